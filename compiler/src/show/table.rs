//! Text in aligned columns, and matrices with the names of their rows and columns.

use super::matrix::Matrix;
use super::name;
use super::size::SIZES;
use crate::expression::Pool;
use std::fmt::Write;

fn width(text: &str) -> usize {
    text.chars().count()
}

/// Lines of cells, each column as wide as its widest cell, two spaces between, the whole indented.
pub(super) fn lines(indent: usize, rows: &[Vec<String>]) -> String {
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0);
    let widths: Vec<usize> =
        (0..columns).map(|j| rows.iter().filter_map(|r| r.get(j)).map(|c| width(c)).max().unwrap_or(0)).collect();
    let mut text = String::new();
    for row in rows {
        let mut line = " ".repeat(indent);
        for (cell, w) in row.iter().zip(&widths) {
            line.push_str(cell);
            // an empty column takes no room
            line.push_str(&" ".repeat(if *w == 0 { 0 } else { w - width(cell) + 2 }));
        }
        text.push_str(line.trim_end());
        text.push('\n');
    }
    text
}

/// A matrix as a table, or the list of its entries where it is large. Zeros are dots.
pub(super) fn matrix(pool: &Pool, title: &str, m: &Matrix) -> String {
    let shape = (m.rows.len(), m.columns.len());
    if m.entries.is_empty() {
        return format!("  {title} = 0 ({} x {})\n", shape.0, shape.1);
    }
    if shape.0 > SIZES.table || shape.1 > SIZES.table {
        let mut text = format!("  {title} ({} x {}), entries that are not 0\n", shape.0, shape.1);
        let rows: Vec<Vec<String>> = m
            .entries
            .iter()
            .map(|(i, j, e)| vec![m.rows[*i].clone(), m.columns[*j].clone(), name::expression(pool, *e)])
            .collect();
        text.push_str(&lines(4, &rows));
        return text;
    }
    let mut cells = vec![vec![".".to_string(); shape.1]; shape.0];
    let mut below: Vec<String> = Vec::new();
    for (i, j, e) in &m.entries {
        let text = name::expression(pool, *e);
        cells[*i][*j] = if width(&text) <= SIZES.entry {
            text
        } else {
            let known = below.iter().position(|b| *b == text);
            let at = known.unwrap_or_else(|| {
                below.push(text);
                below.len() - 1
            });
            format!("<{}>", at + 1)
        };
    }
    let mut rows = vec![std::iter::once(String::new()).chain(m.columns.iter().cloned()).collect::<Vec<_>>()];
    for (row, name) in cells.into_iter().zip(&m.rows) {
        rows.push(std::iter::once(name.clone()).chain(row).collect());
    }
    let mut text = format!("  {title}\n{}", lines(4, &rows));
    for (i, b) in below.iter().enumerate() {
        let _ = writeln!(text, "    <{}> = {b}", i + 1);
    }
    text
}
