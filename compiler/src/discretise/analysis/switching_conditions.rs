//! Where the laws of a cluster switch: functions that are 0 there.

use crate::discretise::analysis::smoothness;
use crate::discretise::cluster::{Cluster, State};
use crate::expression::{Expr, Node, Number, Pool, Symbol};
use crate::model::Model;
use crate::structure::Form;
use bond_runtime::ir::{Binary, Unary};
use rustc_hash::FxHashSet;

/// Laws that switch on what more loops determine are not watched.
const LOOPS: usize = 16;
/// Where the turn of a `tanh` ends, in its argument: 2e-7 are missing to 1 there.
const KNEE: f64 = 8.0;
/// Besides each turn of a state, every second, fourth, ... of them is a guard, up to this power of 2.
const DOUBLINGS: usize = 8;

/// What switches in a cluster.
pub(crate) struct Conditions {
    /// Functions that are 0 where something switches, each once, sorted.
    pub(crate) guards: Vec<Expr>,
    /// Expressions that are one thing or another, each with its guard.
    pub(crate) switches: Vec<(Expr, Expr)>,
    /// The loops that guards may depend on, and their residuals.
    pub(crate) loops: Vec<Symbol>,
    pub(crate) residuals: Vec<Expr>,
}

/// The guards of an expression that switches.
#[derive(Default)]
struct Guards {
    /// The guard itself.
    guard: Option<Expr>,
    /// Others, which end a step besides.
    more: Vec<Expr>,
    /// Whether the expression turns steeply, and is the same function on both sides.
    bends: bool,
}

/// Finds what switches in a cluster's laws and integrands; `None` where nothing switches on something that states, time
/// and loops determine, and that moves within a step. Inputs may be `held` over each step.
pub(crate) fn find(c: &Cluster, model: &mut Model, form: &Form, held: bool) -> Option<Conditions> {
    let map = c.at_instant(&mut model.pool, form);
    let mut roots: Vec<Expr> = map.values().copied().collect();
    let mut flat = c.flat(&mut model.pool, map);
    let mut residuals: Vec<Expr> = c.residuals_in(&mut model.pool, &flat);
    roots.extend(flat.values().chain(&residuals).copied());
    let speeds = c.constraints_at_instant(model, form, &mut flat, &mut residuals).ok()?;
    // What speeds without inertia switch is not looked for.
    if !speeds.now.is_empty() {
        return None;
    }
    // What storages are given is a sum of all that, with ratios of transformers and gyrators in it, which may switch
    // too.
    let ratio = |s: &&State| s.column.is_none() || model.pool.any_node(s.rate, &smoothness::is_kink);
    let rates: Vec<Expr> = c.states.iter().filter(ratio).map(|s| s.rate).collect();
    // What is delayed arrives as it is.
    for rate in rates.into_iter().chain(c.integrals.iter().map(|i| i.rate)).chain(c.carried()) {
        roots.push(model.pool.substitute(rate, &flat));
    }
    roots.sort_unstable();
    let inputs = c.inputs.iter().map(|i| i.1);
    let mut known: FxHashSet<Symbol> = c.states.iter().map(|s| s.symbol).chain(inputs.clone()).chain(c.time).collect();
    // Signals of samples stay until the next one, where a step ends in any case.
    known.extend(&c.foreign);
    known.extend(c.lines.iter().flat_map(|line| &line.coefficients));
    let still: FxHashSet<Symbol> = c.foreign.iter().copied().chain(inputs.filter(|_| held)).collect();
    let loops = if c.loops.len() <= LOOPS { c.loops.clone() } else { Vec::new() };
    known.extend(&loops);
    let mut seen: FxHashSet<Expr> = FxHashSet::default();
    let (mut guards, mut switches) = (Vec::new(), Vec::new());
    while let Some(e) = roots.pop() {
        if !seen.insert(e) {
            continue;
        }
        roots.extend(children(&model.pool, e, &loops));
        let Guards { guard: Some(guard), more, bends } = guards_of(c, &mut model.pool, e) else { continue };
        let symbols = model.pool.symbols(guard);
        let moves = symbols.iter().any(|s| !still.contains(s));
        if moves && symbols.iter().all(|s| known.contains(s)) {
            guards.push(guard);
            guards.extend(more);
            if !bends {
                switches.push((e, guard));
            }
        }
    }
    guards.sort_unstable();
    guards.dedup();
    (!guards.is_empty()).then_some(Conditions { guards, switches, loops, residuals })
}

/// The parts of an expression that are looked at in turn. x |x| has a slope everywhere: rounding makes the sign of a
/// flow that a loop determines, and that comes to rest.
fn children(pool: &Pool, e: Expr, loops: &[Symbol]) -> Vec<Expr> {
    let node = pool.node(e);
    let even = |child: Expr| match (node, pool.node(child)) {
        (Node::Product(_, factors), Node::Unary(Unary::Abs, x)) => {
            let is_in = |e: Expr| factors.iter().any(|f| f.0 == e && f.1.integer().is_some_and(|n| n > 0));
            is_in(*x) && is_in(child) && pool.contains_any(*x, &|s| loops.contains(&s))
        }
        _ => false,
    };
    let mut list = Vec::new();
    node.each_child(&mut |child| {
        if !even(child) {
            list.push(child);
        }
    });
    list
}

/// The guards of an expression; none where it does not switch itself.
fn guards_of(c: &Cluster, pool: &mut Pool, e: Expr) -> Guards {
    let of = |guard: Expr| Guards { guard: Some(guard), ..Guards::default() };
    match pool.node(e).clone() {
        Node::Binary(Binary::Lt | Binary::Le | Binary::Min | Binary::Max, a, b) => of(pool.sub(a, b)),
        // It jumps by 2 pi where y passes 0 below x = 0: where this does, and does not elsewhere but for y < 0.
        Node::Binary(Binary::Atan2, y, x) => Guards { bends: true, ..of(pool.binary(Binary::Max, y, x)) },
        // This and `atan` may all but jump, as friction is often written: what a step over such a turn misses, neither
        // it nor its halves see. So a step ends where the turn of `tanh` ends, too.
        Node::Unary(Unary::Tanh, a) => {
            let square = pool.mul(a, a);
            let end = pool.float(KNEE * KNEE);
            Guards { guard: Some(a), more: vec![pool.sub(square, end)], bends: true }
        }
        Node::Unary(Unary::Atan, a) => Guards { bends: true, ..of(a) },
        Node::Unary(Unary::Abs | Unary::Sign, a) => of(a),
        Node::Unary(Unary::Floor, mut a) => {
            let guard = whole_number_guard(pool, a);
            // A step may pass so many turns of a state that as many lie on both sides: one of every second, fourth, ...
            // of them it then passes alone.
            let moves = c.states.iter().any(|s| pool.contains(a, s.symbol));
            let mut more = Vec::new();
            for _ in 0..if moves { DOUBLINGS } else { 0 } {
                a = pool.scale(a, Number::HALF);
                more.push(whole_number_guard(pool, a));
            }
            Guards { guard: Some(guard), more, bends: false }
        }
        Node::Binary(..)
        | Node::Unary(..)
        | Node::Number(_)
        | Node::Symbol(_)
        | Node::Sum(..)
        | Node::Product(..)
        | Node::Power(..)
        | Node::Select(..) => Guards::default(),
    }
}

/// 0 at each whole number: sin(pi a), by what is left of two of them, which keeps the digits of a large one. It is
/// above 0 from an even one on, and 0 itself at an odd one.
fn whole_number_guard(pool: &mut Pool, a: Expr) -> Expr {
    let (half, one, turn) = (pool.scale(a, Number::HALF), pool.int(1), pool.float(-std::f64::consts::PI));
    let pairs = pool.unary(Unary::Floor, half);
    let rest = pool.combine(&[(a, Number::ONE), (pairs, Number::from(-2)), (one, Number::MINUS_ONE)]);
    let angle = pool.mul(turn, rest);
    pool.unary(Unary::Sin, angle)
}
