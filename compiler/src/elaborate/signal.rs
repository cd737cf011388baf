//! Signals that no bond carries: `input`s, given from outside, and signal states, which controllers remember with.

use super::{Elaborator, Entity, Mode, ScopeId, Typed, Unit};
use crate::model::{Input, Memory, Signal};
use crate::units::Dimension;
use bond_grammar::ast::{Expr, Field, Name};
use bond_grammar::diagnostic::Diagnostic;
use bond_grammar::source::Span;

/// What a signal starts with: its unit, and the number in SI; `None` where that is wrong, which is said.
type Start = Option<(Unit, f64)>;

/// `input u = value`
pub(super) struct Given<'a> {
    pub(super) name: String,
    pub(super) span: Span,
    value: &'a Expr,
    scope: ScopeId,
    start: Option<Start>,
}

/// `state z = z0 { dz = law }`
pub(super) struct Remembered<'a> {
    pub(super) name: String,
    short: &'a str,
    span: Span,
    value: &'a Expr,
    fields: &'a [Field],
    scope: ScopeId,
    sampling: Option<usize>,
    start: Option<Start>,
}

impl<'a> Elaborator<'a> {
    /// Declares an input.
    pub(super) fn input(&mut self, name: &'a Name, value: &'a Expr, scope: ScopeId) {
        if self.declare_signal(scope, name, Entity::Input(self.inputs.len())) {
            let full = self.full_name(self.scopes[scope].instance, &self.looped(scope, &name.text));
            self.inputs.push(Given { name: full, span: name.span, value, scope, start: None });
        }
    }

    /// Declares a signal state.
    pub(super) fn memory(
        &mut self,
        name: &'a Name,
        value: &'a Expr,
        fields: &'a [Field],
        scope: ScopeId,
        sampling: Option<usize>,
    ) {
        if self.declare_signal(scope, name, Entity::Memory(self.memories.len())) {
            let full = self.full_name(self.scopes[scope].instance, &self.looped(scope, &name.text));
            let (short, span) = (name.text.as_str(), name.span);
            self.memories.push(Remembered { name: full, short, span, value, fields, scope, sampling, start: None });
        }
    }

    /// An input as it stands in a value.
    pub(super) fn input_value(&mut self, i: usize, at: Span) -> Option<Typed> {
        self.known_later(&self.inputs[i].name.clone(), at)?;
        let start = match &self.inputs[i].start {
            Some(start) => start.clone(),
            None => {
                let start = self.start(self.inputs[i].value, self.inputs[i].scope, 2 * i);
                self.inputs[i].start.insert(start).clone()
            }
        };
        let symbol = self.signal(Signal::Input(i));
        Some(Typed { expr: self.pool.var(symbol), unit: start?.0 })
    }

    /// A signal state as it stands in a value.
    pub(super) fn memory_value(&mut self, i: usize, at: Span) -> Option<Typed> {
        self.known_later(&self.memories[i].name.clone(), at)?;
        let start = match &self.memories[i].start {
            Some(start) => start.clone(),
            None => {
                let start = self.start(self.memories[i].value, self.memories[i].scope, 2 * i + 1);
                self.memories[i].start.insert(start).clone()
            }
        };
        let symbol = self.signal(Signal::Memory(i));
        Some(Typed { expr: self.pool.var(symbol), unit: start?.0 })
    }

    fn known_later(&mut self, name: &str, at: Span) -> Option<()> {
        if self.mode != Mode::Constant {
            return Some(());
        }
        let e = Diagnostic::error("elaborate::constant", at, format!("`{name}` is not known before the run"));
        self.errors.push(e.help("use parameters and numbers only"));
        None
    }

    /// What the signal with this number starts with. The literal 0 leaves its unit to be inferred.
    fn start(&mut self, value: &'a Expr, scope: ScopeId, number: usize) -> Start {
        let locals = std::mem::take(&mut self.locals);
        let typed = self.with_constants(value, scope);
        self.locals = locals;
        let typed = typed?;
        let x = self.number(&typed, value)?;
        if !x.is_finite() {
            let e = Diagnostic::error("elaborate::value", value.span, format!("this is {x}"));
            self.errors.push(e.help("it must be a finite number"));
            return None;
        }
        let unit = if typed.unit == Unit::Any { Unit::signal(number) } else { typed.unit };
        Some((unit, x))
    }

    /// All inputs, each with its unit as far as it is known.
    pub(super) fn make_inputs(&mut self) -> Vec<(Input, Unit)> {
        self.mode = Mode::Signals;
        let mut list = Vec::new();
        for i in 0..self.inputs.len() {
            let (name, span) = (self.inputs[i].name.clone(), self.inputs[i].span);
            if self.input_value(i, span).is_none() {
                continue;
            }
            let Some(Some((unit, value))) = self.inputs[i].start.clone() else { continue };
            let (symbol, slope) = (self.signal(Signal::Input(i)), self.signal(Signal::Slope(i)));
            list.push((Input { name, symbol, slope, unit: None, value, span }, unit));
        }
        list
    }

    /// All signal states with their laws, each with its unit as far as it is known.
    pub(super) fn make_memories(&mut self) -> Vec<(Memory, Unit)> {
        (0..self.memories.len()).filter_map(|i| self.make_memory(i)).collect()
    }

    fn make_memory(&mut self, i: usize) -> Option<(Memory, Unit)> {
        self.mode = Mode::Signals;
        let (name, span, sampling) = (self.memories[i].name.clone(), self.memories[i].span, self.memories[i].sampling);
        let known = self.memory_value(i, span);
        let law = self.memory_law(i)?;
        self.mode = Mode::Signals;
        let typed = self.express(law, self.memories[i].scope)?;
        let unit = known?.unit;
        let (needed, about) = match sampling {
            None => (unit.div(&Unit::known(Dimension::SECOND)), "the rate of"),
            Some(_) => (unit.clone(), "the next value of"),
        };
        self.require(
            (&typed.unit, law.span),
            needed,
            Some(self.memories[i].value.span),
            format!("{about} `{name}`"),
            2,
        );
        let Some(Some((_, start))) = self.memories[i].start else { return None };
        let symbol = self.signal(Signal::Memory(i));
        Some((Memory { name, symbol, unit: None, start, law: typed.expr, sampling, span }, unit))
    }

    /// The field that says how a signal state moves: `dz`, or `next` in a `sampled` block.
    fn memory_law(&mut self, i: usize) -> Option<&'a Expr> {
        let m = &self.memories[i];
        let (fields, sampling, span) = (m.fields, m.sampling, m.span);
        let (name, own) = (m.name.clone(), format!("d{}", m.short));
        let (right, example) = match sampling {
            None => (own.clone(), format!("`{{ {own} = ... }}`, its rate per second")),
            Some(_) => ("next".to_string(), "`{ next = ... }`, its value an interval later".to_string()),
        };
        let is_rate = |text: &str| text == own || text == "dz";
        let mut found: Option<&'a Field> = None;
        for field in fields {
            let path = field.name();
            let fits = if sampling.is_none() { is_rate(&path) } else { path == "next" };
            let said = match (fits, found) {
                (true, None) => {
                    found = Some(field);
                    continue;
                }
                (true, Some(first)) => {
                    Diagnostic::error("elaborate::twice", field.span, format!("the law of `{name}` is given twice"))
                        .label(first.span, "is the first")
                        .help("keep one")
                }
                (false, _) if sampling.is_none() && path == "next" => {
                    let what = format!("`{name}` is in no `sampled` block, and has no next value");
                    Diagnostic::error("elaborate::state", field.span, what)
                        .help(format!("give {example}; or put it into `sampled at 1 kHz {{ ... }}`"))
                }
                (false, _) if sampling.is_some() && is_rate(&path) => {
                    let what = format!("`{name}` is in a `sampled` block, and changes only from sample to sample");
                    let e = Diagnostic::error("elaborate::state", field.span, what)
                        .help(format!("give {example}, such as `next = {name} + T*rate` with the period T; or take it out of the block"));
                    match sampling.and_then(|s| self.samplings.get(s)) {
                        Some(s) => e.label(s.span, "is the block's clock"),
                        None => e,
                    }
                }
                (false, _) => {
                    let what = format!("the state `{name}` has no field `{path}`");
                    Diagnostic::error("elaborate::field", field.span, what).help(format!("it has `{right}`"))
                }
            };
            self.errors.push(said);
            return None;
        }
        if found.is_none() {
            let e = Diagnostic::error("elaborate::state", span, format!("the state `{name}` has no law"));
            self.errors.push(e.help(format!("give {example}")));
        }
        found.map(|f| &f.value)
    }
}
