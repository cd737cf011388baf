//! What a linear model tells of its motion: its poles, and its answer to sines.

use crate::linearize::Linearized;
use nalgebra::linalg::balancing::balance_parlett_reinsch;
use nalgebra::linalg::{LU, Schur};
use nalgebra::{Complex, DMatrix, DVector};
use petgraph::algo::kosaraju_scc;
use petgraph::graph::DiGraph;
use std::f64::consts::TAU;

/// So many rotations a state, after which eigenvalues are given up.
const MOST: usize = 1000;
/// Squares of larger entries are no doubles: such matrices are not balanced.
const LARGE: f64 = 1e150;

/// D^-1 A D in the place of A, rows and columns of like size, and the powers of 2 on the diagonal of D.
fn balance(a: &mut DMatrix<f64>) -> DVector<f64> {
    if a.amax() < LARGE { balance_parlett_reinsch(a) } else { DVector::from_element(a.nrows(), 1.0) }
}

impl Linearized {
    /// The poles, in 1/s: the eigenvalues of A, from slow to fast, of a pair the one with the positive imaginary part
    /// first. States that do not move each other both ways (integrals of others, scenes side by side) are told apart
    /// first, so that a pole at 0 which the structure has is 0. Each block is balanced (Parlett, Reinsch, Numerische
    /// Mathematik 13, 1969) and brought to Schur's form.
    ///
    /// # Errors
    /// In words, where the iteration does not end.
    pub fn poles(&self) -> Result<Vec<Complex<f64>>, String> {
        let n = self.a.nrows();
        let mut graph = DiGraph::<usize, ()>::with_capacity(n, n);
        let nodes: Vec<_> = (0..n).map(|i| graph.add_node(i)).collect();
        for (j, i) in (0..n).flat_map(|j| (0..n).map(move |i| (j, i))).filter(|(j, i)| self.a[(*i, *j)] != 0.0) {
            graph.add_edge(nodes[j], nodes[i], ());
        }
        let mut poles = Vec::with_capacity(n);
        for block in kosaraju_scc(&graph) {
            let mut rows: Vec<usize> = block.iter().map(|k| graph[*k]).collect();
            rows.sort_unstable();
            let mut a = DMatrix::from_fn(rows.len(), rows.len(), |i, j| self.a[(rows[i], rows[j])]);
            if let [x] = a.as_slice() {
                poles.push(Complex::new(*x, 0.0));
                continue;
            }
            balance(&mut a);
            let schur = Schur::try_new(a, f64::EPSILON, MOST * rows.len())
                .ok_or("the eigenvalues of A do not converge: take A itself, without `--poles`")?;
            poles.extend(schur.complex_eigenvalues().iter());
        }
        let key = |p: &Complex<f64>| (libm::hypot(p.re, p.im), p.re, -p.im);
        poles.sort_by(|a, b| {
            let (a, b) = (key(a), key(b));
            a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)).then(a.2.total_cmp(&b.2))
        });
        Ok(poles)
    }

    /// The transfer matrix C (j 2 pi f - A)^-1 B + D at a frequency f in Hz: a row for each output, a column for each
    /// input. Infinite where what joins the two has a pole there, on the imaginary axis.
    pub fn response(&self, hertz: f64) -> DMatrix<Complex<f64>> {
        let all: Vec<usize> = (0..self.a.nrows()).collect();
        let (outputs, inputs): (Vec<usize>, Vec<usize>) =
            ((0..self.c.nrows()).collect(), (0..self.b.ncols()).collect());
        self.part(hertz, &all, (&outputs, &inputs)).unwrap_or_else(|| {
            // A pole that one output has is none of the others'.
            DMatrix::from_fn(outputs.len(), inputs.len(), |y, u| {
                let part = self.part(hertz, &self.between(y, u), (&[y], &[u]));
                part.map_or(Complex::new(f64::INFINITY, 0.0), |one| one[(0, 0)])
            })
        })
    }

    /// The states that an input moves, and that an output is moved by.
    fn between(&self, output: usize, input: usize) -> Vec<usize> {
        let n = self.a.nrows();
        let spread = |mut found: Vec<bool>, joins: &dyn Fn(usize, usize) -> bool| {
            let mut open: Vec<usize> = (0..n).filter(|i| found[*i]).collect();
            while let Some(from) = open.pop() {
                for to in (0..n).filter(|to| joins(from, *to)) {
                    if !std::mem::replace(&mut found[to], true) {
                        open.push(to);
                    }
                }
            }
            found
        };
        let moved = spread((0..n).map(|i| self.b[(i, input)] != 0.0).collect(), &|from, to| self.a[(to, from)] != 0.0);
        let seen = spread((0..n).map(|i| self.c[(output, i)] != 0.0).collect(), &|from, to| self.a[(from, to)] != 0.0);
        (0..n).filter(|i| moved[*i] && seen[*i]).collect()
    }

    /// The response of some outputs to some inputs by some states; None at a pole of theirs.
    fn part(
        &self,
        hertz: f64,
        states: &[usize],
        (outputs, inputs): (&[usize], &[usize]),
    ) -> Option<DMatrix<Complex<f64>>> {
        let complex = |x: f64| Complex::new(x, 0.0);
        let n = states.len();
        let through = DMatrix::from_fn(outputs.len(), inputs.len(), |i, k| complex(self.d[(outputs[i], inputs[k])]));
        if n == 0 {
            return Some(through);
        }
        let mut scaled = DMatrix::from_fn(n, n, |i, k| self.a[(states[i], states[k])]);
        // A state in other units, by powers of 2: pivots are compared then.
        let units = balance(&mut scaled);
        let mut left = scaled.map(|x| complex(-x));
        for i in 0..n {
            left[(i, i)] += Complex::new(0.0, TAU * hertz);
        }
        let into = DMatrix::from_fn(n, inputs.len(), |i, k| complex(self.b[(states[i], inputs[k])] / units[i]));
        let out = DMatrix::from_fn(outputs.len(), n, |i, k| complex(self.c[(outputs[i], states[k])] * units[k]));
        let all = out * LU::new(left).solve(&into)? + through;
        all.iter().all(|x| x.re.is_finite() && x.im.is_finite()).then_some(all)
    }
}
