//! How large the energies and states of a scene are, from its own numbers: what is nothing beside them is nothing in
//! any units.

use crate::discretise::analysis::curvature;
use crate::discretise::cluster::Cluster;
use crate::expression::{Expr, Symbol};
use crate::model::Model;
use crate::structure::Form;
use rustc_hash::FxHashMap;

/// Signals that are integrals of one another get their sizes one after the other, at most this deep.
const MAX_DEPTH: usize = 4;

/// The size of a scene's energies, J, and by cluster those of its states and then of its integrals.
pub(crate) struct Sizes {
    pub(crate) energy: f64,
    pub(crate) states: Vec<Vec<f64>>,
}

/// A cluster at the start.
struct AtStart {
    /// States, inputs and the time.
    known: FxHashMap<Symbol, f64>,
    /// What states and integrals change by in a second.
    rates: Vec<Expr>,
    /// How strongly the energy bends along each state.
    curvatures: Vec<f64>,
    /// How long each state goes on as it begins, s: a usual step, or the time in which it turns where that is shorter.
    spans: Vec<f64>,
    step: f64,
}

/// Energies are as large as the largest that is stored at the start, or that the efforts and flows which drive a
/// storage would store in it in a usual step (or until it turns, if that is sooner) if none of them held another. An
/// input that is 0 counts as 1 of its unit, since what it will be is not known. A state is as large as what that energy
/// moves it by. An integral is as large as its change in a usual step, where all states are of their sizes; so is a
/// signal state, but for no longer than the fastest state of its cluster goes on as it begins. All are 0 where nothing
/// drives anything.
pub(crate) fn sizes(clusters: &[Cluster], model: &mut Model, form: &Form) -> Sizes {
    let starts: Vec<AtStart> = clusters.iter().map(|c| at_start(c, model, form)).collect();
    let energy = clusters.iter().zip(&starts).map(|(c, start)| energy(c, model, start)).fold(0.0, f64::max);
    let states = clusters.iter().zip(&starts).map(|(c, start)| states(c, model, start, energy)).collect();
    Sizes { energy, states }
}

fn at_start(c: &Cluster, model: &mut Model, form: &Form) -> AtStart {
    let flat = c.flat_at_instant(&mut model.pool, form);
    let curvatures = curvature::curvatures(c, model);
    let all = c.states.iter().map(|s| s.rate).chain(c.integrals.iter().map(|i| i.rate));
    let rates: Vec<Expr> = all.map(|rate| model.pool.substitute(rate, &flat)).collect();
    let step = c.sampling.map_or(model.settings.pace, |s| model.samplings[s].period);
    let input = |i: usize| if model.inputs[i].value == 0.0 { 1.0 } else { model.inputs[i].value };
    let inputs = c.inputs.iter().map(|i| (i.1, input(i.0)));
    let time = c.time.map(|t| (t, model.settings.end));
    let known: FxHashMap<Symbol, f64> =
        c.states.iter().map(|s| (s.symbol, s.initial)).chain(inputs).chain(time).collect();
    let at = |s: Symbol| known.get(&s).copied().unwrap_or(0.0);
    let curvatures = model.pool.eval_all(&curvatures, &at);
    let spans = spans(c, model, &rates, &at).into_iter().map(|span| step.min(span)).collect();
    AtStart { known, rates, curvatures, spans, step }
}

/// The time in which each state turns or decays, s, by the slopes of the rates at the start: 1 over `|d r_i/d x_i|` or
/// `sqrt(|d r_i/d x_j d r_j/d x_i|)`, whichever is the largest. Infinite where none does.
fn spans(c: &Cluster, model: &mut Model, rates: &[Expr], at: &dyn Fn(Symbol) -> f64) -> Vec<f64> {
    let n = c.states.len();
    let place: FxHashMap<Symbol, usize> = c.states.iter().enumerate().map(|(i, s)| (s.symbol, i)).collect();
    let mut fastest = vec![0.0f64; n];
    let mut slopes: FxHashMap<(usize, usize), Expr> = FxHashMap::default();
    for (i, rate) in rates[..n].iter().enumerate() {
        let by: Vec<Symbol> = model.pool.symbols(*rate).into_iter().filter(|s| place.contains_key(s)).collect();
        for s in by {
            slopes.insert((i, place[&s]), model.pool.derivative(*rate, s));
        }
    }
    for (&(i, j), slope) in slopes.iter().filter(|(at, _)| at.1 <= at.0) {
        let Some(back) = slopes.get(&(j, i)) else { continue };
        let product: f64 = model.pool.eval_all(&[*slope, *back], at).into_iter().map(|x| x.abs().sqrt()).product();
        for k in [i, j] {
            fastest[k] = fastest[k].max(product);
        }
    }
    fastest.into_iter().map(|rate| 1.0 / rate).collect()
}

fn energy(c: &Cluster, model: &Model, start: &AtStart) -> f64 {
    let at = |s: Symbol| start.known.get(&s).copied().unwrap_or(0.0);
    let energies: Vec<Expr> = c.groups.iter().map(|g| g.energy).collect();
    let stored = model.pool.eval_all(&energies, &at).into_iter().map(f64::abs);
    let quadratic = c.states.iter().zip(&start.curvatures).map(|(s, k)| 0.5 * k * s.initial * s.initial);
    let rates = model.pool.magnitudes(&start.rates, &at);
    let moved = rates.into_iter().zip(&start.curvatures).zip(&start.spans);
    let moved = moved.map(|((rate, k), span)| 0.5 * k * (rate * span).powi(2));
    stored.chain(quadratic).chain(moved).filter(|e| e.is_finite()).fold(0.0, f64::max)
}

fn states(c: &Cluster, model: &Model, start: &AtStart, energy: f64) -> Vec<f64> {
    let symbols: Vec<Symbol> = c.states.iter().map(|s| s.symbol).chain(c.integrals.iter().map(|i| i.symbol)).collect();
    let mut sizes = vec![0.0f64; symbols.len()];
    for (size, k) in sizes.iter_mut().zip(&start.curvatures).filter(|(_, k)| **k > 0.0) {
        *size = (2.0 * energy / k).sqrt();
    }
    let fastest = start.spans.iter().copied().fold(start.step, f64::min);
    let n = c.states.len();
    for _ in 0..MAX_DEPTH {
        let place: FxHashMap<Symbol, f64> = symbols.iter().copied().zip(sizes.iter().copied()).collect();
        let at = |s: Symbol| {
            let known = start.known.get(&s).copied().unwrap_or(0.0);
            place.get(&s).map_or(known, |size| size.max(known.abs()))
        };
        let rates = model.pool.magnitudes(&start.rates, &at);
        // The size of a signal state is kept once it is known: with what it drives in turn it would grow without end.
        for (i, (size, rate)) in
            sizes.iter_mut().zip(rates).enumerate().filter(|(i, (size, _))| *i >= n || **size == 0.0)
        {
            let moved = rate * if i < n { fastest } else { start.step };
            *size = if moved.is_finite() { moved } else { 0.0 };
        }
    }
    sizes
}
