//! Sources, `Se: e = v`, `Sf: f = v`.

use super::fields::Fields;
use crate::elaborate::{Elaborator, Unit};
use crate::expression::Expr;
use crate::model::{BondId, Kind};
use bond_grammar::ast;

impl<'a> Elaborator<'a> {
    /// The value of a source.
    pub(crate) fn source(&mut self, ast: &'a ast::Element, scope: usize, kind: Kind, bond: BondId) -> Option<Expr> {
        let (field, about) = if kind == Kind::SE { ("effort", "the effort") } else { ("flow", "the flow") };
        let fields = Fields::read(self, ast, field, &[field, if kind == Kind::SE { "e" } else { "f" }], &[])?;
        let value = fields.get(field).or_else(|| fields.get(&field[..1]))?;
        let typed = self.with_signals(value, scope)?;
        let d = self.bond_domain(bond);
        let needed = if kind == Kind::SE { Unit::effort(d) } else { Unit::flow(d) };
        self.require((&typed.unit, value.span), needed, None, format!("{about} of `{}`", ast.name.text), 0);
        self.finite(typed.expr, value, &ast.name.text)?;
        Some(typed.expr)
    }

    /// A constant must be a number that can be computed with.
    pub(super) fn finite(&mut self, value: Expr, ast: &ast::Expr, name: &str) -> Option<()> {
        match self.pool.constant(value) {
            Some(x) if !x.is_finite() => {
                let e = bond_grammar::diagnostic::Diagnostic::error(
                    "elaborate::value",
                    ast.span,
                    format!("the value of `{name}` is {x}"),
                );
                self.errors.push(e.help("it must be a finite number"));
                None
            }
            _ => Some(()),
        }
    }
}
