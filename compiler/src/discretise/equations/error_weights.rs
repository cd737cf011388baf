//! What an iteration measures its unknowns against: weights, as energy per square of an unknown, and scales, the sizes
//! that rounding makes a state or a loop uncertain by some parts in 1e16 of.

use crate::discretise::analysis::at_start::AtStart;
use crate::discretise::analysis::curvature::curvatures;
use crate::discretise::analysis::relay;
use crate::discretise::cluster::{Cluster, Node, missing, own_gain};
use crate::expression::{self, Expr, Lowering, Pool, Symbol};
use crate::model::{Law, Model};
use crate::structure::{ColumnId, Form, Output};
use bond_grammar::diagnostic::Diagnostic;
use bond_runtime::ir::{Binary, Builder, Slot, Unary, Value};
use rustc_hash::FxHashMap;

/// Energy per square of each loop's unknown, in terms of states and loops: h over the slope of its resistor's law; for
/// a law that is run backwards, h times it.
fn loop_weights(c: &Cluster, model: &mut Model, form: &Form, h: Expr) -> Vec<Expr> {
    if c.loops.is_empty() {
        return Vec::new();
    }
    let flat = c.flat_at_instant(&mut model.pool, form);
    let mut list = Vec::new();
    for node in c.loop_nodes() {
        if let Output::Curve { weight, .. } = node.how {
            let weight = model.pool.substitute(weight, &flat);
            list.push(model.pool.mul(h, weight));
            continue;
        }
        let Some((mut slope, forward)) = slope(model, form, &flat, node) else {
            list.push(model.pool.int(0));
            continue;
        };
        // Far below an exponential's knee its slope says nothing of what the unknown may come to cost.
        if let Some(least) = slope_at_knee(model, form, node) {
            let size = model.pool.unary(Unary::Abs, slope);
            let least = model.pool.float(least);
            slope = model.pool.binary(Binary::Max, size, least);
        }
        let w = if forward { model.pool.div(h, slope) } else { model.pool.mul(h, slope) };
        list.push(model.pool.unary(Unary::Abs, w));
    }
    list
}

/// Whether a column is a resistor whose law is not linear: what that gives at one end of a step says nothing of the
/// step.
fn is_steep(model: &Model, form: &Form, column: ColumnId) -> bool {
    matches!(&model.element(form.column(column).element).law, Law::Resistor(r) if r.linear.is_none() && r.row.is_none())
}

/// Sum of the magnitudes of the terms of a column's input, in terms of states and loops. What a resistor gives counts
/// by the terms that it is made of in turn: where a source is balanced by a storage nothing flows, and what is left of
/// the flow is the rounding of the two.
pub(crate) fn terms(model: &mut Model, form: &Form, flat: &FxHashMap<Symbol, Expr>, column: ColumnId) -> Expr {
    let mut list = Vec::new();
    for &(j, k) in &form.column(column).row {
        if is_steep(model, form, j) {
            continue;
        }
        let deep = if let Law::Resistor(_) = model.element(form.column(j).element).law { DEEP } else { 0 };
        let pool = &mut model.pool;
        let z = pool.var(form.column(j).out);
        let (k, z) = (pool.substitute(k, flat), pool.substitute(z, flat));
        let (k, z) = (pool.unary(Unary::Abs, k), magnitude(pool, z, deep));
        list.push(pool.mul(k, z));
    }
    model.pool.sum(&list)
}

/// How much less a change of a state over `h` is uncertain than the terms that it is the sum of, where steps are long:
/// what rounds them is pulled back by resistors, and turned by the storages that it goes to and comes back from. None
/// where steps are not that long.
fn held(
    c: &Cluster,
    model: &mut Model,
    form: &Form,
    flat: &FxHashMap<Symbol, Expr>,
    known: &Known,
    (state, h): (usize, Expr),
) -> Option<Expr> {
    let own = c.states[state].column?;
    let mut list = Vec::new();
    for &(j, k) in &form.column(own).row {
        if let Law::Resistor(_) = model.element(form.column(j).element).law {
            if is_steep(model, form, j) {
                continue;
            }
            let term = term(&mut model.pool, form, flat, (j, k));
            let pool = &mut model.pool;
            let slope = pool.derivative(term, c.states[state].symbol);
            let slope = pool.unary(Unary::Abs, slope);
            list.push(pool.mul(h, slope));
        } else if let Some(other) = known.places.get(&j) {
            let pool = &mut model.pool;
            let k = pool.substitute(k, flat);
            let turn = pool.mul(h, k);
            let square = pool.powi(turn, 2);
            let stiff = pool.mul(known.bends[state], known.bends[*other]);
            list.push(pool.mul(square, stiff));
        }
    }
    let sum = model.pool.sum(&list);
    let long = known.start.eval(&model.pool, sum) > model.settings.thresholds.stiffness.tight;
    let one = model.pool.int(1);
    long.then(|| model.pool.add(one, sum))
}

/// What is known of a cluster before it runs.
struct Known {
    /// How storages bend, state by state.
    bends: Vec<Expr>,
    /// The states of columns.
    places: FxHashMap<ColumnId, usize>,
    start: AtStart,
}

impl Known {
    fn new(c: &Cluster, model: &mut Model) -> Self {
        Self {
            bends: curvatures(c, model),
            places: c.states.iter().enumerate().filter_map(|(i, s)| Some((s.column?, i))).collect(),
            start: c.start(model),
        }
    }
}

/// An exponent that is less is none: what its law gives has lost its digits below the smallest normal number.
const VANISHES: f64 = 1e-250;

/// What [`imposed`] found, by column and how many resistors it looks through.
type Imposed = FxHashMap<(ColumnId, u32), Expr>;

/// Sum of the magnitudes of what others than resistors give to a column's input, in terms of states and loops; through
/// so many linear resistors too.
fn imposed(
    model: &mut Model,
    form: &Form,
    (flat, found): (&FxHashMap<Symbol, Expr>, &mut Imposed),
    column: ColumnId,
    through: u32,
) -> Expr {
    if let Some(sum) = found.get(&(column, through)) {
        return *sum;
    }
    let mut list = Vec::new();
    for &(j, k) in &form.column(column).row {
        let Law::Resistor(_) = model.element(form.column(j).element).law else {
            let term = term(&mut model.pool, form, flat, (j, k));
            list.push(model.pool.unary(Unary::Abs, term));
            continue;
        };
        // What is switched off makes anything of what it is given.
        let gain = own_gain(form, j).filter(|k| through > 0 && !model.pool.is_chosen(*k));
        let Some(gain) = gain else { continue };
        let given = imposed(model, form, (flat, found), j, through - 1);
        let pool = &mut model.pool;
        let k = pool.mul(k, gain);
        let k = pool.substitute(k, flat);
        let k = pool.unary(Unary::Abs, k);
        list.push(pool.mul(k, given));
    }
    let sum = model.pool.sum(&list);
    found.insert((column, through), sum);
    sum
}

/// Linear resistors in a row that are looked through.
const THROUGH: u32 = 2;

/// What one column gives to another's input, in terms of states and loops.
fn term(pool: &mut Pool, form: &Form, flat: &FxHashMap<Symbol, Expr>, (from, k): (ColumnId, Expr)) -> Expr {
    let z = pool.var(form.column(from).out);
    let term = pool.mul(k, z);
    pool.substitute(term, flat)
}

/// Sums within sums that count by their terms, at most.
pub(crate) const DEEP: u32 = 4;

/// What an expression would be if nothing in its sums cancelled, looked into so deep: rounding makes it uncertain by
/// some parts in 1e16 of that.
fn magnitude(pool: &mut Pool, e: Expr, deep: u32) -> Expr {
    match pool.node(e).clone() {
        expression::Node::Sum(constant, pairs) if deep > 0 => {
            let mut list = vec![pool.numeral(constant.abs())];
            for (term, k) in pairs.iter() {
                let term = magnitude(pool, *term, deep - 1);
                list.push(pool.scale(term, k.abs()));
            }
            pool.sum(&list)
        }
        expression::Node::Product(constant, factors) if deep > 0 => {
            let mut product = pool.numeral(constant.abs());
            for (factor, n) in factors.iter() {
                let above = !n.is_negative();
                let factor = if above { magnitude(pool, *factor, deep - 1) } else { pool.unary(Unary::Abs, *factor) };
                let power = pool.powers(&[(factor, *n)]);
                product = pool.mul(product, power);
            }
            product
        }
        expression::Node::Number(_)
        | expression::Node::Symbol(_)
        | expression::Node::Sum(..)
        | expression::Node::Product(..)
        | expression::Node::Power(..)
        | expression::Node::Unary(..)
        | expression::Node::Binary(..)
        | expression::Node::Select(..) => pool.unary(Unary::Abs, e),
    }
}

/// At most this many summands of sums within a sum count by themselves.
const MANY: usize = 32;

/// The summands of an expression; those of a sum that parameters alone stand before, too.
fn parts(pool: &mut Pool, e: Expr, deep: u32) -> Vec<Expr> {
    match pool.node(e).clone() {
        expression::Node::Sum(constant, pairs) if deep > 0 => {
            let mut list = vec![pool.numeral(constant)];
            for (e, k) in pairs.iter() {
                list.extend(parts(pool, *e, deep - 1).into_iter().map(|e| pool.scale(e, *k)).collect::<Vec<_>>());
            }
            list
        }
        expression::Node::Product(_, factors) if deep > 0 => {
            let is_sum = |e: Expr| matches!(pool.node(e), expression::Node::Sum(..));
            let inner = factors.iter().find(|(e, n)| n.is_one() && is_sum(*e)).map(|f| f.0);
            let Some(inner) = inner else { return vec![e] };
            let before = pool.div(e, inner);
            if pool.contains_any(before, &|s| pool.value(s).is_none()) {
                return vec![e];
            }
            parts(pool, inner, deep - 1).into_iter().map(|e| pool.mul(before, e)).collect()
        }
        expression::Node::Number(_)
        | expression::Node::Symbol(_)
        | expression::Node::Sum(..)
        | expression::Node::Product(..)
        | expression::Node::Power(..)
        | expression::Node::Unary(..)
        | expression::Node::Binary(..)
        | expression::Node::Select(..) => vec![e],
    }
}

/// Sum of the magnitudes of an expression's summands, in sums within sums up to so deep, after a substitution.
pub(crate) fn summands(model: &mut Model, flat: &FxHashMap<Symbol, Expr>, e: Expr, deep: u32) -> Expr {
    let pool = &mut model.pool;
    let all = parts(pool, e, deep);
    // Of more no one would cancel all.
    let parts = if all.len() > MANY { parts(pool, e, 1) } else { all };
    let sizes: Vec<Expr> = parts
        .into_iter()
        .map(|e| {
            let e = pool.substitute(e, flat);
            pool.unary(Unary::Abs, e)
        })
        .collect();
    pool.sum(&sizes)
}

/// Sum of the magnitudes of the terms of what each of some ports calls for, at the start.
pub(crate) fn called(
    c: &Cluster,
    model: &mut Model,
    form: &Form,
    b: &mut Builder,
    lowering: &Lowering,
    guesses: &[Value],
    ports: &[usize],
) -> Result<Vec<Value>, Vec<Diagnostic>> {
    let mut lowering = lowering.clone();
    for (z, guess) in c.loops.iter().zip(guesses) {
        lowering.bind(*z, *guess);
    }
    let flat = c.flat_at_instant(&mut model.pool, form);
    ports
        .iter()
        .map(|p| {
            let size = terms(model, form, &flat, c.ports[*p]);
            lowering.lower(&model.pool, b, size).map_err(|s| missing(model, s))
        })
        .collect()
}

/// What changes of the states (over `h`) and loops are measured against: themselves at the start, and the terms that
/// they are the sum of, so that what cancels is not asked for digits that it does not have.
pub(crate) fn scales(
    c: &Cluster,
    model: &mut Model,
    form: &Form,
    b: &mut Builder,
    lowering: &Lowering,
    inputs: (&[Value], &[Slot], &[Value]),
    h: Option<Expr>,
) -> Result<Vec<Value>, Vec<Diagnostic>> {
    let (states, traces, guesses) = inputs;
    let flat = c.flat_at_instant(&mut model.pool, form);
    let at_start = at_loops(c, lowering, guesses);
    let mut scaling = Scaling { c, model, form, b, flat: &flat, at_start, imposed: Imposed::default() };
    let mut laws = Vec::with_capacity(c.loops.len());
    for node in c.loop_nodes() {
        laws.push(scaling.law(node, h)?);
    }
    let sizes = scaling.loop_sizes(lowering, guesses, &laws)?;
    let mut scales = Vec::new();
    if let Some(h) = h {
        let among = at_loops(c, lowering, &sizes);
        scales = scaling.states(among, (states, traces), h)?;
    }
    scales.extend(scaling.loops(sizes)?);
    Ok(scales)
}

/// A lowering with these values of the loops.
fn at_loops(c: &Cluster, lowering: &Lowering, values: &[Value]) -> Lowering {
    let mut lowering = lowering.clone();
    c.loops.iter().zip(values).for_each(|(z, value)| lowering.bind(*z, *value));
    lowering
}

fn lower(model: &Model, b: &mut Builder, lowering: &mut Lowering, e: Expr) -> Result<Value, Vec<Diagnostic>> {
    lowering.lower(&model.pool, b, e).map_err(|s| missing(model, s))
}

/// What scales are made with.
struct Scaling<'a> {
    c: &'a Cluster,
    model: &'a mut Model,
    form: &'a Form,
    b: &'a mut Builder,
    flat: &'a FxHashMap<Symbol, Expr>,
    /// Loops at their guesses.
    at_start: Lowering,
    imposed: Imposed,
}

impl Scaling<'_> {
    fn at_start(&mut self, e: Expr) -> Result<Value, Vec<Diagnostic>> {
        lower(self.model, self.b, &mut self.at_start, e)
    }

    /// What the unknown of a loop is measured against besides itself.
    fn law(&mut self, node: &Node, h: Option<Expr>) -> Result<Size, Vec<Diagnostic>> {
        if let Output::Curve { bends, .. } = node.how {
            // The argument of an exponential is what it is given, and so known to the rounding of that. What resistors
            // give of it is not known at the start: the slope changes too fast.
            let one = self.b.number(1.0);
            return Ok(match node.resistor().zip(bends) {
                Some((column, bends)) => {
                    let terms = imposed(self.model, self.form, (self.flat, &mut self.imposed), column, THROUGH);
                    let sides = bends.above.into_iter().chain(bends.below);
                    let least = self.model.pool.float(sides.map(|b| VANISHES / b.1.abs()).fold(0.0, f64::max));
                    Size::Law { terms: self.model.pool.add(terms, least), slope: one, forward: true }
                }
                None => Size::Known(one),
            });
        }
        let column = node.resistor().filter(|column| !is_steep(self.model, self.form, *column));
        let law = column.and_then(|column| Some((column, slope(self.model, self.form, self.flat, node)?)));
        Ok(match law {
            Some((column, (k, forward))) => {
                // Where a law is switched off it says nothing: the rest of the loop determines it.
                let pool = &mut self.model.pool;
                let k = if node.switched.is_some() { relay::steepest(pool, k, node.out) } else { k };
                let k = self.at_start(k)?;
                let k = self.b.unary(Unary::Abs, k);
                let slope = self.coupled_slope(node, (k, forward), h)?;
                Size::Law { terms: terms(self.model, self.form, self.flat, column), slope, forward }
            }
            // A row of a field, or a law that reads signals: by the terms that it is made of.
            None => match node.how {
                Output::Explicit(e) if column.is_some() => {
                    let e = self.model.pool.substitute(e, self.flat);
                    let terms = magnitude(&mut self.model.pool, e, DEEP);
                    Size::Law { terms, slope: self.b.number(1.0), forward: true }
                }
                Output::Explicit(_) | Output::Implicit { .. } | Output::Curve { .. } => Size::Known(self.b.number(0.0)),
            },
        })
    }

    /// The slope of a law over a step: what a stiffly coupled resistor gives in it is what the storages let it.
    fn coupled_slope(
        &mut self,
        node: &Node,
        (k, forward): (Value, bool),
        h: Option<Expr>,
    ) -> Result<Value, Vec<Diagnostic>> {
        let is_coupled = self.c.stiffly_coupled.contains(&node.out);
        let rate = if is_coupled { self.c.coupling_rate(self.model, self.form, node) } else { None };
        let (Some(h), Some(rate)) = (h, rate) else { return Ok(k) };
        let pool = &mut self.model.pool;
        let one = pool.int(1);
        let turns = pool.mul(h, rate);
        let held = pool.add(one, turns);
        let held = pool.substitute(held, self.flat);
        let held = self.at_start(held)?;
        Ok(if forward { self.b.div(k, held) } else { self.b.mul(k, held) })
    }

    /// The sizes of the loops' unknowns. Loops are made of one another: what one of them is uncertain by, the next one
    /// is too.
    fn loop_sizes(
        &mut self,
        lowering: &Lowering,
        guesses: &[Value],
        laws: &[Size],
    ) -> Result<Vec<Value>, Vec<Diagnostic>> {
        let starts: Vec<Value> = guesses.iter().map(|z| self.b.unary(Unary::Abs, *z)).collect();
        let mut sizes = starts.clone();
        for _ in 0..laws.len().min(2) {
            let mut among = at_loops(self.c, lowering, &sizes);
            for ((size, start), law) in sizes.iter_mut().zip(&starts).zip(laws) {
                let more = match *law {
                    Size::Known(x) => x,
                    Size::Law { terms, slope, forward } => {
                        let t = lower(self.model, self.b, &mut among, terms)?;
                        if forward { self.b.mul(t, slope) } else { self.b.div(t, slope) }
                    }
                };
                *size = self.b.add(*start, more);
            }
        }
        Ok(sizes)
    }

    /// The scales of the states' changes over `h`; `among` has the loops at their sizes.
    fn states(
        &mut self,
        mut among: Lowering,
        (states, traces): (&[Value], &[Slot]),
        h: Expr,
    ) -> Result<Vec<Value>, Vec<Diagnostic>> {
        let known = Known::new(self.c, self.model);
        let mut scales = Vec::new();
        for (i, ((s, x), trace)) in self.c.states.iter().zip(states).zip(traces).enumerate() {
            let t = match s.column {
                Some(column) => terms(self.model, self.form, self.flat, column),
                None => summands(self.model, self.flat, s.rate, 1),
            };
            let (x, trace) = (self.b.unary(Unary::Abs, *x), self.b.load(*trace));
            let x = self.b.add(x, trace);
            let t = self.model.pool.mul(h, t);
            let t = lower(self.model, self.b, &mut among, t)?;
            let t = match held(self.c, self.model, self.form, self.flat, &known, (i, h)) {
                Some(k) => {
                    let k = self.at_start(k)?;
                    self.b.div(t, k)
                }
                None => t,
            };
            scales.push(self.b.add(x, t));
        }
        Ok(scales)
    }

    /// The scales of the loops, by their sizes. A law that is not linear counts what it is given alone: through the
    /// others it would come to powers of what is far from it.
    fn loops(&mut self, sizes: Vec<Value>) -> Result<Vec<Value>, Vec<Diagnostic>> {
        let relays = relay::relays(self.c, self.model, self.form);
        let mut scales = Vec::with_capacity(sizes.len());
        for ((node, size), relay) in self.c.loop_nodes().into_iter().zip(sizes).zip(relays) {
            let steep = node.resistor().filter(|column| is_steep(self.model, self.form, *column));
            let steep = steep.filter(|_| !matches!(node.how, Output::Curve { .. }));
            let law = steep.and_then(|column| Some((column, slope(self.model, self.form, self.flat, node)?)));
            let Some((column, (slope, forward))) = law else {
                scales.push(size);
                continue;
            };
            let mut given = imposed(self.model, self.form, (self.flat, &mut self.imposed), column, THROUGH);
            if !forward && matches!(node.how, Output::Implicit { bends: None, .. }) {
                let lost = cancelled(self.model, self.form, node, column);
                given = self.model.pool.add(given, lost);
            }
            let given = self.at_start(given)?;
            let slope = self.at_start(slope)?;
            let slope = self.b.unary(Unary::Abs, slope);
            let rest = slope_at_rest(self.model, self.form, column);
            let slope = match relay.filter(|_| !forward) {
                // Where a law all but blocks, its slope does not determine what it gives: the storages do.
                Some(relay) => {
                    let rest = self.b.number(relay.rest);
                    self.b.binary(Binary::Max, slope, rest)
                }
                None => cautious(self.b, slope, rest, (forward, self.c.thresholds.iteration.steeper)),
            };
            let more = if forward { self.b.mul(given, slope) } else { self.b.div(given, slope) };
            // Where a law rises like a root its slope says nothing.
            let (most, none) = (self.b.number(self.c.thresholds.newton.chord.range), self.b.number(0.0));
            let is_known = self.b.binary(Binary::Lt, more, most);
            let more = self.b.select(is_known, more, none);
            scales.push(self.b.add(size, more));
        }
        Ok(scales)
    }
}

/// The magnitudes of what does not change with a law's argument in the sums of the law, by how the law goes with them:
/// beside the 1 of `log(1 + e)` an `e` of 1e-17 is none.
fn cancelled(model: &mut Model, form: &Form, node: &Node, column: ColumnId) -> Expr {
    let zero = model.pool.zero();
    let Law::Resistor(law) = &model.element(form.column(column).element).law else { return zero };
    let (argument, output) = (law.argument, law.output);
    if model.pool.symbols(output).iter().any(|s| *s != argument) {
        return zero;
    }
    let mut list = Vec::new();
    let one = model.pool.int(1);
    beside(&mut model.pool, (output, argument), one, DEEPEST, &mut list);
    let pool = &mut model.pool;
    let sum = pool.sum(&list);
    let out = pool.var(node.out);
    pool.substitute(sum, &std::iter::once((argument, out)).collect())
}

/// Functions within functions that are looked through.
const DEEPEST: u32 = 6;

/// Lists what [`cancelled`] adds up of an expression that the law goes with by `by`.
fn beside(pool: &mut Pool, (e, x): (Expr, Symbol), by: Expr, deep: u32, list: &mut Vec<Expr>) {
    if deep == 0 || !pool.contains(e, x) {
        return;
    }
    let mut inner = |pool: &mut Pool, e: Expr, by: Expr| beside(pool, (e, x), by, deep - 1, list);
    match pool.node(e).clone() {
        expression::Node::Sum(constant, pairs) => {
            let mut rest = vec![pool.numeral(constant.abs())];
            for (term, k) in pairs.iter() {
                if pool.contains(*term, x) {
                    let by = pool.scale(by, *k);
                    inner(pool, *term, by);
                } else {
                    let size = pool.unary(Unary::Abs, *term);
                    rest.push(pool.scale(size, k.abs()));
                }
            }
            let (rest, by) = (pool.sum(&rest), pool.unary(Unary::Abs, by));
            list.push(pool.mul(by, rest));
        }
        expression::Node::Select(c, a, b) => {
            let zero = pool.zero();
            for (branch, [then, other]) in [(a, [by, zero]), (b, [zero, by])] {
                let by = pool.select(c, then, other);
                inner(pool, branch, by);
            }
        }
        node => {
            let mut parts = Vec::new();
            node.each_child(&mut |child| parts.push(child));
            for part in parts {
                let inside = pool.symbol("part");
                let stands = pool.var(inside);
                let whole = pool.rebuild(e, &|child| if child == part { stands } else { child });
                let slope = pool.derivative(whole, inside);
                let slope = pool.substitute(slope, &std::iter::once((inside, part)).collect());
                let by = pool.mul(by, slope);
                inner(pool, part, by);
            }
        }
    }
}

/// What a loop's unknown is measured against besides itself.
enum Size {
    Known(Value),
    /// The terms of what its resistor receives, by the slope of the law, or that by it.
    Law {
        terms: Expr,
        slope: Value,
        forward: bool,
    },
}

/// The slope of a resistor's law where it receives nothing; None where it is none, or the law reads signals.
fn slope_at_rest(model: &mut Model, form: &Form, column: ColumnId) -> Option<f64> {
    let Law::Resistor(law) = &model.element(form.column(column).element).law else { return None };
    let (argument, output) = (law.argument, law.output);
    let forward = law.gives == form.column(column).gives;
    if model.pool.symbols(output).iter().any(|s| *s != argument) {
        return None;
    }
    let slope = model.pool.derivative(output, argument);
    // On the side of a kink that makes the size the smaller one.
    let rest = model.pool.landmarks(&[output], argument, &|_| 0.0).rest();
    let sides = [0.0, rest, -rest].map(|x| model.pool.eval(slope, &|_| x).abs());
    let rest =
        if forward { sides.into_iter().fold(f64::INFINITY, f64::min) } else { sides.into_iter().fold(0.0, f64::max) };
    Some(rest).filter(|k| k.is_finite())
}

/// The slope at its knee of a law with an exponential that is run backwards; the least of two.
fn slope_at_knee(model: &mut Model, form: &Form, node: &Node) -> Option<f64> {
    let Output::Implicit { bends: Some(bends), .. } = node.how else { return None };
    let Law::Resistor(law) = &model.element(form.column(node.resistor()?).element).law else { return None };
    let (argument, output) = (law.argument, law.output);
    if model.pool.symbols(output).iter().any(|s| *s != argument) {
        return None;
    }
    let slope = model.pool.derivative(output, argument);
    let at = |(knee, _): (f64, f64)| model.pool.eval(slope, &|_| knee).abs();
    let least = bends.above.into_iter().chain(bends.below).map(at).fold(f64::INFINITY, f64::min);
    (least > 0.0 && least.is_finite()).then_some(least)
}

/// The slope of a law that is not linear, for sizes: that where it starts, which may be far from what it will be. Too
/// large a size lets errors pass, one that is too small costs iterations; so the slope at rest goes before, up to
/// `steeper` times off.
fn cautious(b: &mut Builder, here: Value, rest: Option<f64>, (forward, steeper): (bool, f64)) -> Value {
    let part = b.number(if forward { 1.0 / steeper } else { steeper });
    let far = b.mul(here, part);
    let Some(rest) = rest else { return far };
    let (low, high) = if forward { (far, here) } else { (here, far) };
    let rest = b.number(rest);
    let rest = b.binary(Binary::Max, rest, low);
    b.binary(Binary::Min, rest, high)
}

/// The slope of a resistor's law where it works, in terms of states and loops, and whether it runs forward.
fn slope(model: &mut Model, form: &Form, flat: &FxHashMap<Symbol, Expr>, node: &Node) -> Option<(Expr, bool)> {
    let column = node.resistor()?;
    let Law::Resistor(law) = &model.element(form.column(column).element).law else { return None };
    let (argument, output, forward) = (law.argument, law.output, law.gives == form.column(column).gives);
    if model.pool.symbols(output).iter().any(|s| *s != argument) {
        // A law that reads signals: its residual is in terms of states and outputs already.
        let Output::Implicit { residual, .. } = node.how else { return None };
        let slope = model.pool.derivative(residual, node.out);
        return Some((model.pool.substitute(slope, flat), false));
    }
    let slope = model.pool.derivative(output, argument);
    let at = if forward { form.input(&mut model.pool, column) } else { model.pool.var(node.out) };
    let at = model.pool.substitute(at, flat);
    let map: FxHashMap<Symbol, Expr> = std::iter::once((argument, at)).collect();
    let slope = model.pool.substitute(slope, &map);
    Some((model.pool.substitute(slope, flat), forward))
}

/// The values of [`loop_weights`] at the guesses.
pub(crate) fn weights_of_loops(
    c: &Cluster,
    model: &mut Model,
    form: &Form,
    b: &mut Builder,
    lowering: &Lowering,
    guesses: &[Value],
    h: Expr,
) -> Result<Vec<Value>, Vec<Diagnostic>> {
    let mut lowering = lowering.clone();
    for (z, guess) in c.loops.iter().zip(guesses) {
        lowering.bind(*z, *guess);
    }
    let weights = loop_weights(c, model, form, h);
    weights.into_iter().map(|w| lowering.lower(&model.pool, b, w).map_err(|s| missing(model, s))).collect()
}
