//! Tables: the monotone cubic against its own definition, its energy, its passivity.

use super::Bench;

/// The slopes of Fritsch and Carlson, and the curve by Hermite's basis: written from the paper, not from the compiler.
fn hermite(knots: &[(f64, f64)], x: f64) -> f64 {
    let n = knots.len();
    let rise = |i: usize| (knots[i + 1].1 - knots[i].1) / (knots[i + 1].0 - knots[i].0);
    let step = |i: usize| knots[i + 1].0 - knots[i].0;
    let mut m = vec![0.0; n];
    for i in 0..n {
        m[i] = match i {
            0 if n == 2 => rise(0),
            0 => ((2.0 * step(0) + step(1)) * rise(0) - step(0) * rise(1)) / (step(0) + step(1)),
            i if i == n - 1 && n == 2 => rise(0),
            i if i == n - 1 => {
                let (h, g) = (step(n - 2), step(n - 3));
                ((2.0 * h + g) * rise(n - 2) - h * rise(n - 3)) / (h + g)
            }
            i => (step(i) * rise(i - 1) + step(i - 1) * rise(i)) / (step(i - 1) + step(i)),
        };
        let near = [i.checked_sub(1).map(rise), (i < n - 1).then(|| rise(i))];
        if near.into_iter().flatten().any(|d| d * m[i] <= 0.0) {
            m[i] = 0.0;
        }
    }
    for i in 0..n - 1 {
        if rise(i) == 0.0 {
            continue;
        }
        let (a, b) = (m[i] / rise(i), m[i + 1] / rise(i));
        if a * a + b * b > 9.0 {
            let tau = 3.0 / (a * a + b * b).sqrt();
            (m[i], m[i + 1]) = (tau * a * rise(i), tau * b * rise(i));
        }
    }
    if x <= knots[0].0 {
        return knots[0].1 + m[0] * (x - knots[0].0);
    }
    if x >= knots[n - 1].0 {
        return knots[n - 1].1 + m[n - 1] * (x - knots[n - 1].0);
    }
    let i = (1..n).find(|&i| x < knots[i].0).unwrap_or(n - 1) - 1;
    let (h, t) = (step(i), (x - knots[i].0) / step(i));
    knots[i].1 * (1.0 + 2.0 * t) * (1.0 - t).powi(2)
        + m[i] * h * t * (1.0 - t).powi(2)
        + knots[i + 1].1 * t * t * (3.0 - 2.0 * t)
        + m[i + 1] * h * t * t * (t - 1.0)
}

/// Measured points of many shapes: rising, with flat parts, with turns, with steps of unequal size.
fn curves() -> Vec<Vec<(f64, f64)>> {
    let mut seed = 7u64;
    let mut random = move || {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (seed >> 33) as f64 / f64::from(1u32 << 31)
    };
    let mut all = vec![
        vec![(0.0, 0.0), (0.5, 0.001), (0.6, 0.02), (0.7, 0.4), (0.75, 1.2), (0.8, 3.5)],
        vec![(-1.0, 2.0), (1.0, 2.0), (2.0, -3.0)],
        vec![(1.0, 1.0), (2.0, 5.0)],
        vec![(0.0, 0.0), (1e-9, 1e3), (1.0, 1e3 + 1e-6)],
    ];
    for rising in [true, false, true, false, true] {
        let n = 3 + (random() * 30.0) as usize;
        let (mut x, mut y) = (10.0 * random() - 8.0, 4.0 * random() - 2.0);
        let mut knots = Vec::new();
        for _ in 0..n {
            knots.push((x, y));
            x += 0.01 + random().powi(3) * 2.0;
            y += if random() < 0.2 { 0.0 } else { random() - if rising { 0.0 } else { 0.5 } };
        }
        all.push(knots);
    }
    all
}

/// Places within, at and beyond the knots.
fn places(knots: &[(f64, f64)]) -> Vec<f64> {
    let (low, high) = (knots[0].0, knots[knots.len() - 1].0);
    let span = high - low;
    let mut all: Vec<f64> = (0..=400).map(|i| low - 0.2 * span + 1.4 * span * f64::from(i) / 400.0).collect();
    all.extend(knots.iter().map(|k| k.0));
    all.sort_by(f64::total_cmp);
    all
}

#[test]
fn is_the_cubic_of_fritsch_and_carlson() {
    for knots in curves() {
        let mut bench = Bench::new();
        let q = bench.read("q");
        let e = bench.pool.table(q, &knots).expect("a table");
        let size = knots.iter().fold(0.0f64, |s, k| s.max(k.1.abs()));
        for x in places(&knots) {
            let (found, wanted) = (bench.at(e, x), hermite(&knots, x));
            assert!((found - wanted).abs() <= 1e-13 * size.max(wanted.abs()), "{knots:?} at {x}: {found} {wanted}");
        }
        for k in &knots {
            assert!((bench.at(e, k.0) - k.1).abs() <= 1e-14 * size, "{knots:?} at {}", k.0);
        }
    }
}

/// Where the curve rises all along, an interpolation is of third order.
#[test]
fn order_of_the_interpolation() {
    let errors: Vec<f64> = [8, 16, 32, 64]
        .map(|n| {
            let knots: Vec<(f64, f64)> =
                (0..=n).map(|i| f64::from(i) / f64::from(n)).map(|x| (x, (2.0 * x).exp())).collect();
            let mut bench = Bench::new();
            let q = bench.read("q");
            let e = bench.pool.table(q, &knots).expect("a table");
            let off = (0..=1000).map(|i| f64::from(i) * 1e-3).map(|x| (bench.at(e, x) - (2.0 * x).exp()).abs());
            off.fold(0.0, f64::max)
        })
        .to_vec();
    assert!(errors.windows(2).all(|e| ((e[0] / e[1]).log2() - 3.0).abs() < 0.2), "{errors:?}");
}

/// Between two knots it stays between their values, and has no turn.
#[test]
fn does_not_overshoot() {
    for knots in curves() {
        let mut bench = Bench::new();
        let q = bench.read("q");
        let e = bench.pool.table(q, &knots).expect("a table");
        for pair in knots.windows(2) {
            let [(x0, y0), (x1, y1)] = *pair else { continue };
            let inside = (0..=200).map(|i| bench.at(e, x0 + (x1 - x0) * f64::from(i) / 200.0));
            let values: Vec<f64> = inside.take(200).chain([y1]).collect();
            let tolerance = 1e-13 * y0.abs().max(y1.abs());
            for v in values.windows(2) {
                assert!((v[1] - v[0]) * (y1 - y0).signum() >= -tolerance, "{pair:?}: {v:?}");
            }
        }
    }
}

/// Its slope has no jump at the knots, and its energy has no jump anywhere and the curve as its slope.
#[test]
fn slope_and_energy() {
    for knots in curves().into_iter().filter(|k| k[0].1 != 0.0 || k[1].0 > 1e-6) {
        let mut bench = Bench::new();
        let (q, s) = (bench.read("q"), bench.symbol("q"));
        let e = bench.pool.table(q, &knots).expect("a table");
        let slope = bench.pool.derivative(e, s);
        let energy = bench.pool.antiderivative(e, s).expect("an energy in closed form");
        let back = bench.pool.derivative(energy, s);
        assert_eq!(bench.at(energy, 0.0), 0.0);
        let steepest = places(&knots).iter().fold(0.0f64, |m, x| m.max(bench.at(slope, *x).abs()));
        for (x, _) in &knots {
            let jump = bench.at(slope, *x) - bench.at(slope, x.next_down());
            assert!(jump.abs() <= 1e-10 * steepest, "{knots:?}: the slope jumps by {jump} at {x}");
            let (low, high) = (bench.at(energy, x.next_down()), bench.at(energy, *x));
            let size = places(&knots).iter().fold(0.0f64, |m, x| m.max(bench.at(energy, *x).abs()));
            assert!((low - high).abs() <= 1e-13 * size, "{knots:?}: the energy jumps by {} at {x}", high - low);
        }
        for x in places(&knots) {
            let (found, wanted) = (bench.at(back, x), bench.at(e, x));
            let size = knots.iter().fold(wanted.abs(), |s, k| s.max(k.1.abs()));
            assert!((found - wanted).abs() <= 1e-12 * size, "{knots:?} at {x}: {found} {wanted}");
        }
    }
}

/// The discrete gradient: exactly the difference of the energy, whichever knots lie between the ends.
#[test]
fn difference_closes_the_balance() {
    let knots = [(-2.0, -6.0), (-1.0, -1.5), (0.0, 0.0), (1.0, 1.0), (2.0, 4.0), (3.0, 4.5)];
    let mut bench = Bench::new();
    let (q, s, from, delta) = (bench.read("q"), bench.symbol("q"), bench.symbol("x"), bench.symbol("y"));
    let e = bench.pool.table(q, &knots).expect("a table");
    let energy = bench.pool.antiderivative(e, s).expect("an energy");
    let (a, d) = (bench.pool.var(from), bench.pool.var(delta));
    let slope = bench.pool.difference(energy, s, a, d);
    let near = [-1.0, 1.0, 2.0, 3.0].into_iter().flat_map(|k: f64| [k.next_down(), k - 3e-9, k - 2e-14]);
    for start in (-30..40).map(|i| f64::from(i) * 0.1).chain(near) {
        for step in [3.0, 0.7, 1e-2, 1e-5, 1e-8, 1e-13, -1e-13, -1e-8, -1e-5, -1e-2, -0.7, -3.0] {
            let found = bench.pool.eval(slope, &|v| if v == from { start } else { step });
            let (h0, h1) = (bench.at(energy, start), bench.at(energy, start + step));
            let off = (found * step - (h1 - h0)).abs();
            assert!(off <= 4e-15 * h0.abs().max(h1.abs()).max(1.0), "{start} {step}: off by {off:e}");
            let middle = bench.at(e, start + 0.5 * step);
            let curvature = 40.0 * step * step;
            assert!((found - middle).abs() <= curvature + 1e-14, "{start} {step}: {found} where the law is {middle}");
        }
    }
}

#[test]
fn passive_curves_are_proved_and_others_are_not() {
    let proved = |knots: &[(f64, f64)]| {
        let mut bench = Bench::new();
        let (q, s) = (bench.read("q"), bench.symbol("q"));
        let e = bench.pool.table(q, knots).expect("a table");
        bench.pool.dissipative(e, s)
    };
    // rising through the origin, with a knot there and without
    assert_eq!(proved(&[(-2.0, -1.0), (0.0, 0.0), (1.0, 0.3), (4.0, 5.0)]), Some(true));
    assert_eq!(proved(&[(-2.0, -1.0), (-1.0, -0.5), (1.0, 0.5), (2.0, 1.0)]), Some(true));
    assert_eq!(proved(&[(-5.0, -0.1), (0.0, 0.0), (0.6, 0.0), (0.7, 2.0)]), Some(true));
    // a tunnel diode: falls, and takes power all the same
    assert_eq!(proved(&[(-1.0, -2.0), (0.0, 0.0), (0.1, 1.0), (0.3, 0.2), (0.6, 2.0)]), Some(true));
    // beyond the last knot it falls below 0
    assert_ne!(proved(&[(-1.0, -2.0), (0.0, 0.0), (1.0, 1.0), (2.0, 0.8), (3.0, 0.1)]), Some(true));
    // misses the origin
    assert_eq!(proved(&[(-1.0, -0.9), (0.0, 0.1), (1.0, 1.0)]), Some(false));
    assert_ne!(proved(&[(-1.0, -1.0), (0.0, 1e-6), (1.0, 1.0)]), Some(true));
    assert_ne!(proved(&[(-1.0, 1.0), (0.0, 0.0), (1.0, 1.0)]), Some(true));
    for knots in curves() {
        if proved(&knots) == Some(true) {
            assert!(places(&knots).into_iter().all(|x| x * hermite(&knots, x) >= -1e-14), "{knots:?}");
        }
    }
}

/// Pieces that are no tables are looked at in the same way; what is no polynomial is not.
#[test]
fn piecewise_polynomials() {
    let proved = |text: &str| {
        let mut bench = Bench::new();
        let (e, s) = (bench.read(text), bench.symbol("q"));
        bench.pool.dissipative(e, s)
    };
    assert_eq!(proved("if q < 1 then q*(q - 2)^2 else q^2"), Some(true));
    assert_eq!(proved("if q < 1 then k*q*(q - 2)^2 else if q < 2 then 1 else 3*q - q^2/8"), Some(false));
    assert_eq!(proved("if q < 2*k then q + q^3 else 7 + (q - 6)^2"), Some(true));
    assert_eq!(proved("if q < 1 then q - 0.5 else q"), Some(false));
    assert_eq!(proved("if q < 1 then q else 2 - q + p"), None);
    assert_eq!(proved("if q < 1 then q*(1.5 + sin(q)*cos(q)) else q"), None);
}

#[test]
fn what_is_no_table() {
    let mut bench = Bench::new();
    let q = bench.read("q");
    assert!(bench.pool.table(q, &[]).is_none() && bench.pool.table(q, &[(0.0, 1.0)]).is_none());
    assert!(bench.pool.table(q, &[(0.0, 0.0), (1e-200, 1e200), (1.0, 1e200)]).is_none());
    let line = bench.pool.table(q, &[(-1.0, -2.0), (1.0, 2.0)]).expect("a line");
    let wanted = bench.read("2*q");
    assert_eq!(line, wanted);
}
