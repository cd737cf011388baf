//! Closed forms, balances and bad input.

use super::*;
use crate::double_double::DoubleDouble;
use std::ops::{Add, Mul};

fn system(n: usize, m: usize, a: &[f64]) -> Linear {
    Linear { n, m, a: doubled(a), ..Linear::default() }
}

fn doubled(x: &[f64]) -> Vec<DoubleDouble> {
    x.iter().copied().map(DoubleDouble::new).collect()
}

/// `v^T Q v` from the packed triangle.
fn value(packed: &[f64], v: &[f64]) -> f64 {
    let mut k = 0;
    let mut sum = 0.0;
    for i in 0..v.len() {
        for j in i..v.len() {
            sum += packed[k] * v[i] * v[j];
            k += 1;
        }
    }
    sum
}

/// The table, and its exponential with both parts added.
fn both(linear: &Linear, h: f64) -> (Vec<f64>, Vec<f64>) {
    let table = table(linear, h).unwrap();
    let layout = Layout::of(linear);
    let sums = (0..layout.low()).map(|k| table[k] + table[layout.low() + k]).collect();
    (table, sums)
}

fn close(a: f64, b: f64, bound: f64) {
    assert!((a - b).abs() <= bound, "{a:e} instead of {b:e}, off by {:e}", a - b);
}

#[test]
fn damped_oscillator() {
    for (w, c, h) in [(1.0f64, 0.1, 0.3), (30.0, 2.0, 1.0), (1.0, 1.9, 10.0), (1e3, 1e-3, 0.125)] {
        // x'' = -w² x - c x', in units that are far apart
        let unit = 1e12;
        let linear = system(2, 0, &[0.0, unit, -w * w / unit, -c]);
        let (_, table) = both(&linear, h);
        let (s, q) = (c / 2.0, (w * w - c * c / 4.0).sqrt());
        let decay = (-s * h).exp();
        let (sin, cos) = (q * h).sin_cos();
        let bound = 1e-14 * (1.0 + 0.02 * q * h); // the closed form's own argument is rounded
        close(table[0], decay * (cos + s / q * sin), bound);
        close(table[1] / unit, decay * sin / q, bound / q);
        close(table[2] * unit, -decay * w * w / q * sin, bound * w);
        close(table[3], decay * (cos - s / q * sin), bound);
    }
}

#[test]
fn undamped_oscillators_keep_volume_in_double_double() {
    for wh in [1e-3, 0.7, 31.0, 1e3] {
        let (table, sums) = both(&system(2, 0, &[0.0, 2.0, -0.5, 0.0]), wh);
        let at = |i: usize| DoubleDouble::new(table[i]).add(DoubleDouble::new(table[4 + i]));
        let minus = at(1).mul(at(2)).scale(-1.0);
        let volume = at(0).mul(at(3)).add(minus).add(DoubleDouble::new(-1.0));
        assert!(volume.high.abs() < 1e-23, "{wh}: {volume:?}");
        close(sums[0], f64::cos(wh), 2e-16);
    }
}

#[test]
fn undamped_energy_does_not_drift() {
    for wh in [1e-3, 0.7, 1e3] {
        let t = table(&system(2, 0, &[0.0, 1.0, -1.0, 0.0]), wh).unwrap();
        let mut v = [1.0, 0.25];
        let energy = |v: [f64; 2]| v[0] * v[0] + v[1] * v[1];
        let start = energy(v);
        for _ in 0..1_000_000 {
            let row = |i: usize| (t[2 * i] * v[0] + t[2 * i + 1] * v[1]) + (t[4 + 2 * i] * v[0] + t[5 + 2 * i] * v[1]);
            v = [row(0), row(1)];
        }
        close(energy(v) / start, 1.0, 1e-12);
    }
}

#[test]
fn stiff_and_rotated() {
    // Rates 1 and 1e12 along the diagonals of the plane, every entry exact.
    let (slow, fast) = (1.0, 1e12);
    let (p, q) = (-(slow + fast) / 2.0, (fast - slow) / 2.0);
    let mut linear = system(2, 0, &[p, q, q, p]);
    linear.means = vec![doubled(&[1.0, 0.0])];
    linear.forms = vec![doubled(&[1.0, 0.0, 0.0, 1.0])];
    let (t, e) = both(&linear, 1.0);
    let layout = Layout::of(&linear);
    let half = f64::exp(-1.0) / 2.0;
    for x in &e {
        close(*x, half, 1e-16);
    }
    // DoubleDouble the digits: e^-1 = 0.367879441171442321595523770161460867...
    let reference = DoubleDouble::new(0.36787944117144233).add(DoubleDouble::new(-1.2428753672788363e-17));
    let error = DoubleDouble::new(t[0]).add(DoubleDouble::new(t[layout.low()])).scale(2.0).add(reference.scale(-1.0));
    assert!(error.high.abs() < 1e-18, "{error:?}");
    let mean = (1.0 - f64::exp(-1.0)) / 2.0;
    close(t[layout.mean(0)], mean + 0.5e-12, 1e-15);
    close(t[layout.mean(0) + 1], mean - 0.5e-12, 1e-15);
    // In the frame of the modes the form is (1 - e^-2)/2 and 1/(2e12).
    let s = (1.0 - f64::exp(-2.0)) / 2.0;
    close(t[layout.form(0)], (s + 0.5e-12) / 2.0, 1e-15);
    close(t[layout.form(0) + 1], s - 0.5e-12, 2e-15);
}

#[test]
fn stiff_and_apart() {
    let (_, t) = both(&system(2, 0, &[-1.0, 0.0, 0.0, -1e12]), 1.0);
    close(t[0], f64::exp(-1.0), 1e-16);
    assert_eq!(&t[1..3], [0.0, 0.0]);
    close(t[3], 0.0, 1e-30);
    let (_, t) = both(&system(2, 0, &[-1e-3, 5.0, 0.0, -1e9]), 1.0);
    close(t[1], 5.0 * f64::exp(-1e-3) / (1e9 - 1e-3), 1e-24);
}

#[test]
fn driven_by_constants_ramps_and_sines() {
    // x' = -2 x + u + v + s with u constant, v' = r, r constant, (s, c) turning at 3 rad/s
    let mut a = vec![0.0; 36];
    a[..6].copy_from_slice(&[-2.0, 1e9, 1.0, 0.0, 1.0, 0.0]);
    a[2 * 6 + 3] = 1.0;
    a[4 * 6 + 5] = 3.0;
    a[5 * 6 + 4] = -3.0;
    let mut linear = system(1, 5, &a);
    linear.means = vec![doubled(&[1.0, 0.0, 0.0, 0.0, 0.0, 0.0]), doubled(&[0.0, 0.0, 1.0, 0.0, 0.0, 0.0])];
    let h = 0.75;
    let (table, t) = both(&linear, h);
    let e = f64::exp(-2.0 * h);
    close(t[0], e, 1e-16);
    close(t[1], 1e9 * (1.0 - e) / 2.0, 1e-15 * 1e9);
    close(t[2], (1.0 - e) / 2.0, 1e-15);
    close(t[3], h / 2.0 - (1.0 - e) / 4.0, 1e-15);
    // s(0) = 1, c(0) = 0: s = cos 3t; the response to it.
    close(t[4], (2.0 * f64::cos(3.0 * h) + 3.0 * f64::sin(3.0 * h) - 2.0 * e) / 13.0, 1e-15);
    let layout = Layout::of(&linear);
    close(table[layout.mean(0)], (1.0 - e) / 2.0 / h, 1e-15);
    close(table[layout.mean(1) + 2], 1.0, 1e-15);
    close(table[layout.mean(1) + 3], h / 2.0, 1e-15);
    assert_eq!(table.len(), layout.size());
}

#[test]
fn what_is_lost_is_dissipated() {
    // Two masses, three springs, dampers across; H = (q² k + p² / m) / 2, dissipated b v².
    for (k, b, h) in [(1.0, 0.1, 0.1), (1.0, 1e-9, 1e3), (1e6, 3.0, 1.0), (1.0, 1e9, 1.0)] {
        // q1 q2 p1 p2; masses 1 and 2
        let a = [
            0.0,
            0.0,
            1.0,
            0.0, //
            0.0,
            0.0,
            0.0,
            0.5, //
            -2.0 * k,
            k,
            -b,
            0.5 * b, //
            k,
            -2.0 * k,
            b,
            -0.5 * b,
        ];
        let mut linear = system(4, 0, &a);
        let mut m = vec![0.0; 16];
        // b (p1 - p2 / 2)²
        m[2 * 4 + 2] = b;
        m[2 * 4 + 3] = -0.5 * b;
        m[3 * 4 + 2] = -0.5 * b;
        m[3 * 4 + 3] = 0.25 * b;
        linear.forms = vec![doubled(&m)];
        let t = table(&linear, h).unwrap();
        let layout = Layout::of(&linear);
        let energy = |w: &[f64]| {
            let (q1, q2) = (w[0], w[1]);
            (k * (q1 * q1 + q2 * q2 + (q1 - q2) * (q1 - q2)) + w[2] * w[2] + 0.5 * w[3] * w[3]) / 2.0
        };
        let mut w = [0.3 / f64::sqrt(k), -0.2 / f64::sqrt(k), 0.5, 1.0];
        for _ in 0..20 {
            let next: Vec<f64> = (0..4)
                .map(|i| {
                    let dot = |at: usize| (0..4).map(|j| t[at + 4 * i + j] * w[j]).sum::<f64>();
                    dot(layout.exponential()) + dot(layout.low())
                })
                .collect();
            let lost = value(&t[layout.form(0)..], &w);
            assert!(lost >= 0.0);
            close(energy(&w) - energy(&next), lost, 1e-14 * energy(&w));
            w.copy_from_slice(&next);
        }
    }
}

#[test]
fn unfit_systems_are_told() {
    let one = system(1, 0, &[1.0]);
    assert_eq!(table(&one, 0.0), Err(Unfit::Step(0.0)));
    assert!(matches!(table(&one, f64::NAN), Err(Unfit::Step(_))));
    assert_eq!(table(&one, 1e4), Err(Unfit::Overflow(1e4)));
    assert_eq!(table(&one, 1e300), Err(Unfit::Overflow(1e300)));
    assert_eq!(table(&system(1, 0, &[f64::NAN]), 1.0), Err(Unfit::Coefficient));
    assert_eq!(table(&system(2, 0, &[1.0]), 1.0), Err(Unfit::Shape));
    assert_eq!(table(&system(0, 0, &[]), 1.0), Ok(vec![]));
}

/// A long line that ends in a resistor: far entries of the form are mostly rounding, and its root must not make much of
/// them.
#[test]
fn squares_agree_with_forms_on_long_lines() {
    for cells in [6, 12, 20, 30] {
        let n = 2 * cells;
        let mut a = vec![0.0; n * n];
        let (l, c, g) = (1e-3, 1e-6, 1.0 / 31.6);
        for k in 0..n {
            // flux, charge, flux, charge, ...
            let (mine, next) = if k % 2 == 0 { (l, c) } else { (c, l) };
            let _ = mine;
            if k + 1 < n {
                a[k * n + k + 1] = -1.0 / next;
                a[(k + 1) * n + k] = 1.0 / if k % 2 == 0 { l } else { c };
            }
        }
        a[(n - 1) * n + n - 1] = -g / c;
        let mut m = vec![0.0; n * n];
        m[n * n - 1] = g / (c * c);
        for h in [5e-7, 1e-6, 2e-6, 1e-5] {
            let mut linear = system(n, 0, &a);
            (linear.forms, linear.squares) = (vec![doubled(&m)], vec![doubled(&m)]);
            let t = table(&linear, h).unwrap();
            let layout = Layout::of(&linear);
            for shift in 0..4 {
                let w: Vec<f64> = (0..n)
                    .map(|k| (0.3 * (k + shift * 5) as f64).sin() * if k % 2 == 0 { 3e-5 } else { 1e-6 })
                    .collect();
                let mut form = 0.0;
                let mut at = layout.form(0);
                for i in 0..n {
                    for j in i..n {
                        form += t[at] * w[i] * w[j];
                        at += 1;
                    }
                }
                let squares: f64 = (0..n)
                    .map(|r| (0..n).map(|j| t[layout.square(0) + r * n + j] * w[j]).sum::<f64>())
                    .map(|x| x * x)
                    .sum();
                let size = g * (1e-6f64 / c).powi(2) * h;
                assert!((form - squares).abs() <= 1e-12 * size, "{cells} cells, {h}: {form:e} {squares:e} of {size:e}");
            }
        }
    }
}

/// A product of two signals is that of their means, and a drift: against the plain form.
#[test]
fn drifts_are_what_is_left_of_a_product() {
    let a = [-3.0, 7.0, 1.0, -7.0, -0.5, 0.25, 0.0, 0.0, -0.8];
    let (z, y) = ([1.0, 2.0, -1.0], [0.5, -1.0, 3.0]);
    let product: Vec<f64> = (0..9).map(|k| 0.5 * (z[k / 3] * y[k % 3] + y[k / 3] * z[k % 3])).collect();
    for h in [1e-3, 0.1, 3.0, 40.0] {
        let mut linear = system(3, 0, &a);
        linear.means = vec![doubled(&z), doubled(&y)];
        linear.forms = vec![doubled(&product)];
        linear.drifts = vec![doubled(&product)];
        let table = table(&linear, h).unwrap();
        let layout = Layout::of(&linear);
        let w = [0.3, -1.2, 0.7];
        let row = |at: usize| (0..3).map(|j| table[at + j] * w[j]).sum::<f64>();
        let g = [0, 3, 6].map(|at| row(layout.euler() + at));
        let (mean_z, mean_y) = (row(layout.mean(0)), row(layout.mean(1)));
        let drift = value(&table[layout.drift(0)..], &g);
        let found = h * (mean_z * mean_y) + drift;
        close(found, value(&table[layout.form(0)..], &w), 1e-13 * (1.0 + h));
        assert_eq!(layout.size(), table.len());
    }
}

/// A capacitor behind a resistor of no account, driven by a ramp: over 1e9 to 1e17 time constants it takes C u du, of
/// which next to nothing is lost, though its current is 1e-17 of the two that it is the difference of.
#[test]
fn what_a_tight_capacitor_takes() {
    let (c, slope, from) = (1e-6f64, 2.0, 0.75);
    for r in [1e-3f64, 1e-7, 1e-11] {
        // q, u, du/dt
        let (g, k) = (
            DoubleDouble::new(1.0).divided(DoubleDouble::new(r)),
            DoubleDouble::new(1.0).divided(DoubleDouble::new(c)),
        );
        let (none, one) = (DoubleDouble::default(), DoubleDouble::new(1.0));
        let current = vec![g.mul(k).scale(-1.0), g, none];
        let mut linear = Linear { n: 1, m: 2, ..Linear::default() };
        linear.a = [current.clone(), vec![none, none, one], vec![none; 3]].concat();
        linear.means = vec![vec![none, one, none], current.clone()];
        let form = |z: [DoubleDouble; 3]| -> Vec<DoubleDouble> {
            let entry = |i: usize| z[i / 3].mul(current[i % 3]).add(z[i % 3].mul(current[i / 3])).scale(0.5);
            (0..9).map(entry).collect()
        };
        linear.drifts = vec![form([none, one, none])];
        linear.squares = vec![form([k.scale(-1.0), one, none])];
        let h = 1.0;
        let table = table(&linear, h).unwrap();
        let layout = Layout::of(&linear);
        // Where it has followed for long: behind by R C.
        let w = [c * (from - r * c * slope), from, slope];
        let row = |at: usize| (0..3).map(|j| table[at + j] * w[j]).sum::<f64>();
        let g = [0, 3, 6].map(|at| row(layout.euler() + at));
        let given = h * (row(layout.mean(0)) * row(layout.mean(1))) + value(&table[layout.drift(0)..], &g);
        let wanted = c * slope * h * (from + 0.5 * slope * h);
        close(given / wanted, 1.0, 1e-15);
        let lost: f64 = (0..3).map(|i| row(layout.square(0) + 3 * i)).map(|x| x * x).sum();
        close(lost / wanted, r * (c * slope).powi(2) * h / wanted, 1e-16);
    }
}
