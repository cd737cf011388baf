//! Expressions as instructions of a step program.

use super::walk::Found;
use super::zone::zones;
use super::{Expr, Node, Number, Pool, Symbol};
use bond_runtime::ir::{Binary, Builder, Unary, Value};
use rustc_hash::{FxHashMap, FxHashSet};

/// Writes expressions into a program; what was written once is not written again.
///
/// Use one of these as long as the values of its symbols and of what was lowered are in scope in the builder.
#[derive(Clone)]
pub struct Lowering {
    /// The values of symbols.
    env: FxHashMap<Symbol, Value>,
    /// The values of expressions.
    memo: FxHashMap<Expr, Value>,
    /// Symbols that were not looked at yet.
    fresh: Vec<Symbol>,
    /// Whether a parameter was given a value.
    given: bool,
    /// One over denominators that several products share.
    inverses: FxHashMap<Below, Option<Value>>,
    /// Whether sines and cosines of sums are made of those of the terms, where these are there.
    turns: bool,
    /// Values before this one do not change in the iteration that is written.
    fixed: u32,
    /// Symbols whose terms are added last.
    last: FxHashSet<Symbol>,
    /// Laws that are on the branch which a value tells.
    branches: FxHashMap<Expr, Value>,
}

/// What a product is divided by: factors and their exponents.
pub type Below = Vec<(Expr, (i64, i64))>;

impl Lowering {
    /// Symbols with their values. A parameter that is not among them is its number.
    pub fn new(env: impl IntoIterator<Item = (Symbol, Value)>) -> Self {
        let mut lowering = Lowering {
            env: FxHashMap::default(),
            memo: FxHashMap::default(),
            fresh: Vec::new(),
            given: false,
            inverses: FxHashMap::default(),
            turns: false,
            fixed: 0,
            last: FxHashSet::default(),
            branches: FxHashMap::default(),
        };
        env.into_iter().for_each(|(s, value)| lowering.bind(s, value));
        lowering
    }

    /// Gives a symbol its value. What was lowered with another one keeps that.
    pub fn bind(&mut self, s: Symbol, value: Value) {
        self.env.insert(s, value);
        if !self.given {
            self.fresh.push(s);
        }
    }

    /// Begins what is done over and over: of a product what was there before is multiplied first, so that nobody waits
    /// for it.
    pub fn begin(&mut self, builder: &Builder) {
        self.fixed = builder.count();
    }

    /// Adds terms with these symbols last: what they are added to is small beside them, and keeps its digits so.
    pub fn last(&mut self, symbols: impl IntoIterator<Item = Symbol>) {
        self.last.extend(symbols);
    }

    /// Keeps what switches on one branch: `side` is 1 or -1 as what it switches on is, or 0 where that itself is to be
    /// looked at.
    pub fn branch(&mut self, e: Expr, side: Value) {
        self.branches.insert(e, side);
    }

    /// Makes sines and cosines of sums of those of the terms, where these are there.
    pub fn turn(&mut self) {
        self.turns = true;
    }

    /// Divides by what several products share once, and by what is given with a value not at all.
    pub fn share(&mut self, denominators: impl IntoIterator<Item = (Below, Option<Value>)>) {
        self.inverses = denominators.into_iter().collect();
    }

    /// What an expression is divided by, where it is a product; parts that are numbers do not count.
    pub fn below(pool: &Pool, e: Expr) -> Option<Below> {
        let Node::Product(_, factors) = pool.node(e) else { return None };
        below(factors, &|f| pool.constant(f).is_some())
    }

    /// Gives an expression its value, where that is had by other means.
    pub fn know(&mut self, e: Expr, value: Value) {
        self.memo.insert(e, value);
    }

    /// The value of an expression. Parameters and constant parts become one number each.
    ///
    /// # Errors
    /// A variable that has no value.
    pub fn lower(&mut self, pool: &Pool, builder: &mut Builder, e: Expr) -> Result<Value, Symbol> {
        // parameters that were given a value make constants variable
        self.given |= self.fresh.drain(..).any(|s| pool.value(s).is_some());
        let given = self.given;
        let folded = |e: Expr| if given { None } else { pool.constant(e) };
        if let Some(value) = self.known(e) {
            return Ok(value);
        }
        for e in self.needed(pool, e, &|e| folded(e).is_none() && self.known(e).is_none()) {
            let value = self.node(pool, builder, e, &folded)?;
            self.memo.insert(e, value);
        }
        Ok(self.child(builder, e, &folded))
    }

    fn known(&self, e: Expr) -> Option<Value> {
        self.memo.get(&e).copied()
    }

    /// What is to be written, in order. A product that is a term of a sum is written there, with its coefficient.
    fn needed(&self, pool: &Pool, root: Expr, enter: &dyn Fn(Expr) -> bool) -> Vec<Expr> {
        let mut found = Found::default();
        if enter(root) {
            found.add(root);
        }
        let mut at = 0;
        while let Some(&e) = found.all.get(at) {
            at += 1;
            let mut visit = |c: Expr| {
                if enter(c) {
                    found.add(c);
                }
            };
            if let Node::Sum(_, terms) = pool.node(e) {
                for &(t, _) in terms.iter() {
                    match pool.node(t) {
                        Node::Product(_, factors) if enter(t) => factors.iter().for_each(|&(f, _)| visit(f)),
                        Node::Number(_)
                        | Node::Symbol(_)
                        | Node::Sum(..)
                        | Node::Product(..)
                        | Node::Power(..)
                        | Node::Unary(..)
                        | Node::Binary(..)
                        | Node::Select(..) => visit(t),
                    }
                }
            } else {
                pool.node(e).each_child(&mut visit);
            }
        }
        found.all.sort_unstable();
        found.all
    }

    fn child(&self, builder: &mut Builder, e: Expr, folded: &dyn Fn(Expr) -> Option<f64>) -> Value {
        match (self.known(e), folded(e)) {
            (Some(value), _) => value,
            (None, x) => builder.number(x.unwrap_or(f64::NAN)),
        }
    }

    fn node(
        &mut self,
        pool: &Pool,
        builder: &mut Builder,
        e: Expr,
        folded: &dyn Fn(Expr) -> Option<f64>,
    ) -> Result<Value, Symbol> {
        Ok(match pool.node(e) {
            Node::Number(n) => builder.number(n.to_f64()),
            Node::Symbol(s) => match (self.env.get(s), pool.value(*s)) {
                (Some(value), _) => *value,
                (None, Some(x)) => builder.number(x),
                (None, None) => return Err(*s),
            },
            Node::Sum(c, terms) => self.sum(pool, builder, *c, terms, folded),
            Node::Product(c, factors) => self.product(builder, *c, factors, folded),
            Node::Power(a, b) => {
                let (a, b) = (self.child(builder, *a, folded), self.child(builder, *b, folded));
                builder.binary(Binary::Pow, a, b)
            }
            Node::Unary(f, a) => {
                if matches!(f, Unary::Sin | Unary::Cos)
                    && let Some(value) = self.turned(pool, builder, *f == Unary::Sin, *a)
                {
                    return Ok(value);
                }
                let fraction = if *f == Unary::Floor { self.fraction(pool, builder, *a, folded) } else { None };
                let a = match fraction {
                    Some((above, below)) => {
                        let below = builder.number(below);
                        builder.div(above, below)
                    }
                    None => self.child(builder, *a, folded),
                };
                match self.branches.get(&e) {
                    Some(side) => unary_branch(builder, *f, a, *side),
                    None => builder.unary(*f, a),
                }
            }
            Node::Binary(f, a, b) => {
                let (a, b) = self.sides(pool, builder, *f, (*a, *b), folded);
                match self.branches.get(&e) {
                    Some(side) => binary_branch(builder, *f, (a, b), *side),
                    None => builder.binary(*f, a, b),
                }
            }
            Node::Select(c, a, b) => {
                let [c, a, b] = [c, a, b].map(|&x| self.child(builder, x, folded));
                builder.select(c, a, b)
            }
        })
    }

    /// Both sides of a function of two; of a comparison without what they are divided by, as in [`Pool::eval`].
    fn sides(
        &mut self,
        pool: &Pool,
        builder: &mut Builder,
        f: Binary,
        (a, b): (Expr, Expr),
        folded: &dyn Fn(Expr) -> Option<f64>,
    ) -> (Value, Value) {
        let (mut sides, mut below) = ([self.child(builder, a, folded), self.child(builder, b, folded)], [1.0; 2]);
        if matches!(f, Binary::Lt | Binary::Le | Binary::Eq) {
            for (i, e) in [a, b].into_iter().enumerate() {
                if let Some((above, by)) = self.fraction(pool, builder, e, folded) {
                    (sides[i], below[i]) = (above, by);
                }
            }
        }
        let [p, q] = below;
        if p == q { (sides[0], sides[1]) } else { (scaled(builder, sides[0], q), scaled(builder, sides[1], p)) }
    }

    /// A sum or product as what is above and a positive number below, where that is no power of two.
    fn fraction(
        &mut self,
        pool: &Pool,
        builder: &mut Builder,
        e: Expr,
        folded: &dyn Fn(Expr) -> Option<f64>,
    ) -> Option<(Value, f64)> {
        if folded(e).is_some() {
            return None;
        }
        let whole = pool.whole(e);
        let (node, mut below) = whole.as_ref().map_or((pool.node(e), 1.0), |(node, d)| (node, *d));
        match node {
            Node::Sum(c, terms) if whole.is_some() => Some((self.sum(pool, builder, *c, terms, folded), below)),
            Node::Product(c, factors) => {
                let is_below = |f: &&(Expr, Number)| f.1.is_negative() && folded(f.0).is_some();
                for (f, n) in factors.iter().filter(is_below) {
                    below *= bond_runtime::eval::binary(Binary::Pow, folded(*f)?, n.abs().to_f64());
                }
                if is_power_of_two(below) || !below.is_normal() {
                    return None;
                }
                let above: Vec<_> = factors.iter().filter(|f| !is_below(f)).copied().collect();
                let above = self.product(builder, if below < 0.0 { -*c } else { *c }, &above, folded);
                Some((above, below.abs()))
            }
            _ => None,
        }
    }

    /// The sine, or else the cosine, of a sum or difference of two angles whose own are there.
    fn turned(&self, pool: &Pool, builder: &mut Builder, sine: bool, e: Expr) -> Option<Value> {
        let Node::Sum(c, terms) = pool.node(e) else { return None };
        let (true, true, [(p, m), (q, n)]) = (self.turns, c.is_zero(), &terms[..]) else { return None };
        if !m.abs().is_one() || !n.abs().is_one() {
            return None;
        }
        let known = |f: Unary, e: Expr| self.known(pool.existing(f, e)?);
        let [sp, cp, sq, cq] =
            [known(Unary::Sin, *p)?, known(Unary::Cos, *p)?, known(Unary::Sin, *q)?, known(Unary::Cos, *q)?];
        // sin(p + q) = sin p cos q + cos p sin q, cos(p + q) = cos p cos q - sin p sin q
        let (first, second) = match sine {
            true => (builder.mul(sp, cq), builder.mul(cp, sq)),
            false => (builder.mul(cp, cq), builder.mul(sp, sq)),
        };
        let (minus_p, minus_q) = (m.is_negative(), n.is_negative());
        Some(match (sine, minus_p, minus_q) {
            (true, false, false) => builder.add(first, second),
            (true, false, true) => builder.sub(first, second),
            (true, true, false) => builder.sub(second, first),
            (true, true, true) => {
                let sum = builder.add(first, second);
                builder.unary(Unary::Neg, sum)
            }
            (false, p, q) if p == q => builder.sub(first, second),
            (false, ..) => builder.add(first, second),
        })
    }

    /// Positive terms first, then the others are taken off; all constants are one summand. Then what is to come last.
    /// What weighs a term may be a number of a method, and so has its sign and the term its place: the sums at two
    /// nodes are then made in the same way, whatever the signs of their weights. A variable that another term cuts off
    /// is taken with its cut: the dead zone `x - min(max(x, -1), 1)` is 0 exactly.
    fn sum(
        &mut self,
        pool: &Pool,
        builder: &mut Builder,
        c: Number,
        terms: &[(Expr, Number)],
        folded: &dyn Fn(Expr) -> Option<f64>,
    ) -> Value {
        let mut constant = c.to_f64();
        let mut plus: Vec<Value> = Vec::new();
        let (mut minus, mut last) = (Vec::new(), Vec::new());
        let is_last = |e: Expr| !self.last.is_empty() && pool.contains_any(e, &|s| self.last.contains(&s));
        let zones: Vec<_> = zones(pool, terms).into_iter().filter(|z| !is_last(z.0)).collect();
        let grown = if self.last.is_empty() { growths(pool, c, terms, folded) } else { Vec::new() };
        for &(x, cut, n) in &zones {
            let (x, cut) = (self.child(builder, x, folded), self.child(builder, cut, folded));
            let zone = builder.sub(x, cut);
            plus.push(scaled(builder, zone, n.to_f64()));
        }
        for g in &grown {
            let (exp, x) = (self.child(builder, g.exp, folded), self.child(builder, g.x, folded));
            let growth = growth(builder, x, exp);
            plus.push(match g.without {
                Some(p) => {
                    let p = self.times(pool, builder, (p, g.n), folded);
                    builder.mul(p, growth)
                }
                None => {
                    constant = 0.0;
                    scaled(builder, growth, g.n.to_f64())
                }
            });
        }
        let grows = |t: Expr| grown.iter().any(|g| g.with == t || g.without == Some(t));
        let whole = |t: Expr| zones.iter().all(|z| z.0 != t && z.1 != t) && !grows(t);
        for &(t, n) in terms.iter().filter(|t| whole(t.0)) {
            if let Some(x) = folded(t) {
                constant += n.to_f64() * x;
            } else if !self.last.is_empty() && pool.contains_any(t, &|s| self.last.contains(&s)) {
                last.push((t, n));
            } else if n.is_negative() && !is_weight(n) {
                minus.push((t, n));
            } else {
                plus.push(self.times(pool, builder, (t, n), folded));
            }
        }
        let mut total = builder.total(&plus);
        if constant != 0.0 && (constant > 0.0 || total.is_none() || constant.is_nan()) {
            let value = builder.number(constant);
            total = Some(total.map_or(value, |sum| builder.add(sum, value)));
        } else if constant < 0.0 {
            let value = builder.number(-constant);
            total = total.map(|sum| builder.sub(sum, value));
        }
        for (t, n) in minus.into_iter().chain(last) {
            total = Some(match total {
                Some(sum) if n.is_negative() && !is_weight(n) => {
                    let value = self.times(pool, builder, (t, n.abs()), folded);
                    builder.sub(sum, value)
                }
                Some(sum) => {
                    let value = self.times(pool, builder, (t, n), folded);
                    builder.add(sum, value)
                }
                None => self.times(pool, builder, (t, n), folded),
            });
        }
        total.unwrap_or_else(|| builder.number(constant))
    }

    fn times(
        &mut self,
        pool: &Pool,
        builder: &mut Builder,
        (t, n): (Expr, Number),
        folded: &dyn Fn(Expr) -> Option<f64>,
    ) -> Value {
        if let Node::Product(_, factors) = pool.node(t)
            && !self.memo.contains_key(&t)
        {
            return self.product(builder, n, factors, folded);
        }
        let value = self.child(builder, t, folded);
        // Halves and doubles are exact: nobody need wait for the whole.
        let by = n.to_f64();
        if by.abs() != 1.0
            && is_power_of_two(by)
            && let Some((a, b)) = builder.factors(value)
            && a.0 < self.fixed
        {
            let part = scaled(builder, a, by);
            return builder.mul(part, b);
        }
        scaled(builder, value, by)
    }

    /// One number, the factors above, the factors below: at most one division.
    fn product(
        &mut self,
        builder: &mut Builder,
        c: Number,
        factors: &[(Expr, Number)],
        folded: &dyn Fn(Expr) -> Option<f64>,
    ) -> Value {
        let mut key = below(factors, &|f| folded(f).is_some()).filter(|k| self.inverses.contains_key(k));
        let mut constant = c.to_f64();
        let mut divisor = 1.0;
        let (mut still, mut above, mut below) = (Vec::new(), Vec::new(), Vec::new());
        for &(f, n) in factors {
            if let Some(x) = folded(f) {
                let side = if n.is_negative() { &mut divisor } else { &mut constant };
                *side *= bond_runtime::eval::binary(Binary::Pow, x, n.abs().to_f64());
            } else {
                let value = self.child(builder, f, folded);
                let power = raise(builder, value, n.abs());
                match () {
                    () if n.is_negative() => &mut below,
                    () if value.0 < self.fixed => &mut still,
                    () => &mut above,
                }
                .push(power);
            }
        }
        // a number that got lost in folding is put back as it stands
        let quotient = constant / divisor;
        if quotient.is_normal() || constant == 0.0 {
            constant = quotient;
        } else if divisor != 1.0 {
            let divisor = builder.number(divisor);
            below.push(divisor);
            key = None;
        }
        let multiply = |builder: &mut Builder, all: Vec<Value>| all.into_iter().reduce(|a, b| builder.mul(a, b));
        let above = match multiply(builder, still) {
            Some(still) if !above.is_empty() => {
                let still = scaled(builder, still, std::mem::replace(&mut constant, 1.0));
                let moving = multiply(builder, above);
                moving.map(|m| builder.mul(still, m))
            }
            Some(still) => Some(still),
            None => multiply(builder, above),
        };
        let below = multiply(builder, below);
        if let (Some(key), Some(b)) = (key, below) {
            let inverse = match self.inverses.get(&key) {
                Some(Some(inverse)) => *inverse,
                _ => {
                    let one = builder.number(1.0);
                    builder.div(one, b)
                }
            };
            self.inverses.insert(key, Some(inverse));
            let a = scaled(builder, above.unwrap_or(inverse), constant);
            return if above.is_some() { builder.mul(a, inverse) } else { a };
        }
        match (above, below) {
            (None, None) => builder.number(constant),
            (Some(a), None) => scaled(builder, a, constant),
            (None, Some(b)) => {
                let c = builder.number(constant);
                builder.div(c, b)
            }
            (Some(a), Some(b)) => {
                let a = scaled(builder, a, constant);
                builder.div(a, b)
            }
        }
    }
}

/// What switches on `x`, as `x` or else as `side` is.
fn unary_branch(b: &mut Builder, f: Unary, x: Value, side: Value) -> Value {
    let at = b.select(side, side, x);
    match f {
        Unary::Abs => {
            let (zero, minus) = (b.number(0.0), b.unary(Unary::Neg, x));
            let below = b.binary(Binary::Lt, at, zero);
            b.select(below, minus, x)
        }
        // What switches is the sine of pi x: it is above 0 where the whole number is even.
        Unary::Floor => {
            let (zero, one) = (b.number(0.0), b.number(1.0));
            let (half, two) = (b.number(0.5), b.number(2.0));
            let odd = b.binary(Binary::Lt, side, zero);
            let odd = b.select(odd, one, zero);
            let from = b.sub(x, odd);
            let middle = b.add(from, half);
            let pairs = b.mul(half, middle);
            let pairs = b.unary(f, pairs);
            let even = b.mul(two, pairs);
            let kept = b.add(even, odd);
            let whole = b.unary(f, x);
            b.select(side, kept, whole)
        }
        _ => b.unary(f, at),
    }
}

/// What switches on `x - y`, as that or else as `side` is.
fn binary_branch(b: &mut Builder, f: Binary, (x, y): (Value, Value), side: Value) -> Value {
    let (off, zero) = (b.sub(x, y), b.number(0.0));
    let at = b.select(side, side, off);
    let below = b.binary(Binary::Lt, at, zero);
    match f {
        Binary::Min => b.select(below, x, y),
        Binary::Max => b.select(below, y, x),
        Binary::Lt => below,
        _ => b.binary(f, at, zero),
    }
}

/// What a sum has as `n p (exp(x) - 1)`, as the current of a diode: the terms `n p exp(x)` and `-n p`, where `p` may be
/// 1 and that a number.
struct Growth {
    with: Expr,
    without: Option<Expr>,
    exp: Expr,
    x: Expr,
    n: Number,
}

fn growths(pool: &Pool, c: Number, terms: &[(Expr, Number)], folded: &dyn Fn(Expr) -> Option<f64>) -> Vec<Growth> {
    if terms.len() > pool.options.terms {
        return Vec::new();
    }
    let of = |e: Expr| match pool.node(e) {
        Node::Unary(Unary::Exp, x) if folded(e).is_none() => Some(*x),
        _ => None,
    };
    let (mut plain, mut found): (Vec<Growth>, Vec<Growth>) = (Vec::new(), Vec::new());
    for &(t, n) in terms {
        if let Some(x) = of(t) {
            plain.push(Growth { with: t, without: None, exp: t, x, n });
            continue;
        }
        let Node::Product(k, factors) = pool.node(t) else { continue };
        let once = |&&(f, n): &&(Expr, Number)| if n.is_one() { of(f).map(|x| (f, x)) } else { None };
        let Some((exp, x)) = factors.iter().find_map(|f| once(&f)).filter(|_| k.is_one()) else { continue };
        let rest = || factors.iter().filter(|f| f.0 != exp);
        let is_rest = |e: Expr| match pool.node(e) {
            Node::Product(k, others) => k.is_one() && others.iter().eq(rest()),
            _ => rest().eq(&[(e, Number::ONE)]),
        };
        let other = terms.iter().find(|o| (o.1 + n).is_zero() && is_rest(o.0)).map(|o| o.0);
        if let Some(other) = other.filter(|o| found.iter().all(|g| g.without != Some(*o))) {
            found.push(Growth { with: t, without: Some(other), exp, x, n });
        }
    }
    if !c.is_zero() {
        if plain.iter().fold(c, |sum, g| sum + g.n).is_zero() {
            found.extend(plain);
        } else {
            found.extend(plain.into_iter().find(|g| (c + g.n).is_zero()));
        }
    }
    found
}

/// `exp(x) - 1` with all its digits: near 0 by its series, whose terms from the 13th on are below its rounding there.
fn growth(b: &mut Builder, x: Value, exp: Value) -> Value {
    let one = b.number(1.0);
    let mut sum = one;
    for k in (2..=12).rev() {
        let part = b.number(1.0 / f64::from(k));
        let part = b.mul(x, part);
        let part = b.mul(part, sum);
        sum = b.add(one, part);
    }
    let (near, far) = (b.mul(x, sum), b.sub(exp, one));
    let (size, limit) = (b.unary(Unary::Abs, x), b.number(0.25));
    let is_near = b.binary(Binary::Le, size, limit);
    b.select(is_near, near, far)
}

/// The factors below.
fn below(factors: &[(Expr, Number)], is_number: &dyn Fn(Expr) -> bool) -> Option<Below> {
    let mut list = Below::new();
    for (f, n) in factors.iter().filter(|(f, n)| n.is_negative() && !is_number(*f)) {
        let Number::Ratio(n, d) = n else { return None };
        list.push((*f, (*n, *d)));
    }
    (!list.is_empty()).then_some(list)
}

/// Whether a factor is a number of a method, not of a model.
fn is_weight(n: Number) -> bool {
    matches!(n, Number::Float(x) if x.abs() != 1.0)
}

/// Whether a product with this number has all digits of what it is multiplied with.
fn is_power_of_two(x: f64) -> bool {
    x.is_normal() && x.to_bits() & ((1 << 52) - 1) == 0
}

fn scaled(builder: &mut Builder, value: Value, by: f64) -> Value {
    if by == 1.0 {
        value
    } else if by == -1.0 {
        builder.unary(Unary::Neg, value)
    } else {
        let by = builder.number(by);
        builder.mul(by, value)
    }
}

/// A positive power: products and roots where the exponent is a whole or half number up to 64.
fn raise(builder: &mut Builder, x: Value, n: Number) -> Value {
    let Number::Ratio(above, below @ (1 | 2)) = n else {
        let n = builder.number(n.to_f64());
        return builder.binary(Binary::Pow, x, n);
    };
    if above > 64 {
        let n = builder.number(n.to_f64());
        return builder.binary(Binary::Pow, x, n);
    }
    let (mut whole, mut square) = (above / below, x);
    let mut result = if below == 2 { Some(builder.unary(Unary::Sqrt, x)) } else { None };
    while whole > 0 {
        if whole % 2 == 1 {
            result = Some(result.map_or(square, |r| builder.mul(r, square)));
        }
        whole /= 2;
        if whole > 0 {
            square = builder.mul(square, square);
        }
    }
    result.unwrap_or(x)
}
