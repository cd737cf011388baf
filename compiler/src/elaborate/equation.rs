//! Units as products of powers of unknown ones, equations between them, and the linear system that these make.

use crate::model::ElementId;
use crate::units::{Dimension, Reading};
use bond_grammar::source::Span;
use rustc_hash::FxHashMap;
use std::rc::Rc;

/// A rational exponent, den > 0, in lowest terms.
pub(super) type Ratio = (i32, i32);

fn reduce((n, d): Ratio) -> Ratio {
    fn gcd(a: i32, b: i32) -> i32 {
        if b == 0 { a.abs().max(1) } else { gcd(b, a % b) }
    }
    let g = gcd(n, d) * d.signum();
    (n / g, d / g)
}

pub(super) fn plus(a: Ratio, b: Ratio) -> Ratio {
    reduce((a.0.saturating_mul(b.1).saturating_add(b.0.saturating_mul(a.1)), a.1.saturating_mul(b.1)))
}

pub(super) fn times(a: Ratio, b: Ratio) -> Ratio {
    reduce((a.0.saturating_mul(b.0), a.1.saturating_mul(b.1)))
}

/// An unknown unit.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Unknown(pub u32);

impl Unknown {
    /// That of the effort of a domain.
    pub fn effort(domain: usize) -> Unknown {
        Unknown(2 * domain as u32)
    }

    /// That of the flow of a domain.
    pub fn flow(domain: usize) -> Unknown {
        Unknown(2 * domain as u32 + 1)
    }

    /// That of the signal with this number.
    pub fn signal(number: usize) -> Unknown {
        Unknown(1 << 31 | number as u32)
    }

    /// That of the parameter with this number.
    pub fn parameter(number: usize) -> Unknown {
        Unknown(3 << 30 | number as u32)
    }
}

/// How many radians an expression's unit counts beyond those of its unknowns. Only what is shown depends on it: no two
/// units differ by it.
#[derive(Clone, Debug)]
pub struct Angle {
    /// What is known.
    pub radians: Ratio,
    /// Powers of the units of parameters and signals whose dimension is known, but not what they say about angles.
    pub terms: Vec<(Unknown, Ratio)>,
    /// Whether a number is in it whose unit may be meant otherwise: 2 V*s for 2 V/(rad/s).
    pub vague: bool,
}

impl Angle {
    const NONE: Angle = Angle { radians: (0, 1), terms: Vec::new(), vague: false };
}

impl PartialEq for Angle {
    fn eq(&self, _: &Angle) -> bool {
        true
    }
}

/// The unit of an expression.
#[derive(Clone, Debug, PartialEq)]
pub enum Unit {
    /// The literal 0 has every unit.
    Any,
    /// A dimension times powers of unknowns.
    Form(Dimension, Vec<(Unknown, Ratio)>, Angle),
}

impl Unit {
    /// A known one.
    pub fn known(d: Dimension) -> Unit {
        Unit::Form(d, Vec::new(), Angle::NONE)
    }

    /// That of a number as it is written.
    pub fn literal(d: Dimension, reading: Reading) -> Unit {
        let angle = Angle { radians: (reading.radians, 1), vague: !reading.certain, ..Angle::NONE };
        Unit::Form(d, Vec::new(), angle)
    }

    /// The same unit, and this unknown in the place of what it says about angles.
    pub fn with_angle(self, v: Unknown) -> Unit {
        match self {
            Unit::Any => Unit::Any,
            Unit::Form(d, terms, _) => Unit::Form(d, terms, Angle { terms: vec![(v, (1, 1))], ..Angle::NONE }),
        }
    }

    /// A bare number.
    pub fn one() -> Unit {
        Unit::known(Dimension::DIMENSIONLESS)
    }

    /// An unknown.
    pub fn unknown(v: Unknown) -> Unit {
        Unit::Form(Dimension::DIMENSIONLESS, vec![(v, (1, 1))], Angle::NONE)
    }

    /// Effort of a domain.
    pub fn effort(domain: usize) -> Unit {
        Unit::unknown(Unknown::effort(domain))
    }

    /// Flow of a domain.
    pub fn flow(domain: usize) -> Unit {
        Unit::unknown(Unknown::flow(domain))
    }

    /// A unit of its own, that of the signal with this number, where what it starts with does not tell it.
    pub fn signal(number: usize) -> Unit {
        Unit::unknown(Unknown::signal(number))
    }

    /// The same of the parameter with this number: 0 has every unit, what stands for it has one.
    pub fn parameter(number: usize) -> Unit {
        Unit::unknown(Unknown::parameter(number))
    }

    /// Of two that must be the same, the one that says more: this one, unless only the other says how many radians it
    /// counts.
    pub fn or_clearer(&self, other: &Unit) -> Unit {
        match (self, other) {
            (Unit::Any, _) => other.clone(),
            (Unit::Form(_, _, one), Unit::Form(_, _, two)) if self == other && one.vague && !two.vague => other.clone(),
            (Unit::Form(..), _) => self.clone(),
        }
    }

    /// Whether it counts radians that are not known yet.
    pub fn has_open_angle(&self) -> bool {
        matches!(self, Unit::Form(_, _, angle) if !angle.terms.is_empty())
    }

    /// `self * other^n`
    pub fn times(&self, other: &Unit, n: Ratio) -> Unit {
        match (self, other) {
            (Unit::Any, _) | (_, Unit::Any) => Unit::Any,
            (Unit::Form(a, x, p), Unit::Form(b, y, q)) => {
                let with = |x: &[(Unknown, Ratio)], y: &[(Unknown, Ratio)]| {
                    let mut terms = x.to_vec();
                    y.iter().for_each(|&(v, c)| add_term(&mut terms, v, times(c, n)));
                    terms
                };
                let radians = plus(p.radians, times(q.radians, n));
                let angle = Angle { radians, terms: with(&p.terms, &q.terms), vague: p.vague || q.vague };
                Unit::Form(a.mul(b.pow(n.0, n.1)), with(x, y), angle)
            }
        }
    }

    /// `self * other`
    pub fn mul(&self, other: &Unit) -> Unit {
        self.times(other, (1, 1))
    }

    /// `self / other`
    pub fn div(&self, other: &Unit) -> Unit {
        self.times(other, (-1, 1))
    }

    /// `self^n`
    pub fn pow(&self, n: Ratio) -> Unit {
        match self {
            Unit::Any => Unit::Any,
            Unit::Form(..) => Unit::one().times(self, n),
        }
    }
}

pub(super) fn add_term(terms: &mut Vec<(Unknown, Ratio)>, v: Unknown, c: Ratio) {
    match terms.binary_search_by_key(&v, |t| t.0) {
        Ok(i) => {
            terms[i].1 = plus(terms[i].1, c);
            if terms[i].1.0 == 0 {
                terms.remove(i);
            }
        }
        Err(i) => {
            if c.0 != 0 {
                terms.insert(i, (v, c));
            }
        }
    }
}

/// Two units that must be the same, and where that was asked.
#[derive(Clone, Debug)]
pub struct Equation {
    /// What was found.
    pub found: (Unit, Span),
    /// What is needed.
    pub needed: (Unit, Option<Span>),
    /// What it is about: "resistance of `damper`".
    pub about: String,
    /// Equations of lower rank are believed first. Up to 2: what an element asks of its own value; 3: within an
    /// expression.
    pub rank: u8,
    /// The element whose law asks for it.
    pub owner: Option<ElementId>,
    /// The calls of functions in which it arose.
    pub calls: Calls,
}

impl Equation {
    /// Whether what was found is a number without a unit.
    pub(super) fn is_bare(&self) -> bool {
        self.found.0 == Unit::one()
    }
}

/// The solved part of the system.
#[derive(Default)]
pub struct System {
    /// unknown = dimension times powers of others
    rows: FxHashMap<Unknown, (Dimension, Vec<(Unknown, Ratio)>)>,
}

impl System {
    /// How many unknowns are solved.
    pub fn solved(&self) -> usize {
        self.rows.len()
    }

    /// Replaces all solved unknowns.
    pub fn reduce(&self, unit: &Unit) -> Unit {
        let Unit::Form(d, terms, angle) = unit else { return Unit::Any };
        let (mut d, mut terms) = (*d, terms.clone());
        while let Some(i) = terms.iter().position(|(v, _)| self.rows.contains_key(v)) {
            let (v, c) = terms.remove(i);
            let (dim, row) = &self.rows[&v];
            d = d.mul(dim.pow(c.0, c.1));
            for &(w, k) in row {
                add_term(&mut terms, w, times(k, c));
            }
        }
        Unit::Form(d, terms, angle.clone())
    }

    /// The dimension of a unit, where it is determined.
    pub fn known(&self, unit: &Unit) -> Option<Dimension> {
        match self.reduce(unit) {
            Unit::Form(d, terms, _) if terms.is_empty() => Some(d),
            Unit::Form(..) | Unit::Any => None,
        }
    }

    /// A unit with the unknowns that are not of interest replaced, as far as they are solved.
    pub fn reduce_others(&self, unit: &Unit, keep: &dyn Fn(Unknown) -> bool) -> Unit {
        let Unit::Form(d, terms, _) = unit else { return Unit::Any };
        let mut all = Unit::known(*d);
        for &(v, n) in terms {
            let one = Unit::unknown(v);
            all = all.times(&if keep(v) { one } else { self.reduce(&one) }, n);
        }
        all
    }

    /// Adds `unit = 1`; false where it contradicts what is known.
    pub fn require_one(&mut self, unit: &Unit) -> bool {
        let Unit::Form(d, mut terms, _) = self.reduce(unit) else { return true };
        let Some((v, c)) = terms.pop() else { return d.is_one() };
        // v^c * rest * d = 1, so v = (rest * d)^(-1/c)
        let k = reduce((-c.1, c.0));
        let row = terms.into_iter().map(|(w, x)| (w, times(x, k))).collect();
        self.rows.insert(v, (d.pow(k.0, k.1), row));
        true
    }
}

/// A call that is being worked out, and the one around it.
#[derive(Debug)]
pub struct Call {
    /// Which function.
    pub function: usize,
    /// Where it is called.
    pub span: Span,
    /// The call around it.
    pub outer: Calls,
}

/// The innermost of the calls that are open.
pub type Calls = Option<Rc<Call>>;

/// The open calls, from the inside out.
pub fn calls(calls: &Calls) -> impl Iterator<Item = &Call> {
    std::iter::successors(calls.as_deref(), |c| c.outer.as_deref())
}
