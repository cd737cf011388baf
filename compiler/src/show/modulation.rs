//! What the laws of elements read besides the variables of their own ports: signals.

use crate::expression::Expr;
use crate::model::{BondId, Element, ElementId, Kind, Law, Model, OnePort, Signal, Variable};
use std::collections::BTreeSet;

/// Where a signal comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Origin {
    /// Time.
    Time,
    /// An element: its state, or the argument of its law.
    Element(ElementId),
    /// A bond: its effort (`true`) or its flow.
    Bond(BondId, bool),
    /// An `input`.
    Input(usize),
    /// A signal state.
    Memory(usize),
    /// A `delay(...)`.
    Delay(usize),
    /// An `integral(...)`.
    Integral(usize),
}

/// What an expression reads.
pub(super) fn reads(model: &Model, e: Expr) -> BTreeSet<Origin> {
    let origin = |signal: &Signal| match *signal {
        Signal::Time => Origin::Time,
        Signal::Effort(b) => Origin::Bond(b, true),
        Signal::Flow(b) => Origin::Bond(b, false),
        Signal::State(id) | Signal::Argument(id) | Signal::Parameter(id) => Origin::Element(id),
        Signal::Integral(i) => Origin::Integral(i),
        Signal::Input(i) | Signal::Slope(i) => Origin::Input(i),
        Signal::Memory(i) => Origin::Memory(i),
        Signal::Delay(i) => Origin::Delay(i),
    };
    model.pool.symbols(e).iter().filter_map(|s| model.signals.get(s)).map(origin).collect()
}

/// What drives an element from elsewhere; nothing of a storage, a junction or a line, whose laws are their own, and
/// nothing of a source that is a function of time alone.
pub(super) fn drives(model: &Model, e: &Element) -> BTreeSet<Origin> {
    let mut all = BTreeSet::new();
    if e.line.is_some() || e.added {
        return all;
    }
    match &e.law {
        Law::Source(v) | Law::Ratio(v) => all.extend(reads(model, *v)),
        Law::Resistor(r) => match r.curve {
            Some(curve) => [curve.effort, curve.flow].iter().for_each(|v| all.extend(reads(model, *v))),
            None => all.extend(reads(model, r.output)),
        },
        Law::Storage(_) | Law::Junction | Law::Port(_) | Law::Multiplier => {}
    }
    all.retain(|origin| !is_own(model, e, *origin));
    if e.kind.is_source() && all.iter().all(|o| *o == Origin::Time) {
        all.clear();
    }
    all
}

/// Whether something that a law reads belongs to the element's own ports. A resistor on a junction has the junction's
/// common variable too.
fn is_own(model: &Model, e: &Element, origin: Origin) -> bool {
    let same = |id: ElementId| {
        let other = model.element(id);
        std::ptr::eq(other, e) || e.field.is_some() && other.field.map(|f| f.0) == e.field.map(|f| f.0)
    };
    match origin {
        Origin::Element(id) => same(id),
        Origin::Bond(bond, effort) => {
            let b = model.bond(bond);
            let common = Kind::Junction(if effort { Variable::Effort } else { Variable::Flow });
            let shares = |id: ElementId| {
                let at = |o: &crate::model::Bond| o.tail == id && same(o.head) || o.head == id && same(o.tail);
                model.element(id).kind == common && model.bonds.iter().any(at)
            };
            let resistor = e.kind == Kind::OnePort(OnePort::Resistor);
            same(b.tail) || same(b.head) || resistor && (shares(b.tail) || shares(b.head))
        }
        Origin::Time | Origin::Input(_) | Origin::Memory(_) | Origin::Delay(_) | Origin::Integral(_) => false,
    }
}

/// Whether signals drive an element.
pub(super) fn is_modulated(model: &Model, e: &Element) -> bool {
    !drives(model, e).is_empty()
}
