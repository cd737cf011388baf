//! What an expression means: a number with its unit, or an array of values of one shape.

use super::{Elaborator, Entity, Mode, ScopeId, Typed};
use crate::expression::Node;
use crate::model::Parameter;
use bond_grammar::ast;
use bond_grammar::diagnostic::Diagnostic;
use bond_grammar::source::Span;

/// A number, or a list of values that all have one shape.
#[derive(Clone, Debug)]
pub(crate) enum Value {
    /// A number.
    Scalar(Typed),
    /// An array; of arrays, a matrix by rows.
    List(Vec<Value>),
}

impl Value {
    /// The sizes from the outside in; none of a number.
    pub(super) fn shape(&self) -> Vec<usize> {
        match self {
            Value::Scalar(_) => Vec::new(),
            Value::List(items) => {
                let inner = items.first().map(Value::shape).unwrap_or_default();
                std::iter::once(items.len()).chain(inner).collect()
            }
        }
    }

    /// The shape in words.
    pub(super) fn words(&self) -> String {
        let shape = self.shape();
        let sizes: Vec<String> = shape.iter().map(usize::to_string).collect();
        match shape.len() {
            0 => "a number".into(),
            1 => format!("an array of {}", sizes[0]),
            2 => format!("a matrix of {}", sizes.join(" by ")),
            _ => format!("an array of {}", sizes.join(" by ")),
        }
    }

    /// The numbers in it, each with its indices as they are written: nothing, `[2]`, `[1,2]`.
    pub(super) fn leaves(&self) -> Vec<(String, &Typed)> {
        fn walk<'v>(value: &'v Value, index: &mut Vec<usize>, found: &mut Vec<(String, &'v Typed)>) {
            match value {
                Value::Scalar(t) => {
                    let index: Vec<String> = index.iter().map(usize::to_string).collect();
                    found.push((if index.is_empty() { String::new() } else { format!("[{}]", index.join(",")) }, t));
                }
                Value::List(items) => {
                    for (i, item) in items.iter().enumerate() {
                        index.push(i + 1);
                        walk(item, index, found);
                        index.pop();
                    }
                }
            }
        }
        let mut found = Vec::new();
        walk(self, &mut Vec::new(), &mut found);
        found
    }

    /// Each number replaced; `None` where that fails for one of them.
    pub(super) fn map(self, f: &mut dyn FnMut(Typed) -> Option<Typed>) -> Option<Value> {
        match self {
            Value::Scalar(t) => f(t).map(Value::Scalar),
            Value::List(items) => items.into_iter().map(|v| v.map(f)).collect::<Option<_>>().map(Value::List),
        }
    }

    /// Two values of one shape, number by number.
    pub(super) fn zip(self, other: Value, f: &mut dyn FnMut(Typed, Typed) -> Option<Typed>) -> Option<Value> {
        match (self, other) {
            (Value::Scalar(a), Value::Scalar(b)) => f(a, b).map(Value::Scalar),
            (Value::List(a), Value::List(b)) => {
                a.into_iter().zip(b).map(|(a, b)| a.zip(b, f)).collect::<Option<_>>().map(Value::List)
            }
            (Value::Scalar(_), Value::List(_)) | (Value::List(_), Value::Scalar(_)) => None,
        }
    }
}

impl<'a> Elaborator<'a> {
    /// The number that a value is.
    pub(super) fn scalar(&mut self, value: Value, e: &ast::Expr) -> Option<Typed> {
        match value {
            Value::Scalar(t) => Some(t),
            Value::List(_) => {
                let message = format!("`{}` is {}, where a number is needed", self.words(e), value.words());
                self.errors.push(
                    Diagnostic::error("elaborate::shape", e.span, message)
                        .help("name an entry of it, as in `a[1]`, or add them up with `sum(a)`"),
                );
                None
            }
        }
    }

    /// The rows of a matrix.
    pub(crate) fn rows(&mut self, value: Value, e: &ast::Expr) -> Option<Vec<Vec<Typed>>> {
        let found = value.words();
        let row = |v: Value| match v {
            Value::List(items) => items
                .into_iter()
                .map(|v| match v {
                    Value::Scalar(t) => Some(t),
                    Value::List(_) => None,
                })
                .collect::<Option<Vec<Typed>>>(),
            Value::Scalar(_) => None,
        };
        let rows = match value {
            Value::List(items) => items.into_iter().map(row).collect::<Option<Vec<_>>>(),
            Value::Scalar(_) => None,
        };
        if rows.is_none() {
            let message = format!("`{}` is {found}, where a matrix is needed", self.words(e));
            self.errors.push(
                Diagnostic::error("elaborate::shape", e.span, message)
                    .help("a matrix is written by rows, as in `[[2, 1], [1, 2]]`"),
            );
        }
        rows
    }

    /// The rows of a matrix that may name signals.
    pub(crate) fn matrix(&mut self, e: &'a ast::Expr, scope: ScopeId) -> Option<Vec<Vec<Typed>>> {
        self.mode = Mode::Signals;
        let value = self.value(e, scope)?;
        self.rows(value, e)
    }

    /// The entry of an array that an indexed name means, where no declaration has that name.
    pub(super) fn indexed(&mut self, at: usize, segment: &'a ast::Segment, scope: ScopeId) -> Option<Option<Value>> {
        if segment.index.is_empty() {
            return None;
        }
        let (entity, _) = *self.instances[at].names.get(&segment.name.text)?;
        if !matches!(entity, Entity::Param(_) | Entity::Let(_) | Entity::Input(_) | Entity::Memory(_)) {
            return None;
        }
        let Some(key) = self.key(&segment.name.text, &segment.index, scope) else { return Some(None) };
        if self.instances[at].names.contains_key(&key) {
            return None;
        }
        let value = self.named(entity, segment.name.span);
        Some(value.and_then(|value| self.entry(value, segment, scope)))
    }

    /// Whether an indexed name is that of a declaration of the model, and not the entry of the array that a scope has
    /// by that name. The arguments of a function hide the declarations.
    pub(super) fn is_declared(&mut self, segment: &'a ast::Segment, scope: ScopeId, of: ScopeId) -> Option<bool> {
        let key = self.key(&segment.name.text, &segment.index, scope)?;
        let of_call = self.scopes[of].loop_variable.is_none() && self.scopes[of].parent.is_some();
        Some(!of_call && self.instances[self.scopes[of].instance].names.contains_key(&key))
    }

    /// `a[2]`, `m[1, 2]`: what stands at the indices of a segment.
    pub(super) fn entry(&mut self, value: Value, segment: &'a ast::Segment, scope: ScopeId) -> Option<Value> {
        let indices: Option<Vec<(i64, Span)>> =
            segment.index.iter().map(|index| self.integer(index, scope).map(|i| (i, index.span))).collect();
        self.entry_at(value, &segment.name.text, &indices?)
    }

    /// What stands at these indices, each with the place that gives it.
    pub(super) fn entry_at(&mut self, value: Value, name: &str, indices: &[(i64, Span)]) -> Option<Value> {
        let mut value = value;
        for (depth, &(i, at)) in indices.iter().enumerate() {
            let whole = if depth == 0 { format!("`{name}`") } else { format!("that entry of `{name}`") };
            let Value::List(items) = value else {
                let message = format!("{whole} is a number, and has no entries");
                let help = if depth == 0 { "take the index away" } else { "take the last index away" };
                self.errors.push(Diagnostic::error("elaborate::index", at, message).help(help));
                return None;
            };
            let size = items.len();
            let place = usize::try_from(i).ok().and_then(|i| i.checked_sub(1));
            match place.and_then(|place| items.into_iter().nth(place)) {
                Some(found) => value = found,
                None => {
                    let message = format!("{whole} has no entry {i}: its size is {size}");
                    self.errors.push(
                        Diagnostic::error("elaborate::index", at, message)
                            .help(format!("entries are counted from 1 to {size}")),
                    );
                    return None;
                }
            }
        }
        Some(value)
    }

    /// What a parameter is to be listed as: one line a number.
    pub(super) fn listed(&self, name: &str, value: &Value) -> Vec<(Parameter, super::Unit)> {
        let one = |(index, t): (String, &Typed)| {
            let Node::Symbol(symbol) = *self.pool.node(t.expr) else { return None };
            let value = self.pool.constant(t.expr)?;
            Some((Parameter { name: format!("{name}{index}"), symbol, value, unit: None }, t.unit.clone()))
        };
        value.leaves().into_iter().filter_map(one).collect()
    }
}
