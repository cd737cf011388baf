//! From cells to pixels: how wide each column and how high each row has to be.

use super::diagram::{Diagram, SMALL};
use super::font::width;
use super::geometry::{Point, Rect};
use super::grid::Cell;
use rustc_hash::FxHashMap;

/// Lengths, in pixels.
pub(crate) struct Lengths {
    /// The shortest bond between two labels.
    pub(crate) bond: f64,
    /// Between labels that no bond joins.
    pub(crate) apart: f64,
    /// The least from column to column.
    pub(crate) column: f64,
    /// The least from row to row.
    pub(crate) row: f64,
    /// Within a box, from the labels to its edge.
    pub(crate) padding: f64,
    /// The title of a box.
    pub(crate) title: f64,
    /// Between a label and the end of a bond.
    pub(crate) air: f64,
    /// Around the whole picture.
    pub(crate) margin: f64,
}

pub(crate) const LENGTHS: Lengths =
    Lengths { bond: 44.0, apart: 24.0, column: 52.0, row: 58.0, padding: 13.0, title: 15.0, air: 4.0, margin: 24.0 };

/// Pairs of nodes and boxes that are kept apart one by one; more are left to the least distances.
const PAIRS: usize = 2_000_000;

/// Places of all nodes, in pixels; at a scale above 1 farther apart than they need be.
pub(crate) fn spread(diagram: &Diagram, cells: &[Cell], scale: f64) -> Vec<Rect> {
    let halves: Vec<Point> = diagram.nodes.iter().map(|n| n.half()).collect();
    let mut joined: FxHashMap<(usize, usize), [f64; 2]> = FxHashMap::default();
    for l in &diagram.links {
        let text = |t: &String| if t.is_empty() { 0.0 } else { width(t, SMALL) + 10.0 };
        let ports = text(&l.ports[0]) + text(&l.ports[1]);
        let level = text(&l.labels[0]).max(text(&l.labels[1])).max(LENGTHS.bond - 12.0) + 12.0 + ports;
        let sampled = l.bonds.as_ref().is_some_and(|b| b.sampled);
        let least = if l.bonds.is_none() { 30.0 } else { LENGTHS.bond + if sampled { 16.0 } else { 0.0 } };
        let least = scale * least;
        let need = joined.entry((l.tail.min(l.head), l.tail.max(l.head))).or_insert([0.0, 0.0]);
        *need = [need[0].max(if l.bonds.is_none() { least } else { level.max(least) }), need[1].max(least - 6.0)];
    }
    let need = |i: usize, j: usize, k: usize| {
        let least = scale * [LENGTHS.apart, LENGTHS.apart + 4.0][k];
        joined.get(&(i.min(j), i.max(j))).map_or(least, |n| n[k]) + halves[i][k] + halves[j][k]
    };
    let mut places = [Vec::new(), Vec::new()];
    for k in 0..2 {
        let count = cells.iter().map(|c| c[k]).max().map_or(0, |m| m as usize + 1);
        // From a column to another one, at least so far.
        let mut rules: Vec<Vec<(usize, f64)>> = vec![Vec::new(); count];
        let mut order: Vec<usize> = (0..cells.len()).collect();
        order.sort_by_key(|i| (cells[*i][1 - k], cells[*i][k]));
        for pair in order.windows(2) {
            let (i, j) = (pair[0], pair[1]);
            if cells[i][1 - k] == cells[j][1 - k] {
                rules[cells[j][k] as usize].push((cells[i][k] as usize, need(i, j, k)));
            }
        }
        boxes(diagram, cells, &halves, k, &mut rules);
        let least = scale * [LENGTHS.column, LENGTHS.row][k];
        for line in 0..count {
            let from = |&(c, d): &(usize, f64)| places[k].get(c).copied().unwrap_or(0.0) + d;
            let next = rules[line].iter().map(from).fold(0.0, f64::max);
            let before = places[k].last().map_or(0.0, |x: &f64| x + least);
            places[k].push(next.max(before).round());
        }
    }
    let place = |i: usize| [places[0][cells[i][0] as usize], places[1][cells[i][1] as usize]];
    (0..cells.len()).map(|i| Rect { middle: place(i), half: halves[i] }).collect()
}

/// What stands in a box keeps its edge from what does not.
fn boxes(diagram: &Diagram, cells: &[Cell], halves: &[Point], k: usize, rules: &mut [Vec<(usize, f64)>]) {
    let n = cells.len();
    let chain = |i: usize| -> Vec<usize> {
        std::iter::successors(diagram.nodes[i].group, |g| diagram.groups[*g].parent).collect()
    };
    if diagram.groups.is_empty() || n * n > PAIRS {
        return;
    }
    let chains: Vec<Vec<usize>> = (0..n).map(chain).collect();
    let mut bounds = vec![[i32::MAX, i32::MIN]; diagram.groups.len()];
    for (i, groups) in chains.iter().enumerate() {
        for g in groups {
            let across = cells[i][1 - k];
            bounds[*g] = [bounds[*g][0].min(across), bounds[*g][1].max(across)];
        }
    }
    for i in 0..n {
        for j in 0..n {
            if cells[i][k] >= cells[j][k] {
                continue;
            }
            // The edges between the two: of boxes of which one of them is a member.
            let near = |g: &usize, other: usize| (bounds[*g][0] - 1..=bounds[*g][1] + 1).contains(&cells[other][1 - k]);
            let left = chains[i].iter().filter(|g| !chains[j].contains(g) && near(g, j)).count() as f64;
            let right = chains[j].iter().filter(|g| !chains[i].contains(g) && near(g, i)).count() as f64;
            if left + right > 0.0 {
                // The title is at the top.
                let title = if k == 1 { right * LENGTHS.title } else { 0.0 };
                let edges = (left + right) * LENGTHS.padding + title + 16.0;
                rules[cells[j][k] as usize].push((cells[i][k] as usize, halves[i][k] + halves[j][k] + edges));
            }
        }
    }
}

/// The boxes of groups round their nodes, each round those within it.
pub(crate) fn frames(diagram: &Diagram, nodes: &[Rect]) -> Vec<Rect> {
    let count = diagram.groups.len();
    let mut bounds = vec![[f64::MAX, f64::MAX, f64::MIN, f64::MIN]; count];
    let grow = |b: &mut [f64; 4], low: Point, high: Point| {
        for k in 0..2 {
            b[k] = b[k].min(low[k]);
            b[k + 2] = b[k + 2].max(high[k]);
        }
    };
    for (n, r) in diagram.nodes.iter().zip(nodes) {
        if let Some(g) = n.group {
            let (low, high) = ([0, 1].map(|k| r.middle[k] - r.half[k]), [0, 1].map(|k| r.middle[k] + r.half[k]));
            grow(&mut bounds[g], low, high);
        }
    }
    for g in (0..count).rev() {
        let b = &mut bounds[g];
        let by = LENGTHS.padding;
        *b = [b[0] - by, b[1] - by - LENGTHS.title, b[2] + by, b[3] + by];
        let b = *b;
        if let Some(parent) = diagram.groups[g].parent.filter(|_| b[0] < 1e300) {
            grow(&mut bounds[parent], [b[0], b[1]], [b[2], b[3]]);
        }
    }
    let rect = |b: &[f64; 4]| Rect {
        middle: [0.5 * (b[0] + b[2]), 0.5 * (b[1] + b[3])],
        half: [0.5 * (b[2] - b[0]), 0.5 * (b[3] - b[1])],
    };
    bounds.iter().map(rect).collect()
}
