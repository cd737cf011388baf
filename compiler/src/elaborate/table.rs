//! `table(x, [x1, x2, ...], [y1, y2, ...])`: a measured curve.

use super::{Elaborator, Typed, Unit, Value};
use bond_grammar::ast::{self, ExprKind};
use bond_grammar::diagnostic::Diagnostic;
use bond_grammar::source::Span;

impl<'a> Elaborator<'a> {
    /// The curve through the knots, at `x`.
    pub(super) fn table(
        &mut self,
        [x, places, heights]: [&Value; 3],
        args: &'a [ast::Expr],
        span: Span,
    ) -> Option<Typed> {
        let [x_ast, places_ast, heights_ast] = args else { return None };
        let x = self.scalar(x.clone(), x_ast);
        let xs = self.curve(places, places_ast, "a place of the table");
        let ys = self.curve(heights, heights_ast, "a value of the table");
        let (x, ((xs, place), (ys, unit))) = x.zip(xs.zip(ys))?;
        self.require((&x.unit, x_ast.span), place, Some(places_ast.span), "the argument of the table", 3);
        if xs.len() != ys.len() {
            let message = format!("this table has {} places and {} values", xs.len(), ys.len());
            let error = Diagnostic::error("elaborate::table", span, message)
                .label(places_ast.span, format!("are {} places", xs.len()))
                .label(heights_ast.span, format!("are {} values", ys.len()));
            self.errors.push(error.help("give each place its value"));
            return None;
        }
        if xs.len() < 2 {
            let message = "a table of one place is no curve".to_string();
            self.errors.push(
                Diagnostic::error("elaborate::table", span, message).help("give two places or more, with their values"),
            );
            return None;
        }
        if let Some(i) = (1..xs.len()).find(|&i| xs[i] <= xs[i - 1]) {
            let message = format!(
                "the places of a table must rise: place {} is {} and place {} is {}",
                i,
                xs[i - 1],
                i + 1,
                xs[i]
            );
            let at = entry_span(places_ast, i);
            self.errors.push(
                Diagnostic::error("elaborate::table", at, message).help("sort the places, and name each one once"),
            );
            return None;
        }
        let knots: Vec<(f64, f64)> = xs.into_iter().zip(ys).collect();
        match self.pool.table(x.expr, &knots) {
            Some(expr) => Some(Typed { expr, unit }),
            None => {
                let message = "the steps of this table are too large or too small for numbers".to_string();
                self.errors.push(
                    Diagnostic::error("elaborate::table", span, message).help("numbers reach from 1e-308 to 1e308"),
                );
                None
            }
        }
    }

    /// Numbers that are known now, and their common unit.
    fn curve(&mut self, value: &Value, e: &'a ast::Expr, about: &str) -> Option<(Vec<f64>, Unit)> {
        let all = self.numbers(value, e)?;
        let unit = all.iter().map(|t| &t.unit).find(|u| **u != Unit::Any).cloned().unwrap_or(Unit::Any);
        let mut numbers = Vec::with_capacity(all.len());
        for (i, t) in all.iter().enumerate() {
            let span = entry_span(e, i);
            self.require((&t.unit, span), unit.clone(), Some(entry_span(e, 0)), about, 3);
            let written = match &e.kind {
                ExprKind::List(items) => items.get(i).unwrap_or(e),
                _ => e,
            };
            let x = self.number(t, written)?;
            if !x.is_finite() {
                let message = format!("{about} is {x}");
                self.errors
                    .push(Diagnostic::error("elaborate::table", span, message).help("it must be a finite number"));
                return None;
            }
            numbers.push(x);
        }
        Some((numbers, unit))
    }
}

/// Where an entry is written, if the array is written out.
fn entry_span(e: &ast::Expr, i: usize) -> Span {
    match &e.kind {
        ExprKind::List(items) => items.get(i).map_or(e.span, |item| item.span),
        ExprKind::Paren(inner) => entry_span(inner, i),
        ExprKind::Number { .. }
        | ExprKind::Bool(_)
        | ExprKind::Path(_)
        | ExprKind::Unary(..)
        | ExprKind::Binary(..)
        | ExprKind::If(..)
        | ExprKind::Call(..) => e.span,
    }
}
