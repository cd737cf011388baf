//! Whether a run did what its model expects.

use crate::summary::short;
use bond::{PortPassivity, Summary};
use bond_compiler::elaborate::told;
use bond_runtime::scene::{ExpectationKind, Scene};
use bond_runtime::{Interpreter, Kernel};

/// How an expectation came out, and what was measured.
pub enum Outcome {
    /// It held.
    Held(String),
    /// It did not.
    Broken(String),
}

/// What is kept of the rows for each expectation.
struct Seen {
    /// The value at the instant it is expected at.
    value: Option<f64>,
    /// The extremes so far.
    extremes: Vec<f64>,
    /// The first row at which the condition did not hold.
    broken: Option<f64>,
    rows: u64,
}

/// Watches the rows of a run.
pub struct Watch<'a> {
    scene: &'a Scene,
    stop: f64,
    seen: Vec<Seen>,
}

impl<'a> Watch<'a> {
    /// Nothing is seen yet.
    pub fn new(scene: &'a Scene, stop: f64) -> Self {
        let seen = scene
            .probes
            .expectations
            .iter()
            .map(|x| {
                let extremes = match &x.kind {
                    ExpectationKind::Holds { extremes, .. } => {
                        extremes.iter().map(|e| if e.1 { f64::NEG_INFINITY } else { f64::INFINITY }).collect()
                    }
                    ExpectationKind::Passive | ExpectationKind::PassiveAt(_) | ExpectationKind::At { .. } => vec![],
                };
                Seen { value: None, extremes, broken: None, rows: 0 }
            })
            .collect();
        Self { scene, stop, seen }
    }

    /// Takes a row: the outputs of the program of the probes.
    pub fn row(&mut self, t: f64, values: &[f64]) {
        let value = |output: usize| values.get(output).copied().unwrap_or(f64::NAN);
        for (x, seen) in self.scene.probes.expectations.iter().zip(&mut self.seen) {
            seen.rows += 1;
            match &x.kind {
                ExpectationKind::Passive | ExpectationKind::PassiveAt(_) => {}
                ExpectationKind::At { output, time, .. } => {
                    if (t - time).abs() <= 1e-12 * time.abs() {
                        seen.value = Some(value(*output));
                    }
                }
                ExpectationKind::Holds { extremes, output, .. } => {
                    for ((output, largest), extreme) in extremes.iter().zip(&mut seen.extremes) {
                        let v = value(*output);
                        // Values that are not numbers are kept.
                        if v.is_nan() || (!extreme.is_nan() && if *largest { v > *extreme } else { v < *extreme }) {
                            *extreme = v;
                        }
                    }
                    let holds = value(*output);
                    if extremes.is_empty() && seen.broken.is_none() && (holds == 0.0 || holds.is_nan()) {
                        seen.broken = Some(t);
                    }
                }
            }
        }
    }

    /// How all of them came out.
    pub fn outcomes(&self, summary: &Summary, failure: Option<&str>) -> Vec<Outcome> {
        self.scene
            .probes
            .expectations
            .iter()
            .zip(&self.seen)
            .map(|(x, seen)| self.outcome(&x.kind, seen, summary, failure))
            .collect()
    }

    fn outcome(&self, kind: &ExpectationKind, seen: &Seen, summary: &Summary, failure: Option<&str>) -> Outcome {
        // A value that was reached counts, whatever failed later.
        if let (ExpectationKind::At { target, tolerance, .. }, Some(value)) = (kind, seen.value) {
            let off = (value - target).abs();
            let what = format!("measured {value}, deviation {}", short(off));
            return if off <= *tolerance { Outcome::Held(what) } else { Outcome::Broken(what) };
        }
        if let Some(why) = failure {
            return Outcome::Broken(why.to_string());
        }
        match kind {
            ExpectationKind::Passive if summary.passive => Outcome::Held(String::new()),
            ExpectationKind::Passive => Outcome::Broken(summary.reasons.join("; ")),
            ExpectationKind::PassiveAt(i) => summary.watched.get(*i).map_or_else(unseen, drawn),
            ExpectationKind::At { time, .. } => {
                Outcome::Broken(format!("the run ends at {} s, before {} s", short(self.stop), short(*time)))
            }
            ExpectationKind::Holds { extremes, .. } if extremes.is_empty() => match seen.broken {
                None => Outcome::Held(format!("at {} rows", seen.rows)),
                Some(t) => Outcome::Broken(format!("not at t = {} s", told(t))),
            },
            ExpectationKind::Holds { extremes, program, .. } => {
                let measured: Vec<String> = extremes
                    .iter()
                    .zip(&seen.extremes)
                    .map(|(e, x)| format!("{} {}", if e.1 { "max" } else { "min" }, short(*x)))
                    .collect();
                let measured = format!("measured {}", measured.join(", "));
                let Some(program) = program else {
                    return Outcome::Broken("a condition cannot have both extremes over the run and signals".into());
                };
                let kernel = Interpreter::new(program);
                let mut work = kernel.workspace();
                let good = kernel.run(&[], &seen.extremes, &[], &mut work).is_ok()
                    && work.output.first().is_some_and(|x| *x != 0.0 && !x.is_nan())
                    && !seen.extremes.iter().any(|x| x.is_nan());
                if good { Outcome::Held(measured) } else { Outcome::Broken(measured) }
            }
        }
    }
}

/// Whether what was drawn at a place was there.
fn drawn(at: &PortPassivity) -> Outcome {
    let (drawn, stored) = (short(at.drawn), short(at.stored));
    match at.broken {
        None => {
            Outcome::Held(format!("at most {drawn} J drawn beyond what was put in, and {stored} J stored at the start"))
        }
        Some((first, worst)) => Outcome::Broken(format!(
            "{drawn} J were drawn beyond what was put in, and {stored} J stored at the start: {} J too much at t = {} s, \
            the first of it at t = {} s",
            short(at.drawn - at.stored),
            short(worst),
            short(first)
        )),
    }
}

fn unseen() -> Outcome {
    Outcome::Broken("it was not looked at".into())
}
