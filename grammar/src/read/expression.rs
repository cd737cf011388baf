//! Expressions, paths and units.

use super::{Reader, Rule, children, inner, next};
use crate::ast::*;
use crate::diagnostic::Diagnostic;
use crate::explain;
use crate::source::Span;
use pest::iterators::Pair;
use pest::pratt_parser::{Assoc, Op, PrattParser};
use std::sync::LazyLock;

impl Reader<'_> {
    pub(super) fn indices<'p>(&mut self, pairs: impl Iterator<Item = Pair<'p, Rule>>) -> Vec<Expr> {
        pairs.flat_map(children).map(|pair| self.expr(pair)).collect()
    }

    pub(super) fn path(&mut self, pair: Pair<Rule>) -> Path {
        let span = self.span(&pair);
        let mut segments: Vec<Segment> = Vec::new();
        for pair in children(pair) {
            if pair.as_rule() == Rule::index {
                for pair in children(pair) {
                    let index = self.expr(pair);
                    if let Some(segment) = segments.last_mut() {
                        segment.index.push(index);
                    }
                }
            } else {
                segments.push(Segment { name: self.name(&pair), index: Vec::new() });
            }
        }
        Path { segments, span }
    }

    pub(super) fn expr(&mut self, pair: Pair<Rule>) -> Expr {
        let pairs = pair.into_inner();
        let reader = std::cell::RefCell::new(self);
        PRECEDENCE
            .map_primary(|pair| reader.borrow_mut().primary(pair))
            .map_prefix(|sign, operand| {
                let span = reader.borrow().span(&sign).to(operand.span);
                let sign = if sign.as_rule() == Rule::neg { Unary::Neg } else { Unary::Not };
                Expr { kind: ExprKind::Unary(sign, Box::new(operand)), span }
            })
            .map_infix(|left, sign, right| reader.borrow_mut().binary(left, sign, right))
            .parse(pairs)
    }

    fn binary(&mut self, left: Expr, sign: Pair<Rule>, right: Expr) -> Expr {
        let span = left.span.to(right.span);
        let operator = match sign.as_rule() {
            Rule::add => Binary::Add,
            Rule::sub => Binary::Sub,
            Rule::mul => Binary::Mul,
            Rule::div => Binary::Div,
            Rule::pow => Binary::Pow,
            Rule::lt => Binary::Lt,
            Rule::le => Binary::Le,
            Rule::gt => Binary::Gt,
            Rule::ge => Binary::Ge,
            Rule::eq => Binary::Eq,
            Rule::ne => Binary::Ne,
            Rule::and_op => Binary::And,
            _ => Binary::Or,
        };
        if is_comparison(operator)
            && let ExprKind::Binary(first, _, middle) = &left.kind
            && is_comparison(*first)
        {
            let slice = |span| self.scan.slice(span);
            let (sign, middle) = (sign.as_str().trim(), slice(middle.span));
            let help =
                format!("write two, joined by `and`: `{} and {middle} {sign} {}`", slice(left.span), slice(right.span));
            let message = "comparisons cannot be chained";
            self.errors.push(Diagnostic::error("syntax::comparison", span, message).help(help));
        }
        if matches!(operator, Binary::Mul | Binary::Div) {
            self.check_unit_end(&left, self.span(&sign), &right);
        }
        if operator == Binary::Pow {
            self.check_unit_power(&left, self.span(&sign), &right);
        }
        Expr { kind: ExprKind::Binary(operator, Box::new(left), Box::new(right)), span }
    }

    /// Refuses `2 m^2^2` and `2 m^(0.5)`: a `^` that touches a unit looks like the unit's, and would be that of number
    /// and unit together.
    fn check_unit_power(&mut self, left: &Expr, sign: Span, right: &Expr) {
        let ExprKind::Number { unit: Some(unit), .. } = &left.kind else { return };
        if unit.span.end != sign.start {
            return;
        }
        let [number, power, both] =
            [left.span, right.span, unit.span.to(right.span)].map(|s| self.scan.slice(s).to_string());
        let raised = format!("`({number})^{power}`");
        let bare = unit.factors.last().is_some_and(|factor| factor.2.end == unit.span.end);
        let exponent = explain::exponent(self.scan.slice(unit.span), power.trim_matches(['(', ')']));
        let (message, help) = match (bare, exponent) {
            (true, Some(exponent)) => (
                format!("`{power}` is not an exponent of a unit: a fraction is written with `/`, in parentheses"),
                format!("write `{exponent}`, or for a power of number and unit together {raised}"),
            ),
            (false, _) => (
                format!("the second `^` of `{both}` is read as that of number and unit together"),
                format!("write {raised} if that is meant; a unit has one exponent"),
            ),
            (true, None) => return,
        };
        self.errors.push(Diagnostic::error("syntax::exponent", sign.to(right.span), message).help(help));
    }

    /// A unit ends at the first space, so that what follows its operator without one would belong to it.
    fn check_unit_end(&mut self, left: &Expr, sign: Span, right: &Expr) {
        let mut last = left;
        let unit = loop {
            match &last.kind {
                ExprKind::Binary(_, _, b) | ExprKind::Unary(_, b) => last = b,
                ExprKind::Number { unit: Some(unit), .. } => break unit,
                _ => return,
            }
        };
        let is_number = matches!(right.kind, ExprKind::Number { .. });
        if unit.span.end == sign.start && sign.end == right.span.start && !is_number {
            // `1 H*f*(x + 1)`: the variables of laws are not units.
            let plain = !self.scan.slice(unit.span).contains('(');
            let variable = unit.factors.iter().skip(1).find(|f| is_variable(&f.0));
            if let Some((name, _, at)) = variable.filter(|_| plain) {
                let text = self.scan.slice(last.span.to(right.span));
                let (head, rest) = text.split_at((at.start - last.span.start) as usize);
                let (head, sign) = head.split_at(head.len() - 1);
                let message = format!("`{name}` is read as a unit, which ends at the first space, but is not one");
                let help = format!("put spaces around the operator: `{head} {sign} {}`", set_apart(rest));
                self.errors.push(Diagnostic::error("syntax::unit", at.to(right.span), message).help(help));
                return;
            }
            let [unit, sign_, right_] = [unit.span, sign, right.span].map(|s| self.scan.slice(s).to_string());
            let message =
                format!("`{unit}{sign_}{right_}` is read as a unit, which ends at the first space, but is not one");
            let left = self.scan.slice(last.span);
            let help = format!("put spaces around the operator: `{left} {sign_} {}`", set_apart(&right_));
            self.errors.push(Diagnostic::error("syntax::unit", sign.to(right.span), message).help(help));
        }
    }

    fn primary(&mut self, pair: Pair<Rule>) -> Expr {
        let span = self.span(&pair);
        let kind = match pair.as_rule() {
            Rule::quantity | Rule::timed_quantity => return self.quantity(pair),
            Rule::boolean => ExprKind::Bool(pair.as_str() == "true"),
            Rule::path => ExprKind::Path(self.path(pair)),
            Rule::paren => ExprKind::Paren(Box::new(self.expr(inner(pair)))),
            Rule::list => ExprKind::List(children(pair).map(|pair| self.expr(pair)).collect()),
            Rule::call => {
                let mut parts = children(pair);
                let name = self.name(&next(&mut parts));
                ExprKind::Call(name, parts.map(|pair| self.expr(pair)).collect())
            }
            _ => {
                let mut parts = children(pair);
                let condition = Box::new(self.expr(next(&mut parts)));
                let then = Box::new(self.expr(next(&mut parts)));
                ExprKind::If(condition, then, Box::new(self.expr(next(&mut parts))))
            }
        };
        Expr { kind, span }
    }

    pub(super) fn quantity(&mut self, pair: Pair<Rule>) -> Expr {
        let span = self.span(&pair);
        let mut parts = children(pair);
        let digits = next(&mut parts).as_str().to_string();
        let unit = parts.next().map(|pair| {
            let span = self.span(&pair);
            let mut factors = Vec::new();
            self.factors(pair, (1, 1), &mut factors);
            Unit { factors, span }
        });
        Expr { kind: ExprKind::Number { digits, unit }, span }
    }

    /// Factors of a unit or of a group in it, each to a power.
    fn factors(&mut self, pair: Pair<Rule>, power: (i32, i32), factors: &mut Vec<(String, (i32, i32), Span)>) {
        let mut sign = 1;
        for pair in children(pair) {
            let own = children(pair.clone()).find(|part| part.as_rule() == Rule::exponent);
            let (above, below) =
                own.map_or((sign * power.0, power.1), |own| self.exponent(own, (sign * power.0, power.1)));
            match pair.as_rule() {
                Rule::unit_op => sign = if pair.as_str() == "/" { -1 } else { 1 },
                Rule::unit_group => self.factors(pair, (above, below), factors),
                Rule::factor | Rule::timed_factor => {
                    let symbol = next(&mut children(pair));
                    factors.push((symbol.as_str().to_string(), (above, below), self.span(&symbol)));
                }
                _ => {}
            }
        }
    }

    /// `^2`, `^-1`, `^(1/2)` of a power as a reduced fraction.
    fn exponent(&mut self, pair: Pair<Rule>, power: (i32, i32)) -> (i32, i32) {
        const MAX_EXPONENT: i32 = 1000;
        let digits = pair.as_str().trim_matches(['^', '(', ')']);
        let (above, below) = digits.split_once('/').unwrap_or((digits, "1"));
        let within = |n: &i32| n.abs() <= MAX_EXPONENT;
        let times = |n: Option<i32>, by: i32| n.filter(within)?.checked_mul(by);
        if let (Some(above), Some(below)) = (times(above.parse().ok(), power.0), times(below.parse().ok(), power.1))
            && below > 0
        {
            let (mut a, mut b) = (above.abs(), below);
            while a != 0 {
                (a, b) = (b % a, a);
            }
            if within(&(above / b)) && within(&(below / b)) {
                return (above / b, below / b);
            }
        }
        let message = format!("`{}` is not an exponent of a unit", pair.as_str().trim_start_matches('^'));
        let help = format!("an exponent is a whole number or a fraction such as `^(1/2)`, at most {MAX_EXPONENT}");
        let error = Diagnostic::error("syntax::exponent", self.span(&pair), message);
        self.errors.push(error.help(help));
        (1, 1)
    }
}

fn is_comparison(operator: Binary) -> bool {
    match operator {
        Binary::Lt | Binary::Le | Binary::Gt | Binary::Ge | Binary::Eq | Binary::Ne => true,
        Binary::Add | Binary::Sub | Binary::Mul | Binary::Div | Binary::Pow | Binary::And | Binary::Or => false,
    }
}

/// From the loosest operators to the tightest.
static PRECEDENCE: LazyLock<PrattParser<Rule>> = LazyLock::new(|| {
    let left = |rule| Op::infix(rule, Assoc::Left);
    PrattParser::new()
        .op(left(Rule::or_op))
        .op(left(Rule::and_op))
        .op(Op::prefix(Rule::not_op))
        .op(left(Rule::lt) | left(Rule::le) | left(Rule::gt) | left(Rule::ge) | left(Rule::eq) | left(Rule::ne))
        .op(left(Rule::add) | left(Rule::sub))
        .op(left(Rule::mul) | left(Rule::div))
        .op(Op::prefix(Rule::neg))
        .op(Op::infix(Rule::pow, Assoc::Right))
});

/// Whether this is a variable of laws, time, or a name, and not a unit.
fn is_variable(name: &str) -> bool {
    matches!(name, "e" | "f" | "p" | "q" | "t") || name.contains(|c: char| c.is_ascii_digit() || c == '_')
}

/// A text with spaces around the operators before variables, which would else be read as units.
fn set_apart(text: &str) -> String {
    let is_name = |c: char| c.is_alphanumeric() || c == '_';
    let mut apart = String::new();
    for (at, c) in text.char_indices() {
        let rest = &text[at + c.len_utf8()..];
        let name = &rest[..rest.find(|c| !is_name(c)).unwrap_or(rest.len())];
        let joined = matches!(c, '*' | '/') && text[..at].ends_with(is_name) && name.starts_with(char::is_alphabetic);
        match joined && is_variable(name) {
            true => apart.extend([' ', c, ' ']),
            false => apart.push(c),
        }
    }
    apart
}
