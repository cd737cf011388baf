//! Open ports of the scene: `port tip { inertia = m }`, at which a value is held, and `port hand { impedance = Z }`,
//! which carries waves: half a [line](super::line), the other half of which is in another program.

use crate::elaborate::{Elaborator, Unit};
use crate::model::{BondId, ElementId, Law};
use crate::units::Dimension;
use bond_grammar::ast;
use bond_grammar::diagnostic::Diagnostic;

impl<'a> Elaborator<'a> {
    /// The law of an open port with these fields.
    pub(crate) fn open_port(
        &mut self,
        id: ElementId,
        (fields, scope): (&'a [ast::Field], usize),
        bond: BondId,
    ) -> Option<Law> {
        let known = |f: &&ast::Field| ["inertia", "impedance"].contains(&f.name().as_str());
        for (i, field) in fields.iter().enumerate() {
            let name = field.name();
            if !known(&field) {
                let message = format!("a port has no field `{name}`");
                let help = "it has `inertia`, the least inertia that the outside has there, or `impedance`: then it carries waves";
                self.errors.push(Diagnostic::error("elaborate::field", field.span, message).help(help));
            } else if let Some(first) = fields[..i].iter().find(|f| f.name() == name) {
                let message = format!("`{name}` of the port is given twice");
                let error = Diagnostic::error("elaborate::twice", field.span, message);
                self.errors.push(error.label(first.span, "is the first").help("keep one"));
            } else if let Some(first) = fields[..i].iter().find(known) {
                let message = "a port has an inertia or an impedance, and not both";
                let error = Diagnostic::error("elaborate::field", field.span, message);
                let help =
                    "keep `impedance` where another program is at the other end, and `inertia` where a device is";
                self.errors.push(error.label(first.span, "is the other one").help(help));
            }
        }
        let Some(field) = fields.iter().find(known) else { return Some(Law::Port(None)) };
        if field.name() == "impedance" {
            return self.wave_port(id, (field, scope), bond);
        }
        let value = self.with_constants(&field.value, scope)?;
        let d = self.bond_domain(bond);
        let needed = Unit::effort(d).div(&Unit::flow(d)).mul(&Unit::known(Dimension::SECOND));
        // What the elements say of the domain is believed before what is said of the outside.
        self.require((&value.unit, field.value.span), needed, None, "the inertia of the port", 3);
        let inertia = self.number(&value, &field.value)?;
        let name = self.elements[id.at()].name.clone();
        self.positive_constant(value.expr, &field.value, &name, "inertia")?;
        Some(Law::Port(Some(inertia)))
    }

    /// A port that carries waves: what comes in is told from outside.
    fn wave_port(&mut self, id: ElementId, (field, scope): (&'a ast::Field, usize), bond: BondId) -> Option<Law> {
        let z = self.with_constants(&field.value, scope)?;
        let d = self.bond_domain(bond);
        let (effort, flow) = (Unit::effort(d), Unit::flow(d));
        self.require((&z.unit, field.value.span), effort.div(&flow), None, "the impedance of the port", 3);
        self.number(&z, &field.value)?;
        let name = self.elements[id.at()].name.clone();
        self.positive_constant(z.expr, &field.value, &name, "impedance")?;
        let Some(block) = self.sampling else {
            let message = format!("`{name}` carries waves, and belongs to no `sampled` block");
            let help = format!(
                "declare it in one, `sampled at 1 kHz {{ port {name} {{ impedance = ... }} ... -> {name} }}`: a wave goes \
                 out in each of its periods"
            );
            self.errors.push(Diagnostic::error("elaborate::wave_port", field.span, message).help(help));
            return None;
        };
        let leaves = self.wave_into(id, bond, z.expr);
        let comes = self.leaving_wave((&name, leaves), effort, block, field.span);
        Some(Law::Resistor(self.half_line(id, z.expr, comes)))
    }
}
