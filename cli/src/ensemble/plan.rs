//! Which instances there are, and what the parameters of each are.

use super::draw::Draw;
use super::philox::words;
use super::sweep::Sweep;
use super::{Args, INSTANCES};
use crate::stop::Stop;
use bond::internal::Quantity;
use bond_compiler::elaborate::told;

/// The grid of the sweeps, times the draws at each of its points.
///
/// Instance `i` is draw `i mod N` at point `i div N` of the grid; its random words are those of `i`, so that more draws
/// of a plan without sweeps go on where fewer ended.
#[derive(Clone, Debug)]
pub struct Plan {
    sweeps: Vec<Sweep>,
    draws: Vec<Draw>,
    seed: u64,
    /// Instances a point of the grid.
    each: u64,
    total: u64,
}

impl Plan {
    /// The plan that is asked for, beside parameters that are set for all.
    ///
    /// # Errors
    /// Status 2: too many instances, or a parameter that is given twice.
    pub fn new(args: &Args, set: &[(String, Quantity)]) -> Result<Self, Stop> {
        let each = args.monte_carlo.unwrap_or(1);
        let mut total = Some(each);
        for s in &args.sweep {
            total = total.and_then(|n| n.checked_mul(s.count()));
        }
        let Some(total) = total.filter(|n| *n <= INSTANCES) else {
            let counts =
                args.sweep.iter().map(|s| s.count().to_string()).chain(args.monte_carlo.map(|n| n.to_string()));
            let product = counts.collect::<Vec<_>>().join(" x ");
            return Err(Stop::Usage(format!(
                "{product} are too many instances; the limit is {INSTANCES}; take fewer values"
            )));
        };
        let sweeps = args.sweep.iter().map(|s| (&s.path, "--sweep"));
        let draws = args.draw.iter().map(|d| (&d.path, "--draw"));
        let mut known: Vec<(&String, &str)> = set.iter().map(|(path, _)| (path, "--set")).collect();
        for (path, option) in sweeps.chain(draws) {
            if let Some((_, other)) = known.iter().find(|(p, _)| *p == path) {
                let where_ =
                    if *other == option { format!("two {option}") } else { format!("{other} and in {option}") };
                return Err(Stop::Usage(format!("`{path}` is in {where_}; give it once")));
            }
            known.push((path, option));
        }
        Ok(Self { sweeps: args.sweep.clone(), draws: args.draw.clone(), seed: args.seed.unwrap_or(0), each, total })
    }

    /// How many instances there are.
    pub fn total(&self) -> u64 {
        self.total
    }

    /// The parameters that vary: those of the sweeps, then those that are drawn.
    pub fn paths(&self) -> impl Iterator<Item = &str> {
        self.sweeps.iter().map(|s| s.path.as_str()).chain(self.draws.iter().map(|d| d.path.as_str()))
    }

    /// Their values in an instance.
    pub fn values(&self, instance: u64) -> Vec<Quantity> {
        let mut point = instance / self.each;
        let mut list: Vec<Quantity> = Vec::with_capacity(self.sweeps.len() + self.draws.len());
        for s in self.sweeps.iter().rev() {
            list.push((s.value(point % s.count()), s.dimension));
            point /= s.count();
        }
        list.reverse();
        let drawn = |(j, d): (usize, &Draw)| (d.value(words(self.seed, instance, j as u64)), d.dimension);
        list.extend(self.draws.iter().enumerate().map(drawn));
        list
    }

    /// An instance and its values, for people.
    pub fn named(&self, instance: u64) -> String {
        let values = self.values(instance);
        let list: Vec<String> = self.paths().zip(values).map(|(p, (x, _))| format!("{p} = {}", told(x))).collect();
        format!("instance {instance} ({})", list.join(", "))
    }

    /// What makes it: option and text.
    pub fn written(&self) -> Vec<(&'static str, String)> {
        let sweeps: Vec<String> = self.sweeps.iter().map(|s| format!("{}={}", s.path, s.text)).collect();
        let draws: Vec<String> = self.draws.iter().map(|d| format!("{}={}", d.path, d.text)).collect();
        let count = if self.draws.is_empty() { String::new() } else { self.each.to_string() };
        vec![
            ("--sweep", sweeps.join(" ")),
            ("--monte-carlo", count),
            ("--draw", draws.join(" ")),
            ("--seed", self.seed.to_string()),
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::super::{draw, sweep};
    use super::*;

    fn plan(sweeps: &[&str], draws: &[&str], n: Option<u64>, set: &[&str]) -> Result<Plan, Stop> {
        let args = Args {
            sweep: sweeps.iter().map(|t| sweep::parse(t).unwrap()).collect(),
            monte_carlo: n,
            draw: draws.iter().map(|t| draw::parse(t).unwrap()).collect(),
            seed: None,
            threads: None,
            restart: false,
        };
        Plan::new(&args, &set.iter().map(|p| (p.to_string(), (1.0, None))).collect::<Vec<_>>())
    }

    #[test]
    fn the_last_sweep_varies_fastest() {
        let plan = plan(&["a=1,2", "b=1..3:3"], &["c=uniform(0,1)"], Some(2), &[]).unwrap();
        assert_eq!(plan.total(), 12);
        let rows: Vec<Vec<f64>> = (0..12).map(|i| plan.values(i).iter().map(|q| q.0).collect()).collect();
        let grid: Vec<(f64, f64)> = rows.iter().step_by(2).map(|r| (r[0], r[1])).collect();
        assert_eq!(grid, [(1.0, 1.0), (1.0, 2.0), (1.0, 3.0), (2.0, 1.0), (2.0, 2.0), (2.0, 3.0)]);
        assert!(rows.iter().all(|r| (0.0..1.0).contains(&r[2])));
        assert!((1..12).all(|i| rows[i][2] != rows[i - 1][2]));
    }

    #[test]
    fn what_is_given_twice_is_refused() {
        assert!(plan(&["a=1,2", "a=3"], &[], None, &[]).is_err());
        assert!(plan(&["a=1,2"], &["a=uniform(0,1)"], Some(1), &[]).is_err());
        assert!(plan(&["a=1,2"], &[], None, &["a"]).is_err());
        assert!(plan(&["a=1..2:1000000", "b=1..2:1000000"], &[], None, &[]).is_err());
        assert!(plan(&["a=1..2:1000000000", "b=1..2:1000000000", "c=1..2:1000"], &[], None, &[]).is_err());
        assert!(plan(&["a=1..2:1000000000"], &[], None, &["b"]).is_ok());
    }
}
