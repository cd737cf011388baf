//! `= value` and `{ field = value }` of an element's declaration.

use crate::elaborate::{Elaborator, meant};
use bond_grammar::ast::{Element, Expr};
use bond_grammar::diagnostic::Diagnostic;

/// The fields of a declaration by name; `= value` counts as the field `short`.
pub(super) struct Fields<'a> {
    list: Vec<(String, &'a Expr)>,
}

impl<'a> Fields<'a> {
    /// Reads a declaration that may have the fields `known`, at most one of them out of `laws`, and must have one of
    /// `laws`.
    pub(super) fn read(
        e: &mut Elaborator<'a>,
        ast: &'a Element,
        short: &str,
        laws: &[&str],
        others: &[&str],
    ) -> Option<Self> {
        let name = &ast.name.text;
        let mut list: Vec<(String, &'a Expr)> = ast.value.iter().map(|v| (short.to_string(), v)).collect();
        let known: Vec<&str> = laws.iter().chain(others).copied().collect();
        let mut sound = true;
        for f in ast.fields.iter().flat_map(|f| &f.0) {
            let path = f.name();
            if !known.contains(&path.as_str()) {
                let mut error = Diagnostic::error(
                    "elaborate::field",
                    f.span,
                    format!("`{name}` (a `{}`) has no field `{path}`", ast.kind.text),
                );
                error = match meant(&path, &known) {
                    Some(n) => error.help(format!("did you mean `{n}`?")),
                    None => error.help(format!("its fields are {}", known.join(", "))),
                };
                e.errors.push(error);
                sound = false;
            } else if list.iter().any(|(n, _)| *n == path) {
                e.errors.push(
                    Diagnostic::error("elaborate::twice", f.span, format!("`{path}` of `{name}` is given twice"))
                        .help("keep one"),
                );
                sound = false;
            } else {
                list.push((path, &f.value));
            }
        }
        let found: Vec<&(String, &Expr)> = list.iter().filter(|(n, _)| laws.contains(&n.as_str())).collect();
        match found[..] {
            [_] => {}
            [] if sound => {
                let choice = laws.iter().map(|l| format!("`{l}`")).collect::<Vec<_>>().join(", ");
                e.errors.push(
                    Diagnostic::error("elaborate::value", ast.span, format!("`{name}` has no value"))
                        .help(format!("write `{}:{name} = value`, or give one of {choice} in braces", ast.kind.text)),
                );
                sound = false;
            }
            [] => sound = false,
            [first, second, ..] => {
                e.errors.push(
                    Diagnostic::error(
                        "elaborate::twice",
                        second.1.span,
                        format!("`{name}` is given two laws, `{}` and `{}`", first.0, second.0),
                    )
                    .label(first.1.span, "is the first")
                    .help("keep one of them"),
                );
                sound = false;
            }
        }
        sound.then_some(Self { list })
    }

    /// The field of this name.
    pub(super) fn get(&self, name: &str) -> Option<&'a Expr> {
        self.list.iter().find(|(n, _)| n == name).map(|(_, v)| *v)
    }
}
