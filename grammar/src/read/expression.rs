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
        pairs.flat_map(children).map(|pair| self.entry(pair)).collect()
    }

    /// The indices that stand next.
    pub(super) fn indices_ahead<'p>(
        &mut self,
        parts: &mut std::iter::Peekable<impl Iterator<Item = Pair<'p, Rule>>>,
    ) -> Vec<Expr> {
        let index = std::iter::from_fn(|| parts.next_if(|pair| pair.as_rule() == Rule::index)).collect::<Vec<_>>();
        self.indices(index.into_iter())
    }

    /// An index, or a range of them.
    fn entry(&mut self, pair: Pair<Rule>) -> Expr {
        let span = self.span(&pair);
        let mut parts = children(pair);
        let from = self.expr(next(&mut parts));
        match parts.next() {
            None => from,
            Some(to) => Expr { kind: ExprKind::Range(Box::new(from), Box::new(self.expr(to))), span },
        }
    }

    pub(super) fn path(&mut self, pair: Pair<Rule>) -> Path {
        let span = self.span(&pair);
        let mut segments: Vec<Segment> = Vec::new();
        for pair in children(pair) {
            if pair.as_rule() == Rule::index {
                for pair in children(pair) {
                    let index = self.entry(pair);
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
        self.operation(pairs)
    }

    /// Operands with operators between them.
    fn operation<'p>(&mut self, pairs: impl Iterator<Item = Pair<'p, Rule>>) -> Expr {
        let is_unit = self.is_unit;
        let pairs = pairs.flat_map(|pair| parts(pair, is_unit));
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
            Rule::unit_op if sign.as_str() == "*" => Binary::Mul,
            Rule::unit_op => Binary::Div,
            Rule::pow | Rule::unit_pow => Binary::Pow,
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

    fn primary(&mut self, pair: Pair<Rule>) -> Expr {
        let span = self.span(&pair);
        let kind = match pair.as_rule() {
            Rule::quantity | Rule::timed_quantity => return self.quantity(pair),
            Rule::boolean => ExprKind::Bool(pair.as_str() == "true"),
            Rule::path => ExprKind::Path(self.path(pair)),
            // Behind a unit that ended before it.
            Rule::symbol | Rule::bare_symbol => {
                let segments = vec![Segment { name: self.name(&pair), index: Vec::new() }];
                ExprKind::Path(Path { segments, span })
            }
            Rule::unit_group => return self.group(pair),
            Rule::power => return self.power(&pair),
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
        let mut span = span;
        let unit = parts.next().map(|pair| {
            let whole = self.span(&pair);
            let rest = behind_unit(&pair, self.is_unit);
            let kept: Vec<Pair<Rule>> = children(pair).collect();
            let kept = &kept[..kept.len() - rest.len()];
            span.end = kept.last().map_or(span.end, |last| self.span(last).end);
            let mut factors = Vec::new();
            self.factors(kept.iter().cloned(), (1, 1), &mut factors);
            Unit { factors, span: Span { end: span.end, ..whole } }
        });
        Expr { kind: ExprKind::Number { digits, unit }, span }
    }

    /// `(m*x)` behind a unit that ended before it, without its exponent.
    fn group(&mut self, pair: Pair<Rule>) -> Expr {
        let mut span = self.span(&pair);
        let within = children(pair).filter(|part| part.as_rule() != Rule::exponent);
        let within: Vec<Pair<Rule>> = within.collect();
        if let Some(last) = within.last() {
            span.end = self.span(last).end + 1; // its bracket
        }
        let within = within.into_iter().flat_map(operands);
        Expr { kind: ExprKind::Paren(Box::new(self.operation(within))), span }
    }

    /// The `2`, `-1` or `(1/2)` of a power behind a unit that ended before it.
    fn power(&self, pair: &Pair<Rule>) -> Expr {
        let span = self.span(pair);
        let of = |kind| Expr { kind, span };
        let number = |digits: &str| of(ExprKind::Number { digits: digits.to_string(), unit: None });
        let signed = |digits: &str| match digits.strip_prefix('-') {
            Some(digits) => of(ExprKind::Unary(Unary::Neg, Box::new(number(digits)))),
            None => number(digits),
        };
        let text = pair.as_str();
        let inner = text.trim_matches(['(', ')']);
        let value = match inner.split_once('/') {
            Some((above, below)) => of(ExprKind::Binary(Binary::Div, Box::new(signed(above)), Box::new(number(below)))),
            None => signed(inner),
        };
        if text.starts_with('(') { of(ExprKind::Paren(Box::new(value))) } else { value }
    }

    /// Factors of a unit or of a group in it, each to a power.
    fn factors<'p>(
        &mut self,
        pairs: impl Iterator<Item = Pair<'p, Rule>>,
        power: (i32, i32),
        factors: &mut Vec<(String, (i32, i32), Span)>,
    ) {
        let mut sign = 1;
        for pair in pairs {
            let own = children(pair.clone()).find(|part| part.as_rule() == Rule::exponent);
            let (above, below) =
                own.map_or((sign * power.0, power.1), |own| self.exponent(own, (sign * power.0, power.1)));
            match pair.as_rule() {
                Rule::unit_op => sign = if pair.as_str() == "/" { -1 } else { 1 },
                Rule::unit_group => {
                    let within: Vec<Pair<Rule>> = children(pair).collect();
                    self.factors(within.into_iter(), (above, below), factors);
                }
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
        .op(left(Rule::mul) | left(Rule::div) | left(Rule::unit_op))
        .op(Op::prefix(Rule::neg))
        .op(Op::infix(Rule::pow, Assoc::Right) | Op::infix(Rule::unit_pow, Assoc::Right))
});

/// What follows the unit of a number within its chain of factors, from the operator on: the unit ends before its first
/// factor that is none. Nothing follows where the first factor is none, which is an error of later.
fn behind_unit<'p>(unit: &Pair<'p, Rule>, is_unit: &dyn Fn(&str) -> bool) -> Vec<Pair<'p, Rule>> {
    let mut parts: Vec<Pair<Rule>> = children(unit.clone()).collect();
    match parts.iter().position(|part| part.as_rule() != Rule::unit_op && !is_of_units(part, is_unit)) {
        Some(at) if at > 1 => parts.split_off(at - 1),
        _ => Vec::new(),
    }
}

/// Whether a factor, or each in a group, is a unit.
fn is_of_units(part: &Pair<Rule>, is_unit: &dyn Fn(&str) -> bool) -> bool {
    match part.as_rule() {
        Rule::factor | Rule::timed_factor => is_unit(next(&mut children(part.clone())).as_str()),
        Rule::unit_group => children(part.clone()).all(|part| is_of_units(&part, is_unit)),
        _ => true,
    }
}

/// An operand or operator of an expression; a number with what stands behind its unit gives several.
fn parts<'p>(pair: Pair<'p, Rule>, is_unit: &dyn Fn(&str) -> bool) -> impl Iterator<Item = Pair<'p, Rule>> {
    let unit = match pair.as_rule() {
        Rule::quantity | Rule::timed_quantity => children(pair.clone()).nth(1),
        _ => None,
    };
    let rest = unit.map_or_else(Vec::new, |unit| behind_unit(&unit, is_unit));
    std::iter::once(pair).chain(rest.into_iter().flat_map(operands))
}

/// A factor behind a unit as an operand, with the operator and the operand of its power.
fn operands(part: Pair<Rule>) -> Vec<Pair<Rule>> {
    let exponent = |part: &Pair<'_, Rule>| part.as_rule() == Rule::exponent;
    match part.as_rule() {
        Rule::factor | Rule::timed_factor => {
            children(part).flat_map(|part| if exponent(&part) { operands(part) } else { vec![part] }).collect()
        }
        Rule::unit_group => {
            let power = children(part.clone()).find(exponent);
            std::iter::once(part).chain(power.into_iter().flat_map(operands)).collect()
        }
        Rule::exponent => children(part).collect(),
        _ => vec![part],
    }
}
