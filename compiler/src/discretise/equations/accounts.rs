//! What the ledger has of a cluster: names of its entries, and the columns whose powers they are.

use crate::discretise::cluster::{Cluster, Group, Node};
use crate::discretise::equations::constraints::LOSS;
use crate::expression::Sign;
use crate::graph::RegionId;
use crate::model::Model;
use crate::structure::{ColumnId, Form, Role};
use bond_runtime::ir::Builder;
use bond_runtime::scene::{Entries, Produced, Steering, Work};
use rustc_hash::FxHashMap;

/// The columns of a region's entries in the ledger. A field is one entry, of all its ports.
pub(crate) struct Accounts {
    /// Sources, ports, and ends of lines.
    pub(crate) supplied: Vec<ColumnId>,
    /// Resistors.
    pub(crate) dissipated: Vec<Vec<ColumnId>>,
    /// The thermal ports of fields, whose entropy is counted.
    pub(crate) produced: Vec<Vec<ColumnId>>,
}

impl Cluster {
    /// Names of the ledger's entries, with the outputs reserved in a builder: means first, then for each region H,
    /// sources and ports, resistors.
    pub(crate) fn reserve(&self, model: &Model, b: &mut Builder, form: &Form) -> Vec<Entries> {
        use bond_runtime::ir::Array;
        for c in &self.ports {
            b.named(Array::Output, format!("mean({})", form.column(*c).name));
        }
        for i in 0..self.waves().count() {
            b.named(Array::Output, format!("wave({})", i + 1));
        }
        let holds: Vec<ColumnId> = held_ports(self, form).into_iter().map(|p| self.ports[p]).collect();
        let mut list = Vec::new();
        for (r, accounts) in self.regions.iter().zip(self.accounts(model, form)) {
            let name = &form.regions[r.at()].name;
            let mut e = Entries { region: r.at(), ..Entries::default() };
            e.energy = b.named(Array::Output, format!("H({name})")).index as usize;
            let late = |g: &Group| self.time.is_some_and(|t| model.pool.contains(g.energy, t));
            if self.groups_in(*r).iter().any(late) {
                e.before = Some(b.named(Array::Output, format!("H({name}) before")).index as usize);
            }
            let signed = |g: &Group| !model.pool.sign(g.energy, &|_| Sign::Unknown).is_nonnegative();
            e.size = match self.groups_in(*r).iter().any(signed) {
                true => b.named(Array::Output, format!("size({name})")).index as usize,
                false => e.energy,
            };
            if self.watched {
                let change = b.named(Array::Output, format!("change({name})")).index as usize;
                let exchanged = b.named(Array::Output, format!("exchanged({name})")).index as usize;
                e.change = Some((change, exchanged));
            }
            if self.counts_work(model, form, *r) {
                let energy = b.named(Array::Output, format!("work({name})")).index as usize;
                let heats = accounts.supplied.iter().enumerate().filter(|(_, c)| is_thermal(model, form, **c));
                e.work = Some(Work { energy, heats: heats.map(|(i, _)| i).collect(), ..Work::default() });
            }
            for c in accounts.supplied {
                e.steered.extend(steering(model, form, c).map(|s| (e.supplied.len(), s)));
                let name = form.column(c).name.clone();
                let slot = b.named(Array::Output, format!("supplied({name})"));
                if holds.contains(&c) {
                    e.held.push(e.supplied.len());
                } else if self.sampling.is_some() && self.ports.contains(&c) {
                    e.met.push(e.supplied.len());
                }
                e.supplied.push((name, slot.index as usize));
            }
            let mut named = |what: &str, members: &[ColumnId]| {
                let first = members.first().map(|c| model.element(form.column(*c).element));
                let name = match first.and_then(|e| e.field) {
                    Some((f, _)) => model.fields[f].name.clone(),
                    None => first.map(|e| e.name.clone()).unwrap_or_default(),
                };
                let slot = b.named(Array::Output, format!("{what}({name})"));
                (name, slot.index as usize)
            };
            e.dissipated.extend(accounts.dissipated.iter().map(|m| named("dissipated", m)));
            e.produced.extend(accounts.produced.iter().map(|m| {
                let (name, entropy) = named("produced", m);
                Produced { name, entropy, heat: named("heat", m).1 }
            }));
            if self.is_constrained(form, *r) {
                let slot = b.named(Array::Output, format!("dissipated({LOSS})"));
                e.dissipated.push((LOSS.into(), slot.index as usize));
            }
            list.push(e);
        }
        list
    }

    /// Whether a region is sampled and has to do with heat, which must not be drawn as work.
    fn counts_work(&self, model: &Model, form: &Form, region: RegionId) -> bool {
        let own = |c: ColumnId| form.column(c).region == region && is_thermal(model, form, c);
        let columns = self.nodes.iter().filter_map(|n| n.source().or(n.resistor())).chain(self.ports.iter().copied());
        self.sampling.is_some() && columns.chain(self.states.iter().filter_map(|s| s.column)).any(own)
    }

    /// Which states of a group are heat: their bonds are of temperature and entropy.
    pub(crate) fn heats(&self, model: &Model, form: &Form, g: &Group) -> Vec<usize> {
        let is_heat = |s: &usize| self.states[*s].column.is_some_and(|c| is_thermal(model, form, c));
        g.states.iter().copied().filter(is_heat).collect()
    }

    /// The groups of a region whose energy is not heat alone.
    pub(crate) fn working_groups(&self, model: &Model, form: &Form, region: RegionId) -> Vec<&Group> {
        let works = |g: &&Group| self.heats(model, form, g).len() < g.states.len();
        self.groups_in(region).iter().filter(works).collect()
    }

    /// The columns of the entries of each region of the cluster, in the order in which [`Self::reserve`] lists them.
    pub(crate) fn accounts(&self, model: &Model, form: &Form) -> Vec<Accounts> {
        let mut of: FxHashMap<usize, (Vec<ColumnId>, Vec<ColumnId>)> = FxHashMap::default();
        for c in self.nodes.iter().filter_map(Node::source).chain(self.ports.iter().copied()) {
            of.entry(form.column(c).region.at()).or_default().0.push(c);
        }
        for c in self.nodes.iter().filter_map(Node::resistor) {
            let parts = of.entry(form.column(c).region.at()).or_default();
            // What goes into a line is not lost.
            let is_line = model.element(form.column(c).element).line.is_some();
            if is_line { parts.0.push(c) } else { parts.1.push(c) }
        }
        let sorted = |mut list: Vec<ColumnId>| {
            list.sort_unstable();
            list
        };
        let parts = self.regions.iter().map(|r| of.remove(&r.at()).unwrap_or_default());
        parts.map(|(supplied, resistors)| account(model, form, sorted(supplied), sorted(resistors))).collect()
    }
}

/// What a source that is steered is to the claim of passivity; `None` of one that is not.
pub(crate) fn steering(model: &Model, form: &Form, source: ColumnId) -> Option<Steering> {
    form.steered.get(&source)?;
    let column = form.column(source);
    let region = &form.regions[column.region.at()];
    let meets = region.inputs.iter().any(|i| matches!(form.column(*i).role, Role::Bar | Role::Open(_)));
    Some(match region.sampling.filter(|_| meets) {
        _ if model.element(column.element).active => Steering::Active,
        Some(sampling) if model.samplings[sampling].budget => Steering::Drawing,
        Some(_) => Steering::Unbounded,
        None => Steering::Beside,
    })
}

/// Whether a column's bond is of temperature and entropy.
pub(crate) fn is_thermal(model: &Model, form: &Form, column: ColumnId) -> bool {
    use crate::units::Dimension as D;
    let (effort, flow) = &model.units[form.column(column).bond.at()];
    let [effort, flow] = [effort, flow].map(|u| u.as_ref().map(|u| u.dimension));
    (effort, flow) == (Some(D::KELVIN), Some(D::WATT.div(D::KELVIN)))
}

/// The entries of a region with these columns, in order.
fn account(model: &Model, form: &Form, supplied: Vec<ColumnId>, resistors: Vec<ColumnId>) -> Accounts {
    let field = |c: ColumnId| model.element(form.column(c).element).field.map(|f| f.0);
    let mut dissipated: Vec<Vec<ColumnId>> = Vec::new();
    for c in resistors {
        // The ports of a field stand one after the other.
        match dissipated.last_mut().filter(|d| field(c).is_some() && field(d[0]) == field(c)) {
            Some(d) => d.push(c),
            None => dissipated.push(vec![c]),
        }
    }
    let thermal = |c: &&ColumnId| is_thermal(model, form, **c);
    let of_field = dissipated.iter().filter(|d| field(d[0]).is_some());
    let produced =
        of_field.map(|d| d.iter().filter(thermal).copied().collect::<Vec<_>>()).filter(|d| !d.is_empty()).collect();
    Accounts { supplied, dissipated, produced }
}

/// The ports, by index, whose outgoing variable the cluster holds.
pub(crate) fn held_ports(c: &Cluster, form: &Form) -> Vec<usize> {
    if c.sampling.is_none() {
        return Vec::new();
    }
    let holds = |p: &ColumnId| match form.column(*p).role {
        Role::Bar => form.bars.iter().any(|b| b.holder == *p),
        Role::Open(_) => true,
        Role::Source(_) | Role::Storage | Role::Resistor | Role::Dependent | Role::Constraint => false,
    };
    c.ports.iter().enumerate().filter(|(_, p)| holds(p)).map(|(i, _)| i).collect()
}
