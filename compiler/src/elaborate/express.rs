//! Turns written expressions into expressions of the pool, with their units.

use super::{Elaborator, Entity, Equation, Inference, LetState, Mode, ParamState, ScopeId, Typed, Unit, Value};
use crate::expression::Symbol;
use crate::model::{BondId, ElementId, Integral, Kind, Signal};
use crate::units::{self, Dimension};
use bond_grammar::ast::{self, Binary, ExprKind, Unary};
use bond_grammar::diagnostic::Diagnostic;
use bond_grammar::source::Span;
use bond_runtime::ir;

/// An extreme over the run: its symbol, what it is of, and whether it is the largest.
type Extreme = (Symbol, crate::expression::Expr, bool);

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
        if *found.0 == Unit::Any || needed == Unit::Any || *found.0 == needed {
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

    /// The words of an expression, for messages.
    pub(crate) fn words(&self, e: &ast::Expr) -> String {
        let text = self.sources.slice(e.span).split_whitespace().collect::<Vec<_>>().join(" ");
        if text.chars().count() > 60 { format!("{}...", text.chars().take(57).collect::<String>()) } else { text }
    }

    fn wrong<T>(&mut self, code: &'static str, span: Span, message: String, help: &str) -> Option<T> {
        self.errors.push(Diagnostic::error(code, span, message).help(help));
        None
    }

    /// A number that is known now, with a unit.
    pub(super) fn constant(&mut self, e: &'a ast::Expr, scope: ScopeId, unit: Dimension, about: &str) -> Option<f64> {
        let mode = std::mem::replace(&mut self.mode, Mode::Constant);
        let typed = self.express(e, scope);
        self.mode = mode;
        let typed = typed?;
        self.require((&typed.unit, e.span), Unit::known(unit), None, about, 1);
        self.number(&typed, e)
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
        self.wrong("elaborate::integer", e.span, format!("`{words}` is {x}, and a whole number is needed"), "round it")
    }

    /// A condition that is known now.
    pub(super) fn truth(&mut self, e: &'a ast::Expr, scope: ScopeId) -> Option<bool> {
        self.constant(e, scope, Dimension::DIMENSIONLESS, "a condition").map(|x| x != 0.0)
    }

    /// An expression that may name signals.
    pub(crate) fn with_signals(&mut self, e: &'a ast::Expr, scope: ScopeId) -> Option<Typed> {
        self.mode = Mode::Signals;
        self.express(e, scope)
    }

    /// An expression of parameters and numbers.
    pub(crate) fn with_constants(&mut self, e: &'a ast::Expr, scope: ScopeId) -> Option<Typed> {
        let mode = std::mem::replace(&mut self.mode, Mode::Constant);
        let typed = self.express(e, scope);
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
        match &e.kind {
            ExprKind::Number { digits, unit } => self.quantity(digits, unit.as_ref(), e.span).map(Value::Scalar),
            ExprKind::Bool(b) => Some(Value::Scalar(Typed { expr: self.pool.int(i64::from(*b)), unit: Unit::one() })),
            ExprKind::Paren(inner) => self.value(inner, scope),
            ExprKind::Path(path) => self.path(path, scope),
            ExprKind::Unary(op, a) => {
                let value = self.value(a, scope)?;
                value.map(&mut |t| {
                    let expr = match op {
                        Unary::Neg => self.pool.neg(t.expr),
                        Unary::Not => self.pool.unary(ir::Unary::Not, t.expr),
                    };
                    Some(Typed { expr, unit: t.unit })
                })
            }
            ExprKind::Binary(op, a, b) => self.binary(*op, a, b, scope),
            ExprKind::If(c, a, b) => {
                let (c, x, y) = (self.express(c, scope), self.value(a, scope), self.value(b, scope));
                let (c, x, y) = (c?, x?, y?);
                if !self.same_shape("the branches of this `if` differ", (&x, a), (&y, b)) {
                    return None;
                }
                x.zip(y, &mut |x, y| {
                    let unit = self.same((&x, a), (&y, b), "of the two branches of `if`, this one");
                    Some(Typed { expr: self.pool.select(c.expr, x.expr, y.expr), unit })
                })
            }
            ExprKind::Call(name, args) => self.call(name, args, e.span, scope),
            ExprKind::List(items) => self.list(items, e.span, scope),
        }
    }

    fn quantity(&mut self, digits: &str, unit: Option<&ast::Unit>, span: Span) -> Option<Typed> {
        let Some(number) = self.pool.decimal(digits) else {
            return self.wrong(
                "elaborate::number",
                span,
                format!("`{digits}` is no number that can be held"),
                "write it with fewer digits",
            );
        };
        let value = self.pool.constant(number).unwrap_or(f64::NAN);
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
            return Some(Typed { expr: number, unit });
        };
        match units::of(unit) {
            Ok((factor, dimension)) => {
                // A factor below one is the inverse of a rounder number: 35 ms are 35/1000 s.
                let inverse = (1.0 / factor).round();
                let exact = factor < 1.0 && inverse < 9e15 && 1.0 / inverse == factor;
                let expr = if factor == 1.0 {
                    number
                } else if factor.fract() == 0.0 && factor < 1e15 {
                    let f = self.pool.int(factor as i64);
                    self.pool.mul(number, f)
                } else if exact {
                    let f = self.pool.int(inverse as i64);
                    self.pool.div(number, f)
                } else {
                    self.pool.float(value * factor)
                };
                Some(Typed { expr, unit: Unit::known(dimension) })
            }
            Err(unknown) => {
                let help = match &unknown.suggestion {
                    Some(s) => format!("did you mean `{s}`?"),
                    None => format!(
                        "if `{}` is a variable, put a space before the operator, as in `6 V * x`",
                        unknown.symbol
                    ),
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
    fn same(&mut self, a: (&Typed, &ast::Expr), b: (&Typed, &ast::Expr), about: &str) -> Unit {
        let about = format!("{about}, `{}`,", self.words(b.1));
        self.require((&b.0.unit, b.1.span), a.0.unit.clone(), Some(a.1.span), about, 3);
        if a.0.unit == Unit::Any { b.0.unit.clone() } else { a.0.unit.clone() }
    }

    fn binary(&mut self, op: Binary, a: &'a ast::Expr, b: &'a ast::Expr, scope: ScopeId) -> Option<Value> {
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
                        "mend the divisor",
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
            Binary::And => (self.pool.binary(ir::Binary::And, x.expr, y.expr), one),
            Binary::Or => (self.pool.binary(ir::Binary::Or, x.expr, y.expr), one),
        };
        Some(Typed { expr, unit })
    }

    fn call(&mut self, name: &ast::Name, args: &'a [ast::Expr], span: Span, scope: ScopeId) -> Option<Value> {
        let f = name.text.as_str();
        if let Some(function) = self.function(f, scope) {
            return self.apply(function, args, span, scope);
        }
        if f == "integral" {
            return self.integral(args, span, scope).map(Value::Scalar);
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
    fn known_function(
        &mut self,
        name: &ast::Name,
        values: &[Typed],
        args: &'a [ast::Expr],
        (span, scope): (Span, ScopeId),
    ) -> Option<Typed> {
        use ir::Unary as F;
        let f = name.text.as_str();
        let plain = [F::Exp, F::Log, F::Sin, F::Cos, F::Tan, F::Asin, F::Acos, F::Atan, F::Sinh, F::Cosh, F::Tanh];
        let count = |n: usize, this: &mut Self| -> Option<()> {
            if values.len() == n {
                return Some(());
            }
            this.wrong(
                "elaborate::arguments",
                span,
                format!("`{f}` takes {n} argument(s), and got {}", values.len()),
                "mend the call",
            )
        };
        if let Some(op) = plain.into_iter().find(|op| op.name() == f) {
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
            "atan2" => {
                count(2, self)?;
                self.same((&values[0], &args[0]), (&values[1], &args[1]), "the second argument of `atan2`");
                Some(Typed {
                    expr: self.pool.binary(ir::Binary::Atan2, values[0].expr, values[1].expr),
                    unit: Unit::one(),
                })
            }
            "min" | "max" if values.len() == 1 && self.mode == Mode::Expect => {
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
            _ => {
                const KNOWN: [&str; 23] = [
                    "sin",
                    "cos",
                    "tan",
                    "asin",
                    "acos",
                    "atan",
                    "atan2",
                    "sinh",
                    "cosh",
                    "tanh",
                    "exp",
                    "log",
                    "sqrt",
                    "abs",
                    "sign",
                    "min",
                    "max",
                    "integral",
                    "table",
                    "sum",
                    "dot",
                    "len",
                    "transpose",
                ];
                let own = self.function_names(scope);
                let mut error =
                    Diagnostic::error("elaborate::function", name.span, format!("there is no function `{f}`"));
                error = match super::nearest(f, own.iter().map(String::as_str).chain(KNOWN)) {
                    Some(n) => error.help(format!("did you mean `{n}`?")),
                    None => error.help(format!("the functions are {}", KNOWN.join(", "))),
                };
                self.errors.push(error);
                None
            }
        }
    }

    fn integral(&mut self, args: &'a [ast::Expr], span: Span, scope: ScopeId) -> Option<Typed> {
        if !matches!(self.mode, Mode::Outputs | Mode::Expect) {
            return self.wrong(
                "elaborate::integral",
                span,
                "`integral` stands only in `let` and `probe`".into(),
                "a storage's state `.q` or `.p` is the integral that a law may use",
            );
        }
        let [rate_ast, start_ast] = args else {
            return self.wrong(
                "elaborate::arguments",
                span,
                "`integral` takes what is integrated and the value at the start".into(),
                "write `integral(v.f, 0 m)`",
            );
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

    fn path(&mut self, path: &'a ast::Path, scope: ScopeId) -> Option<Value> {
        let first = &path.segments[0];
        // The pair of a port, in the law of a field: `a.f`.
        if let [port, variable] = &path.segments[..]
            && let Some((_, t)) = self
                .locals
                .iter()
                .rev()
                .find(|(n, _)| n.split_once('.') == Some((port.name.text.as_str(), variable.name.text.as_str())))
        {
            return Some(Value::Scalar(t.clone()));
        }
        if path.segments.len() == 1 {
            let plain = first.index.is_empty();
            if plain && let Some((_, t)) = self.locals.iter().rev().find(|(n, _)| *n == first.name.text) {
                return Some(Value::Scalar(t.clone()));
            }
            let mut at = Some(scope);
            while let Some(s) = at {
                if let Some((v, i)) = &self.scopes[s].loop_variable
                    && *v == first.name.text
                    && plain
                {
                    // A count may be 0 and is still a bare number.
                    let i = *i;
                    return Some(Value::Scalar(Typed { expr: self.pool.int(i), unit: Unit::one() }));
                }
                match self.scopes[s].locals.get(&first.name.text).copied() {
                    Some(Entity::Let(l)) if plain || !self.is_declared(first, scope, s)? => {
                        let value = self.let_value(l, path.span)?;
                        return self.entry(value, first, scope);
                    }
                    Some(Entity::Input(i)) if plain => return self.input_value(i, path.span).map(Value::Scalar),
                    Some(Entity::Memory(i)) if plain => return self.memory_value(i, path.span).map(Value::Scalar),
                    Some(
                        Entity::Element(_)
                        | Entity::Instance(_)
                        | Entity::Port(_)
                        | Entity::Param(_)
                        | Entity::Let(_)
                        | Entity::Input(_)
                        | Entity::Memory(_)
                        | Entity::Function(_)
                        | Entity::Bond(_)
                        | Entity::Field(_)
                        | Entity::Missing,
                    )
                    | None => {}
                }
                at = self.scopes[s].parent;
            }
        }
        // As far as the path leads through instances.
        let mut at = self.scopes[scope].instance;
        for (i, segment) in path.segments.iter().enumerate() {
            let builtin =
                i == 0 && segment.index.is_empty() && !self.instances[at].names.contains_key(&segment.name.text);
            if builtin {
                match segment.name.text.as_str() {
                    "t" if path.segments.len() == 1 => return self.time(path.span).map(Value::Scalar),
                    "pi" if path.segments.len() == 1 => {
                        return Some(Value::Scalar(Typed { expr: self.pool.pi(), unit: Unit::one() }));
                    }
                    _ => {}
                }
            }
            let rest = &path.segments[i + 1..];
            if rest.is_empty()
                && let Some(entry) = self.indexed(at, segment, scope)
            {
                return entry;
            }
            if builtin && self.function(&segment.name.text, scope).is_some() {
                return self.no_call(&segment.name.text, path.span);
            }
            let (key, entity, _) = self.find(at, segment, scope, i > 0)?;
            match entity {
                Entity::Instance(_) if rest.is_empty() => {
                    return self.wrong(
                        "elaborate::signal",
                        path.span,
                        format!("`{key}` is an instance, not a signal"),
                        "name a signal of it, as in `wall.spring.q`",
                    );
                }
                Entity::Instance(inner) => at = inner,
                Entity::Missing => return None,
                Entity::Param(p) if rest.is_empty() => return self.param_value(p, path.span),
                Entity::Let(l) if rest.is_empty() => return self.let_value(l, path.span),
                Entity::Input(i) if rest.is_empty() => return self.input_value(i, path.span).map(Value::Scalar),
                Entity::Memory(i) if rest.is_empty() => return self.memory_value(i, path.span).map(Value::Scalar),
                Entity::Param(_) | Entity::Let(_) | Entity::Input(_) | Entity::Memory(_) => {
                    return self.wrong(
                        "elaborate::signal",
                        path.span,
                        format!("`{}` is no signal", self.sources.slice(path.span)),
                        "a parameter, `let`, `input` or `state` has no parts, and a probe is for the outside: use a `let`",
                    );
                }
                Entity::Function(_) => return self.no_call(&key, path.span),
                Entity::Element(id) => return self.element_signal(id, rest, path.span).map(Value::Scalar),
                Entity::Field(f) => return self.field_signal(f, rest, path.span).map(Value::Scalar),
                Entity::Port(p) => {
                    let raw = self.ports[p].outside.first().or(self.ports[p].inside.first()).map(|r| r.0);
                    let shown = self.ports[p].name.clone();
                    return self
                        .bond_signal(raw.and_then(|r| self.merged.get(r).copied().flatten()), &shown, rest, path.span)
                        .map(Value::Scalar);
                }
                Entity::Bond(b) => {
                    let shown = self.raw_bonds[b].name.clone();
                    return self
                        .bond_signal(self.merged.get(b).copied().flatten(), &shown, rest, path.span)
                        .map(Value::Scalar);
                }
            }
        }
        None
    }

    fn no_call<T>(&mut self, function: &str, span: Span) -> Option<T> {
        let message = format!("`{function}` is a function, not a value");
        self.wrong("elaborate::signal", span, message, &format!("call it, as in `{function}(x)`"))
    }

    fn time(&mut self, span: Span) -> Option<Typed> {
        if self.mode == Mode::Constant {
            return self.wrong(
                "elaborate::constant",
                span,
                "time is not known before the run".into(),
                "use parameters and numbers only",
            );
        }
        let symbol = self.signal(Signal::Time);
        Some(Typed { expr: self.pool.var(symbol), unit: Unit::known(Dimension::SECOND) })
    }

    /// The value of a parameter.
    pub(super) fn param_value(&mut self, p: usize, at: Span) -> Option<Value> {
        match self.params[p].state.clone() {
            ParamState::Done(t) => t,
            ParamState::Open => {
                let name = self.params[p].name.clone();
                self.params[p].state = ParamState::Done(None);
                self.wrong(
                    "elaborate::circular",
                    at,
                    format!("the parameter `{name}` depends on itself"),
                    "give it a value of its own",
                )
            }
            ParamState::New => {
                self.params[p].state = ParamState::Open;
                let found = self.compute_param(p, at);
                self.params[p].state = ParamState::Done(found.clone());
                found
            }
        }
    }

    fn compute_param(&mut self, p: usize, at: Span) -> Option<Value> {
        let name = self.params[p].name.clone();
        let over = self.params[p].overridden;
        let mut given = None;
        match self.params[p].value {
            Some((ast, scope)) => {
                let mode = std::mem::replace(&mut self.mode, Mode::Constant);
                let locals = std::mem::take(&mut self.locals);
                let value = self.value(ast, scope);
                self.mode = mode;
                self.locals = locals;
                given = Some((value?, ast));
            }
            None if over.is_none() => {
                let span = self.params[p].span;
                self.errors.push(
                    Diagnostic::error("elaborate::parameter", at, format!("the parameter `{name}` has no value"))
                        .label(span, "has no default")
                        .help(format!(
                            "give it where the instance is made, `({name} = ...)`, or with --set {name}=..."
                        )),
                );
                return None;
            }
            None => {}
        }
        let span = self.params[p].span;
        if let Some((number, dimension)) = over {
            if let Some((value @ Value::List(_), _)) = &given {
                return self.wrong(
                    "elaborate::set",
                    span,
                    format!("--set {name}: `{name}` is {}, and --set gives one number", value.words()),
                    "change the array in the file, or give its entries by parameters of their own",
                );
            }
            if let Some((Value::Scalar(t), ast)) = &given {
                self.number(t, ast)?;
            }
            let mut unit = match &given {
                Some((Value::Scalar(t), _)) => t.unit.clone(),
                Some((Value::List(_), _)) | None => Unit::Any,
            };
            if let Some(d) = dimension {
                let about = format!("the value of `{name}` given with --set");
                self.require((&Unit::known(d), span), unit.clone(), None, about, 1);
                unit = Unit::known(d);
            }
            return self.known_parameter(&name, number, unit, span).map(Value::Scalar);
        }
        let (value, ast) = given?;
        let mut names = value.leaves().into_iter().map(|(index, _)| format!("{name}{index}")).collect::<Vec<_>>();
        names.reverse();
        value.map(&mut |t| {
            let number = self.number(&t, ast)?;
            self.known_parameter(&names.pop()?, number, t.unit, span)
        })
    }

    /// A symbol with this value.
    fn known_parameter(&mut self, name: &str, value: f64, unit: Unit, span: Span) -> Option<Typed> {
        if !value.is_finite() {
            return self.wrong(
                "elaborate::number",
                span,
                format!("the parameter `{name}` is {value}"),
                "its value must be a finite number",
            );
        }
        let symbol = self.pool.parameter(name, value);
        Some(Typed { expr: self.pool.var(symbol), unit })
    }

    pub(super) fn let_value(&mut self, l: usize, at: Span) -> Option<Value> {
        match self.lets[l].state.clone() {
            LetState::Done(t) => t,
            LetState::Open => {
                let name = self.lets[l].name.clone();
                self.wrong("elaborate::circular", at, format!("`{name}` depends on itself"), "break the circle")
            }
            LetState::New => {
                let before = self.errors.len();
                self.lets[l].state = LetState::Open;
                let (value, scope) = (self.lets[l].value, self.lets[l].scope);
                let mode = self.mode;
                if mode == Mode::Signals || mode == Mode::Expect {
                    self.mode = Mode::Outputs;
                }
                let locals = std::mem::take(&mut self.locals);
                let found = self.value(value, scope);
                self.mode = mode;
                self.locals = locals;
                // What cannot be said before the run may well be said in it.
                let retry = found.is_none() && mode == Mode::Constant;
                self.lets[l].state = if retry { LetState::New } else { LetState::Done(found.clone()) };
                if retry {
                    self.errors.truncate(before + 1);
                }
                found
            }
        }
    }

    /// `arm.p1`, the state; `arm.p1.e`; `arm.H`.
    fn field_signal(&mut self, field: usize, rest: &'a [ast::Segment], span: Span) -> Option<Typed> {
        let f = &self.fields[field];
        let name = f.name.clone();
        if let [port, rest @ ..] = rest
            && let Some(place) = f.ports.iter().position(|p| *p == port.name.text)
        {
            let id = f.members[place];
            let kind = self.elements[id.at()].kind;
            if !rest.is_empty() || self.mode == Mode::Constant || !matches!(kind, Kind::C | Kind::I) {
                return self.element_signal(id, rest, span);
            }
            return self.state_signal(id);
        }
        let first = f.members.first().copied()?;
        if let ([h], Kind::C | Kind::I) = (rest, self.elements[first.at()].kind)
            && h.name.text == "H"
        {
            return self.element_signal(first, rest, span);
        }
        let list = f.ports.join(", ");
        self.wrong(
            "elaborate::signal",
            span,
            format!("`{}` is no signal", self.sources.slice(span)),
            &format!("`{name}` is a field: name one of its ports, {list}, and then .e or .f"),
        )
    }

    /// The state of a storage.
    fn state_signal(&mut self, id: ElementId) -> Option<Typed> {
        let bond = self.bonds_of.get(id.at()).and_then(|b| b.first().copied())?;
        let symbol = self.signal(Signal::State(id));
        let d = self.domain_of[bond.at()];
        let is_c = self.elements[id.at()].kind == Kind::C;
        let other = if is_c { Inference::flow(d) } else { Inference::effort(d) };
        Some(Typed { expr: self.pool.var(symbol), unit: other.mul(&Unit::known(Dimension::SECOND)) })
    }

    fn element_signal(&mut self, id: ElementId, rest: &'a [ast::Segment], span: Span) -> Option<Typed> {
        let decl = &self.elements[id.at()];
        let (name, kind) = (decl.name.clone(), decl.kind);
        if self.mode == Mode::Constant {
            return self.wrong(
                "elaborate::constant",
                span,
                format!("a signal of `{name}` is not known before the run"),
                "use parameters and numbers only",
            );
        }
        let words: Vec<&str> = rest.iter().map(|s| s.name.text.as_str()).collect();
        let bond = self.bonds_of.get(id.at()).and_then(|b| b.first().copied());
        match (kind, &words[..]) {
            (Kind::C, ["q"]) | (Kind::I, ["p"]) if decl.field.is_none() => self.state_signal(id),
            (Kind::C | Kind::I, ["H"]) => {
                let bond = bond?;
                let expr = self.energy(id)?;
                Some(Typed { expr, unit: self.energy_unit(bond) })
            }
            (Kind::Tf | Kind::Gy, [side @ ("in" | "out"), _]) => {
                let inward = *side == "in";
                let found =
                    self.bonds_of.get(id.at())?.iter().copied().find(|b| (self.bonds[b.at()].head == id) == inward);
                self.bond_signal(found, &name, &rest[1..], span)
            }
            (Kind::Zero, ["e"]) | (Kind::One, ["f"]) => self.bond_signal(bond, &name, rest, span),
            (
                Kind::Se | Kind::Sf | Kind::C | Kind::I | Kind::R | Kind::De | Kind::Df | Kind::Port,
                ["e" | "f" | "P"],
            ) => self.bond_signal(bond, &name, rest, span),
            _ => {
                let has = match kind {
                    Kind::C | Kind::I if decl.field.is_some() => "the state under its own name, and .e .f .P",
                    Kind::C => ".e .f .P .q .H",
                    Kind::I => ".e .f .P .p .H",
                    Kind::Zero => ".e, its common effort; the flows are those of its bonds",
                    Kind::One => ".f, its common flow; the efforts are those of its bonds",
                    Kind::Tf | Kind::Gy => ".in.e .in.f .out.e .out.f",
                    Kind::Se | Kind::Sf | Kind::R | Kind::De | Kind::Df | Kind::Port => ".e .f .P",
                };
                let asked = if words.is_empty() {
                    format!("`{name}` is an element, not a signal")
                } else {
                    format!("`{name}` has no signal `.{}`", words.join("."))
                };
                let decl = self.elements[id.at()].span;
                self.errors.push(
                    Diagnostic::error("elaborate::signal", span, asked)
                        .label(decl, "is declared here")
                        .help(format!("it has {has}")),
                );
                None
            }
        }
    }

    fn bond_signal(&mut self, bond: Option<BondId>, name: &str, rest: &'a [ast::Segment], span: Span) -> Option<Typed> {
        if self.mode == Mode::Constant {
            return self.wrong(
                "elaborate::constant",
                span,
                format!("a signal of `{name}` is not known before the run"),
                "use parameters and numbers only",
            );
        }
        let bond = bond?;
        let d = self.domain_of[bond.at()];
        let words: Vec<&str> = rest.iter().map(|s| s.name.text.as_str()).collect();
        let (effort, flow) = (Inference::effort(d), Inference::flow(d));
        match words[..] {
            ["e"] => {
                let s = self.signal(Signal::Effort(bond));
                Some(Typed { expr: self.pool.var(s), unit: effort })
            }
            ["f"] => {
                let s = self.signal(Signal::Flow(bond));
                Some(Typed { expr: self.pool.var(s), unit: flow })
            }
            ["P"] => {
                let (e, f) = (self.signal(Signal::Effort(bond)), self.signal(Signal::Flow(bond)));
                let (e, f) = (self.pool.var(e), self.pool.var(f));
                Some(Typed { expr: self.pool.mul(e, f), unit: effort.mul(&flow) })
            }
            _ => self.wrong(
                "elaborate::signal",
                span,
                format!("`{}` is no signal", self.sources.slice(span)),
                &format!("`{name}` has .e .f .P"),
            ),
        }
    }

    /// Unit of H on a bond: joule on a true one.
    pub(crate) fn energy_unit(&self, bond: BondId) -> Unit {
        let d = self.domain_of[bond.at()];
        Inference::effort(d).mul(&Inference::flow(d)).mul(&Unit::known(Dimension::SECOND))
    }

    /// The symbol of a signal.
    pub(crate) fn signal(&mut self, signal: Signal) -> Symbol {
        if let Some(s) = self.symbol_of.get(&signal) {
            return *s;
        }
        let name = match signal {
            Signal::Time => "t".to_string(),
            Signal::Effort(b) => format!("{}.e", self.bond_word(b)),
            Signal::Flow(b) => format!("{}.f", self.bond_word(b)),
            Signal::State(id) => {
                let decl = &self.elements[id.at()];
                match (decl.field, decl.kind) {
                    (Some(_), _) => decl.name.clone(),
                    (None, Kind::I) => format!("{}.p", decl.name),
                    (None, _) => format!("{}.q", decl.name),
                }
            }
            Signal::Integral(i) => format!("integral[{i}]"),
            Signal::Input(i) => self.inputs[i].name.clone(),
            Signal::Slope(i) => format!("slope({})", self.inputs[i].name),
            Signal::Memory(i) => self.memories[i].name.clone(),
            Signal::Argument(id) => self.elements[id.at()].name.clone(),
            Signal::Parameter(id) => format!("{}.s", self.elements[id.at()].name),
        };
        let symbol = self.pool.symbol(&name);
        self.signals.insert(symbol, signal);
        self.symbol_of.insert(signal, symbol);
        symbol
    }

    /// A bond named after the element at one of its ends, where only one of them can be meant.
    fn bond_word(&self, b: BondId) -> String {
        let bond = &self.bonds[b.at()];
        for end in [bond.head, bond.tail] {
            let decl = &self.elements[end.at()];
            if self.bonds_of[end.at()].len() == 1 && !matches!(decl.kind, Kind::Zero | Kind::One) {
                return decl.name.clone();
            }
        }
        bond.name.replace(' ', "")
    }
}

/// A simple fraction, for units under powers.
fn ratio_of(x: f64) -> Option<(i32, i32)> {
    [1i32, 2, 3, 4, 5, 6, 8].into_iter().find_map(|d| {
        let n = x * f64::from(d);
        (n.fract() == 0.0 && n.abs() < 1000.0).then_some((n as i32, d))
    })
}
