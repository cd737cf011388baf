//! `table(x, [x1, x2, ...], [y1, y2, ...])`: a measured curve; and `table2(x, y, [x1, ...], [y1, ...], [[z11, ...],
//! ...])`, a measured surface.

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
        self.rise(&xs, places_ast)?;
        let knots: Vec<(f64, f64)> = xs.into_iter().zip(ys).collect();
        match self.pool.table(x.expr, &knots) {
            Some(expr) => Some(Typed { expr, unit }),
            None => self.too_steep(span),
        }
    }

    /// The surface through the knots, at `x` and `y`. Rows go along x, one for each place of y.
    pub(super) fn surface(
        &mut self,
        [x, y, places, rows, heights]: [&Value; 5],
        args: &'a [ast::Expr],
        span: Span,
    ) -> Option<Typed> {
        let [x_ast, y_ast, xs_ast, ys_ast, zs_ast] = args else { return None };
        let (x, y) = (self.scalar(x.clone(), x_ast), self.scalar(y.clone(), y_ast));
        let xs = self.curve(places, xs_ast, "a place of the table in its first direction");
        let ys = self.curve(rows, ys_ast, "a place of the table in its second direction");
        let zs = self.heights(heights, zs_ast);
        let ((x, (xs, x_unit)), (y, (ys, y_unit))) = x.zip(xs).zip(y.zip(ys))?;
        let (zs, unit) = zs?;
        self.require((&x.unit, x_ast.span), x_unit, Some(xs_ast.span), "the first argument of the table", 3);
        self.require((&y.unit, y_ast.span), y_unit, Some(ys_ast.span), "the second argument of the table", 3);
        let width = zs.first().map_or(0, Vec::len);
        if (width, zs.len()) != (xs.len(), ys.len()) {
            let message = format!(
                "this table has {} by {} places, and {} rows of {} values",
                xs.len(),
                ys.len(),
                zs.len(),
                width
            );
            let error = Diagnostic::error("elaborate::table", span, message)
                .label(xs_ast.span, format!("are {} places of `{}`", xs.len(), self.words(x_ast)))
                .label(ys_ast.span, format!("are {} places of `{}`", ys.len(), self.words(y_ast)))
                .label(zs_ast.span, format!("are {} rows of {width}", zs.len()));
            let help = if (width, zs.len()) == (ys.len(), xs.len()) {
                "rows go along the first direction: exchange the directions, or write `transpose(...)`"
            } else {
                "give a row for each place of the second direction, with a value for each place of the first"
            };
            self.errors.push(error.help(help));
            return None;
        }
        let (x_rises, y_rises) = (self.rise(&xs, xs_ast), self.rise(&ys, ys_ast));
        x_rises.zip(y_rises)?;
        match self.pool.surface((x.expr, y.expr), &xs, &ys, &zs) {
            Some(expr) => Some(Typed { expr, unit }),
            None => self.too_steep(span),
        }
    }

    fn too_steep(&mut self, span: Span) -> Option<Typed> {
        let message = "the steps of this table are too large or too small for numbers".to_string();
        self.errors
            .push(Diagnostic::error("elaborate::table", span, message).help("numbers reach from 1e-308 to 1e308"));
        None
    }

    /// Two places or more, which rise.
    fn rise(&mut self, xs: &[f64], places: &ast::Expr) -> Option<()> {
        if xs.len() < 2 {
            let message = "a table of one place is no curve".to_string();
            self.errors.push(
                Diagnostic::error("elaborate::table", places.span, message)
                    .help("give two places or more, with their values"),
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
            let at = entry_span(places, i);
            self.errors.push(
                Diagnostic::error("elaborate::table", at, message).help("sort the places, and name each one once"),
            );
            return None;
        }
        Some(())
    }

    /// A matrix of numbers that are known now, and their common unit.
    fn heights(&mut self, value: &Value, e: &'a ast::Expr) -> Option<(Vec<Vec<f64>>, Unit)> {
        let rows = self.rows(value.clone(), e)?;
        let unit = rows.iter().flatten().map(|t| &t.unit).find(|u| **u != Unit::Any).cloned().unwrap_or(Unit::Any);
        let mut all = Vec::with_capacity(rows.len());
        for (j, row) in rows.iter().enumerate() {
            let line = entry(e, j);
            let mut numbers = Vec::with_capacity(row.len());
            for (i, t) in row.iter().enumerate() {
                let written = line.map_or(e, |line| entry(line, i).unwrap_or(line));
                let about = "a value of the table";
                self.require((&t.unit, written.span), unit.clone(), Some(e.span), about, 3);
                numbers.push(self.finite_number(t, written, about)?);
            }
            all.push(numbers);
        }
        Some((all, unit))
    }

    fn finite_number(&mut self, t: &Typed, e: &ast::Expr, about: &str) -> Option<f64> {
        let x = self.number(t, e)?;
        if x.is_finite() {
            return Some(x);
        }
        let message = format!("{about} is {x}");
        self.errors.push(Diagnostic::error("elaborate::table", e.span, message).help("it must be a finite number"));
        None
    }

    /// Numbers that are known now, and their common unit.
    fn curve(&mut self, value: &Value, e: &'a ast::Expr, about: &str) -> Option<(Vec<f64>, Unit)> {
        let all = self.numbers(value, e)?;
        let unit = all.iter().map(|t| &t.unit).find(|u| **u != Unit::Any).cloned().unwrap_or(Unit::Any);
        let mut numbers = Vec::with_capacity(all.len());
        for (i, t) in all.iter().enumerate() {
            let span = entry_span(e, i);
            self.require((&t.unit, span), unit.clone(), Some(entry_span(e, 0)), about, 3);
            let x = self.finite_number(t, entry(e, i).unwrap_or(e), about)?;
            numbers.push(x);
        }
        Some((numbers, unit))
    }
}

/// Where an entry is written, if the array is written out.
fn entry_span(e: &ast::Expr, i: usize) -> Span {
    entry(e, i).unwrap_or(e).span
}

/// An entry as it is written, if the array is written out.
fn entry(e: &ast::Expr, i: usize) -> Option<&ast::Expr> {
    match &e.kind {
        ExprKind::List(items) => items.get(i),
        ExprKind::Paren(inner) => entry(inner, i),
        ExprKind::Number { .. }
        | ExprKind::Bool(_)
        | ExprKind::Path(_)
        | ExprKind::Unary(..)
        | ExprKind::Binary(..)
        | ExprKind::If(..)
        | ExprKind::Call(..)
        | ExprKind::Range(..) => None,
    }
}
