//! Expressions as formulas.

use super::greek::greek;
use super::print::coefficient;
use super::unary::{Latex, row};
use super::{Expr, Node, Number, Pool};
use bond_runtime::ir::Binary;
use rustc_hash::FxHashMap;

/// How tightly a formula holds together.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
enum Tightness {
    Logic,
    Sum,
    Product,
    /// A function with its argument, a power.
    Power,
    Atom,
}

#[derive(Clone, Debug)]
struct Formula {
    text: String,
    tightness: Tightness,
    variable: bool,
}

impl Formula {
    fn within(&self, least: Tightness) -> String {
        if self.tightness < least { format!(r"\left({}\right)", self.text) } else { self.text.clone() }
    }
}

const GREEK: [&str; 31] = [
    "alpha", "beta", "gamma", "delta", "epsilon", "zeta", "eta", "theta", "iota", "kappa", "lambda", "mu", "nu", "xi",
    "pi", "rho", "sigma", "tau", "phi", "chi", "psi", "omega", "Gamma", "Delta", "Theta", "Lambda", "Sigma", "Phi",
    "Psi", "Omega", "Xi",
];

/// One word: a letter, a Greek letter as it is or by its name, or upright text.
fn word(text: &str) -> String {
    let mut letters = text.chars();
    if GREEK.contains(&text) {
        format!(r"\{text}")
    } else if let (Some(letter), None) = (letters.next(), letters.next()) {
        greek(letter).map_or(text.to_string(), String::from)
    } else {
        let letters = text.trim_end_matches(|c: char| c.is_ascii_digit());
        let digits = &text[letters.len()..];
        if !digits.is_empty() && (letters.chars().count() == 1 || GREEK.contains(&letters)) {
            return format!("{}_{{{digits}}}", word(letters));
        }
        format!(r"\mathrm{{{}}}", upright(text))
    }
}

/// What stands in upright text.
fn upright(text: &str) -> String {
    let mut out = String::new();
    for c in text.chars() {
        match greek(c) {
            // The space ends the command, and is not set.
            Some(letter) => out.extend([letter, " "]),
            None if c == '_' => out.push_str(r"\_"),
            None => out.push(c),
        }
    }
    out
}

/// `spring.q` as q with the index spring, `k_wall` as k with the index wall.
fn symbol(name: &str) -> String {
    if let Some((path, last)) = name.rsplit_once('.') {
        let path = upright(path);
        let last = word(last);
        let (last, more) = match last.split_once("_{") {
            Some((head, index)) => (head.to_string(), format!(",{}", index.trim_end_matches('}'))),
            None => (last, String::new()),
        };
        return format!(r"{last}_{{\mathrm{{{path}}}{more}}}");
    }
    match name.split_once('_') {
        Some((head, index)) if !head.is_empty() && !index.is_empty() => {
            let index = word(&index.replace('_', " "));
            format!("{}_{{{index}}}", word(head))
        }
        Some(_) | None => word(name),
    }
}

fn size(n: Number) -> String {
    match n.abs() {
        Number::Ratio(a, 1) => a.to_string(),
        exact @ Number::Ratio(a, b) => super::print::decimal(exact).unwrap_or_else(|| format!(r"\frac{{{a}}}{{{b}}}")),
        Number::Float(x) if x == std::f64::consts::PI => r"\pi".to_string(),
        Number::Float(x) if x.is_nan() => r"\mathrm{NaN}".to_string(),
        Number::Float(x) if x.is_infinite() => r"\infty".to_string(),
        Number::Float(x) => {
            let text = format!("{x:?}");
            match text.split_once('e') {
                Some((mantissa, exponent)) => format!(r"{mantissa}\cdot 10^{{{exponent}}}"),
                None => text,
            }
        }
    }
}

impl Pool {
    /// The expression as a LaTeX formula, to be set in mathematics mode.
    pub fn latex(&self, e: Expr) -> String {
        let mut known: FxHashMap<Expr, Formula> = FxHashMap::default();
        for e in self.ascending(&[e], &|_| true) {
            let (text, tightness) = self.formula(e, &known);
            known.insert(e, Formula { text, tightness, variable: self.constant(e).is_none() });
        }
        known.remove(&e).map(|f| f.text).unwrap_or_default()
    }

    fn formula(&self, e: Expr, of: &FxHashMap<Expr, Formula>) -> (String, Tightness) {
        let within = |e: Expr, least: Tightness| of.get(&e).map(|f| f.within(least)).unwrap_or_default();
        match self.node(e) {
            Node::Number(n) if n.is_negative() => (format!("-{}", size(*n)), Tightness::Sum),
            Node::Number(n) => (size(*n), Tightness::Atom),
            Node::Symbol(s) => (symbol(self.name(*s)), Tightness::Atom),
            Node::Sum(c, terms) => self.sum_formula(*c, terms, of),
            Node::Product(c, factors) => {
                let (text, tightness) = product_formula(c.abs(), factors, of);
                if c.is_negative() { (format!("-{text}"), Tightness::Sum) } else { (text, tightness) }
            }
            Node::Power(a, b) => {
                (format!("{}^{{{}}}", within(*a, Tightness::Atom), within(*b, Tightness::Logic)), Tightness::Power)
            }
            Node::Unary(f, a) => {
                let inside = within(*a, Tightness::Logic);
                match row(*f).latex {
                    Latex::Operator => {
                        (format!(r"\operatorname{{{}}}\left({inside}\right)", f.name()), Tightness::Power)
                    }
                    Latex::Command(name) => (format!(r"\{name}\left({inside}\right)"), Tightness::Power),
                    Latex::Between(left, right) => (format!("{left}{inside}{right}"), Tightness::Atom),
                    Latex::Exponent => (format!("e^{{{inside}}}"), Tightness::Power),
                    Latex::Prefix(sign) => (format!("{sign}{}", within(*a, Tightness::Atom)), Tightness::Power),
                }
            }
            Node::Binary(f, a, b) => {
                let turned = self.constant(*a).is_some() && self.constant(*b).is_none();
                binary_formula(*f, turned, (*a, *b), &within)
            }
            Node::Select(c, a, b) => {
                let [c, a, b] = [c, a, b].map(|&x| within(x, Tightness::Logic));
                (
                    format!(r"\begin{{cases}}{a} & \text{{if }} {c}\\{b} & \text{{otherwise}}\end{{cases}}"),
                    Tightness::Sum,
                )
            }
        }
    }

    fn sum_formula(&self, c: Number, terms: &[(Expr, Number)], of: &FxHashMap<Expr, Formula>) -> (String, Tightness) {
        let mut parts: Vec<(bool, bool, String)> = Vec::new();
        for &(t, n) in terms {
            let (text, tightness) = match self.node(t) {
                Node::Product(_, factors) => product_formula(n.abs(), factors, of),
                Node::Number(_)
                | Node::Symbol(_)
                | Node::Sum(..)
                | Node::Power(..)
                | Node::Unary(..)
                | Node::Binary(..)
                | Node::Select(..) => product_formula(n.abs(), &[(t, Number::ONE)], of),
            };
            let variable = self.constant(t).is_none();
            let part = Formula { text, tightness, variable };
            parts.push((n.is_negative(), variable, part.within(Tightness::Product)));
        }
        parts.sort();
        if !c.is_zero() {
            let at = if c.is_negative() { parts.iter().filter(|(minus, ..)| !minus).count() } else { 0 };
            parts.insert(at, (c.is_negative(), false, size(c)));
        }
        let mut text = String::new();
        for (i, (minus, _, part)) in parts.iter().enumerate() {
            text.push_str(match (i, minus) {
                (0, true) => "-",
                (0, false) => "",
                (_, true) => " - ",
                (_, false) => " + ",
            });
            text.push_str(part);
        }
        (text, Tightness::Sum)
    }
}

fn product_formula(c: Number, factors: &[(Expr, Number)], of: &FxHashMap<Expr, Formula>) -> (String, Tightness) {
    let mut above: Vec<(bool, String)> = Vec::new();
    let mut below: Vec<(bool, String)> = Vec::new();
    for &(f, n) in factors {
        let Some(base) = of.get(&f) else { continue };
        let size_of = n.abs();
        let text = if size_of.is_one() {
            if factors.len() == 1 && c.is_one() && !n.is_negative() {
                return (base.text.clone(), base.tightness);
            }
            base.within(Tightness::Product)
        } else if size_of == Number::HALF {
            format!(r"\sqrt{{{}}}", base.text)
        } else {
            let exponent = match size_of {
                Number::Ratio(a, b) if b != 1 => format!("{a}/{b}"),
                Number::Ratio(..) | Number::Float(_) => size(size_of),
            };
            format!("{}^{{{exponent}}}", base.within(Tightness::Atom))
        };
        if n.is_negative() { &mut below } else { &mut above }.push((base.variable, text));
    }
    above.sort();
    below.sort();
    let (top, bottom) = coefficient(c);
    if !top.is_one() || above.is_empty() {
        above.insert(0, (false, size(top)));
    }
    if !bottom.is_one() {
        below.insert(0, (false, size(bottom)));
    }
    let join = |all: Vec<(bool, String)>| all.into_iter().map(|(_, t)| t).collect::<Vec<_>>().join(r"\,");
    if below.is_empty() {
        (join(above), Tightness::Product)
    } else {
        (format!(r"\frac{{{}}}{{{}}}", join(above), join(below)), Tightness::Product)
    }
}

fn binary_formula(
    f: Binary,
    turned: bool,
    (a, b): (Expr, Expr),
    within: &dyn Fn(Expr, Tightness) -> String,
) -> (String, Tightness) {
    let (a, b) = if turned { (b, a) } else { (a, b) };
    let sign = match f {
        Binary::Lt => Some(if turned { ">" } else { "<" }),
        Binary::Le => Some(if turned { r"\ge" } else { r"\le" }),
        Binary::Eq => Some("="),
        Binary::And => Some(r"\land"),
        Binary::Or => Some(r"\lor"),
        Binary::Add
        | Binary::Sub
        | Binary::Mul
        | Binary::Div
        | Binary::Pow
        | Binary::Min
        | Binary::Max
        | Binary::Atan2 => None,
    };
    match sign {
        Some(sign) => {
            let least = if matches!(f, Binary::And | Binary::Or) { Tightness::Atom } else { Tightness::Sum };
            (format!("{} {sign} {}", within(a, least), within(b, least)), Tightness::Logic)
        }
        None => {
            let (a, b) = if turned { (b, a) } else { (a, b) };
            let name = match f {
                Binary::Min | Binary::Max => format!(r"\{}", f.name()),
                Binary::Atan2
                | Binary::Lt
                | Binary::Le
                | Binary::Eq
                | Binary::And
                | Binary::Or
                | Binary::Add
                | Binary::Sub
                | Binary::Mul
                | Binary::Div
                | Binary::Pow => format!(r"\operatorname{{{}}}", f.name()),
            };
            let (a, b) = (within(a, Tightness::Logic), within(b, Tightness::Logic));
            (format!(r"{name}\left({a}, {b}\right)"), Tightness::Power)
        }
    }
}
