//! How many radians units count, which no check asks about: a radian is 1. It follows from the same equations as the
//! units, where a torque is J/rad and its speed rad/s, and decides how units are shown.

use super::equation::{Equation, Ratio, System, Unit, Unknown, add_term, plus, times};
use crate::units::{Dimension, DisplayUnit, Reading};
use rustc_hash::FxHashMap;
use std::sync::Arc;

/// A parameter or signal whose unit is known, but for what it counts of angles.
pub struct Declared {
    /// The unknown that stands for that.
    pub unknown: Unknown,
    /// Its dimension.
    pub dimension: Dimension,
    /// What its unit says about it.
    pub reading: Reading,
    /// The unit in the words of the model, in SI.
    pub written: Option<Arc<str>>,
}

/// The radians that the units of a model count.
#[derive(Default)]
pub struct Angles {
    /// unknown = radians plus multiples of others
    rows: FxHashMap<Unknown, (Ratio, Vec<(Unknown, Ratio)>)>,
    declared: FxHashMap<Unknown, Declared>,
}

impl Angles {
    /// The domains first, then units that say how many radians they count, then the equations, in the order in which
    /// they are believed. One that does not fit says nothing: the arc of an angle is in m.
    pub fn solve(domains: usize, system: &System, equations: &[Equation], declared: Vec<Declared>) -> Angles {
        let mut angles = Angles::default();
        for d in 0..domains {
            let (effort, flow) = (Unit::effort(d), Unit::flow(d));
            let pair = (system.known(&effort), system.known(&flow));
            let radians = i32::from(pair == (Some(Dimension::JOULE), Some(Dimension::HERTZ)));
            angles.rows.insert(Unknown::effort(d), ((-radians, 1), Vec::new()));
            angles.rows.insert(Unknown::flow(d), ((radians, 1), Vec::new()));
        }
        for d in declared.iter().filter(|d| d.reading.certain) {
            angles.rows.insert(d.unknown, ((d.reading.radians, 1), Vec::new()));
        }
        for e in equations {
            // The argument of a sine is an angle or none; so is a ratio.
            let says = |unit: &Unit| matches!(unit, Unit::Form(_, _, angle) if !angle.vague);
            if e.needed.0 != Unit::one() && says(&e.found.0) && says(&e.needed.0) {
                angles.require_none(&e.found.0.div(&e.needed.0));
            }
        }
        angles.declared = declared.into_iter().map(|d| (d.unknown, d)).collect();
        angles
    }

    /// How a unit is shown.
    pub fn display(&self, system: &System, unit: &Unit) -> Option<DisplayUnit> {
        let dimension = system.known(unit)?;
        let (known, free) = self.reduce(unit);
        let of = |v: &Unknown| self.declared.get(v).map_or(0, |d| d.reading.radians);
        let radians = free.iter().fold(known, |sum, (v, n)| plus(sum, times((of(v), 1), *n)));
        // A speed per what may be a speed is a number, or an angle: less is said.
        let vague = !free.is_empty() || matches!(unit, Unit::Form(_, _, angle) if angle.vague);
        let radians = if vague && dimension.is_one() { (0, 1) } else { radians };
        let own = match unit {
            Unit::Form(_, terms, angle) if terms.is_empty() && !angle.vague && angle.radians.0 == 0 => {
                Some(&angle.terms[..])
            }
            Unit::Form(..) | Unit::Any => None,
        };
        let written = match own {
            Some([(v, (1, 1))]) => {
                self.declared.get(v).filter(|d| (d.dimension, (d.reading.radians, 1)) == (dimension, radians))
            }
            Some(_) | None => None,
        };
        Some(DisplayUnit::new(dimension, radians).written(written.and_then(|d| d.written.clone())))
    }

    /// The radians of a unit as far as they are known, and what the rest depends on.
    fn reduce(&self, unit: &Unit) -> (Ratio, Vec<(Unknown, Ratio)>) {
        let Unit::Form(_, units, angle) = unit else { return ((0, 1), Vec::new()) };
        let (mut radians, mut terms) = (angle.radians, angle.terms.clone());
        units.iter().for_each(|&(v, n)| add_term(&mut terms, v, n));
        while let Some(i) = terms.iter().position(|(v, _)| self.rows.contains_key(v)) {
            let (v, n) = terms.remove(i);
            let (known, row) = &self.rows[&v];
            radians = plus(radians, times(*known, n));
            row.iter().for_each(|&(w, k)| add_term(&mut terms, w, times(k, n)));
        }
        (radians, terms)
    }

    /// Has a unit count none, if it can.
    fn require_none(&mut self, unit: &Unit) {
        let (radians, mut terms) = self.reduce(unit);
        let Some((v, n)) = terms.pop() else { return };
        // n v + rest + radians = 0
        let by = times((-1, 1), if n.0 < 0 { (-n.1, -n.0) } else { (n.1, n.0) });
        let row = terms.into_iter().map(|(w, k)| (w, times(k, by))).collect();
        self.rows.insert(v, (times(radians, by), row));
    }
}
