//! `TL(a, b):line { impedance = Z; delay = T }`: a lossless line between two ports.
//!
//! Waves run both ways, (e + Z f) / (2 √Z) into the line at a port, f counted into it, and (e - Z f) / (2 √Z) out of
//! it; each comes out a delay later at the other port (the method of characteristics: Branin, Proc. IEEE 55, 1967). So
//! each port has the law f = (e - w) / Z, where w is e + Z f at the other port a delay ago.

use crate::elaborate::{Elaborator, Unit};
use crate::expression::{Expr, Symbol};
use crate::model::{BondId, ElementId, Resistor, Signal, Variable};
use crate::units::Dimension;
use bond_grammar::ast;
use bond_grammar::diagnostic::Diagnostic;

impl<'a> Elaborator<'a> {
    /// The laws of both ports of a line.
    pub(crate) fn line_laws(
        &mut self,
        ast: &'a ast::Element,
        scope: usize,
        field: usize,
        bonds: &[BondId],
    ) -> Option<Vec<Resistor>> {
        let (members, name) = (self.fields[field].members.clone(), self.fields[field].name.clone());
        let &[first, second] = bonds else { return None };
        let (z_ast, t_ast) = (self.of_line(ast, &name, "impedance")?, self.of_line(ast, &name, "delay")?);
        let z = self.with_constants(z_ast, scope);
        let time = self.with_constants(t_ast, scope);
        let (z, time) = z.zip(time)?;
        let units = bonds.iter().map(|b| self.bond_domain(*b)).map(|d| (Unit::effort(d), Unit::flow(d)));
        let units: Vec<(Unit, Unit)> = units.collect();
        let [(effort, flow), (other_effort, other_flow)] = &units[..] else { return None };
        let about = format!("the impedance of `{name}`");
        self.require((&z.unit, z_ast.span), effort.div(flow), None, about, 2);
        let about = format!("the effort at the second port of `{name}`");
        self.require((other_effort, ast.span), effort.clone(), None, about, 3);
        let about = format!("the flow at the second port of `{name}`");
        self.require((other_flow, ast.span), flow.clone(), None, about, 3);
        let about = format!("the delay of `{name}`");
        self.require((&time.unit, t_ast.span), Unit::known(Dimension::SECOND), None, about, 2);
        self.positive_constant(z.expr, z_ast, &name, "impedance")?;
        self.positive_constant(time.expr, t_ast, &name, "delay")?;
        self.number(&z, z_ast)?;
        let (time, z) = (self.number(&time, t_ast)?, z.expr);
        // What goes in at each port comes out at the other.
        let waves = [self.wave_into(members[1], second, z), self.wave_into(members[0], first, z)];
        let mut laws = Vec::new();
        for (member, wave) in members.iter().zip(waves) {
            let w = self.wave(wave, effort.clone(), time, t_ast.span)?;
            laws.push(self.half_line(*member, z, w));
        }
        Some(laws)
    }

    /// The wave that goes into a line at one of its ports: e + Z f, with f counted into it.
    pub(super) fn wave_into(&mut self, member: ElementId, bond: BondId, z: Expr) -> Expr {
        let (e, f) = (self.signal(Signal::Effort(bond)), self.signal(Signal::Flow(bond)));
        let (e, f) = (self.pool.var(e), self.pool.var(f));
        let zf = self.pool.mul(z, f);
        if self.bonds[bond.at()].head == member { self.pool.add(e, zf) } else { self.pool.sub(e, zf) }
    }

    /// The law of a port of a line, f = (e - w) / Z, where w comes out of it.
    pub(super) fn half_line(&mut self, member: ElementId, z: Expr, w: Symbol) -> Resistor {
        let argument = self.argument(member);
        let (e, w) = (self.pool.var(argument), self.pool.var(w));
        let off = self.pool.sub(e, w);
        let output = self.pool.div(off, z);
        Resistor {
            argument,
            output,
            gives: Variable::Flow,
            written: Variable::Flow,
            curve: None,
            row: None,
            linear: None,
            dissipative: None,
        }
    }

    /// A field of a line, which must have it, and no others than `impedance` and `delay`.
    fn of_line(&mut self, ast: &'a ast::Element, name: &str, wanted: &str) -> Option<&'a ast::Expr> {
        let example = "write `TL(a, b):line { impedance = 50 Ohm; delay = 10 ns }`";
        let list = ast.fields.as_ref().map_or(&[][..], |f| f.0.as_slice());
        let known = |f: &ast::Field| f.path.len() == 1 && matches!(f.path[0].text.as_str(), "impedance" | "delay");
        if let Some(f) = list.iter().find(|f| !known(f)) {
            let message = format!("`{name}` (a `TL`) has no field `{}`", f.name());
            self.errors.push(Diagnostic::error("elaborate::field", f.span, message).help(example));
            return None;
        }
        let mut found = list.iter().filter(|f| f.path[0].text == wanted);
        let Some(first) = found.next() else {
            let message = format!("`{name}` (a `TL`) has no {wanted}");
            let span = ast.value.as_ref().map_or(ast.name.span, |v| v.span);
            self.errors.push(Diagnostic::error("elaborate::value", span, message).help(example));
            return None;
        };
        if let Some(second) = found.next() {
            let message = format!("the {wanted} of `{name}` is given twice");
            self.errors.push(Diagnostic::error("elaborate::twice", second.span, message).help("keep one"));
            return None;
        }
        Some(&first.value)
    }
}
