//! Residuals of solved systems.

use super::*;
use crate::solve::linear::Matrix;
use crate::solve::testing::Random;

/// Solves with a known solution and checks each row's residual against its terms.
fn check(n: usize, entries: &[(u32, u32, f64)], bound: f64) -> Symbolic {
    let pattern: Vec<_> = entries.iter().map(|&(r, c, _)| (r, c)).collect();
    let values: Vec<_> = entries.iter().map(|&(.., v)| v).collect();
    let mut random = Random::new(5);
    let mut b: Vec<f64> = (0..n).map(|_| random.next()).collect();
    let right = b.clone();
    let symbolic = Symbolic::analyse(n, &pattern, true).unwrap();
    let mut numeric = Numeric::<f64>::new(&symbolic);
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

/// So many lines of nodes from a full block of nodes outwards: neighbours, both ways.
fn arms(count: usize, length: usize) -> (usize, Vec<(u32, u32)>) {
    let (hub, n) = (6, 6 + count * length);
    let inside = (0..hub).flat_map(|i| (0..i).map(move |j| (i, j)));
    let arms = (0..count).flat_map(|a| {
        (0..length).map(move |k| (hub + a * length + k, if k == 0 { a } else { hub + a * length + k - 1 }))
    });
    (n, inside.chain(arms).map(|(i, j)| (i as u32, j as u32)).collect())
}

/// Lines are gone through without tables, and solved as the dense elimination does it, in real numbers and in complex
/// ones; twice the same to the bit.
#[test]
fn lines_are_solved_in_runs() {
    for count in 1..=5 {
        let (n, edges) = arms(count, 33);
        let mut random = Random::new(count as u64);
        let mut pattern: Vec<(u32, u32)> = (0..n as u32).map(|i| (i, i)).collect();
        pattern.extend(edges.iter().flat_map(|&(i, j)| [(i, j), (j, i)]));
        let symbolic = Symbolic::analyse(n, &pattern, true).unwrap();
        let lower = &symbolic.tables().lower.runs;
        let (far, rows) = lower.iter().map(|r| (r.distance, r.to - r.from)).max_by_key(|r| r.1).unwrap();
        assert_eq!(far as usize, count, "{lower:?}");
        assert!(rows as usize >= 30 * count, "{lower:?}");
        for parts in [1, 2] {
            let values: Vec<f64> = pattern
                .iter()
                .flat_map(|&(i, j)| {
                    let re = if i == j { 3.0 + random.next() } else { random.next() };
                    [re, random.next()].into_iter().take(parts).collect::<Vec<_>>()
                })
                .collect();
            let right: Vec<f64> = (0..parts * n).map(|_| random.next()).collect();
            let (mut x, mut again) = (right.clone(), right.clone());
            let mut system = crate::solve::linear::System::new(
                n,
                pattern.clone(),
                if parts == 2 { Matrix::Complex } else { Matrix::Kept },
            );
            assert_eq!(system.solve(&values, &mut x, false), Ok(false));
            assert_eq!(system.solve(&values, &mut again, true), Ok(false));
            assert!(x.iter().zip(&again).all(|(x, y)| x.to_bits() == y.to_bits()));
            // Of complex numbers the real and imaginary parts as unknowns of their own.
            let mut dense = vec![0.0; parts * n * parts * n];
            for (k, &(i, j)) in pattern.iter().enumerate() {
                let mut put = |a: usize, b: usize, v: f64| {
                    dense[(parts * i as usize + a) * parts * n + parts * j as usize + b] = v;
                };
                put(0, 0, values[parts * k]);
                if parts == 2 {
                    put(1, 1, values[2 * k]);
                    put(0, 1, -values[2 * k + 1]);
                    put(1, 0, values[2 * k + 1]);
                }
            }
            let mut y = right;
            let mut scratch = crate::solve::dense::Scratch::new(parts * n);
            assert_eq!(crate::solve::dense::solve(parts * n, &mut dense, &mut y, &mut scratch, false), Ok(false));
            let size = y.iter().fold(0.0f64, |m, y| m.max(y.abs()));
            assert!(x.iter().zip(&y).all(|(x, y)| (x - y).abs() < 1e-12 * size), "{count} arms, {parts} parts");
        }
    }
}

/// Complex systems in wild units, of a pattern without order: as the same real ones, and where pivots are 0.
#[test]
fn complex_systems() {
    let mut random = Random::new(8);
    for n in [5usize, 60, 300] {
        for holes in [false, true] {
            let unit: Vec<f64> = (0..n).map(|_| (10.0 * random.next()).exp2()).collect();
            let mut entries = std::collections::BTreeMap::new();
            for i in 0..n {
                let size = if holes && i % 20 == 3 { 0.0 } else { 2.0 };
                entries.insert((i, i), (size * (1.5 + random.next()), size * random.next()));
            }
            for _ in 0..2 * n {
                let (i, j) = (random.below(n), random.below(n));
                if i != j && !entries.contains_key(&(i, j)) {
                    let v = (random.next(), random.next());
                    entries.insert((i, j), v);
                    entries.insert((j, i), (-v.0, v.1));
                }
            }
            let pattern: Vec<(u32, u32)> = entries.keys().map(|&(i, j)| (i as u32, j as u32)).collect();
            let values: Vec<f64> =
                entries.iter().flat_map(|(&(i, j), v)| [v.0 * unit[i] * unit[j], v.1 * unit[i] * unit[j]]).collect();
            let right: Vec<f64> = (0..2 * n).map(|k| random.next() * unit[k / 2]).collect();
            let mut x = right.clone();
            let mut system = crate::solve::linear::System::new(n, pattern.clone(), Matrix::Complex);
            assert_eq!(system.solve(&values, &mut x, false), Ok(false));
            let (mut rest, mut size) = (right.clone(), right.iter().map(|b| b.abs()).collect::<Vec<f64>>());
            for (k, &(i, j)) in pattern.iter().enumerate() {
                let (i, j) = (i as usize, j as usize);
                let (a, b, c, d) = (values[2 * k], values[2 * k + 1], x[2 * j], x[2 * j + 1]);
                rest[2 * i] -= a * c - b * d;
                rest[2 * i + 1] -= a * d + b * c;
                size[2 * i] += (a * c).abs() + (b * d).abs();
                size[2 * i + 1] += (a * d).abs() + (b * c).abs();
            }
            for k in 0..2 * n {
                let size = size[k].max(size[k ^ 1]);
                assert!(rest[k].abs() <= 1e-11 * size, "{n} {holes}: {k} {:e} of {size:e}", rest[k]);
            }
        }
    }
    // A row that is twice another.
    let pattern: Vec<(u32, u32)> = vec![(0, 0), (0, 1), (1, 0), (1, 1)];
    let mut system = crate::solve::linear::System::new(2, pattern, Matrix::Complex);
    let mut x = [1.0, 2.0, 3.0, 4.0];
    assert!(system.solve(&[1.0, 1.0, 2.0, 0.0, 0.0, 2.0, 2.0, 2.0], &mut x, false).is_err());
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
    assert!(symbolic.fill() < 5 * n as usize, "{}", symbolic.fill());
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
    assert!(Symbolic::analyse(3, &[(0, 0), (1, 0), (2, 2), (2, 1)], true).is_err());
    let pattern = [(0, 0), (0, 1), (1, 0), (1, 1)];
    let symbolic = Symbolic::analyse(2, &pattern, true).unwrap();
    let mut numeric = Numeric::<f64>::new(&symbolic);
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
    let symbolic = Symbolic::analyse(n as usize, &pattern, true).unwrap();
    let mut numeric = Numeric::<f64>::new(&symbolic);
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
    // Beside an unknown of which nothing is asked.
    let apart = [(0, 0), (0, 1), (1, 0), (1, 1), (2, 2)];
    let symbolic = Symbolic::analyse(3, &apart, true).unwrap();
    let mut x = [4.0, 2.0, 0.0];
    assert_eq!(Numeric::<f64>::new(&symbolic).solve_raised(&symbolic, &[0.0, 1.0, 2.0, 0.0, 5.0], &mut x), Ok(()));
    assert_eq!(x, [1.0, 4.0, 0.0]);
    // Two equal rows.
    let twice = [(0, 0), (0, 1), (1, 0), (1, 1)];
    let symbolic = Symbolic::analyse(2, &twice, true).unwrap();
    let mut x = [1.0, 2.0];
    assert!(Numeric::<f64>::new(&symbolic).solve_raised(&symbolic, &[1.0, 1.0, 1.0, 1.0], &mut x).is_err());
}

/// Lines of any length as the dense elimination solves them.
#[test]
fn lines_from_both_ends() {
    let mut random = Random::new(11);
    for n in 1u32..=70 {
        let unit: Vec<f64> = (0..n).map(|_| (10.0 * random.next()).exp2()).collect();
        let mut entries = Vec::new();
        for i in 0..n as usize {
            entries.push((i as u32, i as u32, (2.0 + random.next()) * unit[i] * unit[i]));
            if i + 1 < n as usize {
                let k = unit[i] * unit[i + 1];
                entries.push((i as u32, i as u32 + 1, 2.0 * random.next() * k));
                entries.push((i as u32 + 1, i as u32, 2.0 * random.next() * k));
            }
        }
        let symbolic = check(n as usize, &entries, 1e-11);
        assert_eq!(symbolic.tables().line.is_some(), n >= 16);
    }
}
