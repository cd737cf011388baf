//! Outputs of resistors: the law as it is written where causality goes its way, inverted where it is linear, else the
//! root of a residual. A port of a field reads the variables of the others.

use super::resolve::Resolver;
use super::{Bends, ColumnId, Form, OPTIONS, Output, Row, inverse};
use crate::expression::{Expr, Growth, Node, Number, Pool, Sign, Symbol, growth};
use crate::model::{ElementId, Law, Resistor, Variable};
use bond_grammar::diagnostic::Diagnostic;
use bond_runtime::ir::Unary;
use nalgebra::DMatrix;
use rustc_hash::{FxHashMap, FxHashSet};

/// A resistor's output, and its coefficients where it is linear.
pub(super) struct Found {
    pub(super) how: Output,
    pub(super) gain: Option<Row>,
    /// See [`super::Region::steep`].
    pub(super) steep: Option<Output>,
    /// See [`super::Region::leaky`].
    pub(super) leaky: Option<Output>,
    /// See [`super::Region::laws`].
    pub(super) law: Option<(Symbol, Expr)>,
}

impl Found {
    fn plain(how: Output) -> Self {
        Self { how, gain: None, steep: None, leaky: None, law: None }
    }
}

fn law_of<'m>(r: &'m Resolver<'_>, id: ElementId) -> Option<&'m Resistor> {
    match &r.model.element(id).law {
        Law::Resistor(law) => Some(law),
        Law::Source(_) | Law::Storage(_) | Law::Ratio(_) | Law::Junction | Law::Port(_) | Law::Multiplier => None,
    }
}

/// How the output of a resistor's column is had.
pub(super) fn output(r: &mut Resolver<'_>, form: &Form, id: ColumnId) -> Result<Option<Found>, Diagnostic> {
    let c = form.column(id);
    let span = r.model.element(c.element).span;
    let Some(law) = law_of(r, c.element).cloned() else { return Ok(None) };
    // The columns of the field, or this one alone.
    let members: Vec<ColumnId> = match r.model.element(c.element).field {
        Some((f, _)) => r.model.fields[f].members.iter().filter_map(|m| form.column_of_element[m.at()]).collect(),
        None => vec![id],
    };
    let mut inputs: Vec<Expr> = Vec::new();
    for m in &members {
        let row = r.row(&form.column(*m).row);
        inputs.push(r.resolve(row, Some(c.region), span)?);
    }
    let place = members.iter().position(|m| *m == id).unwrap_or(0);
    let forward = |r: &Resolver<'_>, m: ColumnId| {
        law_of(r, form.column(m).element).is_some_and(|l| l.gives == form.column(m).gives)
    };
    // A linear field: its matrix, inverted in the ports that causality runs backwards.
    if let Some(rows) = rows(r, form, &members, (c.region, span))? {
        let flipped: Vec<usize> = (0..members.len()).filter(|i| !forward(r, members[*i])).collect();
        if is_singular(&r.model.pool, &rows, &flipped) {
            let names: Vec<String> = flipped.iter().map(|i| format!("`{}`", form.column(members[*i]).name)).collect();
            return Err(Diagnostic::error(
                "structure::singular",
                span,
                format!("the outputs of {} do not follow from their inputs: the matrix is singular", names.join(", ")),
            )
            .help(
                "impose the variable that its matrix multiplies, as an I does for flows and a C for efforts; or \
            give the inverse matrix",
            ));
        }
        if let Some(hybrid) = hybrid(r, rows, &flipped) {
            let pool = &mut r.model.pool;
            let terms: Vec<Expr> = hybrid[place].iter().zip(&inputs).map(|(k, x)| pool.mul(*k, *x)).collect();
            let mut gain: Row = members.iter().copied().zip(hybrid[place].iter().copied()).collect();
            gain.retain(|t| !pool.is_zero(t.1));
            gain.sort_unstable_by_key(|t| t.0);
            return Ok(Some(Found { gain: Some(gain), ..Found::plain(Output::Explicit(pool.sum(&terms))) }));
        }
    }
    if let Some(curve) = law.curve {
        let effort = r.resolve(curve.effort, Some(c.region), span)?;
        let flow = r.resolve(curve.flow, Some(c.region), span)?;
        return Ok(Some(on_curve(r, c.gives, curve.parameter, (effort, flow), inputs[place])));
    }
    if let (None, Some(k)) = (r.model.element(c.element).field, law.linear) {
        let k = r.resolve(k, Some(c.region), span)?;
        let pool = &mut r.model.pool;
        if law.gives == c.gives {
            let how = Output::Explicit(pool.mul(k, inputs[0]));
            return Ok(Some(Found { gain: Some(vec![(id, k)]), ..Found::plain(how) }));
        }
        // One that may pass 0 is solved for; so is one that changes smoothly, which has digits of its own so.
        if pool.constant(k).is_some() || pool.is_switched(k) {
            let one = pool.int(1);
            let gain = Some(vec![(id, pool.div(one, k))]);
            let how = Output::Explicit(pool.div(inputs[0], k));
            return Ok(Some(Found { gain, ..Found::plain(how) }));
        }
    }
    // What the law's arguments are: inputs where causality goes its way, outputs where it does not.
    let mut arguments: FxHashMap<Symbol, Expr> = FxHashMap::default();
    for (m, input) in members.iter().zip(&inputs) {
        let Some(other) = law_of(r, form.column(*m).element).cloned() else { continue };
        let value = if forward(r, *m) { *input } else { r.model.pool.var(form.column(*m).out) };
        arguments.insert(other.argument, value);
    }
    let law_output = r.resolve(law.output, Some(c.region), span)?;
    let value = r.model.pool.substitute(law_output, &arguments);
    let own = (members.len() == 1).then_some((law.argument, law_output));
    // A bell, as Stribeck's, does not grow, unless it is divided by.
    let pool = &r.model.pool;
    let is_exp = |n: &Node| matches!(n, Node::Unary(Unary::Exp, _));
    let divides = |f: &(Expr, Number)| f.1.to_f64() < 0.0 && pool.any_node(f.0, &is_exp);
    let rises = |e: Expr| !pool.sign(e, &|_| Sign::Unknown).is_nonpositive();
    let grows = |n: &Node| match n {
        Node::Unary(f, e) => match growth(*f) {
            Growth::Bounded | Growth::Algebraic => false,
            Growth::Exponential => rises(*e),
            Growth::ExponentialBothWays => true,
        },
        Node::Product(_, factors) => factors.iter().any(divides),
        _ => matches!(n, Node::Power(..)),
    };
    let is_steep = members.len() == 1
        && r.model.pool.any_node(law.output, &grows)
        && !levels_off(&mut r.model.pool, law_output, law.argument);
    if law.gives != c.gives {
        // The law gives the input; its root is sought.
        let bends = is_steep.then(|| bends(&mut r.model.pool, law_output, law.argument));
        let how = Output::Implicit { residual: r.model.pool.sub(value, inputs[place]), bends };
        return Ok(Some(Found { law: own, ..Found::plain(how) }));
    }
    let mut found = Found { law: own, ..Found::plain(Output::Explicit(value)) };
    if is_steep {
        // It has an exponential in it, as that of a junction diode.
        let pool = &mut r.model.pool;
        let x = pool.var(law.argument);
        // The slope where an iteration starts says nothing of the slope where it ends: the argument counts by itself.
        let (residual, weight) = (pool.sub(x, inputs[0]), pool.int(0));
        let bends = Some(bends(pool, law_output, law.argument));
        found.steep = Some(Output::Curve { parameter: law.argument, out: law_output, residual, weight, bends });
    }
    Ok(Some(found))
}

/// The output of a resistor on a curve, from effort and flow in the curve's parameter.
fn on_curve(
    r: &mut Resolver<'_>,
    gives: Variable,
    parameter: Symbol,
    (effort, flow): (Expr, Expr),
    input: Expr,
) -> Found {
    let (out, other) = if gives == Variable::Effort { (effort, flow) } else { (flow, effort) };
    let (along, across) = (steepness(r, out, parameter), steepness(r, other, parameter));
    let pool = &mut r.model.pool;
    let off = pool.sub(other, input);
    let residual = pool.div(off, across);
    let weight = pool.mul(along, across);
    let curve = |out, residual| Output::Curve { parameter, out, residual, weight, bends: None };
    let leak = pool.float(OPTIONS.leak);
    let leaky = if gives == Variable::Effort {
        let part = pool.div(leak, along);
        let more = pool.mul(part, out);
        curve(out, pool.add(residual, more))
    } else {
        let part = pool.mul(leak, along);
        let part = pool.div(part, across);
        let more = pool.mul(part, other);
        curve(pool.add(out, more), residual)
    };
    Found { leaky: Some(leaky), ..Found::plain(curve(out, residual)) }
}

/// Whether a law comes to a level where its exponentials grow, as a logistic does: then nothing in it is steep for
/// long.
fn levels_off(pool: &mut Pool, law: Expr, argument: Symbol) -> bool {
    let bends = bends(pool, law, argument);
    let at = |x: f64| pool.eval(law, &|s| if s == argument { x } else { f64::NAN }).abs();
    let sides: Vec<(f64, f64)> = bends.above.into_iter().chain(bends.below).collect();
    !sides.is_empty() && sides.iter().all(|(knee, rate)| at(knee + 60.0 / rate) <= 2.0 * at(knee + 30.0 / rate))
}

/// Where the exponentials of a law grow, of those whose exponents are linear in its argument: the fastest to each side.
fn bends(pool: &mut Pool, law: Expr, argument: Symbol) -> Bends {
    let mut found = Bends::default();
    let (mut seen, mut stack) = (FxHashSet::default(), vec![law]);
    while let Some(e) = stack.pop() {
        if !seen.insert(e) {
            continue;
        }
        let node = pool.node(e).clone();
        node.each_child(&mut |c| stack.push(c));
        let Node::Unary(f, exponent) = node else { continue };
        let both = match growth(f) {
            Growth::Bounded | Growth::Algebraic => continue,
            Growth::Exponential => false,
            Growth::ExponentialBothWays => true,
        };
        let Some((slope, rest)) = pool.linear(exponent, argument) else { continue };
        let (Some(slope), Some(rest)) = (pool.constant(slope), pool.constant(rest)) else { continue };
        let knee = -rest / slope;
        if !knee.is_finite() || !slope.is_finite() || slope == 0.0 {
            continue;
        }
        for rate in if both { vec![slope.abs(), -slope.abs()] } else { vec![slope] } {
            let one = Some((knee, rate));
            let (above, below) = if rate > 0.0 { (one, None) } else { (None, one) };
            found = found.with(Bends { above, below });
        }
    }
    found
}

/// How fast a variable rises along a curve, where it does: the sum of its slopes at some places.
fn steepness(r: &mut Resolver<'_>, e: Expr, parameter: Symbol) -> Expr {
    let pool = &mut r.model.pool;
    let slope = pool.derivative(e, parameter);
    let mut terms = Vec::new();
    for at in [0.5, -0.5, 2.0, -2.0, 1e3, -1e3] {
        let at = pool.float(at);
        let map: FxHashMap<Symbol, Expr> = std::iter::once((parameter, at)).collect();
        let k = pool.substitute(slope, &map);
        terms.push(pool.unary(Unary::Abs, k));
    }
    pool.sum(&terms)
}

/// The matrix of a linear field, resolved.
fn rows(
    r: &mut Resolver<'_>,
    form: &Form,
    members: &[ColumnId],
    (region, span): (crate::graph::RegionId, bond_grammar::source::Span),
) -> Result<Option<Vec<Vec<Expr>>>, Diagnostic> {
    let mut list = Vec::new();
    for m in members {
        let Some(row) = law_of(r, form.column(*m).element).and_then(|l| l.row.clone()) else { return Ok(None) };
        let row = row.into_iter().map(|e| r.resolve(e, Some(region), span)).collect::<Result<Vec<_>, _>>()?;
        list.push(row);
    }
    Ok(Some(list))
}

/// Whether a matrix of numbers cannot be inverted in some of its rows and columns, up to rounding.
fn is_singular(pool: &Pool, k: &[Vec<Expr>], flipped: &[usize]) -> bool {
    let n = flipped.len();
    let number = |i: usize, j: usize| pool.constant(k[flipped[i]][flipped[j]]);
    if n == 0 || !(0..n).all(|i| (0..n).all(|j| number(i, j).is_some())) {
        return false;
    }
    let mut a = DMatrix::from_fn(n, n, |i, j| number(i, j).unwrap_or(f64::NAN));
    // Ports are of different units: rows and columns are scaled to 1.
    for mut row in a.row_iter_mut() {
        let size = row.amax();
        row.apply(|x| *x /= size);
    }
    for mut column in a.column_iter_mut() {
        let size = column.amax();
        column.apply(|x| *x /= size);
    }
    if a.iter().any(|x| !x.is_finite()) {
        return true;
    }
    let values = a.singular_values();
    values.min() <= 1e-14 * values.max()
}

/// y = K x solved for (y of the ports as they are, x of the flipped ones): the partial inverse.
fn hybrid(r: &mut Resolver<'_>, k: Vec<Vec<Expr>>, flipped: &[usize]) -> Option<Vec<Vec<Expr>>> {
    if flipped.is_empty() {
        return Some(k);
    }
    let pool = &mut r.model.pool;
    let n = k.len();
    let block: Vec<Vec<Expr>> = flipped.iter().map(|i| flipped.iter().map(|j| k[*i][*j]).collect()).collect();
    // One that changes may pass 0.
    if block.iter().flatten().any(|e| pool.constant(*e).is_none()) {
        return None;
    }
    let inv = inverse(pool, &block)?;
    let zero = pool.int(0);
    let mut h = vec![vec![zero; n]; n];
    // x_b = inv (y_b - K_ba x_a)
    for (p, &i) in flipped.iter().enumerate() {
        for (q, &j) in flipped.iter().enumerate() {
            h[i][j] = inv[p][q];
        }
        for j in (0..n).filter(|j| !flipped.contains(j)) {
            let terms: Vec<Expr> = flipped.iter().enumerate().map(|(q, b)| pool.mul(inv[p][q], k[*b][j])).collect();
            let sum = pool.sum(&terms);
            h[i][j] = pool.neg(sum);
        }
    }
    // y_a = K_aa x_a + K_ab x_b
    for i in (0..n).filter(|i| !flipped.contains(i)) {
        for j in 0..n {
            let mut terms: Vec<Expr> = flipped.iter().map(|b| pool.mul(k[i][*b], h[*b][j])).collect();
            if !flipped.contains(&j) {
                terms.push(k[i][j]);
            }
            h[i][j] = pool.sum(&terms);
        }
    }
    Some(h)
}
