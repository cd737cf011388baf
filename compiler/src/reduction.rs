//! What can be left out of a flat model, and the model without it.
//!
//! A part, that is a storage, a resistor or a multiport field, is left out with its bonds: at a 1-junction its effort
//! counts as 0 from then on, at a 0-junction its flow. The other elements, and with them the form, stay what they are.
//! Which parts matter is measured by their activity, the integral of |power| (Louca and Stein, *Energy-based model
//! reduction of linear systems*, 1999): `watch` lets a run tell their power.

use crate::elaborate::nearest;
use crate::expression::{Expr, Symbol};
use crate::model::{
    BondId, ElementId, Expectation, ExpectationKind, Kind, Law, Meeting, Model, Probe, Resistor, Signal, Variable,
};
use bond_grammar::diagnostic::Diagnostic;
use bond_grammar::source::Span;
use rustc_hash::{FxHashMap, FxHashSet};

/// What is left out as one.
#[derive(Clone, Debug, PartialEq)]
pub struct Part {
    /// Its path, `wall.spring`.
    pub name: String,
    /// `C`, `I`, `R`; of a field as it is written.
    pub kind: String,
    /// The element, or the ports of the field.
    pub members: Vec<ElementId>,
    /// Whether effort times flow is a power at each of its bonds.
    pub power: bool,
}

/// The storages, resistors and fields of a model, in order of declaration.
pub fn parts(model: &Model) -> Vec<Part> {
    let bonds = model.bonds_of();
    let power = |id: ElementId| bonds[id.at()].iter().all(|b| !model.pseudo[b.at()]);
    let mut list = Vec::new();
    for (id, e) in model.ids() {
        if e.added || e.line.is_some() {
            continue;
        }
        let (name, kind, members) = match (e.field, e.kind) {
            (Some((field, 0)), _) => {
                let f = &model.fields[field];
                (&f.name, f.kind.as_str(), f.members.clone())
            }
            (None, Kind::C) => (&e.name, "C", vec![id]),
            (None, Kind::I) => (&e.name, "I", vec![id]),
            (None, Kind::R) => (&e.name, "R", vec![id]),
            _ => continue,
        };
        let power = members.iter().all(|m| power(*m));
        list.push(Part { name: name.clone(), kind: kind.into(), members, power });
    }
    list
}

/// Adds a probe for the power into each part, in the order of [`parts`], after those of the model.
pub(crate) fn watch(model: &mut Model) {
    let bonds = model.bonds_of();
    let mut known: FxHashMap<Signal, Symbol> =
        model.signals.iter().map(|(symbol, signal)| (*signal, *symbol)).collect();
    for part in parts(model) {
        let mut total = model.pool.zero();
        for member in &part.members {
            for bond in &bonds[member.at()] {
                let inward = model.bond(*bond).head == *member;
                let mut read = |signal, variable: Variable| {
                    let symbol = *known.entry(signal).or_insert_with(|| {
                        model.pool.symbol(&format!("{}.{}", model.bonds[bond.at()].name, variable.letter()))
                    });
                    model.signals.insert(symbol, signal);
                    model.pool.var(symbol)
                };
                let (e, f) = (read(Signal::Effort(*bond), Variable::Effort), read(Signal::Flow(*bond), Variable::Flow));
                let power = model.pool.mul(e, f);
                total = if inward { model.pool.add(total, power) } else { model.pool.sub(total, power) };
            }
        }
        let span = model.element(part.members[0]).span;
        model.probes.push(Probe { name: format!("{}.P", part.name), value: total, unit: None, span });
    }
}

/// Why a part cannot be left out, whatever that came to: what reads it, or what it is bonded to.
pub fn kept(model: &Model, name: &str) -> Option<String> {
    let errors = leave_out(&mut model.clone(), &[name.to_string()]).err()?;
    let message = &errors.first()?.message;
    Some(message.split_once(": ").map_or(message.as_str(), |(_, why)| why).to_string())
}

/// Leaves parts out.
///
/// # Errors
/// A name that is no part's, what is not joined to a junction, what something reads.
pub(crate) fn leave_out(model: &mut Model, names: &[String]) -> Result<(), Vec<Diagnostic>> {
    let parts = parts(model);
    let by_name: FxHashMap<&str, &Part> = parts.iter().map(|p| (p.name.as_str(), p)).collect();
    let mut errors = Vec::new();
    let mut out = Removed {
        elements: vec![false; model.elements.len()],
        bonds: vec![false; model.bonds.len()],
        memories: vec![false; model.memories.len()],
        integrals: vec![false; model.integrals.len()],
        delays: vec![false; model.delays.len()],
    };
    let bonds = model.bonds_of();
    for name in names {
        let Some(part) = by_name.get(name.as_str()) else {
            errors.push(unknown(model, name, &parts));
            continue;
        };
        for member in &part.members {
            out.elements[member.at()] = true;
            for b in &bonds[member.at()] {
                out.bonds[b.at()] = true;
                let bond = model.bond(*b);
                let other = model.element(bond.other(*member));
                if bond.sampled || !other.kind.is_junction() {
                    let how = if bond.sampled { "by a double bar" } else { "itself, not to a junction" };
                    let message = format!("--without {name}: it is bonded to `{}` {how}", other.name);
                    errors.push(
                        Diagnostic::error("omit::bonded", model.element(*member).span, message)
                            .help("put a junction between them, or change the model"),
                    );
                }
            }
        }
    }
    if !errors.is_empty() {
        return Err(errors);
    }
    // A junction that has lost all its bonds joins nothing.
    for (id, _) in model.ids() {
        let own = &bonds[id.at()];
        if !own.is_empty() && own.iter().all(|b| out.bonds[b.at()]) {
            out.elements[id.at()] = true;
        }
    }
    out.keep_common(model, &bonds);
    errors = out.read(model);
    if errors.is_empty() {
        out.apply(model);
        Ok(())
    } else {
        Err(errors)
    }
}

fn unknown(model: &Model, name: &str, parts: &[Part]) -> Diagnostic {
    let error = |at: Span, message| Diagnostic::error("omit::unknown", at, message);
    if let Some(e) = model.elements.iter().find(|e| e.name == name) {
        return error(e.span, format!("--without {name}: `{name}` is no storage, resistor or field"))
            .help("these alone can be left out");
    }
    let error = error(model.span, format!("--without {name}: there is no element `{name}`"));
    match nearest(name, parts.iter().map(|p| p.name.as_str())) {
        Some(n) => error.help(format!("did you mean `{n}`?")),
        None => error.help("`bond reduce FILE --error 0.01` lists what can be left out"),
    }
}

/// What is out; of a bond that stays, both ends do.
pub(crate) struct Removed {
    pub(crate) elements: Vec<bool>,
    pub(crate) bonds: Vec<bool>,
    pub(crate) memories: Vec<bool>,
    pub(crate) integrals: Vec<bool>,
    pub(crate) delays: Vec<bool>,
}

impl Removed {
    /// Has what all bonds of a junction have in common read at one that stays, where it is only looked at: a law that
    /// reads a part may mean the part.
    fn keep_common(&self, model: &mut Model, bonds: &[Vec<BondId>]) {
        let (elements, all) = (&model.elements, &model.bonds);
        let laws = elements.iter().flat_map(|e| of_law(&e.law)).chain(model.memories.iter().map(|m| m.law));
        let laws = laws.chain(model.delays.iter().map(|d| d.signal));
        let read: FxHashSet<Symbol> = laws.flat_map(|e| model.pool.symbols(e)).collect();
        let other = |b: BondId, common: Variable| {
            let ends = [all[b.at()].tail, all[b.at()].head];
            let junction = ends
                .into_iter()
                .find(|id| elements[id.at()].kind == Kind::Junction(common) && !self.elements[id.at()])?;
            bonds[junction.at()].iter().copied().find(|b| !self.bonds[b.at()] && !all[b.at()].sampled)
        };
        for (_, signal) in model.signals.iter_mut().filter(|(symbol, _)| !read.contains(symbol)) {
            let kept = match *signal {
                Signal::Effort(b) if self.bonds[b.at()] => other(b, Variable::Effort).map(Signal::Effort),
                Signal::Flow(b) if self.bonds[b.at()] => other(b, Variable::Flow).map(Signal::Flow),
                _ => None,
            };
            *signal = kept.unwrap_or(*signal);
        }
    }

    /// What reads something that is out, each said once.
    fn read(&self, model: &Model) -> Vec<Diagnostic> {
        let mut gone: FxHashMap<Symbol, String> = FxHashMap::default();
        for (symbol, signal) in &model.signals {
            let element = |id: ElementId| self.elements[id.at()].then(|| model.element(id).name.clone());
            let bond = |b: BondId| {
                let b = self.bonds[b.at()].then(|| model.bond(b))?;
                element(b.tail).or_else(|| element(b.head))
            };
            let name = match *signal {
                Signal::Effort(b) | Signal::Flow(b) => bond(b),
                Signal::State(id) | Signal::Argument(id) | Signal::Parameter(id) => element(id),
                Signal::Time
                | Signal::Integral(_)
                | Signal::Input(_)
                | Signal::Slope(_)
                | Signal::Memory(_)
                | Signal::Delay(_) => None,
            };
            if let Some(name) = name {
                gone.insert(*symbol, name);
            }
        }
        let mut errors = Vec::new();
        let mut told = FxHashSet::default();
        for (reader, span, list) in self.readers(model) {
            let read = list.iter().flat_map(|e| model.pool.symbols(*e)).filter_map(|s| gone.get(&s)).min();
            if let Some(name) = read
                && told.insert(name)
            {
                errors.push(
                    Diagnostic::error("omit::read", span, format!("--without {name}: {reader} reads it"))
                        .help("keep it, or leave out what reads it too"),
                );
            }
        }
        errors
    }

    /// What stays and may read something: what it is, where it stands, its expressions.
    fn readers(&self, model: &Model) -> Vec<(String, Span, Vec<Expr>)> {
        let stays = model.ids().filter(|(id, _)| !self.elements[id.at()]);
        let mut list: Vec<(String, Span, Vec<Expr>)> =
            stays.map(|(_, e)| (format!("`{}`", e.name), e.span, of_law(&e.law))).collect();
        list.extend(model.memories.iter().map(|m| (format!("the state `{}`", m.name), m.span, vec![m.law])));
        list.extend(model.delays.iter().map(|d| ("a `delay`".into(), d.span, vec![d.signal])));
        list.extend(model.integrals.iter().map(|i| ("an `integral`".into(), i.span, vec![i.rate])));
        list.extend(model.probes.iter().map(|p| (format!("the probe `{}`", p.name), p.span, vec![p.value])));
        list.extend(model.expectations.iter().map(|e| ("an `expect`".into(), e.span, of_expectation(e))));
        list
    }

    /// Takes it out of a model in which nothing that stays reads it.
    pub(crate) fn apply(&self, model: &mut Model) {
        let (elements, bonds) = (numbers(&self.elements), numbers(&self.bonds));
        let [memories, integrals, delays] = [&self.memories, &self.integrals, &self.delays].map(|out| numbers(out));
        let element = |id: ElementId| elements[id.at()].map(ElementId);
        let bond = |id: BondId| bonds[id.at()].map(BondId);
        // A field goes as a whole.
        let fields = numbers(
            &model.fields.iter().map(|f| f.members.iter().any(|m| self.elements[m.at()])).collect::<Vec<bool>>(),
        );
        retain(&mut model.elements, &self.elements);
        for e in &mut model.elements {
            e.field = e.field.and_then(|(f, port)| Some((fields[f]? as usize, port)));
        }
        model.fields.retain_mut(|f| {
            f.members = f.members.iter().filter_map(|m| element(*m)).collect();
            !f.members.is_empty()
        });
        let gone: Vec<bool> = model.lines.iter().map(|l| l.ends.iter().any(|e| self.elements[e.at()])).collect();
        let lines = numbers(&gone);
        retain(&mut model.lines, &gone);
        model.lines.iter_mut().flat_map(|l| &mut l.ends).for_each(|e| *e = element(*e).unwrap_or(*e));
        model.elements.iter_mut().for_each(|e| e.line = e.line.and_then(|l| lines[l]).map(|l| l as usize));
        retain(&mut model.bonds, &self.bonds);
        for b in &mut model.bonds {
            b.tail = element(b.tail).unwrap_or(b.tail);
            b.head = element(b.head).unwrap_or(b.head);
        }
        retain(&mut model.units, &self.bonds);
        retain(&mut model.pseudo, &self.bonds);
        retain(&mut model.memories, &self.memories);
        retain(&mut model.integrals, &self.integrals);
        retain(&mut model.delays, &self.delays);
        // What nothing drives any more is not looked at.
        model.expectations.retain_mut(|e| {
            let ExpectationKind::PassiveAt(at) = &mut e.kind else { return true };
            let moved = match *at {
                Meeting::Element(id) => element(id).map(Meeting::Element),
                Meeting::Bar(b) => bond(b).map(Meeting::Bar),
            };
            *at = moved.unwrap_or(*at);
            moved.is_some()
        });
        model.signals = std::mem::take(&mut model.signals)
            .into_iter()
            .filter_map(|(symbol, signal)| {
                let signal = match signal {
                    Signal::Effort(b) => Signal::Effort(bond(b)?),
                    Signal::Flow(b) => Signal::Flow(bond(b)?),
                    Signal::State(id) => Signal::State(element(id)?),
                    Signal::Argument(id) => Signal::Argument(element(id)?),
                    Signal::Parameter(id) => Signal::Parameter(element(id)?),
                    Signal::Integral(i) => Signal::Integral(integrals[i]? as usize),
                    Signal::Memory(i) => Signal::Memory(memories[i]? as usize),
                    Signal::Delay(i) => Signal::Delay(delays[i]? as usize),
                    Signal::Time | Signal::Input(_) | Signal::Slope(_) => signal,
                };
                Some((symbol, signal))
            })
            .collect();
    }
}

/// The expressions of an expectation.
pub(crate) fn of_expectation(e: &Expectation) -> Vec<Expr> {
    match &e.kind {
        ExpectationKind::Passive | ExpectationKind::PassiveAt(_) => Vec::new(),
        ExpectationKind::At { value, .. } => vec![*value],
        ExpectationKind::Holds { condition, extremes } => {
            std::iter::once(*condition).chain(extremes.iter().map(|x| x.1)).collect()
        }
    }
}

/// The expressions of a law.
pub(crate) fn of_law(law: &Law) -> Vec<Expr> {
    match law {
        Law::Source(e) | Law::Ratio(e) => vec![*e],
        Law::Storage(s) => [Some(s.energy), Some(s.coenergy), s.linear].into_iter().flatten().collect(),
        Law::Resistor(Resistor { output, curve, row, linear, .. }) => {
            let mut list = vec![*output];
            list.extend(curve.iter().flat_map(|c| [c.effort, c.flow]));
            list.extend(row.iter().flatten());
            list.extend(linear);
            list
        }
        Law::Junction | Law::Port(_) | Law::Multiplier => Vec::new(),
    }
}

/// The new number of each, of which those that are out have none.
fn numbers(out: &[bool]) -> Vec<Option<u32>> {
    let mut next = 0..;
    out.iter().map(|out| if *out { None } else { next.next() }).collect()
}

fn retain<T>(list: &mut Vec<T>, out: &[bool]) {
    let mut out = out.iter();
    list.retain(|_| out.next() == Some(&false));
}
