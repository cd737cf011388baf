//! Two causes that cannot both be, and the chains of bonds that carried them together.

use super::Cause;
use super::assignment::Assignment;
use crate::model::{BondId, ElementId, Kind, Variable};
use bond_grammar::diagnostic::Diagnostic;

const NO_EFFORT: &str = "gets no effort: every bond of it brings a flow";
const NO_FLOW: &str = "gets no flow: every bond of it brings an effort";

/// Bonds along which a stroke came, nearest first, and what began it.
type Chain = (Vec<BondId>, Cause);

/// Where two causes met, each with the bonds that carried it there, nearest first.
pub(super) struct Conflict {
    place: Option<ElementId>,
    chains: Vec<Chain>,
    met: Option<BondId>,
    what: &'static str,
}

impl Conflict {
    /// A bond that has a stroke and is asked for the other.
    pub(super) fn new(a: &Assignment, bond: BondId, cause: Cause) -> Self {
        let place = ruled(cause).or_else(|| ruled(a.causes[bond.at()]));
        let mut first = chain(a, bond);
        let mut second = (vec![bond], cause);
        if let Cause::Rule(_, from) = cause {
            let rest = chain(a, from);
            second.0.extend(rest.0);
            second.1 = rest.1;
        }
        let kind = place.map(|p| a.model.element(p).kind);
        let what = match (place.zip(kind.and_then(Kind::common)), kind) {
            // What meets at a junction is asked to give it the common variable once more, or the other one, so that
            // nothing is left that gives the common one.
            (Some((p, common)), Some(kind)) => {
                let brings = a.gives(bond, p) == Some(common.other());
                let lacks = if ruled(cause).is_some() { !brings } else { brings };
                if lacks {
                    return Self::lacking(a, (p, kind), (bond, second));
                }
                twice(kind)
            }
            _ => "is asked for both causalities",
        };
        first.0.truncate(64);
        second.0.truncate(64);
        Self { place, chains: vec![first, second], met: Some(bond), what }
    }

    /// A junction that a bond was to give its common variable, and is asked for the other one.
    fn lacking(a: &Assignment, (junction, kind): (ElementId, Kind), (bond, asked): (BondId, Chain)) -> Self {
        let others = a.graph.bonds_of[junction.at()].iter().filter(|b| **b != bond).take(7);
        let chains = others.map(|b| chain(a, *b)).chain([asked]).collect();
        Self { place: Some(junction), chains, met: Some(bond), what: none(kind) }
    }

    /// A junction that gets its common variable twice.
    pub(super) fn two_givers(a: &Assignment, junction: ElementId, _: BondId) -> Self {
        let kind = a.model.element(junction).kind;
        let wanted = kind.common().map(Variable::other);
        let mut chains = Vec::new();
        for b in a.graph.bonds_of[junction.at()].iter().filter(|b| a.gives(**b, junction) == wanted) {
            chains.push(chain(a, *b));
        }
        Self { place: Some(junction), chains, met: None, what: twice(kind) }
    }

    /// A junction all of whose bonds take and none gives.
    pub(super) fn no_giver(a: &Assignment, junction: ElementId, _: BondId) -> Self {
        let chains = a.graph.bonds_of[junction.at()].iter().take(8).map(|b| chain(a, *b)).collect();
        Self { place: Some(junction), chains, met: None, what: none(a.model.element(junction).kind) }
    }

    /// What began it, sorted: two conflicts of the same causes are one.
    pub(super) fn causes(&self) -> Vec<String> {
        let mut list: Vec<String> = self.chains.iter().map(|c| format!("{:?}", c.1)).collect();
        list.sort();
        list
    }

    /// The mend of a junction that lacks its common variable.
    fn giver(&self, a: &Assignment) -> String {
        let (what, such) = if self.what == NO_EFFORT { ("effort", "a C or an R") } else { ("flow", "an I or an R") };
        let bond = format!("bond something that gives {what} to it, such as {such}");
        let asserted = self.chains.iter().find(|c| c.1 == Cause::Asserted).and_then(|c| c.0.last());
        match asserted.map(|b| &a.model.bond(*b).name) {
            Some(name) => format!("remove the stroke of the bond {name}, `->`, or {bond}"),
            None => format!("the graph is not determined: {bond}"),
        }
    }

    /// In words.
    pub(super) fn diagnose(&self, a: &Assignment) -> Diagnostic {
        let model = a.model;
        let origin = |cause: &Cause, bonds: &[BondId]| -> (String, Option<ElementId>) {
            match cause {
                Cause::Source(e) | Cause::Law(e) | Cause::Storage(e) => {
                    (format!("`{}`", model.element(*e).name), Some(*e))
                }
                Cause::Asserted => {
                    let of = bonds.last().map(|b| format!(" of the bond {}", model.bond(*b).name)).unwrap_or_default();
                    (format!("the asserted stroke{of}"), None)
                }
                Cause::Hold => ("a double bar".into(), None),
                Cause::Free | Cause::Rule(..) => {
                    (bonds.last().map(|b| format!("the bond {}", model.bond(*b).name)).unwrap_or_default(), None)
                }
            }
        };
        let first = self.chains.first();
        let span = self
            .place
            .map(|p| model.element(p).span)
            .or_else(|| first.and_then(|c| c.0.first()).map(|b| model.bond(*b).span))
            .unwrap_or(model.span);
        let who = match self.place {
            Some(p) => format!("`{}`", model.element(p).name),
            None => {
                first.and_then(|c| c.0.first()).map(|b| format!("the bond {}", model.bond(*b).name)).unwrap_or_default()
            }
        };
        let from: Vec<String> = self.chains.iter().map(|(bonds, cause)| origin(cause, bonds).0).collect();
        let mut d = Diagnostic::error(
            "causality::conflict",
            span,
            format!("causal conflict: {who} {}, from {}", self.what, from.join(" and from ")),
        );
        for (bonds, cause) in &self.chains {
            let (name, element) = origin(cause, bonds);
            if let Some(e) = element {
                d = d.label(model.element(e).span, "is one cause");
            }
            // The bond where they met says nothing of the way there.
            let way = if bonds.len() > 1 && Some(&bonds[0]) == self.met.as_ref() { &bonds[1..] } else { &bonds[..] };
            for b in way.iter().rev() {
                d = d.label(model.bond(*b).span, format!("carries what {name} gives, along {}", model.bond(*b).name));
            }
        }
        if self.what == NO_EFFORT || self.what == NO_FLOW {
            return d.help(self.giver(a));
        }
        d.help(match self.place.map(|p| model.element(p).kind) {
            Some(Kind::ZERO) => {
                "take one of them out, or put a 1-junction with an R, or a C, between them: efforts add up there"
            }
            Some(Kind::ONE) => {
                "take one of them out, or put a 0-junction with an R, or an I, between them: flows add up there"
            }
            _ if self.chains.iter().any(|(_, cause)| matches!(cause, Cause::Asserted)) => {
                "reverse the asserted stroke, `->|` or `|->`, or remove it: the elements at the bond determine it \
                already"
            }
            _ => "take one of them out, or put an R between them",
        })
    }
}

/// What a junction says that gets its common variable twice.
fn twice(kind: Kind) -> &'static str {
    if kind == Kind::ZERO { "gets two efforts" } else { "gets two flows" }
}

/// What a junction says that nothing gives its common variable.
fn none(kind: Kind) -> &'static str {
    if kind == Kind::ZERO { NO_EFFORT } else { NO_FLOW }
}

/// The element by whose rule a bond has its stroke.
fn ruled(cause: Cause) -> Option<ElementId> {
    match cause {
        Cause::Rule(element, _) => Some(element),
        Cause::Source(_) | Cause::Asserted | Cause::Law(_) | Cause::Hold | Cause::Storage(_) | Cause::Free => None,
    }
}

/// The bonds along which the stroke of a bond came, nearest first, and what began it.
fn chain(a: &Assignment, bond: BondId) -> Chain {
    let (mut bonds, mut at) = (vec![bond], bond);
    loop {
        match a.causes[at.at()] {
            Cause::Rule(_, from) if bonds.len() < 64 => {
                bonds.push(from);
                at = from;
            }
            cause => return (bonds, cause),
        }
    }
}
