//! What the end of an interval does to the accounts of a sampled cluster, and to what it is trusted with.

use super::{AccountPlaces, HeldPlaces, Layout, Memory, Place, account, larger, positive, smaller};
use crate::machine::{Machine, Number};
use crate::scene::{Cluster, Entries};

/// How much less a debtor may put at risk after it lost all that it risked: 1 in one more than this.
const MARGIN_PENALTY: f64 = 16.0;
/// A loss, or a debt, of less than this part of the most that an interval ever risked, or that crossed and was put in,
/// is rounding, and counts as none.
const LOSS: f64 = 1e-12;
/// Beside this part of the scene's largest energy a debt counts, where the region's own are smaller: what crosses from
/// there has the rounding of that.
const BESIDE: f64 = 1e-2;
/// What of an energy is its rounding. What is stored is no budget as far as it is that: of next to nothing, held
/// against what was not predicted, its root would be given out.
const NOISE: f64 = 1e-14;

/// Books what crossed a held port: what is `counted` where that was summed up, else what was held times the answer. The
/// other side of a double bar counts for itself, by what it `met`.
pub fn cross<M: Machine, K: Memory<M>>(m: M, k: K, h: &HeldPlaces, counted: bool, met: Option<M::Number>) {
    let (q, w) = (k.load(h.q), k.load(h.w));
    let crossed = if counted { w } else { k.load(h.v) * q };
    k.store(h.crossed, crossed);
    if let Some(p) = &h.counts {
        k.gather(p.holder, crossed);
        k.gather(p.other, met.filter(|_| !counted).map_or(crossed, |met| q * met));
        k.raise(m, p.difference, (k.sum(p.holder) - k.sum(p.other)).abs());
    }
}

/// Books what crossed in the place of what the step's own effort would have let in, what that leaves in the tanks, and
/// what that does to what the cluster is trusted with. `near` are those that it is joined to.
pub fn settle<'s, M: Machine, K: Memory<M>>(
    m: M,
    k: K,
    i: usize,
    near: &[usize],
    clusters: impl Iterator<Item = (&'s Cluster, &'s Layout)> + Clone,
) {
    let Some((c, l)) = clusters.clone().nth(i) else { return };
    let mut turned = m.number(0.0);
    for (e, p) in c.entries.iter().zip(&l.accounts) {
        turned = settle_account(m, k, (c, l), (e, p), turned);
    }
    if l.accounts.is_empty() {
        return;
    }
    share(m, k, c, l);
    for p in &l.accounts {
        let stored = k.load(p.stored);
        k.raise(m, p.debt_max, owed(m, k, p));
        if let Some(d) = &p.detail {
            k.raise(m, d.stored_max, stored);
        }
    }
    k.raise(m, l.passivity.most, turned);
    control(m, k, l, near, clusters);
}

/// The same of one region. Adds to the magnitudes of what crossed and sources put in.
fn settle_account<M: Machine, K: Memory<M>>(
    m: M,
    k: K,
    (c, l): (&Cluster, &Layout),
    (e, p): (&Entries, &AccountPlaces),
    mut turned: M::Number,
) -> M::Number {
    let [mut called, mut crossed, mut heat, mut own, mut warmed] = [m.number(-0.0); 5];
    for h in l.held.iter().filter(|h| c.ports[h.port].region == e.region) {
        let (port, energy) = (&c.ports[h.port], k.load(h.crossed));
        called = called + k.load(h.q) * k.output(port.mean);
        if h.is_thermal {
            heat = heat + energy;
        } else {
            crossed = crossed + energy;
        }
        turned = turned + energy.abs();
        // A source beside the port may have the name of what it joins.
        let source = e.held.iter().copied().find(|i| e.supplied[*i].0 == port.name);
        if let (Some(d), Some(source)) = (&p.detail, source) {
            k.gather(d.sources.plus(2 * source), energy);
        }
    }
    let mut stored = k.load(p.stored);
    if !e.held.is_empty() {
        let all = if e.work.is_some() { crossed + heat } else { crossed };
        k.gather(p.supplied, all);
        k.gather(p.leaked, called - all);
        if let Some(d) = &p.detail {
            k.raise(m, d.crossed_max, all.abs());
        }
        stored = stored + crossed;
    }
    for i in e.own() {
        let x = k.output(e.supplied[i].1);
        if e.work.as_ref().is_some_and(|w| w.heats.contains(&i)) {
            warmed = warmed + x;
        } else {
            own = own + x;
        }
        turned = turned + x.abs();
    }
    if e.is_driven() {
        stored = stored + own;
    }
    if let Some(w) = &p.work {
        k.store(w.heat, k.load(w.heat) + heat + warmed);
    }
    if l.accounts.len() == 1 && !e.is_drawn_on() {
        let mut most = k.load(energy(p)) + cap(m, k, e, p);
        // What was promised is not let go; several regions have no open ports.
        if let Some(reserve) = l.passivity.reserve {
            most = larger(m, most, k.load(reserve));
        }
        keep(m, k, p, stored, smaller(m, stored, most));
    } else {
        k.store(p.stored, stored);
    }
    turned
}

/// Replaces what there is to give. What is no longer there as work became heat.
fn keep<M: Machine, K: Memory<M>>(_: M, k: K, p: &AccountPlaces, before: M::Number, now: M::Number) {
    if let Some(w) = &p.work {
        k.store(w.heat, k.load(w.heat) + (before - now));
    }
    k.store(p.stored, now);
}

/// The energy that what there is to give is counted beside.
fn energy(p: &AccountPlaces) -> Place {
    p.work.map_or(p.h, |w| w.energy)
}

/// What the tank holds, and that energy where it is least, below 0.
fn tank<M: Machine, K: Memory<M>>(k: K, p: &AccountPlaces) -> M::Number {
    k.load(p.stored) - k.load(energy(p))
}

/// The most that it may hold: the largest energy above the least seen, likewise counted. What a steered source that
/// draws on the account would store cannot be seen: with such a one, all that was put in may be returned.
fn cap<M: Machine, K: Memory<M>>(m: M, k: K, e: &Entries, p: &AccountPlaces) -> M::Number {
    match &p.work {
        Some(w) => k.load(w.top) - m.number(2.0) * k.load(w.least),
        None if e.least == 0.0 => k.load(p.h_max),
        None => k.load(p.h_top) - m.number(2.0) * k.load(p.h_least),
    }
}

/// What regions that hold together have to give is one: where one of them is in debt, the others' tanks cover that, and
/// the cap is on all tanks together.
fn share<M: Machine, K: Memory<M>>(m: M, k: K, c: &Cluster, l: &Layout) {
    if l.accounts.len() < 2 {
        return;
    }
    let zero = m.number(0.0);
    let (mut there, mut lacking) = (zero, zero);
    for p in &l.accounts {
        let stored = k.load(p.stored);
        let below = stored.below(zero);
        (there, lacking) = (m.select(below.clone(), there, there + stored), m.select(below, lacking - stored, lacking));
    }
    m.only(zero.below(there) & zero.below(lacking), || {
        let cover = smaller(m, there, lacking);
        let (taken, given) = (cover / there, cover / lacking);
        for p in &l.accounts {
            let stored = k.load(p.stored);
            k.store(p.stored, stored - stored * m.select(stored.below(zero), given, taken));
        }
    });
    if c.entries.iter().any(Entries::is_drawn_on) {
        return;
    }
    let (mut over, mut full) = (zero, zero);
    for (p, e) in l.accounts.iter().zip(&c.entries) {
        let tank = tank(k, p);
        over = over + (tank - cap(m, k, e, p));
        full = full + positive(m, tank);
    }
    m.only(zero.below(over), || {
        let part = over / full;
        for p in &l.accounts {
            let (stored, tank) = (k.load(p.stored), tank(k, p));
            keep(m, k, p, stored, m.select(zero.below(tank), stored - tank * part, stored));
        }
    });
}

/// The passivity controller: what a debt, or a loss while there is one, takes from what may be put at risk, here and at
/// those near.
fn control<'s, M: Machine, K: Memory<M>>(
    m: M,
    k: K,
    l: &Layout,
    near: &[usize],
    clusters: impl Iterator<Item = (&'s Cluster, &'s Layout)> + Clone,
) {
    let (zero, one) = (m.number(0.0), m.number(1.0));
    let p = &l.passivity;
    let near = || near.iter().filter_map(|j| clusters.clone().nth(*j)).map(|(_, l)| l);
    let clear = |l: &Layout| (-balance(m, k, l)).at_most(m.number(LOSS) * k.load(l.passivity.most));
    let others = near().fold(m.known(true), |all, l| all & clear(l));
    let easy = k.load(p.peak).equals(zero) & k.load(p.energy_margin).equals(one);
    let free = clear(l) & (easy | others);
    let freed = || {
        k.store(p.peak, zero);
        k.store(p.energy_margin, one);
    };
    let owing = || {
        note_relative_debt(m, k, l, clusters.clone());
        let debt = -balance(m, k, l);
        let crossed = l.held.iter().fold(m.number(-0.0), |sum, h| sum + k.load(h.crossed));
        let lost = smaller(m, -crossed, debt);
        m.only((m.number(LOSS) * k.load(p.most)).below(lost), || {
            let part = smaller(m, one, lost / k.load(p.risk));
            let cost = one + m.number(MARGIN_PENALTY) * part;
            k.store(p.energy_margin, k.load(p.energy_margin) / cost);
            // What it gave out, the others may lose too.
            for other in near() {
                let margin = other.passivity.energy_margin;
                k.store(margin, k.load(margin) / cost);
            }
        });
        k.raise(m, p.peak, debt);
    };
    // Neither leaves anything around it.
    let _ = m.branch(
        free,
        || {
            freed();
            Ok(())
        },
        || {
            owing();
            Ok(())
        },
    );
}

/// Notes what debts are beside the energies that there were until now: what comes later excuses none.
fn note_relative_debt<'s, M: Machine, K: Memory<M>>(
    m: M,
    k: K,
    l: &Layout,
    clusters: impl Iterator<Item = (&'s Cluster, &'s Layout)>,
) {
    if l.accounts.iter().all(|p| p.detail.is_none()) {
        return;
    }
    let mut largest = m.number(0.0);
    for (c, l) in clusters {
        for p in &l.accounts {
            // What holds alone have a sampled one store is no energy that was there.
            let own = match &p.detail {
                Some(d) if c.period.is_some() => k.load(d.stored_max),
                _ => account::largest(m, [p.h_max, p.turnover_max, p.size_max].map(|at| k.load(at))),
            };
            largest = larger(m, largest, own);
        }
    }
    let beside = m.number(BESIDE) * largest;
    for (p, d) in l.accounts.iter().filter_map(|p| Some((p, p.detail.as_ref()?))) {
        let own = [k.load(d.stored_max), k.sum(p.supplied).abs(), k.load(d.crossed_max)];
        let scale = own.into_iter().fold(beside, |most, x| larger(m, most, x));
        k.raise(m, d.relative_debt, owed(m, k, p) / scale);
    }
}

/// What a cluster has to give; 0 where it has no account.
pub fn stored<M: Machine, K: Memory<M>>(m: M, k: K, l: &Layout) -> M::Number {
    l.accounts.iter().fold(m.number(-0.0), |sum, p| sum + k.load(p.stored))
}

/// What a region drew and was not given, as work or as heat; below 0 where it has something to give of both.
fn owed<M: Machine, K: Memory<M>>(m: M, k: K, p: &AccountPlaces) -> M::Number {
    let work = -k.load(p.stored);
    p.work.map_or(work, |w| larger(m, work, -k.load(w.heat)))
}

/// The lesser of what a cluster has to give as work and as heat: below 0 where it is in debt.
pub(super) fn balance<M: Machine, K: Memory<M>>(m: M, k: K, l: &Layout) -> M::Number {
    let stored = stored(m, k, l);
    if l.accounts.iter().all(|p| p.work.is_none()) { stored } else { smaller(m, stored, heat(m, k, l)) }
}

/// What a cluster has to give as heat; 0 where it has none.
pub(super) fn heat<M: Machine, K: Memory<M>>(m: M, k: K, l: &Layout) -> M::Number {
    l.accounts.iter().filter_map(|p| p.work).fold(m.number(-0.0), |sum, w| sum + k.load(w.heat))
}

/// What of that is rounding.
pub(super) fn noise<M: Machine, K: Memory<M>>(m: M, k: K, l: &Layout) -> M::Number {
    m.number(NOISE) * l.accounts.iter().fold(m.number(-0.0), |sum, p| sum + k.load(energy(p)).abs())
}

#[cfg(test)]
mod tests {
    use super::super::{Booking, CountPlaces, Ledger};
    use super::*;
    use crate::machine::Real;
    use std::cell::Cell;

    /// The holder counts by what it held, the other side by what it met.
    #[test]
    fn sides_that_go_by_other_values_differ() {
        let mut ledger = Ledger::default();
        ledger.numbers.resize(25, Cell::new(0.0));
        let at = |at| Place { cluster: 0, at };
        let counts = CountPlaces { holder: at(20), other: at(22), difference: at(24) };
        let h = HeldPlaces {
            port: 0,
            is_thermal: false,
            v: at(0),
            q: at(1),
            w: at(2),
            last_q: at(3),
            free_response: at(4),
            before: at(9),
            predicted: at(14),
            off: at(15),
            intervals: at(16),
            crossed: at(17),
            counts: Some(counts),
        };
        ledger.set(h.v, 2.0);
        ledger.set(h.q, 3.0);
        let booking = Booking { ledger: &ledger, output: &[] };
        cross(Real::new(), booking, &h, false, Some(2.0));
        assert_eq!(ledger.get(at(24)), 0.0);
        cross(Real::new(), booking, &h, false, Some(2.5));
        assert_eq!((ledger.sum(at(20)), ledger.sum(at(22)), ledger.get(at(24))), (12.0, 13.5, 1.5));
    }
}
