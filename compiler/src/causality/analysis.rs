//! What strokes come to, told from the values of the junction structure at one place: whether they leave a variable
//! undetermined, whether dependent storages can be merged, and whether that divides by ratios which may pass 0.

use super::Causality;
use super::junction::{Coefficients, Given, rows, somewhere};
use super::laws::Laws;
use crate::expression::{Expr, Node, Symbol};
use crate::graph::{BondGraph, RegionId};
use crate::model::{BondId, ElementId, Law, Model, Signal};
use petgraph::unionfind::UnionFind;
use rustc_hash::{FxHashMap, FxHashSet};

/// A part of the largest term of a sum that is rounding.
const ROUNDING: f64 = 1e-12;

/// A coefficient at one place, and what of it changes with states.
#[derive(Clone, Copy, Default)]
struct Value {
    value: f64,
    /// Whether it is multiplied and divided by what changes.
    multiplied: bool,
    divided: bool,
    /// Whether it is a sum of what changes, and whether it is divided by such a sum.
    sum: bool,
    divided_by_sum: bool,
}

struct Values<'m>(&'m Model);

impl Coefficients for Values<'_> {
    type Of = Value;

    fn int(&mut self, n: i64) -> Value {
        Value { value: n as f64, ..Value::default() }
    }

    fn ratio(&mut self, ratio: Expr) -> Value {
        let pool = &self.0.pool;
        let value = somewhere(pool, ratio);
        let value = if value.is_finite() && value != 0.0 { value } else { 1.0 };
        let is_state = |s: Symbol| matches!(self.0.signals.get(&s), Some(Signal::State(_)));
        let changes = |e: Expr| pool.contains_any(e, &is_state);
        let powers: Vec<f64> = match pool.node(ratio) {
            Node::Product(_, factors) => factors.iter().filter(|t| changes(t.0)).map(|t| t.1.to_f64()).collect(),
            _ => changes(ratio).then_some(1.0).into_iter().collect(),
        };
        let (multiplied, divided) = (powers.iter().any(|n| *n > 0.0), powers.iter().any(|n| *n < 0.0));
        Value { value, multiplied, divided, ..Value::default() }
    }

    fn neg(&mut self, x: Value) -> Value {
        Value { value: -x.value, ..x }
    }

    fn sum(&mut self, terms: &[Value]) -> Value {
        let sum: f64 = terms.iter().map(|x| x.value).sum();
        let largest = terms.iter().fold(0.0f64, |m, x| m.max(x.value.abs()));
        if sum.abs() <= ROUNDING * largest {
            return Value::default();
        }
        let changing = |x: &&Value| x.multiplied || x.divided;
        Value {
            value: sum,
            multiplied: terms.iter().any(|x| x.multiplied),
            divided: terms.iter().any(|x| x.divided),
            sum: terms.iter().any(|x| x.sum) || (terms.len() > 1 && terms.iter().any(|x| changing(&x))),
            divided_by_sum: terms.iter().any(|x| x.divided_by_sum),
        }
    }

    fn mul(&mut self, x: Value, y: Value) -> Value {
        Value {
            value: x.value * y.value,
            multiplied: x.multiplied || y.multiplied,
            divided: x.divided || y.divided,
            sum: x.sum || y.sum,
            divided_by_sum: x.divided_by_sum || y.divided_by_sum,
        }
    }

    fn div(&mut self, x: Value, y: Value) -> Value {
        Value {
            value: x.value / y.value,
            multiplied: x.multiplied || y.divided,
            divided: x.divided || y.multiplied,
            sum: x.sum || y.divided_by_sum,
            divided_by_sum: x.divided_by_sum || y.sum,
        }
    }

    fn is_zero(&self, x: Value) -> bool {
        x.value == 0.0
    }

    fn size(&self, x: Value) -> (bool, f64) {
        (!x.multiplied && !x.divided, x.value.abs())
    }
}

/// What stands at an end of the junction structure and gives a variable.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
enum By {
    /// An element with one port.
    Element(ElementId),
    /// The other side of a double bar.
    Bar(BondId),
}

/// What all elements with one port and double bars give.
fn given(model: &Model, graph: &BondGraph, causality: &Causality) -> Vec<Given<By>> {
    let mut list = Vec::new();
    for (id, _) in model.ids().filter(|(_, e)| !matches!(e.law, Law::Ratio(_) | Law::Junction)) {
        let Some(&bond) = graph.bonds_of[id.at()].first() else { continue };
        let place = model.place(bond, id, causality.gives(model, bond, id));
        list.push(Given { place, by: By::Element(id), sign: 1 });
    }
    for (i, b) in model.bonds.iter().enumerate().filter(|(_, b)| b.sampled) {
        let bond = BondId(i as u32);
        for far in [b.head, b.tail] {
            let place = model.place(bond, b.other(far), causality.gives(model, bond, far));
            list.push(Given { place, by: By::Bar(bond), sign: 1 });
        }
    }
    list
}

/// What strokes come to.
#[derive(Clone, Default)]
pub(super) struct Facts {
    /// Whether no variable is undetermined.
    pub(super) determined: bool,
    /// Whether all dependent storages can be merged, as far as that shows without the values of ratios.
    pub(super) mergeable: bool,
    /// Whether one of them follows several independent storages by ratios that are divided by, and change with states.
    pub(super) divided: bool,
    /// Storages of which one follows another by a division by a sum of such ratios, as where bars make a loop.
    pub(super) looped: Vec<ElementId>,
}

impl Facts {
    pub(super) fn of(model: &Model, graph: &BondGraph, laws: &Laws, causality: &Causality) -> Self {
        let given = given(model, graph, causality);
        let Ok(rows) = rows(&mut Values(model), model, graph, causality, &given) else {
            // Of a loop that is too large to be solved nothing is known: multipliers cut it.
            let regions: FxHashSet<RegionId> = causality.dependent.iter().map(|d| graph.region_of[d.at()]).collect();
            let storages = model
                .ids()
                .filter(|(id, e)| matches!(e.law, Law::Storage(_)) && regions.contains(&graph.region_of[id.at()]));
            return Self { looped: storages.map(|(id, _)| id).collect(), ..Self::default() };
        };
        let is_independent =
            |id: ElementId| matches!(model.element(id).law, Law::Storage(_)) && !causality.dependent.contains(&id);
        let mut mergeable = true;
        let mut sets = UnionFind::<usize>::new(model.elements.len());
        let (mut divides, mut divides_by_sums) = (Vec::new(), Vec::new());
        for &id in &causality.dependent {
            let bond = graph.bonds_of[id.at()].first();
            let Some((&bond, variable)) = bond.zip(model.element(id).kind.integral()) else { continue };
            let row = &rows[model.place(bond, id, variable)];
            mergeable &= laws.quadratic[id.at()] && !row.is_empty();
            for (by, k) in row {
                match by {
                    By::Element(by) if is_independent(*by) => {
                        sets.union(id.at(), by.at());
                        divides.extend(k.divided.then_some(id));
                        divides_by_sums.extend(k.divided_by_sum.then_some(id));
                    }
                    By::Element(by) => mergeable &= is_known_in_time(model, *by),
                    By::Bar(_) => mergeable = false,
                }
            }
        }
        for field in &model.fields {
            field.members.windows(2).for_each(|pair| _ = sets.union(pair[0].at(), pair[1].at()));
        }
        let mut independent: FxHashMap<usize, usize> = FxHashMap::default();
        for (id, _) in model.ids().filter(|(id, _)| is_independent(*id)) {
            *independent.entry(sets.find(id.at())).or_default() += 1;
        }
        let divided = divides.iter().any(|id| independent.get(&sets.find(id.at())).is_some_and(|n| *n > 1));
        let looped: FxHashSet<usize> = divides_by_sums.iter().map(|id| sets.find(id.at())).collect();
        let storages = model.ids().filter(|(_, e)| matches!(e.law, Law::Storage(_)));
        let looped = storages.map(|(id, _)| id).filter(|id| looped.contains(&sets.find(id.at()))).collect();
        Self { determined: true, mergeable, divided, looped }
    }
}

/// Whether it is a source whose value is one in time alone.
fn is_known_in_time(model: &Model, id: ElementId) -> bool {
    let Law::Source(v) = model.element(id).law else { return false };
    model.pool.symbols(v).iter().all(|s| model.signals.get(s) == Some(&Signal::Time))
}
