//! Large systems: tables, and calls of the two eliminations.

use super::print::Needs;
use crate::backend::code::{Routine, System};
use bond_runtime::solve::linear::Plan;
use bond_runtime::solve::sparse::Pattern;
use std::fmt::Write;

/// How many numbers the elimination of each system of a routine needs. Each has its own: it keeps its factors.
fn rooms(routine: &Routine) -> impl Iterator<Item = usize> {
    routine.systems.iter().map(|s| match plan(s).sparse() {
        Some(t) => {
            let (t, parts) = (t.tables(), if s.is_complex() { 2 } else { 1 });
            let packed = t.line.map_or(0, |line| 2 * line.packed());
            parts * (t.lower.columns.len() + t.upper.columns.len() + 3 * s.n) + 2 * s.n + 1 + packed
        }
        None => s.n * s.n + 7 * s.n,
    })
}

/// How a system is solved.
fn plan(s: &System) -> Plan {
    Plan::new(s.n, &s.pattern, s.matrix)
}

/// How many numbers the eliminations of a routine need.
pub(super) fn room(routine: &Routine) -> usize {
    rooms(routine).sum()
}

/// The functions `bond_solve_0`, ... that a routine calls, numbered from `first` on.
pub(super) fn functions(routine: &Routine, first: usize, needs: &mut Needs) -> String {
    let mut out = String::new();
    let mut at = routine.scratch as usize;
    for ((k, s), room) in routine.systems.iter().enumerate().zip(rooms(routine)) {
        let k = first + k;
        let plan = plan(s);
        let call = match plan.sparse() {
            Some(symbolic) => {
                let t = symbolic.tables();
                let how = match (s.is_complex(), t.line) {
                    (true, _) => "bond_complex",
                    (false, Some(_)) => "bond_line",
                    (false, None) => "bond_sparse",
                };
                needs.extend(["bond_pattern", how]);
                if !s.is_complex() {
                    needs.insert("bond_factor");
                }
                let entries: Vec<u32> = t.entries.iter().flat_map(|e| [e.0, e.1]).collect();
                let runs = |p: &Pattern| p.runs.iter().flat_map(|r| [r.from, r.to, r.distance]).collect::<Vec<u32>>();
                let wide = |list: &[usize]| list.iter().map(|x| *x as u32).collect::<Vec<u32>>();
                let lists = [
                    ("row", t.row.to_vec()),
                    ("column", t.column.to_vec()),
                    ("starts", t.starts.to_vec()),
                    ("entries", entries),
                    ("lower_starts", wide(&t.lower.starts)),
                    ("lower_columns", t.lower.columns.clone()),
                    ("lower_run", runs(t.lower)),
                    ("upper_starts", wide(&t.upper.starts)),
                    ("upper_columns", t.upper.columns.clone()),
                    ("upper_run", runs(t.upper)),
                ];
                for (name, list) in &lists {
                    numbers(&mut out, &format!("static const unsigned solve_{k}_{name}[]"), list);
                }
                let _ = write!(
                    out,
                    "static const struct bond_pattern solve_{k} = {{ {}, {}, {}, {}, {}",
                    s.n,
                    t.lower.columns.len(),
                    t.upper.columns.len(),
                    t.lower.runs.len(),
                    t.upper.runs.len()
                );
                for (name, _) in &lists {
                    let _ = write!(out, ", solve_{k}_{name}");
                }
                out.push_str(" };\n");
                format!("{how}(&solve_{k}, a, b, w, same)")
            }
            None => {
                needs.insert("bond_dense");
                let list: Vec<u32> = s.pattern.iter().flat_map(|p| [p.0, p.1]).collect();
                numbers(&mut out, &format!("static const unsigned short solve_{k}_at[]"), &list);
                format!(
                    "(void)same, bond_dense({}, solve_{k}_at, {}, a, b, w, {})",
                    s.n,
                    s.pattern.len(),
                    u8::from(plan.is_undetermined())
                )
            }
        };
        let _ = writeln!(
            out,
            "static bond_real bond_solve_{k}(const bond_real *a, bond_real *b, bond_real *s, int same) {{\n    \
             bond_real *w = s + {at};\n    return {call};\n}}"
        );
        at += room;
    }
    out
}

/// A table of numbers.
pub(super) fn numbers(out: &mut String, name: &str, list: &[u32]) {
    let _ = write!(out, "{name} = {{");
    if list.is_empty() {
        out.push_str(" 0");
    }
    for (i, x) in list.iter().enumerate() {
        out.push_str(if i % 24 == 0 { "\n    " } else { " " });
        let _ = write!(out, "{x},");
    }
    out.push_str("\n};\n");
}
