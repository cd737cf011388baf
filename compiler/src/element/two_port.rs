//! Transformer, `e_in = v e_out, f_out = v f_in`, and gyrator, `e_in = v f_out, e_out = v f_in`.

use super::fields::Fields;
use crate::elaborate::{Elaborator, Unit};
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
        let fields = Fields::read(self, ast, "ratio", &["ratio"], &[])?;
        let value = fields.get("ratio")?;
        let typed = self.with_signals(value, scope)?;
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
                Diagnostic::error("elaborate::value", value.span, format!("the ratio of `{name}` is 0"))
                    .help("a ratio of 0 cuts the bond: take the element out"),
            );
            return None;
        }
        Some(typed.expr)
    }
}
