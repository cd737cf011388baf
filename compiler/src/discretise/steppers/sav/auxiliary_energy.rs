//! The energies that are not quadratic, each kept as a number of its own beside the states.

use crate::discretise::analysis::energy_minimum;
use crate::discretise::analysis::polynomial::{degree, is_quadratic};
use crate::discretise::cluster::{Cluster, Group};
use crate::expression::{Expr, Number, Pool, Sign, Symbol};
use crate::model::Model;
use rustc_hash::FxHashMap;
use std::cell::OnceCell;

/// An energy that is kept: that of a group, without the part of it that is quadratic.
pub(crate) struct AuxiliaryEnergy {
    /// Its region, by its place among the cluster's.
    pub(crate) region: usize,
    /// Its states, by their place in the cluster.
    pub(crate) states: Vec<usize>,
    /// V, of the states.
    pub(crate) energy: Expr,
    /// dV/dx of each.
    pub(crate) slopes: Vec<Expr>,
    /// Where V has a least value, that.
    pub(crate) least: Option<f64>,
    /// V at the start.
    pub(crate) start: f64,
}

/// An energy that is not kept: all of a group's, or a part of it.
pub(crate) struct Plain {
    pub(crate) region: usize,
    pub(crate) states: Vec<usize>,
    pub(crate) energy: Expr,
    pub(crate) slopes: Vec<Expr>,
    pub(crate) least: f64,
    pub(crate) start: f64,
}

/// What a cluster stores.
pub(crate) struct Stores {
    pub(crate) auxiliaries: Vec<AuxiliaryEnergy>,
    pub(crate) plain: Vec<Plain>,
}

impl Stores {
    pub(crate) fn new(c: &Cluster, model: &mut Model) -> Self {
        let (mut auxiliaries, mut plain) = (Vec::new(), Vec::new());
        for g in &c.groups {
            let region = c.regions.iter().position(|r| *r == g.region).unwrap_or(0);
            let (even, rest) = match is_quadratic(c, &mut model.pool, g) {
                true => (Some(g.clone()), None),
                false => match split(c, &mut model.pool, g) {
                    Some((even, rest)) => (Some(even), Some(rest)),
                    None => (None, Some(g.clone())),
                },
            };
            if let Some(g) = even {
                let (energy, start) = energy(c, model, &g);
                let least = if g.bounded { energy_minimum::reference_energy(model, &g, c) } else { 0.0 };
                plain.push(Plain { region, states: g.states, energy, slopes: g.coenergy, least, start });
            }
            if let Some(g) = rest {
                let (energy, start) = energy(c, model, &g);
                let (least, told) = energy_minimum::reference(model, &g, c);
                // The steps keep no Casimir to the last bit.
                let least = (told && g.bounded && g.least_at.is_none()).then_some(least);
                auxiliaries.push(AuxiliaryEnergy {
                    region,
                    states: g.states,
                    energy,
                    slopes: g.coenergy,
                    least,
                    start,
                });
            }
        }
        Self { auxiliaries, plain }
    }

    /// What a region stores at the start, above where it is least.
    pub(crate) fn above(&self, region: usize) -> f64 {
        let auxiliaries = self.auxiliaries.iter().filter(|v| v.region == region).map(|v| match v.least {
            Some(least) => (v.start - least).max(0.0),
            None => v.start.abs(),
        });
        let plain = self.plain.iter().filter(|p| p.region == region).map(|p| (p.start - p.least).max(0.0));
        let sum: f64 = auxiliaries.chain(plain).sum();
        if sum.is_finite() { sum } else { 0.0 }
    }
}

/// The energy of a group as it is to be computed, and what it is at the start.
fn energy(c: &Cluster, model: &mut Model, g: &Group) -> (Expr, f64) {
    let e = c.energy_form(&mut model.pool, g).energy;
    let at = |s: Symbol| g.states.iter().map(|i| &c.states[*i]).find(|x| x.symbol == s).map_or(0.0, |x| x.initial);
    (e, model.pool.eval(e, &at))
}

/// A polynomial's quadratic part at 0 and the rest, where that is seen not to be negative.
fn split(c: &Cluster, pool: &mut Pool, g: &Group) -> Option<(Group, Group)> {
    let symbols: Vec<Symbol> = g.states.iter().map(|s| c.states[*s].symbol).collect();
    degree(pool, g.energy, &symbols)?;
    let nothing = pool.int(0);
    let zero: FxHashMap<Symbol, Expr> = symbols.iter().map(|s| (*s, nothing)).collect();
    let (mut even, mut energy) = (Vec::new(), Vec::new());
    for (z, s) in g.coenergy.iter().zip(&symbols) {
        let x = pool.var(*s);
        let steady = pool.substitute(*z, &zero);
        let mut slope = vec![(steady, Number::ONE)];
        energy.push((pool.mul(steady, x), Number::ONE));
        for t in &symbols {
            let k = pool.derivative(*z, *t);
            let k = pool.substitute(k, &zero);
            let y = pool.var(*t);
            let term = pool.mul(k, y);
            slope.push((term, Number::ONE));
            energy.push((pool.mul(term, x), Number::HALF));
        }
        even.push(pool.combine(&slope));
    }
    let part = pool.combine(&energy);
    let rest = pool.sub(g.energy, part);
    if pool.is_zero(part) || !pool.sign(rest, &|_| Sign::Unknown).is_nonnegative() {
        return None;
    }
    let slopes = g.coenergy.iter().zip(&even).map(|(z, k)| pool.sub(*z, *k)).collect();
    let group = |energy: Expr, coenergy: Vec<Expr>| Group {
        region: g.region,
        states: g.states.clone(),
        energy,
        coenergy,
        energy_form: OnceCell::new(),
        bounded: g.bounded,
        least_at: g.least_at,
    };
    Some((group(part, even), group(rest, slopes)))
}
