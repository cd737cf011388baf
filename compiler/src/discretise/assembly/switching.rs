//! What switches within the steps of a cluster, by name: for who takes steps that are not cut there.

use crate::Stages;
use crate::discretise::choice::UNCUT;
use crate::expression::{Expr, Node, Pool, Symbol};
use crate::model::Signal;
use crate::structure::Role;
use bond_runtime::ir::{Binary, Unary};
use bond_runtime::scene::Cluster;
use rustc_hash::FxHashSet;

/// So many steps are looked at, for all that a law switches on together, for whether one is cut by an instant; and here
/// in each of them, as parts of it.
const STEPS: f64 = 20_000.0;
const LOOKS: [f64; 4] = [NEAR, 0.35, 0.65, 1.0 - NEAR];
/// Parts of a run at which no period is over.
const ODD: [f64; 3] = [0.141_592_653, 0.414_213_562, 0.718_281_828];
/// So near to a step's end, as a part of it, is at its end.
const NEAR: f64 = 1e-6;

/// Whether a linear cluster that a run steps exactly, in steps that end where a source switches, is not stepped so
/// here.
pub fn is_uncut(c: &Cluster) -> bool {
    c.step.why == UNCUT
}

/// Something that switches.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Switching {
    /// The name of the element or signal.
    pub name: String,
    /// Whether time alone determines when.
    pub timed: bool,
}

/// What of a continuous cluster switches within fixed steps of `h`, s, up to `stop`, s, where a run of the scene meets
/// the instants: it does so with `fitted` steps, and by `exact`. What switches in time alone where steps end is not of
/// them.
pub fn switching(stages: &Stages, c: &Cluster, (h, stop): (f64, f64), fitted: bool) -> Vec<Switching> {
    let met = c.guards.is_some() && (fitted || is_uncut(c) || c.step.linear.is_some());
    if !met || c.period.is_some() {
        return Vec::new();
    }
    let look = Look::new(stages);
    let mut list: Vec<Switching> = Vec::new();
    for (name, expressions) in laws(stages, c) {
        let mut sides = look.sides(expressions);
        let steps = (STEPS / sides.len() as f64).min((stop / h - 1e-9).ceil()).max(1.0);
        sides.retain(|s| !s.timed || s.held || look.cuts(s, (h, stop), steps as u32));
        let Some(timed) = sides.iter().map(|s| s.timed && !s.held).reduce(|a, b| a && b) else { continue };
        if !list.iter().any(|s| s.name == name) {
            list.push(Switching { name, timed });
        }
    }
    list
}

/// All laws of a cluster, by the name of what they are of.
fn laws(stages: &Stages, c: &Cluster) -> Vec<(String, Vec<Expr>)> {
    let (model, form) = (&stages.model, &stages.form);
    let is_own = |region: usize| c.energies.iter().any(|e| e.0 == region);
    let mut list: Vec<(String, Vec<Expr>)> = Vec::new();
    for column in form.columns.iter().filter(|column| is_own(column.region.at())) {
        let mut read: Vec<Expr> = column.row.iter().map(|t| t.1).collect();
        if let Role::Source(v) = column.role {
            read.push(v);
        }
        list.push((column.name.clone(), read));
    }
    for (_, r) in form.regions.iter().enumerate().filter(|(i, _)| is_own(*i)) {
        let name = |column| form.column(column).name.clone();
        list.extend(r.resistors.iter().map(|(column, how)| (name(*column), how.expressions().collect())));
        for g in &r.groups {
            let states = g.states.iter().zip(&g.coenergy);
            list.extend(states.map(|(s, z)| (name(r.states[*s].column), vec![*z])));
        }
        list.extend(r.following.iter().map(|f| (name(f.column), vec![f.rate])));
    }
    let loops = form.loops.iter().filter(|l| is_own(l.region.at()));
    list.extend(loops.map(|l| (model.pool.name(l.unknown).to_string(), vec![l.value])));
    let memories = model.memories.iter().zip(&form.memories).map(|(m, law)| (m.name.as_str(), law));
    let integrals = model.integrals.iter().zip(&form.integrals).map(|(i, rate)| (model.pool.name(i.symbol), rate));
    let of_signals = memories.chain(integrals).filter(|(name, _)| c.names.iter().any(|n| n == name));
    list.extend(of_signals.map(|(name, e)| (name.to_string(), vec![*e])));
    list
}

/// Where a law switches.
struct Side {
    /// It is on the one side where the first is above the second (or above 0), and on the other where it is not; of
    /// `floor`, each whole number is a side.
    of: (Expr, Option<Expr>),
    floor: bool,
    timed: bool,
    /// Whether it depends on what is held over a step, too.
    held: bool,
}

struct Look<'a> {
    pool: &'a Pool,
    time: FxHashSet<Symbol>,
    /// What stands still over a step: what is given from outside, and all that is sampled.
    still: FxHashSet<Symbol>,
}

impl<'a> Look<'a> {
    fn new(stages: &'a Stages) -> Self {
        let (model, form) = (&stages.model, &stages.form);
        let is_sampled = |region: usize| form.regions[region].sampling.is_some();
        let signals = |f: &dyn Fn(&Signal) -> bool| model.signals.iter().filter(|s| f(s.1)).map(|s| *s.0).collect();
        let mut still: FxHashSet<Symbol> = signals(&|s| matches!(s, Signal::Input(_) | Signal::Slope(_)));
        still.extend(model.memories.iter().filter(|m| m.sampling.is_some()).map(|m| m.symbol));
        still.extend(form.columns.iter().filter(|c| is_sampled(c.region.at())).map(|c| c.out));
        still.extend(form.loops.iter().filter(|l| is_sampled(l.region.at())).map(|l| l.unknown));
        let regions = form.regions.iter().filter(|r| r.sampling.is_some());
        still.extend(regions.flat_map(|r| r.states.iter().map(|s| s.symbol)));
        Self { pool: &model.pool, time: signals(&|s| *s == Signal::Time), still }
    }

    /// Where these switch, but by what stands still alone.
    fn sides(&self, mut open: Vec<Expr>) -> Vec<Side> {
        let mut seen: FxHashSet<Expr> = FxHashSet::default();
        let mut list = Vec::new();
        while let Some(e) = open.pop() {
            if !seen.insert(e) {
                continue;
            }
            let node = self.pool.node(e);
            // x |x| has a slope everywhere.
            let even = |child: Expr| match (node, self.pool.node(child)) {
                (Node::Product(_, factors), Node::Unary(Unary::Abs, x)) => factors.iter().any(|f| f.0 == *x),
                _ => false,
            };
            node.each_child(&mut |child| {
                if !even(child) {
                    open.push(child);
                }
            });
            let (of, floor) = match node {
                Node::Binary(Binary::Lt | Binary::Le | Binary::Min | Binary::Max, a, b) => ((*a, Some(*b)), false),
                Node::Unary(Unary::Abs | Unary::Sign, a) => ((*a, None), false),
                Node::Unary(Unary::Floor, a) => ((*a, None), true),
                // `tanh` and `atan` only turn.
                Node::Binary(..)
                | Node::Unary(..)
                | Node::Number(_)
                | Node::Symbol(_)
                | Node::Sum(..)
                | Node::Product(..)
                | Node::Power(..)
                | Node::Select(..) => continue,
            };
            let symbols = self.pool.symbols(e);
            let moves: Vec<&Symbol> = symbols.iter().filter(|s| !self.still.contains(s)).collect();
            if !moves.is_empty() {
                let timed = moves.iter().all(|s| self.time.contains(s));
                list.push(Side { of, floor, timed, held: moves.len() < symbols.len() });
            }
        }
        list
    }

    /// Whether one that time alone switches does so within a step: by where a line is 0, else in as many steps.
    fn cuts(&self, side: &Side, (h, stop): (f64, f64), steps: u32) -> bool {
        let value = |t: f64| {
            let value = |e: Expr| self.pool.eval(e, &|_| t);
            value(side.of.0) - side.of.1.map_or(0.0, value)
        };
        let (first, last) = (value(0.0), value(stop));
        let size = 1e-12 * (first.abs() + last.abs());
        let on_line = |part: f64| (value(part * stop) - first - part * (last - first)).abs() <= size;
        if !side.floor && ODD.into_iter().all(on_line) {
            let at = stop * first / (first - last) / h;
            return at > NEAR && at < stop / h && (at - at.round()).abs() > NEAR;
        }
        (0..steps).any(|k| {
            let mut looks = LOOKS.iter().map(|part| {
                let x = value((f64::from(k) + part) * h);
                if side.floor { x.floor() } else { f64::from(u8::from(x > 0.0)) }
            });
            let first = looks.next();
            looks.any(|x| first != Some(x))
        })
    }
}
