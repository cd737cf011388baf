//! The comparison as a picture: error against time, both in decades.

use super::Bench;
use super::front::place;
use super::point::Point;
use super::setting::{Setting, time};
use bond::internal::{Anchor, BLACK, COLOURS, Colour, Drawing, GREY, Mark, PALE, power};

/// Places in the picture, in points.
struct Layout {
    /// Width and height of the picture.
    size: (f64, f64),
    /// Left, top, right and bottom of the frame.
    frame: [f64; 4],
    /// The largest error that is drawn.
    largest: f64,
}

const LAYOUT: Layout = Layout { size: (960.0, 640.0), frame: [92.0, 64.0, 770.0, 560.0], largest: 10.0 };

const SHADE: Colour = [244, 244, 244];
const FRONT: Colour = [255, 214, 110];
const MARKS: [Mark; 4] = [Mark::Circle, Mark::Square, Mark::Triangle, Mark::Diamond];

/// A decimal scale of a frame's side.
struct Scale {
    /// Exponents of its ends.
    low: i32,
    high: i32,
    /// Where those are.
    from: f64,
    to: f64,
}

impl Scale {
    /// Whole decades around the values; one decade if there are none.
    fn around(values: impl Iterator<Item = f64>, from: f64, to: f64) -> Self {
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for x in values.filter(|x| *x > 0.0 && x.is_finite()) {
            low = low.min(x.log10());
            high = high.max(x.log10());
        }
        let (low, high) = if low <= high { (low.floor() as i32, high.ceil() as i32) } else { (-1, 0) };
        Self { low, high: high.max(low + 1), from, to }
    }

    fn at(&self, x: f64) -> f64 {
        let part = (x.log10() - f64::from(self.low)) / f64::from(self.high - self.low);
        self.from + part.clamp(0.0, 1.0) * (self.to - self.from)
    }
}

/// Draws it.
pub fn picture(b: &Bench) -> Drawing {
    let mut d = Drawing::new(LAYOUT.size.0, LAYOUT.size.1);
    let [left, top, right, bottom] = LAYOUT.frame;
    let shown: Vec<(&Point, f64, f64)> = b.points.iter().filter_map(|p| spot(b, p).map(|(e, s)| (p, e, s))).collect();
    let x = Scale::around(shown.iter().map(|s| s.1), left, right);
    let y = Scale::around(shown.iter().map(|s| s.2), bottom, top);
    d.text((left, 30.0), &format!("{}: speed against error", b.model), 18, BLACK, Anchor::Start);
    let told = format!("{} simulated; errors against {}", time(b.stop), b.reference.how);
    d.text((left, 50.0), &told, 12, GREY, Anchor::Start);
    // Errors below the accuracy of the reference.
    let floor = super::point::TIMES_REFERENCE * b.reference.error;
    if floor.log10() > f64::from(x.low) {
        let edge = x.at(floor);
        d.rect((left, top), (edge - left, bottom - top), SHADE);
        d.text_up((left + 14.0, bottom - 8.0), "within the reference's own error", 11, GREY, Anchor::Start);
    }
    axes(&mut d, &x, &y);
    let mut front: Vec<(f64, f64)> = shown.iter().filter(|s| s.0.front).map(|s| (x.at(s.1), y.at(s.2))).collect();
    front.sort_by(|a, b| a.0.total_cmp(&b.0));
    d.line(&front, FRONT, 9.0, None);
    let mut methods: Vec<&str> = Vec::new();
    for p in &b.points {
        if !methods.contains(&p.method) {
            methods.push(p.method);
        }
    }
    for (i, method) in methods.iter().enumerate() {
        let (colour, mark) = (COLOURS[i % COLOURS.len()], MARKS[i % MARKS.len()]);
        for fixed in [true, false] {
            let own =
                shown.iter().filter(|s| s.0.method == *method && matches!(s.0.setting, Setting::Step(_)) == fixed);
            let own: Vec<(&Point, (f64, f64))> = own.map(|s| (s.0, (x.at(s.1), y.at(s.2)))).collect();
            let line: Vec<(f64, f64)> = own.iter().map(|o| o.1).collect();
            d.line(&line, colour, 1.4, (!fixed).then_some("5 4"));
            for (p, at) in own {
                d.mark(mark, at, 4.2, colour, p.keeps());
            }
        }
        let at = (right + 26.0, top + 14.0 + 20.0 * i as f64);
        let passive = b.points.iter().any(|p| p.method == *method && p.passive);
        d.line(&[(at.0 - 12.0, at.1), (at.0 + 12.0, at.1)], colour, 1.4, None);
        d.mark(mark, at, 4.2, colour, passive);
        d.text((at.0 + 20.0, at.1 + 4.0), method, 13, BLACK, Anchor::Start);
    }
    legend(&mut d, top + 14.0 + 20.0 * methods.len() as f64 + 16.0);
    d
}

/// Where a point is: error, and time for a simulated second.
fn spot(b: &Bench, p: &Point) -> Option<(f64, f64)> {
    place(p, 0.0).map(|(e, s)| (e.max(1e-16), s / b.stop)).filter(|(e, s)| *e <= LAYOUT.largest && *s > 0.0)
}

fn axes(d: &mut Drawing, x: &Scale, y: &Scale) {
    let [left, top, right, bottom] = LAYOUT.frame;
    let apart = |s: &Scale| ((s.high - s.low + 11) / 12).max(1);
    for k in x.low..=x.high {
        let at = x.at(decade(k));
        d.line(&[(at, top), (at, bottom)], PALE, 1.0, None);
        if (k - x.high) % apart(x) == 0 {
            d.text((at, bottom + 19.0), &power(k), 13, BLACK, Anchor::Middle);
        }
    }
    for k in y.low..=y.high {
        let at = y.at(decade(k));
        d.line(&[(left, at), (right, at)], PALE, 1.0, None);
        if (k - y.high) % apart(y) == 0 {
            d.text((left - 9.0, at + 4.5), &time(decade(k)), 13, BLACK, Anchor::End);
        }
    }
    d.line(&[(left, top), (left, bottom), (right, bottom), (right, top), (left, top)], BLACK, 1.0, None);
    let (middle, height) = (0.5 * (left + right), 0.5 * (top + bottom));
    d.text((middle, bottom + 46.0), "error at the end, relative", 13, BLACK, Anchor::Middle);
    d.text_up((24.0, height), "processor time for a simulated second", 13, BLACK, Anchor::Middle);
}

/// What filled marks, dashes and the broad line mean.
fn legend(d: &mut Drawing, from: f64) {
    let left = LAYOUT.frame[2] + 14.0;
    let row = |i: f64| from + 20.0 * i;
    d.mark(Mark::Circle, (left + 12.0, row(0.0)), 4.2, GREY, true);
    d.mark(Mark::Circle, (left + 12.0, row(1.0)), 4.2, GREY, false);
    d.line(&[(left, row(2.0)), (left + 24.0, row(2.0))], GREY, 1.4, None);
    d.line(&[(left, row(3.0)), (left + 24.0, row(3.0))], GREY, 1.4, Some("5 4"));
    d.line(&[(left, row(4.0)), (left + 24.0, row(4.0))], FRONT, 9.0, None);
    let words = ["keeps the balance", "does not", "fixed steps", "steps to a tolerance", "front"];
    for (i, words) in words.iter().enumerate() {
        d.text((left + 32.0, row(i as f64) + 4.0), words, 12, GREY, Anchor::Start);
    }
}

fn decade(k: i32) -> f64 {
    10f64.powi(k)
}
