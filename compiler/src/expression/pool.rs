//! The pool that owns all expressions, its nodes and its symbols.

use super::Number;
use bond_runtime::ir::{Binary, Unary};
use rustc_hash::FxHashMap;
use std::sync::Arc;

/// An expression: an index in its [`Pool`]. Equal expressions have equal indices.
#[derive(Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Debug)]
pub struct Expr(pub(super) u32);

/// A variable or a parameter.
#[derive(Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Debug)]
pub struct Symbol(pub u32);

/// A list of terms with their coefficients, or of factors with their exponents, sorted by expression.
pub(super) type Pairs = Arc<[(Expr, Number)]>;

/// What an expression is. Children are older than the node.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub enum Node {
    /// A number.
    Number(Number),
    /// A variable or a parameter.
    Symbol(Symbol),
    /// `constant + Σ coefficient * term`; coefficients are not 0, no term is a number, a sum, or a product with a
    /// coefficient of its own. At least two summands.
    Sum(Number, Pairs),
    /// `coefficient * Π factor^exponent`; exponents are ratios and not 0, no factor is a number; more than one factor
    /// alone with coefficient and exponent 1.
    Product(Number, Pairs),
    /// `a^b` with an exponent that is no ratio.
    Power(Expr, Expr),
    /// A function; never `Neg`, which is a product, nor `Sqrt`, which is a power.
    Unary(Unary, Expr),
    /// `Min`, `Max`, `Atan2`, a comparison or a connective; never arithmetic.
    Binary(Binary, Expr, Expr),
    /// The second where the first is not 0, else the third.
    Select(Expr, Expr, Expr),
}

impl Node {
    /// Calls `f` with each child.
    pub fn each_child(&self, f: &mut dyn FnMut(Expr)) {
        match self {
            Node::Number(_) | Node::Symbol(_) => {}
            Node::Sum(_, pairs) | Node::Product(_, pairs) => pairs.iter().for_each(|&(e, _)| f(e)),
            Node::Power(a, b) | Node::Binary(_, a, b) => [*a, *b].into_iter().for_each(f),
            Node::Unary(_, a) => f(*a),
            Node::Select(c, a, b) => [*c, *a, *b].into_iter().for_each(f),
        }
    }
}

/// Which variables an expression has.
#[derive(Clone, Debug)]
pub(super) enum Support {
    /// All of them, sorted.
    Few(Arc<[Symbol]>),
    /// More than [`FEW`].
    Many,
}

/// Expressions with more variables than this don't carry the list of them.
const FEW: usize = 16;

#[derive(Clone, Debug)]
struct SymbolData {
    name: String,
    value: Option<f64>,
}

/// Owns expressions and symbols.
#[derive(Clone, Debug)]
pub struct Pool {
    nodes: Vec<Node>,
    known: FxHashMap<Node, Expr>,
    pub(super) support: Vec<Support>,
    constants: FxHashMap<Expr, f64>,
    symbols: Vec<SymbolData>,
    parameters: Vec<Symbol>,
    empty: Arc<[Symbol]>,
    pub(super) derivatives: FxHashMap<(Expr, Symbol), Expr>,
}

impl Default for Pool {
    fn default() -> Self {
        Self::new()
    }
}

impl Pool {
    /// An empty pool.
    pub fn new() -> Pool {
        Pool {
            nodes: Vec::new(),
            known: FxHashMap::default(),
            support: Vec::new(),
            constants: FxHashMap::default(),
            symbols: Vec::new(),
            parameters: Vec::new(),
            empty: Arc::from([]),
            derivatives: FxHashMap::default(),
        }
    }

    /// A new variable with this name; names need not be unique.
    pub fn symbol(&mut self, name: &str) -> Symbol {
        self.symbols.push(SymbolData { name: name.to_string(), value: None });
        Symbol((self.symbols.len() - 1) as u32)
    }

    /// A new parameter, a symbol whose value is known. It stays a symbol in expressions.
    pub fn parameter(&mut self, name: &str, value: f64) -> Symbol {
        self.symbols.push(SymbolData { name: name.to_string(), value: Some(value) });
        let s = Symbol((self.symbols.len() - 1) as u32);
        self.parameters.push(s);
        s
    }

    /// Whether a parameter is among the keys of a map.
    pub(super) fn has_parameter<T>(&self, map: &FxHashMap<Symbol, T>) -> bool {
        if self.parameters.len() < map.len() {
            self.parameters.iter().any(|s| map.contains_key(s))
        } else {
            map.keys().any(|&s| self.value(s).is_some())
        }
    }

    /// A symbol's name; empty for a symbol of another pool.
    pub fn name(&self, s: Symbol) -> &str {
        self.symbols.get(s.0 as usize).map_or("", |d| &d.name)
    }

    /// A parameter's value; `None` for a variable.
    pub fn value(&self, s: Symbol) -> Option<f64> {
        self.symbols.get(s.0 as usize).and_then(|d| d.value)
    }

    /// A symbol as an expression.
    pub fn var(&mut self, s: Symbol) -> Expr {
        self.intern(Node::Symbol(s))
    }

    /// An integer.
    pub fn int(&mut self, i: i64) -> Expr {
        self.numeral(Number::from(i))
    }

    /// A fraction.
    pub fn ratio(&mut self, n: i64, d: i64) -> Expr {
        self.numeral(Number::ratio(n, d))
    }

    /// A number. What is a short decimal becomes exact, so that 0.1 is 1/10.
    pub fn float(&mut self, x: f64) -> Expr {
        self.numeral(Number::float(x))
    }

    /// A decimal as it is written; `None` if it is no number.
    pub fn decimal(&mut self, digits: &str) -> Option<Expr> {
        Number::decimal(digits).map(|n| self.numeral(n))
    }

    /// A number of any form.
    pub fn numeral(&mut self, n: Number) -> Expr {
        self.intern(Node::Number(n))
    }

    /// The number pi, rounded.
    pub fn pi(&mut self) -> Expr {
        self.numeral(Number::Float(std::f64::consts::PI))
    }

    /// 0
    pub fn zero(&mut self) -> Expr {
        self.numeral(Number::ZERO)
    }

    /// 1
    pub fn one(&mut self) -> Expr {
        self.numeral(Number::ONE)
    }

    /// What an expression is.
    ///
    /// # Panics
    /// If the expression is of another pool and out of this one's range.
    pub fn node(&self, e: Expr) -> &Node {
        &self.nodes[e.0 as usize]
    }

    /// The number it is, if it is one; a parameter is none.
    pub fn number(&self, e: Expr) -> Option<Number> {
        if let Node::Number(n) = self.node(e) { Some(*n) } else { None }
    }

    /// Whether it is the number 0.
    pub fn is_zero(&self, e: Expr) -> bool {
        self.number(e).is_some_and(Number::is_zero)
    }

    /// Whether it is the number 1.
    pub fn is_one(&self, e: Expr) -> bool {
        self.number(e).is_some_and(Number::is_one)
    }

    /// Its value, if only numbers and parameters occur in it.
    pub fn constant(&self, e: Expr) -> Option<f64> {
        self.constants.get(&e).copied()
    }

    /// How many nodes there are.
    pub fn len(&self) -> usize {
        self.nodes.len()
    }

    /// Whether there is no node.
    pub fn is_empty(&self) -> bool {
        self.nodes.is_empty()
    }

    /// The one expression that is this node, which must be canonical.
    pub(super) fn intern(&mut self, node: Node) -> Expr {
        if let Some(&e) = self.known.get(&node) {
            return e;
        }
        let e = Expr(self.nodes.len() as u32);
        let support = self.support_of(&node);
        let constant = match &support {
            Support::Few(s) if s.is_empty() => {
                Some(self.evaluate(&node, &|c| self.constant(c).unwrap_or(f64::NAN), &|_| f64::NAN))
            }
            Support::Few(_) | Support::Many => None,
        };
        if let Some(x) = constant {
            self.constants.insert(e, x);
        }
        self.support.push(support);
        self.nodes.push(node.clone());
        self.known.insert(node, e);
        e
    }

    fn support_of(&self, node: &Node) -> Support {
        if let Node::Symbol(s) = node {
            let known = self.value(*s).is_some();
            return Support::Few(if known { self.empty.clone() } else { Arc::from([*s]) });
        }
        let mut all: Vec<Symbol> = Vec::new();
        let mut largest = self.empty.clone();
        let mut many = false;
        node.each_child(&mut |c| match &self.support[c.0 as usize] {
            Support::Many => many = true,
            Support::Few(_) if many => {}
            Support::Few(few) => {
                for s in few.iter() {
                    if let Err(i) = all.binary_search(s) {
                        all.insert(i, *s);
                    }
                }
                many = all.len() > FEW;
                if few.len() > largest.len() {
                    largest = few.clone();
                }
            }
        });
        if many {
            Support::Many
        } else if largest.len() == all.len() {
            Support::Few(largest)
        } else {
            Support::Few(all.into())
        }
    }
}
