//! Relay-like laws: diodes, dry friction, valves, contacts that open. Their slope falls by orders of magnitude from one
//! place to another.
//!
//! The network may ask such a law for a value where it almost blocks, as a coil asks a diode for its current: the time
//! constant there is tiny, or 0. A symmetric method does not damp that mode but reverses it in each step (A-stability
//! without L-stability: Hairer and Wanner II, IV.3). The state is then within its tolerance, and the error of the law's
//! output is that of the state times the slope.

use crate::discretise::analysis::smoothness;
use crate::discretise::cluster::{Cluster, Node};
use crate::expression::{Expr, Landmarks, Node as Part, Pool, Symbol};
use crate::model::{Law, Model, Variable};
use crate::structure::{ColumnId, Form, Output};
use bond_runtime::ir::{Binary, Unary};
use rustc_hash::{FxHashMap, FxHashSet};

/// At most this many diodes of two pieces are treated as relays.
const BRIDGE: usize = 4;

/// More loops than this are not looked at: they are stepped by what is known to be cheap.
const LARGEST: usize = 64;

/// The numbers of a cluster at its start.
struct Start(FxHashMap<Symbol, f64>);

impl Start {
    fn of(c: &Cluster, model: &Model) -> Self {
        let inputs = c.inputs.iter().map(|i| (i.1, model.inputs[i.0].value));
        Self(c.states.iter().map(|s| (s.symbol, s.initial)).chain(inputs).collect())
    }

    /// The size of an expression, with one symbol put to a value.
    fn size(&self, pool: &Pool, e: Expr, at: (Symbol, f64)) -> f64 {
        self.eval(pool, e, at).abs()
    }

    /// The value of an expression, likewise.
    fn eval(&self, pool: &Pool, e: Expr, (z, x): (Symbol, f64)) -> f64 {
        pool.eval(e, &|s| if s == z { x } else { self.value(s) })
    }

    /// Where expressions change their character along a symbol.
    fn landmarks(&self, pool: &Pool, list: &[Expr], z: Symbol) -> Landmarks {
        pool.landmarks(list, z, &|s| self.value(s))
    }

    fn value(&self, s: Symbol) -> f64 {
        self.0.get(&s).copied().unwrap_or(0.0)
    }
}

/// A relay-like law.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Relay {
    /// The slope at rest of what is solved for it.
    pub(crate) rest: f64,
    /// Whether the law comes to an end, as that of a diode without a leak: beyond, it has nothing for what it is asked.
    pub(crate) ends: bool,
}

/// The relay-like laws among those that loops are solved for, by loop.
pub(crate) fn relays(c: &Cluster, model: &mut Model, form: &Form) -> Vec<Option<Relay>> {
    if c.loops.len() > LARGEST {
        return vec![None; c.loops.len()];
    }
    let flat = c.flat_at_instant(&mut model.pool, form);
    let start = Start::of(c, model);
    let residuals = c.loop_residuals(&mut model.pool);
    // A curve has both sides of a switch, and needs no slope.
    let curves: Vec<bool> = c.loop_nodes().iter().map(|n| matches!(n.how, Output::Curve { .. })).collect();
    c.loops
        .iter()
        .zip(residuals)
        .zip(curves)
        .map(|((z, residual), curve)| {
            if curve {
                return None;
            }
            let whole = model.pool.substitute(residual, &flat);
            let laws = [true, false].map(|side| branch(&mut model.pool, whole, side, *z));
            let slopes = laws.map(|law| model.pool.derivative(law, *z));
            let landmarks = start.landmarks(&model.pool, &[whole], *z);
            falls(model, (laws, slopes), (*z, &landmarks), &start)
        })
        .collect()
}

/// Whether a cluster has a relay-like law, which may be asked for a value that it does not have.
pub(crate) fn has_relay(c: &Cluster, model: &mut Model, form: &Form) -> bool {
    relays(c, model, form).iter().any(Option::is_some) || opens(c, model, form) || leaks(c, model, form)
}

/// Where curves are looked at for their pieces, on both sides of 0.
const PLACES: [f64; 5] = [1e-3, 0.1, 0.999, 10.0, 1e6];

/// A piece of a curve.
pub(crate) struct Piece {
    /// A place on it.
    pub(crate) place: f64,
    /// How fast what the curve gives rises there, and what it is given.
    slopes: [f64; 2],
}

/// The pieces of a law with vertical and horizontal branches.
pub(crate) fn pieces(c: &Cluster, model: &mut Model, node: &Node) -> Vec<Piece> {
    let Output::Curve { parameter, out, residual, .. } = node.how else { return Vec::new() };
    let slopes = [out, residual].map(|e| model.pool.derivative(e, parameter));
    let start = c.start(model);
    let mut found: Vec<Piece> = Vec::new();
    for place in PLACES.iter().flat_map(|x| [*x, -*x]) {
        let at = FxHashMap::from_iter([(parameter, model.pool.float(place))]);
        let slopes = slopes.map(|e| {
            let e = model.pool.substitute(e, &at);
            start.eval(&model.pool, e)
        });
        let same = |other: &Piece| {
            slopes.iter().zip(other.slopes).all(|(x, y)| (x - y).abs() <= model.settings.thresholds.relay.end * x.abs())
        };
        if !found.iter().any(same) {
            found.push(Piece { place, slopes });
        }
    }
    found
}

/// Whether a curve of two pieces has a leak on one and is almost vertical on the other, as that of a diode. (Without a
/// leak it passes nothing at all.) With more diodes than a bridge has, longer steps suffer from the rounding of
/// conductances that are far apart.
fn leaks(c: &Cluster, model: &mut Model, form: &Form) -> bool {
    let bare: Vec<Node> = c.nodes.iter().filter(|n| n.has_branches()).cloned().collect();
    bare.len() <= BRIDGE
        && bare.iter().any(|n| {
            let effort = n.resistor().is_some_and(|column| form.column(column).gives == Variable::Effort);
            let pieces = pieces(c, model, n);
            let conductance = |p: &Piece| if effort { p.slopes[1] / p.slopes[0] } else { p.slopes[0] / p.slopes[1] };
            let sizes: Vec<f64> = pieces.iter().map(|p| conductance(p).abs()).collect();
            let (least, most) = extent(&sizes);
            pieces.len() == 2 && least > 0.0 && least < model.settings.thresholds.relay.slope * most
        })
}

/// Whether a law has a corner beyond which it is steeper by orders of magnitude, as that of a diode of two straight
/// pieces.
pub(crate) fn is_steeply_non_smooth(c: &Cluster, model: &mut Model, form: &Form) -> bool {
    let kinked = smoothness::laws(c).into_iter().any(|e| model.pool.any_node(e, &smoothness::is_kink));
    kinked && has_relay(c, model, form)
}

/// Whether a linear resistor is switched by the state of the cluster, as a contact by the current through a coil.
pub(crate) fn has_state_dependent_switch(c: &Cluster, model: &mut Model, form: &Form) -> bool {
    let flat = c.flat_at_instant(&mut model.pool, form);
    let own: FxHashSet<Symbol> = c.states.iter().map(|s| s.symbol).chain(c.loops.iter().copied()).collect();
    let is_linear = |column: ColumnId| match &model.element(form.column(column).element).law {
        Law::Resistor(law) => law.linear.is_some(),
        Law::Source(_) | Law::Storage(_) | Law::Ratio(_) | Law::Junction | Law::Port(_) | Law::Multiplier => false,
    };
    let linear = c.nodes.iter().filter(|n| n.resistor().is_some_and(is_linear));
    let laws: Vec<Expr> = linear.flat_map(|n| n.how.expressions()).collect();
    let laws: Vec<Expr> = laws.into_iter().map(|e| model.pool.substitute(e, &flat)).collect();
    let pool = &model.pool;
    let on_state = |n: &Part| matches!(n, Part::Select(test, ..) if pool.contains_any(*test, &|s| own.contains(&s)));
    laws.into_iter().any(|e| pool.any_node(e, &on_state))
}

/// A relay, where the mean slope from rest on falls, so that the law saturates, and slopes differ by orders of
/// magnitude; the choices made either way. A slope that only dips, as between two steep parts of a measured curve, is
/// no relay's.
fn falls(
    model: &Model,
    (laws, slopes): ([Expr; 2], [Expr; 2]),
    (z, landmarks): (Symbol, &Landmarks),
    start: &Start,
) -> Option<Relay> {
    let by = model.settings.thresholds.relay;
    let at = |x: f64| slopes.map(|slope| start.size(&model.pool, slope, (z, x)));
    let value = |x: f64| laws.map(|law| start.eval(&model.pool, law, (z, x)));
    let near = landmarks.within();
    let rest = [at(near), at(-near)].as_flattened().iter().copied().fold(0.0, f64::max);
    if !(rest > 0.0 && rest.is_finite()) {
        return None;
    }
    let points = landmarks.points();
    let beside = [value(-near), value(near)];
    let mean = |x: &f64| {
        let from = if *x < 0.0 { -near } else { near };
        let [a, b] = [value(*x), beside[usize::from(*x >= 0.0)]];
        [0, 1].map(|side| ((a[side] - b[side]) / (x - from)).abs())
    };
    let means: Vec<[f64; 2]> = points.iter().map(mean).collect();
    let all: Vec<[f64; 2]> = points.iter().copied().chain([near, -near]).map(at).collect();
    let (least, most) = extent(all.as_flattened());
    let saturates = extent(means.as_flattened()).0 < by.held * rest;
    (saturates && least < by.slope * most).then_some(Relay { rest, ends: least < by.end * rest })
}

/// The least and the most of some sizes.
fn extent(sizes: &[f64]) -> (f64, f64) {
    sizes.iter().fold((f64::INFINITY, 0.0), |(least, most): (f64, f64), x| (least.min(*x), most.max(*x)))
}

/// Whether what a resistor gives for a state changes by orders of magnitude, as that of a contact that opens, or of a
/// diode that is given as a conductance.
fn opens(c: &Cluster, model: &mut Model, form: &Form) -> bool {
    let flat = c.flat_at_instant(&mut model.pool, form);
    let start = Start::of(c, model);
    let laws: Vec<Expr> = c
        .nodes
        .iter()
        .filter(|n| n.resistor().is_some() && matches!(n.how, Output::Explicit(_)))
        .filter_map(|n| flat.get(&n.out).copied())
        .filter(|e| model.pool.any_node(*e, &|n| matches!(n, Part::Select(..))))
        .collect();
    laws.into_iter().any(|law| {
        c.states.iter().any(|s| {
            let slopes = [true, false].map(|side| {
                let one = branch(&mut model.pool, law, side, s.symbol);
                model.pool.derivative(one, s.symbol)
            });
            let at = |x: f64| slopes.map(|slope| start.size(&model.pool, slope, (s.symbol, x)));
            let landmarks = start.landmarks(&model.pool, &[law], s.symbol);
            let jumps = |[left, right]: [f64; 2]| {
                let (least, most) = extent(&[left, right]);
                least < model.settings.thresholds.relay.slope * most && most.is_finite() && least > 0.0
            };
            landmarks.beside_breaks().into_iter().any(|sides| {
                let [left, right] = sides.map(at);
                (0..2).any(|choice| jumps([left[choice], right[choice]]))
            })
        })
    })
}

/// The larger size of what an expression is with its choices made either way.
pub(crate) fn steepest(pool: &mut Pool, e: Expr, z: Symbol) -> Expr {
    let [a, b] = [true, false].map(|side| {
        let one = branch(pool, e, side, z);
        pool.unary(Unary::Abs, one)
    });
    pool.binary(Binary::Max, a, b)
}

/// An expression with each choice that does not depend on a symbol made: the first branch of all, or the second.
fn branch(pool: &mut Pool, e: Expr, first: bool, z: Symbol) -> Expr {
    let (mut seen, mut stack, mut nodes) = (FxHashSet::default(), vec![e], Vec::new());
    while let Some(e) = stack.pop() {
        if seen.insert(e) {
            nodes.push(e);
            pool.node(e).each_child(&mut |child| stack.push(child));
        }
    }
    // The whole is younger than its parts.
    nodes.sort_unstable();
    let mut new: FxHashMap<Expr, Expr> = FxHashMap::default();
    for n in nodes {
        let of = |child: Expr| new.get(&child).copied().unwrap_or(child);
        let made = match *pool.node(n) {
            Part::Select(test, a, b) if !pool.contains_any(test, &|s| s == z) => of(if first { a } else { b }),
            _ => pool.rebuild(n, &of),
        };
        new.insert(n, made);
    }
    new.get(&e).copied().unwrap_or(e)
}
