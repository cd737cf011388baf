//! Transformer, `e_in = v e_out, f_out = v f_in`, and gyrator, `e_in = v f_out, e_out = v f_in`.

use super::fields::Fields;
use crate::elaborate::{Elaborator, Typed, Unit};
use crate::expression::Expr;
use crate::model::{BondId, ElementId, TwoPort};
use bond_grammar::ast;
use bond_grammar::diagnostic::Diagnostic;

impl<'a> Elaborator<'a> {
    /// The ratio of a transformer or gyrator.
    pub(crate) fn ratio(
        &mut self,
        id: ElementId,
        (ast, scope): (&'a ast::Element, usize),
        kind: TwoPort,
        into: BondId,
        out: BondId,
    ) -> Option<Expr> {
        let name = self.elements[id.at()].name.clone();
        let (value, typed, help) = match self.cell(scope) {
            Some((which, row, column)) => {
                let rows = self.matrix_of(which)?;
                let typed = rows.get(row)?.get(column)?.clone();
                let value =
                    written_entry(Fields::read(self, ast, "matrix", &["matrix"], &[])?.get("matrix")?, row, column);
                (value, typed, "write that entry as `0`, which has no bond")
            }
            None => {
                let fields = Fields::read(self, ast, "ratio", &["ratio"], &[])?;
                let value = fields.get("ratio")?;
                (value, self.with_signals(value, scope)?, "a ratio of 0 cuts the bond: take the element out")
            }
        };
        let (i, o) = (self.bond_domain(into), self.bond_domain(out));
        let (first, second) = match kind {
            TwoPort::Gyrator => (Unit::effort(i).div(&Unit::flow(o)), Unit::effort(o).div(&Unit::flow(i))),
            TwoPort::Transformer => (Unit::effort(i).div(&Unit::effort(o)), Unit::flow(o).div(&Unit::flow(i))),
        };
        let about = format!("the ratio of `{name}`");
        self.require((&typed.unit, value.span), first, None, about.clone(), 2);
        self.require((&typed.unit, value.span), second, None, about, 2);
        self.finite(typed.expr, value, &name)?;
        if self.pool.is_zero(typed.expr) || self.pool.constant(typed.expr) == Some(0.0) {
            self.errors.push(
                Diagnostic::error("elaborate::value", value.span, format!("the ratio of `{name}` is 0")).help(help),
            );
            return None;
        }
        Some(typed.expr)
    }

    /// Makes the matrix of a two-port, by its rows, and looks at its size and at what it must be.
    pub(crate) fn make_matrix(&mut self, which: usize) -> Option<Vec<Vec<Typed>>> {
        let it = &self.two_ports[which];
        let (ast, scope, name, size, skew) = (it.ast, it.scope, it.name.clone(), it.size(), it.is_skew());
        let fields = Fields::read(self, ast, "matrix", &["matrix"], &[])?;
        let value = fields.get("matrix")?;
        let rows = self.matrix(value, scope)?;
        let found = (rows.len(), rows.first().map_or(0, Vec::len));
        if found != size {
            let message = format!(
                "the matrix of `{name}` is one of {} by {}, and one of {} by {} is needed",
                found.0, found.1, size.0, size.1
            );
            let help = match &ast.ports[..] {
                [a, b] => format!(
                    "it has a row for each entry of `{}`, and a column for each of `{}`",
                    b.name.text, a.name.text
                ),
                _ => "it has a row and a column for each entry of the bundle".to_string(),
            };
            self.errors.push(Diagnostic::error("elaborate::matrix", value.span, message).help(help));
            return None;
        }
        if !skew {
            return Some(rows);
        }
        for (i, row) in rows.iter().enumerate() {
            for (j, entry) in row.iter().enumerate().skip(i) {
                let sum = self.pool.add(entry.expr, rows[j][i].expr);
                if self.pool.is_zero(sum) {
                    continue;
                }
                let message = match i == j {
                    true => format!("the matrix of `{name}` is not skew: its entry [{0}, {0}] is not 0", i + 1),
                    false => format!(
                        "the matrix of `{name}` is not skew: its entries [{0}, {1}] and [{1}, {0}] are not opposite",
                        i + 1,
                        j + 1
                    ),
                };
                let (first, second) = (written_entry(value, i, j).span, written_entry(value, j, i).span);
                let mut error = Diagnostic::error("elaborate::matrix", second, message);
                if first != second {
                    error = error.label(first, "is the other entry");
                }
                self.errors.push(error.help(
                    "a gyrator takes no power, e^T f = 0: each entry is the other one across the diagonal with its sign \
                     changed, and those on the diagonal are 0; what takes power is an `R` with a matrix",
                ));
                return None;
            }
        }
        Some(rows)
    }
}

/// Where an entry is written, if the matrix is written out; else the matrix.
fn written_entry(matrix: &ast::Expr, row: usize, column: usize) -> &ast::Expr {
    if let ast::ExprKind::List(rows) = &matrix.kind
        && let Some(ast::ExprKind::List(entries)) = rows.get(row).map(|row| &row.kind)
        && let Some(entry) = entries.get(column)
    {
        return entry;
    }
    matrix
}
