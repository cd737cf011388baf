//! Points, boxes and stretches of lines in the plane, in pixels.

/// A point, or a way from one to another.
pub(crate) type Point = [f64; 2];

/// A stretch of a line.
pub(crate) type Segment = [Point; 2];

/// A box: its middle, half its width and half its height.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Rect {
    /// Its middle.
    pub(crate) middle: Point,
    /// Half its width and half its height.
    pub(crate) half: Point,
}

/// From one point to another.
pub(crate) fn minus(a: Point, b: Point) -> Point {
    [a[0] - b[0], a[1] - b[1]]
}

/// A point that far along a way.
pub(crate) fn along(p: Point, u: Point, t: f64) -> Point {
    [p[0] + t * u[0], p[1] + t * u[1]]
}

/// The length of a way.
pub(crate) fn length(v: Point) -> f64 {
    libm::hypot(v[0], v[1])
}

/// A way of length 1; to the right where there is none.
pub(crate) fn unit(v: Point) -> Point {
    let l = length(v);
    if l < 1e-9 { [1.0, 0.0] } else { [v[0] / l, v[1] / l] }
}

/// Twice the area that two ways span.
pub(crate) fn cross(a: Point, b: Point) -> f64 {
    a[0] * b[1] - a[1] * b[0]
}

/// How far a point is from a stretch.
pub(crate) fn distance(p: Point, s: Segment) -> f64 {
    let d = minus(s[1], s[0]);
    let square = d[0] * d[0] + d[1] * d[1];
    let v = minus(p, s[0]);
    let t = if square > 0.0 { ((v[0] * d[0] + v[1] * d[1]) / square).clamp(0.0, 1.0) } else { 0.0 };
    length(minus(p, along(s[0], d, t)))
}

/// Whether two stretches have a point in common.
pub(crate) fn meet(a: Segment, b: Segment) -> bool {
    let side = |s: Segment, p: Point| cross(minus(s[1], s[0]), minus(p, s[0]));
    let (p, q) = (side(a, b[0]), side(a, b[1]));
    let (r, s) = (side(b, a[0]), side(b, a[1]));
    (p < 0.0) != (q < 0.0) && (r < 0.0) != (s < 0.0)
}

/// How far two stretches are from each other.
pub(crate) fn apart(a: Segment, b: Segment) -> f64 {
    if meet(a, b) {
        return 0.0;
    }
    distance(a[0], b).min(distance(a[1], b)).min(distance(b[0], a)).min(distance(b[1], a))
}

impl Rect {
    /// It with a margin.
    pub(crate) fn grown(self, by: f64) -> Rect {
        Rect { half: [self.half[0] + by, self.half[1] + by], ..self }
    }

    /// Whether two boxes overlap.
    pub(crate) fn meets(self, other: Rect) -> bool {
        (0..2).all(|k| (self.middle[k] - other.middle[k]).abs() < self.half[k] + other.half[k])
    }

    /// Whether another box lies in it.
    pub(crate) fn covers(self, other: Rect) -> bool {
        (0..2).all(|k| (self.middle[k] - other.middle[k]).abs() + other.half[k] < self.half[k])
    }

    /// Whether a stretch has a point in it.
    pub(crate) fn crossed(self, [a, b]: Segment) -> bool {
        let (mut from, mut to) = (0.0f64, 1.0f64);
        for k in 0..2 {
            let (start, d) = (a[k] - self.middle[k], b[k] - a[k]);
            if d.abs() < 1e-9 {
                if start.abs() >= self.half[k] {
                    return false;
                }
                continue;
            }
            let (s, t) = ((-self.half[k] - start) / d, (self.half[k] - start) / d);
            from = from.max(s.min(t));
            to = to.min(s.max(t));
        }
        from < to
    }

    /// Where a ray from a point in it leaves it.
    pub(crate) fn leave(self, from: Point, u: Point) -> Point {
        let reach = |k: usize| {
            if u[k].abs() < 1e-9 {
                f64::INFINITY
            } else {
                (self.half[k] - (from[k] - self.middle[k]) * u[k].signum()) / u[k].abs()
            }
        };
        along(from, u, reach(0).min(reach(1)).clamp(0.0, 1e6))
    }
}
