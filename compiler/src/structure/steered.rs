//! Which sources are steered: their values read the scene's own signals, so that they may give energy as a feedback
//! does, without end. One that reads time, numbers and what is given from outside is not.

use super::{ColumnId, Form, Role};
use crate::expression::{Expr, Symbol};
use crate::model::{Model, Signal};
use rustc_hash::FxHashSet;

/// The columns of the steered sources of a form whose values are in terms of states, outputs and time.
pub(super) fn steered(model: &Model, form: &Form) -> FxHashSet<ColumnId> {
    let columns = form.columns.iter().enumerate();
    let sources = columns.filter_map(|(i, c)| match c.role {
        Role::Source(value) => Some((ColumnId(i as u32), value)),
        Role::Bar | Role::Open(_) | Role::Storage | Role::Resistor | Role::Dependent | Role::Constraint => None,
    });
    sources.filter(|(_, value)| reads_the_scene(model, form, *value)).map(|(id, _)| id).collect()
}

/// Whether a value depends on what moves in the scene: symbols are followed through signal states, integrals and
/// sources until that is known.
fn reads_the_scene(model: &Model, form: &Form, value: Expr) -> bool {
    let (mut seen, mut next) = (FxHashSet::<Symbol>::default(), vec![value]);
    while let Some(e) = next.pop() {
        for s in model.pool.symbols(e) {
            if model.pool.value(s).is_some() || !seen.insert(s) {
                continue;
            }
            match model.signals.get(&s) {
                Some(Signal::Time | Signal::Input(_) | Signal::Slope(_)) => continue,
                Some(Signal::Memory(i)) => next.extend(form.memories.get(*i)),
                Some(Signal::Delay(i)) => next.extend(form.delays.get(*i)),
                Some(Signal::Integral(i)) => next.extend(form.integrals.get(*i)),
                Some(
                    Signal::Effort(_) | Signal::Flow(_) | Signal::State(_) | Signal::Argument(_) | Signal::Parameter(_),
                ) => return true,
                // The output of a source is its value; any other output, and what is an unknown of a step, moves.
                None => match form.column_of.get(&s).map(|c| form.column(*c).role) {
                    Some(Role::Source(value)) => next.push(value),
                    Some(
                        Role::Bar | Role::Open(_) | Role::Storage | Role::Resistor | Role::Dependent | Role::Constraint,
                    )
                    | None => {
                        return true;
                    }
                },
            }
        }
    }
    false
}
