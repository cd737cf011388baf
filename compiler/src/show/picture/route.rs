//! Lines with corners, where no straight one is free: the cheapest way over a fine grid, round labels and marks.

use super::geometry::{Point, Rect, Segment, along, apart, distance};
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// Pixels from one line of the fine grid to the next.
const STEP: f64 = 6.0;

/// Pixels beside a line that others keep off.
const BESIDE: f64 = 7.0;

/// What a way costs, in tenths of a step.
struct Costs {
    step: u32,
    corner: u32,
    /// A step on a line that is there, or right beside it.
    crossing: u32,
    /// A step along a signal from the same place.
    shared: u32,
}

const COSTS: Costs = Costs { step: 10, corner: 60, crossing: 110, shared: 4 };

const FREE: u8 = 0;
const LINE: u8 = 1;
const FULL: u8 = 2;

const WAYS: [[i32; 2]; 4] = [[1, 0], [0, 1], [-1, 0], [0, -1]];

/// A fine grid over the picture.
pub(crate) struct Field {
    low: Point,
    size: [usize; 2],
    /// What is at each point.
    at: Vec<u8>,
    /// What lines and their signs are drawn by, and whose signals they are, counted from 1.
    drawn: Vec<(Segment, u32)>,
    /// All lines, and whose signals they are, counted from 1.
    lines: Vec<(Segment, u32)>,
    /// Whose signal alone runs there, counted from 1.
    owner: Vec<u32>,
}

/// An end of a line, in pixels.
#[derive(Clone, Copy)]
pub(crate) struct End {
    /// How far it is straight.
    pub(crate) lead: f64,
    /// How far signs reach from it; less than 0 if there are none.
    pub(crate) sign: f64,
}

/// Half of the width of a sign.
const SIGN: f64 = 6.5;

/// Half of what lines may start from, at a label that is shorter.
const SHORT: f64 = 16.0;

/// Where a line may end: the point of the grid, the way that leads out of the label, and what it costs.
type Exit = (usize, usize, u32);

impl Field {
    /// A grid over a box.
    pub(crate) fn new(all: Rect) -> Self {
        let low = [0, 1].map(|k| ((all.middle[k] - all.half[k]) / STEP).floor() * STEP);
        let size = [0, 1].map(|k| ((2.0 * all.half[k]) / STEP).ceil() as usize + 2);
        Field {
            low,
            size,
            at: vec![FREE; size[0] * size[1]],
            drawn: Vec::new(),
            lines: Vec::new(),
            owner: vec![0; size[0] * size[1]],
        }
    }

    fn point(&self, cell: usize) -> Point {
        let (x, y) = (cell % self.size[0], cell / self.size[0]);
        [self.low[0] + x as f64 * STEP, self.low[1] + y as f64 * STEP]
    }

    fn next(&self, cell: usize, way: usize) -> Option<usize> {
        let (x, y) = ((cell % self.size[0]) as i32 + WAYS[way][0], (cell / self.size[0]) as i32 + WAYS[way][1]);
        let inside = x >= 0 && y >= 0 && (x as usize) < self.size[0] && (y as usize) < self.size[1];
        inside.then(|| y as usize * self.size[0] + x as usize)
    }

    /// The points of the grid in a box.
    fn cells(&self, around: Rect) -> impl Iterator<Item = usize> + use<> {
        let range = |k: usize| {
            let from = ((around.middle[k] - around.half[k] - self.low[k]) / STEP).ceil().max(0.0) as usize;
            let to = ((around.middle[k] + around.half[k] - self.low[k]) / STEP).floor();
            from..if to < 0.0 { 0 } else { (to as usize + 1).min(self.size[k]) }
        };
        let (xs, width) = (range(0), self.size[0]);
        range(1).flat_map(move |y| xs.clone().map(move |x| y * width + x))
    }

    /// Nothing may run through a box.
    pub(crate) fn block(&mut self, r: Rect) {
        for cell in self.cells(r) {
            self.at[cell] = FULL;
        }
    }

    /// What is drawn: signs of others keep off it.
    pub(crate) fn draw(&mut self, segments: &[Segment], node: Option<usize>) {
        self.drawn.extend(segments.iter().map(|s| (*s, node.map_or(0, |o| o as u32 + 1))));
    }

    /// Whether signs at an end of a bond would meet nothing that is drawn.
    fn clear(&self, tip: Point, way: usize, sign: f64) -> bool {
        let (out, across) = (WAYS[way].map(f64::from), WAYS[(way + 1) % 4].map(f64::from));
        let at = |t: f64, s: f64| along(along(tip, out, t), across, s);
        let signs = [2.0, sign + 2.0].map(|t| [at(t, -SIGN), at(t, SIGN)]);
        let near = |(s, _): &&(Segment, u32)| {
            (0..2).all(|k| (s[0][k].min(s[1][k]) - 40.0..s[0][k].max(s[1][k]) + 40.0).contains(&tip[k]))
        };
        self.drawn.iter().filter(near).all(|(s, _)| signs.iter().all(|own| apart(*own, *s) >= 2.5))
    }

    /// What crosses a line is to do so straight, except for signals from the same node, which may share it.
    pub(crate) fn line(&mut self, s: Segment, node: Option<usize>) {
        let middle = [0, 1].map(|k| 0.5 * (s[0][k] + s[1][k]));
        let half = [0, 1].map(|k| 0.5 * (s[0][k] - s[1][k]).abs() + BESIDE);
        let owner = node.map_or(0, |o| o as u32 + 1);
        self.lines.push((s, owner));
        for cell in self.cells(Rect { middle, half }) {
            let off = distance(self.point(cell), s);
            if off >= BESIDE || self.at[cell] == FULL {
                continue;
            }
            // What is on the line itself is shared, what is beside it is not.
            let shared = off < 0.1 && (self.at[cell] == FREE || self.owner[cell] == owner);
            self.owner[cell] = if shared { owner } else { 0 };
            self.at[cell] = LINE;
        }
    }

    /// Where lines may leave a label, going straight for a while.
    fn exits(&self, r: Rect, end: End, owner: u32) -> Vec<Exit> {
        let mut list = Vec::new();
        for (way, d) in WAYS.iter().enumerate() {
            let k = usize::from(d[0] == 0);
            let across = 1 - k;
            // A line may start a little beside a short label.
            let reach = (r.half[across] - 1.0).max(SHORT.min(r.half[across] + 4.0));
            let from = ((r.middle[across] - reach - self.low[across]) / STEP).ceil() as i64;
            let to = ((r.middle[across] + reach - self.low[across]) / STEP).floor() as i64;
            let edge = r.middle[k] + f64::from(d[k]) * r.half[k];
            for line in from..=to {
                let off = (self.low[across] + line as f64 * STEP - r.middle[across]).abs();
                // The first point outside of the label, and the last of the straight part.
                let outside = (edge - self.low[k]) / STEP;
                let first = if d[k] > 0 { outside.floor() as i64 + 1 } else { outside.ceil() as i64 - 1 };
                let steps = (end.lead / STEP).ceil() as i64;
                let cell = |n: i64| {
                    let mut c = [0i64; 2];
                    c[k] = first + n * i64::from(d[k]);
                    c[across] = line;
                    let inside = c.iter().zip(self.size).all(|(c, s)| *c >= 0 && (*c as usize) < s);
                    inside.then(|| c[1] as usize * self.size[0] + c[0] as usize)
                };
                let own = |c: usize| owner > 0 && self.owner[c] == owner;
                let free =
                    |n: i64| cell(n).is_some_and(|c| self.at[c] == FREE || own(c) || n == 0 && self.at[c] == FULL);
                let mut tip = [0.0; 2];
                (tip[k], tip[across]) = (edge, self.low[across] + line as f64 * STEP);
                let other = |(s, o): &(Segment, u32)| owner > 0 && *o == owner || distance(tip, *s) >= BESIDE - 1.0;
                let beside = |(s, o): &(Segment, u32)| *o != owner && distance(tip, *s) < BESIDE - 3.0;
                let alone = self.lines.iter().all(other)
                    && (owner == 0 || !self.drawn.iter().any(beside))
                    && (end.sign < 0.0 || self.clear(tip, way, end.sign));
                if alone && (0..=steps).all(free) {
                    list.extend(cell(steps).map(|c| (c, way, (off * 0.6) as u32)));
                }
            }
        }
        list
    }

    /// A way from one label to another, as corners; nothing where there is none.
    pub(crate) fn route(
        &self,
        (from, to): (Rect, Rect),
        ends: [End; 2],
        air: f64,
        node: Option<usize>,
    ) -> Option<Vec<Point>> {
        let owner = node.map_or(0, |o| o as u32 + 1);
        let (starts, goals) = (self.exits(from, ends[0], owner), self.exits(to, ends[1], 0));
        let mut goal_at = rustc_hash::FxHashMap::default();
        for (cell, way, cost) in &goals {
            goal_at.insert((*cell, (*way + 2) % 4), *cost);
        }
        let bound = |k: usize| {
            let values = goals.iter().map(|g| self.point(g.0)[k]);
            values.fold((f64::MAX, f64::MIN), |(l, h), v| (l.min(v), h.max(v)))
        };
        let (bx, by) = (bound(0), bound(1));
        let left = |cell: usize| {
            let p = self.point(cell);
            let off = (bx.0 - p[0]).max(p[0] - bx.1).max(0.0) + (by.0 - p[1]).max(p[1] - by.1).max(0.0);
            (off / STEP) as u32 * if owner > 0 { COSTS.shared } else { COSTS.step }
        };
        let states = self.at.len() * 4;
        let (mut cost, mut before) = (vec![u32::MAX; states], vec![u32::MAX; states]);
        let mut queue = BinaryHeap::new();
        for (cell, way, price) in starts {
            let s = cell * 4 + way;
            if price < cost[s] {
                cost[s] = price;
                queue.push(Reverse((price + left(cell), s)));
            }
        }
        let mut end = None;
        while let Some(Reverse((estimate, s))) = queue.pop() {
            let (cell, way) = (s / 4, s % 4);
            if s >= states || estimate > cost[s] + left(cell) {
                continue;
            }
            if let Some(price) = goal_at.get(&(cell, way)) {
                // Other goals may be cheaper by what the place on their side costs: that is less than a corner.
                let whole = cost[s] + price;
                if end.is_none_or(|(best, _)| whole < best) {
                    end = Some((whole, s));
                }
            }
            if end.is_some_and(|(best, _)| estimate >= best) {
                break;
            }
            for turn in [0, 1, 3] {
                let to = (way + turn) % 4;
                let Some(next) = self.next(cell, to) else { continue };
                let own = |c: usize| owner > 0 && self.owner[c] == owner;
                // On a line of others there is no turning.
                if self.at[next] == FULL || turn != 0 && self.at[cell] == LINE && !own(cell) {
                    continue;
                }
                let price = cost[s]
                    + if own(next) { COSTS.shared } else { COSTS.step }
                    + if turn == 0 { 0 } else { COSTS.corner }
                    + if self.at[next] == LINE && !own(next) { COSTS.crossing } else { 0 };
                let state = next * 4 + to;
                if price < cost[state] {
                    cost[state] = price;
                    before[state] = s as u32;
                    queue.push(Reverse((price + left(next), state)));
                }
            }
        }
        let (_, mut s) = end?;
        let mut cells = vec![(s / 4, s % 4)];
        while before[s] != u32::MAX {
            s = before[s] as usize;
            cells.push((s / 4, s % 4));
        }
        cells.reverse();
        Some(self.corners(&cells, from, to, air))
    }

    fn corners(&self, cells: &[(usize, usize)], from: Rect, to: Rect, air: f64) -> Vec<Point> {
        let at_edge = |r: Rect, p: Point, way: usize| {
            let d = WAYS[way];
            let k = usize::from(d[0] == 0);
            let mut q = p;
            q[k] = r.middle[k] + f64::from(d[k]) * (r.half[k] + air);
            q
        };
        let mut points = Vec::new();
        if let (Some(first), Some(last)) = (cells.first(), cells.last()) {
            points.push(at_edge(from, self.point(first.0), first.1));
            for pair in cells.windows(2) {
                if pair[0].1 != pair[1].1 {
                    points.push(self.point(pair[0].0));
                }
            }
            points.push(at_edge(to, self.point(last.0), (last.1 + 2) % 4));
        }
        points
    }
}
