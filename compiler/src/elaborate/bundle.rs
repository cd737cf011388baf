//! Bundles, `1:v[1..3]`: elements and ports of one name that are declared, bonded and read together.
//!
//! A bundle is no more than its entries, `v[1]` to `v[3]`: what runs knows no bundles.

use super::{Elaborator, Entity, RawEnd, ScopeId, Typed, Value};
use bond_grammar::ast::{self, End, ExprKind, Path};
use bond_grammar::diagnostic::Diagnostic;
use bond_grammar::source::Span;

/// Which entry of a bundle something is of, counted from 0, and how many there are.
#[derive(Clone, Copy, Debug)]
pub(super) struct Entry {
    place: usize,
    size: usize,
}

/// A name with a range: `v[1..3]`.
pub(super) struct Range {
    /// The name without the range: `v`, and `v[2]` of `v[2, 1..3]`.
    pub(super) name: String,
    pub(super) from: i64,
    pub(super) to: i64,
}

impl Range {
    /// How many entries it has.
    pub(super) fn size(&self) -> usize {
        (self.to - self.from + 1) as usize
    }

    /// As it is written, `v[1..3]`.
    fn written(&self) -> String {
        let (head, end) = match self.name.strip_suffix(']') {
            Some(indexed) => (indexed, ','),
            None => (self.name.as_str(), '['),
        };
        format!("{head}{end}{}..{}]", self.from, self.to)
    }

    /// The names of its entries.
    pub(super) fn keys(&self) -> impl Iterator<Item = String> {
        let (head, end) = match self.name.strip_suffix(']') {
            Some(indexed) => (indexed.to_string(), ','),
            None => (self.name.clone(), '['),
        };
        (self.from..=self.to).map(move |k| format!("{head}{end}{k}]"))
    }
}

/// What is written as one end of a bond.
pub(super) struct Ends {
    /// The ends, each with its name for messages; nothing for one that could not be made, which is said.
    pub(super) list: Vec<Option<(RawEnd, String)>>,
    /// Of a bundle, how many they are.
    pub(super) size: Option<usize>,
    /// Where it stands.
    span: Span,
}

/// The ends of the bonds that join two ends.
type Pairs<'e> = Vec<(Option<&'e (RawEnd, String)>, Option<&'e (RawEnd, String)>)>;

impl<'a> Elaborator<'a> {
    /// The range that a name has last among its indices; nothing within where it has none.
    pub(super) fn range(&mut self, name: &str, index: &'a [ast::Expr], scope: ScopeId) -> Option<Option<Range>> {
        let Some((last, before)) = index.split_last() else { return Some(None) };
        let ExprKind::Range(from, to) = &last.kind else { return Some(None) };
        let name = self.key(name, before, scope)?;
        let (from, to) = (self.integer(from, scope), self.integer(to, scope));
        let (from, to) = from.zip(to)?;
        if to < from {
            let message = format!("the bundle `{name}` has no entries: it goes from {from} to {to}");
            let help = format!("a range counts upwards: `{name}[{to}..{from}]`");
            return self.wrong("elaborate::bundle", last.span, message, &help);
        }
        let (size, most) = (to as i128 - from as i128 + 1, self.limits.entries);
        if size > most as i128 {
            let message = format!("the bundle `{name}` has {size} entries, and may have {most}");
            return self.wrong("elaborate::limit", last.span, message, "use fewer entries");
        }
        // Each entry is work like a round of a `for`.
        self.rounds += size as u64;
        if self.rounds > self.limits.rounds {
            let message = format!("all loops and bundles together have more than {} rounds", self.limits.rounds);
            return self.wrong("elaborate::limit", last.span, message, "lower the bounds");
        }
        Some(Some(Range { name, from, to }))
    }

    /// Declares the name of a bundle; whether it was free.
    pub(super) fn declare_bundle(&mut self, scope: ScopeId, range: &Range, span: Span) -> bool {
        let entity = Entity::Bundle(self.bundles.len());
        let instance = self.scopes[scope].instance;
        let bundle = self.full_name(instance, &range.written());
        for key in range.keys() {
            self.entries.insert(self.full_name(instance, &key), bundle.clone());
        }
        self.bundles.push((range.from, range.to));
        self.declare(scope, range.name.clone(), entity, span)
    }

    /// Declares a bundle of elements or parts.
    pub(super) fn bundle(&mut self, e: &'a ast::Element, range: Range, scope: ScopeId, sampling: Option<usize>) {
        if !self.declare_bundle(scope, &range, e.name.span) {
            return;
        }
        let (instance, size) = (self.scopes[scope].instance, range.size());
        for (place, key) in range.keys().enumerate() {
            if self.too_big(e.span) {
                return;
            }
            let inner = self.new_scope(instance, Some(scope), None);
            self.scopes[inner].entry = Some(Entry { place, size });
            self.element_at(e, key, inner, sampling);
        }
    }

    /// A number of an element's law. In a bundle an array gives each entry its own.
    pub(super) fn of_entry(&mut self, e: &'a ast::Expr, scope: ScopeId) -> Option<Typed> {
        let Some(entry) = self.scopes[scope].entry else { return self.express(e, scope) };
        let value = self.value(e, scope)?;
        let Value::List(mut items) = value else { return self.scalar(value, e) };
        if items.len() != entry.size {
            let words = self.words(e);
            let message = format!("`{words}` has {} entries, and the bundle has {}", items.len(), entry.size);
            let help = "give as many entries as the bundle has, or one number for all of them";
            return self.wrong("elaborate::bundle", e.span, message, help);
        }
        let own = items.swap_remove(entry.place);
        self.scalar(own, e)
    }

    /// The bundle that a path leads through: in which segment, and what its entries are called there.
    fn bundle_in(&mut self, path: &'a Path, scope: ScopeId) -> Option<Option<(usize, Range)>> {
        let mut at = self.scopes[scope].instance;
        for (i, segment) in path.segments.iter().enumerate() {
            if let Some(range) = self.range(&segment.name.text, &segment.index, scope)? {
                return Some(Some((i, range)));
            }
            let name = match &segment.index[..] {
                [] => segment.name.text.clone(),
                index => self.key(&segment.name.text, index, scope)?,
            };
            match self.instances[at].names.get(&name).map(|found| found.0) {
                Some(Entity::Bundle(b)) => {
                    let (from, to) = self.bundles[b];
                    return Some(Some((i, Range { name, from, to })));
                }
                Some(Entity::Instance(inner)) => at = inner,
                Some(_) | None => return Some(None),
            }
        }
        Some(None)
    }

    /// What is written as one end of a bond: one end, or those of a bundle.
    pub(super) fn ends(&mut self, end: &'a End, scope: ScopeId) -> Ends {
        let (span, bundle) = match end {
            End::Declare(e) => {
                (e.name.span, self.range(&e.name.text, &e.index, scope).map(|range| range.map(|range| (0, range))))
            }
            End::Path(path) => (path.span, self.bundle_in(path, scope)),
        };
        match bundle {
            None => Ends { list: vec![None], size: None, span },
            Some(None) => Ends { list: vec![self.end(end, scope, None)], size: None, span },
            Some(Some((segment, range))) => {
                let list = range.keys().map(|key| self.end(end, scope, Some((segment, &key)))).collect();
                Ends { list, size: Some(range.size()), span }
            }
        }
    }

    /// The bonds of one arrow between two ends: of two bundles, entry by entry.
    pub(super) fn paired<'e>(&mut self, tails: &'e Ends, heads: &'e Ends, arrow: Span) -> Pairs<'e> {
        let is_lost = |ends: &Ends| ends.size.is_none() && ends.list.iter().all(Option::is_none);
        if tails.size == heads.size || is_lost(tails) || is_lost(heads) {
            return tails.list.iter().zip(&heads.list).map(|(tail, head)| (tail.as_ref(), head.as_ref())).collect();
        }
        let told = |ends: &Ends| match ends.size {
            Some(1) => "a bundle of 1 entry".to_string(),
            Some(n) => format!("a bundle of {n} entries"),
            None => "a single end".to_string(),
        };
        let (tail, head) = (self.words_at(tails.span), self.words_at(heads.span));
        let message = format!("this bond joins `{tail}`, {}, with `{head}`, {}", told(tails), told(heads));
        let help = match (tails.size, heads.size) {
            (Some(n), Some(m)) => {
                let (longer, least) = if n > m { (&tail, m) } else { (&head, n) };
                let longer = longer.split('[').next().unwrap_or_default();
                format!(
                    "bundles are joined entry by entry: bond a part of the longer one, as in `{longer}[1..{least}]`"
                )
            }
            _ => {
                let bundle = if tails.size.is_some() { &tail } else { &head };
                format!("bond one entry, as in `{bundle}[1]`, or each of them in a `for`")
            }
        };
        let error = Diagnostic::error("elaborate::bundle", arrow, message);
        let error = error.label(tails.span, format!("is {}", told(tails)));
        self.errors.push(error.label(heads.span, format!("is {}", told(heads))).help(help));
        vec![(None, None)]
    }

    fn words_at(&self, span: Span) -> String {
        self.sources.slice(span).split_whitespace().collect::<Vec<_>>().join(" ")
    }

    /// A signal of each entry of a bundle, as an array.
    pub(super) fn bundle_value(
        &mut self,
        at: usize,
        (bundle, name): (usize, &str),
        rest: &'a [ast::Segment],
        span: Span,
    ) -> Option<Value> {
        let (from, to) = self.bundles[bundle];
        let range = Range { name: name.to_string(), from, to };
        let mut items = Vec::new();
        for key in range.keys() {
            let entity = self.instances[at].names.get(&key)?.0;
            if let (Entity::Instance(_), true) = (entity, !rest.is_empty()) {
                let message = format!("`{name}` is a bundle of parts");
                let help = format!("name one of them, as in `{key}.{}`", rest[0].name.text);
                return self.wrong("elaborate::bundle", span, message, &help);
            }
            items.push(self.entity_value(entity, &key, rest, span)?);
        }
        Some(Value::List(items))
    }
}
