//! The end of a layout: labels are pushed apart and off the bonds, bonds drawn long enough and straight.

use super::{Drawing, Point};
use crate::show::size::SIZES;

/// Pushes until nothing moves, or long enough.
pub(super) fn settle(x: &mut [Point], drawing: &Drawing<'_>) {
    for round in 0..400 {
        let moved = part_labels(x, drawing) | stretch(x, drawing) | (round % 2 == 0 && clear_bonds(x, drawing));
        if !moved || round % 40 == 39 {
            align(x, drawing.bonds);
        }
        if !moved {
            break;
        }
    }
}

/// Makes bonds that are nearly level or upright exactly so, a whole row at once.
fn align(x: &mut [Point], bonds: &[(usize, usize, f64)]) {
    for k in 0..2 {
        let mut rows = petgraph::unionfind::UnionFind::<usize>::new(x.len());
        for &(a, b, _) in bonds {
            let d = [x[b][0] - x[a][0], x[b][1] - x[a][1]];
            if d[k].abs() < 0.2 * d[1 - k].abs() {
                rows.union(a, b);
            }
        }
        let mut sums = vec![(0.0, 0.0); x.len()];
        for (i, p) in x.iter().enumerate() {
            let s = &mut sums[rows.find(i)];
            *s = (s.0 + p[k], s.1 + 1.0);
        }
        for (i, p) in x.iter_mut().enumerate() {
            let s = sums[rows.find(i)];
            p[k] = s.0 / s.1;
        }
    }
}

/// Pushes labels apart that touch, and labels out of parts they are not of.
fn part_labels(x: &mut [Point], drawing: &Drawing<'_>) -> bool {
    let mut moved = false;
    for i in 0..x.len() {
        for j in i + 1..x.len() {
            let apart = if drawing.parts[i] == drawing.parts[j] { [10.0, 14.0] } else { [30.0, 44.0] };
            let need = [0, 1].map(|k| drawing.sizes[i][k] + drawing.sizes[j][k] + apart[k]);
            let delta = [x[j][0] - x[i][0], x[j][1] - x[i][1]];
            let over = [need[0] - delta[0].abs(), need[1] - delta[1].abs()];
            if over[0] <= 0.0 || over[1] <= 0.0 {
                continue;
            }
            moved = true;
            let k = usize::from(over[1] < over[0]);
            let sign = if delta[k] < 0.0 { -1.0 } else { 1.0 };
            x[i][k] -= sign * (0.5 * over[k] + 0.5);
            x[j][k] += sign * (0.5 * over[k] + 0.5);
        }
    }
    moved
}

/// Lengthens bonds of which the labels leave too little to be seen.
fn stretch(x: &mut [Point], drawing: &Drawing<'_>) -> bool {
    let mut moved = false;
    for &(a, b, length) in drawing.bonds {
        let d = [x[b][0] - x[a][0], x[b][1] - x[a][1]];
        let full = libm::hypot(d[0], d[1]);
        if full < 1e-6 {
            continue;
        }
        let u = [d[0] / full, d[1] / full];
        let hidden: f64 = [a, b]
            .iter()
            .map(|i| {
                let half = drawing.sizes[*i];
                let reach = |k: usize| if u[k].abs() < 1e-9 { f64::INFINITY } else { (half[k] + 4.0) / u[k].abs() };
                reach(0).min(reach(1))
            })
            .sum();
        let short = hidden + SIZES.bond * length - full;
        if short > 0.5 {
            moved = true;
            for k in 0..2 {
                x[a][k] -= 0.5 * short * u[k];
                x[b][k] += 0.5 * short * u[k];
            }
        }
    }
    moved
}

/// Pushes labels off bonds that are not theirs.
fn clear_bonds(x: &mut [Point], drawing: &Drawing<'_>) -> bool {
    let mut moved = false;
    for &(a, b, _) in drawing.bonds {
        for i in (0..x.len()).filter(|i| *i != a && *i != b) {
            let d = [x[b][0] - x[a][0], x[b][1] - x[a][1]];
            let length = libm::hypot(d[0], d[1]);
            if length < 1e-6 {
                continue;
            }
            let normal = [-d[1] / length, d[0] / length];
            let p = [x[i][0] - x[a][0], x[i][1] - x[a][1]];
            let (along, across) = ((p[0] * d[0] + p[1] * d[1]) / length, p[0] * normal[0] + p[1] * normal[1]);
            let reach = |v: Point| v[0].abs() * drawing.sizes[i][0] + v[1].abs() * drawing.sizes[i][1] + 6.0;
            let (half, far) = (reach(normal), reach([d[0] / length, d[1] / length]));
            if across.abs() >= half || along < -far || along > length + far {
                continue;
            }
            moved = true;
            let sign = if across < 0.0 { -1.0 } else { 1.0 };
            let push = sign * (0.5 * (half - across.abs()) + 0.5);
            for k in 0..2 {
                x[i][k] += push * normal[k];
                x[a][k] -= 0.25 * push * normal[k];
                x[b][k] -= 0.25 * push * normal[k];
            }
        }
    }
    moved
}
