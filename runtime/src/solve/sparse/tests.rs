//! Residuals of solved systems.

use super::*;
use crate::solve::testing::Random;

/// Solves with a known solution and checks each row's residual against its terms.
fn check(n: usize, entries: &[(u32, u32, f64)], bound: f64) -> Symbolic {
    let pattern: Vec<_> = entries.iter().map(|&(r, c, _)| (r, c)).collect();
    let values: Vec<_> = entries.iter().map(|&(.., v)| v).collect();
    let mut random = Random::new(5);
    let mut b: Vec<f64> = (0..n).map(|_| random.next()).collect();
    let right = b.clone();
    let symbolic = Symbolic::analyse(n, &pattern).unwrap();
    let mut numeric = symbolic.numeric();
    numeric.factor(&symbolic, &values, false).unwrap();
    numeric.solve(&symbolic, &values, &mut b);
    let mut rest = right.clone();
    let mut size: Vec<f64> = right.iter().map(|b| b.abs()).collect();
    for &(r, c, v) in entries {
        rest[r as usize] -= v * b[c as usize];
        size[r as usize] += (v * b[c as usize]).abs();
    }
    for (i, (rest, size)) in rest.iter().zip(&size).enumerate() {
        assert!(rest.abs() <= bound * size, "row {i}: {rest:e} of {size:e}");
    }
    symbolic
}

/// A positive definite diagonal plus a skew pattern, as steppers make them, in wild units.
#[test]
fn skew_plus_definite() {
    let mut random = Random::new(3);
    for n in [1usize, 2, 5, 17, 60, 200] {
        let unit: Vec<f64> = (0..n).map(|_| (20.0 * random.next()).exp2()).collect();
        let mut entries: Vec<(u32, u32, f64)> =
            (0..n).map(|i| (i as u32, i as u32, (1.0 + random.next().abs()) * unit[i] * unit[i])).collect();
        let mut places = std::collections::BTreeSet::new();
        for _ in 0..2 * n {
            let (i, j) = (random.below(n), random.below(n));
            if i != j && places.insert((i.min(j), i.max(j))) {
                let v = 10.0 * random.next() * unit[i] * unit[j];
                entries.push((i as u32, j as u32, v));
                entries.push((j as u32, i as u32, -v));
            }
        }
        check(n, &entries, 1e-12);
    }
}

#[test]
fn holes_in_the_diagonal() {
    // Rows of constraints: [I B; B^T 0] with B having one entry a column.
    let m = 30u32;
    let mut entries = Vec::new();
    for i in 0..2 * m {
        entries.push((i, i, 1.0 + f64::from(i) * 0.1));
    }
    for c in 0..m {
        for (k, v) in [(2 * c, 1.0), (2 * c + 1, -0.7)] {
            entries.push((k, 2 * m + c, v));
            entries.push((2 * m + c, k, v));
        }
    }
    check(3 * m as usize, &entries, 1e-12);
}

#[test]
fn a_long_ladder() {
    let n = 200_000u32;
    let mut entries = Vec::new();
    for i in 0..n {
        entries.push((i, i, 1.0));
        if i + 1 < n {
            entries.push((i, i + 1, 3.0));
            entries.push((i + 1, i, -3.0));
        }
    }
    let symbolic = check(n as usize, &entries, 1e-13);
    assert!(symbolic.fill() < 4 * n as usize, "{}", symbolic.fill());
}

#[test]
fn a_grid() {
    let side = 100u32;
    let mut entries = Vec::new();
    for i in 0..side * side {
        entries.push((i, i, 4.1));
        let right = (i % side + 1 < side).then_some(i + 1);
        let below = (i + side < side * side).then_some(i + side);
        for j in right.into_iter().chain(below) {
            entries.push((i, j, -1.0));
            entries.push((j, i, -1.0));
        }
    }
    let symbolic = check((side * side) as usize, &entries, 1e-13);
    assert!(symbolic.fill() < 700_000, "{}", symbolic.fill());
}

#[test]
fn singular_matrices_are_told() {
    assert!(Symbolic::analyse(3, &[(0, 0), (1, 0), (2, 2), (2, 1)]).is_err());
    let pattern = [(0, 0), (0, 1), (1, 0), (1, 1)];
    let symbolic = Symbolic::analyse(2, &pattern).unwrap();
    let mut numeric = symbolic.numeric();
    assert!(numeric.factor(&symbolic, &[1.0, 2.0, 0.5, 1.0], false).is_err());
    assert!(numeric.factor(&symbolic, &[0.0, 2.0, 0.5, 0.0], false).is_err());
    assert!(numeric.factor(&symbolic, &[1.0, f64::NAN, 0.5, 1.0], false).is_err());
    assert!(numeric.factor(&symbolic, &[1.0, 2.0, 0.5, 7.0], false).is_ok());
}

#[test]
fn raised_pivots() {
    // A ladder some of whose diagonal entries happen to be 0, ordered from the end.
    let n = 5000u32;
    let mut random = Random::new(9);
    let mut entries = Vec::new();
    for i in 0..n {
        entries.push((i, i, if i % 20 < 2 { 0.0 } else { 1.0 + random.next().abs() }));
        if i + 1 < n {
            entries.push((i, i + 1, 2.0 + random.next()));
            entries.push((i + 1, i, 2.0 + random.next()));
        }
    }
    let pattern: Vec<_> = entries.iter().map(|&(r, c, _)| (r, c)).collect();
    let values: Vec<_> = entries.iter().map(|&(.., v)| v).collect();
    let symbolic = Symbolic::analyse(n as usize, &pattern).unwrap();
    let mut numeric = symbolic.numeric();
    assert!(numeric.factor(&symbolic, &values, false).is_err());
    let right: Vec<f64> = (0..n).map(|_| random.next()).collect();
    let mut x = right.clone();
    assert_eq!(numeric.solve_raised(&symbolic, &values, &mut x), Ok(()));
    let mut rest = right.clone();
    for &(r, c, v) in &entries {
        rest[r as usize] -= v * x[c as usize];
    }
    let size = x.iter().fold(1.0f64, |m, x| m.max(x.abs()));
    assert!(rest.iter().all(|r| r.abs() < 1e-11 * size));
    // Two equal rows.
    let twice = [(0, 0), (0, 1), (1, 0), (1, 1)];
    let symbolic = Symbolic::analyse(2, &twice).unwrap();
    let mut x = [1.0, 2.0];
    assert!(symbolic.numeric().solve_raised(&symbolic, &[1.0, 1.0, 1.0, 1.0], &mut x).is_err());
}
