//! Complex numbers in a program, and the elimination of small complex systems in straight code.

use super::modes::Pair;
use bond_runtime::ir::{Builder, Unary, Value};

/// Entries of a matrix that are not 0: row, column, value; sorted.
pub(crate) type Entries = Vec<(usize, usize, Value)>;

/// A complex number in a program; a part that is not there is 0.
#[derive(Clone, Copy, Default)]
pub(crate) struct Cx {
    pub(crate) re: Option<Value>,
    pub(crate) im: Option<Value>,
}

/// Arithmetic that leaves out what is 0.
pub(crate) struct Algebra<'b> {
    pub(crate) b: &'b mut Builder,
}

impl Algebra<'_> {
    pub(crate) fn add(&mut self, x: Option<Value>, y: Option<Value>) -> Option<Value> {
        match (x, y) {
            (Some(x), Some(y)) => Some(self.b.add(x, y)),
            (Some(x), None) | (None, Some(x)) => Some(x),
            (None, None) => None,
        }
    }

    pub(crate) fn sub(&mut self, x: Option<Value>, y: Option<Value>) -> Option<Value> {
        match (x, y) {
            (Some(x), Some(y)) => Some(self.b.sub(x, y)),
            (Some(x), None) => Some(x),
            (None, Some(y)) => Some(self.b.unary(Unary::Neg, y)),
            (None, None) => None,
        }
    }

    fn mul(&mut self, x: Option<Value>, y: Option<Value>) -> Option<Value> {
        Some(self.b.mul(x?, y?))
    }

    /// A number times a value; nothing where the number is 0.
    pub(crate) fn times(&mut self, x: f64, y: Option<Value>) -> Option<Value> {
        let y = y?;
        if x == 0.0 {
            return None;
        }
        let x = self.b.number(x);
        Some(self.b.mul(x, y))
    }

    fn product(&mut self, x: Cx, y: Cx) -> Cx {
        let (a, b) = (self.mul(x.re, y.re), self.mul(x.im, y.im));
        let (c, d) = (self.mul(x.re, y.im), self.mul(x.im, y.re));
        Cx { re: self.sub(a, b), im: self.add(c, d) }
    }

    fn less(&mut self, x: Cx, y: Cx) -> Cx {
        Cx { re: self.sub(x.re, y.re), im: self.sub(x.im, y.im) }
    }

    fn inverse(&mut self, x: Cx) -> Cx {
        let one = self.b.number(1.0);
        match (x.re, x.im) {
            (Some(re), None) => Cx { re: Some(self.b.div(one, re)), im: None },
            (re, im) => {
                let (a, b) = (self.mul(re, re), self.mul(im, im));
                let size = self.add(a, b);
                let inverse = size.map(|s| self.b.div(one, s));
                let (re, im) = (self.mul(re, inverse), self.mul(im, inverse));
                Cx { re, im: self.sub(None, im) }
            }
        }
    }
}

/// The factors of P + λ Q: lower ones below the diagonal, inverse pivots on it, upper ones above.
pub(crate) struct Factors {
    n: usize,
    entries: Vec<Cx>,
}

impl Factors {
    /// Eliminates without exchanging rows: for a convex H and short steps the pivots have digits, and where one has
    /// none the iteration does not converge.
    pub(crate) fn new(algebra: &mut Algebra, n: usize, p: &Entries, q: &Entries, value: Pair) -> Self {
        let mut a = vec![Cx::default(); n * n];
        for &(i, j, v) in p {
            a[i * n + j].re = Some(v);
        }
        for &(i, j, v) in q {
            let (re, im) = (algebra.times(value.0, Some(v)), algebra.times(value.1, Some(v)));
            let at = &mut a[i * n + j];
            *at = Cx { re: algebra.add(at.re, re), im };
        }
        for k in 0..n {
            a[k * n + k] = algebra.inverse(a[k * n + k]);
            for i in k + 1..n {
                let f = algebra.product(a[i * n + k], a[k * n + k]);
                a[i * n + k] = f;
                for j in k + 1..n {
                    let term = algebra.product(f, a[k * n + j]);
                    a[i * n + j] = algebra.less(a[i * n + j], term);
                }
            }
        }
        Self { n, entries: a }
    }

    pub(crate) fn solve(&self, algebra: &mut Algebra, right: &[Cx]) -> Vec<Cx> {
        let n = self.n;
        let mut x = right.to_vec();
        for i in 0..n {
            for j in 0..i {
                let term = algebra.product(self.entries[i * n + j], x[j]);
                x[i] = algebra.less(x[i], term);
            }
        }
        for i in (0..n).rev() {
            for j in i + 1..n {
                let term = algebra.product(self.entries[i * n + j], x[j]);
                x[i] = algebra.less(x[i], term);
            }
            x[i] = algebra.product(x[i], self.entries[i * n + i]);
        }
        x
    }
}
