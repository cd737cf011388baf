//! What the end of an interval does to the accounts of a sampled cluster.

use super::{AbsorbedPlaces, AccountPlaces, HeldPlaces, Layout, Memory, Place, account, larger, positive, smaller};
use crate::ir::Unary;
use crate::machine::{Machine, Number};
use crate::scene::{Cluster, Entries, Leaving};

/// What a region may draw beyond what it has to give, once, as a part of the largest energy that was ever at stake: so
/// much of a sum of many intervals is rounding.
const SLACK: f64 = 1e-12;
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

/// Books what crossed in the place of what the step's own effort would have let in, and what that leaves in the tanks
/// of the `i`-th of the clusters.
pub fn settle<'s, M: Machine, K: Memory<M>>(
    m: M,
    k: K,
    i: usize,
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
    if let Some(part) = l.stake.shortened {
        shorten(m, k, (c, l), part);
    }
    let zero = m.number(0.0);
    for (n, there) in [stored(m, k, l), heat(m, k, l)].into_iter().enumerate() {
        for sum in l.accounts.iter().filter_map(|p| p.absorbed).map(|at| at.sums.plus(n)) {
            k.store(sum, m.select(there.below(zero), k.load(sum), zero));
        }
    }
    for p in &l.accounts {
        let stored = k.load(p.stored);
        k.raise(m, p.debt_max, owed(m, k, l, p));
        if let Some(d) = &p.detail {
            k.raise(m, d.stored_max, stored);
        }
    }
    k.raise(m, l.stake.most, turned);
    k.raise(m, l.stake.most, balance(m, k, l));
    if l.accounts.iter().any(|p| p.detail.is_some()) {
        // What is reported has the rounding of what it is the difference of.
        let owing = (balance(m, k, l) + slack(m, k, l) + noise(m, k, l)).below(m.number(0.0));
        m.only(owing & is_short(m, k, l), || note_relative_debt(m, k, l, clusters));
    }
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
        if let (Some(sources), Some(source)) = (p.sources, source) {
            k.gather(sources.plus(2 * source), energy);
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
    if let Some(at) = p.absorbed {
        absorb(m, k, e, at);
    }
    if let Some(w) = &p.work {
        k.store(w.heat, k.load(w.heat) + heat + warmed);
    }
    if l.accounts.len() == 1 && !e.is_drawn_on() {
        let mut most = k.load(energy(p)) + cap(m, k, e, p);
        // What was promised is not let go; several regions have no open ports.
        if let Some(reserve) = l.stake.reserve {
            most = larger(m, most, k.load(reserve));
        }
        keep(m, k, p, stored, smaller(m, stored, most));
    } else {
        k.store(p.stored, stored);
    }
    turned
}

/// Shortens the waves that leave into lines where they took more than there was to give: what a hold added to a step
/// is no energy that came in, and what goes into a line comes back. So a line draws on the account as bars do.
fn shorten<M: Machine, K: Memory<M>>(m: M, k: K, (c, l): (&Cluster, &Layout), part: Place) {
    let (zero, one) = (m.number(0.0), m.number(1.0));
    let energy = |x: &Leaving| {
        let wave = k.output(x.wave);
        m.number(x.scale) * wave * wave
    };
    let sent = c.entries.iter().flat_map(|e| &e.leaving).fold(zero, |sum, x| sum + energy(x));
    k.store(part, one);
    m.only(is_short(m, k, l) & zero.below(sent), || {
        let short = positive(m, -(stored(m, k, l) + absorbed(m, k, l, 0)));
        let cut = smaller(m, short / sent, one);
        k.store(part, (one - cut).unary(Unary::Sqrt));
        for (e, p) in c.entries.iter().zip(&l.accounts) {
            for x in &e.leaving {
                let back = energy(x) * cut;
                k.gather(p.supplied, back);
                k.gather(p.leaked, -back);
                k.add(p.stored, back);
                if let Some(sources) = p.sources {
                    k.gather(sources.plus(2 * x.source), back);
                }
            }
        }
    });
}

/// Books what a region's own sources took back in the interval: of what it was to have from them when it let go, or of
/// nothing. What lines took comes back, and is none of it.
fn absorb<M: Machine, K: Memory<M>>(m: M, k: K, e: &Entries, at: AbsorbedPlaces) {
    let zero = m.number(0.0);
    for (n, is_heat) in [false, true].into_iter().enumerate() {
        let warms = |i: &usize| e.work.as_ref().is_some_and(|w| w.heats.contains(i));
        let is_line = |i: &usize| e.leaving.iter().any(|x| x.source == *i);
        let own = e.sources().filter(|i| warms(i) == is_heat && !is_line(i));
        let own = own.fold(m.number(-0.0), |sum, i| sum + k.output(e.supplied[i].1));
        let counted_on = at.counted_on.plus(n);
        // What was counted on may have been a line's.
        let had = if e.leaving.is_empty() { k.load(counted_on) } else { zero };
        k.add(at.sums.plus(n), larger(m, own, had) - own);
        k.store(counted_on, zero);
    }
}

/// Books that what a step gave out at a port that it meets, J, did not cross as far as this: it is lost inside.
pub fn keep_back<M: Machine, K: Memory<M>>(_: M, k: K, p: &AccountPlaces, (energy, is_heat): (M::Number, bool)) {
    k.gather(p.supplied, energy);
    k.gather(p.leaked, -energy);
    match p.work.filter(|_| is_heat) {
        Some(w) => k.add(w.heat, energy),
        None => k.add(p.stored, energy),
    }
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

/// Notes what debts are beside the energies that there were until now: what comes later excuses none.
fn note_relative_debt<'s, M: Machine, K: Memory<M>>(
    m: M,
    k: K,
    l: &Layout,
    clusters: impl Iterator<Item = (&'s Cluster, &'s Layout)>,
) {
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
        let own = [k.load(d.stored_max), k.sum(p.supplied).abs(), k.load(d.crossed_max), k.load(l.stake.most)];
        let scale = own.into_iter().fold(beside, |most, x| larger(m, most, x));
        k.raise(m, d.relative_debt, owed(m, k, l, p) / scale);
    }
}

/// The least that W may be within a step, from its values at both ends and its rates there, per step: that at its end,
/// or where the cubic through them dips in between, as far below both ends again as the cubic: so much that one may
/// miss.
pub fn least_between<M: Machine>(m: M, [x, f, y, g]: [M::Number; 4]) -> M::Number {
    let (zero, two, three) = (m.number(0.0), m.number(2.0), m.number(3.0));
    // The rate is f + 2 b u + 3 c u². Of its roots one is where it turns to rise.
    let rise = y - x;
    let (b, c) = (three * rise - two * f - g, f + g - two * rise);
    let root = positive(m, b * b - three * c * f).unary(Unary::Sqrt);
    let u = m.select(zero.below(b), -f / (b + root), (root - b) / (three * c));
    let u = m.select(zero.below(u) & u.below(m.number(1.0)), u, m.number(0.5));
    let least = x + u * (f + u * (b + u * c));
    let ends = smaller(m, x, y);
    m.select(f.below(zero) & zero.below(g), least - (ends - least), y)
}

/// What a cluster has to give; 0 where it has no account.
pub fn stored<M: Machine, K: Memory<M>>(m: M, k: K, l: &Layout) -> M::Number {
    l.accounts.iter().fold(m.number(-0.0), |sum, p| sum + k.load(p.stored))
}

/// What its bars drew from a region that it was not given, as work or as heat, and no more than from all that it holds
/// together with; below 0 where it has something to give of both.
fn owed<M: Machine, K: Memory<M>>(m: M, k: K, l: &Layout, p: &AccountPlaces) -> M::Number {
    let one = |p: &AccountPlaces| {
        let absorbed = |n: usize| p.absorbed.map_or(m.number(0.0), |at| k.load(at.sums.plus(n)));
        let heat = p.work.map(|w| -k.load(w.heat) - absorbed(1));
        (-k.load(p.stored) - absorbed(0), heat)
    };
    let (mut work, mut heat) = one(p);
    if l.accounts.len() > 1 {
        let all = l.accounts.iter().map(one);
        let (together, warm) = all.fold((m.number(-0.0), m.number(-0.0)), |(sum, warm), (work, heat)| {
            (sum + work, heat.map_or(warm, |x| warm + x))
        });
        work = smaller(m, work, together);
        heat = heat.map(|x| smaller(m, x, warm));
    }
    heat.map_or(work, |x| larger(m, work, x))
}

/// The lesser of what a cluster has to give as work and as heat: below 0 where it is in debt.
pub(super) fn balance<M: Machine, K: Memory<M>>(m: M, k: K, l: &Layout) -> M::Number {
    let stored = stored(m, k, l);
    if l.accounts.iter().all(|p| p.work.is_none()) { stored } else { smaller(m, stored, heat(m, k, l)) }
}

/// What a cluster has to give as heat; 0 where it has none.
pub fn heat<M: Machine, K: Memory<M>>(m: M, k: K, l: &Layout) -> M::Number {
    l.accounts.iter().filter_map(|p| p.work).fold(m.number(-0.0), |sum, w| sum + k.load(w.heat))
}

/// The most that may be drawn within an interval as work, and as heat: what there is to give, what its own sources put
/// in, and the slack. From a region that owes, nothing may be drawn.
pub fn rooms<M: Machine, K: Memory<M>>(m: M, k: K, l: &Layout, own: [M::Number; 2]) -> [M::Number; 2] {
    let slack = slack(m, k, l);
    let [work, warm] = own.map(|x| positive(m, x));
    [stored(m, k, l) + work, heat(m, k, l) + warm].map(|there| positive(m, there + slack))
}

/// Whether more was drawn than there was to give, beyond the slack: as work or as heat.
pub fn is_short<M: Machine, K: Memory<M>>(m: M, k: K, l: &Layout) -> M::Condition {
    let (slack, zero) = (slack(m, k, l), m.number(0.0));
    let [work, warm] = [stored(m, k, l) + absorbed(m, k, l, 0), heat(m, k, l) + absorbed(m, k, l, 1)];
    (work + slack).below(zero) | (warm + slack).below(zero)
}

/// What own sources took back since there last was something to give: as work, or with 1 as heat.
fn absorbed<M: Machine, K: Memory<M>>(m: M, k: K, l: &Layout, n: usize) -> M::Number {
    let places = l.accounts.iter().filter_map(|p| p.absorbed);
    places.fold(m.number(0.0), |sum, at| sum + k.load(at.sums.plus(n)))
}

/// What may be drawn beyond what there is to give, in all.
pub fn slack<M: Machine, K: Memory<M>>(m: M, k: K, l: &Layout) -> M::Number {
    m.number(SLACK) * k.load(l.stake.most)
}

/// What of that is rounding.
pub(super) fn noise<M: Machine, K: Memory<M>>(m: M, k: K, l: &Layout) -> M::Number {
    m.number(NOISE) * l.accounts.iter().fold(m.number(-0.0), |sum, p| sum + k.load(energy(p)).abs())
}

#[cfg(test)]
mod tests {
    use super::super::testing::{account, at};
    use super::super::{Booking, CountPlaces, Ledger, StakePlaces, WorkPlaces};
    use super::*;
    use crate::machine::Real;
    use std::cell::Cell;

    /// (u - 1/2)² and u³ - u + 1, of which the least is at 1/sqrt(3), and what rises throughout.
    #[test]
    fn the_least_within_a_step() {
        let twice = |least: f64, ends: f64| least - (ends - least);
        let wanted = [twice(0.0, 0.25), twice(1.0 - 2.0 / (3.0 * 3f64.sqrt()), 1.0), 3.0];
        let cases = [[0.25, -1.0, 0.25, 1.0], [1.0, -1.0, 1.0, 2.0], [1.0, 2.0, 3.0, 2.0]];
        for (case, wanted) in cases.into_iter().zip(wanted) {
            assert!((least_between(Real::new(), case) - wanted).abs() < 1e-15, "{case:?}");
        }
    }

    /// What a region's own sources took back is no draw of its bars: only what is owed beyond that is short, as work
    /// and as heat, each for itself.
    #[test]
    fn what_sources_took_back_is_not_short() {
        let account = AccountPlaces {
            work: Some(WorkPlaces { energy: at(18), top: at(19), least: at(20), heat: at(21) }),
            absorbed: Some(AbsorbedPlaces { sums: at(22), counted_on: at(24) }),
            ..account()
        };
        let stake = StakePlaces { most: at(26), releases: None, reserve: None, shortened: None };
        let layout = Layout { size: 32, logs: 0, held: Vec::new(), stake, accounts: vec![account] };
        let short = |[work, heat]: [f64; 2], [worked, warmed]: [f64; 2]| {
            let mut ledger = Ledger::default();
            ledger.numbers.resize(32, Cell::new(0.0));
            for (place, x) in [(13, work), (21, heat), (22, worked), (23, warmed), (26, 1.0)] {
                ledger.set(at(place), x);
            }
            is_short(Real::new(), Booking { ledger: &ledger, output: &[] }, &layout)
        };
        assert!(!short([1.0, 1.0], [0.0, 0.0]) && !short([-2.0, 1.0], [2.0, 0.0]) && !short([1.0, -2.0], [0.0, 2.0]));
        assert!(short([-2.0, 1.0], [1.5, 9.0]) && short([1.0, -2.0], [9.0, 1.5]));
        // What is rounding beside the most that was at stake is nothing.
        assert!(!short([-0.5e-12, 0.0], [0.0, 0.0]) && short([-2e-12, 0.0], [0.0, 0.0]));
    }

    /// The holder counts by what it held, the other side by what it met.
    #[test]
    fn sides_that_go_by_other_values_differ() {
        let mut ledger = Ledger::default();
        ledger.numbers.resize(25, Cell::new(0.0));
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
            intervals: at(14),
            crossed: at(15),
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
