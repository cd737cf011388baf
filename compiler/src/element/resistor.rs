//! Resistors: `e = r f`, `f = g e`, or a law that never gives power.

use super::fields::Fields;
use crate::elaborate::{Elaborator, Inference, Typed};
use crate::model::{BondId, ElementId, Resistor, Variable};
use bond_grammar::ast;
use bond_grammar::diagnostic::Diagnostic;

impl<'a> Elaborator<'a> {
    /// The law of a resistor.
    pub(crate) fn resistor(
        &mut self,
        id: ElementId,
        ast: &'a ast::Element,
        scope: usize,
        bond: BondId,
    ) -> Option<Resistor> {
        let name = ast.name.text.clone();
        let fields = Fields::read(self, ast, "resistance", &["resistance", "conductance", "e", "f"], &[])?;
        let d = self.bond_domain(bond);
        let (effort, flow) = (Inference::effort(d), Inference::flow(d));
        let argument = self.argument(id);
        let x = self.pool.var(argument);
        let (gives, output) = if let Some(value) = fields.get("resistance").or_else(|| fields.get("conductance")) {
            let resistance = fields.get("resistance").is_some();
            let typed = self.with_signals(value, scope)?;
            let (needed, what, gives) = if resistance {
                (effort.div(&flow), "resistance", Variable::Effort)
            } else {
                (flow.div(&effort), "conductance", Variable::Flow)
            };
            self.require((&typed.unit, value.span), needed, None, format!("the {what} of `{name}`"), 2);
            if !ast.active {
                self.positive_constant(typed.expr, value, &name, "resistance")?;
            }
            self.finite(typed.expr, value, &name)?;
            (gives, self.pool.mul(typed.expr, x))
        } else {
            let (field, value) = ["e", "f"].into_iter().find_map(|f| Some((f, fields.get(f)?)))?;
            let gives = if field == "e" { Variable::Effort } else { Variable::Flow };
            let (local, own, needed) = match gives {
                Variable::Effort => ("f", flow, effort),
                Variable::Flow => ("e", effort, flow),
            };
            self.locals.push((local, Typed { expr: x, unit: own }));
            let typed = self.with_signals(value, scope);
            self.locals.pop();
            let typed = typed?;
            self.require((&typed.unit, value.span), needed, None, format!("the law of `{name}`"), 2);
            (gives, typed.expr)
        };
        let place = ast.value.as_ref().map_or(ast.span, |v| v.span);
        let linear = self.pool.linear(output, argument).filter(|(_, rest)| self.pool.is_zero(*rest)).map(|l| l.0);
        if let Some(r) = linear
            && !ast.active
            && let Some(x) = self.pool.constant(r)
            && x < 0.0
        {
            self.errors.push(
                Diagnostic::error("elaborate::value", place, format!("negative resistance: that of `{name}` is {x}"))
                    .help(format!("a resistor that gives power must say so: `active R:{name}`")),
            );
            return None;
        }
        let dissipative = self.pool.dissipative(output, argument);
        if dissipative == Some(false) && !ast.active {
            self.errors.push(
                Diagnostic::error("elaborate::law", place, format!("the law of `{name}` gives power: there e f < 0"))
                    .help(format!(
                        "a resistor's law must satisfy e f >= 0; one that gives power must say so: `active R:{name}`"
                    )),
            );
            return None;
        }
        Some(Resistor { argument, output, gives, linear, dissipative })
    }
}
