//! Lines of unknowns: tables, and calls of their elimination, which goes two at a time in vectors.

use super::print::{Needs, table};
use crate::backend::code::Routine;
use bond_runtime::solve::linear::Plan;
use std::fmt::Write;

/// The functions `bond_solve_0`, ... that a routine calls, numbered from `first` on. Each has numbers of its own, where
/// it keeps its factors: no more than [`crate::backend::lower::with_solvers`] takes.
pub(super) fn functions(routine: &Routine, first: usize, needs: &mut Needs) -> String {
    let mut out = String::new();
    let mut at = routine.scratch as usize;
    for (k, s) in (first..).zip(&routine.systems) {
        let plan = Plan::new(s.n, &s.pattern, s.matrix);
        let Some(t) = plan.line().map(|symbolic| symbolic.tables()) else { continue };
        needs.extend(["bond_scale", "bond_line"]);
        let wide = |list: &[usize]| list.iter().map(|x| *x as u32).collect::<Vec<u32>>();
        let lists = [
            ("row", t.row.to_vec()),
            ("column", t.column.to_vec()),
            ("starts", t.starts.to_vec()),
            ("entries", t.entries.iter().flat_map(|e| [e.0, e.1]).collect()),
            ("lower_starts", wide(&t.lower.starts)),
            ("lower_columns", t.lower.columns.clone()),
            ("upper_starts", wide(&t.upper.starts)),
            ("upper_columns", t.upper.columns.clone()),
        ];
        for (name, list) in &lists {
            table(&mut out, &format!("static const unsigned solve_{k}_{name}[]"), list);
        }
        let (lower, upper) = (t.lower.columns.len(), t.upper.columns.len());
        let _ = write!(out, "static const struct bond_pattern solve_{k} = {{ {}, {lower}, {upper}", s.n);
        for (name, _) in &lists {
            let _ = write!(out, ", solve_{k}_{name}");
        }
        let _ = writeln!(
            out,
            " }};\nstatic bond_real bond_solve_{k}(const bond_real *a, bond_real *b, bond_real *s, int same) {{\n    \
             return bond_line(&solve_{k}, a, b, s + {at}, same);\n}}"
        );
        at += lower + upper + 5 * s.n + 1 + t.line.map_or(0, |line| 2 * line.packed());
    }
    out
}
