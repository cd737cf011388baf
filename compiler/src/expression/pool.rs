//! The pool that owns all expressions, its nodes and its symbols.

use super::Number;
use super::free_symbols::FreeSymbols;
use super::intern::{InternTable, hash_of, hash_of_pairs};
use super::node::{Expr, Node, Pairs, Symbol};
use super::options::Options;
use bond_runtime::ir::Unary;
use rustc_hash::FxHashMap;

/// Whole numbers from here on are remembered apart.
const SMALLEST: i64 = -2;

#[derive(Clone, Debug)]
struct SymbolData {
    name: String,
    value: Option<f64>,
}

/// Owns expressions and symbols.
#[derive(Clone, Debug)]
pub struct Pool {
    nodes: Vec<Node>,
    interned: InternTable,
    /// The variables of each expression.
    pub(super) variables: FreeSymbols,
    /// The parameters of each expression.
    parameters: FreeSymbols,
    /// Of each expression that has no variables, its value.
    constants: Vec<f64>,
    symbols: Vec<SymbolData>,
    /// Of each symbol, the expression that it is alone.
    alone: Vec<Option<Expr>>,
    small: [Option<Expr>; 8],
    /// Derivatives that were taken before.
    pub(super) derivatives: FxHashMap<(Expr, Symbol), Expr>,
    /// Whether an antiderivative may be a sum that cancels near 0.
    pub(super) cancelling: bool,
    /// Bounds on the work of its rules.
    pub options: Options,
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
            interned: InternTable::default(),
            variables: FreeSymbols::default(),
            parameters: FreeSymbols::default(),
            constants: Vec::new(),
            symbols: Vec::new(),
            alone: Vec::new(),
            small: [None; 8],
            derivatives: FxHashMap::default(),
            cancelling: false,
            options: Options::default(),
        }
    }

    /// A new variable with this name; names need not be unique.
    pub fn symbol(&mut self, name: &str) -> Symbol {
        self.new_symbol(name, None)
    }

    /// A new parameter, a symbol whose value is known. It stays a symbol in expressions.
    pub fn parameter(&mut self, name: &str, value: f64) -> Symbol {
        self.new_symbol(name, Some(value))
    }

    fn new_symbol(&mut self, name: &str, value: Option<f64>) -> Symbol {
        self.symbols.push(SymbolData { name: name.to_string(), value });
        self.alone.push(None);
        Symbol((self.symbols.len() - 1) as u32)
    }

    /// Whether any parameter of an expression is among the keys of a map.
    pub(super) fn has_parameter<T>(&self, e: Expr, map: &FxHashMap<Symbol, T>) -> bool {
        match self.parameters.few(e) {
            Some(few) => few.iter().any(|s| map.contains_key(s)),
            None => map.keys().any(|&s| self.value(s).is_some()),
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
        if let Some(Some(e)) = self.alone.get(s.0 as usize) {
            return *e;
        }
        let e = self.intern(Node::Symbol(s));
        if let Some(alone) = self.alone.get_mut(s.0 as usize) {
            *alone = Some(e);
        }
        e
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
        let small = n.integer().and_then(|n| usize::try_from(n - SMALLEST).ok()).filter(|i| *i < self.small.len());
        let Some(i) = small else { return self.intern(Node::Number(n)) };
        if let Some(e) = self.small[i] {
            return e;
        }
        let e = self.intern(Node::Number(n));
        self.small[i] = Some(e);
        e
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
        self.variables.is_empty(e).then(|| self.constants[e.0 as usize])
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
        let hash = hash_of(&node);
        match self.interned.find(hash, |e| self.nodes[e.0 as usize] == node) {
            Some(e) => e,
            None => self.append(hash, node),
        }
    }

    /// A function of an expression, where it is there.
    pub(crate) fn existing(&self, f: Unary, e: Expr) -> Option<Expr> {
        let node = Node::Unary(f, e);
        self.interned.find(hash_of(&node), |e| self.nodes[e.0 as usize] == node)
    }

    /// The one sum of these terms.
    pub(super) fn intern_sum(&mut self, c: Number, terms: impl AsRef<[(Expr, Number)]> + Into<Pairs>) -> Expr {
        let hash = hash_of_pairs(true, c, terms.as_ref());
        let is =
            |e: Expr| matches!(&self.nodes[e.0 as usize], Node::Sum(d, list) if *d == c && **list == *terms.as_ref());
        match self.interned.find(hash, is) {
            Some(e) => e,
            None => self.append(hash, Node::Sum(c, terms.into())),
        }
    }

    /// The one product of these factors.
    pub(super) fn intern_product(&mut self, c: Number, factors: impl AsRef<[(Expr, Number)]> + Into<Pairs>) -> Expr {
        let hash = hash_of_pairs(false, c, factors.as_ref());
        let is = |e: Expr| matches!(&self.nodes[e.0 as usize], Node::Product(d, list) if *d == c && **list == *factors.as_ref());
        match self.interned.find(hash, is) {
            Some(e) => e,
            None => self.append(hash, Node::Product(c, factors.into())),
        }
    }

    /// Adds a node that is not there yet.
    fn append(&mut self, hash: u32, node: Node) -> Expr {
        let e = Expr(self.nodes.len() as u32);
        let mut of_children = |children: &[Expr]| {
            self.variables.push_union(children.iter().copied());
            self.parameters.push_union(children.iter().copied());
        };
        match &node {
            Node::Symbol(s) => {
                let is_known = self.symbols.get(s.0 as usize).is_some_and(|d| d.value.is_some());
                self.variables.push((!is_known).then_some(*s));
                self.parameters.push(is_known.then_some(*s));
            }
            Node::Number(_) => of_children(&[]),
            Node::Sum(_, pairs) | Node::Product(_, pairs) => {
                let children = pairs.iter().map(|p| p.0);
                self.variables.push_union(children.clone());
                self.parameters.push_union(children);
            }
            Node::Unary(_, a) => of_children(&[*a]),
            Node::Power(a, b) | Node::Binary(_, a, b) => of_children(&[*a, *b]),
            Node::Select(c, a, b) => of_children(&[*c, *a, *b]),
        }
        let constant = if self.variables.is_empty(e) {
            self.evaluate(&node, &|c| self.constant(c).unwrap_or(f64::NAN), &|_| f64::NAN)
        } else {
            f64::NAN
        };
        self.constants.push(constant);
        self.nodes.push(node);
        self.interned.add(hash, e);
        e
    }
}
