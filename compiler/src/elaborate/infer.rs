//! Unit inference. Each domain of the graph (bonds joined by junctions) has two unknown units, effort and flow; every
//! expression's unit is a product of powers of them and of a known dimension. Equating two units is a linear equation
//! in the exponents, so that all of them are one linear system, solved by elimination as the equations come.

use super::angle::{Angles, Declared};
use super::domain::{self, Names};
use super::equation::{self, Equation, System, Unit, Unknown};
use crate::units::{self, Dimension, DisplayUnit};
use bond_grammar::diagnostic::Diagnostic;
use bond_grammar::source::Span;
use rustc_hash::FxHashSet;

/// Effort and flow units that belong together although their product is no power.
fn is_pseudo_pair(e: Dimension, f: Dimension) -> bool {
    use Dimension as D;
    let kelvin = D::KELVIN;
    let flow_of_mass = D::KILOGRAM.div(D::SECOND);
    let volume_flow = D::METRE.pow(3, 1).div(D::SECOND);
    [
        (kelvin, D::WATT),                                         // heat
        (D::PASCAL, flow_of_mass),                                 // hydraulics by mass
        (D::METRE, volume_flow),                                   // hydraulics by head
        (D::MOLE.div(D::METRE.pow(3, 1)), D::MOLE.div(D::SECOND)), // diffusion
    ]
    .contains(&(e, f))
}

/// The units of a whole model.
pub struct Inference {
    equations: Vec<Equation>,
    domains: u32,
    /// Equations that are looked at to find the ones that mislead.
    work: usize,
}

/// What inference found.
pub struct Units {
    /// The solved system.
    pub system: System,
    /// For each domain, whether it is a pseudo bond graph.
    pub pseudo: Vec<bool>,
    angles: Angles,
}

impl Units {
    /// How a unit is shown, where it is determined.
    pub fn display(&self, unit: &Unit) -> Option<DisplayUnit> {
        self.angles.display(&self.system, unit)
    }
}

impl Inference {
    /// For a number of domains.
    pub fn new(domains: usize, work: usize) -> Self {
        Self { equations: Vec::new(), domains: domains as u32, work }
    }

    /// Asks for two units to be the same.
    pub fn equate(&mut self, equation: Equation) {
        self.equations.push(equation);
    }

    /// Solves; contradictions become diagnostics at the place of the equation that did not fit any more.
    pub fn solve(mut self, declared: Vec<Declared>, errors: &mut Vec<Diagnostic>, names: &Names<'_>) -> Units {
        self.equations.sort_by_key(|e| e.rank);
        let Belief { system, pseudo, mixed, off, .. } = self.weigh();
        let angles = Angles::solve(self.domains as usize, &system, &self.equations, declared);
        for e in off.iter().filter_map(|i| self.equations.get(*i)) {
            let name = |u: &Unit| system.known(u).map(|d| d.to_string());
            let found = match angles.display(&system, &e.found.0) {
                Some(u) if u.dimension.is_one() => "a bare number, without a unit".to_string(),
                Some(u) => format!("in {}", u.written(units::of_number((names.text)(e.found.1)))),
                None => "of another unit".to_string(),
            };
            let needed = match angles.display(&system, &e.needed.0) {
                Some(u) if u.dimension.is_one() => "a bare number without a unit".to_string(),
                // How often a second something comes.
                Some(u) if u.dimension == Dimension::HERTZ && e.about == "the rate" => "Hz".to_string(),
                Some(u) => u.to_string(),
                None => "another unit".to_string(),
            };
            let value = match name(&e.needed.0) {
                Some(u) if u == "1" => needed.clone(),
                Some(_) | None => format!("the value in {needed}"),
            };
            let within = match &e.calls {
                Some(call) => format!(" in `{}`", (names.function)(call.function)),
                None => String::new(),
            };
            let mut error = Diagnostic::error(
                "units::mismatch",
                e.found.1,
                format!("wrong unit: {}{within} is {found} where {needed} is needed", e.about),
            )
            .here(format!("this is {found}"));
            for call in equation::calls(&e.calls) {
                error = error.label(call.span, format!("`{}` is called here", (names.function)(call.function)));
            }
            error = names.and_given(error, e);
            if let Some(span) = e.needed.1 {
                error = error.label(span, format!("this asks for {needed}"));
            }
            let turned = name(&e.found.0.mul(&e.needed.0)).is_some_and(|u| u == "1");
            let other = reciprocal(&e.about, (names.text)(e.found.1).trim())
                .filter(|_| turned && name(&e.found.0).is_some_and(|u| u != "1"));
            let bare = name(&e.found.0).is_some_and(|u| u == "1");
            // Where the unit is known apart from those of the bonds, they have no part in it.
            let bonded = !matches!(&e.needed.0, Unit::Form(_, terms, _) if terms.is_empty());
            let source = self.equations.iter().find(|o| {
                bare && bonded
                    && o.about != e.about
                    && (o.about.starts_with("the effort of") || o.about.starts_with("the flow of"))
                    && name(&o.found.0).is_some_and(|u| u == "1")
            });
            // Where a value was given, that is what has to change.
            let place = error.labels.first().map_or(e.found.1, |l| l.span);
            let text = (names.text)(place).trim();
            let number = Some(text).filter(|text| bare && text.parse::<f64>().is_ok());
            let joined = domain::joined(e, &system, names);
            let entropy = domain::entropy(&self.equations, e, &system, names);
            let help = match name(&e.found.0.div(&e.needed.0)) {
                _ if entropy.is_some() => entropy.unwrap_or_default(),
                _ if other.is_some() && joined.is_none() => format!("{}; or give {value}", other.unwrap_or_default()),
                Some(off) if off == "s" && e.about.starts_with("the argument of `") => "time is in seconds: give the \
                    frequency its unit, as in `sin(2*pi*50 Hz*t)`, or divide by a time, as in `exp(-t/(2 s))`"
                    .to_string(),
                Some(_) if bare && first_factor(text).is_some() => {
                    let (number, rest) = first_factor(text).unwrap_or_default();
                    format!("give its number a unit: write `{number} {needed}{rest}`")
                }
                _ if source.is_some() => {
                    let what = source.map(|o| o.about.as_str()).unwrap_or_default();
                    format!(
                        "{what} is a bare number too, so its bonds have no physical units: give both units, as in `= \
                        1 N` and `= 1 kg`"
                    )
                }
                Some(_) if joined.is_some() => joined.unwrap_or_default(),
                Some(_) if e.about.starts_with("the ratio of") => format!(
                    "the ratio of a TF is an effort over an effort, that of a GY an effort over a flow, as a motor's constant is: \
                     take the other, or give {value}"
                ),
                Some(_) if number.is_some() => {
                    format!("give it a unit: write `{} {needed}`", number.unwrap_or_default())
                }
                Some(off) => {
                    format!("the unit is off by a factor of {off}: give {value}, or correct the expression")
                }
                None => format!("give {value}"),
            };
            let error = error.help(match (names.misread)(e, system.known(&e.found.0.div(&e.needed.0))) {
                Some(misread) => format!("{misread}; else {help}"),
                None => help,
            });
            // Effort and flow of a ratio say the same.
            if errors.last() != Some(&error) {
                errors.push(error);
            }
        }
        mixed.tell(&self.equations, errors, names);
        Units { system, pseudo, angles }
    }

    /// Believes the equations in an order that leaves the fewest that do not fit, and of such orders one in which the
    /// domains have units of physics: a wrong unit that stands first would make all that is right look wrong. Only an
    /// equation that told something can mislead, and so each of those is tried at the end.
    fn weigh(&mut self) -> Belief {
        let mut belief = self.believe();
        let mut trials = self.work / self.equations.len().max(1);
        while !belief.off.is_empty() {
            let suspects = self.suspects(&belief);
            trials = trials.saturating_sub(suspects.len());
            if trials == 0 {
                break;
            }
            let doubts = suspects.into_iter().map(|suspect| self.doubting(suspect)).chain([self.doubting_bare()]);
            let others = doubts.map(|last| (last.believe(), last));
            let best = others.min_by_key(|(other, last)| last.cost(other));
            let Some((other, last)) = best.filter(|(other, last)| last.cost(other) < self.cost(&belief)) else { break };
            (*self, belief) = (last, other);
        }
        belief
    }

    /// The equations that told units of a domain in which one does not fit.
    fn suspects(&self, belief: &Belief) -> Vec<usize> {
        let domains = |i: usize| {
            let e = self.equations.get(i);
            let units = e.into_iter().flat_map(|e| [&e.found.0, &e.needed.0]);
            let terms = units.flat_map(|u| match u {
                Unit::Form(_, terms, _) => terms.as_slice(),
                Unit::Any => &[],
            });
            terms.map(|t| t.0).filter(|v| v.0 < 1 << 31).map(|v| v.0 / 2)
        };
        let odd: FxHashSet<u32> = belief.off.iter().flat_map(|i| domains(*i)).collect();
        belief.told.iter().copied().filter(|i| domains(*i).any(|d| odd.contains(&d))).collect()
    }

    /// How much speaks against it: whether a unit that is written is wrong because of units with broken powers, as of
    /// resistances without one, then how many places of the text would have to be mended, then how many domains have a
    /// pair of units that no physics has.
    fn cost(&self, belief: &Belief) -> (bool, usize, usize) {
        let off = || belief.off.iter().copied().chain(belief.mixed.members()).filter_map(|i| self.equations.get(i));
        let places: FxHashSet<Span> = off().map(|e| e.found.1).collect();
        let broken = belief.broken && off().any(|e| !e.is_bare());
        (broken, places.len(), belief.strange)
    }

    /// The same with one equation, and all of the same place, believed last.
    fn doubting(&self, suspect: usize) -> Inference {
        let doubted = self.equations.get(suspect).map(|e| e.found.1);
        self.believing_last(|e| Some(e.found.1) == doubted)
    }

    /// The same with what elements are given without a unit believed last: of several, each says what the others do.
    fn doubting_bare(&self) -> Inference {
        self.believing_last(|e| e.owner.is_some() && e.is_bare())
    }

    fn believing_last(&self, doubted: impl Fn(&Equation) -> bool) -> Inference {
        let (last, mut equations): (Vec<Equation>, Vec<Equation>) =
            self.equations.iter().cloned().partition(|e| doubted(e));
        equations.extend(last);
        Inference { equations, ..*self }
    }

    /// What follows where the equations are believed one after the other.
    fn believe(&self) -> Belief {
        // What do the elements say by themselves? Only then is a pair of units taken for a pseudo bond.
        let mut free = System::default();
        for e in &self.equations {
            free.require_one(&e.found.0.div(&e.needed.0));
        }
        let mut system = System::default();
        let mut pseudo = Vec::new();
        for d in 0..self.domains as usize {
            let (e, f) = (Unit::effort(d), Unit::flow(d));
            let odd = match (free.known(&e), free.known(&f)) {
                (Some(e), Some(f)) => is_pseudo_pair(e, f),
                _ => false,
            };
            pseudo.push(odd);
            if !odd {
                system.require_one(&e.mul(&f).div(&Unit::known(Dimension::WATT)));
            }
        }
        let mut mixed = domain::Mixed::default();
        let (mut told, mut off) = (Vec::new(), Vec::new());
        for (i, e) in self.equations.iter().enumerate() {
            let solved = system.solved();
            if system.require_one(&e.found.0.div(&e.needed.0)) {
                if system.solved() > solved {
                    told.push(i);
                }
            } else if !mixed.takes(&self.equations, i, &system) {
                off.push(i);
            }
        }
        let strange = (0..self.domains as usize)
            .filter(|d| match (system.known(&Unit::effort(*d)), system.known(&Unit::flow(*d))) {
                (Some(e), Some(f)) => !domain::is_physical(e, f),
                _ => false,
            })
            .count();
        let broken = (0..2 * self.domains).any(|v| {
            let unit = system.known(&Unit::unknown(Unknown(v)));
            unit.is_some_and(|d| d.whole().is_none())
        });
        Belief { system, pseudo, mixed, told, off, strange, broken }
    }
}

/// What follows from the equations in some order.
struct Belief {
    system: System,
    pseudo: Vec<bool>,
    mixed: domain::Mixed,
    /// The equations that told something.
    told: Vec<usize>,
    /// Those that did not fit, but for elements of another domain.
    off: Vec<usize>,
    /// How many domains have a pair of units that no physics has.
    strange: usize,
    /// Whether one has a unit with a power that is no whole number.
    broken: bool,
}

/// The number that a product begins with, and the rest from its operator on.
fn first_factor(text: &str) -> Option<(&str, &str)> {
    let end = text.find(|c: char| !c.is_ascii_digit() && c != '.')?;
    let (number, rest) = text.split_at(end);
    let mut depth = 0;
    let is_sum = |c: char| {
        depth += i32::from(c == '(') - i32::from(c == ')');
        depth == 0 && matches!(c, '+' | '-' | '<' | '>' | '=')
    };
    (rest.starts_with('*') && number.parse::<f64>().is_ok() && !rest.contains(is_sum)).then_some((number, rest))
}

/// What may have been meant where a value's unit is one over what it should be.
fn reciprocal(about: &str, text: &str) -> Option<String> {
    let list = [
        ("the compliance of", "if the stiffness is meant, write `C:NAME { stiffness = TEXT }`"),
        ("the stiffness of", "if the compliance is meant, write `C:NAME = TEXT`"),
        ("the resistance of", "if the conductance is meant, write `R:NAME { conductance = TEXT }`"),
        ("the conductance of", "if the resistance is meant, write `R:NAME = TEXT`"),
        ("the ratio of", "e_in = ratio e_out: if it runs the other way, write `1/(TEXT)`, or turn the half arrows"),
    ];
    let path = about.split('`').nth(1).unwrap_or_default();
    let name = path.rsplit('.').next().unwrap_or(path);
    // A state has a rate, too: "the rate of `z`".
    match about {
        "the rate" => Some(format!("if the period is meant, write `sampled every {text}`")),
        "the period" => Some(format!("if the rate is meant, write `sampled at {text}`")),
        _ => {
            let fix = list.into_iter().find(|(what, _)| about.starts_with(what)).map(|(_, fix)| fix)?;
            Some(fix.replace("NAME", name).replace("TEXT", text))
        }
    }
}
