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
        if !segment.index.is_empty() || !units::is_unit(name) {
            return None;
        }
        let before = self.sources.get(span.source).text.get(..span.start as usize)?.trim_end();
        let number = last_number(before.strip_suffix('*')?.trim_end())?;
        Some(format!("if the unit is meant, write it behind its number: `{number} {name}`"))
    }

    /// What is said of a name that is no value here and that touches the unit of a number, where it may have been meant
    /// as a part of it: `sec` in `3 N*sec`, `s` in `3 kg*x/s`. Nothing, inside, where that is said of a factor before.
    pub(super) fn within_unit(&self, name: &str, span: Span) -> Option<Option<Diagnostic>> {
        let text = &self.sources.get(span.source).text;
        let quantity = quantity_before(text.get(..span.start as usize)?)?;
        let error = |message: String| Diagnostic::error("units::unknown", span, message);
        if units::is_unit(name) {
            let scope = self.owner.and_then(|id| self.elements.get(id.at())).map_or(0, |owner| owner.scope);
            let is_value = |name: &str| matches!(name, "t" | "pi") || self.value_named(name, scope).is_some();
            let (first, behind) = split_at_name(quantity)?;
            let told = |symbol: &str| units::is_unit(symbol) && !is_value(symbol);
            if !is_value(first) || symbols(behind).any(told) {
                return Some(None);
            }
            let rest = &text[span.end as usize..];
            let chain = format!("{quantity}{}", &text[span.start as usize - 1..span.end as usize + of_chain(rest)]);
            let message =
                format!("`{name}` behind `{first}`, which is no unit, is read as a name, and there is no such value");
            return Some(Some(error(message).help(match units_first(&chain) {
                Some(fix) => format!("write the units first: `{fix}`"),
                None => "write the units first, then the names".to_string(),
            })));
        }
        let neither = error(format!("`{name}` is neither a unit nor a name here"));
        if units::is_celsius(name) {
            return Some(Some(neither.help(celsius(None, &[]))));
        }
        let unit = units::suggest(name)?;
        Some(Some(neither.help(format!("did you mean the unit `{unit}`?"))))
    }

    /// Notes that a name of the model is read as a unit behind a number, where nothing else shows how it is meant: in
    /// an output, whose unit nothing checks, or where the name's own value has the unit's dimension.
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
            | Entity::Bundle(_)
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

/// The first factor of a quantity that is no unit, and what stands behind it.
fn split_at_name(quantity: &str) -> Option<(&str, &str)> {
    let mut signs = quantity.match_indices(['*', '/', '(']);
    signs.find_map(|(at, _)| {
        let rest = &quantity[at + 1..];
        let symbol = symbols(rest).next()?;
        let is_name = rest.starts_with(symbol) && !units::is_unit(symbol);
        is_name.then(|| (symbol, &rest[symbol.len()..]))
    })
}

/// The names in a text.
fn symbols(text: &str) -> impl Iterator<Item = &str> {
    text.split(|c: char| !c.is_alphanumeric() && c != '_').filter(|s| s.starts_with(|c: char| c.is_alphabetic()))
}

/// How far a text goes on with powers and further factors of a product.
fn of_chain(text: &str) -> usize {
    text.find(|c: char| !c.is_alphanumeric() && !"_^*/-".contains(c)).unwrap_or(text.len())
}

/// A product of factors without brackets with those that are units in front: `6 kg*m/s^2*x` for `6 kg*x*m/s^2`.
fn units_first(chain: &str) -> Option<String> {
    if chain.contains('(') {
        return None;
    }
    let start = chain.find(['*', '/'])?;
    let (head, mut rest) = chain.split_at(start);
    let (mut ahead, mut behind) = (String::new(), String::new());
    while !rest.is_empty() {
        let end = rest[1..].find(['*', '/']).map_or(rest.len(), |at| at + 1);
        let symbol = symbols(&rest[1..end]).next()?;
        let side = if units::is_unit(symbol) { &mut ahead } else { &mut behind };
        side.push_str(&rest[..end]);
        rest = &rest[end..];
    }
    Some(format!("{head}{ahead}{behind}"))
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

/// The fix for the first name that stands as a unit behind a number: `m` in `p^2/2 m`, where `m` is a parameter. Of
/// several such factors of one unit, one that multiplies is rather a name than one that divides.
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
        let (mut start, mut found) = (0, Vec::new());
        for symbol in unit.split(['*', '/', '^']).take_while(|_| unit.starts_with(is_name)) {
            if known(symbol) && units::is_unit(symbol) {
                found.push((unit[..start].chars().last(), start, symbol));
            }
            start += symbol.len() + 1;
        }
        let first = found.iter().find(|f| f.0 != Some('/')).or(found.first());
        let Some(&(sign, start, symbol)) = first else { continue };
        let (head, rest) = unit.split_at(start);
        let fix = match sign {
            None if below => format!("({number}*{rest})"),
            None => format!("{number}*{rest}"),
            Some(sign) => format!("{number} {} {sign} {rest}", head.trim_end_matches(sign)),
        };
        let read = format!("`{symbol}` in `{quantity}` is read as a unit");
        return Some(format!("{read}; if the name is meant, write `{fix}`"));
    }
    None
}
