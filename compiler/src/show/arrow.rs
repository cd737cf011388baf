//! A bond in SVG: a straight line with the barb of a half arrow, the causal stroke, the double bar, its name.

use super::layout::Point;
use bond_grammar::ast::Stroke;
use std::fmt::Write;

/// A bond to be drawn.
pub(super) struct Arrow<'a> {
    /// Centre and half size of the label it starts at.
    pub(super) tail: (Point, Point),
    /// The same where it ends.
    pub(super) head: (Point, Point),
    /// The causal stroke.
    pub(super) stroke: Option<Stroke>,
    /// `||>`
    pub(super) sampled: bool,
    /// The name the user gave it.
    pub(super) name: Option<&'a str>,
}

/// Text that is safe in XML.
pub(super) fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// Where a ray from the centre of a label leaves it, with a little air.
fn leave((centre, half): (Point, Point), towards: Point) -> Point {
    let t = [0, 1]
        .map(|k| if towards[k].abs() < 1e-9 { f64::INFINITY } else { (half[k] + 4.0) / towards[k].abs() })
        .into_iter()
        .fold(f64::INFINITY, f64::min);
    [centre[0] + t * towards[0], centre[1] + t * towards[1]]
}

impl Arrow<'_> {
    /// The elements of the picture.
    pub(super) fn svg(&self, text: &mut String) {
        let d = [self.head.0[0] - self.tail.0[0], self.head.0[1] - self.tail.0[1]];
        let length = libm::hypot(d[0], d[1]);
        if length < 1e-6 {
            return;
        }
        let u = [d[0] / length, d[1] / length];
        let (a, b) = (leave(self.tail, u), leave(self.head, [-u[0], -u[1]]));
        // One side of the line for all: the side of the flow, below or right of it.
        let n = if u[0] > 0.3 || (u[0].abs() <= 0.3 && u[1] < 0.0) { [-u[1], u[0]] } else { [u[1], -u[0]] };
        let at = |p: Point, along: f64, across: f64| {
            [p[0] + along * u[0] + across * n[0], p[1] + along * u[1] + across * n[1]]
        };
        let line = |text: &mut String, p: Point, q: Point, class: &str| {
            let _ = writeln!(
                text,
                "<line class=\"{class}\" x1=\"{:.1}\" y1=\"{:.1}\" x2=\"{:.1}\" y2=\"{:.1}\"/>",
                p[0], p[1], q[0], q[1]
            );
        };
        line(text, a, b, "bond");
        line(text, b, at(b, -10.0, 6.5), "bond");
        match self.stroke {
            Some(Stroke::Head) => line(text, at(b, 0.0, -6.5), at(b, 0.0, 6.5), "stroke"),
            Some(Stroke::Tail) => line(text, at(a, 0.0, -6.5), at(a, 0.0, 6.5), "stroke"),
            None => {}
        }
        let middle = [0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1])];
        if self.sampled {
            for along in [-3.0, 3.0] {
                line(text, at(middle, along, -11.0), at(middle, along, 11.0), "bar");
            }
        }
        if let Some(name) = self.name {
            let p = at(middle, 0.0, if self.sampled { -18.0 } else { -11.0 });
            let _ = writeln!(
                text,
                "<text class=\"name\" x=\"{:.1}\" y=\"{:.1}\">{}</text>",
                p[0],
                p[1] + 3.5,
                escape(name)
            );
        }
    }
}
