//! Laws that jump, as friction written with `sign` does: they have a vertical branch there, and no value on it.

use crate::discretise::cluster::{Cluster, Node};
use crate::expression::{Expr, Symbol};
use crate::model::{Law, Model};
use crate::structure::{ColumnId, Form};
use rustc_hash::FxHashMap;

/// Two distances from 0 so small that what has no jump there is nothing beside the other, whatever the units.
const NEAR: [f64; 2] = [f64::from_bits((1023 - 350) << 52), f64::from_bits((1023 - 400) << 52)];
/// It jumps where of the difference between both sides at the larger one at least this part is left at the smaller one.
const LEFT: f64 = 0.5;

impl Cluster {
    /// Resistors whose laws jump where their argument passes 0.
    pub(crate) fn vertical_laws(&self, model: &mut Model, form: &Form) -> Vec<String> {
        let start = self.start(model);
        let columns = self.nodes.iter().filter_map(Node::resistor);
        let law = |c: ColumnId| Some((c, law(model, form, c)?));
        let laws: Vec<_> = columns.filter_map(law).collect();
        let mut jumps = Vec::new();
        for (column, (argument, law)) in laws {
            let mut at = |x: f64| {
                let x = model.pool.float(x);
                let law = model.pool.substitute(law, &FxHashMap::from_iter([(argument, x)]));
                start.eval(&model.pool, law)
            };
            let [far, near] = NEAR.map(|x| (at(x) - at(-x)).abs());
            if near > LEFT * far {
                let id = form.column(column).element;
                let field = model.element(id).field.and_then(|(f, _)| model.fields.get(f));
                jumps.push(field.map_or(&model.element(id).name, |f| &f.name).clone());
            }
        }
        jumps.dedup();
        jumps
    }
}

/// The argument and the law of a resistor, or of a port of a field, whose law has no value here where it reads others.
fn law(model: &Model, form: &Form, c: ColumnId) -> Option<(Symbol, Expr)> {
    let column = form.column(c);
    match (&model.element(column.element).law, model.element(column.element).field) {
        (Law::Resistor(law), Some(_)) if law.curve.is_none() => Some((law.argument, law.output)),
        _ => form.regions[column.region.at()].laws.get(&c).copied(),
    }
}
