//! `phs` as LaTeX: a fragment that needs `amsmath`.

use super::matrix::{self, Explicit, Matrix};
use super::size::SIZES;
use super::{Shown, equation, name, region};
use crate::expression::{Expr, Pool, greek};
use crate::model::Model;
use crate::structure::{Form, Region, Role};
use std::fmt::Write;

/// The form of all regions.
pub(super) fn text(shown: &mut Shown<'_>) -> String {
    let names = name::columns(shown.model, shown.form);
    let mut text = format!("% {}: the port-Hamiltonian form. Needs \\usepackage{{amsmath}}.\n", shown.model.name);
    let _ = writeln!(text, "\\setcounter{{MaxMatrixCols}}{{{}}}", SIZES.latex_columns + 1);
    for (i, r) in shown.form.regions.iter().enumerate() {
        let kind = shown.graph.regions.get(i).map(|g| region::kind(shown, g)).unwrap_or_default();
        let _ = writeln!(text, "\n\\paragraph{{Region \\texttt{{{}}}, {}.}}", escape(&r.name), escape(&kind));
        one(shown.model, shown.form, r, &names, &mut text);
    }
    text
}

fn escape(text: &str) -> String {
    let mut out = String::new();
    for c in text.chars() {
        match c {
            '_' | '%' | '&' | '#' | '$' | '{' | '}' => out.extend(['\\', c]),
            '\\' => out.push_str("\\textbackslash{}"),
            '^' => out.push_str("\\^{}"),
            '~' => out.push_str("\\~{}"),
            _ => match greek(c) {
                Some(letter) => out.extend(["\\ensuremath{", letter, "}"]),
                None => out.push(c),
            },
        }
    }
    out
}

/// A name as a formula; the minus of `-hand.f` stays before it.
fn symbol(pool: &mut Pool, name: &str) -> String {
    let (sign, name) = name.strip_prefix('-').map_or(("", name), |n| ("-", n));
    let s = pool.symbol(name);
    let s = pool.var(s);
    format!("{sign}{}", pool.latex(s))
}

fn one(model: &mut Model, form: &Form, r: &Region, names: &[String], text: &mut String) {
    if !r.groups.is_empty() {
        energy(&model.pool, r, text);
    }
    let explicit = matrix::explicit_form(model, form, r, names);
    match &explicit {
        Some(e) if e.inputs.len().max(r.states.len()) <= SIZES.latex_columns => form_of(&mut model.pool, r, e, text),
        Some(_) | None => equations(model, form, r, names, text),
    }
    let d = matrix::dirac(form, r, names);
    if d.rows.len() <= SIZES.latex_columns && !d.rows.is_empty() {
        text.push_str("The Dirac structure, the power $e f$ of each element counted into it:\n");
        let pool = &mut model.pool;
        let (rows, columns) = (column(pool, &d.rows), column(pool, &d.columns));
        let body = body(pool, &d);
        let _ = write!(text, "\\begin{{equation*}}\n{rows}\n=\n{body}\n{columns}\n\\end{{equation*}}\n");
    }
    laws(model, form, r, names, text);
}

/// H, a line a term.
fn energy(pool: &Pool, r: &Region, text: &mut String) {
    let terms: Vec<String> = r.groups.iter().map(|g| name::formula(pool, g.energy)).collect();
    let _ = write!(text, "\\begin{{align*}}\nH ={{}}& {}\n\\end{{align*}}\n", terms.join(" \\\\\n&{}+ "));
}

/// Names in a column.
fn column(pool: &mut Pool, names: &[String]) -> String {
    let names: Vec<String> = names.iter().map(|n| symbol(pool, n)).collect();
    format!("\\begin{{bmatrix}} {} \\end{{bmatrix}}", names.join(" \\\\ "))
}

/// The entries of a matrix.
fn body(pool: &Pool, m: &Matrix) -> String {
    let mut cells = vec![vec!["0".to_string(); m.columns.len()]; m.rows.len()];
    for (i, j, e) in &m.entries {
        cells[*i][*j] = name::formula(pool, *e);
    }
    let rows: Vec<String> = cells.iter().map(|r| r.join(" & ")).collect();
    format!("\\begin{{bmatrix}}\n{}\n\\end{{bmatrix}}", rows.join(" \\\\\n"))
}

fn form_of(pool: &mut Pool, r: &Region, e: &Explicit, text: &mut String) {
    if r.states.is_empty() && e.inputs.is_empty() {
        return;
    }
    text.push_str("\\begin{equation*}\n\\dot{x} = (J - R)\\,\\nabla H + (G - P)\\,u, \\qquad y = (G + P)^{\\mathsf T}\\,\\nabla H + (M + S)\\,u\n\\end{equation*}\n");
    let states: Vec<String> = r.states.iter().map(|s| s.name.clone()).collect();
    let mut vectors = Vec::new();
    for (letter, names) in [("x", &states), ("u", &e.inputs), ("y", &e.outputs)] {
        if !names.is_empty() {
            vectors.push(format!("{letter} &= {}", column(pool, names)));
        }
    }
    let _ = write!(text, "\\begin{{align*}}\n{}\n\\end{{align*}}\n", vectors.join(", &\n"));
    let mut parts = Vec::new();
    for (letter, m) in [("J", &e.j), ("R", &e.r), ("G", &e.g), ("P", &e.p), ("M", &e.m), ("S", &e.s)] {
        if !m.entries.is_empty() {
            parts.push(format!("{letter} &= {}", body(pool, m)));
        } else if !m.rows.is_empty() && !m.columns.is_empty() {
            parts.push(format!("{letter} &= 0"));
        }
    }
    if !parts.is_empty() {
        let _ = write!(text, "\\begin{{align*}}\n{}\n\\end{{align*}}\n", parts.join(" \\\\\n"));
    }
}

/// What is too large for matrices, state by state.
fn equations(model: &mut Model, form: &Form, r: &Region, names: &[String], text: &mut String) {
    let all = equation::equations(model, form, r, names);
    let pool = &mut model.pool;
    let mut lines = Vec::new();
    for (s, rate) in r.states.iter().zip(&all.rates) {
        let x = symbol(pool, &s.name);
        lines.push(format!("\\frac{{\\mathrm d}}{{\\mathrm dt}} {x} &= {}", name::formula(pool, *rate)));
    }
    for u in &all.unknowns {
        let left = if u.root { "0".to_string() } else { symbol(pool, &u.name) };
        lines.push(format!("{left} &= {}", name::formula(pool, u.law)));
    }
    aligned(&lines, text);
}

fn aligned(lines: &[String], text: &mut String) {
    // Pages break between blocks.
    for block in lines.chunks(20) {
        let _ = write!(text, "\\begin{{align*}}\n{}\n\\end{{align*}}\n", block.join(" \\\\\n"));
    }
}

/// Laws of sources and resistors.
fn laws(model: &mut Model, form: &Form, r: &Region, names: &[String], text: &mut String) {
    let mut lines: Vec<(String, Expr)> = Vec::new();
    for &c in &r.inputs {
        if let Role::Source(v) = form.column(c).role {
            lines.push((name::port(form, names, c).input, v));
        }
    }
    for (c, _) in &r.resistors {
        if let Some((left, right)) = name::resistor(model, form.column(*c).element) {
            lines.extend(left.split(", ").map(str::to_string).zip(right));
        }
    }
    let pool = &mut model.pool;
    let lines: Vec<String> = lines
        .into_iter()
        .map(|(left, right)| format!("{} &= {}", symbol(pool, &left), name::formula(pool, right)))
        .collect();
    aligned(&lines, text);
}
