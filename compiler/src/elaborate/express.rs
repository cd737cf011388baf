//! Turns written expressions into expressions of the pool, with their units.

use super::{Elaborator, Equation, Mode, ScopeId, Typed, Unit, Value, told};
use crate::expression::{Number, Symbol};
use crate::model::{ElementId, Integral, Kind, Signal};
use crate::units::{self, Dimension};
use bond_grammar::ast::{self, Binary, ExprKind, Unary};
use bond_grammar::diagnostic::Diagnostic;
use bond_grammar::source::Span;
use bond_runtime::ir;

/// An extreme over the run: its symbol, what it is of, and whether it is the largest.
type Extreme = (Symbol, crate::expression::Expr, bool);

/// The functions of the language besides those of a mathematical library.
const FUNCTIONS: [&str; 18] = [
    "atan2",
    "sqrt",
    "abs",
    "sign",
    "floor",
    "ceil",
    "round",
    "mod",
    "min",
    "max",
    "integral",
    "delay",
    "table",
    "table2",
    "sum",
    "dot",
    "len",
    "transpose",
];

/// All functions of the language.
fn functions() -> impl Iterator<Item = &'static str> {
    ir::Unary::ALL.into_iter().filter(|f| f.is_library()).map(ir::Unary::name).chain(FUNCTIONS)
}

/// Prefixes that are no units by themselves.
const PREFIXES: [&str; 8] = ["p", "n", "u", "µ", "μ", "k", "M", "G"];

impl<'a> Elaborator<'a> {
    /// Asks for a unit.
    pub(crate) fn require(
        &mut self,
        found: (&Unit, Span),
        needed: Unit,
        place: Option<Span>,
        about: impl Into<String>,
        rank: u8,
    ) {
        let says_nothing = *found.0 == needed && !found.0.has_open_angle() && !needed.has_open_angle();
        if *found.0 == Unit::Any || needed == Unit::Any || says_nothing {
            return;
        }
        self.equations.push(Equation {
            found: (found.0.clone(), found.1),
            needed: (needed, place),
            about: about.into(),
            rank,
            owner: self.owner,
            calls: self.functions.open.clone(),
        });
    }

    /// What is written at a place.
    pub(crate) fn text(&self, at: Span) -> &'a str {
        self.sources.slice(at)
    }

    /// The words of an expression, for messages.
    pub(crate) fn words(&self, e: &ast::Expr) -> String {
        let text = self.sources.slice(e.span).split_whitespace().collect::<Vec<_>>().join(" ");
        if text.chars().count() > 60 { format!("{}...", text.chars().take(57).collect::<String>()) } else { text }
    }

    /// The words of an expression where it is to be an operand of `^`.
    fn operand(&self, e: &ast::Expr) -> String {
        match &e.kind {
            ExprKind::Number { unit: None, .. } | ExprKind::Path(_) | ExprKind::Call(..) | ExprKind::Paren(_) => {
                self.words(e)
            }
            ExprKind::Number { unit: Some(_), .. }
            | ExprKind::Bool(_)
            | ExprKind::Unary(..)
            | ExprKind::Binary(..)
            | ExprKind::If(..)
            | ExprKind::List(_)
            | ExprKind::Range(..) => format!("({})", self.words(e)),
        }
    }

    pub(super) fn wrong<T>(&mut self, code: &'static str, span: Span, message: String, help: &str) -> Option<T> {
        self.errors.push(Diagnostic::error(code, span, message).help(help));
        None
    }

    /// A number that is known now, with a unit.
    pub(super) fn constant(&mut self, e: &'a ast::Expr, scope: ScopeId, unit: Dimension, about: &str) -> Option<f64> {
        let typed = self.as_constant(e, scope)?;
        self.require((&typed.unit, e.span), Unit::known(unit), None, about, 1);
        self.number(&typed, e)
    }

    /// An expression that names no signals.
    pub(super) fn as_constant(&mut self, e: &'a ast::Expr, scope: ScopeId) -> Option<Typed> {
        let mode = std::mem::replace(&mut self.mode, Mode::Constant);
        let typed = self.express(e, scope);
        self.mode = mode;
        typed
    }

    pub(crate) fn number(&mut self, typed: &Typed, e: &ast::Expr) -> Option<f64> {
        match self.pool.constant(typed.expr) {
            Some(x) => Some(x),
            None => {
                let words = self.words(e);
                self.wrong(
                    "elaborate::constant",
                    e.span,
                    format!("`{words}` must be known before the run"),
                    "use parameters and numbers only",
                )
            }
        }
    }

    /// A whole number that is known now.
    pub(super) fn integer(&mut self, e: &'a ast::Expr, scope: ScopeId) -> Option<i64> {
        let x = self.constant(e, scope, Dimension::DIMENSIONLESS, "a count")?;
        if x.fract() == 0.0 && x.abs() <= 9e15 {
            return Some(x as i64);
        }
        let words = self.words(e);
        if x.fract() == 0.0 {
            let message = format!("`{words}` is {}, too large for a count or an index", told(x));
            return self.wrong("elaborate::integer", e.span, message, "lower it: the largest is 9e15");
        }
        let message = format!("`{words}` is {}, and a whole number is needed", told(x));
        self.wrong("elaborate::integer", e.span, message, "round it")
    }

    /// A condition that is known now.
    pub(super) fn truth(&mut self, e: &'a ast::Expr, scope: ScopeId) -> Option<bool> {
        self.constant(e, scope, Dimension::DIMENSIONLESS, "a condition").map(|x| x != 0.0)
    }

    /// A condition by which parts are chosen.
    pub(super) fn choice(&mut self, e: &'a ast::Expr, scope: ScopeId) -> Option<bool> {
        let before = self.errors.len();
        let truth = self.truth(e, scope);
        for error in self.errors.iter_mut().skip(before).filter(|d| d.code == "elaborate::constant") {
            error.help = Some(
                "`if` with braces chooses parts before the run, by parameters. A value that changes in the run is \
                 chosen where it stands: `R:r = if t < 1 s then 2 Ohm else 3 Ohm`"
                    .to_string(),
            );
        }
        truth
    }

    /// An expression that may name signals.
    pub(crate) fn with_signals(&mut self, e: &'a ast::Expr, scope: ScopeId) -> Option<Typed> {
        self.mode = Mode::Signals;
        self.of_entry(e, scope)
    }

    /// An expression of parameters and numbers.
    pub(crate) fn with_constants(&mut self, e: &'a ast::Expr, scope: ScopeId) -> Option<Typed> {
        let mode = std::mem::replace(&mut self.mode, Mode::Constant);
        let typed = self.of_entry(e, scope);
        self.mode = mode;
        typed
    }

    /// Keeps H of a storage for those who name it.
    pub(crate) fn energies_set(&mut self, id: ElementId, energy: crate::expression::Expr) {
        self.energies[id.at()] = Some(energy);
    }

    /// An expression of an `expect`, and the extremes in it.
    pub(super) fn expected(&mut self, e: &'a ast::Expr, scope: ScopeId) -> Option<(Typed, Vec<Extreme>)> {
        self.mode = Mode::Expect;
        self.extremes.clear();
        let typed = self.express(e, scope)?;
        Some((typed, std::mem::take(&mut self.extremes)))
    }

    /// A number.
    pub(super) fn express(&mut self, e: &'a ast::Expr, scope: ScopeId) -> Option<Typed> {
        let value = self.value(e, scope)?;
        self.scalar(value, e)
    }

    /// A number or an array.
    pub(crate) fn value(&mut self, e: &'a ast::Expr, scope: ScopeId) -> Option<Value> {
        self.depth += 1;
        let found = self.value_of(e, scope);
        self.depth -= 1;
        found
    }

    #[inline]
    fn value_of(&mut self, e: &'a ast::Expr, scope: ScopeId) -> Option<Value> {
        match &e.kind {
            ExprKind::Number { digits, unit } => {
                if let Some(unit) = unit {
                    self.note_names_as_units(unit, e.span, scope);
                }
                self.quantity(digits, unit.as_ref(), e.span).map(Value::Scalar)
            }
            ExprKind::Bool(b) => Some(Value::Scalar(Typed { expr: self.pool.int(i64::from(*b)), unit: Unit::one() })),
            ExprKind::Paren(inner) => self.value(inner, scope),
            ExprKind::Path(path) => self.path(path, scope),
            ExprKind::Unary(op, a) => {
                let value = self.value(a, scope)?;
                value.map(&mut |t| match op {
                    Unary::Neg => Some(Typed { expr: self.pool.neg(t.expr), unit: t.unit }),
                    Unary::Not => {
                        self.truth_of(&t, a, "what `not` turns round");
                        Some(Typed { expr: self.pool.unary(ir::Unary::Not, t.expr), unit: Unit::one() })
                    }
                })
            }
            ExprKind::Binary(op, a, b) => self.binary(*op, a, b, scope),
            ExprKind::If(c, a, b) => {
                let truth = self.express(c, scope);
                if let Some(truth) = &truth
                    && let Some(taken) = self.of_round(truth, c, scope)
                {
                    self.truth_of(truth, c, "the condition of an `if`");
                    return self.value(if taken { a } else { b }, scope);
                }
                let (x, y) = (self.value(a, scope), self.value(b, scope));
                let (truth, x, y) = (truth?, x?, y?);
                self.truth_of(&truth, c, "the condition of an `if`");
                if !self.same_shape("the branches of this `if` differ", (&x, a), (&y, b)) {
                    return None;
                }
                x.zip(y, &mut |x, y| {
                    let unit = self.same((&x, a), (&y, b), "of the two branches of `if`, this one");
                    Some(Typed { expr: self.pool.select(truth.expr, x.expr, y.expr), unit })
                })
            }
            ExprKind::Call(name, args) => self.call(name, args, e.span, scope),
            ExprKind::List(items) => self.list(items, e.span, scope),
            ExprKind::Range(..) => {
                let message = format!("`{}` is several indices, where one is needed", self.words(e));
                let help =
                    "a range stands last in the name of a bundle, where it is declared or bonded: `1:v[1..3] -> m`";
                self.wrong("elaborate::bundle", e.span, message, help)
            }
        }
    }

    /// What a condition comes to in this round of a `for` whose variable it names, if that is known. The branch that is
    /// not taken may name what is beyond the ends: `if i == 1 then T else h[i - 1].e`.
    fn of_round(&self, truth: &Typed, c: &ast::Expr, scope: ScopeId) -> Option<bool> {
        let text = self.sources.slice(c.span);
        let names = |v: &str| text.split(|l: char| !l.is_alphanumeric() && l != '_').any(|word| word == v);
        let mut at = Some(scope);
        while let Some(s) = at {
            if self.scopes[s].loop_variable.as_ref().is_some_and(|(v, _)| names(v)) {
                return self.pool.constant(truth.expr).map(|x| x != 0.0);
            }
            at = self.scopes[s].parent;
        }
        None
    }

    pub(super) fn quantity(&mut self, digits: &str, unit: Option<&ast::Unit>, span: Span) -> Option<Typed> {
        let Some(number) = Number::decimal(digits) else {
            return self.wrong(
                "elaborate::number",
                span,
                format!("`{digits}` is no number that can be held"),
                "write it with fewer digits",
            );
        };
        let value = number.to_f64();
        if !value.is_finite() {
            return self.wrong(
                "elaborate::number",
                span,
                format!("`{digits}` is too large for a number"),
                "numbers reach to 1.8e308",
            );
        }
        let Some(unit) = unit else {
            let unit = if value == 0.0 { Unit::Any } else { Unit::one() };
            return Some(Typed { expr: self.pool.numeral(number), unit });
        };
        match units::of(unit) {
            Ok((factor, dimension)) => {
                let number = units::in_si(digits, factor).unwrap_or(number) * self.base_units.factor(dimension);
                let expr = self.pool.numeral(number);
                Some(Typed { expr, unit: Unit::literal(dimension, units::reading(Some(unit))) })
            }
            Err(unknown) => {
                let help = match &unknown.suggestion {
                    // `12_000`
                    _ if unknown.symbol.starts_with('_')
                        && unknown.symbol.chars().all(|c| c == '_' || c.is_ascii_digit()) =>
                    {
                        "the digits of a number stand together, without `_`".to_string()
                    }
                    _ if units::is_celsius(&unknown.symbol) => {
                        // The sign in front of a number is not its own.
                        let before = self.sources.get(span.source).text.get(..span.start as usize);
                        let plain = !before.is_some_and(|text| text.trim_end().ends_with('-'));
                        celsius(plain.then_some(value), &unit.factors)
                    }
                    // No unit of the table, since `3 rad/s*t` would be one of it.
                    _ if unknown.symbol == "t" => {
                        format!("a tonne is `Mg`; if time is meant, write the product out: `{}*t`", told(value))
                    }
                    // `2.2k`
                    _ if PREFIXES.contains(&unknown.symbol.as_str()) => {
                        let (digits, prefix) = (super::told(value), &unknown.symbol);
                        let of = self.owner.and_then(|id| self.elements.get(id.at())).map(|e| e.kind);
                        let unit = match of {
                            Some(Kind::C) => "F",
                            Some(Kind::I) => "H",
                            Some(Kind::SE) => "V",
                            Some(Kind::SF) => "A",
                            Some(_) => "Ohm",
                            None if matches!(prefix.as_str(), "k" | "M" | "G") => "Ohm",
                            None => "F",
                        };
                        format!(
                            "a prefix needs its unit, as in `{digits} {prefix}{unit}`; \
                             if `{prefix}` is a variable, write the product out: `{digits}*{prefix}`"
                        )
                    }
                    // A number before a name is a unit's; a product has its sign.
                    _ if is_name(&unknown.symbol) => {
                        let product = format!("write the product out: `{}*{}`", super::told(value), unknown.symbol);
                        match &unknown.suggestion {
                            Some(s) => format!("did you mean `{s}`? If it is a variable, {product}"),
                            None => format!("if `{}` is a variable, {product}", unknown.symbol),
                        }
                    }
                    Some(s) => format!("did you mean `{s}`?"),
                    None => "the units are those of the SI, such as `kg`, `N*m` or `mm/s`".to_string(),
                };
                self.errors.push(
                    Diagnostic::error("units::unknown", unknown.span, format!("`{}` is no unit", unknown.symbol))
                        .help(help),
                );
                None
            }
        }
    }

    /// Two things that must have one unit; gives that unit.
    pub(super) fn same(&mut self, a: (&Typed, &ast::Expr), b: (&Typed, &ast::Expr), about: &str) -> Unit {
        let about = format!("{about}, `{}`,", self.words(b.1));
        self.require((&b.0.unit, b.1.span), a.0.unit.clone(), Some(a.1.span), about, 3);
        a.0.unit.or_clearer(&b.0.unit)
    }

    /// Truth is a bare number.
    fn truth_of(&mut self, t: &Typed, e: &ast::Expr, about: &str) {
        self.require((&t.unit, e.span), Unit::one(), None, about, 3);
    }

    pub(super) fn binary(&mut self, op: Binary, a: &'a ast::Expr, b: &'a ast::Expr, scope: ScopeId) -> Option<Value> {
        let (x, y) = (self.value(a, scope), self.value(b, scope));
        match (x?, y?) {
            (Value::Scalar(x), Value::Scalar(y)) => self.scalar_operation(op, (x, a), (y, b)).map(Value::Scalar),
            (x, y) => self.array_operation(op, (x, a), (y, b)),
        }
    }

    pub(super) fn scalar_operation(
        &mut self,
        op: Binary,
        (x, a): (Typed, &ast::Expr),
        (y, b): (Typed, &ast::Expr),
    ) -> Option<Typed> {
        let one = Unit::one();
        let (expr, unit) = match op {
            Binary::Add => {
                let unit = self.same((&x, a), (&y, b), "the second term of a sum");
                (self.pool.add(x.expr, y.expr), unit)
            }
            Binary::Sub => {
                let unit = self.same((&x, a), (&y, b), "the second term of a difference");
                (self.pool.sub(x.expr, y.expr), unit)
            }
            Binary::Mul => (self.pool.mul(x.expr, y.expr), x.unit.mul(&y.unit)),
            Binary::Div => {
                if self.pool.is_zero(y.expr) {
                    let words = self.words(b);
                    return self.wrong(
                        "elaborate::zero",
                        b.span,
                        format!("division by `{words}`, which is 0"),
                        "correct the divisor",
                    );
                }
                (self.pool.div(x.expr, y.expr), x.unit.div(&y.unit))
            }
            Binary::Pow => {
                self.require((&y.unit, b.span), one.clone(), None, "an exponent", 3);
                let unit = match self.pool.constant(y.expr).and_then(ratio_of) {
                    Some(n) => x.unit.pow(n),
                    None => {
                        self.require(
                            (&x.unit, a.span),
                            one.clone(),
                            None,
                            "the base of a power that is not a simple fraction",
                            3,
                        );
                        one
                    }
                };
                (self.pool.pow(x.expr, y.expr), unit)
            }
            Binary::Lt | Binary::Le | Binary::Gt | Binary::Ge | Binary::Eq | Binary::Ne => {
                self.same((&x, a), (&y, b), "the right side of a comparison");
                let (p, q) = (x.expr, y.expr);
                let expr = match op {
                    Binary::Lt => self.pool.binary(ir::Binary::Lt, p, q),
                    Binary::Le => self.pool.binary(ir::Binary::Le, p, q),
                    Binary::Gt => self.pool.binary(ir::Binary::Lt, q, p),
                    Binary::Ge => self.pool.binary(ir::Binary::Le, q, p),
                    Binary::Eq => self.pool.binary(ir::Binary::Eq, p, q),
                    Binary::Ne
                    | Binary::Add
                    | Binary::Sub
                    | Binary::Mul
                    | Binary::Div
                    | Binary::Pow
                    | Binary::And
                    | Binary::Or => {
                        let eq = self.pool.binary(ir::Binary::Eq, p, q);
                        self.pool.unary(ir::Unary::Not, eq)
                    }
                };
                (expr, one)
            }
            Binary::And | Binary::Or => {
                let (op, name) = if op == Binary::And { (ir::Binary::And, "and") } else { (ir::Binary::Or, "or") };
                for (t, e) in [(&x, a), (&y, b)] {
                    self.truth_of(t, e, &format!("a side of `{name}`"));
                }
                (self.pool.binary(op, x.expr, y.expr), one)
            }
        };
        Some(Typed { expr, unit })
    }

    pub(super) fn call(
        &mut self,
        name: &ast::Name,
        args: &'a [ast::Expr],
        span: Span,
        scope: ScopeId,
    ) -> Option<Value> {
        let f = name.text.as_str();
        if let Some(function) = self.function(f, scope) {
            self.is_one(function, name, scope)?;
            return self.apply(function, args, span, scope);
        }
        if f == "integral" {
            return self.integral(args, span, scope).map(Value::Scalar);
        }
        if f == "delay" {
            return self.delay(args, span, scope).map(Value::Scalar);
        }
        if !functions().any(|name| name == f) {
            return self.unknown_function(name, args, scope).map(Value::Scalar);
        }
        let values: Vec<Option<Value>> = args.iter().map(|a| self.value(a, scope)).collect();
        let values: Vec<Value> = values.into_iter().collect::<Option<_>>()?;
        if let Some(found) = self.array_function(f, &values, args, span) {
            return found;
        }
        let values: Vec<Option<Typed>> = values.into_iter().zip(args).map(|(v, a)| self.scalar(v, a)).collect();
        let values: Vec<Typed> = values.into_iter().collect::<Option<_>>()?;
        self.known_function(name, &values, args, (span, scope)).map(Value::Scalar)
    }

    /// A function of the language, of numbers.
    pub(super) fn known_function(
        &mut self,
        name: &ast::Name,
        values: &[Typed],
        args: &'a [ast::Expr],
        (span, scope): (Span, ScopeId),
    ) -> Option<Typed> {
        use ir::Unary as F;
        let f = name.text.as_str();
        let count = |n: usize, this: &mut Self| -> Option<()> {
            if values.len() == n {
                return Some(());
            }
            this.wrong(
                "elaborate::arguments",
                span,
                format!("`{f}` takes {n} argument(s), and got {}", values.len()),
                "correct the call",
            )
        };
        if let Some(op) = F::ALL.into_iter().find(|op| op.is_library() && op.name() == f) {
            count(1, self)?;
            self.require((&values[0].unit, args[0].span), Unit::one(), None, format!("the argument of `{f}`"), 3);
            return Some(Typed { expr: self.pool.unary(op, values[0].expr), unit: Unit::one() });
        }
        match f {
            "sqrt" => {
                count(1, self)?;
                Some(Typed { expr: self.pool.sqrt(values[0].expr), unit: values[0].unit.pow((1, 2)) })
            }
            "abs" => {
                count(1, self)?;
                Some(Typed { expr: self.pool.unary(F::Abs, values[0].expr), unit: values[0].unit.clone() })
            }
            "sign" => {
                count(1, self)?;
                Some(Typed { expr: self.pool.unary(F::Sign, values[0].expr), unit: Unit::one() })
            }
            "floor" | "ceil" | "round" => {
                count(1, self)?;
                let x = values[0].expr;
                self.require((&values[0].unit, args[0].span), Unit::one(), None, format!("the argument of `{f}`"), 3);
                let expr = match f {
                    "floor" => self.pool.unary(F::Floor, x),
                    // -floor(-x)
                    "ceil" => {
                        let below = self.pool.neg(x);
                        let whole = self.pool.unary(F::Floor, below);
                        self.pool.neg(whole)
                    }
                    // floor(x + 1/2)
                    _ => {
                        let one = self.pool.int(1);
                        let above = self.pool.combine(&[(x, Number::ONE), (one, Number::HALF)]);
                        self.pool.unary(F::Floor, above)
                    }
                };
                Some(Typed { expr, unit: Unit::one() })
            }
            // x - y floor(x/y)
            "mod" => {
                count(2, self)?;
                let unit = self.same((&values[0], &args[0]), (&values[1], &args[1]), "the second argument of `mod`");
                let (x, y) = (values[0].expr, values[1].expr);
                if self.pool.is_zero(y) {
                    let message = format!("`mod` divides by `{}`, which is 0", self.words(&args[1]));
                    return self.wrong("elaborate::zero", args[1].span, message, "correct the divisor");
                }
                let ratio = self.pool.div(x, y);
                let whole = self.pool.unary(F::Floor, ratio);
                let steps = self.pool.mul(y, whole);
                Some(Typed { expr: self.pool.sub(x, steps), unit })
            }
            "atan2" => {
                count(2, self)?;
                self.same((&values[0], &args[0]), (&values[1], &args[1]), "the second argument of `atan2`");
                Some(Typed {
                    expr: self.pool.binary(ir::Binary::Atan2, values[0].expr, values[1].expr),
                    unit: Unit::one(),
                })
            }
            "min" | "max" if values.len() == 1 && self.mode == Mode::Expect => {
                let extremes = &self.extremes;
                if self.pool.contains_any(values[0].expr, &|s| extremes.iter().any(|e| e.0 == s)) {
                    return self.wrong(
                        "elaborate::expect",
                        span,
                        format!("`{f}` is applied to an expression that already contains an extreme over the run"),
                        "an extreme is one number for the whole run: take it of signals alone, and compute with it \
                         outside, `max(x) - min(x)` for `max(x - min(x))`",
                    );
                }
                let symbol = self.pool.symbol(&self.words(&args[0]));
                self.extremes.push((symbol, values[0].expr, f == "max"));
                Some(Typed { expr: self.pool.var(symbol), unit: values[0].unit.clone() })
            }
            "min" | "max" => {
                if values.len() < 2 {
                    let help = "one argument is an extreme over the run, and stands in `expect` only";
                    return self.wrong(
                        "elaborate::arguments",
                        span,
                        format!("`{f}` takes two arguments or more"),
                        help,
                    );
                }
                let op = if f == "min" { ir::Binary::Min } else { ir::Binary::Max };
                let mut all = values[0].clone();
                for (v, a) in values.iter().zip(args).skip(1) {
                    all.unit = self.same((&all, &args[0]), (v, a), &format!("an argument of `{f}`"));
                    all.expr = self.pool.binary(op, all.expr, v.expr);
                }
                Some(all)
            }
            _ => self.unknown_function(name, args, scope),
        }
    }

    /// Says that there is no such function, and what was meant.
    fn unknown_function(&mut self, name: &ast::Name, args: &'a [ast::Expr], scope: ScopeId) -> Option<Typed> {
        let f = name.text.as_str();
        if self.is_lost(self.scopes[scope].instance, &name.text) || self.has_gaps(scope) {
            return None;
        }
        let (own, known) = (self.function_names(scope), functions().collect::<Vec<_>>());
        let error = Diagnostic::error("elaborate::function", name.span, format!("there is no function `{f}`"));
        let all: Vec<(String, String)> = args.iter().map(|a| (self.words(a), self.operand(a))).collect();
        let help = match (
            super::foreign(f, &all),
            super::nearest(f, own.iter().map(String::as_str).chain(known.iter().copied())),
        ) {
            (Some(fix), _) => fix,
            // Of few letters another function is near.
            (None, Some(n)) if f.len() > 4 || super::distance(f, n) < 2 => format!("did you mean `{n}`?"),
            (None, _) => format!("the functions are {}", known.join(", ")),
        };
        self.errors.push(error.help(help));
        None
    }

    pub(super) fn integral(&mut self, args: &'a [ast::Expr], span: Span, scope: ScopeId) -> Option<Typed> {
        if !matches!(self.mode, Mode::Outputs | Mode::Expect) {
            return self.wrong(
                "elaborate::integral",
                span,
                "`integral` stands only in `let` and `probe`".into(),
                "a storage's state `.q` or `.p` is the integral that a law may use; what a controller integrates is `state z = 0 { dz = ... }`",
            );
        }
        let [rate_ast, start_ast] = args else {
            let help = match args {
                [rate] => {
                    format!("write `integral({}, 0)`, or another start with its unit", self.sources.slice(rate.span))
                }
                _ => "write `integral(v.f, 0 m)`".to_string(),
            };
            let message = "`integral` takes what is integrated and the value at the start".into();
            return self.wrong("elaborate::arguments", span, message, &help);
        };
        let rate = self.express(rate_ast, scope)?;
        let mode = std::mem::replace(&mut self.mode, Mode::Constant);
        let start = self.express(start_ast, scope);
        self.mode = mode;
        let start = start?;
        let unit = rate.unit.mul(&Unit::known(Dimension::SECOND));
        self.require((&start.unit, start_ast.span), unit.clone(), Some(rate_ast.span), "the start of an integral", 3);
        let unit = if unit == Unit::Any { start.unit.clone() } else { unit };
        let start = self.number(&start, start_ast)?;
        let index = self.integrals.len();
        let symbol = self.signal(Signal::Integral(index));
        self.integrals.push(Integral { symbol, rate: rate.expr, start, span });
        Some(Typed { expr: self.pool.var(symbol), unit })
    }
}

/// How a number of degrees Celsius is to be written.
pub(super) fn celsius(value: Option<f64>, factors: &[(String, (i32, i32), Span)]) -> String {
    match (factors, value) {
        ([(_, (1, 1), _)], Some(value)) => {
            let kelvin = libm::round((value + 273.15) * 1e9) / 1e9;
            format!(
                "degrees Celsius need an offset, and are not a unit here: as a temperature this is `{} K`, as a \
                difference of two `{} K`",
                told(kelvin),
                told(value)
            )
        }
        ([(_, (1, 1), _)], None) => "degrees Celsius need an offset, and are not a unit here: for a temperature add \
        273.15, and write `K`; a difference of 1 °C is one of 1 K"
            .to_string(),
        _ => "there is no degree Celsius; a difference of 1 °C is one of 1 K: write `K`".to_string(),
    }
}

/// A simple fraction, for units under powers.
fn ratio_of(x: f64) -> Option<(i32, i32)> {
    [1i32, 2, 3, 4, 5, 6, 8].into_iter().find_map(|d| {
        let n = x * f64::from(d);
        (n.fract() == 0.0 && n.abs() < 1000.0).then_some((n as i32, d))
    })
}

/// Whether a text is a name and no more.
fn is_name(text: &str) -> bool {
    text.chars().all(|c| c.is_alphanumeric() || c == '_')
}
