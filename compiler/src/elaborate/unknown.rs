//! What a name that means nothing in an expression may have been meant for.

use super::Elaborator;
use crate::model::Kind;
use crate::units;
use bond_grammar::ast::Segment;
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
