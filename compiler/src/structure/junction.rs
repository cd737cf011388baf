//! The rows of the columns: their inputs as combinations of outputs.

use super::{Column, ColumnId, Role, Row};
use crate::causality::{Causality, Given, Undetermined, combine, rows as solve};
use crate::graph::BondGraph;
use crate::model::{BondId, ElementId, Model, Variable};
use bond_grammar::diagnostic::Diagnostic;

/// The suggested fix for bonds in a loop that leave a variable free.
const FREE: &str = "open the loop, or put an element into it that determines the missing variable; a circuit without \
a reference voltage needs a ground, `Se:ground = 0 V` bonded to one of its 0-junctions";

/// Rows of all bond variables.
pub(super) struct Rows {
    rows: Vec<Row>,
}

impl Rows {
    /// The row of a bond's variable as seen from one of its ends.
    pub(super) fn get(&self, model: &Model, bond: BondId, end: ElementId, variable: Variable) -> &Row {
        &self.rows[model.place(bond, end, variable)]
    }
}

/// Solves the junction structure and fills in the columns' rows.
pub(super) fn rows(
    model: &mut Model,
    graph: &BondGraph,
    causality: &Causality,
    columns: &mut [Column],
) -> Result<Rows, Vec<Diagnostic>> {
    let near = |c: &Column| if c.role == Role::Bar { model.bond(c.bond).other(c.element) } else { c.element };
    let given: Vec<Given<ColumnId>> = columns
        .iter()
        .enumerate()
        .map(|(i, c)| Given {
            place: model.place(c.bond, near(c), c.gives),
            by: ColumnId(i as u32),
            sign: c.sign_of(c.gives),
        })
        .collect();
    let inputs: Vec<(usize, i64)> =
        columns.iter().map(|c| (model.place(c.bond, near(c), c.gives.other()), c.sign_of(c.gives.other()))).collect();
    let mut pool = std::mem::take(&mut model.pool);
    let solved = solve(&mut pool, model, graph, causality, &given);
    if let Ok(rows) = &solved {
        for (c, (place, sign)) in columns.iter_mut().zip(inputs) {
            let k = pool.int(sign);
            c.row = combine(&mut pool, [(k, &rows[place])]);
        }
    }
    model.pool = pool;
    solved.map(|rows| Rows { rows }).map_err(|Undetermined(bonds)| vec![undetermined(model, &bonds)])
}

fn undetermined(model: &Model, bonds: &[BondId]) -> Diagnostic {
    let is_added = |b: &&BondId| [model.bond(**b).tail, model.bond(**b).head].iter().any(|id| model.element(*id).added);
    let (added, bonds): (Vec<&BondId>, Vec<&BondId>) = bonds.iter().partition(is_added);
    let bonds = if bonds.is_empty() { added } else { bonds };
    let names: Vec<&str> = bonds.iter().map(|b| model.bond(**b).name.as_str()).collect();
    let message =
        format!("the graph is not determined: the bonds {} form a loop that leaves a variable free", names.join(", "));
    let mut error = Diagnostic::error("structure::loop", model.bond(*bonds[0]).span, message);
    for b in bonds.iter().skip(1).take(16) {
        error = error.label(model.bond(**b).span, "is in the loop");
    }
    error.help(FREE)
}
