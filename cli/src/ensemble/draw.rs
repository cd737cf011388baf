//! `--draw`: distributions of parameters, and how random words become values of them.

use super::written::{assignment, plain, unit};
use bond_compiler::units::Dimension;
use bond_runtime::eval;
use bond_runtime::ir::Unary;

const EXAMPLE: &str = "normal(1 kg, 0.1 kg)";
const KNOWN: &str = "uniform(A, B), normal(MEAN, SD), lognormal(MEDIAN, SIGMA) and triangular(A, MODE, B)";

/// How a parameter is drawn, in SI, or in the unit that `dimension` is of.
#[derive(Clone, Debug, PartialEq)]
pub struct Draw {
    /// The parameter.
    pub path: String,
    /// The dimension that it was given in, if it was.
    pub dimension: Option<Dimension>,
    /// As it was written, without spaces.
    pub text: String,
    law: Law,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Law {
    Uniform { a: f64, b: f64 },
    Normal { mean: f64, sd: f64 },
    LogNormal { median: f64, sigma: f64 },
    Triangular { a: f64, mode: f64, b: f64 },
}

impl Draw {
    /// The value that two random words give. With `u = (w0 >> 11) / 2^53` and `v = (w1 >> 11) / 2^53`:
    ///
    /// - uniform: `a + (b - a) u`;
    /// - normal: `mean + sd z` with `z = sqrt(-2 log(1 - u)) cos(2 pi v)` (Box and Muller 1958);
    /// - lognormal: `median exp(sigma z)`;
    /// - triangular: `a + sqrt(u (b - a) (mode - a))` where `u (b - a) < mode - a`, else
    ///   `b - sqrt((1 - u) (b - a) (b - mode))`.
    pub fn value(&self, words: [u64; 2]) -> f64 {
        let [u, v] = words.map(|w| (w >> 11) as f64 * (1.0 / (1u64 << 53) as f64));
        match self.law {
            Law::Uniform { a, b } => a + (b - a) * u,
            Law::Normal { mean, sd } => mean + sd * normal(u, v),
            Law::LogNormal { median, sigma } => median * eval::unary(Unary::Exp, sigma * normal(u, v)),
            Law::Triangular { a, mode, b } if u * (b - a) < mode - a => a + (u * (b - a) * (mode - a)).sqrt(),
            Law::Triangular { a, mode, b } => b - ((1.0 - u) * (b - a) * (b - mode)).sqrt(),
        }
    }
}

fn normal(u: f64, v: f64) -> f64 {
    let radius = (-2.0 * eval::unary(Unary::Log, 1.0 - u)).sqrt();
    radius * eval::unary(Unary::Cos, std::f64::consts::TAU * v)
}

/// Reads `PATH=NAME(A, B, ...)`.
///
/// # Errors
/// In a few words, what is wrong with it.
pub fn parse(text: &str) -> Result<Draw, String> {
    let (path, rest) = assignment(text, EXAMPLE)?;
    let inside = rest.split_once('(').and_then(|(name, args)| Some((name.trim(), args.strip_suffix(')')?)));
    let (name, args) = inside.ok_or_else(|| format!("`{rest}` is not a distribution; there are {KNOWN}"))?;
    let list = args.split(',').map(bond::internal::quantity).collect::<Result<Vec<_>, _>>()?;
    let (numbers, alike): (Vec<f64>, &[_]) = (list.iter().map(|q| q.0).collect(), &list);
    let (law, alike) = match (name, numbers.as_slice()) {
        ("uniform", &[a, b]) => (Law::Uniform { a, b }, alike),
        ("normal", &[mean, sd]) => (Law::Normal { mean, sd }, alike),
        // The second one is about the logarithm.
        ("lognormal", &[median, sigma]) => (Law::LogNormal { median, sigma }, &alike[..1]),
        ("triangular", &[a, mode, b]) => (Law::Triangular { a, mode, b }, alike),
        ("uniform" | "normal" | "lognormal" | "triangular", given) => {
            return Err(format!("`{name}` does not take {}; there are {KNOWN}", counted(given.len())));
        }
        (other, _) => return Err(format!("there is no distribution `{other}`; there are {KNOWN}")),
    };
    let dimension = match law {
        // A deviation of 0 would be a unitless one in disguise; it is refused below.
        Law::Normal { .. } | Law::Uniform { .. } | Law::Triangular { .. } => unit(alike)?,
        Law::LogNormal { .. } if list[1].1.is_some_and(|d| d != Dimension::DIMENSIONLESS) => {
            return Err("SIGMA of `lognormal` has no unit: it is the standard deviation of the logarithm".into());
        }
        Law::LogNormal { .. } => unit(alike)?,
    };
    possible(law)?;
    Ok(Draw { path, dimension, text: plain(rest), law })
}

fn counted(n: usize) -> String {
    if n == 1 { "1 number".into() } else { format!("{n} numbers") }
}

fn possible(law: Law) -> Result<(), String> {
    let positive = |what: &str, x: f64| {
        if x > 0.0 { Ok(()) } else { Err(format!("{what} is {x}, and must be positive")) }
    };
    let between = |a: f64, b: f64| {
        if a >= b {
            return Err(format!("the interval is empty: it goes from {a} to {b}"));
        }
        if (b - a).is_finite() { Ok(()) } else { Err("the interval is too wide for double numbers".into()) }
    };
    match law {
        Law::Uniform { a, b } => between(a, b),
        Law::Normal { sd, .. } => positive("SD of `normal`", sd),
        Law::LogNormal { median, sigma } => {
            positive("SIGMA of `lognormal`", sigma)?;
            positive("MEDIAN of `lognormal`", median)
        }
        Law::Triangular { a, mode, b } => {
            between(a, b)?;
            if (a..=b).contains(&mode) { Ok(()) } else { Err(format!("MODE is {mode}, and not between {a} and {b}")) }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::philox::words;
    use super::*;

    /// Mean and standard deviation, and the share of values below a point, of many draws.
    fn moments(text: &str, below: f64) -> [f64; 3] {
        const N: u64 = 200_000;
        let d = parse(text).unwrap();
        let values: Vec<f64> = (0..N).map(|i| d.value(words(7, i, 0))).collect();
        let mean = values.iter().sum::<f64>() / N as f64;
        let var = values.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / N as f64;
        [mean, var.sqrt(), values.iter().filter(|x| **x < below).count() as f64 / N as f64]
    }

    #[test]
    fn moments_are_those_of_the_distributions() {
        // The standard error of a mean is 0.0022 sd; of a share, at most 0.0011.
        let close = |found: [f64; 3], wanted: [f64; 3]| {
            let off = [(found[0] - wanted[0]) / wanted[1], found[1] / wanted[1] - 1.0, found[2] - wanted[2]];
            assert!(off[0].abs() < 0.01 && off[1].abs() < 0.02 && off[2].abs() < 0.005, "{found:?} {wanted:?}");
        };
        close(moments("m=uniform(2, 5)", 2.75), [3.5, 3.0 / 12f64.sqrt(), 0.25]);
        close(moments("m=normal(-1, 0.5)", -0.5), [-1.0, 0.5, 0.841_344_7]);
        let (s2, median) = (0.3f64 * 0.3, 2.0);
        let mean = median * (s2 / 2.0).exp();
        close(moments("m=lognormal(2, 0.3)", 2.0), [mean, mean * (s2.exp() - 1.0).sqrt(), 0.5]);
        let (a, c, b) = (1.0f64, 2.0, 5.0);
        let var = (a * a + b * b + c * c - a * b - a * c - b * c) / 18.0;
        close(moments("m=triangular(1, 2, 5)", 2.0), [(a + b + c) / 3.0, var.sqrt(), (c - a) / (b - a)]);
        // With the mode at an end.
        close(moments("m=triangular(0, 0, 1)", 0.5), [1.0 / 3.0, (1.0 / 18.0f64).sqrt(), 0.75]);
        close(moments("m=triangular(0, 1, 1)", 0.5), [2.0 / 3.0, (1.0 / 18.0f64).sqrt(), 0.25]);
    }

    #[test]
    fn the_ends_of_the_words_are_finite() {
        for text in ["m=uniform(2,5)", "m=normal(0,1)", "m=lognormal(1,0.5)", "m=triangular(1,2,5)"] {
            let d = parse(text).unwrap();
            for w in [[0, 0], [u64::MAX, 0], [0, u64::MAX], [u64::MAX, u64::MAX]] {
                assert!(d.value(w).is_finite(), "{text} {w:?}");
            }
        }
        assert_eq!(parse("m=uniform(2,5)").unwrap().value([0, 0]), 2.0);
        assert!((4.9..=5.0).contains(&parse("m=uniform(2,5)").unwrap().value([u64::MAX, 0])));
    }

    #[test]
    fn units_are_read() {
        let d = parse("wall.k = normal(1 kN/m, 50 N/m)").unwrap();
        assert_eq!((d.path.as_str(), d.dimension), ("wall.k", bond::internal::quantity("1 N/m").unwrap().1));
        assert_eq!(d.law, Law::Normal { mean: 1000.0, sd: 50.0 });
        assert_eq!(parse("m=lognormal(100 g, 0.1)").unwrap().law, Law::LogNormal { median: 0.1, sigma: 0.1 });
        assert_eq!(parse("m=uniform((1 kg)/2, 1 kg)").unwrap().law, Law::Uniform { a: 0.5, b: 1.0 });
    }

    #[test]
    fn nonsense_is_told() {
        for (text, words) in [
            ("m", "PATH="),
            ("m=3", "not a distribution"),
            ("m=poisson(3)", "no distribution `poisson`"),
            ("m=uniform(3)", "1 number"),
            ("m=uniform()", "missing"),
            ("m=uniform(3,2)", "empty"),
            ("m=uniform(3,3)", "empty"),
            ("m=normal(3,0)", "positive"),
            ("m=normal(3,-1)", "positive"),
            ("m=normal(3 kg, 1)", "another has none"),
            ("m=normal(3 kg, 1 m)", "one unit"),
            ("m=lognormal(-3, 1)", "positive"),
            ("m=lognormal(3 kg, 1 kg)", "logarithm"),
            ("m=triangular(1,9,5)", "MODE"),
            ("m=triangular(1,2)", "2 numbers"),
            ("m=uniform(-1.7e308, 1.7e308)", "too wide"),
            ("m=uniform(nan, 1)", "number"),
            ("m=uniform(1, 2", "not a distribution"),
        ] {
            let why = parse(text).unwrap_err();
            assert!(why.contains(words), "{text}: {why}");
        }
    }
}
