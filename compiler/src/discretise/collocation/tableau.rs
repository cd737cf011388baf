//! Nodes, weights and integrals of Lagrange polynomials on [0, 1] (Hairer, Norsett and Wanner, Solving Ordinary
//! Differential Equations I, II.7).

/// A collocation method: a polynomial of degree `s` that starts at the state and whose slope at each node is the rate
/// there.
pub(super) struct Tableau {
    /// c, ascending.
    pub(super) nodes: Vec<f64>,
    /// b_i, the integral of the i-th Lagrange polynomial over the step.
    pub(super) weights: Vec<f64>,
}

impl Tableau {
    /// The nodes of Gauss: order 2 s.
    pub(super) fn gauss(s: usize) -> Self {
        Self::at((1..=s).map(|i| 0.5 * (1.0 + gauss_node(s, i).0)).collect())
    }

    /// The three nodes of Radau that end with the step: order 5.
    pub(super) fn radau() -> Self {
        let root = 6f64.sqrt();
        Self::at(vec![(4.0 - root) / 10.0, (4.0 + root) / 10.0, 1.0])
    }

    fn at(nodes: Vec<f64>) -> Self {
        let weights = integrals(&nodes, 1.0);
        Self { nodes, weights }
    }

    /// How many stages.
    pub(super) fn stages(&self) -> usize {
        self.nodes.len()
    }

    /// The integrals of the Lagrange polynomials from 0 to `c`: the state there is x + h Σ of them times the rates.
    pub(super) fn integrals(&self, c: f64) -> Vec<f64> {
        integrals(&self.nodes, c)
    }

    /// The values of the Lagrange polynomials at `c`.
    pub(super) fn values(&self, c: f64) -> Vec<f64> {
        (0..self.stages()).map(|j| lagrange(&self.nodes, j, c)).collect()
    }

    /// The Taylor coefficients, at the end of the step, of the polynomial through values at the nodes: a row a
    /// coefficient.
    pub(super) fn expansion(&self) -> Vec<Vec<f64>> {
        let s = self.stages();
        let mut rows = vec![vec![0.0; s]; s];
        for j in 0..s {
            // The product of (1 + theta - c_k)/(c_j - c_k), multiplied out in theta.
            let mut poly = vec![1.0];
            for k in (0..s).filter(|k| *k != j) {
                let (shift, scale) = (1.0 - self.nodes[k], 1.0 / (self.nodes[j] - self.nodes[k]));
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
pub(super) fn quadrature(n: usize) -> Vec<(f64, f64)> {
    let one = |i| {
        let (x, slope) = gauss_node(n, i);
        (0.5 * (1.0 + x), 1.0 / ((1.0 - x * x) * slope * slope))
    };
    (1..=n).map(one).collect()
}

/// The i-th root of the Legendre polynomial of degree n, ascending, and the slope there.
fn gauss_node(n: usize, i: usize) -> (f64, f64) {
    let mut x = -(std::f64::consts::PI * (i as f64 - 0.25) / (n as f64 + 0.5)).cos();
    let mut slope = 1.0;
    for _ in 0..20 {
        let (mut before, mut p) = (1.0, x);
        for k in 2..=n {
            let k = k as f64;
            (before, p) = (p, ((2.0 * k - 1.0) * x * p - (k - 1.0) * before) / k);
        }
        slope = n as f64 * (x * p - before) / (x * x - 1.0);
        x -= p / slope;
    }
    // The middle one is 0, whatever rounding says.
    (if 2 * i == n + 1 { 0.0 } else { x }, slope)
}

/// The j-th Lagrange polynomial at `x`.
fn lagrange(nodes: &[f64], j: usize, x: f64) -> f64 {
    nodes.iter().enumerate().filter(|(k, _)| *k != j).map(|(_, c)| (x - c) / (nodes[j] - c)).product()
}

/// The integrals of the Lagrange polynomials from 0 to `end`.
fn integrals(nodes: &[f64], end: f64) -> Vec<f64> {
    let rule = quadrature(nodes.len());
    let one = |j| rule.iter().map(|(x, w)| w * end * lagrange(nodes, j, end * x)).sum();
    (0..nodes.len()).map(one).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_tableaus() {
        let two = Tableau::gauss(2);
        let root = 3f64.sqrt() / 6.0;
        assert!((two.nodes[0] - (0.5 - root)).abs() < 2e-16 && (two.weights[1] - 0.5).abs() < 2e-16);
        assert!((two.integrals(two.nodes[0])[1] - (0.25 - root)).abs() < 2e-16);
        let radau = Tableau::radau();
        assert!((radau.weights[2] - 1.0 / 9.0).abs() < 2e-16);
        let a = radau.integrals(radau.nodes[0]);
        assert!((a[0] - (88.0 - 7.0 * 6f64.sqrt()) / 360.0).abs() < 2e-16);
    }

    #[test]
    fn quadrature_of_polynomials() {
        for n in 1..=20 {
            let rule = quadrature(n);
            for degree in 0..2 * n as i32 {
                let sum: f64 = rule.iter().map(|(x, w)| w * x.powi(degree)).sum();
                assert!((sum - 1.0 / f64::from(degree + 1)).abs() < 4e-15, "{n} {degree} {sum}");
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
                let a: f64 = row.iter().zip(&five.nodes).map(|(w, c)| w * f(*c)).sum();
                a * theta.powi(m as i32)
            })
            .sum();
        assert!((sum - f(1.0 + theta)).abs() < 1e-12);
        let here: f64 = five.values(0.3).iter().zip(&five.nodes).map(|(l, c)| l * f(*c)).sum();
        assert!((here - f(0.3)).abs() < 1e-14);
    }
}
