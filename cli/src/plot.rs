//! Probes over time as a picture: a panel for each unit, one above the other.

use crate::pending::Sink;
use crate::picture;
use crate::stop::Stop;
use bond::internal::{Anchor, BLACK, COLOURS, Drawing, GREY, Mark, PALE, power};
use bond_compiler::units;
use bond_runtime::scene::Probes;
use std::path::PathBuf;

/// Places in the picture, in points, and how much it shows.
struct Layout {
    /// Width of the picture.
    width: f64,
    /// Left and right of the frames.
    left: f64,
    right: f64,
    /// Top of the first frame.
    top: f64,
    /// Distance of two frames.
    gap: f64,
    /// Room below the last frame.
    below: f64,
    /// Distance of two lines of the legend.
    legend: f64,
    /// Most letters of a name in the legend.
    letters: usize,
    /// Most probes.
    traces: usize,
    /// Most frames.
    panels: usize,
    /// Most rows of a run that has a mark at each.
    marked: usize,
}

const LAYOUT: Layout = Layout {
    width: 960.0,
    left: 96.0,
    right: 744.0,
    top: 52.0,
    gap: 22.0,
    below: 58.0,
    legend: 16.0,
    letters: 25,
    traces: 200,
    panels: 16,
    marked: 60,
};

/// Columns of a frame, two per point. Of the rows in one, at most the first, the least, the largest and the last are
/// drawn.
const COLUMNS: f64 = 2.0 * (LAYOUT.right - LAYOUT.left);
/// A span below this part of the size shown is rounding, and drawn as no change.
const SMALLEST_SPAN: f64 = 1e-12;
/// Sizes below `SMALLEST_DRAWN` are drawn as 0, sizes above `LARGEST_DRAWN` as `LARGEST_DRAWN`.
const SMALLEST_DRAWN: f64 = 1e-290;
const LARGEST_DRAWN: f64 = 1e300;

/// A picture that is being made: what it keeps of a run does not grow with its rows.
pub struct Plot {
    path: PathBuf,
    title: String,
    from: f64,
    stop: f64,
    rows: usize,
    panels: Vec<Panel>,
    /// Probes that are not drawn.
    left: usize,
}

/// What has one unit.
struct Panel {
    unit: String,
    traces: Vec<Trace>,
}

/// What is drawn of a probe.
struct Trace {
    name: String,
    /// Its place in a row.
    place: usize,
    columns: Vec<Column>,
    /// Whether there was no number since the last column.
    gap: bool,
}

/// The rows that fall in one column, as instants and values.
struct Column {
    index: u32,
    first: (f64, f64),
    least: (f64, f64),
    most: (f64, f64),
    last: (f64, f64),
    /// Whether the line begins anew here.
    gap: bool,
}

impl Column {
    /// Its points in the order of time.
    fn points(&self) -> impl Iterator<Item = (f64, f64)> {
        let (a, b) = if self.least.0 <= self.most.0 { (self.least, self.most) } else { (self.most, self.least) };
        [self.first, a, b, self.last].into_iter()
    }
}

impl Trace {
    fn take(&mut self, index: u32, t: f64, value: f64) {
        if !value.is_finite() {
            self.gap = true;
            return;
        }
        let at = (t, if value.abs() < SMALLEST_DRAWN { 0.0 } else { value.clamp(-LARGEST_DRAWN, LARGEST_DRAWN) });
        match self.columns.last_mut() {
            Some(c) if c.index == index => {
                if at.1 < c.least.1 {
                    c.least = at;
                }
                if at.1 > c.most.1 {
                    c.most = at;
                }
                c.last = at;
            }
            _ => self.columns.push(Column { index, first: at, least: at, most: at, last: at, gap: self.gap }),
        }
        self.gap = false;
    }

    /// Its lines, in seconds and its unit.
    fn lines(&self) -> Vec<Vec<(f64, f64)>> {
        let mut list: Vec<Vec<(f64, f64)>> = Vec::new();
        for column in &self.columns {
            if column.gap || list.is_empty() {
                list.push(Vec::new());
            }
            if let Some(line) = list.last_mut() {
                line.extend(column.points());
                line.dedup();
            }
        }
        list
    }
}

impl Plot {
    /// An empty one of a scene's probes over a run, in s.
    ///
    /// # Errors
    /// A scene without probes.
    pub fn new(path: PathBuf, title: &str, probes: &Probes, (from, stop): (f64, f64)) -> Result<Self, Stop> {
        if probes.names.is_empty() {
            return Err(Stop::Usage(format!(
                "there is nothing to draw in {}: `{title}` has no probe; add one, such as `probe x = spring.q`",
                path.display()
            )));
        }
        let mut plot = Self { path, title: title.into(), from, stop, rows: 0, panels: Vec::new(), left: 0 };
        for (i, (name, unit)) in probes.names.iter().zip(&probes.units).enumerate() {
            let unit = unit.as_deref().unwrap_or_default();
            let known = plot.panels.iter().position(|p| p.unit == unit);
            if i - plot.left >= LAYOUT.traces || known.is_none() && plot.panels.len() >= LAYOUT.panels {
                plot.left += 1;
                continue;
            }
            let k = known.unwrap_or_else(|| {
                plot.panels.push(Panel { unit: unit.into(), traces: Vec::new() });
                plot.panels.len() - 1
            });
            let trace = Trace { name: name.clone(), place: i + 1, columns: Vec::new(), gap: false };
            plot.panels[k].traces.push(trace);
        }
        Ok(plot)
    }

    /// The number of probes without room.
    pub fn left(&self) -> usize {
        self.left
    }

    fn drawing(&self) -> Drawing {
        let height = match self.panels.len() {
            0 | 1 => 420.0,
            2 => 260.0,
            _ => 190.0,
        };
        let count = self.panels.len() as f64;
        let mut d = Drawing::new(LAYOUT.width, LAYOUT.top + count * (height + LAYOUT.gap) - LAYOUT.gap + LAYOUT.below);
        d.text((LAYOUT.left, 30.0), &self.title, 18, BLACK, Anchor::Start);
        let time = Axis::over(self.from, self.stop, 8.0, (LAYOUT.left, LAYOUT.right));
        for (i, panel) in self.panels.iter().enumerate() {
            let top = LAYOUT.top + i as f64 * (height + LAYOUT.gap);
            self.panel(&mut d, panel, &time, (top, top + height));
        }
        let bottom = LAYOUT.top + count * (height + LAYOUT.gap) - LAYOUT.gap;
        for (at, label) in time.ticks() {
            d.text((at, bottom + 18.0), &label, 12, BLACK, Anchor::Middle);
        }
        d.text(
            (0.5 * (LAYOUT.left + LAYOUT.right), bottom + 42.0),
            &format!("t, {}", time.unit("s")),
            13,
            BLACK,
            Anchor::Middle,
        );
        d
    }

    fn panel(&self, d: &mut Drawing, panel: &Panel, time: &Axis, (top, bottom): (f64, f64)) {
        let all = || panel.traces.iter().flat_map(|t| &t.columns);
        let low = all().map(|c| c.least.1).fold(f64::INFINITY, f64::min);
        let high = all().map(|c| c.most.1).fold(f64::NEG_INFINITY, f64::max);
        let y = Axis::around(low, high, (bottom - top) / 32.0, (bottom, top));
        for (at, _) in time.ticks() {
            d.line(&[(at, top), (at, bottom)], PALE, 1.0, None);
        }
        for (at, label) in y.ticks() {
            d.line(&[(LAYOUT.left, at), (LAYOUT.right, at)], PALE, 1.0, None);
            d.text((LAYOUT.left - 8.0, at + 4.0), &label, 12, BLACK, Anchor::End);
        }
        if y.low < 0.0 && y.high > 0.0 {
            d.line(&[(LAYOUT.left, y.at(0.0)), (LAYOUT.right, y.at(0.0))], GREY, 0.8, None);
        }
        for (k, trace) in panel.traces.iter().enumerate() {
            let (colour, dashes) = (COLOURS[k % COLOURS.len()], DASHES[k / COLOURS.len() % DASHES.len()]);
            for line in trace.lines() {
                let line: Vec<_> = line.into_iter().map(|(t, v)| (time.at(t), y.at(v))).collect();
                d.line(&line, colour, 1.5, dashes);
                if self.rows <= LAYOUT.marked || line.len() == 1 {
                    line.iter().for_each(|at| d.mark(Mark::Circle, *at, 2.2, colour, true));
                }
            }
        }
        d.line(
            &[
                (LAYOUT.left, top),
                (LAYOUT.left, bottom),
                (LAYOUT.right, bottom),
                (LAYOUT.right, top),
                (LAYOUT.left, top),
            ],
            BLACK,
            1.0,
            None,
        );
        d.text_up((22.0, 0.5 * (top + bottom)), &y.unit(&panel.unit), 13, BLACK, Anchor::Middle);
        legend(d, panel, (top, bottom));
    }
}

impl Sink for Plot {
    fn row(&mut self, row: &[f64]) -> Result<(), Stop> {
        self.rows += 1;
        let t = row[0];
        let part = (t - self.from) / (self.stop - self.from);
        // A last row may be a rounding beyond the end.
        let index = (part.clamp(0.0, 1.0) * COLUMNS) as u32;
        for trace in self.panels.iter_mut().flat_map(|p| &mut p.traces) {
            trace.take(index, t, row[trace.place]);
        }
        Ok(())
    }

    fn commit(self) -> Result<(), Stop> {
        picture::put(&self.drawing(), &self.path)
    }
}

/// Dashes that distinguish lines of one colour.
const DASHES: [Option<&str>; 3] = [None, Some("7 3"), Some("2 3")];

/// Names beside a frame.
fn legend(d: &mut Drawing, panel: &Panel, (top, bottom): (f64, f64)) {
    let room = ((bottom - top) / LAYOUT.legend) as usize;
    let count = panel.traces.len();
    let shown = if count > room { room - 1 } else { count };
    let row = |k: usize| top + LAYOUT.legend * (k as f64 + 0.5);
    for (k, trace) in panel.traces.iter().take(shown).enumerate() {
        let (colour, dashes) = (COLOURS[k % COLOURS.len()], DASHES[k / COLOURS.len() % DASHES.len()]);
        d.line(&[(LAYOUT.right + 10.0, row(k)), (LAYOUT.right + 30.0, row(k))], colour, 1.5, dashes);
        d.text((LAYOUT.right + 36.0, row(k) + 4.0), &shortened(&trace.name), 12, BLACK, Anchor::Start);
    }
    if count > shown {
        d.text(
            (LAYOUT.right + 36.0, row(shown) + 4.0),
            &format!("and {} more", count - shown),
            12,
            GREY,
            Anchor::Start,
        );
    }
}

/// A name; if it is too long, without its middle.
fn shortened(name: &str) -> String {
    let letters: Vec<char> = name.chars().collect();
    if letters.len() <= LAYOUT.letters {
        return name.into();
    }
    let half = LAYOUT.letters / 2;
    letters[..half].iter().chain(&['…']).chain(&letters[letters.len() - half..]).collect()
}

/// A side of a frame, evenly divided, with ticks at round numbers.
struct Axis {
    low: f64,
    high: f64,
    /// Between two ticks.
    step: f64,
    /// What labels count from, and the power of ten by which they do.
    base: f64,
    exponent: i32,
    /// Digits of the labels after their point.
    digits: usize,
    /// Where its ends are drawn.
    place: (f64, f64),
}

impl Axis {
    /// From one value to another, with some `count` ticks.
    fn over(low: f64, high: f64, count: f64, place: (f64, f64)) -> Self {
        let raw = (high - low) / count;
        let k = raw.log10().floor();
        let unit = 10f64.powi(k as i32);
        let step = unit * [1.0, 2.0, 5.0, 10.0].into_iter().find(|m| m * unit >= raw * (1.0 - 1e-9)).unwrap_or(10.0);
        let size = low.abs().max(high.abs());
        // Labels of a small change beside a large value count from a value.
        let base = if size > 1e6 * step { (low / step).ceil() * step } else { 0.0 };
        let told = if base == 0.0 { size } else { high - low };
        let decade = told.log10().floor() as i32;
        let exponent = if (-2..=3).contains(&decade) { 0 } else { 3 * decade.div_euclid(3) };
        let digits = (f64::from(exponent) - (step * (1.0 + 1e-9)).log10().floor()).max(0.0) as usize;
        Self { low, high, step, base, exponent, digits, place }
    }

    /// Around values from `low` to `high`; an arbitrary range without values.
    fn around(low: f64, high: f64, count: f64, place: (f64, f64)) -> Self {
        let size = low.abs().max(high.abs());
        let (low, high) = if low > high || size == 0.0 {
            (-1.0, 1.0)
        } else if high - low < SMALLEST_SPAN * size {
            (low - 0.1 * size, high + 0.1 * size)
        } else {
            let margin = 0.05 * (high - low);
            (low - margin, high + margin)
        };
        Self::over(low, high, count, place)
    }

    fn at(&self, x: f64) -> f64 {
        let part = (x - self.low) / (self.high - self.low);
        self.place.0 + part.clamp(0.0, 1.0) * (self.place.1 - self.place.0)
    }

    /// The places of its ticks, and their labels.
    fn ticks(&self) -> Vec<(f64, String)> {
        let first = (self.low / self.step - 1e-9).ceil();
        let value = |i: u32| (first + f64::from(i)) * self.step;
        let inside = |x: &f64| *x <= self.high + 1e-9 * self.step;
        (0..40)
            .map(value)
            .take_while(inside)
            .map(|x| {
                let told = (x - self.base) / 10f64.powi(self.exponent);
                // No -0.
                let told = if told.abs() < 1e-9 { 0.0 } else { told };
                (self.at(x), format!("{told:.*}", self.digits))
            })
            .collect()
    }

    /// What its labels are in.
    fn unit(&self, unit: &str) -> String {
        let factor = if self.exponent == 0 { String::new() } else { power(self.exponent) };
        let text = match unit {
            "" | "1" if !factor.is_empty() => factor,
            _ => [factor.as_str(), units::in_prose(unit)].join(" ").trim().to_string(),
        };
        if self.base == 0.0 { text } else { format!("{text} above {}", self.base).trim().to_string() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(low: f64, high: f64) -> (Vec<String>, String) {
        let axis = Axis::over(low, high, 5.0, (0.0, 1.0));
        (axis.ticks().into_iter().map(|t| t.1).collect(), axis.unit("m"))
    }

    #[test]
    fn ticks_are_round() {
        assert_eq!(labels(0.0, 1.0), (["0.0", "0.2", "0.4", "0.6", "0.8", "1.0"].map(String::from).into(), "m".into()));
        assert_eq!(labels(-2.0, 8.0), (["-2", "0", "2", "4", "6", "8"].map(String::from).into(), "m".into()));
        assert_eq!(labels(0.0, 4e-5), (["0", "10", "20", "30", "40"].map(String::from).into(), "10⁻⁶ m".into()));
        let (list, unit) = labels(1e9, 1e9 + 4.0);
        assert_eq!((list, unit.as_str()), (["0", "1", "2", "3", "4"].map(String::from).into(), "m above 1000000000"));
    }

    #[test]
    fn any_values_have_an_axis() {
        for (low, high) in [
            (0.0, 0.0),
            (1.0, 1.0),
            (-LARGEST_DRAWN, LARGEST_DRAWN),
            (SMALLEST_DRAWN, 2.0 * SMALLEST_DRAWN),
            (1.0, 1.0 + 1e-11),
        ] {
            let axis = Axis::around(low, high, 5.0, (0.0, 100.0));
            let ticks = axis.ticks();
            assert!((2..20).contains(&ticks.len()), "{low} to {high}: {ticks:?}");
            assert!(ticks.iter().all(|t| (0.0..=100.0).contains(&t.0)));
        }
        let none = Axis::around(f64::INFINITY, f64::NEG_INFINITY, 5.0, (0.0, 1.0));
        assert_eq!((none.low, none.high), (-1.0, 1.0));
    }

    #[test]
    fn what_is_kept_does_not_grow_with_the_rows() -> Result<(), Stop> {
        let probes = Probes {
            names: vec!["x".into(), "y".into()],
            units: vec![Some("m".into()), None],
            program: None,
            gather: Vec::new(),
            inputs: Vec::new(),
            expectations: Vec::new(),
        };
        let mut plot = Plot::new("x.svg".into(), "Scene", &probes, (0.0, 1.0))?;
        let n = 100_000;
        for i in 0..=n {
            let t = f64::from(i) / f64::from(n);
            let hole = (40_000..60_000).contains(&i);
            plot.row(&[t, (1e3 * t).sin(), if hole { f64::NAN } else { t }])?;
        }
        let kept: Vec<usize> = plot.panels.iter().map(|p| p.traces[0].columns.len()).collect();
        assert!(kept.iter().all(|k| *k <= COLUMNS as usize + 1), "{kept:?}");
        assert_eq!(plot.panels[1].traces[0].lines().len(), 2);
        let x = &plot.panels[0].traces[0];
        assert!(x.lines()[0].windows(2).all(|w| w[0].0 <= w[1].0));
        assert!(x.columns.iter().any(|c| c.most.1 > 0.999_99));
        Ok(())
    }
}
