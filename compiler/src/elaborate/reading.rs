//! Signals of elements, fields and bonds, with their units.

use super::{Elaborator, Mode, Typed, Unit};
use crate::expression::Symbol;
use crate::model::{BondId, ElementId, Kind, OnePort, Signal, Variable};
use crate::units::Dimension;
use bond_grammar::ast;
use bond_grammar::diagnostic::Diagnostic;
use bond_grammar::source::Span;

impl<'a> Elaborator<'a> {
    /// `arm.p1`, the state; `arm.p1.e`; `arm.H`.
    pub(super) fn field_signal(&mut self, field: usize, rest: &'a [ast::Segment], span: Span) -> Option<Typed> {
        let f = &self.fields[field];
        let name = f.name.clone();
        if let [port, rest @ ..] = rest
            && let Some(place) = f.ports.iter().position(|p| *p == port.name.text)
        {
            let id = f.members[place];
            let kind = self.elements[id.at()].kind;
            if !rest.is_empty() || self.mode == Mode::Constant || !kind.is_storage() {
                return self.element_signal(id, rest, span);
            }
            return self.state_signal(id);
        }
        let first = f.members.first().copied()?;
        if let [h] = rest
            && h.name.text == "H"
            && self.elements[first.at()].kind.is_storage()
        {
            return self.element_signal(first, rest, span);
        }
        let list = f.ports.join(", ");
        self.wrong(
            "elaborate::signal",
            span,
            format!("`{}` is no signal", self.sources.slice(span)),
            &format!("`{name}` is a field: name one of its ports, {list}, and then .e or .f"),
        )
    }

    /// The state of a storage.
    pub(super) fn state_signal(&mut self, id: ElementId) -> Option<Typed> {
        let bond = self.bonds_of.get(id.at()).and_then(|b| b.first().copied())?;
        let symbol = self.signal(Signal::State(id));
        let d = self.domain_of[bond.at()];
        let is_c = self.elements[id.at()].kind == Kind::C;
        let other = if is_c { Unit::flow(d) } else { Unit::effort(d) };
        Some(Typed { expr: self.pool.var(symbol), unit: other.mul(&Unit::known(Dimension::SECOND)) })
    }

    pub(super) fn element_signal(&mut self, id: ElementId, rest: &'a [ast::Segment], span: Span) -> Option<Typed> {
        let decl = &self.elements[id.at()];
        let (name, kind) = (decl.name.clone(), decl.kind);
        if self.mode == Mode::Constant {
            return self.wrong(
                "elaborate::constant",
                span,
                format!("a signal of `{name}` is not known before the run"),
                "use parameters and numbers only",
            );
        }
        let words: Vec<&str> = rest.iter().map(|s| s.name.text.as_str()).collect();
        let bond = self.bonds_of.get(id.at()).and_then(|b| b.first().copied());
        match (kind, &words[..]) {
            (Kind::C, ["q"]) | (Kind::I, ["p"]) if decl.field.is_none() => self.state_signal(id),
            (Kind::OnePort(OnePort::Storage(_)), ["H"]) => {
                let bond = bond?;
                let found = self.energy(id);
                if found.is_none() && self.asked.is_empty() && std::mem::take(&mut self.circular) {
                    return self.wrong(
                        "elaborate::energy",
                        span,
                        format!("the energy of `{name}` depends on itself"),
                        "a storage's energy depends on its own state and on parameters: write it with these",
                    );
                }
                let expr = found?;
                Some(Typed { expr, unit: self.energy_unit(bond) })
            }
            (Kind::TwoPort(_), [side @ ("in" | "out"), _]) => {
                let inward = *side == "in";
                let found =
                    self.bonds_of.get(id.at())?.iter().copied().find(|b| (self.bonds[b.at()].head == id) == inward);
                self.bond_signal(found, &format!("{name}.{side}"), &rest[1..], span)
            }
            (Kind::ZERO, ["e"]) | (Kind::ONE, ["f"]) | (Kind::OnePort(_), ["e" | "f" | "P"]) => {
                self.bond_signal(bond, &name, rest, span)
            }
            _ => {
                if words.is_empty()
                    && let Some(said) = self.within_unit(self.sources.slice(span), span)
                {
                    self.errors.extend(said);
                    return None;
                }
                let has = self.described(id, kind);
                let itself = words.is_empty() && self.owner == Some(id);
                let asked = if itself {
                    format!("the value of `{name}` names `{name}` itself")
                } else if words.is_empty() {
                    format!("`{name}` is an element, not a signal")
                } else {
                    format!("`{name}` has no signal `.{}`", words.join("."))
                };
                let decl = self.elements[id.at()].span;
                self.errors.push(
                    Diagnostic::error("elaborate::signal", span, asked).label(decl, "is declared here").help(
                        match itself {
                            true => {
                                "write its number with a unit; or declare a parameter by another name, and give it that"
                                    .to_string()
                            }
                            // Of what moves, how far.
                            false
                                if matches!(
                                    words[..],
                                    ["x" | "pos" | "position" | "angle" | "phi" | "theta" | "q"]
                                ) && kind.integral() != Some(Variable::Effort)
                                    && matches!(kind, Kind::OnePort(_) | Kind::ONE) =>
                            {
                                format!("how far it moves is `integral({name}.f, 0)`; it has {has}")
                            }
                            false => format!("it has {has}"),
                        },
                    ),
                );
                None
            }
        }
    }

    /// What signals an element has, and what they are.
    fn described(&self, id: ElementId, kind: Kind) -> String {
        const PAIR: &str = ".e (its effort: force, torque, voltage, pressure), .f (its flow: speed, current, volume flow), \
            .P (power into it)";
        // The elements that hang on it by one bond.
        let of_bonds = |letter: char| {
            let bonds = self.bonds_of.get(id.at()).map_or(&[][..], Vec::as_slice);
            let ends = bonds.iter().map(|b| &self.bonds[b.at()]).map(|b| if b.head == id { b.tail } else { b.head });
            let names =
                ends.filter_map(|end| self.elements.get(end.at())).filter(|e| matches!(e.kind, Kind::OnePort(_)));
            let names: Vec<String> = names.take(3).map(|e| format!("`{}.{letter}`", e.name)).collect();
            if names.is_empty() { String::new() } else { format!(", such as {}", names.join(", ")) }
        };
        match kind {
            Kind::OnePort(OnePort::Storage(_)) if self.elements[id.at()].field.is_some() => {
                "the state under its own name, and .e .f .P".to_string()
            }
            Kind::OnePort(OnePort::Storage(Variable::Effort)) => {
                format!("{PAIR}, .q (its state: displacement, charge, volume) and .H (energy)")
            }
            Kind::OnePort(OnePort::Storage(Variable::Flow)) => {
                format!("{PAIR}, .p (its state: momentum, flux) and .H (energy)")
            }
            Kind::OnePort(_) => PAIR.to_string(),
            Kind::Junction(Variable::Effort) => {
                format!(".e, its common effort; the flows are those of its bonds{}", of_bonds('f'))
            }
            Kind::Junction(Variable::Flow) => {
                format!(".f, its common flow; the efforts are those of its bonds{}", of_bonds('e'))
            }
            Kind::TwoPort(_) => ".in.e .in.f .in.P .out.e .out.f .out.P".to_string(),
        }
    }

    pub(super) fn bond_signal(
        &mut self,
        bond: Option<BondId>,
        name: &str,
        rest: &'a [ast::Segment],
        span: Span,
    ) -> Option<Typed> {
        if self.mode == Mode::Constant {
            return self.wrong(
                "elaborate::constant",
                span,
                format!("a signal of `{name}` is not known before the run"),
                "use parameters and numbers only",
            );
        }
        let bond = bond?;
        let d = self.domain_of[bond.at()];
        let words: Vec<&str> = rest.iter().map(|s| s.name.text.as_str()).collect();
        let (effort, flow) = (Unit::effort(d), Unit::flow(d));
        match words[..] {
            ["e"] => {
                let s = self.signal(Signal::Effort(bond));
                Some(Typed { expr: self.pool.var(s), unit: effort })
            }
            ["f"] => {
                let s = self.signal(Signal::Flow(bond));
                Some(Typed { expr: self.pool.var(s), unit: flow })
            }
            ["P"] => {
                let (e, f) = (self.signal(Signal::Effort(bond)), self.signal(Signal::Flow(bond)));
                let (e, f) = (self.pool.var(e), self.pool.var(f));
                Some(Typed { expr: self.pool.mul(e, f), unit: effort.mul(&flow) })
            }
            _ => self.wrong(
                "elaborate::signal",
                span,
                format!("`{}` is no signal", self.sources.slice(span)),
                &format!("`{name}` has .e .f .P"),
            ),
        }
    }

    /// Unit of H on a bond: joule on a true one.
    pub(crate) fn energy_unit(&self, bond: BondId) -> Unit {
        let d = self.domain_of[bond.at()];
        Unit::effort(d).mul(&Unit::flow(d)).mul(&Unit::known(Dimension::SECOND))
    }

    /// The symbol of a signal.
    pub(crate) fn signal(&mut self, signal: Signal) -> Symbol {
        if let Some(s) = self.symbol_of.get(&signal) {
            return *s;
        }
        let name = match signal {
            Signal::Time => "t".to_string(),
            Signal::Effort(b) => format!("{}.e", self.bond_word(b)),
            Signal::Flow(b) => format!("{}.f", self.bond_word(b)),
            Signal::State(id) => {
                let decl = &self.elements[id.at()];
                match (decl.field, decl.kind) {
                    (Some(_), _) => decl.name.clone(),
                    (None, Kind::I) => format!("{}.p", decl.name),
                    (None, _) => format!("{}.q", decl.name),
                }
            }
            Signal::Integral(i) => format!("integral[{i}]"),
            Signal::Input(i) => self.numbers.input(i).to_string(),
            Signal::Slope(i) => format!("slope({})", self.numbers.input(i)),
            Signal::Memory(i) => self.numbers.memory(i).to_string(),
            Signal::Delay(i) => self.delays[i].name(i),
            Signal::Argument(id) => self.elements[id.at()].name.clone(),
            Signal::Parameter(id) => format!("{}.s", self.elements[id.at()].name),
        };
        let symbol = self.pool.symbol(&name);
        self.signals.insert(symbol, signal);
        self.symbol_of.insert(signal, symbol);
        symbol
    }

    /// A bond named after the element at one of its ends, where only one of them can be meant.
    pub(super) fn bond_word(&self, b: BondId) -> String {
        let bond = &self.bonds[b.at()];
        for end in [bond.head, bond.tail] {
            let decl = &self.elements[end.at()];
            if self.bonds_of[end.at()].len() == 1 && !decl.kind.is_junction() {
                return decl.name.clone();
            }
        }
        bond.name.replace(' ', "")
    }
}
