//! A picture of the limits: stiffness over damping, both in decades.

use super::limit::{Curve, DAMPING, Limit, STIFFNESS, colgate};
use super::wall::{FRICTION, PERIOD};
use bond::internal::{Anchor, BLACK, COLOURS, Colour, Drawing, GREY, Mark, PALE, power};

/// Places in the picture, in points.
struct Layout {
    /// Width and height of the picture.
    size: (f64, f64),
    /// Left, top, right and bottom of the frame.
    frame: [f64; 4],
    /// Distance of two lines of the legend.
    legend: f64,
}

const LAYOUT: Layout = Layout { size: (960.0, 560.0), frame: [84.0, 56.0, 640.0, 492.0], legend: 24.0 };

/// The Coulomb friction and the resolution of an encoder, for which the limit of Abbott and Okamura is drawn: N, m.
pub const COULOMB: f64 = 0.02;
pub const RESOLUTION: f64 = 5e-5;

/// Lines of the formulas; lines and marks of the holds.
const DASHES: [&str; 3] = ["9 4", "2 3", "9 3 2 3"];
const WIDTHS: [f64; 3] = [5.0, 3.2, 1.6];
const MARKS: [Mark; 3] = [Mark::Circle, Mark::Square, Mark::Triangle];

/// Where a damping and a stiffness are.
fn at(b: f64, k: f64) -> (f64, f64) {
    let [left, top, right, bottom] = LAYOUT.frame;
    let part = |x: f64, (low, high): (i32, i32)| (x.log10() - f64::from(low)) / f64::from(high - low);
    (
        left + part(b, DAMPING).clamp(0.0, 1.0) * (right - left),
        bottom - part(k, STIFFNESS).clamp(0.0, 1.0) * (bottom - top),
    )
}

/// Colgate's limit down to the edge of the frame.
fn bound() -> Vec<(f64, f64)> {
    let lowest = 10f64.powi(STIFFNESS.0);
    let last = FRICTION - 0.5 * PERIOD * lowest;
    let from = f64::from(DAMPING.0);
    (0..=60)
        .map(|i| 10f64.powf(from + (last.log10() - from) * f64::from(i) / 60.0))
        .map(|b| at(b, colgate(b)))
        .collect()
}

/// What stands beside the frame, from the top.
struct Legend {
    y: f64,
}

impl Legend {
    fn entry(&mut self, d: &mut Drawing, words: [&str; 2], colour: Colour, dashes: Option<&'static str>) -> (f64, f64) {
        let x = LAYOUT.frame[2] + 18.0;
        let middle = (x + 16.0, self.y - 4.0);
        d.line(&[(x, middle.1), (x + 32.0, middle.1)], colour, 2.0, dashes);
        d.text((x + 42.0, self.y), words[0], 13, BLACK, Anchor::Start);
        if !words[1].is_empty() {
            d.text((x + 42.0, self.y + 16.0), words[1], 12, GREY, Anchor::Start);
            self.y += 16.0;
        }
        self.y += LAYOUT.legend;
        middle
    }
}

fn frame(d: &mut Drawing, title: &str) {
    let [left, top, right, bottom] = LAYOUT.frame;
    d.text((left, 32.0), title, 16, BLACK, Anchor::Start);
    for k in DAMPING.0..=DAMPING.1 {
        let (x, _) = at(10f64.powi(k), 1.0);
        d.line(&[(x, top), (x, bottom)], PALE, 1.0, None);
        d.text((x, bottom + 20.0), &power(k), 13, BLACK, Anchor::Middle);
    }
    for k in STIFFNESS.0..=STIFFNESS.1 {
        let (_, y) = at(1.0, 10f64.powi(k));
        d.line(&[(left, y), (right, y)], PALE, 1.0, None);
        d.text((left - 8.0, y + 4.0), &power(k), 13, BLACK, Anchor::End);
    }
    d.text((0.5 * (left + right), bottom + 46.0), "damping B of the wall, N s/m", 14, BLACK, Anchor::Middle);
    d.text_up((26.0, 0.5 * (top + bottom)), "largest stiffness K of the wall, N/m", 14, BLACK, Anchor::Middle);
}

/// A curve, in pieces where it has a limit; at the edges where it has none.
fn curve(d: &mut Drawing, curve: &Curve, colour: Colour, mark: Mark, width: f64) {
    let dashes = curve.budget.then_some("5 4");
    let (mut line, mut marks) = (Vec::new(), Vec::new());
    let mut before = Limit::Below;
    for (b, limit) in &curve.points {
        match limit {
            Limit::Below => {
                // It ends between this damping and the one before.
                if before != Limit::Below {
                    line.push(at(*b, 1.0));
                }
                d.line(&line, colour, width, dashes);
                line.clear();
            }
            Limit::At(k) => {
                line.push(at(*b, *k));
                marks.push(at(*b, *k));
            }
            Limit::Above => line.push(at(*b, f64::INFINITY)),
        }
        before = *limit;
    }
    d.line(&line, colour, width, dashes);
    marks.into_iter().for_each(|at| d.mark(mark, at, 3.6, colour, !curve.budget));
}

/// The limits of all holds, and those of the formulas.
pub fn chart(title: &str, curves: &[Curve], formulas: bool) -> Drawing {
    let [left, top, right, bottom] = LAYOUT.frame;
    let mut d = Drawing::new(LAYOUT.size.0, LAYOUT.size.1);
    frame(&mut d, title);
    let mut legend = Legend { y: top + 14.0 };
    for (i, c) in curves.iter().enumerate() {
        let (colour, mark) = (COLOURS[i % 3], MARKS[i % 3]);
        // Where curves lie on one another, the wider ones look out from behind.
        curve(&mut d, c, colour, mark, WIDTHS[i % 3]);
        let name = format!("{}{}", c.hold, if c.budget { "" } else { ", budget off" });
        let all = |limit: fn(&Limit) -> bool| c.points.iter().all(|p| limit(&p.1));
        let note = if all(|l| *l == Limit::Above) {
            "no limit: along the upper edge"
        } else if all(|l| *l == Limit::Below) {
            "no wall passes"
        } else {
            ""
        };
        let middle = legend.entry(&mut d, [&name, note], colour, c.budget.then_some("5 4"));
        d.mark(mark, middle, 3.6, colour, !c.budget);
    }
    if formulas {
        legend.y += 10.0;
        d.line(&bound(), BLACK, 1.6, Some(DASHES[0]));
        legend.entry(&mut d, ["Colgate, Schenkel (lagged)", "b = K T/2 + |B|"], BLACK, Some(DASHES[0]));
        let friction = 2.0 * FRICTION / PERIOD;
        let encoder = 2.0 * COULOMB / RESOLUTION;
        for (k, dashes, formula) in [
            (friction, DASHES[1], format!("K = 2 b/T = {friction} N/m")),
            (encoder, DASHES[2], format!("K = 2 f_c/Δ = {encoder} N/m")),
        ] {
            let y = at(1.0, k).1;
            d.line(&[(left, y), (right, y)], GREY, 1.6, Some(dashes));
            legend.entry(&mut d, ["Abbott, Okamura", &formula], GREY, Some(dashes));
        }
    }
    d.line(&[(left, top), (left, bottom), (right, bottom), (right, top), (left, top)], BLACK, 1.0, None);
    d
}
