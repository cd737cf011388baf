//! Signals that no bond carries: `input`s, given from outside or where a part is made, and signal states, which
//! controllers remember with.

use super::equation::Unknown;
use super::{Elaborator, Entity, Let, LetState, Mode, Param, ScopeId, Typed, Unit, Value};
use crate::expression::{Node, Symbol};
use crate::model::{Exchange, Exchanged, Input, Memory, Signal};
use crate::units::{Dimension, DisplayUnit};
use bond_grammar::ast::{Definition, Expr, Field};
use bond_grammar::diagnostic::Diagnostic;
use bond_grammar::source::Span;

/// What a signal starts with, each number with its unit, these numbers in SI, and the place of the first among all.
struct Start {
    value: Value,
    numbers: Vec<f64>,
    first: usize,
}

/// `input u = value`
pub(super) struct Given<'a> {
    pub(super) name: String,
    pub(super) span: Span,
    value: &'a Expr,
    scope: ScopeId,
    sampling: Option<usize>,
    start: Option<Start>,
    /// What is wrong with its start; told when the signal is first asked for.
    wrong: Vec<Diagnostic>,
}

/// `state z = z0 { dz = law }`
pub(super) struct Remembered<'a> {
    of: Given<'a>,
    short: &'a str,
    fields: &'a [Field],
}

/// What a part says of an input that its instance is given.
pub(super) struct Bound<'a> {
    /// Its default, which has the input's unit and shape.
    default: &'a Expr,
    scope: ScopeId,
    /// The entry of what is given that is meant: of an input with an index, or of a round, that of its own.
    entry: Vec<i64>,
}

/// An output of a `sampled` block that is read outside of it, and is not made of the block's states alone. What a
/// computer finds at a sample it gives at the next one, so that this is a signal state, which starts with 0.
pub(super) struct Held {
    /// The `let` that it is.
    of: usize,
    /// As it stands in a value.
    value: Value,
}

/// The names of all numbers of inputs and of signal states, those of arrays one by one.
#[derive(Default)]
pub(super) struct Numbers {
    inputs: Vec<String>,
    memories: Vec<String>,
    /// The `sampled` blocks of the signal states.
    samplings: Vec<Option<usize>>,
}

impl Numbers {
    /// The name of an input's number.
    pub(super) fn input(&self, i: usize) -> &str {
        self.inputs.get(i).map_or("", String::as_str)
    }

    /// The name of a signal state's number.
    pub(super) fn memory(&self, i: usize) -> &str {
        self.memories.get(i).map_or("", String::as_str)
    }
}

/// Which law a signal state has.
#[derive(Clone, Copy, PartialEq)]
enum Moves {
    /// `dz`
    Rate,
    /// `next`
    Next,
}

impl<'a> Elaborator<'a> {
    /// Declares an input: what the instance is given for it, or else a signal from outside.
    pub(super) fn input(&mut self, it: &'a Definition, scope: ScopeId, sampling: Option<usize>) {
        let instance = self.scopes[scope].instance;
        let (fields, caller, outside) = self.instances[instance].given;
        let given = fields.iter().find(|f| f.path.len() == 1 && f.path[0].text == it.name.text);
        let entity = match given {
            Some(_) => Entity::Let(self.lets.len()),
            None => Entity::Input(self.inputs.len()),
        };
        let Some(name) = self.declare_definition(scope, it, entity) else { return };
        let (full, span) = (self.full_name(instance, &name), it.name.span);
        let Some(given) = given else {
            let (value, start, wrong) = (&it.value, None, Vec::new());
            self.inputs.push(Given { name: full, span, value, scope, sampling, start, wrong });
            return;
        };
        // `u[2]`, `u[1,3]`
        let entry = name.split(['[', ',', ']']).skip(1).filter_map(|i| i.parse().ok()).collect();
        let input = Some(Box::new(Bound { default: &it.value, scope, entry }));
        self.exchanged.push((self.lets.len(), Exchange::Input));
        let (value, state) = (&given.value, LetState::New);
        self.lets.push(Let { value, scope: caller, sampling: outside, input, output: None, state, name: full });
    }

    /// Declares a signal state.
    pub(super) fn memory(&mut self, it: &'a Definition, fields: &'a [Field], scope: ScopeId, sampling: Option<usize>) {
        let Some(name) = self.declare_definition(scope, it, Entity::Memory(self.memories.len())) else { return };
        let name = self.full_name(self.scopes[scope].instance, &name);
        let (value, span, start, wrong) = (&it.value, it.name.span, None, Vec::new());
        let of = Given { name, span, value, scope, sampling, start, wrong };
        self.memories.push(Remembered { of, short: &it.name.text, fields });
    }

    /// What is given for an input of a part, where a `let` is one: it has the unit and the shape of the default.
    pub(super) fn bound(&mut self, l: usize, given: Value) -> Option<Value> {
        let Some(input) = &self.lets[l].input else { return Some(given) };
        let (default, scope, entry) = (input.default, input.scope, input.entry.clone());
        let (name, place) = (self.lets[l].name.clone(), self.lets[l].value.span);
        let given = match entry.is_empty() {
            true => given,
            false => {
                let plain = name.split('[').next().unwrap_or(&name).to_string();
                let indices: Vec<(i64, Span)> = entry.into_iter().map(|i| (i, place)).collect();
                if let Value::Scalar(_) = given {
                    let message = format!("`{plain}` is an input of each round, and is given one number");
                    let help = "give an array with an entry for each round, `[a, b, c]`";
                    return self.shape_error(place, message, help);
                }
                self.entry_at(given, &plain, &indices)?
            }
        };
        let mode = std::mem::replace(&mut self.mode, Mode::Constant);
        let wanted = self.value(default, scope);
        self.mode = mode;
        let wanted = wanted?;
        if wanted.shape() != given.shape() {
            let message = format!("the input `{name}` is {}, and is given {}", wanted.words(), given.words());
            let error = Diagnostic::error("elaborate::shape", place, message).label(default.span, "is its default");
            self.errors.push(error.help("give it what has the shape of its default"));
            return None;
        }
        given.zip(wanted, &mut |given, wanted| {
            let about = format!("what the input `{name}` is given");
            self.require((&given.unit, place), wanted.unit.clone(), Some(default.span), about, 2);
            Some(Typed { unit: if wanted.unit == Unit::Any { given.unit } else { wanted.unit }, ..given })
        })
    }

    /// Says of what a parameter is given that is not known before the run, how a signal is given to a part.
    pub(super) fn is_parameter(&mut self, p: usize, before: usize) {
        let Param { name, instance, span, value, given, .. } = &self.params[p];
        let own = name.rsplit('.').next().unwrap_or(name);
        let model = self.files.model(self.instances[*instance].model);
        let bundled = self.sources.get(span.source).name.starts_with("std/");
        let place = match (value, model, given) {
            (Some((value, _)), Some(model), true) => (value.span, &model.name.text),
            _ => return,
        };
        let text = self.sources.slice(*span);
        let default = model.and_then(|m| m.params.iter().find(|p| p.name.text == own)?.default.as_ref());
        let default = default.map_or("0", |d| self.sources.slice(d.span));
        let help = match bundled {
            true => format!("`{text}` of `{}` is a parameter: give numbers and parameters only", place.1),
            false => format!(
                "a part takes a signal as an input: take `{text}` out of the head of `{}`, and write `input {own} = \
                {default}` in its braces",
                place.1
            ),
        };
        let (at, declared) = (place.0, *span);
        for error in &mut self.errors[before..] {
            if error.code == "elaborate::constant" && error.labels.len() == 1 {
                let error_ = std::mem::replace(error, Diagnostic::error("elaborate::constant", at, String::new()));
                *error = error_.label(declared, "is a parameter, and known before the run").help(help.clone());
            }
        }
    }

    /// Numbers the signals in the order in which they are declared. Their starts are known before the run.
    pub(super) fn number_signals(&mut self) {
        let (inputs, memories) = (self.inputs.len(), self.memories.len());
        for (i, of_state) in (0..inputs).map(|i| (i, false)).chain((0..memories).map(|i| (i, true))) {
            let before = self.errors.len();
            let start = self.start(i, of_state);
            let wrong = self.errors.split_off(before);
            let it = self.given(i, of_state);
            (it.start, it.wrong) = (start, wrong);
            let span = it.value.span;
            let most = self.limits.values;
            if self.numbers.inputs.len() + self.numbers.memories.len() > most {
                let message = format!("the arrays of inputs and states have more than {most} numbers");
                let error = Diagnostic::error("elaborate::limit", span, message);
                self.errors.push(error.help("lower the bounds of the loops, or take entries out"));
                return;
            }
        }
    }

    /// The input, or the signal state, with this number.
    fn given(&mut self, i: usize, of_state: bool) -> &mut Given<'a> {
        if of_state { &mut self.memories[i].of } else { &mut self.inputs[i] }
    }

    /// What an input or a signal state starts with. The literal 0 leaves its unit to be inferred.
    fn start(&mut self, i: usize, of_state: bool) -> Option<Start> {
        let Given { value, scope, sampling, .. } = *self.given(i, of_state);
        let name = self.given(i, of_state).name.clone();
        self.sampling = sampling;
        let mode = std::mem::replace(&mut self.mode, Mode::Constant);
        let found = self.value(value, scope);
        (self.mode, self.sampling) = (mode, None);
        let found = found?;
        let mut indices: Vec<String> = found.leaves().into_iter().map(|(index, _)| index).rev().collect();
        let names = if of_state { &self.numbers.memories } else { &self.numbers.inputs };
        let (first, mut numbers) = (names.len(), Vec::new());
        let value = found.map(&mut |typed| {
            let x = self.number(&typed, value)?;
            if !x.is_finite() {
                let e = Diagnostic::error("elaborate::value", value.span, format!("this is {x}"));
                self.errors.push(e.help("it must be a finite number"));
                return None;
            }
            numbers.push(x);
            let name = format!("{name}{}", indices.pop().unwrap_or_default());
            let k = match of_state {
                true => self.remember(name, sampling),
                false => {
                    self.numbers.inputs.push(name);
                    self.numbers.inputs.len() - 1
                }
            };
            let own = Unit::signal(2 * k + usize::from(of_state));
            let unit = self.declared(typed.unit.clone(), Unknown::signal(2 * k + usize::from(of_state)), Some(value));
            Some(Typed { unit: if unit == Unit::Any { own } else { unit }, ..typed })
        })?;
        Some(Start { value, numbers, first })
    }

    /// Numbers a signal state.
    pub(super) fn remember(&mut self, name: String, sampling: Option<usize>) -> usize {
        self.numbers.memories.push(name);
        self.numbers.samplings.push(sampling);
        self.numbers.samplings.len() - 1
    }

    /// Whether a value stands still from sample to sample of a block, as the states of the block do.
    fn is_held(&self, value: &Value, sampling: Option<usize>) -> bool {
        let of_block = |s: Symbol| match self.signals.get(&s) {
            Some(Signal::Memory(k)) => self.numbers.samplings.get(*k) == Some(&sampling),
            _ => false,
        };
        value.leaves().iter().all(|(_, typed)| self.pool.symbols(typed.expr).into_iter().all(of_block))
    }

    /// An input as it stands in a value.
    pub(super) fn input_value(&mut self, i: usize, at: Span) -> Option<Value> {
        self.carried(i, false, at)
    }

    /// A signal state as it stands in a value.
    pub(super) fn memory_value(&mut self, i: usize, at: Span) -> Option<Value> {
        self.carried(i, true, at)
    }

    fn carried(&mut self, i: usize, of_state: bool, at: Span) -> Option<Value> {
        let name = self.given(i, of_state).name.clone();
        self.known_later(&name, at)?;
        let it = self.given(i, of_state);
        let start = it.start.as_ref().map(|start| (start.value.clone(), start.first));
        let mut wrong = std::mem::take(&mut it.wrong);
        self.errors.append(&mut wrong);
        let (value, first) = start?;
        let mut places = first..;
        value.map(&mut |typed| {
            let k = places.next()?;
            let symbol = self.signal(if of_state { Signal::Memory(k) } else { Signal::Input(k) });
            Some(Typed { expr: self.pool.var(symbol), ..typed })
        })
    }

    pub(super) fn known_later(&mut self, name: &str, at: Span) -> Option<()> {
        if self.mode != Mode::Constant {
            return Some(());
        }
        let e = Diagnostic::error("elaborate::constant", at, format!("`{name}` is not known before the run"));
        self.errors.push(e.help("use parameters and numbers only"));
        None
    }

    /// The numbers of an input or of a signal state, each with the index that it has in it, its symbol, its unit and
    /// what it starts with.
    fn numbers_of(&mut self, i: usize, of_state: bool) -> Option<Vec<(String, Symbol, Unit, f64)>> {
        self.mode = Mode::Signals;
        let span = self.given(i, of_state).span;
        let value = self.carried(i, of_state, span)?;
        let starts = self.given(i, of_state).start.as_ref().map(|start| start.numbers.clone())?;
        let leaves = value.leaves().into_iter().zip(starts);
        let of = |((index, typed), x): ((String, &Typed), f64)| match *self.pool.node(typed.expr) {
            Node::Symbol(symbol) => Some((index, symbol, typed.unit.clone(), x)),
            _ => None,
        };
        leaves.map(of).collect()
    }

    /// All inputs, each with its unit as far as it is known.
    pub(super) fn make_inputs(&mut self) -> Vec<(Input, Unit)> {
        let mut list = Vec::new();
        for i in 0..self.inputs.len() {
            let (name, span) = (self.inputs[i].name.clone(), self.inputs[i].span);
            for (index, symbol, unit, value) in self.numbers_of(i, false).unwrap_or_default() {
                let slope = self.signal(Signal::Slope(list.len()));
                list.push((Input { name: format!("{name}{index}"), symbol, slope, unit: None, value, span }, unit));
            }
        }
        list
    }

    /// All signal states with their laws, each with its unit as far as it is known.
    pub(super) fn make_memories(&mut self) -> Vec<(Memory, Unit)> {
        let all = (0..self.memories.len()).filter_map(|i| self.make_memory(i)).flatten().collect();
        self.sampling = None;
        all
    }

    fn make_memory(&mut self, i: usize) -> Option<Vec<(Memory, Unit)>> {
        let Given { span, sampling, scope, value: start, .. } = self.memories[i].of;
        let name = self.memories[i].of.name.clone();
        let known = self.numbers_of(i, true);
        let (law, moves) = self.memory_law(i)?;
        (self.mode, self.sampling) = (Mode::Signals, sampling);
        let value = self.value(law, scope)?;
        let (known, own) = (known?, self.memory_value(i, span)?);
        if value.shape() != own.shape() {
            let message = format!("the state `{name}` is {}, and its law is {}", own.words(), value.words());
            let error = Diagnostic::error("elaborate::shape", law.span, message).label(start.span, "is its start");
            self.errors.push(error.help("give the law an entry for each entry of the start"));
            return None;
        }
        let laws: Vec<Typed> = value.leaves().into_iter().map(|(_, typed)| typed.clone()).collect();
        let mut list = Vec::new();
        for (typed, (index, symbol, unit, start_value)) in laws.into_iter().zip(known) {
            let name = format!("{name}{index}");
            let (needed, about) = match moves {
                Moves::Rate => (unit.div(&Unit::known(Dimension::SECOND)), "the rate of"),
                Moves::Next => (unit.clone(), "the next value of"),
            };
            self.require((&typed.unit, law.span), needed, Some(start.span), format!("{about} `{name}`"), 2);
            let law = match (moves, sampling.and_then(|s| self.samplings.get(s))) {
                // What a sampled block reads is held from sample to sample, so that the rate is too.
                (Moves::Rate, Some(block)) => {
                    let period = self.pool.float(block.period);
                    let (own, change) = (self.pool.var(symbol), self.pool.mul(period, typed.expr));
                    self.pool.add(own, change)
                }
                (Moves::Rate | Moves::Next, _) => typed.expr,
            };
            list.push((Memory { name, symbol, unit: None, start: start_value, law, sampling, span }, unit));
        }
        Some(list)
    }

    /// An output of a `sampled` block as it stands in a value outside of the block.
    pub(super) fn held_value(&mut self, l: usize, at: Span) -> Option<Value> {
        let Let { sampling, scope, .. } = self.lets[l];
        let name = self.full_name(self.scopes[scope].instance, &self.lets[l].name);
        // Blocks may read each other's outputs: which shape this one has cannot be told while it is being worked out.
        let own = match self.lets[l].state {
            LetState::Open => None,
            LetState::New | LetState::Done(_) => {
                let outside = std::mem::replace(&mut self.sampling, sampling);
                let own = self.let_value(l, at);
                self.sampling = outside;
                let own = own?;
                if self.is_held(&own, sampling) {
                    return Some(own);
                }
                Some(own)
            }
        };
        if let Some(held) = self.held.iter().find(|held| held.of == l) {
            return Some(held.value.clone());
        }
        let zero = Typed { expr: self.pool.int(0), unit: Unit::Any };
        let own = own.unwrap_or(Value::Scalar(zero));
        let mut indices: Vec<String> = own.leaves().into_iter().map(|(index, _)| index).rev().collect();
        let value = own.map(&mut |_| {
            let k = self.remember(format!("{name}{}", indices.pop().unwrap_or_default()), sampling);
            let symbol = self.signal(Signal::Memory(k));
            Some(Typed { expr: self.pool.var(symbol), unit: Unit::signal(2 * k + 1) })
        })?;
        self.held.push(Held { of: l, value: value.clone() });
        Some(value)
    }

    /// The signal states that outputs of `sampled` blocks are outside of these.
    pub(super) fn make_held(&mut self) -> Vec<(Memory, Unit)> {
        let mut list = Vec::new();
        let mut made = 0;
        // To work one out may ask for others.
        while let Some(Held { of, value }) = self.held.get(made) {
            made += 1;
            let (l, held) = (*of, value.clone());
            let Let { sampling, value: law, output: Some(span), .. } = self.lets[l] else { continue };
            (self.mode, self.sampling) = (Mode::Signals, sampling);
            let own = self.let_value(l, span);
            self.sampling = None;
            let Some(own) = own else { continue };
            if own.shape() != held.shape() {
                let message = format!("`{}` is {}, and depends on itself", self.lets[l].name, own.words());
                let error = Diagnostic::error("elaborate::shape", law.span, message);
                self.errors.push(error.help("read its entries one by one: give each an output of its own"));
                continue;
            }
            let own: Vec<Typed> = own.leaves().into_iter().map(|(_, t)| t.clone()).collect();
            let held = held.leaves().into_iter().map(|(_, t)| t.clone()).collect::<Vec<_>>();
            for (own, held) in own.into_iter().zip(held) {
                let Node::Symbol(symbol) = *self.pool.node(held.expr) else { continue };
                let name = self.pool.name(symbol).to_string();
                self.require((&own.unit, law.span), held.unit.clone(), None, format!("the output `{name}`"), 3);
                let (start, law) = (0.0, own.expr);
                list.push((Memory { name, symbol, unit: None, start, law, sampling, span }, held.unit));
            }
        }
        list
    }

    /// The signals that parts are given and give, as far as they have been asked for with their units.
    pub(super) fn exchanges(&self, known: &dyn Fn(&Unit) -> Option<DisplayUnit>) -> Vec<Exchanged> {
        let of = |&(l, way): &(usize, Exchange)| {
            let it = &self.lets[l];
            let name = match way {
                Exchange::Input => it.name.clone(),
                Exchange::Output => self.full_name(self.scopes[it.scope].instance, &it.name),
            };
            let units = match &it.state {
                LetState::Done(Some(value)) => value.leaves().into_iter().map(|(_, t)| known(&t.unit)).collect(),
                LetState::Done(None) | LetState::New | LetState::Open => Vec::new(),
            };
            let unit = units.first().cloned().flatten().filter(|unit| units.iter().all(|u| u.as_ref() == Some(unit)));
            Exchanged { name, way, value: self.words(it.value), unit }
        };
        self.exchanged.iter().map(of).collect()
    }

    /// The field that says how a signal state moves: `dz`, or, in a `sampled` block alone, `next`.
    fn memory_law(&mut self, i: usize) -> Option<(&'a Expr, Moves)> {
        let m = &self.memories[i];
        let (fields, sampling, span) = (m.fields, m.of.sampling, m.of.span);
        let (name, own) = (m.of.name.clone(), format!("d{}", m.short));
        let (right, example) = match sampling {
            None => (own.clone(), format!("`{{ {own} = ... }}`, its rate per second")),
            Some(_) => ("next".to_string(), "`{ next = ... }`, its value an interval later".to_string()),
        };
        let is_rate = |text: &str| text == own || text == "dz";
        let mut found: Option<&'a Field> = None;
        for field in fields {
            let path = field.name();
            let fits = is_rate(&path) || sampling.is_some() && path == "next";
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
        found.map(|f| (&f.value, if f.name() == "next" { Moves::Next } else { Moves::Rate }))
    }
}
