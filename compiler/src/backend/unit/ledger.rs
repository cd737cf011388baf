//! A region's ledger in the block, and what a step does to it: as `bond_runtime::simulate` keeps it, without single
//! elements.

use super::{Writing, more};
use crate::backend::code::{Cond, Reason, Stmt, Value};
use crate::backend::lower::writer::Writer;
use bond_runtime::scene::Entries;
use bond_runtime::simulate::{BESIDE, GROSS, LOSS, NOISE, WARY};

/// What a ledger holds, in order; sums of energies have two numbers each, of which the second is what rounding took
/// from the first.
pub const NAMES: [&str; 18] = [
    "h",
    "h_initial",
    "h_max",
    "supplied",
    "supplied_rest",
    "dissipated",
    "dissipated_rest",
    "leaked",
    "leaked_rest",
    "residual",
    "worst",
    "turnover_max",
    "size_max",
    "stored",
    "debt_max",
    "gained",
    "h_top",
    "h_least",
];

const H: usize = 0;
const H_MAX: usize = 2;
const SUPPLIED: usize = 3;
const DISSIPATED: usize = 5;
const LEAKED: usize = 7;
const RESIDUAL: usize = 9;
const WORST: usize = 10;
const TURNOVER: usize = 11;
const SIZE: usize = 12;
const STORED: usize = 13;
const DEBT: usize = 14;
const GAINED: usize = 15;
const H_TOP: usize = 16;
const H_LEAST: usize = 17;

/// Energies below this are none, J, where the worst balance is kept as a ratio: of subnormal numbers, with which a wave
/// begins to arrive, most digits are rounding. Single numbers have it.
const LEAST: f64 = 1e-37;

/// The numbers of a ledger that a run goes on from, in the order of `bond_runtime::simulate::BookPlaces`.
pub(super) const KEPT: [usize; 12] =
    [H, H_MAX, H_TOP, H_LEAST, SUPPLIED, DISSIPATED, LEAKED, RESIDUAL, TURNOVER, SIZE, STORED, DEBT];

/// What a ledger starts as, with so much energy, which is so much at least.
pub(super) fn start(h: f64, least: f64) -> Vec<f64> {
    let mut list = vec![0.0; NAMES.len()];
    (list[H], list[1], list[H_MAX], list[H_TOP]) = (h, h, h.abs(), h);
    (list[STORED], list[H_LEAST]) = (h - least, least);
    list
}

impl Writer {
    /// Adds to a compensated sum, as `bond_runtime::ledger::Sum`.
    pub(super) fn gather(&mut self, at: usize, x: Value) {
        let (before, rest) = (self.kept(at), self.kept(at + 1));
        let sum = self.add(before, x);
        let added = self.sub(sum, before);
        let (p, q) = (self.sub(sum, added), self.sub(x, added));
        let p = self.sub(before, p);
        let lost = self.add(p, q);
        let rest = self.add(rest, lost);
        self.keep(at, sum);
        self.keep(at + 1, rest);
    }

    /// Keeps the larger of a number of the block and another.
    pub(super) fn raise(&mut self, at: usize, x: Value) -> Value {
        let before = self.kept(at);
        let most = self.larger(before, x);
        self.keep(at, most);
        most
    }
}

/// Fewer entries are booked one after the other.
const ROLLED: usize = 64;

/// The first of outputs that stand in a row, where they are many.
fn row(list: &[(String, usize)]) -> Option<usize> {
    let first = list.first()?.1;
    let stand = list.iter().enumerate().all(|(k, (_, slot))| *slot == first + k);
    (list.len() >= ROLLED && stand).then_some(first)
}

/// What the sources and resistors of a region do in a step.
struct Terms {
    supplied: Value,
    dissipated: Value,
    /// The sum of the sizes of both.
    turnover: Value,
    /// What the resistor that takes least takes: below 0 it gives.
    least: Value,
}

impl Writing<'_> {
    /// Sums what sources supply and resistors take in the step whose outputs are in the block, and books each of them
    /// that has an account of its own.
    fn terms(&self, w: &mut Writer, i: usize, k: usize) -> Terms {
        let (place, e) = (&self.clusters[i], &self.scene.clusters[i].entries[k]);
        let (at, more, zero) = (place.books[k], place.more.get(k), w.number(0.0));
        let out = |w: &mut Writer, k: usize| w.kept(place.output + k);
        let (mut supplied, mut dissipated, mut turnover, mut least) = (zero, zero, zero, zero);
        let mut own = None; // of it, what holds have no part in
        for (k, (_, slot)) in e.supplied.iter().enumerate() {
            let x = out(w, *slot);
            supplied = if k == 0 { x } else { w.add(supplied, x) };
            let size = w.abs(x);
            turnover = if k == 0 { size } else { w.add(turnover, size) };
            if e.held.contains(&k) {
                continue;
            }
            own = Some(own.map_or(x, |sum| w.add(sum, x)));
            if let Some(sums) = more.and_then(|m| m.sources) {
                w.gather(sums + 2 * k, x);
            }
        }
        if let Some(own) = &own {
            w.gather(at + SUPPLIED, *own);
        }
        let rolled = match more.and_then(|m| m.resistors) {
            None => row(&e.dissipated),
            Some(_) => None,
        };
        if let Some(first) = rolled {
            let (base, sums) = (place.output + first, [w.starting(0.0), w.holding(turnover), w.starting(0.0)]);
            w.each(e.dissipated.len(), |w, at| {
                let x = w.read(base, at);
                let [lost, turned, least] = sums.map(|v| w.get(v));
                let (lost, size) = (w.add(lost, x), w.abs(x));
                let (turned, below) = (w.add(turned, size), w.lt(x, least));
                let least = w.select(below, x, least);
                for (v, x) in sums.into_iter().zip([lost, turned, least]) {
                    w.set(v, x);
                }
            });
            [dissipated, turnover, least] = sums.map(|v| w.get(v));
        }
        let single = if rolled.is_some() { &[][..] } else { &e.dissipated[..] };
        for (k, (_, slot)) in single.iter().enumerate() {
            let x = out(w, *slot);
            dissipated = if k == 0 { x } else { w.add(dissipated, x) };
            let size = w.abs(x);
            turnover = if k == 0 && e.supplied.is_empty() { size } else { w.add(turnover, size) };
            let below = w.lt(x, least);
            least = w.select(below, x, least);
            if let Some(own) = more.and_then(|m| m.resistors) {
                w.gather(own + 2 * k, x);
            }
        }
        Terms { supplied, dissipated, turnover, least }
    }

    /// Books the step whose outputs are in the block.
    pub(super) fn book(&self, w: &mut Writer, i: usize) {
        let (c, place) = (&self.scene.clusters[i], &self.clusters[i]);
        for (k, (e, &at)) in c.entries.iter().zip(&place.books).enumerate() {
            let more = place.more.get(k);
            let zero = w.number(0.0);
            let out = |w: &mut Writer, k: usize| w.kept(place.output + k);
            let Terms { supplied, dissipated, turnover, least } = self.terms(w, i, k);
            if !e.dissipated.is_empty() {
                w.gather(at + DISSIPATED, dissipated);
            }
            let leap = e.leap.map_or(zero, |(slot, _)| out(w, slot));
            let h = out(w, e.energy);
            let last = w.kept(at + H);
            let before = e.before.map_or(last, |slot| out(w, slot));
            if e.before.is_some() && c.period.is_some() {
                // What time alone did to it.
                let (stored, more) = (w.kept(at + STORED), w.sub(before, last));
                let stored = w.add(stored, more);
                w.keep(at + STORED, stored);
            }
            let (rise, mut net) = (w.sub(h, before), w.sub(supplied, dissipated));
            if e.leap.is_some() {
                net = w.add(net, leap);
            }
            let residual = w.sub(rise, net);
            let own = w.abs(h);
            let size = if e.size == e.energy {
                own
            } else {
                let size = out(w, e.size);
                w.abs(size)
            };
            let held = w.abs(last);
            let mut scale = w.larger(size, held);
            if !(e.supplied.is_empty() && e.dissipated.is_empty()) {
                scale = w.larger(scale, turnover);
                w.raise(at + TURNOVER, turnover);
            }
            w.keep(at + H, h);
            let most = w.raise(at + H_MAX, own);
            if e.size == e.energy {
                w.keep(at + SIZE, most);
            } else {
                w.raise(at + SIZE, size);
            }
            let off = w.abs(residual);
            self.worst(w, i, k, false, off, scale);
            if !e.dissipated.is_empty() {
                let gave = w.lt(least, zero);
                w.when(gave, |w| {
                    if let Some(more) = more {
                        more.giver(w, place.output, e);
                    }
                    let given = w.unary(bond_runtime::ir::Unary::Neg, least);
                    self.worst(w, i, k, true, given, scale);
                });
            }
            let total = w.kept(at + RESIDUAL);
            let total = w.add(total, residual);
            w.keep(at + RESIDUAL, total);
            if let Some((_, count)) = e.leap {
                w.gather(at + LEAKED, leap);
                if let Some(more) = more {
                    let (x, before, one) = (out(w, count), w.kept(more.leaps), w.number(1.0));
                    let none = w.eq(x, zero);
                    let after = w.add(before, one);
                    let after = w.select(none, before, after);
                    w.keep(more.leaps, after);
                }
            }
            if more.is_some() || e.least != 0.0 {
                w.raise(at + H_TOP, h);
            }
            let sum = w.add(turnover, own);
            let sum = if e.size == e.energy { sum } else { w.add(sum, size) };
            let sound = w.finite(sum);
            w.when(sound.not(), |w| w.push(Stmt::Fail(Reason::NotFinite)));
        }
    }

    /// Looks whether an error is the worst so far beside its scale: of the balance, or of what resistors gave.
    fn worst(&self, w: &mut Writer, i: usize, k: usize, gained: bool, error: Value, scale: Value) {
        let place = &self.clusters[i];
        let at = place.books[k];
        let floor = |w: &mut Writer| {
            let (a, b, c) = (w.kept(at + H_MAX), w.kept(at + TURNOVER), w.kept(at + SIZE));
            let largest = w.larger(a, b);
            let largest = w.larger(largest, c);
            let trace = w.number(1e-4);
            w.mul(trace, largest)
        };
        let gross = (!gained && self.scene.clusters[i].step.linear.is_some()).then_some(GROSS);
        if let Some(more) = place.more.get(k) {
            return more.worst(w, if gained { more.gained } else { more.worst }, error, scale, floor, gross);
        }
        let slot = at + if gained { GAINED } else { WORST };
        let worst = w.kept(slot);
        let allowed = w.mul(worst, scale);
        let maybe = w.lt(allowed, error);
        w.when(maybe, |w| {
            let (floor, least) = (floor(w), w.number(LEAST));
            more::fail_above(w, error, scale, floor, gross);
            let floor = w.larger(floor, least);
            let scale = w.larger(scale, floor);
            let allowed = w.mul(worst, scale);
            let more = w.lt(allowed, error);
            w.when(more, |w| {
                let ratio = w.div(error, scale);
                w.keep(slot, ratio);
            });
        });
    }

    /// Books what crossed held ports, `all`, in the place of what the step's own effort would have let in.
    pub(super) fn settle(&self, w: &mut Writer, i: usize, all: &[Value]) {
        let (c, place) = (&self.scene.clusters[i], &self.clusters[i]);
        let zero = w.number(0.0);
        let mut turned = zero;
        for (r, (e, &at)) in c.entries.iter().zip(&place.books).enumerate() {
            let out = |w: &mut Writer, k: usize| w.kept(place.output + k);
            let more = place.more.get(r);
            let (mut called, mut crossed) = (zero, zero);
            let held = self.start.clusters[i].held.iter().zip(&place.held).zip(all);
            for (k, ((h, held), &own)) in held.filter(|((h, _), _)| c.ports[h.port].region == e.region).enumerate() {
                let port = &c.ports[h.port];
                let (q, mean) = (w.kept(held.q), out(w, port.mean));
                let x = w.mul(q, mean);
                called = if k == 0 { x } else { w.add(called, x) };
                crossed = if k == 0 { own } else { w.add(crossed, own) };
                let size = w.abs(own);
                turned = w.add(turned, size);
                let named = e.supplied.iter().position(|s| s.0 == port.name);
                if let (Some(k), Some(sources)) = (named, more.and_then(|m| m.sources)) {
                    w.gather(sources + 2 * k, own);
                }
            }
            if !e.held.is_empty() {
                let leak = w.sub(called, crossed);
                if let Some(more) = more {
                    let size = w.abs(crossed);
                    w.raise(more.crossed, size);
                }
                w.gather(at + SUPPLIED, crossed);
                w.gather(at + LEAKED, leak);
            }
            let mut stored = w.kept(at + STORED);
            if !e.held.is_empty() {
                stored = w.add(stored, crossed);
            }
            let sources = e.supplied.iter().enumerate().filter(|(k, _)| !e.held.contains(k)).map(|(_, s)| s.1);
            let mut own = None;
            for slot in sources {
                let x = out(w, slot);
                own = Some(own.map_or(x, |sum| w.add(sum, x)));
                let size = w.abs(x);
                turned = w.add(turned, size);
            }
            if let Some(own) = own {
                stored = w.add(stored, own);
            }
            w.keep(at + STORED, stored);
            if place.books.len() == 1 {
                let (h, stored, cap) = (w.kept(at + H), w.kept(at + STORED), cap(w, at, e));
                let most = w.add(h, cap);
                let over = w.lt(most, stored);
                let stored = w.select(over, most, stored);
                w.keep(at + STORED, stored);
            }
        }
        if place.books.is_empty() {
            return;
        }
        self.share(w, i);
        for (k, &at) in place.books.iter().enumerate() {
            let stored = w.kept(at + STORED);
            let debt = w.unary(bond_runtime::ir::Unary::Neg, stored);
            w.raise(at + DEBT, debt);
            if let Some(more) = place.more.get(k) {
                w.raise(more.stored, stored);
            }
        }
        w.raise(place.caution + 3, turned);
        let stored = self.stored(w, i);
        let debt = w.unary(bond_runtime::ir::Unary::Neg, stored);
        let crossed = all.iter().fold(zero, |sum, x| w.add(sum, *x));
        self.note_debt(w, i, debt, crossed);
    }

    /// What regions that hold together have to give is one: where one of them is in debt, the others' tanks cover that,
    /// and the cap is on all tanks together.
    fn share(&self, w: &mut Writer, i: usize) {
        let books = &self.clusters[i].books;
        if books.len() < 2 {
            return;
        }
        let zero = w.number(0.0);
        let tank = |w: &mut Writer, at: usize| {
            let (stored, h) = (w.kept(at + STORED), w.kept(at + H));
            w.sub(stored, h)
        };
        let (mut there, mut lacking) = (zero, zero);
        for &at in books {
            let own = w.kept(at + STORED);
            let below = w.lt(own, zero);
            let (more, less) = (w.add(there, own), w.sub(lacking, own));
            there = w.select(below.clone(), there, more);
            lacking = w.select(below, less, lacking);
        }
        let both = [w.lt(zero, there), w.lt(zero, lacking)];
        w.when(Cond::all(both), |w| {
            let less = w.lt(lacking, there);
            let cover = w.select(less, lacking, there);
            let (taken, given) = (w.div(cover, there), w.div(cover, lacking));
            for &at in books {
                let own = w.kept(at + STORED);
                let below = w.lt(own, zero);
                let part = w.select(below, given, taken);
                let moved = w.mul(own, part);
                let left = w.sub(own, moved);
                w.keep(at + STORED, left);
            }
        });
        let (mut over, mut full) = (zero, zero);
        for (&at, e) in books.iter().zip(&self.scene.clusters[i].entries) {
            let (tank, most) = (tank(w, at), cap(w, at, e));
            let more = w.sub(tank, most);
            over = w.add(over, more);
            let there = positive(w, tank);
            full = w.add(full, there);
        }
        let some = w.lt(zero, over);
        w.when(some, |w| {
            let part = w.div(over, full);
            for &at in books {
                let (stored, tank) = (w.kept(at + STORED), tank(w, at));
                let there = w.lt(zero, tank);
                let less = w.mul(tank, part);
                let less = w.sub(stored, less);
                let stored = w.select(there, less, stored);
                w.keep(at + STORED, stored);
            }
        });
    }

    /// What a debt does to what is trusted.
    fn note_debt(&self, w: &mut Writer, i: usize, debt: Value, crossed: Value) {
        let [peak, trust, risk, largest] = [0, 1, 2, 3].map(|k| self.clusters[i].caution + k);
        let (zero, one) = (w.number(0.0), w.number(1.0));
        let near = self.scene.near().swap_remove(i);
        let mut others = Vec::new();
        for &j in &near {
            let stored = self.stored(w, j);
            let debt = w.unary(bond_runtime::ir::Unary::Neg, stored);
            others.push(self.clear(w, j, debt));
        }
        let (lost, left) = (w.kept(peak), w.kept(trust));
        let easy = Cond::all([w.eq(lost, zero), w.eq(left, one)]);
        let own = self.clear(w, i, debt);
        w.branch(
            Cond::all([own, Cond::any([easy, Cond::all(others)])]),
            |w| {
                w.keep(peak, zero);
                w.keep(trust, one);
            },
            |w| {
                self.owe(w, i);
                let (most, left, risk) = (w.kept(peak), w.kept(trust), w.kept(risk));
                let out = w.unary(bond_runtime::ir::Unary::Neg, crossed);
                let all = w.lt(debt, out);
                let lost = w.select(all, debt, out);
                let (loss, largest) = (w.number(LOSS), w.kept(largest));
                let least = w.mul(loss, largest);
                let some = w.lt(least, lost);
                let wary = w.number(WARY);
                w.when(some, |w| {
                    let part = w.div(lost, risk);
                    let below = w.lt(part, one);
                    let part = w.select(below, part, one);
                    let more = w.mul(wary, part);
                    let more = w.add(one, more);
                    let left = w.div(left, more);
                    w.keep(trust, left);
                    // What it gave out, the others may lose too.
                    for &j in &near {
                        let theirs = self.clusters[j].caution + 1;
                        let left = w.kept(theirs);
                        let left = w.div(left, more);
                        w.keep(theirs, left);
                    }
                });
                let larger = w.lt(most, debt);
                let most = w.select(larger, debt, most);
                w.keep(peak, most);
            },
        );
    }

    /// Whether a debt is none but for rounding.
    fn clear(&self, w: &mut Writer, i: usize, debt: Value) -> Cond {
        let (loss, most) = (w.number(LOSS), w.kept(self.clusters[i].caution + 3));
        let least = w.mul(loss, most);
        w.le(debt, least)
    }

    /// Notes what debts are beside the energies that there were until now.
    fn owe(&self, w: &mut Writer, i: usize) {
        let place = &self.clusters[i];
        if place.more.is_empty() {
            return;
        }
        let mut largest = w.number(0.0);
        for (c, place) in self.scene.clusters.iter().zip(&self.clusters) {
            for (at, more) in place.books.iter().zip(&place.more) {
                let parts = [at + H_MAX, at + TURNOVER, at + SIZE];
                let alone = [more.stored];
                for &at in if c.period.is_some() { &alone[..] } else { &parts[..] } {
                    let x = w.kept(at);
                    largest = w.larger(largest, x);
                }
            }
        }
        let beside = w.number(BESIDE);
        let beside = w.mul(beside, largest);
        for (&at, more) in place.books.iter().zip(&place.more) {
            let (sum, rest) = (w.kept(at + SUPPLIED), w.kept(at + SUPPLIED + 1));
            let supplied = w.add(sum, rest);
            let mut scale = beside;
            for x in [w.kept(more.stored), w.kept(more.crossed), w.abs(supplied)] {
                scale = w.larger(scale, x);
            }
            let stored = w.kept(at + STORED);
            let debt = w.unary(bond_runtime::ir::Unary::Neg, stored);
            let part = w.div(debt, scale);
            w.raise(more.owed, part);
        }
    }

    /// What a cluster has to give; 0 where it has no ledger.
    pub(super) fn stored(&self, w: &mut Writer, i: usize) -> Value {
        let mut stored = w.number(0.0);
        for (k, &at) in self.clusters[i].books.iter().enumerate() {
            let own = w.kept(at + STORED);
            stored = if k == 0 { own } else { w.add(stored, own) };
        }
        stored
    }

    /// What of [`Self::stored`] is rounding.
    pub(super) fn noise(&self, w: &mut Writer, i: usize) -> Value {
        let (mut size, noise) = (w.number(0.0), w.number(NOISE));
        for (k, &at) in self.clusters[i].books.iter().enumerate() {
            let h = w.kept(at + H);
            let h = w.abs(h);
            size = if k == 0 { h } else { w.add(size, h) };
        }
        w.mul(noise, size)
    }
}

/// What may be given besides H at most.
fn cap(w: &mut Writer, at: usize, e: &Entries) -> Value {
    if e.least == 0.0 {
        return w.kept(at + H_MAX);
    }
    let (top, least) = (w.kept(at + H_TOP), w.kept(at + H_LEAST));
    let most = w.sub(top, least);
    w.sub(most, least)
}

/// Not below 0.
pub(super) fn positive(w: &mut Writer, x: Value) -> Value {
    let zero = w.number(0.0);
    let above = w.lt(zero, x);
    w.select(above, x, zero)
}

/// `a <= x <= b`, NaN becoming `a`.
pub(super) fn clamped(w: &mut Writer, x: Value, a: f64, b: f64) -> Value {
    let (low, high) = (w.number(a), w.number(b));
    let above: Cond = w.lt(low, x);
    let x = w.select(above, x, low);
    let below = w.lt(x, high);
    w.select(below, x, high)
}
