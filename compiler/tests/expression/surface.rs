//! Surfaces: values, slopes, range and rise against the points; flat directions against curves.

use super::Bench;
use bond_compiler::expression::Expr;

/// Places of both directions, and a row of values for each of the second.
struct Points {
    xs: Vec<f64>,
    ys: Vec<f64>,
    rows: Vec<Vec<f64>>,
}

impl Points {
    fn surface(&self, bench: &mut Bench) -> Expr {
        let (q, p) = (bench.read("q"), bench.read("p"));
        bench.pool.surface((q, p), &self.xs, &self.ys, &self.rows).expect("a surface")
    }

    fn size(&self) -> f64 {
        self.rows.iter().flatten().fold(0.0, |s, z| f64::max(s, z.abs()))
    }
}

fn value(bench: &Bench, e: Expr, x: f64, y: f64) -> f64 {
    let (q, p) = (bench.symbol("q"), bench.symbol("p"));
    bench.pool.eval(e, &|s| {
        if s == q {
            x
        } else if s == p {
            y
        } else {
            f64::NAN
        }
    })
}

/// Points of many shapes: rising both ways, with flat parts and steps, with saddles and peaks, falling in one
/// direction.
fn all() -> Vec<Points> {
    let mut seed = 11u64;
    let mut random = move || {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (seed >> 33) as f64 / f64::from(1u32 << 31)
    };
    let mut all = Vec::new();
    for kind in 0..60 {
        let (n, m) = (2 + (random() * 6.0) as usize, 2 + (random() * 6.0) as usize);
        let mut places = |n: usize| -> Vec<f64> {
            let mut x = 4.0 * random() - 6.0;
            (0..n)
                .map(|_| {
                    x += 0.02 + random().powi(3) * 3.0;
                    x
                })
                .collect()
        };
        let (xs, ys) = (places(n), places(m));
        let mut rows = vec![vec![0.0; n]; m];
        for j in 0..m {
            for i in 0..n {
                let step = if random() < 0.4 { 0.0 } else { random().powi(4) * 5.0 };
                rows[j][i] = match kind % 4 {
                    // rises in both
                    0 | 1 => {
                        let left: f64 = if i > 0 { rows[j][i - 1] } else { -1.0 };
                        let below: f64 = if j > 0 { rows[j - 1][i] } else { -1.0 };
                        left.max(below) + step
                    }
                    // rises in x only
                    2 => (if i > 0 { rows[j][i - 1] } else { 3.0 * random() }) + step,
                    _ => step - 1.0,
                };
            }
        }
        if kind % 8 == 1 {
            // falls in both
            rows.iter_mut().flatten().for_each(|z| *z = -*z);
        }
        all.push(Points { xs, ys, rows });
    }
    all
}

#[test]
fn goes_through_the_points() {
    for points in all() {
        let mut bench = Bench::new();
        let e = points.surface(&mut bench);
        for (j, y) in points.ys.iter().enumerate() {
            for (i, x) in points.xs.iter().enumerate() {
                let (found, wanted) = (value(&bench, e, *x, *y), points.rows[j][i]);
                assert!((found - wanted).abs() <= 1e-13 * points.size(), "{x} {y}: {found} {wanted}");
            }
        }
    }
}

/// In each rectangle: within its four values, and rising (or falling) in a direction where both edges do.
#[test]
fn does_not_overshoot() {
    for points in all() {
        let mut bench = Bench::new();
        let e = points.surface(&mut bench);
        let tolerance = 2e-13 * points.size();
        for j in 1..points.ys.len() {
            for i in 1..points.xs.len() {
                let (x, y) = ([points.xs[i - 1], points.xs[i]], [points.ys[j - 1], points.ys[j]]);
                let corner = |a: usize, b: usize| points.rows[j - 1 + b][i - 1 + a];
                let corners = [corner(0, 0), corner(1, 0), corner(0, 1), corner(1, 1)];
                let low = corners.iter().copied().fold(f64::INFINITY, f64::min);
                let high = corners.iter().copied().fold(f64::NEG_INFINITY, f64::max);
                let n = 12;
                let at = |k: usize, ends: [f64; 2]| ends[0] + (ends[1] - ends[0]) * k as f64 / n as f64;
                let grid: Vec<Vec<f64>> =
                    (0..n).map(|b| (0..n).map(|a| value(&bench, e, at(a, x), at(b, y))).collect()).collect();
                for b in 0..n {
                    for a in 0..n {
                        let z = grid[b][a];
                        assert!(low - tolerance <= z && z <= high + tolerance, "{z} outside of {corners:?}");
                        for (rises, before) in [
                            (
                                (corner(1, 0) - corner(0, 0), corner(1, 1) - corner(0, 1)),
                                a.checked_sub(1).map(|a| grid[b][a]),
                            ),
                            (
                                (corner(0, 1) - corner(0, 0), corner(1, 1) - corner(1, 0)),
                                b.checked_sub(1).map(|b| grid[b][a]),
                            ),
                        ] {
                            let Some(before) = before else { continue };
                            assert!(
                                !(rises.0 >= 0.0 && rises.1 >= 0.0) || z - before >= -tolerance,
                                "falls from {before} to {z} in {corners:?}"
                            );
                            assert!(
                                !(rises.0 <= 0.0 && rises.1 <= 0.0) || z - before <= tolerance,
                                "rises from {before} to {z} in {corners:?}"
                            );
                        }
                    }
                }
            }
        }
    }
}

/// Neither the surface nor its symbolic slopes jump at a line of the mesh, nor at its ends.
#[test]
fn slopes_are_continuous() {
    for points in all() {
        let mut bench = Bench::new();
        let e = points.surface(&mut bench);
        let (q, p) = (bench.symbol("q"), bench.symbol("p"));
        let parts = [e, bench.pool.derivative(e, q), bench.pool.derivative(e, p)];
        let place = |all: &[f64], k: i32| all[0] + (all[all.len() - 1] - all[0]) * (f64::from(k) / 20.0);
        let largest = |e: Expr| {
            (-2..=22)
                .flat_map(|a| (-2..=22).map(move |b| (a, b)))
                .fold(0.0f64, |m, (a, b)| m.max(value(&bench, e, place(&points.xs, a), place(&points.ys, b)).abs()))
        };
        for part in parts {
            let size = largest(part);
            for k in -2..=22 {
                for x in &points.xs {
                    let y = place(&points.ys, k);
                    let jump = value(&bench, part, *x, y) - value(&bench, part, x.next_down(), y);
                    assert!(jump.abs() <= 1e-9 * size, "jumps by {jump} at x = {x}, y = {y}, of {size}");
                }
                for y in &points.ys {
                    let x = place(&points.xs, k);
                    let jump = value(&bench, part, x, *y) - value(&bench, part, x, y.next_down());
                    assert!(jump.abs() <= 1e-9 * size, "jumps by {jump} at x = {x}, y = {y}, of {size}");
                }
            }
        }
        // Central differences of the surface: the symbolic slopes are its own.
        for k in 1..20 {
            let (x, y) = (place(&points.xs, k), place(&points.ys, 20 - k));
            let d = 1e-6;
            let by_x = (value(&bench, e, x + d, y) - value(&bench, e, x - d, y)) / (2.0 * d);
            assert!((by_x - value(&bench, parts[1], x, y)).abs() <= 1e-3 * largest(parts[1]).max(1e-3));
        }
    }
}

/// What does not depend on one direction is the curve of the other.
#[test]
fn a_flat_direction_leaves_the_curve() {
    let places = [-2.0, -1.0, -0.3, 0.4, 1.5, 2.0];
    let heights = [-3.0, -3.0, 0.1, 0.2, 4.0, 3.0];
    let knots: Vec<(f64, f64)> = places.iter().copied().zip(heights).collect();
    let other = [0.0, 1.0, 5.0];
    let mut bench = Bench::new();
    let (q, p) = (bench.read("q"), bench.read("p"));
    let curve = bench.pool.table(q, &knots).expect("a curve");
    let along_x = bench.pool.surface((q, p), &places, &other, &vec![heights.to_vec(); 3]).expect("a surface");
    let rows: Vec<Vec<f64>> = heights.iter().map(|z| vec![*z; 3]).collect();
    let along_y = bench.pool.surface((p, q), &other, &places, &rows).expect("a surface");
    for k in -30..=30 {
        let (x, y) = (f64::from(k) * 0.1, f64::from(k * k) * 0.013 - 2.0);
        let wanted = value(&bench, curve, x, y);
        for e in [along_x, along_y] {
            let found = value(&bench, e, x, y);
            assert!((found - wanted).abs() <= 1e-13 * 4.0, "{x} {y}: {found} {wanted}");
        }
    }
}

/// Four points make the bilinear surface, in one piece.
#[test]
fn bilinear() {
    let mut bench = Bench::new();
    let (q, p, wanted) = (bench.read("q"), bench.read("p"), bench.read("q*(1 + p)"));
    let e = bench.pool.surface((q, p), &[0.0, 2.0], &[0.0, 1.0], &[vec![0.0, 2.0], vec![0.0, 4.0]]).expect("a surface");
    for (x, y) in [(0.3, 0.7), (-5.0, 3.0), (9.0, -2.0)] {
        assert!((value(&bench, e, x, y) - value(&bench, wanted, x, y)).abs() <= 1e-14);
    }
    assert!(!bench.pool.print(e).contains("if"), "{}", bench.pool.print(e));
}

/// Where the points rise, an interpolation is of third order.
#[test]
fn order_of_the_interpolation() {
    let law = |x: f64, y: f64| (x + 0.5 * y).exp() + x * y;
    let errors: Vec<f64> = [5, 10, 20]
        .map(|n: i32| {
            let places: Vec<f64> = (0..=n).map(|i| f64::from(i) / f64::from(n)).collect();
            let rows: Vec<Vec<f64>> = places.iter().map(|y| places.iter().map(|x| law(*x, *y)).collect()).collect();
            let mut bench = Bench::new();
            let e = Points { xs: places.clone(), ys: places, rows }.surface(&mut bench);
            (0..=40)
                .flat_map(|a| (0..=40).map(move |b| (f64::from(a) / 40.3, f64::from(b) / 40.3)))
                .map(|(x, y)| (value(&bench, e, x, y) - law(x, y)).abs())
                .fold(0.0, f64::max)
        })
        .to_vec();
    assert!(errors.windows(2).all(|e| (e[0] / e[1]).log2() > 2.7), "{errors:?}");
}

#[test]
fn what_is_no_surface() {
    let mut bench = Bench::new();
    let (q, p) = (bench.read("q"), bench.read("p"));
    let two = [0.0, 1.0];
    assert!(bench.pool.surface((q, p), &[0.0], &two, &[vec![0.0], vec![0.0]]).is_none());
    assert!(bench.pool.surface((q, p), &two, &two, &[vec![0.0, 1.0]]).is_none());
    assert!(bench.pool.surface((q, p), &two, &two, &[vec![0.0, 1.0], vec![0.0]]).is_none());
    assert!(bench.pool.surface((q, p), &[0.0, 1e-200], &two, &[vec![0.0, 1e200], vec![0.0, 0.0]]).is_none());
}
