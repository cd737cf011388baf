//! Transformer, `e_in = v e_out, f_out = v f_in`, and gyrator, `e_in = v f_out, e_out = v f_in`.

use super::fields::Fields;
use crate::elaborate::{Elaborator, Inference};
use crate::expression::Expr;
use crate::model::{BondId, Kind};
use bond_grammar::ast;
use bond_grammar::diagnostic::Diagnostic;

impl<'a> Elaborator<'a> {
    /// The ratio of a transformer or gyrator.
    pub(crate) fn ratio(
        &mut self,
        ast: &'a ast::Element,
        scope: usize,
        kind: Kind,
        into: BondId,
        out: BondId,
    ) -> Option<Expr> {
        let fields = Fields::read(self, ast, "ratio", &["ratio"], &[])?;
        let value = fields.get("ratio")?;
        let typed = self.with_signals(value, scope)?;
        let (i, o) = (self.bond_domain(into), self.bond_domain(out));
        let (first, second) = match kind {
            Kind::Gy => (Inference::effort(i).div(&Inference::flow(o)), Inference::effort(o).div(&Inference::flow(i))),
            _ => (Inference::effort(i).div(&Inference::effort(o)), Inference::flow(o).div(&Inference::flow(i))),
        };
        let about = format!("the ratio of `{}`", ast.name.text);
        self.require((&typed.unit, value.span), first, None, about.clone(), 2);
        self.require((&typed.unit, value.span), second, None, about, 2);
        self.finite(typed.expr, value, &ast.name.text)?;
        if self.pool.is_zero(typed.expr) || self.pool.constant(typed.expr) == Some(0.0) {
            self.errors.push(
                Diagnostic::error("elaborate::value", value.span, format!("the ratio of `{}` is 0", ast.name.text))
                    .help("a ratio of 0 cuts the bond: take the element out"),
            );
            return None;
        }
        Some(typed.expr)
    }
}
