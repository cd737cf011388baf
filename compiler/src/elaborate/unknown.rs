//! What a name that means nothing in an expression may have been meant for.

use super::express::celsius;
use super::{Elaborator, Entity, Mode, ScopeId};
use crate::model::Kind;
use crate::units;
use bond_grammar::ast::{self, ExprKind, Segment};
use bond_grammar::diagnostic::Diagnostic;
use bond_grammar::source::Span;

/// What laws are written in.
const VARIABLES: [&str; 5] = ["e", "f", "p", "q", "s"];

impl Elaborator<'_> {
    /// The fix for a variable of laws that the law which is being read is not written in.
    pub(super) fn in_law(&self, segment: &Segment) -> Option<String> {
        let name = segment.name.text.as_str();
        if !VARIABLES.contains(&name) || !segment.index.is_empty() {
            return None;
        }
        if !self.locals.is_empty() {
            return Some(self.written_in());
        }
        let owner = self.owner.and_then(|id| self.elements.get(id.at()));
        let owner = owner.filter(|o| o.ast.is_some_and(|ast| encloses(ast.span, segment.name.span)))?;
        let (is, law) = match owner.kind {
            Kind::R => ("resistance or conductance is a number", "`{ e = ... }` in `f`, or `{ f = ... }` in `e`"),
            Kind::C => ("compliance or stiffness is a number", "`{ e = ... }` in `q`"),
            Kind::I => ("inertia is a number", "`{ f = ... }` in `p`"),
            _ => return None,
        };
        Some(format!("a {is}, as `= value` gives it; write a law in braces: {law}").replace("a inertia", "an inertia"))
    }

    /// The fix for a port of a field, of which one of its laws reads what another one gives.
    pub(super) fn in_field_law(&self, segment: &Segment) -> Option<String> {
        let is_port = |local: &str| local.split_once('.').is_some_and(|(port, _)| port == segment.name.text);
        let (read, _) = self.locals.iter().find(|(local, _)| is_port(local))?;
        Some(format!("a law reads `{read}`, and not the output of another law of the field: write that out"))
    }

    /// What the law that is being read is written in.
    fn written_in(&self) -> String {
        let owner = self.owner.and_then(|id| self.elements.get(id.at()));
        let list: Vec<String> = self.locals.iter().map(|(n, _)| format!("`{n}`")).collect();
        let law = match (owner.map(|o| o.kind), list.first().map(String::as_str)) {
            (Some(Kind::C), _) => "the law of a C",
            (Some(Kind::I), _) => "the law of an I",
            (Some(Kind::R), Some("`f`")) => "`e = ...` of an R",
            (Some(Kind::R), Some("`e`")) => "`f = ...` of an R",
            (Some(Kind::R), Some("`s`")) => "the curve of an R",
            _ => "this law",
        };
        format!("{law} is written in {}", list.join(", "))
    }

    /// The fix for a name that is declared nowhere, in a value.
    pub(super) fn undeclared(&self, key: &str) -> String {
        let declare = format!("declare it, for instance as `let {key} = ...`, or check the spelling");
        match self.owner.is_some() && !self.locals.is_empty() {
            true => format!("{declare}; {}", self.written_in()),
            false => declare,
        }
    }

    /// The fix for a unit that stands apart from its number: `6*V`.
    pub(super) fn as_unit(&self, segment: &Segment) -> Option<String> {
        let (name, span) = (&segment.name.text, segment.name.span);
        if !segment.index.is_empty() || units::lookup(name).is_none() {
            return None;
        }
        let before = self.sources.get(span.source).text.get(..span.start as usize)?.trim_end();
        let number = last_number(before.strip_suffix('*')?.trim_end())?;
        Some(format!("if the unit is meant, write it behind its number: `{number} {name}`"))
    }

    /// What is said of a name that is declared nowhere and that touches the unit of a number, where it may have been
    /// meant as a part of it: `sec` in `3 N*sec`.
    pub(super) fn within_unit(&self, segment: &Segment) -> Option<Diagnostic> {
        let (name, span) = (segment.name.text.as_str(), segment.name.span);
        if !segment.index.is_empty() {
            return None;
        }
        let quantity = quantity_before(self.sources.get(span.source).text.get(..span.start as usize)?)?;
        let error = |message: String| Diagnostic::error("units::unknown", span, message);
        if units::lookup(name).is_some() {
            let (units, rest, first) = split_at_name(quantity)?;
            let sign = if self.sources.get(span.source).text[..span.start as usize].ends_with('/') { '/' } else { '*' };
            let message = format!("`{name}` behind `{first}`, which is no unit, is read as a name, and there is none");
            return Some(error(message).help(format!("write the units first: `{units}{sign}{name}{rest}`")));
        }
        let neither = error(format!("`{name}` is neither a unit nor a name here"));
        if units::is_celsius(name) {
            return Some(neither.help(celsius(None, &[])));
        }
        let unit = units::suggest(name)?;
        Some(neither.help(format!("did you mean the unit `{unit}`?")))
    }

    /// Whether a unit stands behind a factor that is neither a unit nor a name, which is said of that: `m` in `3 N*sec/m`.
    pub(super) fn follows_unknown(&self, segment: &Segment, scope: ScopeId) -> bool {
        let (name, span) = (segment.name.text.as_str(), segment.name.span);
        let before = self.sources.get(span.source).text.get(..span.start as usize);
        let first = before.and_then(quantity_before).and_then(split_at_name).map(|parts| parts.2);
        let is_known = |name: &str| matches!(name, "t" | "pi") || self.value_named(name, scope).is_some();
        units::lookup(name).is_some() && first.is_some_and(|first| !is_known(first))
    }

    /// Notes that a name of the model is read as a unit behind a number, where nothing else shows how it is meant: in an
    /// output, whose unit nothing checks, or where the name's own value has the unit's dimension.
    pub(super) fn note_names_as_units(&mut self, unit: &ast::Unit, span: Span, scope: ScopeId) {
        let first = unit.factors.first().map(|f| f.2);
        let is_meant = |name: &str| {
            let Some((_, dimension)) = units::lookup(name) else { return false };
            let behind = unit.factors.iter().any(|f| f.0 == name && Some(f.2) != first);
            match self.value_named(name, scope) {
                Some(_) if self.mode == Mode::Outputs && behind => true,
                Some(Some(ExprKind::Number { unit: Some(own), .. })) => {
                    units::of(own).is_ok_and(|(_, own)| own == dimension)
                }
                Some(_) | None => false,
            }
        };
        if !unit.factors.iter().any(|f| is_meant(&f.0)) {
            return;
        }
        let read = misread(self.sources.slice(span), &is_meant);
        let name = unit.factors.iter().find(|f| is_meant(&f.0)).map(|f| f.0.clone());
        if let (Some(read), Some(name)) = (read, name) {
            self.remarks.push((span, name, read));
        }
    }

    /// Whether a value of this name is known in a scope; what it is given as, where that is seen at once.
    fn value_named(&self, name: &str, scope: ScopeId) -> Option<Option<&'_ ExprKind>> {
        if self.locals.iter().any(|(local, _)| local == name) {
            return Some(None);
        }
        let scopes = std::iter::successors(Some(scope), |s| self.scopes[*s].parent);
        for s in scopes {
            if self.scopes[s].loop_variable.as_ref().is_some_and(|(v, _)| v == name) {
                return Some(None);
            }
            if self.scopes[s].locals.contains_key(name) {
                return Some(None);
            }
        }
        match self.instances.get(self.scopes[scope].instance)?.names.get(name)?.0 {
            Entity::Param(p) => Some(self.params[p].value.map(|(e, _)| &e.kind)),
            Entity::Let(l) => Some(Some(&self.lets[l].value.kind)),
            Entity::Input(_) | Entity::Memory(_) => Some(None),
            Entity::Element(_)
            | Entity::Instance(_)
            | Entity::Port(_)
            | Entity::Function(_)
            | Entity::Bond(_)
            | Entity::Field(_)
            | Entity::Missing => None,
        }
    }

    /// The first remark on each name, in order of place.
    pub(super) fn told_remarks(&mut self) -> Vec<String> {
        let mut all = std::mem::take(&mut self.remarks);
        all.sort_by_key(|(span, ..)| (span.source, span.start));
        let mut seen = rustc_hash::FxHashSet::default();
        all.retain(|(span, name, _)| {
            !self.sources.get(span.source).name.starts_with("std/") && seen.insert((span.source, name.clone()))
        });
        all.into_iter().map(|(span, _, text)| format!("line {}: {text}", self.sources.position(span).0)).collect()
    }
}

/// The number and the unit that a text ends with, before the operator and the bracket that it ends with: `6 V` of
/// `a + 6 V*(`.
fn quantity_before(text: &str) -> Option<&str> {
    let head = text.strip_suffix('(').unwrap_or(text).strip_suffix(['*', '/'])?;
    let of_unit = |c: char| c.is_alphanumeric() || "_^*/()°%.-".contains(c);
    let start = head.rfind(|c| !of_unit(c)).map_or(0, |at| at + head[at..].chars().next().map_or(1, char::len_utf8));
    let unit = &head[start..];
    if unit.starts_with(|c: char| c.is_ascii_digit() || c == '.') {
        return Some(unit);
    }
    let number = last_number(head[..start].strip_suffix(' ')?)?;
    (!unit.is_empty()).then(|| &head[start - 1 - number.len()..])
}

/// A quantity before and behind its first factor that is no unit, with the operator, and that factor.
fn split_at_name(quantity: &str) -> Option<(&str, &str, &str)> {
    let signs = quantity.match_indices(['*', '/', '(']);
    signs.into_iter().find_map(|(at, _)| {
        let rest = &quantity[at + 1..];
        let symbol = &rest[..rest.find(|c: char| !c.is_alphanumeric() && c != '_').unwrap_or(rest.len())];
        let is_name = !symbol.is_empty() && units::lookup(symbol).is_none();
        is_name.then(|| (&quantity[..at], &quantity[at..], symbol))
    })
}

/// Whether one span lies in the other.
fn encloses(outer: Span, inner: Span) -> bool {
    outer.source == inner.source && outer.start <= inner.start && inner.end <= outer.end
}

/// The number that a text ends with.
fn last_number(text: &str) -> Option<&str> {
    let mut start = text.len();
    for (at, c) in text.char_indices().rev() {
        let exponent = matches!(c, '+' | '-') && text[..at].ends_with(['e', 'E']);
        if !c.is_alphanumeric() && c != '.' && c != '_' && !exponent {
            break;
        }
        start = at;
    }
    let number = &text[start..];
    number.parse::<f64>().ok().filter(|_| number.starts_with(|c: char| c.is_ascii_digit() || c == '.')).map(|_| number)
}

/// The fix for the first name that stands as a unit behind a number: `m` in `p^2/2 m`, where `m` is a parameter.
pub(super) fn misread(text: &str, known: &dyn Fn(&str) -> bool) -> Option<String> {
    let is_name = |c: char| c.is_alphanumeric() || c == '_';
    let span = |text: &str, fits: &dyn Fn(char) -> bool| text.find(|c| !fits(c)).unwrap_or(text.len());
    let mut rest = text;
    while let Some(at) = rest.find(is_name) {
        let digits = span(&rest[at..], &|c| c.is_ascii_digit() || c == '.');
        if digits == 0 {
            rest = &rest[at + span(&rest[at..], &is_name)..];
            continue;
        }
        let (number, behind) = rest[at..].split_at(digits);
        let spaced = behind.strip_prefix(' ').unwrap_or(behind);
        let unit = &spaced[..span(spaced, &|c| is_name(c) || matches!(c, '*' | '/' | '^'))];
        let quantity = &rest[at..rest.len() - spaced.len() + unit.len()];
        let below = rest[..at].trim_end().ends_with('/');
        rest = behind;
        let mut start = 0;
        for symbol in unit.split(['*', '/', '^']).take_while(|_| unit.starts_with(is_name)) {
            if known(symbol) && units::lookup(symbol).is_some() {
                let (head, rest) = unit.split_at(start);
                let fix = match head.chars().last() {
                    None if below => format!("({number}*{rest})"),
                    None => format!("{number}*{rest}"),
                    Some(sign) => format!("{number} {} {sign} {rest}", head.trim_end_matches(sign)),
                };
                let read = format!("`{symbol}` in `{quantity}` is read as a unit");
                return Some(format!("{read}; if the name is meant, write `{fix}`"));
            }
            start += symbol.len() + 1;
        }
    }
    None
}
