//! `--sweep`: the values that a parameter takes one after another.

use super::INSTANCES;
use super::written::{assignment, plain, unit};
use bond_compiler::units::Dimension;
use bond_runtime::eval;
use bond_runtime::ir::Binary;

const EXAMPLE: &str = "100..1000:50, 1..1e6:7:log or 1,2,5";

/// The values of a parameter, in SI, or in the unit that `dimension` is of.
#[derive(Clone, Debug, PartialEq)]
pub struct Sweep {
    /// The parameter.
    pub path: String,
    /// The dimension that the values were given in, if they were.
    pub dimension: Option<Dimension>,
    /// As it was written, without spaces.
    pub text: String,
    values: Values,
}

#[derive(Clone, Debug, PartialEq)]
enum Values {
    List(Vec<f64>),
    /// Evenly spaced, or by equal factors: first, last and count.
    Range(f64, f64, u64, Spacing),
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Spacing {
    Even,
    Log,
}

impl Sweep {
    /// How many values there are.
    pub fn count(&self) -> u64 {
        match &self.values {
            Values::List(list) => list.len() as u64,
            Values::Range(_, _, n, _) => *n,
        }
    }

    /// Value `k`, from 0: of `FROM..TO:N` FROM + (TO - FROM) k / (N - 1), with `:log` FROM (TO / FROM)^(k / (N - 1)).
    /// Both ends are what was written, to the bit.
    pub fn value(&self, k: u64) -> f64 {
        let (from, to, n, spacing) = match &self.values {
            Values::List(list) => {
                return usize::try_from(k).ok().and_then(|k| list.get(k)).copied().unwrap_or(f64::NAN);
            }
            Values::Range(from, to, n, spacing) => (*from, *to, *n, *spacing),
        };
        if k == 0 || k + 1 >= n {
            return if k == 0 { from } else { to };
        }
        let part = k as f64 / (n - 1) as f64;
        match spacing {
            Spacing::Even => from + (to - from) * part,
            Spacing::Log => {
                let (ratio, m, k) = (to / from, (n - 1) as f64, k as f64);
                let pow = |x: f64, n: f64| eval::binary(Binary::Pow, x, n);
                // Their quotient may be beyond all numbers where what lies between them is not.
                if !ratio.is_normal() {
                    return from.signum() * pow(from.abs(), 1.0 - part) * pow(to.abs(), part);
                }
                let x = pow(ratio, part);
                // 1/6 is rounded, and so is the power by it: 10 is that of 1e6 all the same.
                let off = (pow(x, m) / pow(ratio, k) - 1.0) / m;
                from * if off.abs() < 1e-14 { x - x * off } else { x }
            }
        }
    }
}

/// Reads `PATH=FROM..TO:N`, `PATH=FROM..TO:N:log` or `PATH=A,B,...`.
///
/// # Errors
/// In a few words, what is wrong with it.
pub fn parse(text: &str) -> Result<Sweep, String> {
    let (path, rest) = assignment(text, EXAMPLE)?;
    if let Some((from, to)) = rest.split_once("...") {
        let (from, to) = (from.trim(), to.trim());
        return Err(format!(
            "three points may be read in two ways: write {path}={from}..{to}, or {path}={from}..0.{to}"
        ));
    }
    let (values, dimension) = match rest.split_once("..") {
        Some((from, range)) => self::range(&path, from, range)?,
        None => {
            let list = rest.split(',').map(bond::internal::quantity).collect::<Result<Vec<_>, _>>();
            let list = list.map_err(|why| meant(&path, rest).unwrap_or(why))?;
            (Values::List(list.iter().map(|q| q.0).collect()), unit(&list)?)
        }
    };
    Ok(Sweep { path, dimension, text: plain(rest), values })
}

/// How many values a range has that is given by its ends and a step, where they meet.
fn steps(from: &str, to: &str, step: &str) -> Option<u64> {
    let [from, to, step] = [from, to, step].map(|text| bond::internal::quantity(text).ok());
    let (from, to, step) = (from?, to?, step?);
    let n = (to.0 - from.0) / step.0 + 1.0;
    let whole = n.round();
    (n.is_finite() && (n - whole).abs() < 1e-6 && (2.0..=1e9).contains(&whole)).then_some(whole as u64)
}

/// What a range or a list in the form of another language was meant for.
fn meant(path: &str, text: &str) -> Option<String> {
    let inner = text.trim_matches(['[', ']', '(', ')', '{', '}']);
    let parts: Vec<&str> = inner.split(':').map(str::trim).collect();
    let range = "a range is FROM..TO:N, with the number of values";
    match parts[..] {
        [from, step, to] => {
            let Some(n) = steps(from, to, step) else {
                return Some(format!("{range}; for these three values, write `{path}={from},{step},{to}`"));
            };
            Some(format!(
                "{range}: for steps of {step}, write `{path}={from}..{to}:{n}`; for three values, `{path}={from},{step},{to}`"
            ))
        }
        [from, to] => {
            let n = steps(from, to, "1").unwrap_or(50);
            Some(format!("{range}: write `{path}={from}..{to}:{n}`"))
        }
        _ => {
            if let Some((function, arguments)) = text.split_once('(')
                && let "linspace" | "logspace" = function.trim()
                && let [from, to, n] = arguments.trim_end_matches(')').split(',').map(str::trim).collect::<Vec<_>>()[..]
            {
                return Some(match function.trim() {
                    "linspace" => format!("{range}: write `{path}={from}..{to}:{n}`"),
                    _ => format!("{range}: write `{path}=1e{from}..1e{to}:{n}:log`"),
                });
            }
            if inner.split([',', ';']).any(|x| x.trim().is_empty()) {
                return None;
            }
            let list: Vec<&str> = inner.split([',', ';', ' ']).filter(|x| !x.is_empty()).collect();
            let numbers = list.len() > 1 && list.iter().all(|x| bond::internal::quantity(x).is_ok());
            numbers.then(|| format!("values have commas between them: write `{path}={}`", list.join(",")))
        }
    }
}

fn range(path: &str, from: &str, rest: &str) -> Result<(Values, Option<Dimension>), String> {
    let mut parts = rest.split(':');
    let to = parts.next().unwrap_or_default();
    let Some(count) = parts.next() else {
        return Err(format!("how many values? Write {path}={}..{}:50 for 50 of them", from.trim(), to.trim()));
    };
    let spacing = match parts.next().map(str::trim) {
        None => Spacing::Even,
        Some("log") => Spacing::Log,
        Some(other) => return Err(format!("the values are spaced evenly, or with `:log`, not `:{other}`")),
    };
    if let Some(more) = parts.next() {
        return Err(format!("`:{more}` is one too many"));
    }
    let count = count.trim();
    let n: u64 = count.parse().map_err(|_| {
        let by_steps = steps(from, to, count)
            .map(|n| format!("; for steps of {count}, `{path}={}..{}:{n}`", from.trim(), to.trim()));
        format!("`{count}` is not a number of values: write a whole number, such as 50{}", by_steps.unwrap_or_default())
    })?;
    let ends = [bond::internal::quantity(from)?, bond::internal::quantity(to)?];
    let dimension = unit(&ends)?;
    let [from, to] = ends.map(|q| q.0);
    match n {
        0 => return Err("the range is empty: it has 0 values".into()),
        1 => return Err(format!("one value is not at both ends; write {path}=VALUE, or 2 values at least")),
        n if n > INSTANCES => return Err(format!("{n} values are too many; at most {INSTANCES} instances are run")),
        _ if from == to => return Err(format!("the range is empty: both ends are {from}")),
        _ if !(to - from).is_finite() => return Err("the range is too wide for double numbers".into()),
        _ => {}
    }
    if spacing == Spacing::Log && !(from > 0.0 && to > 0.0 || from < 0.0 && to < 0.0) {
        return Err("`:log` goes by equal factors, so both ends have one sign, and none is 0".into());
    }
    Ok((Values::Range(from, to, n, spacing), dimension))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn values(text: &str) -> Vec<f64> {
        let s = parse(text).unwrap();
        (0..s.count()).map(|k| s.value(k)).collect()
    }

    #[test]
    fn values_are_where_they_are_said() {
        assert_eq!(values("k=1..3:5"), [1.0, 1.5, 2.0, 2.5, 3.0]);
        assert_eq!(values("a.k = 3 .. -1 : 3"), [3.0, 1.0, -1.0]);
        assert_eq!(values("k=100 N/m..1 kN/m:4"), [100.0, 400.0, 700.0, 1000.0]);
        assert_eq!(values("m=0.1 kg, 20 g,5e-3kg"), [0.1, 0.02, 0.005]);
        assert_eq!(values("m=7"), [7.0]);
        assert_eq!(values("x=0..1 mm:2"), [0.0, 0.001]);
        assert_eq!(values("x=0.1..0.3:3")[2], 0.3);
        let log = values("k=1..1e6:7:log");
        assert_eq!(log, [1.0, 10.0, 100.0, 1e3, 1e4, 1e5, 1e6]);
        assert!((0..7).all(|i| (log[i] / 10f64.powi(i as i32) - 1.0).abs() < 1e-14), "{log:?}");
        let wide = values("k=1e300..1e-300:5:log");
        assert!((0..5).all(|i| (wide[i] / 10f64.powi(300 - 150 * i as i32) - 1.0).abs() < 1e-12), "{wide:?}");
        assert!(values("k=-1..-100:3:log").iter().zip([-1.0, -10.0, -100.0]).all(|(a, b)| (a / b - 1.0).abs() < 1e-14));
        assert_eq!(parse("cell[1][2].k = 2,3").unwrap().path, "cell[1,2].k");
        assert_eq!(parse("k=1 N/m..2 N/m:2").unwrap().dimension, bond::internal::quantity("1 N/m").unwrap().1);
    }

    #[test]
    fn nonsense_is_told() {
        for (text, words) in [
            ("k", "PATH="),
            ("=1,2", "name of the parameter"),
            ("k=", "values are missing"),
            ("k=1..2", "k=1..2:50"),
            ("k=1..2:0", "empty"),
            ("k=1..2:1", "both ends"),
            ("k=2..2:5", "empty"),
            ("k=1..2:-3", "not a number of values"),
            ("k=1..2:2.5", "not a number of values"),
            ("k=1..2:1000000001", "too many"),
            ("k=1..2:5:cubic", "cubic"),
            ("k=1..2:5:log:9", "one too many"),
            ("k=0..2:5:log", "one sign"),
            ("k=-1..2:5:log", "one sign"),
            ("k=1..2 kg:5", "another has none"),
            ("k=1 m..2 kg:5", "one unit"),
            ("k=1,,2", "missing"),
            ("k=nan..1:5", "number"),
            ("k=-1.7e308..1.7e308:5", "too wide"),
            ("k=1..1e999:5", "finite"),
            ("k=1...2:3", "write k=1..2:3"),
            ("k=1 ...2:3", "k=1..0.2:3"),
            ("k=1:0.5:3", "for steps of 0.5, write `k=1..3:5`"),
            ("k=1:2:8", "write `k=1,2,8`"),
            ("k=1:10", "write `k=1..10:10`"),
            ("k=1 2 3", "write `k=1,2,3`"),
            ("k=[1, 2, 3]", "write `k=1,2,3`"),
            ("k=linspace(1, 2, 5)", "write `k=1..2:5`"),
            ("k=logspace(1, 3, 5)", "write `k=1e1..1e3:5:log`"),
            ("k=1..10:0.5", "for steps of 0.5, `k=1..10:19`"),
        ] {
            let why = parse(text).unwrap_err();
            assert!(why.contains(words), "{text}: {why}");
        }
    }
}
