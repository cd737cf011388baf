//! The energy reference of a group: where its energy is least, and how large it is there.

use crate::discretise::cluster::{Cluster, Group};
use crate::expression::{Expr, Pool, Symbol};
use crate::model::Model;

/// Where the least of an energy is looked for, on both sides of where it is near: powers of ten, times what the state
/// starts at, or where its energy changes its character.
const DECADES: std::ops::RangeInclusive<i32> = -9..=9;

/// The least energy of a group near where it starts; where there is none, as of heat, which is least at no temperature,
/// its energy at the start.
pub(crate) fn reference_energy(model: &mut Model, g: &Group, c: &Cluster) -> f64 {
    reference(model, g, c).0
}

/// The same, and whether it is a least energy rather than that at the start.
pub(crate) fn reference(model: &mut Model, g: &Group, c: &Cluster) -> (f64, bool) {
    if let Some(x) = g.least_at {
        return (model.pool.eval(g.energy, &|_| x), true);
    }
    // Of each state its symbol, where the energy is least, and where it starts.
    let at: Vec<(Symbol, f64, f64)> = g
        .states
        .iter()
        .map(|s| (c.states[*s].symbol, state_of_minimum(model, g, c, *s), c.states[*s].initial))
        .collect();
    let level = |e: Expr, initial: bool| {
        model.pool.eval(e, &|s| at.iter().find(|t| t.0 == s).map_or(0.0, |t| if initial { t.2 } else { t.1 }))
    };
    let rise = (level(g.energy, true) - level(g.energy, false)).abs();
    let flat = g.coenergy.iter().zip(&at).all(|(z, t)| level(*z, false).abs() * (t.2 - t.1).abs() <= 1e-6 * rise);
    let h = level(g.energy, !flat);
    if h.is_finite() { (h, flat) } else { (0.0, false) }
}

/// The state where a storage's energy is least, near where it starts: by walking down and Newton's method.
pub(crate) fn state_of_minimum(model: &mut Model, g: &Group, c: &Cluster, state: usize) -> f64 {
    if let Some(x) = g.least_at {
        return x;
    }
    if g.states.len() > 1 {
        let all = descend(model, g, c, &[]);
        return g.states.iter().position(|s| *s == state).map_or(0.0, |i| all[i]);
    }
    let symbol = c.states[state].symbol;
    let Some(&slope) = g.coenergy.first() else { return 0.0 };
    let curvature = model.pool.derivative(slope, symbol);
    let at = |e: Expr, x: f64| model.pool.eval(e, &|_| x);
    if at(slope, 0.0) == 0.0 && at(curvature, 0.0) >= 0.0 {
        return 0.0;
    }
    let x = walk(&model.pool, [g.energy, slope, curvature], c.states[state].initial);
    if x.is_finite() { x } else { 0.0 }
}

/// Where an energy of one state, with its slope and curvature, is least near a value of that.
fn walk(pool: &Pool, [energy, slope, curvature]: [Expr; 3], mut x: f64) -> f64 {
    let at = |e: Expr, x: f64| pool.eval(e, &|_| x);
    for _ in 0..24 {
        let mut d = at(slope, x) / at(curvature, x).abs();
        if !d.is_finite() || d.abs() <= 1e-15 * x.abs() {
            break;
        }
        // What is out of the energy's domain is not lower either.
        let falls = |d: f64| at(energy, x - d) <= at(energy, x);
        while !falls(d) && d.abs() > 1e-300 {
            d *= 0.5;
        }
        x -= d;
    }
    x
}

/// The least that the energy of a group can be while some of its states stay as they start, as far as it is seen: near
/// where it starts, and where powers of ten lie beside that and 0. What a sampled region has to give is counted from
/// there: an energy has no zero of its own.
pub(crate) fn minimum(model: &mut Model, g: &Group, c: &Cluster, stay: &[usize]) -> f64 {
    if c.time.is_some_and(|t| model.pool.contains(g.energy, t)) {
        return 0.0;
    }
    if let Some(x) = g.least_at {
        return model.pool.eval(g.energy, &|_| x);
    }
    let start: Vec<(Symbol, f64)> = g.states.iter().map(|s| (c.states[*s].symbol, c.states[*s].initial)).collect();
    let near: Vec<f64> = match g.states.len() {
        1 => vec![state_of_minimum(model, g, c, g.states[0])],
        _ => descend(model, g, c, stay),
    };
    let slopes = match (&g.coenergy[..], &start[..]) {
        (&[slope], &[(symbol, _)]) => Some([g.energy, slope, model.pool.derivative(slope, symbol)]),
        _ => None,
    };
    let pool = &model.pool;
    let energy =
        |x: &dyn Fn(usize) -> f64| pool.eval(g.energy, &|s| start.iter().position(|t| t.0 == s).map_or(0.0, x));
    let size_of = |k: usize| {
        let (symbol, start) = start[k];
        let landmarks = pool.landmarks(&[g.energy], symbol, &|s| {
            g.states.iter().position(|i| c.states[*i].symbol == s).map_or(0.0, |i| near[i])
        });
        let [size, _] = landmarks.extent();
        if start == 0.0 { size } else { start.abs() }
    };
    let mut least = f64::INFINITY;
    let mut look = |h: f64| {
        let lower = h < least;
        least = if lower { h } else { least };
        lower
    };
    look(energy(&|i| start[i].1));
    look(energy(&|i| near[i]));
    for base in [&near, &start.iter().map(|s| s.1).collect()] {
        for (k, x) in base.iter().enumerate().filter(|(k, _)| !stay.contains(&g.states[*k])) {
            let size = size_of(k);
            for off in DECADES.flat_map(|n| [1.0, -1.0].map(|side| side * size * libm::exp10(f64::from(n)))) {
                if look(energy(&|i| if i == k { x + off } else { base[i] }))
                    && let Some(slopes) = slopes
                {
                    let x = walk(pool, slopes, x + off);
                    look(energy(&|_| x));
                }
            }
        }
    }
    if least.is_finite() { least } else { 0.0 }
}

/// The state of least energy of several, of which some stay: down along one after the other.
fn descend(model: &mut Model, g: &Group, c: &Cluster, stay: &[usize]) -> Vec<f64> {
    let symbols: Vec<Symbol> = g.states.iter().map(|s| c.states[*s].symbol).collect();
    let mut x: Vec<f64> = vec![0.0; symbols.len()];
    let value = |model: &Model, e: Expr, x: &[f64]| {
        model.pool.eval(e, &|s| symbols.iter().position(|t| *t == s).map_or(0.0, |i| x[i]))
    };
    let flat = |model: &Model, x: &[f64]| g.coenergy.iter().all(|z| value(model, *z, x) == 0.0);
    if !stay.is_empty() || !flat(model, &x) {
        x = g.states.iter().map(|s| c.states[*s].initial).collect();
        let slopes: Vec<Expr> = g.coenergy.iter().zip(&symbols).map(|(z, s)| model.pool.derivative(*z, *s)).collect();
        for _ in 0..500 {
            let before = x.clone();
            for i in (0..x.len()).filter(|i| !stay.contains(&g.states[*i])) {
                let mut d = value(model, g.coenergy[i], &x) / value(model, slopes[i], &x).abs();
                let h = value(model, g.energy, &x);
                let from = x[i];
                while d.is_finite() && d != 0.0 && d.abs() > 1e-16 * from.abs() {
                    x[i] = from - d;
                    if value(model, g.energy, &x) <= h {
                        break;
                    }
                    x[i] = from;
                    d *= 0.5;
                }
            }
            if x == before {
                break;
            }
        }
    }
    x.into_iter().map(|x| if x.is_finite() { x } else { 0.0 }).collect()
}
