//! The ledger's terms of an explicit step: by the weights of the stages, and moved along with the end of the step.

use super::projection::{Net, Projected, Projection};
use super::stage::{Stage, sum};
use crate::discretise::cluster::Cluster;
use crate::graph::RegionId;
use crate::model::Model;
use crate::structure::{ColumnId, Form};
use bond_runtime::ir::{Array, Binary, Builder, Slot, Unary, Value};
use bond_runtime::scene::Entries;

/// What a step supplies, loses and produces in a region, J: in the order of the ledger's entries. What is produced is
/// an entropy and the heat of it, one after the other.
pub(super) struct Booked {
    supplied: Vec<Value>,
    dissipated: Vec<Value>,
    produced: Vec<Value>,
}

/// The energies of a step by the weights of the stages.
pub(super) fn book(b: &mut Builder, stages: &[Stage], weights: &[f64], h: Value, entries: &[Entries]) -> Vec<Booked> {
    let mut k = 0;
    let mut energy = |b: &mut Builder| {
        let p = sum(b, stages, weights.iter().copied(), &|s| s.powers[k]);
        k += 1;
        b.mul(h, p)
    };
    let mut list = Vec::new();
    for e in entries {
        let given: Vec<Value> = e.supplied.iter().map(|_| energy(b)).collect();
        let supplied = given.into_iter().map(|w| b.unary(Unary::Neg, w)).collect();
        let dissipated = e.dissipated.iter().map(|_| energy(b)).collect();
        let produced = e.produced.iter().flat_map(|_| [(); 2]).map(|()| energy(b)).collect();
        list.push(Booked { supplied, dissipated, produced });
    }
    list
}

/// What each block is given in a step. The first block of a region is given what the others leave of what the ledger
/// says.
pub(super) fn nets(
    b: &mut Builder,
    (c, projection): (&Cluster, &Projection),
    (stages, weights): (&[Stage], &[f64]),
    booked: &[Booked],
    h: Value,
) -> Vec<Net> {
    let regions: Vec<Net> = booked.iter().map(|x| net(b, x)).collect();
    let region = |at: RegionId| c.regions.iter().position(|r| *r == at).unwrap_or(0);
    let mut nets: Vec<Net> = projection.blocks.iter().map(|x| regions[region(x.region)]).collect();
    let apart: Vec<usize> = (0..nets.len()).filter(|i| projection.is_apart(*i)).collect();
    for (k, i) in apart.into_iter().enumerate() {
        let power = sum(b, stages, weights.iter().copied(), &|s| s.intakes[k]);
        nets[i].energy = b.mul(h, power);
        let first = projection.first_of(i);
        nets[first].energy = b.sub(nets[first].energy, nets[i].energy);
    }
    nets
}

/// What a region is given.
fn net(b: &mut Builder, booked: &Booked) -> Net {
    let zero = b.number(0.0);
    let (mut energy, mut gross) = (zero, zero);
    for (values, sign) in [(&booked.supplied, false), (&booked.dissipated, true)] {
        for w in values {
            energy = if sign { b.sub(energy, *w) } else { b.add(energy, *w) };
            let size = b.unary(Unary::Abs, *w);
            gross = b.add(gross, size);
        }
    }
    Net { energy, gross }
}

/// Moves what crosses ports and sources along with the states.
pub(super) fn take_along(
    b: &mut Builder,
    (c, model, form): (&Cluster, &Model, &Form),
    found: &Projected,
    (means, booked): (&mut [Value], &mut [Booked]),
    h: Value,
) {
    for (mean, port) in means.iter_mut().zip(&c.ports) {
        if let Some((moved, _)) = found.through.get(port) {
            let part = b.div(*moved, h);
            *mean = b.add(*mean, part);
        }
    }
    for (booked, accounts) in booked.iter_mut().zip(c.accounts(model, form)) {
        for (w, column) in booked.supplied.iter_mut().zip(accounts.supplied) {
            if let Some((moved, value)) = found.through.get(&column) {
                let more = b.mul(*moved, *value);
                *w = b.sub(*w, more);
            }
        }
    }
}

/// Stores the ledger's terms, and of what is projected the changes of the energies.
pub(super) fn store(b: &mut Builder, entries: &[Entries], booked: &[Booked], found: Option<&Projected>, c: &Cluster) {
    for ((e, booked), region) in entries.iter().zip(booked).zip(&c.regions) {
        let supplied = e.supplied.iter().map(|s| s.1).zip(&booked.supplied);
        let dissipated = e.dissipated.iter().map(|d| d.1).zip(&booked.dissipated);
        let produced = e.produced.iter().flat_map(|p| [p.entropy, p.heat]).zip(&booked.produced);
        for (slot, w) in supplied.chain(dissipated).chain(produced) {
            b.store(Slot::new(Array::Output, slot), *w);
        }
        if let (Some((change, exchanged)), Some(found)) = (e.change, found) {
            let zero = b.number(0.0);
            let (moved, size) = found.changes.get(region).copied().unwrap_or((zero, zero));
            b.store(Slot::new(Array::Output, change), moved);
            b.store(Slot::new(Array::Output, exchanged), size);
        }
    }
}

/// Whether no resistor gives energy, and no entropy falls, by the quadrature alone: some weights are below 0. Where a
/// law itself gives energy at a stage, that is the law's.
pub(super) fn sound(
    b: &mut Builder,
    (c, model, form): (&Cluster, &Model, &Form),
    (stages, weights): (&[Stage], &[f64]),
    booked: &[Booked],
) -> Value {
    let mut all = b.number(1.0);
    let zero = b.number(0.0);
    let mut k = 0;
    for (booked, accounts) in booked.iter().zip(c.accounts(model, form)) {
        k += booked.supplied.len();
        let active = |columns: &[ColumnId]| columns.iter().any(|c| model.element(form.column(*c).element).active);
        let losses = booked.dissipated.iter().zip(accounts.dissipated.iter().map(|columns| active(columns)));
        let losses = losses.chain(booked.produced.iter().map(|w| (w, false)));
        for (w, is_active) in losses.collect::<Vec<_>>() {
            let powers: Vec<Value> =
                stages.iter().zip(weights).filter(|(_, w)| **w != 0.0).map(|(s, _)| s.powers[k]).collect();
            k += 1;
            let Some((first, rest)) = powers.split_first().filter(|_| !is_active) else { continue };
            let least = rest.iter().fold(*first, |least, p| b.binary(Binary::Min, least, *p));
            let own = b.binary(Binary::Lt, least, zero);
            let takes = b.binary(Binary::Le, zero, *w);
            let fine = b.binary(Binary::Max, takes, own);
            all = b.mul(all, fine);
        }
    }
    all
}
