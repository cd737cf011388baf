//! Large systems as statements, for back ends that can call no solver: `bond_runtime::solve::direct` on a [`Recorder`].

use super::dead_code::remove_unused;
use super::recorder::Recorder;
use super::writer::{Vector, Writer};
use crate::backend::code::{Bound, Routine, Stmt, System, all};
use bond_runtime::machine::Number;
use bond_runtime::solve::direct::Direct;
use bond_runtime::solve::linear::Plan;

/// What of [`Stmt::Solve`] is written out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::backend) enum Solvers {
    /// All.
    All,
    /// All but lines of unknowns, which C does two at a time in vectors.
    AllButLines,
}

/// A routine without [`Stmt::Solve`]. Its scratch has room for factors, which stay there from run to run.
pub(in crate::backend) fn with_solvers(mut routine: Routine, which: Solvers) -> Routine {
    let (body, systems) = (std::mem::take(&mut routine.body), std::mem::take(&mut routine.systems));
    if systems.is_empty() {
        return Routine { body, ..routine };
    }
    let plans: Vec<Plan> = systems.iter().map(|s| Plan::new(s.n, &s.pattern, s.matrix)).collect();
    let recorder = Recorder::new(Writer::resume(&mut routine));
    let mut writing =
        Writing { m: &recorder, which, systems: &systems, plans: &plans, made: Vec::new(), left: Vec::new() };
    writing.made.resize_with(systems.len(), || None);
    let body = writing.written(body);
    let systems = writing.left.iter().map(|k| systems[*k as usize].clone()).collect();
    let mut routine = recorder.into_writer().resumed(Routine { systems, ..routine }, body);
    remove_unused(&mut routine);
    if !has_tables(&routine.body) {
        routine.tables.clear();
    }
    routine
}

/// Whether anything looks into the tables.
fn has_tables(body: &[Stmt]) -> bool {
    let listed = |bound: Bound| matches!(bound, Bound::Table(..));
    !all(body, &mut |s| match s {
        Stmt::Span(span, _) => !listed(span.from) && !listed(span.to),
        s => s.place().is_none_or(|place| place.through.is_none()),
    })
}

/// The systems of a routine, each with its memory as soon as it is solved somewhere.
struct Writing<'r, 's> {
    m: &'r Recorder,
    which: Solvers,
    systems: &'s [System],
    plans: &'s [Plan],
    made: Vec<Option<Direct<'s, &'r Recorder>>>,
    /// The numbers of those that stay as they are.
    left: Vec<u32>,
}

impl Writing<'_, '_> {
    /// Statements with solutions written out.
    fn written(&mut self, body: Vec<Stmt>) -> Vec<Stmt> {
        let mut out = Vec::with_capacity(body.len());
        for mut s in body {
            for block in s.inner_mut() {
                *block = self.written(std::mem::take(block));
            }
            let Stmt::Solve { system, matrix, vector, row, same } = s else {
                out.push(s);
                continue;
            };
            let (m, this, plan) = (self.m, &self.systems[system as usize], &self.plans[system as usize]);
            if self.which == Solvers::AllButLines && plan.line().is_some() {
                let known = self.left.iter().position(|k| *k == system);
                let system = known.unwrap_or_else(|| {
                    self.left.push(system);
                    self.left.len() - 1
                });
                out.push(Stmt::Solve { system: system as u32, matrix, vector, row, same });
                continue;
            }
            m.with(Writer::open);
            let solver = self.made[system as usize].get_or_insert_with(|| {
                let room = |n| m.with(|w| Vector::Memory(w.room(n)));
                let lists = (Vector::Memory(matrix), Vector::Memory(vector));
                Direct::new(m, (plan, &this.pattern), lists, room, |list| m.table(list))
            });
            solver.solve(&m.changing(row), same.map(|same| m.value(same).is_set()));
            out.extend(m.with(Writer::close));
        }
        out
    }
}
