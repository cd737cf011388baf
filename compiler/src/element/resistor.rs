//! Resistors: `e = r f`, `f = g e`, or a law that never gives power.

use super::fields::Fields;
use crate::elaborate::{Elaborator, Typed, Unit, told};
use crate::model::{BondId, Curve, ElementId, Resistor, Variable};
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
        let name = self.elements[id.at()].name.clone();
        if let Some(curve) = self.law_along(id, ast, scope, bond) {
            return curve;
        }
        let fields = Fields::read(self, ast, "resistance", &["resistance", "conductance", "e", "f"], &[])?;
        let d = self.bond_domain(bond);
        let (effort, flow) = (Unit::effort(d), Unit::flow(d));
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
                self.positive_constant(typed.expr, value, &name, what)?;
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
            self.locals.push((local.to_string(), Typed { expr: x, unit: own }));
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
            let what = if gives == Variable::Effort { "resistance" } else { "conductance" };
            self.errors.push(
                Diagnostic::error(
                    "elaborate::value",
                    place,
                    format!("negative {what}: that of `{name}` is {}", told(x)),
                )
                .help(format!("a resistor that gives power must say so: `active R:{}`", ast.name.text)),
            );
            return None;
        }
        let dissipative = self.pool.dissipative(output, argument);
        if dissipative == Some(false) && !ast.active {
            let at = self.pool.refuting(output).unwrap_or(f64::NAN);
            let (own, other) = (gives.letter(), gives.other().letter());
            let value = self.pool.eval(output, &|_| at);
            let message = format!(
                "the law of `{name}` gives power: at {other} = {} it says {own} = {}, in SI units, and e f is below 0",
                told(at),
                told(value)
            );
            // `f^2` pushes the same way in both directions.
            let square = format!("{other}^2");
            let even = match self.text(ast.span).contains(&square) {
                true => format!("against motion in both directions, `{square}` is written `{other}*abs({other})`; "),
                false => String::new(),
            };
            self.errors.push(Diagnostic::error("elaborate::law", place, message).help(format!(
                "{even}a resistor's law must satisfy e f >= 0; one that gives power must say so: `active R:{}`",
                ast.name.text
            )));
            return None;
        }
        Some(Resistor { argument, output, gives, written: gives, curve: None, row: None, linear, dissipative })
    }

    /// A law that is a curve, `{ e = ...; f = ... }` in a bare number `s`: an ideal diode, a switch, friction that
    /// sticks. Both must rise with `s` where they move. `None` where the law is none.
    fn law_along(
        &mut self,
        id: ElementId,
        ast: &'a ast::Element,
        scope: usize,
        bond: BondId,
    ) -> Option<Option<Resistor>> {
        let list = ast.fields.as_ref().map(|f| f.0.as_slice()).unwrap_or(&[]);
        let field = |name: &str| list.iter().find(|f| f.path.len() == 1 && f.path[0].text == name).map(|f| &f.value);
        let (e, f) = (field("e")?, field("f")?);
        if list.len() != 2 {
            return None; // what is too much is said by the fields
        }
        Some(self.curve_law(id, ast, scope, bond, (e, f)))
    }

    fn curve_law(
        &mut self,
        id: ElementId,
        ast: &'a ast::Element,
        scope: usize,
        bond: BondId,
        (e, f): (&'a ast::Expr, &'a ast::Expr),
    ) -> Option<Resistor> {
        let name = ast.name.text.clone();
        let d = self.bond_domain(bond);
        let parameter = self.signal(crate::model::Signal::Parameter(id));
        let s = Typed { expr: self.pool.var(parameter), unit: crate::elaborate::Unit::one() };
        self.locals.push(("s".to_string(), s));
        let (effort, flow) = (self.with_signals(e, scope), self.with_signals(f, scope));
        self.locals.pop();
        let (effort, flow) = (effort?, flow?);
        self.require((&effort.unit, e.span), Unit::effort(d), None, format!("the effort of `{name}`"), 2);
        self.require((&flow.unit, f.span), Unit::flow(d), None, format!("the flow of `{name}`"), 2);
        let (effort, flow) = (effort.expr, flow.expr);
        let mut verdict = Some(true);
        for (what, x) in [("effort", effort), ("flow", flow)] {
            if !self.pool.contains(x, parameter) {
                self.errors.push(
                    Diagnostic::error("elaborate::curve", ast.span, format!("the {what} of `{name}` does not depend on `s`"))
                        .help("give both e and f in the bare number `s`, which runs along the curve; or one of them, in the other"),
                );
                return None;
            }
            match self.pool.dissipative(x, parameter) {
                // Both have the sign of s: so the product is not negative.
                Some(true) => {}
                None => verdict = None,
                Some(false) => {
                    verdict = None;
                }
            }
        }
        if verdict.is_none() {
            let power = self.pool.mul(effort, flow);
            let known = self.pool.symbols(power).iter().all(|x| *x == parameter);
            let sizes = [1e-6, 1e-3, 0.1, 0.5, 1.0, 1.5, 3.0, 10.0, 1e3, 1e6];
            let mut places = sizes.iter().flat_map(|x| [*x, -*x]).filter(|_| known);
            let gives = places.find(|x| {
                let p = self.pool.eval(power, &|_| *x);
                p < 0.0 && p.is_finite()
            });
            if let Some(at) = gives.filter(|_| !ast.active) {
                let message = format!("the law of `{name}` gives power: at s = {} e f is below 0", told(at));
                self.errors.push(
                    Diagnostic::error("elaborate::law", ast.span, message)
                        .help("both e and f must have the sign of `s`, or be 0"),
                );
                return None;
            }
        }
        let argument = self.argument(id);
        let curve = Some(Curve { parameter, effort, flow });
        let output = self.pool.var(argument);
        Some(Resistor {
            argument,
            output,
            gives: Variable::Effort,
            written: Variable::Effort,
            curve,
            row: None,
            linear: None,
            dissipative: verdict,
        })
    }
}
