//! Expressions as text of the language.

use super::{Expr, Node, Number, Pool};
use bond_runtime::ir::{Binary, Unary};
use rustc_hash::FxHashMap;
use std::cmp::Ordering;

/// How tightly a piece of text holds together.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub(super) enum Tightness {
    /// `if c then a else b`
    Choice,
    /// `a or b`
    Or,
    /// `a and b`
    And,
    /// `not a`
    Not,
    /// `a < b`
    Comparison,
    /// `a + b`
    Sum,
    /// `-a`
    Minus,
    /// `a*b`
    Product,
    /// `a^b`
    Power,
    /// A name, a number, a call.
    Atom,
}

/// Text of an expression.
#[derive(Clone, Debug)]
struct Text {
    text: String,
    tightness: Tightness,
    /// Variables come after parameters.
    variable: bool,
}

impl Text {
    /// The text, in parentheses where the place asks for more tightness.
    fn within(&self, least: Tightness) -> String {
        if self.tightness < least { format!("({})", self.text) } else { self.text.clone() }
    }
}

/// A number without its sign.
fn size(n: Number) -> (String, Tightness) {
    match n.abs() {
        Number::Ratio(a, 1) => (a.to_string(), Tightness::Atom),
        exact @ Number::Ratio(a, b) => match decimal(exact) {
            Some(text) => (text, Tightness::Atom),
            None => (format!("{a}/{b}"), Tightness::Product),
        },
        Number::Float(x) if x == std::f64::consts::PI => ("pi".to_string(), Tightness::Atom),
        Number::Float(x) if x.is_nan() => ("0/0".to_string(), Tightness::Product),
        Number::Float(x) if x.is_infinite() => ("1/0".to_string(), Tightness::Product),
        Number::Float(x) => (format!("{x:?}"), Tightness::Atom),
    }
}

/// The decimal that an exact number is, if it ends soon.
pub(super) fn decimal(n: Number) -> Option<String> {
    let x = n.to_f64();
    let text = format!("{x:?}");
    (text.len() <= 17 && Number::decimal(&text) == Some(n)).then_some(text)
}

/// A coefficient as a factor above and one below the line. Small fractions are written as such, others as decimals.
pub(super) fn coefficient(n: Number) -> (Number, Number) {
    match n {
        Number::Ratio(a, b) if b <= 12 && a.unsigned_abs() <= 100 => (Number::Ratio(a, 1), Number::Ratio(b, 1)),
        Number::Ratio(a, b) if decimal(n).is_none() => (Number::Ratio(a, 1), Number::Ratio(b, 1)),
        Number::Ratio(1, b) => (Number::ONE, Number::Ratio(b, 1)),
        Number::Ratio(..) | Number::Float(_) => (n, Number::ONE),
    }
}

impl Pool {
    /// The expression in the language's own notation; reads back to the same value, unless a part of it is too long to
    /// be written.
    pub fn print(&self, e: Expr) -> String {
        let mut texts: FxHashMap<Expr, Text> = FxHashMap::default();
        let nodes = self.ascending(&[e], &|_| true);
        let mut uses: FxHashMap<Expr, usize> = FxHashMap::default();
        for &e in &nodes {
            self.node(e).each_child(&mut |c| *uses.entry(c).or_default() += 1);
            // the factors of a product that is a term are written with the term
            if let Node::Sum(_, terms) = self.node(e) {
                for &(t, _) in terms.iter() {
                    self.node(t).each_child(&mut |c| *uses.entry(c).or_default() += 1);
                }
            }
        }
        for node in nodes {
            let (text, tightness) = match self.text(node, &texts) {
                (text, _) if text.len() > self.options.letters && node != e => ("...".to_string(), Tightness::Atom),
                written => written,
            };
            texts.insert(node, Text { text, tightness, variable: self.constant(node).is_none() });
            // a text that is not needed any more is dropped: a deep expression would keep all its parts
            let mut used = |c: Expr| {
                let left = uses.entry(c).or_default();
                *left = left.saturating_sub(1);
                if *left == 0 {
                    texts.remove(&c);
                }
            };
            self.node(node).each_child(&mut used);
            if let Node::Sum(_, terms) = self.node(node) {
                terms.iter().for_each(|&(t, _)| self.node(t).each_child(&mut used));
            }
        }
        texts.remove(&e).map(|t| t.text).unwrap_or_default()
    }

    /// Parameters first, then variables, each by text.
    fn natural(a: &Text, b: &Text) -> Ordering {
        (a.variable, &a.text).cmp(&(b.variable, &b.text))
    }

    fn text(&self, e: Expr, of: &FxHashMap<Expr, Text>) -> (String, Tightness) {
        let within = |e: Expr, least: Tightness| of.get(&e).map(|t| t.within(least)).unwrap_or_default();
        match self.node(e) {
            Node::Number(n) => signed(n.is_negative(), size(*n)),
            Node::Symbol(s) => (self.name(*s).to_string(), Tightness::Atom),
            Node::Sum(c, terms) => self.sum_text(*c, terms, of),
            Node::Product(c, factors) => signed(c.is_negative(), self.product_text(c.abs(), factors, of)),
            Node::Power(a, b) => {
                (format!("{}^{}", within(*a, Tightness::Atom), within(*b, Tightness::Atom)), Tightness::Power)
            }
            Node::Unary(Unary::Not, a) => (format!("not {}", within(*a, Tightness::Power)), Tightness::Not),
            Node::Unary(f, a) => (format!("{}({})", f.name(), within(*a, Tightness::Choice)), Tightness::Atom),
            Node::Binary(f, a, b) => self.binary_text(*f, self.ordered(*f, (*a, *b), of), &within),
            Node::Select(c, a, b) => {
                let [c, a, b] = [c, a, b].map(|&x| within(x, Tightness::Or));
                (format!("if {c} then {a} else {b}"), Tightness::Choice)
            }
        }
    }

    /// The arguments of what can be turned around: constants last, else by text.
    fn ordered(&self, f: Binary, (a, b): (Expr, Expr), of: &FxHashMap<Expr, Text>) -> (Expr, Expr) {
        let key = |e: Expr| (self.constant(e).is_some(), of.get(&e).map(|t| &t.text));
        match f {
            Binary::Min | Binary::Max | Binary::Eq | Binary::And | Binary::Or if key(b) < key(a) => (b, a),
            Binary::Min
            | Binary::Max
            | Binary::Eq
            | Binary::And
            | Binary::Or
            | Binary::Lt
            | Binary::Le
            | Binary::Atan2
            | Binary::Add
            | Binary::Sub
            | Binary::Mul
            | Binary::Div
            | Binary::Pow => (a, b),
        }
    }

    fn binary_text(
        &self,
        f: Binary,
        (a, b): (Expr, Expr),
        within: &dyn Fn(Expr, Tightness) -> String,
    ) -> (String, Tightness) {
        let infix = |sign: &str, a: Expr, b: Expr, is: Tightness, inner: Tightness| {
            (format!("{} {sign} {}", within(a, inner), within(b, inner)), is)
        };
        let turned = self.constant(a).is_some() && self.constant(b).is_none();
        match f {
            Binary::Lt if turned => infix(">", b, a, Tightness::Comparison, Tightness::Sum),
            Binary::Le if turned => infix(">=", b, a, Tightness::Comparison, Tightness::Sum),
            Binary::Lt => infix("<", a, b, Tightness::Comparison, Tightness::Sum),
            Binary::Le => infix("<=", a, b, Tightness::Comparison, Tightness::Sum),
            Binary::Eq => infix("==", a, b, Tightness::Comparison, Tightness::Sum),
            Binary::And => infix("and", a, b, Tightness::And, Tightness::Not),
            Binary::Or => infix("or", a, b, Tightness::Or, Tightness::And),
            Binary::Min
            | Binary::Max
            | Binary::Atan2
            | Binary::Add
            | Binary::Sub
            | Binary::Mul
            | Binary::Div
            | Binary::Pow => {
                let [a, b] = [a, b].map(|x| within(x, Tightness::Choice));
                (format!("{}({a}, {b})", f.name()), Tightness::Atom)
            }
        }
    }

    fn sum_text(&self, c: Number, terms: &[(Expr, Number)], of: &FxHashMap<Expr, Text>) -> (String, Tightness) {
        let mut parts: Vec<(bool, Text)> = Vec::with_capacity(terms.len());
        for &(t, n) in terms {
            let (text, tightness) = match self.node(t) {
                Node::Product(_, factors) => self.product_text(n.abs(), factors, of),
                Node::Number(_)
                | Node::Symbol(_)
                | Node::Sum(..)
                | Node::Power(..)
                | Node::Unary(..)
                | Node::Binary(..)
                | Node::Select(..) => self.product_text(n.abs(), &[(t, Number::ONE)], of),
            };
            parts.push((n.is_negative(), Text { text, tightness, variable: self.constant(t).is_none() }));
        }
        parts.sort_by(|(m, a), (n, b)| m.cmp(n).then_with(|| Self::natural(a, b)));
        if !c.is_zero() {
            let (text, tightness) = size(c);
            let at = if c.is_negative() { parts.iter().filter(|(minus, _)| !minus).count() } else { 0 };
            parts.insert(at, (c.is_negative(), Text { text, tightness, variable: false }));
        }
        let mut text = String::new();
        for (i, (minus, part)) in parts.iter().enumerate() {
            text.push_str(match (i, minus) {
                (0, true) => "-",
                (0, false) => "",
                (_, true) => " - ",
                (_, false) => " + ",
            });
            text.push_str(&part.within(Tightness::Product));
        }
        (text, Tightness::Sum)
    }

    /// A product with a coefficient that is not negative, as a fraction where something stands below.
    fn product_text(&self, c: Number, factors: &[(Expr, Number)], of: &FxHashMap<Expr, Text>) -> (String, Tightness) {
        let (mut above, mut below): (Vec<Text>, Vec<Text>) = (Vec::new(), Vec::new());
        for &(f, n) in factors {
            if let Some(base) = of.get(&f) {
                let side = if n.is_negative() { &mut below } else { &mut above };
                side.push(power_text(base, n.abs()));
            }
        }
        let number = |n: Number| {
            let (text, tightness) = size(n);
            Text { text, tightness, variable: false }
        };
        above.sort_by(Self::natural);
        below.sort_by(Self::natural);
        let (top, bottom) = coefficient(c);
        if !top.is_one() || above.is_empty() {
            above.insert(0, number(top));
        }
        if !bottom.is_one() {
            below.insert(0, number(bottom));
        }
        let join = |all: &[Text]| {
            let all: Vec<String> = all
                .iter()
                .enumerate()
                .map(|(i, t)| t.within(if i == 0 { Tightness::Product } else { Tightness::Power }))
                .collect();
            all.join("*")
        };
        match (&above[..], &below[..]) {
            ([one], []) => (one.text.clone(), one.tightness),
            (_, []) => (join(&above), Tightness::Product),
            (_, [one]) => (format!("{}/{}", join(&above), one.within(Tightness::Power)), Tightness::Product),
            (_, _) => (format!("{}/({})", join(&above), join(&below)), Tightness::Product),
        }
    }
}

fn signed(negative: bool, (text, tightness): (String, Tightness)) -> (String, Tightness) {
    if negative {
        let text = if tightness < Tightness::Product { format!("-({text})") } else { format!("-{text}") };
        (text, Tightness::Minus)
    } else {
        (text, tightness)
    }
}

/// A base to a positive exponent.
fn power_text(base: &Text, n: Number) -> Text {
    let (text, tightness) = if n.is_one() {
        return base.clone();
    } else if n == Number::HALF {
        (format!("sqrt({})", base.text), Tightness::Atom)
    } else {
        let (exponent, tightness) = size(n);
        let exponent = if tightness < Tightness::Atom { format!("({exponent})") } else { exponent };
        (format!("{}^{exponent}", base.within(Tightness::Atom)), Tightness::Power)
    };
    Text { text, tightness, variable: base.variable }
}
