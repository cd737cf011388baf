//! A first place for each node: stress majorisation over all-pairs distances (Gansner, Koren, North 2004), begun from
//! classical scaling, and turned so that most bonds lie level or upright.

use super::geometry::Point;

/// A line that holds two nodes together: its ends and its length.
pub(crate) type Edge = (usize, usize, f64);

/// Pairs of nodes that all rounds together look at, at most: what bounds the time for large graphs.
const PAIRS: usize = 40_000_000;

/// Places with about 1 between neighbours.
pub(crate) fn place(n: usize, edges: &[Edge]) -> Vec<Point> {
    let distance = distances(n, edges);
    let mut x = scaling(&distance);
    let rounds = (PAIRS / (n * n).max(1)).clamp(10, 100);
    for _ in 0..2 * rounds {
        x = majorise(&distance, &x, (&[], 0.0));
    }
    turn(&mut x, edges);
    for weight in [1.5, 40.0] {
        for _ in 0..rounds {
            let pulls = axes(&x, edges);
            x = majorise(&distance, &x, (&pulls, weight));
        }
    }
    x
}
/// All-pairs distances along the edges; pieces that nothing joins stand a little apart.
fn distances(n: usize, edges: &[(usize, usize, f64)]) -> Vec<Vec<f64>> {
    let mut near: Vec<Vec<(usize, f64)>> = vec![Vec::new(); n];
    for &(a, b, length) in edges {
        near[a].push((b, length));
        near[b].push((a, length));
    }
    // Lengths are multiples of a half: a queue over half units visits in order of distance.
    let from = |start: usize| {
        let mut d = vec![f64::INFINITY; n];
        d[start] = 0.0;
        let mut layers: Vec<Vec<usize>> = vec![vec![start]];
        let mut k = 0;
        while k < layers.len() {
            for i in std::mem::take(&mut layers[k]) {
                if (d[i] * 2.0).round() as usize != k {
                    continue;
                }
                for &(j, length) in &near[i] {
                    let new = d[i] + length;
                    if new < d[j] {
                        d[j] = new;
                        let at = (new * 2.0).round() as usize;
                        if layers.len() <= at {
                            layers.resize(at + 1, Vec::new());
                        }
                        layers[at].push(j);
                    }
                }
            }
            k += 1;
        }
        d
    };
    let mut all: Vec<Vec<f64>> = (0..n).map(from).collect();
    let largest = all.iter().flatten().copied().filter(|d| d.is_finite()).fold(1.0, f64::max);
    for d in all.iter_mut().flatten() {
        if !d.is_finite() {
            *d = 0.6 * largest + 1.5;
        }
    }
    all
}

/// The two main directions of the centred squares of the distances, by power iteration.
fn scaling(distance: &[Vec<f64>]) -> Vec<Point> {
    let n = distance.len();
    let mean = |row: &[f64]| row.iter().map(|d| d * d).sum::<f64>() / n.max(1) as f64;
    let rows: Vec<f64> = distance.iter().map(|r| mean(r)).collect();
    let all = rows.iter().sum::<f64>() / n.max(1) as f64;
    let b = |i: usize, j: usize| -0.5 * (distance[i][j] * distance[i][j] - rows[i] - rows[j] + all);
    let mut axes: Vec<Vec<f64>> = Vec::new();
    for axis in 0..2 {
        let mut v: Vec<f64> =
            (0..n).map(|i| libm::sin((i as f64 + 1.0) * (0.71 + 0.53 * axis as f64)) + 0.01).collect();
        let mut size = 0.0;
        for _ in 0..80 {
            for earlier in &axes {
                let norm: f64 = earlier.iter().map(|x| x * x).sum();
                if norm > 0.0 {
                    let along = v.iter().zip(earlier).map(|(a, b)| a * b).sum::<f64>() / norm;
                    v.iter_mut().zip(earlier).for_each(|(a, b)| *a -= along * b);
                }
            }
            let next: Vec<f64> = (0..n).map(|i| (0..n).map(|j| b(i, j) * v[j]).sum()).collect();
            size = next.iter().map(|x| x * x).sum::<f64>().sqrt();
            if size < 1e-9 {
                break;
            }
            v = next.into_iter().map(|x| x / size).collect();
        }
        axes.push(v.into_iter().map(|x| x * size.sqrt()).collect());
    }
    // A little of the index keeps nodes apart that have the same distances to all others.
    (0..n).map(|i| [axes[0][i] + 0.013 * libm::cos(i as f64), axes[1][i] + 0.013 * libm::sin(i as f64 * 1.7)]).collect()
}

/// A bond that wants to lie along a vector.
type Pull = (usize, usize, Point);

/// One step that lowers the stress, the pulls counting with their weight.
fn majorise(distance: &[Vec<f64>], x: &[Point], (pulls, weight): (&[Pull], f64)) -> Vec<Point> {
    let n = x.len();
    let mut sums: Vec<([f64; 2], f64)> = vec![([0.0, 0.0], 0.0); n];
    for i in 0..n {
        for j in 0..n {
            if i == j {
                continue;
            }
            let d = distance[i][j].max(0.1);
            let w = 1.0 / (d * d);
            let delta = [x[i][0] - x[j][0], x[i][1] - x[j][1]];
            let length = libm::hypot(delta[0], delta[1]).max(1e-6);
            for k in 0..2 {
                sums[i].0[k] += w * (x[j][k] + d * delta[k] / length);
            }
            sums[i].1 += w;
        }
    }
    for &(a, b, v) in pulls {
        let w = weight;
        for k in 0..2 {
            sums[a].0[k] += w * (x[b][k] - v[k]);
            sums[b].0[k] += w * (x[a][k] + v[k]);
        }
        sums[a].1 += w;
        sums[b].1 += w;
    }
    sums.iter().zip(x).map(|((s, w), x)| if *w > 0.0 { [s[0] / w, s[1] / w] } else { *x }).collect()
}

/// Turns the drawing so that most edges lie level or upright and it is wider than high; the first edges run to the
/// right.
fn turn(x: &mut [Point], edges: &[(usize, usize, f64)]) {
    let (mut c, mut s) = (0.0, 0.0);
    for &(a, b, _) in edges {
        let angle = 4.0 * libm::atan2(x[b][1] - x[a][1], x[b][0] - x[a][0]);
        c += libm::cos(angle);
        s += libm::sin(angle);
    }
    let rotate = |x: &mut [Point], by: f64| {
        let (sin, cos) = libm::sincos(by);
        for p in x.iter_mut() {
            *p = [p[0] * cos - p[1] * sin, p[0] * sin + p[1] * cos];
        }
    };
    rotate(x, -libm::atan2(s, c) / 4.0);
    let extent = |x: &[Point], k: usize| {
        let (low, high) = x.iter().fold((f64::MAX, f64::MIN), |(l, h), p| (l.min(p[k]), h.max(p[k])));
        high - low
    };
    if extent(x, 1) > extent(x, 0) {
        rotate(x, std::f64::consts::FRAC_PI_2);
    }
    let right: f64 = edges.iter().map(|(a, b, _)| x[*b][0] - x[*a][0]).sum();
    if right < 0.0 {
        for p in x.iter_mut() {
            p[0] = -p[0];
        }
    }
    if edges.iter().map(|(a, b, _)| x[*b][1] - x[*a][1]).sum::<f64>() < 0.0 {
        for p in x.iter_mut() {
            p[1] = -p[1];
        }
    }
}

/// For each bond that is the nearest of its ends' edges to a level or upright direction, that direction.
fn axes(x: &[Point], edges: &[(usize, usize, f64)]) -> Vec<Pull> {
    let quarter = std::f64::consts::FRAC_PI_2;
    let angle = |a: usize, b: usize| libm::atan2(x[b][1] - x[a][1], x[b][0] - x[a][0]);
    let nearest = |angle: f64| (angle / quarter).round();
    // For each node and quarter, the deviation of the bond that is nearest to it.
    let mut best = vec![[f64::MAX; 4]; x.len()];
    let side = |q: f64| (q.rem_euclid(4.0)) as usize % 4;
    for &(a, b, _) in edges {
        for (from, to) in [(a, b), (b, a)] {
            let t = angle(from, to);
            let q = nearest(t);
            let off = (t - q * quarter).abs();
            let slot = &mut best[from][side(q)];
            *slot = slot.min(off);
        }
    }
    let mut pulls = Vec::new();
    for &(a, b, length) in edges {
        let t = angle(a, b);
        let q = nearest(t);
        let off = (t - q * quarter).abs();
        let back = nearest(angle(b, a));
        let chosen = off <= best[a][side(q)] + 1e-12 && off <= best[b][side(back)] + 1e-12;
        if chosen && off < 0.6 {
            pulls.push((a, b, [length * libm::cos(q * quarter), length * libm::sin(q * quarter)]));
        }
    }
    pulls
}
