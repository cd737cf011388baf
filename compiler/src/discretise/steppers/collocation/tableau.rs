//! Nodes, weights and integrals of Lagrange polynomials on [0, 1] (Hairer, Norsett and Wanner, Solving Ordinary
//! Differential Equations I, II.7), in double-double arithmetic: what a rounded coefficient takes from the energy it
//! takes in each step (Hairer, McLachlan and Razakarivony, BIT 48, 2008).

use bond_runtime::double_double::DoubleDouble;

/// The nodes of a collocation method.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Nodes {
    /// Gauss, with the number of stages.
    Gauss(usize),
    /// Radau IIA of three stages.
    Radau,
}

impl Nodes {
    pub(crate) fn stages(self) -> usize {
        match self {
            Nodes::Gauss(s) => s,
            Nodes::Radau => 3,
        }
    }

    pub(crate) fn tableau(self) -> Tableau {
        match self {
            Nodes::Gauss(s) => Tableau::gauss(s),
            Nodes::Radau => Tableau::radau(),
        }
    }
}

/// A collocation method: a polynomial of degree `s` that starts at the state and whose slope at each node is the rate
/// there.
pub(crate) struct Tableau {
    /// c, ascending.
    nodes: Vec<DoubleDouble>,
    /// b_i, the integral of the i-th Lagrange polynomial over the step.
    pub(crate) weights: Vec<DoubleDouble>,
}

impl Tableau {
    /// The nodes of Gauss: order 2 s.
    pub(crate) fn gauss(s: usize) -> Self {
        Self::at(quadrature(s).into_iter().map(|(node, _)| node).collect())
    }

    /// The three nodes of Radau that end with the step: order 5.
    pub(crate) fn radau() -> Self {
        let (four, root) = (DoubleDouble::new(4.0), DoubleDouble::new(6.0).sqrt());
        Self::at(vec![(four - root).over(10.0), (four + root).over(10.0), DoubleDouble::new(1.0)])
    }

    fn at(nodes: Vec<DoubleDouble>) -> Self {
        let weights = integrals(&nodes, DoubleDouble::new(1.0));
        Self { nodes, weights }
    }

    /// How many stages.
    pub(crate) fn stages(&self) -> usize {
        self.nodes.len()
    }

    /// c, ascending.
    pub(crate) fn nodes(&self) -> impl Iterator<Item = DoubleDouble> + '_ {
        self.nodes.iter().copied()
    }

    /// The integrals of the Lagrange polynomials from 0 to `c`: the state there is x + h Σ of them times the rates.
    pub(crate) fn integrals(&self, c: DoubleDouble) -> Vec<DoubleDouble> {
        integrals(&self.nodes, c)
    }

    /// A: the integrals up to each node, rounded.
    pub(crate) fn matrix(&self) -> Vec<Vec<f64>> {
        self.nodes().map(|c| self.integrals(c).into_iter().map(|a| a.high).collect()).collect()
    }

    /// The values of the Lagrange polynomials at `c`.
    pub(crate) fn values(&self, c: DoubleDouble) -> Vec<DoubleDouble> {
        (0..self.stages()).map(|j| lagrange(&self.nodes, j, c)).collect()
    }

    /// The Taylor coefficients, at the end of the step, of the polynomial through values at the nodes: a row a
    /// coefficient.
    pub(crate) fn expansion(&self) -> Vec<Vec<f64>> {
        let s = self.stages();
        let node = |k: usize| self.nodes[k].high;
        let mut rows = vec![vec![0.0; s]; s];
        for j in 0..s {
            // The product of (1 + theta - c_k)/(c_j - c_k), multiplied out in theta.
            let mut poly = vec![1.0];
            for k in (0..s).filter(|k| *k != j) {
                let (shift, scale) = (1.0 - node(k), 1.0 / (node(j) - node(k)));
                let mut next = vec![0.0; poly.len() + 1];
                for (m, x) in poly.iter().enumerate() {
                    next[m] += x * shift * scale;
                    next[m + 1] += x * scale;
                }
                poly = next;
            }
            for (m, x) in poly.into_iter().enumerate() {
                rows[m][j] = x;
            }
        }
        rows
    }
}

/// Nodes and weights of Gauss's quadrature on [0, 1], exact for polynomials of degree 2 n - 1.
pub(crate) fn quadrature(n: usize) -> Vec<(DoubleDouble, DoubleDouble)> {
    let one = DoubleDouble::new(1.0);
    let point = |i| {
        let (x, slope) = gauss_node(n, i);
        let weight = one.divided((one - x * x) * slope * slope);
        ((one + x).scale(0.5), weight)
    };
    (1..=n).map(point).collect()
}

/// The i-th root of the Legendre polynomial of degree n, ascending, and the slope there.
fn gauss_node(n: usize, i: usize) -> (DoubleDouble, DoubleDouble) {
    let one = DoubleDouble::new(1.0);
    let whole = |k: usize| DoubleDouble::new(k as f64);
    let mut x = DoubleDouble::new(-libm::cos(std::f64::consts::PI * (i as f64 - 0.25) / (n as f64 + 0.5)));
    // The middle one is 0, whatever rounding says.
    if 2 * i == n + 1 {
        x = DoubleDouble::default();
    }
    let mut slope = one;
    for _ in 0..8 {
        let (mut before, mut p) = (one, x);
        for k in 2..=n {
            let next = (whole(2 * k - 1) * x * p - whole(k - 1) * before).over(k as f64);
            (before, p) = (p, next);
        }
        slope = (whole(n) * (x * p - before)).divided(x * x - one);
        if 2 * i != n + 1 {
            x = x - p.divided(slope);
        }
    }
    (x, slope)
}

/// The j-th Lagrange polynomial at `x`.
fn lagrange(nodes: &[DoubleDouble], j: usize, x: DoubleDouble) -> DoubleDouble {
    let others = nodes.iter().enumerate().filter(|(k, _)| *k != j).map(|(_, c)| *c);
    others.fold(DoubleDouble::new(1.0), |product, c| (product * (x - c)).divided(nodes[j] - c))
}

/// The integrals of the Lagrange polynomials from 0 to `end`.
fn integrals(nodes: &[DoubleDouble], end: DoubleDouble) -> Vec<DoubleDouble> {
    let rule = quadrature(nodes.len());
    let one = |j| {
        let parts = rule.iter().map(|(x, w)| *w * end * lagrange(nodes, j, end * *x));
        parts.fold(DoubleDouble::default(), |sum, part| sum + part)
    };
    (0..nodes.len()).map(one).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_tableaus() {
        let two = Tableau::gauss(2);
        let root = 3f64.sqrt() / 6.0;
        let near = |x: DoubleDouble, y: f64| (x.high - y).abs() < 2e-16;
        assert!(near(two.nodes[0], 0.5 - root) && near(two.weights[1], 0.5));
        assert!(near(two.integrals(two.nodes[0])[1], 0.25 - root));
        let radau = Tableau::radau();
        assert!((radau.weights[2] - DoubleDouble::new(1.0).over(9.0)).high.abs() < 1e-30);
        let a = radau.integrals(radau.nodes[0]);
        assert!(near(a[0], (88.0 - 7.0 * 6f64.sqrt()) / 360.0));
    }

    /// Symplectic, and so the energy of quadratic ones is kept, to the last digit of double-double.
    #[test]
    fn quadratic_energies_are_kept() {
        for s in 1..=6 {
            let t = Tableau::gauss(s);
            let a: Vec<Vec<DoubleDouble>> = t.nodes().map(|c| t.integrals(c)).collect();
            for i in 0..s {
                for j in 0..s {
                    let (b, both) = (&t.weights, t.weights[i] * t.weights[j]);
                    let m = b[i] * a[i][j] + b[j] * a[j][i] - both;
                    assert!(m.high.abs() < 1e-29, "{s}: {i} {j} {m:?}");
                }
            }
        }
    }

    #[test]
    fn quadrature_of_polynomials() {
        for n in 1..=20 {
            let rule = quadrature(n);
            for degree in 0..2 * n as i32 {
                let power = |x: DoubleDouble| (0..degree).fold(DoubleDouble::new(1.0), |p, _| p * x);
                let sum = rule.iter().fold(DoubleDouble::default(), |sum, (x, w)| sum + *w * power(*x));
                let off = sum - DoubleDouble::new(1.0).over(f64::from(degree + 1));
                assert!(off.high.abs() < 1e-28, "{n} {degree} {off:?}");
            }
        }
    }

    #[test]
    fn polynomials_go_on() {
        let five = Tableau::gauss(5);
        let f = |x: f64| 1.0 + x * (2.0 - x * (3.0 + x * (1.0 - 0.5 * x)));
        let theta: f64 = 0.7;
        let sum: f64 = five
            .expansion()
            .iter()
            .enumerate()
            .map(|(m, row)| {
                let a: f64 = row.iter().zip(&five.nodes).map(|(w, c)| w * f(c.high)).sum();
                a * theta.powi(m as i32)
            })
            .sum();
        assert!((sum - f(1.0 + theta)).abs() < 1e-12);
        let here: f64 =
            five.values(DoubleDouble::new(0.3)).iter().zip(&five.nodes).map(|(l, c)| l.high * f(c.high)).sum();
        assert!((here - f(0.3)).abs() < 1e-14);
    }
}
