//! Domains of physics: pairs of units, and what is said where elements of two of them are bonded without a transducer.

use super::equation::{Equation, System, Unit, Unknown};
use crate::model::ElementId;
use crate::units::Dimension;
use bond_grammar::diagnostic::{Diagnostic, Label};
use bond_grammar::source::Span;

/// How elements and functions are called.
pub struct Names<'n> {
    /// Of an element.
    pub element: &'n dyn Fn(ElementId) -> &'n str,
    /// Of a function.
    pub function: &'n dyn Fn(usize) -> &'n str,
    /// The parameters that the values in an equation's expression come from, with the places of these values, the
    /// outermost first; and whether it is but the name of one.
    pub given: &'n dyn Fn(&Equation) -> (Given, bool),
    /// The text of a place.
    pub text: &'n dyn Fn(Span) -> &'n str,
    /// The mend for a name in an equation's expression that is read as a unit there, so that the whole is off by this.
    pub misread: &'n dyn Fn(&Equation, Option<Dimension>) -> Option<String>,
}

/// Parameters whose values were given somewhere, and where.
pub type Given = Vec<(String, Span)>;

/// An error of a value, first where it was given.
pub(super) fn at_its_origin(mut error: Diagnostic, given: Given) -> Diagnostic {
    let mut given = given.into_iter();
    let words = |name: &str| format!("`{name}` is given here");
    if let Some((name, span)) = given.next() {
        if let Some(first) = error.labels.first_mut().filter(|l| l.text.is_empty()) {
            first.text = "is used here".into();
        }
        error.labels.insert(0, Label { span, text: words(&name) });
    }
    given.fold(error, |error, (name, span)| error.label(span, words(&name)))
}

impl Names<'_> {
    /// The error, with the places where the values of what the equation reads were given: that of a value which is but
    /// a name first.
    pub(super) fn and_given(&self, error: Diagnostic, e: &Equation) -> Diagnostic {
        let (given, alone) = (self.given)(e);
        if alone {
            return at_its_origin(error, given);
        }
        given.into_iter().fold(error, |error, (name, span)| error.label(span, format!("`{name}` is given here")))
    }
}

/// A domain, by its units of effort and flow.
#[derive(Debug, PartialEq)]
struct Domain {
    /// "mechanical"
    name: &'static str,
    /// Its units in words, after a kind of it where the name has several.
    units: &'static str,
    effort: Dimension,
    flow: Dimension,
}

impl Domain {
    /// The units of effort and flow, without the kind before them.
    fn pair(&self) -> (&'static str, &'static str) {
        let pair = self.units.rsplit_once(": ").map_or(self.units, |(_, pair)| pair);
        pair.split_once(", ").unwrap_or((pair, pair))
    }

    fn effort_unit(&self) -> &'static str {
        self.pair().0
    }

    fn flow_unit(&self) -> &'static str {
        self.pair().1
    }
}

/// All of them. A pair that stands earlier is believed first, where a value fits several.
fn domains() -> [Domain; 11] {
    use Dimension as D;
    let one = |name, units, effort, flow| Domain { name, units, effort, flow };
    let per_second = D::SECOND.pow(-1, 1);
    let metre = D::METRE;
    let (volume, amount) = (metre.pow(3, 1), D::MOLE);
    let joule = D::WATT.mul(D::SECOND);
    let volt = D::WATT.div(D::AMPERE);
    let newton = joule.div(metre);
    [
        one("mechanical", "translation: N, m/s", newton, metre.mul(per_second)),
        one("mechanical", "rotation: N*m, rad/s", joule, per_second),
        one("electrical", "V, A", volt, D::AMPERE),
        one("hydraulic", "Pa, m^3/s", D::PASCAL, volume.mul(per_second)),
        one("thermal", "K, W/K", D::KELVIN, D::WATT.div(D::KELVIN)),
        one("thermal", "as a pseudo bond: K, W", D::KELVIN, D::WATT),
        one("chemical", "J/mol, mol/s", joule.div(amount), amount.mul(per_second)),
        one("magnetic", "A, Wb/s", D::AMPERE, volt),
        one("hydraulic", "by mass: Pa, kg/s", D::PASCAL, D::KILOGRAM.mul(per_second)),
        one("hydraulic", "by head: m, m^3/s", metre, volume.mul(per_second)),
        one("chemical", "by concentration: mol/m^3, mol/s", amount.div(volume), amount.mul(per_second)),
    ]
}

/// Whether a domain of physics has these units of effort and flow.
pub(super) fn is_physical(effort: Dimension, flow: Dimension) -> bool {
    domains().iter().any(|d| (d.effort, d.flow) == (effort, flow))
}

/// The domain of graph whose units alone an element's equation asks about.
fn only_domain(e: &Equation) -> Option<u32> {
    let terms = |unit: &Unit| match unit {
        Unit::Form(_, terms, _) => terms.iter().map(|t| t.0.0 / 2).collect::<Vec<u32>>(),
        Unit::Any => Vec::new(),
    };
    let needed = terms(&e.needed.0);
    let first = *needed.first()?;
    needed.iter().all(|d| *d == first).then_some(first)
}

/// The mend for an RS whose thermal port is bonded to elements of heat as a flow: the first equation is its own.
pub(super) fn entropy(all: &[Equation], e: &Equation, system: &System, names: &Names<'_>) -> Option<String> {
    let (_, rest) = e.about.split_once("the power of `")?;
    let (source, _) = rest.split_once("` on its two ports (the thermal one")?;
    let Unit::Form(_, terms, _) = &e.found.0 else { return None };
    let graph = terms.iter().find(|(_, (n, d))| (*n < 0) != (*d < 0)).map(|(v, _)| v.0 / 2)?;
    let pair = [Unit::effort(graph as usize), Unit::flow(graph as usize)].map(|unit| system.known(&unit));
    if pair != [Some(Dimension::KELVIN), Some(Dimension::WATT)] {
        return None;
    }
    let asks_flow = |e: &&Equation| {
        only_domain(e) == Some(graph)
            && matches!(&e.needed.0, Unit::Form(_, terms, _) if terms.iter().any(|t| t.0.0 % 2 == 1))
    };
    let mut told: Vec<String> = Vec::new();
    for owner in all.iter().filter(asks_flow).filter_map(|e| e.owner) {
        let name = format!("`{}`", (names.element)(owner));
        if !told.contains(&name) {
            told.push(name);
        }
    }
    Some(format!(
        "an RS gives entropy, at a true bond (K, W/K), and what it leads to ({}) is written for heat, as a pseudo bond (K, W): \
         give that for entropy, as J/K^2 and K^2/W, or make it `R:{source}` and lead its heat on by \
         `Sf:heat = {source}.e*{source}.f`",
        told.join(", ")
    ))
}

/// What a transformer or gyrator joins, and what ratio fits it, where the one that is given does not.
pub(super) fn joined(e: &Equation, system: &System, names: &Names<'_>) -> Option<String> {
    let name = e.about.strip_prefix("the ratio of `")?.strip_suffix('`')?;
    let Unit::Form(_, terms, _) = &e.needed.0 else { return None };
    let term = |sign: i32| terms.iter().find(|t| t.1 == (sign, 1)).map(|t| t.0.0);
    let (above, below) = (term(1)?, term(-1)?);
    // Efforts have even numbers: e_in/e_out and f_out/f_in of a TF, e_in/f_out and e_out/f_in of a GY.
    let kind = if above % 2 == below % 2 { "TF" } else { "GY" };
    let turned = if kind == "TF" { above % 2 == 1 } else { above > below };
    let (first, second) = if turned { (below / 2, above / 2) } else { (above / 2, below / 2) };
    let of = |graph: u32| {
        let side = |unit: Unit| system.known(&unit);
        let (effort, flow) = (side(Unit::effort(graph as usize))?, side(Unit::flow(graph as usize))?);
        domains().into_iter().find(|d| (d.effort, d.flow) == (effort, flow))
    };
    let (from, to) = (of(first)?, of(second)?);
    let unit = |kind: &str| match kind {
        "TF" => (quotient(from.effort_unit(), to.effort_unit()), from.effort.div(to.effort)),
        _ => (quotient(from.effort_unit(), to.flow_unit()), from.effort.div(to.flow)),
    };
    let joins = format!("`{name}` joins {} ({}) to {} ({})", from.name, from.units, to.name, to.units);
    let (fits, text, found) = (unit(kind), (names.text)(e.found.1), system.known(&e.found.0)?);
    let (other, article) =
        if kind == "TF" { ("GY", "an effort over an effort") } else { ("TF", "an effort over a flow") };
    let wanted = match fits.1.is_one() {
        true => "a bare number".to_string(),
        false => format!("in {}", fits.0),
    };
    let is = format!("{joins}; the ratio of a {kind} is {article}, here {wanted}");
    Some(if found == unit(other).1 && !found.is_one() {
        format!("{is}: what is given is the ratio of a {other}, so write `{other}:{name} = {text}`")
    } else if found.is_one() && text.trim().parse::<f64>().is_ok() {
        format!("{is}: write `{} {}`", text.trim(), fits.0)
    } else if found.mul(fits.1).is_one() {
        format!("{is}: e_in = ratio e_out, so for the other way write `1/({text})`, or turn the half arrows")
    } else {
        is
    })
}

/// One unit over another one, as it is written: `V/(N*m)`, `V*s`.
fn quotient(above: &'static str, below: &'static str) -> String {
    let longer = |long: &'static str, short: &str| long.strip_prefix(short)?.strip_prefix('*');
    match below.strip_suffix("/s") {
        None if let Some(rest) = longer(above, below) => rest.to_string(),
        None if let Some(rest) = longer(below, above) => format!("{rest}^-1"),
        Some("rad") => format!("{above}/(rad/s)"),
        Some(part) if let Some(rest) = above.strip_suffix(part).and_then(|rest| rest.strip_suffix('*')) => {
            format!("{rest}*s")
        }
        Some(part) => format!("{above}*s/{part}"),
        None if above == below => "1".to_string(),
        None if below.contains(['*', '/']) => format!("{above}/({below})"),
        None => format!("{above}/{below}"),
    }
}

/// The domains of physics that fit an element's equation by itself.
fn fitting(e: &Equation, graph: u32, system: &System) -> Vec<Domain> {
    let keep = |v: Unknown| v.0 / 2 == graph;
    let ratio = system.reduce_others(&e.found.0.div(&e.needed.0), &keep);
    let Unit::Form(d, terms, _) = ratio else { return Vec::new() };
    if !terms.iter().all(|t| keep(t.0)) {
        return Vec::new();
    }
    // Siemens are no magnetic resistance, but a conductance that was written for a resistance.
    let resistive = matches!(terms[..], [(_, (1, 1)), (_, (-1, 1))] | [(_, (-1, 1)), (_, (1, 1))]);
    let fits = |domain: &Domain| {
        if resistive && domain.name == "magnetic" {
            return false;
        }
        let value = |v: Unknown| if v.0.is_multiple_of(2) { domain.effort } else { domain.flow };
        terms.iter().fold(d, |d, (v, n)| d.mul(value(*v).pow(n.0, n.1))).is_one()
    };
    domains().into_iter().filter(fits).collect()
}

/// Elements of one domain of physics among those of another.
struct Group {
    graph: u32,
    /// What they are, and what they are bonded to.
    are: Domain,
    among: Domain,
    /// Their equations; the first one is where the error stands.
    members: Vec<usize>,
    /// An equation that says what the others are.
    witness: Option<usize>,
}

/// The groups that were found.
#[derive(Default)]
pub(super) struct Mixed {
    groups: Vec<Group>,
}

impl Mixed {
    /// Whether an equation that contradicts the others does so because its element is of another domain of physics;
    /// then it is kept for [`Mixed::tell`].
    pub(super) fn takes(&mut self, all: &[Equation], i: usize, system: &System) -> bool {
        self.group(all, i, system).is_some()
    }

    /// The equations that were kept.
    pub(super) fn members(&self) -> impl Iterator<Item = usize> {
        self.groups.iter().flat_map(|g| g.members.iter().copied())
    }

    fn group(&mut self, all: &[Equation], i: usize, system: &System) -> Option<()> {
        let e = all.get(i).filter(|e| e.rank <= 2 && e.calls.is_none())?;
        e.owner?;
        let graph = only_domain(e)?;
        let side = |unit: Unit| system.known(&unit);
        let effort = side(Unit::effort(graph as usize))?;
        let flow = side(Unit::flow(graph as usize))?;
        let among = domains().into_iter().find(|d| d.effort == effort && d.flow == flow)?;
        let mut fitting = fitting(e, graph, system);
        // Energies fit several domains. Swapped units are a mistake within the domain: a conductance for a resistance.
        if fitting.iter().any(|d| d.name != fitting[0].name) || fitting.is_empty() {
            return None;
        }
        let are = fitting.swap_remove(0);
        if are == among || (are.effort, are.flow) == (flow, effort) {
            return None;
        }
        let says = |e: &Equation| {
            e.rank <= 2
                && e.owner.is_some()
                && only_domain(e) == Some(graph)
                && self::fitting(e, graph, system).first() == Some(&among)
        };
        // An element that belongs there by another of its values has a wrong unit, as of where it starts.
        if all.iter().enumerate().any(|(j, other)| j != i && other.owner == e.owner && says(other)) {
            return None;
        }
        if let Some(group) = self.groups.iter_mut().find(|g| g.graph == graph && g.are == are) {
            if group.members.iter().all(|m| all.get(*m).map(|m| m.owner) != Some(e.owner)) {
                group.members.push(i);
            }
            return Some(());
        }
        let witness = all.iter().take(i).position(says);
        self.groups.push(Group { graph, are, among, members: vec![i], witness });
        Some(())
    }

    /// Says of each group that it needs a transducer.
    pub(super) fn tell(self, all: &[Equation], errors: &mut Vec<Diagnostic>, names: &Names<'_>) {
        for group in self.groups {
            let name = |i: usize| all.get(i).and_then(|e| e.owner).map_or("", |id| (names.element)(id));
            let listed: Vec<String> = group.members.iter().map(|m| format!("`{}`", name(*m))).collect();
            let Some((first, more)) = group.members.split_first() else { continue };
            let Some(place) = all.get(*first).map(|e| e.found.1) else { continue };
            let (who, are, is) = match listed.split_last() {
                Some((last, [])) => (last.clone(), "is", "is"),
                Some((last, others)) => (format!("{} and {last}", others.join(", ")), "are", "are"),
                None => continue,
            };
            let (these, those) = (&group.are, &group.among);
            let message = format!(
                "{who} {are} {} ({}), and {is} bonded to what is {} ({})",
                these.name, these.units, those.name, those.units
            );
            let mut error = Diagnostic::error("units::domain", place, message)
                .here(format!("this is {} ({})", these.name, these.units));
            if let Some(e) = all.get(*first) {
                error = names.and_given(error, e);
            }
            for m in more {
                if let Some(e) = all.get(*m) {
                    error = error.label(e.found.1, format!("so is `{}`", name(*m)));
                }
            }
            if let Some((w, e)) = group.witness.and_then(|w| Some((w, all.get(w)?))) {
                error = error.label(e.found.1, format!("`{}` is {} ({})", name(w), those.name, those.units));
            }
            errors.push(error.help(
                "join two domains by a transducer, a TF or a GY; within one domain, correct the \
            unit",
            ));
        }
    }
}
