//! What the names in an expression mean: parameters, `let`s, inputs, states, time, and whatever a path leads to.

use super::angle::Declared;
use super::equation::Unknown;
use super::{Elaborator, Entity, Let, LetState, Mode, Param, ParamState, ScopeId, Sought, Typed, Unit, Value};
use crate::model::Signal;
use crate::units::{self, Dimension, Reading};
use bond_grammar::ast;
use bond_grammar::diagnostic::Diagnostic;
use bond_grammar::source::Span;

/// What a segment of a path is looked up for.
fn sought(path: &ast::Path, segment: usize) -> Sought {
    match (segment, path.segments.len()) {
        (0, 1) => Sought::Value,
        (0, _) => Sought::Element,
        _ => Sought::Part,
    }
}

impl<'a> Elaborator<'a> {
    pub(super) fn path(&mut self, path: &'a ast::Path, scope: ScopeId) -> Option<Value> {
        let first = &path.segments[0];
        // The pair of a port, in the law of a field: `a.f`.
        if let [port, variable] = &path.segments[..]
            && port.index.is_empty()
            && let Some((_, t)) = self
                .locals
                .iter()
                .rev()
                .find(|(n, _)| n.split_once('.') == Some((port.name.text.as_str(), variable.name.text.as_str())))
        {
            let found = t.clone();
            return self.no_entries(&path.segments[1..], path.span, found);
        }
        if path.segments.len() == 1
            && let Some(found) = self.local(first, path.span, scope)
        {
            return found;
        }
        // As far as the path leads through instances.
        let mut at = self.scopes[scope].instance;
        for (i, segment) in path.segments.iter().enumerate() {
            let builtin =
                i == 0 && segment.index.is_empty() && !self.instances[at].names.contains_key(&segment.name.text);
            if builtin {
                match segment.name.text.as_str() {
                    "t" if path.segments.len() == 1 => return self.time(path.span).map(Value::Scalar),
                    "period" if path.segments.len() == 1 => return Some(Value::Scalar(self.period())),
                    "pi" if path.segments.len() == 1 => {
                        // With it, turns become radians.
                        let unit = Unit::literal(Dimension::DIMENSIONLESS, Reading { radians: 0, certain: false });
                        return Some(Value::Scalar(Typed { expr: self.pool.pi(), unit }));
                    }
                    _ => {}
                }
            }
            let rest = &path.segments[i + 1..];
            if rest.is_empty()
                && let Some(entry) = self.indexed(at, segment, scope)
            {
                return entry;
            }
            if builtin && self.function(&segment.name.text, scope).is_some() {
                return self.no_call(&segment.name.text, path.span);
            }
            let (key, entity, _) = self.find(at, segment, scope, sought(path, i))?;
            match entity {
                Entity::Instance(inner) if !rest.is_empty() => at = inner,
                Entity::Bundle(bundle) => return self.bundle_value(at, (bundle, &key), rest, path.span),
                _ => return self.entity_value(entity, &key, rest, path.span),
            }
        }
        None
    }

    /// What a name alone means in a scope and those around it, up to its instance; None where it means nothing there.
    fn local(&mut self, first: &'a ast::Segment, whole: Span, scope: ScopeId) -> Option<Option<Value>> {
        let plain = first.index.is_empty();
        if plain && let Some((_, t)) = self.locals.iter().rev().find(|(n, _)| *n == first.name.text) {
            return Some(Some(Value::Scalar(t.clone())));
        }
        let mut at = Some(scope);
        while let Some(s) = at {
            if let Some((v, i)) = &self.scopes[s].loop_variable
                && *v == first.name.text
                && plain
            {
                // A count may be 0 and is still a bare number.
                let i = *i;
                return Some(Some(Value::Scalar(Typed { expr: self.pool.int(i), unit: Unit::one() })));
            }
            match self.scopes[s].locals.get(&first.name.text).map(|(entity, _)| *entity) {
                Some(entity @ (Entity::Let(_) | Entity::Input(_) | Entity::Memory(_))) => {
                    let is_own = if plain { Some(true) } else { self.is_declared(first, scope, s).map(|other| !other) };
                    match is_own {
                        None => return Some(None),
                        Some(true) => {
                            let value = self.named(entity, whole);
                            return Some(value.and_then(|value| self.entry_of_round(value, first, scope, s)));
                        }
                        Some(false) => {}
                    }
                }
                Some(
                    Entity::Element(_)
                    | Entity::Instance(_)
                    | Entity::Port(_)
                    | Entity::Param(_)
                    | Entity::Function(_)
                    | Entity::Bond(_)
                    | Entity::Field(_)
                    | Entity::Bundle(_)
                    | Entity::Missing,
                )
                | None => {}
            }
            at = self.scopes[s].parent;
        }
        None
    }

    /// The value of what is a value by itself.
    pub(super) fn named(&mut self, entity: Entity, span: Span) -> Option<Value> {
        match entity {
            Entity::Param(p) => self.param_value(p, span),
            Entity::Let(l) => self.let_value(l, span),
            Entity::Input(i) => self.input_value(i, span),
            Entity::Memory(i) => self.memory_value(i, span),
            Entity::Element(_)
            | Entity::Instance(_)
            | Entity::Port(_)
            | Entity::Function(_)
            | Entity::Bond(_)
            | Entity::Field(_)
            | Entity::Bundle(_)
            | Entity::Missing => None,
        }
    }

    /// The entry of a value that belongs to a round, if the name has an index.
    fn entry_of_round(
        &mut self,
        value: Value,
        segment: &'a ast::Segment,
        scope: ScopeId,
        of: ScopeId,
    ) -> Option<Value> {
        let round = self.scopes[of].loop_variable.as_ref().map(|(variable, _)| variable.clone());
        if let (Value::Scalar(_), Some(variable), Some(index)) = (&value, round, segment.index.first()) {
            let name = &segment.name.text;
            let message = format!("`{name}` belongs to its round, and is a number without entries");
            let help = format!("to name it from other rounds, declare it as `{name}[{variable}]`");
            return self.wrong("elaborate::index", index.span, message, &help);
        }
        self.entry(value, segment, scope)
    }

    /// The value of an entity, of which a path names the parts `rest`.
    pub(super) fn entity_value(
        &mut self,
        entity: Entity,
        key: &str,
        rest: &'a [ast::Segment],
        span: Span,
    ) -> Option<Value> {
        match entity {
            Entity::Instance(i) => {
                let outputs: Vec<String> = self.instances[i].outputs.iter().map(|o| format!("`{key}.{o}`")).collect();
                let help = match &outputs[..] {
                    [] => "name a signal of it, as in `wall.spring.q`".to_string(),
                    [one] => format!("its output is {one}"),
                    _ => format!("its outputs are {}", outputs.join(", ")),
                };
                self.wrong("elaborate::signal", span, format!("`{key}` is an instance, not a signal"), &help)
            }
            Entity::Missing | Entity::Bundle(_) => None,
            Entity::Param(_) | Entity::Let(_) | Entity::Input(_) | Entity::Memory(_) if rest.is_empty() => {
                self.named(entity, span)
            }
            Entity::Param(_) | Entity::Let(_) | Entity::Input(_) | Entity::Memory(_) => self.wrong(
                "elaborate::signal",
                span,
                format!("`{}` is no signal", self.sources.slice(span)),
                "a parameter, `let`, `input` or `state` has no parts, and a probe is for the outside: use a `let`",
            ),
            Entity::Function(_) => self.no_call(key, span),
            Entity::Element(id) => {
                // In a law, its own variable by its full name.
                if self.owner == Some(id)
                    && let [own] = rest
                    && own.index.is_empty()
                    && let Some((_, t)) = self.locals.iter().rev().find(|(n, _)| *n == own.name.text)
                {
                    return Some(Value::Scalar(t.clone()));
                }
                let found = self.element_signal(id, rest, span)?;
                self.no_entries(rest, span, found)
            }
            Entity::Field(f) => {
                let found = self.field_signal(f, rest, span)?;
                self.no_entries(rest, span, found)
            }
            Entity::Port(p) => {
                let raw = self.ports[p].outside.first().or(self.ports[p].inside.first()).map(|r| r.0);
                let shown = self.ports[p].name.clone();
                let bond = raw.and_then(|r| self.merged.get(r).copied().flatten());
                let found = self.bond_signal(bond, &shown, rest, span)?;
                self.no_entries(rest, span, found)
            }
            Entity::Bond(b) => {
                let shown = self.raw_bonds[b].name.clone();
                let found = self.bond_signal(self.merged.get(b).copied().flatten(), &shown, rest, span)?;
                self.no_entries(rest, span, found)
            }
        }
    }

    /// The signal that a path leads to, unless a part of it has an index: elements have no arrays of signals.
    fn no_entries(&mut self, rest: &'a [ast::Segment], whole: Span, found: Typed) -> Option<Value> {
        let Some(at) = rest.iter().position(|s| !s.index.is_empty()) else { return Some(Value::Scalar(found)) };
        let part = &rest[at];
        let name = self.sources.slice(Span { end: part.name.span.end, ..whole });
        let message = if at + 1 == rest.len() {
            format!("`{name}` is a number, and has no entries")
        } else {
            format!("`{name}` is one port, and has no entries")
        };
        self.wrong("elaborate::index", part.index[0].span, message, "take the index away")
    }

    pub(super) fn no_call<T>(&mut self, function: &str, span: Span) -> Option<T> {
        let message = format!("`{function}` is a function, not a value");
        self.wrong("elaborate::signal", span, message, &format!("call it, as in `{function}(x)`"))
    }

    /// Whether the value of one more name goes too deep, which is said once.
    fn is_too_deep(&mut self, at: Span) -> bool {
        let most = self.limits.depth;
        let deep = self.depth > most;
        if deep && !self.errors.iter().any(|e| e.code == "elaborate::limit") {
            let name = self.sources.slice(at);
            let message = format!("values are nested too deep: `{name}` is reached through a chain of {most} names");
            self.errors.push(
                Diagnostic::error("elaborate::limit", at, message)
                    .help("give some names of the chain a value that uses no other name"),
            );
        }
        deep
    }

    /// The time between two samples of the `sampled` block around; 0 outside of them.
    fn period(&mut self) -> Typed {
        let period = self.sampling.and_then(|s| self.samplings.get(s)).map_or(0.0, |s| s.period);
        Typed { expr: self.pool.float(period), unit: Unit::known(Dimension::SECOND) }
    }

    pub(super) fn time(&mut self, span: Span) -> Option<Typed> {
        if self.mode == Mode::Constant {
            return self.wrong(
                "elaborate::constant",
                span,
                "time is not known before the run".into(),
                "use parameters and numbers only",
            );
        }
        let symbol = self.signal(Signal::Time);
        Some(Typed { expr: self.pool.var(symbol), unit: Unit::known(Dimension::SECOND) })
    }

    /// The value of a parameter.
    pub(super) fn param_value(&mut self, p: usize, at: Span) -> Option<Value> {
        match self.params[p].state.clone() {
            ParamState::Done(t) => t,
            ParamState::Open => {
                let name = self.params[p].name.clone();
                self.params[p].state = ParamState::Done(None);
                self.wrong(
                    "elaborate::circular",
                    at,
                    format!("the parameter `{name}` depends on itself"),
                    "give it a value of its own",
                )
            }
            ParamState::New if self.is_too_deep(at) => {
                self.params[p].state = ParamState::Done(None);
                None
            }
            ParamState::New => {
                self.params[p].state = ParamState::Open;
                let found = self.compute_param(p, at);
                self.params[p].state = ParamState::Done(found.clone());
                found
            }
        }
    }

    pub(super) fn compute_param(&mut self, p: usize, at: Span) -> Option<Value> {
        let name = self.params[p].name.clone();
        let over = self.params[p].overridden;
        let mut given = None;
        match self.params[p].value {
            Some((ast, scope)) => {
                let before = self.errors.len();
                let sampling = std::mem::replace(&mut self.sampling, self.params[p].sampling);
                let mode = std::mem::replace(&mut self.mode, Mode::Constant);
                let locals = std::mem::take(&mut self.locals);
                let value = self.value(ast, scope);
                self.mode = mode;
                self.locals = locals;
                self.sampling = sampling;
                if value.is_none() {
                    self.is_parameter(p, before);
                }
                given = Some((value?, ast));
            }
            None if over.is_none() => {
                let Param { instance, span, .. } = self.params[p];
                // What is wrong is the instance, and not the model that it is one of.
                let place = if instance == 0 { at } else { self.instances[instance].span };
                let message = format!("the parameter `{name}` has no value");
                let mut error = Diagnostic::error("elaborate::parameter", place, message).label(span, "has no default");
                if instance != 0 {
                    error = error.label(at, "needs it");
                }
                self.errors.push(error.help(self.where_given(p)));
                return None;
            }
            None => {}
        }
        let span = self.params[p].span;
        if let Some((number, dimension)) = over {
            if let Some((value @ Value::List(_), _)) = &given {
                return self.wrong(
                    "elaborate::set",
                    span,
                    format!("--set {name}: `{name}` is {}, and --set gives one number", value.words()),
                    "change the array in the file, or give its entries by parameters of their own",
                );
            }
            if let Some((Value::Scalar(t), ast)) = &given {
                self.number(t, ast)?;
            }
            let default = match &given {
                Some((Value::Scalar(t), _)) => t.unit.clone(),
                Some((Value::List(_), _)) | None => Unit::Any,
            };
            let unit = match (dimension, &default) {
                (Some(given), Unit::Form(own, unknown, _)) if unknown.is_empty() && given != *own => {
                    let words = self.params[p].value.and_then(|(ast, _)| units::as_written(self.sources, ast));
                    let own_words = words.filter(|_| !own.is_one()).map(|words| format!("in {words}"));
                    let told = |d: Dimension| match d {
                        Dimension::DIMENSIONLESS => "a bare number".to_string(),
                        d if d == *own
                            && let Some(words) = &own_words =>
                        {
                            words.clone()
                        }
                        d => format!("in {d}"),
                    };
                    let message = format!("--set {name}: the value is {}, and `{name}` is {}", told(given), told(*own));
                    let help = format!("give {}, or without a unit in SI", told(*own).replace("in ", "it in "));
                    return self.wrong("elaborate::set", span, message, &help);
                }
                (Some(given), Unit::Any) => Unit::literal(given, Reading { radians: 0, certain: false }),
                (None, Unit::Any) => Unit::parameter(p),
                (Some(_) | None, Unit::Form(..)) => default,
            };
            let unit = self.declared(unit, Unknown::parameter(p), self.params[p].value.map(|v| v.0));
            return self.known_parameter(&name, number, unit, span).map(Value::Scalar);
        }
        let (mut value, ast) = given?;
        if let Value::Scalar(t) = &mut value
            && t.unit == Unit::Any
        {
            t.unit = Unit::parameter(p);
        }
        let mut names = value.leaves().into_iter().map(|(index, _)| format!("{name}{index}")).collect::<Vec<_>>();
        names.reverse();
        value.map(&mut |t| {
            let number = self.number(&t, ast)?;
            let unit = self.declared(t.unit, Unknown::parameter(p), Some(ast));
            self.known_parameter(&names.pop()?, number, unit, span)
        })
    }

    /// Where a parameter that has no value may be given one.
    fn where_given(&self, p: usize) -> String {
        let Param { name, instance, .. } = &self.params[p];
        if *instance == 0 {
            return format!(
                "give it a default, `{name} = ...` in the head of the model, or set it with `bond run --set {name}=...`"
            );
        }
        let declared = self.sources.slice(self.instances[*instance].span);
        let head = declared.split(['(', ';', '{', '=']).next().unwrap_or(declared).trim_end();
        let own = name.rsplit('.').next().unwrap_or(name);
        format!("give it where the instance is made, `{head}({own} = ...)`, or with `bond run --set {name}=...`")
    }

    /// The unit of a parameter or signal that is written with it, so that its use can tell what it says about angles.
    pub(super) fn declared(&mut self, unit: Unit, unknown: Unknown, ast: Option<&ast::Expr>) -> Unit {
        let Unit::Form(dimension, terms, angle) = &unit else { return unit };
        let dimension = *dimension;
        if !terms.is_empty() || !angle.terms.is_empty() {
            return unit;
        }
        let written = ast.and_then(|ast| units::as_written(self.sources, ast));
        // 2*pi*50 Hz are radians a second.
        let says = written.is_some() || dimension.is_one() || angle.radians.0 != 0;
        let reading = Reading { radians: angle.radians.0, certain: says && !angle.vague };
        self.angles.push(Declared { unknown, dimension, reading, written });
        unit.with_angle(unknown)
    }

    /// A symbol with this value.
    pub(super) fn known_parameter(&mut self, name: &str, value: f64, unit: Unit, span: Span) -> Option<Typed> {
        if !value.is_finite() {
            return self.wrong(
                "elaborate::number",
                span,
                format!("the parameter `{name}` is {value}"),
                "its value must be a finite number",
            );
        }
        let symbol = self.pool.parameter(name, value);
        Some(Typed { expr: self.pool.var(symbol), unit })
    }

    pub(super) fn let_value(&mut self, l: usize, at: Span) -> Option<Value> {
        if self.lets[l].input.is_some() {
            self.known_later(&self.lets[l].name.clone(), at)?;
        }
        let Let { output, sampling, .. } = self.lets[l];
        if output.is_some() && sampling.is_some() && sampling != self.sampling && self.mode != Mode::Constant {
            return self.held_value(l, at);
        }
        match self.lets[l].state.clone() {
            LetState::Done(t) => t,
            LetState::Open => {
                let from = self.open_lets.iter().position(|open| *open == l).unwrap_or_default();
                let circle = self.open_lets[from..].iter().chain([&l]).map(|l| format!("`{}`", self.lets[*l].name));
                let circle: Vec<String> = circle.collect();
                let help = match circle.len() {
                    2 => "it cannot be computed from itself; a `state` keeps the earlier value of a signal".to_string(),
                    _ => format!("break the circle {}", circle.join(" <- ")),
                };
                let name = self.lets[l].name.clone();
                self.wrong("elaborate::circular", at, format!("`{name}` depends on itself"), &help)
            }
            LetState::New if self.is_too_deep(at) => {
                self.lets[l].state = LetState::Done(None);
                None
            }
            LetState::New => {
                let before = self.errors.len();
                self.lets[l].state = LetState::Open;
                let (value, scope) = (self.lets[l].value, self.lets[l].scope);
                let mode = self.mode;
                if mode == Mode::Signals || mode == Mode::Expect {
                    self.mode = Mode::Outputs;
                }
                let locals = std::mem::take(&mut self.locals);
                let sampling = std::mem::replace(&mut self.sampling, self.lets[l].sampling);
                self.open_lets.push(l);
                let found = self.value(value, scope).and_then(|given| self.bound(l, given));
                self.open_lets.pop();
                self.mode = mode;
                self.locals = locals;
                self.sampling = sampling;
                // What cannot be said before the run may well be said in it.
                let retry = found.is_none() && mode == Mode::Constant;
                self.lets[l].state = if retry { LetState::New } else { LetState::Done(found.clone()) };
                if retry {
                    self.errors.truncate(before + 1);
                }
                found
            }
        }
    }
}
