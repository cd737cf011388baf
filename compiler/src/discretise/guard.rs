//! Guards: where laws switch, as functions that are 0 there.

use super::choice;
use super::cluster::{Cluster, State, missing, verified};
use super::write;
use crate::expression::{Expr, Lowering, Node, Number, Pool, Symbol};
use crate::model::Model;
use crate::structure::Form;
use bond_grammar::diagnostic::Diagnostic;
use bond_runtime::ir::{Array, Binary, Builder, Unary};
use bond_runtime::scene::Guards;
use rustc_hash::FxHashSet;

/// Laws that switch on what so many loops tell at most are watched.
const LOOPS: usize = 16;
/// Where the turn of a `tanh` ends, in its argument: 2e-7 are missing to 1 there.
const KNEE: f64 = 8.0;
/// So many times twice the turns of a state are looked at, beside each of them.
const DOUBLINGS: usize = 8;

/// 0 at each whole number: sin(pi a), by what is left of two of them, which keeps the digits of a large one. It is above 0
/// from an even one on, and 0 itself at an odd one.
fn turns(pool: &mut Pool, a: Expr) -> Expr {
    let (half, one, turn) = (pool.scale(a, Number::HALF), pool.int(1), pool.float(-std::f64::consts::PI));
    let pairs = pool.unary(Unary::Floor, half);
    let rest = pool.combine(&[(a, Number::ONE), (pairs, Number::from(-2)), (one, Number::MINUS_ONE)]);
    let angle = pool.mul(turn, rest);
    pool.unary(Unary::Sin, angle)
}

/// What switches, each with its guard by index.
pub(super) type Switches = Vec<(Expr, usize)>;

/// Writes the guards of a cluster's laws and integrands, and tells what switches on them; `None` where none switches on
/// something that states, time and loops tell, and that moves within a step. What is given from outside may be `held`
/// over each.
pub(super) fn guards(
    c: &Cluster,
    model: &mut Model,
    form: &Form,
    held: bool,
) -> Result<Option<(Guards, Switches)>, Vec<Diagnostic>> {
    let map = c.at_instant(&mut model.pool, form);
    let mut roots: Vec<Expr> = map.values().copied().collect();
    let flat = c.flat(&mut model.pool, map);
    let residuals: Vec<Expr> =
        c.loop_residuals(&mut model.pool).into_iter().map(|r| model.pool.substitute(r, &flat)).collect();
    roots.extend(flat.values().chain(&residuals).copied());
    // What storages are given is a sum of all that, with ratios of transformers and gyrators in it, which may switch too.
    let ratio = |s: &&State| s.column.is_none() || model.pool.any_node(s.rate, &choice::is_kink);
    let rates: Vec<Expr> = c.states.iter().filter(ratio).map(|s| s.rate).collect();
    for rate in rates.into_iter().chain(c.integrals.iter().map(|i| i.rate)) {
        roots.push(model.pool.substitute(rate, &flat));
    }
    roots.sort_unstable();
    let mut seen: FxHashSet<Expr> = FxHashSet::default();
    let mut found: Vec<Expr> = Vec::new();
    let mut switches: Vec<(Expr, Expr)> = Vec::new();
    let inputs = c.inputs.iter().map(|i| i.1);
    let mut told: FxHashSet<Symbol> = c.states.iter().map(|s| s.symbol).chain(inputs.clone()).chain(c.time).collect();
    // Signals of samples stay until the next one, where a step ends in any case.
    told.extend(&c.foreign);
    let still: FxHashSet<Symbol> = c.foreign.iter().copied().chain(inputs.filter(|_| held)).collect();
    let loops: &[Symbol] = if c.loops.len() <= LOOPS { &c.loops } else { &[] };
    told.extend(loops);
    while let Some(e) = roots.pop() {
        if !seen.insert(e) {
            continue;
        }
        let node = model.pool.node(e).clone();
        // x |x| has a slope everywhere. Of a flow that a loop tells, and that comes to rest, rounding makes the sign.
        let even = |child: Expr| match (&node, model.pool.node(child)) {
            (Node::Product(_, factors), Node::Unary(Unary::Abs, x)) => {
                let is_in = |e: Expr| factors.iter().any(|f| f.0 == e && f.1.integer().is_some_and(|n| n > 0));
                is_in(*x) && is_in(child) && model.pool.contains_any(*x, &|s| loops.contains(&s))
            }
            _ => false,
        };
        node.each_child(&mut |child| {
            if !even(child) {
                roots.push(child);
            }
        });
        let mut more = Vec::new();
        let bends = matches!(node, Node::Unary(Unary::Tanh | Unary::Atan, _) | Node::Binary(Binary::Atan2, ..));
        let guard = match node {
            Node::Binary(Binary::Lt | Binary::Le | Binary::Min | Binary::Max, a, b) => model.pool.sub(a, b),
            // It jumps by 2 pi where y passes 0 below x = 0: where this does, and does not elsewhere but for y < 0.
            Node::Binary(Binary::Atan2, y, x) => model.pool.binary(Binary::Max, y, x),
            // This and `atan` may be switches but for a little, as friction is often written: what a step over such a
            // turn misses, neither it nor its halves see. So a step ends where this one's does, too.
            Node::Unary(Unary::Tanh, a) => {
                let square = model.pool.mul(a, a);
                let end = model.pool.float(KNEE * KNEE);
                more.push(model.pool.sub(square, end));
                a
            }
            Node::Unary(Unary::Abs | Unary::Sign | Unary::Atan, a) => a,
            Node::Unary(Unary::Floor, mut a) => {
                let guard = turns(&mut model.pool, a);
                // Of a state a step may pass so many that as many lie on both sides: one of every second, fourth, ... of
                // them it then passes alone.
                let moves = c.states.iter().any(|s| model.pool.contains(a, s.symbol));
                for _ in 0..if moves { DOUBLINGS } else { 0 } {
                    a = model.pool.scale(a, Number::HALF);
                    more.push(turns(&mut model.pool, a));
                }
                guard
            }
            Node::Binary(..)
            | Node::Unary(..)
            | Node::Number(_)
            | Node::Symbol(_)
            | Node::Sum(..)
            | Node::Product(..) => continue,
            Node::Power(..) | Node::Select(..) => continue,
        };
        let symbols = model.pool.symbols(guard);
        let moves = symbols.iter().any(|s| !still.contains(s));
        if moves && symbols.iter().all(|s| told.contains(s)) {
            found.push(guard);
            found.extend(more);
            if !bends {
                switches.push((e, guard));
            }
        }
    }
    if found.is_empty() {
        return Ok(None);
    }
    found.sort_unstable();
    found.dedup();
    let mut b = Builder::new(c.title(form, "guards"));
    let inputs = write::inputs(&mut b, c, form, model);
    let mut lowering = Lowering::new(inputs.env.iter().copied());
    let count = found.len();
    let mut list: Vec<(String, Expr)> = found.iter().map(|g| (model.pool.print(*g), *g)).collect();
    let wide = found.iter().any(|g| model.pool.contains_any(*g, &|s| loops.contains(&s)));
    if wide {
        for (z, guess) in loops.iter().zip(&inputs.guesses) {
            lowering.bind(*z, *guess);
        }
        let names: Vec<String> = loops.iter().map(|z| model.pool.name(*z).to_string()).collect();
        list.extend(names.iter().zip(&residuals).map(|(z, r)| (format!("residual of {z}"), *r)));
        for (what, e) in names.iter().zip(&residuals).map(|(z, r)| (z.clone(), *r)).chain(list[..count].to_vec()) {
            let slopes = model.pool.derivatives(e, loops);
            list.extend(names.iter().zip(slopes).map(|(z, d)| (format!("d {what} / d {z}"), d)));
        }
    }
    for (name, e) in list {
        let v = lowering.lower(&model.pool, &mut b, e).map_err(|s| missing(model, s))?;
        let slot = b.named(Array::Output, name);
        b.store(slot, v);
    }
    let at = |(e, guard): (Expr, Expr)| Some((e, found.binary_search(&guard).ok()?));
    let switches = switches.into_iter().filter_map(at).collect();
    let loops = if wide { loops.len() } else { 0 };
    let is_floor = |n: &Node| matches!(n, Node::Unary(Unary::Floor, _));
    let jumps = found.iter().any(|e| model.pool.any_node(*e, &is_floor));
    let alone = |e: &Expr| model.pool.symbols(*e).iter().all(|s| Some(*s) == c.time);
    let times = (0..count).filter(|k| alone(&found[*k])).collect();
    let program = verified(model, b.finish())?;
    Ok(Some((Guards { program, count, loops, times, ends: false, branch: None, jumps }, switches)))
}
