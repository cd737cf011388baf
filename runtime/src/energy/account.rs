//! What a step does to the account of a region.

use super::{AccountPlaces, ErrorPlaces, Memory, Place, larger, positive};
use crate::kernel::Failure;
use crate::machine::{Flow, Machine, Number};
use crate::scene::Entries;

/// What the balance of a step is measured against at least, as a part of the largest energy that its region ever held
/// or turned over in a step: what is off by 1e-12 of that is the rounding of that energy.
const TRACE: f64 = 1e-4;
/// An exact step that is off by more than this part of the energy there says nothing.
pub const GROSS: f64 = 1e-3;

/// The largest energy that was held, or turned over in a step; of the largest magnitude, turnover and size.
#[inline]
pub fn largest<M: Machine>(m: M, [h_max, turnover_max, size_max]: [M::Number; 3]) -> M::Number {
    larger(m, larger(m, h_max, turnover_max), size_max)
}

/// What balances are measured against at least.
#[inline]
pub fn floor<M: Machine>(m: M, maxima: [M::Number; 3]) -> M::Number {
    m.number(TRACE) * largest(m, maxima)
}

/// Books a step: the outputs of the step go into the account. An `exact` step whose balance is grossly off is refused.
///
/// # Errors
/// The step is refused, and the account is what it was.
pub fn book_step<M: Machine, K: Memory<M>>(
    m: M,
    k: K,
    e: &Entries,
    p: &AccountPlaces,
    (sampled, exact): (bool, bool),
) -> Flow {
    let (zero, nothing) = (m.number(0.0), m.number(-0.0));
    let [supplied, own, turnover, given] = flows(m, k, e);
    let [dissipated, turnover, least] =
        k.fold(&e.dissipated, [nothing, turnover, zero], |w, [lost, turnover, least]| {
            [lost + w, turnover + w.abs(), m.select(w.below(least), w, least)]
        });
    let (h, last) = (k.output(e.energy), k.load(p.h));
    let signed = e.size != e.energy;
    let magnitude = h.abs();
    let size = if signed { k.output(e.size).abs() } else { magnitude };
    let mut sound = (turnover + size).is_finite();
    if signed {
        sound = sound & h.is_finite();
    }
    let off = e.modified.filter(|_| p.detail.is_some()).map(|slot| h - k.output(slot));
    if let Some(off) = off {
        sound = sound & off.is_finite();
    }
    for x in e.produced.iter().filter(|_| p.detail.is_some()) {
        sound = sound & k.output(x.heat).is_finite() & k.output(x.entropy).is_finite();
    }
    k.require(sound, Failure::Energy)?;
    let before = e.before.map_or(last, |slot| k.output(slot));
    let mut net = supplied - dissipated;
    if let Some((slot, _)) = e.leap {
        net = net + k.output(slot);
    }
    let residual = (h - before) - net;
    let flows = !(e.supplied.is_empty() && e.dissipated.is_empty());
    let mut scale = larger(m, size, last.abs());
    let (held, mut turned) = ([k.load(p.h_max), k.load(p.size_max)], k.load(p.turnover_max));
    if flows {
        scale = larger(m, scale, turnover);
        turned = larger(m, turned, turnover);
    }
    let h_max = larger(m, held[0], magnitude);
    // Where none can be negative, the magnitude of the whole is it.
    let size_max = if signed { larger(m, held[1], size) } else { h_max };
    let floor = || floor(m, [h_max, turned, size_max]);
    note_error(m, k, p.worst, [residual.abs(), scale], floor, exact)?;
    if let Some(d) = &p.detail {
        if let Some(off) = off {
            k.store(d.modified, off);
            k.raise(m, d.modified.plus(1), off.abs());
            // What is kept closes the balance: what H is more than that came from nothing. Nothing that comes later
            // excuses it, nor does H itself in this step, but what a source gives does.
            let excuse = larger(m, larger(m, larger(m, held[0], held[1]), given), m.number(e.faintest));
            let excess = -off;
            m.only((k.load(d.energy_excess) * excuse).below(excess), || {
                k.store(d.energy_excess, excess / excuse);
                k.store(d.energy_excess.plus(1), excess);
            });
        }
        if !e.produced.is_empty() {
            let heats = e.produced.iter().map(|x| k.output(x.heat));
            let fall = heats.fold(zero, |fall, heat| larger(m, fall, -heat));
            m.when(zero.below(fall), || note_error(m, k, d.second_law_violation, [fall, scale], floor, false))?;
        }
    }
    gather_elements(m, k, e, p);
    if !e.dissipated.is_empty() {
        k.gather(p.dissipated, dissipated);
        m.when(least.below(zero), || {
            if let Some(d) = &p.detail {
                note_negative_resistor(m, k, e, d.most_negative_resistor);
            }
            note_error(m, k, p.gained, [-least, scale], floor, false)
        })?;
    }
    if e.supplied.len() > e.held.len() {
        k.gather(p.supplied, own);
    }
    if e.before.is_some() && sampled {
        // What time alone did to it.
        k.add(p.stored, before - last);
    }
    if flows {
        k.store(p.turnover_max, turned);
    }
    k.store(p.h, h);
    k.store(p.h_max, h_max);
    k.store(p.size_max, size_max);
    if p.detail.is_some() || e.least != 0.0 {
        k.raise(m, p.h_top, h);
    }
    if let (Some(at), Some(work)) = (&p.work, &e.work) {
        let energy = k.output(work.energy);
        k.store(at.energy, energy);
        k.raise(m, at.top, energy);
    }
    k.add(p.residual, residual);
    if let Some((slot, count)) = e.leap {
        k.gather(p.leaked, k.output(slot));
        if let Some(d) = &p.detail {
            k.add(d.leaps, m.select(k.output(count).equals(zero), zero, m.number(1.0)));
        }
    }
    Ok(())
}

/// What sources supply in a step: all of it, what holds have no part in, the sum of the magnitudes, and what is given.
fn flows<M: Machine, K: Memory<M>>(m: M, k: K, e: &Entries) -> [M::Number; 4] {
    let [mut supplied, mut own, mut turnover, mut given] = [m.number(-0.0); 4];
    for (i, (_, slot)) in e.supplied.iter().enumerate() {
        let w = k.output(*slot);
        (supplied, turnover) = (supplied + w, turnover + w.abs());
        if e.modified.is_some() {
            given = given + positive(m, w);
        }
        if !e.held.contains(&i) {
            own = own + w;
        }
    }
    [supplied, own, turnover, given]
}

/// Books what single elements supplied, dissipated and produced.
fn gather_elements<M: Machine, K: Memory<M>>(_: M, k: K, e: &Entries, p: &AccountPlaces) {
    if let Some(sources) = p.sources.filter(|sources| *sources != p.supplied) {
        for (i, (_, slot)) in e.supplied.iter().enumerate().filter(|(i, _)| !e.held.contains(i)) {
            k.gather(sources.plus(2 * i), k.output(*slot));
        }
    }
    let Some(d) = &p.detail else { return };
    if d.resistors != p.dissipated {
        for (i, (_, slot)) in e.dissipated.iter().enumerate() {
            k.gather(d.resistors.plus(2 * i), k.output(*slot));
        }
    }
    for (i, x) in e.produced.iter().enumerate() {
        k.gather(d.produced.plus(2 * i), k.output(x.entropy));
    }
}

/// Notes which resistor gave most, where one gave.
fn note_negative_resistor<M: Machine, K: Memory<M>>(m: M, k: K, e: &Entries, at: Place) {
    for (i, (_, slot)) in e.dissipated.iter().enumerate() {
        let w = k.output(*slot);
        m.only(w.below(k.load(at.plus(1))), || {
            k.store(at, m.number(i as f64));
            k.store(at.plus(1), w);
        });
    }
}

/// Notes an error beside its scale, where it may be the worst so far. Where the step is `exact`, one that is grossly
/// off ends it.
fn note_error<M: Machine, K: Memory<M>>(
    m: M,
    k: K,
    at: ErrorPlaces,
    [error, scale]: [M::Number; 2],
    floor: impl Fn() -> M::Number,
    exact: bool,
) -> Flow {
    let refuse = |floor: M::Number| match exact {
        true => k.require(!(m.number(GROSS) * larger(m, scale, floor)).below(error), Failure::GrossBalance),
        false => Ok(()),
    };
    match at {
        ErrorPlaces::Ratio(at) => {
            let worst = k.load(at);
            m.when((worst * scale).below(error), || {
                let floor = floor();
                refuse(floor)?;
                let scale = larger(m, scale, floor);
                m.only((worst * scale).below(error), || k.store(at, error / scale));
                Ok(())
            })
        }
        ErrorPlaces::Tops(at, log) => {
            let below = |top: Place| error.at_most(k.load(top)) & error.at_most(k.load(top.plus(1)) * scale);
            let known = below(at) | below(at.plus(2));
            m.when(!known, || {
                let floor = floor();
                refuse(floor)?;
                let zero = m.number(0.0);
                let relative = m.select(zero.below(error), error / scale, zero);
                for (larger, at) in [(k.load(at).below(error), at), (k.load(at.plus(3)).below(relative), at.plus(2))] {
                    m.only(larger, || {
                        k.store(at, error);
                        k.store(at.plus(1), relative);
                    });
                }
                k.note(log, at, [error, scale, floor]);
                Ok(())
            })
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing::{account, at};
    use super::super::{Booking, DetailPlaces, Ledger};
    use super::*;
    use crate::machine::Real;
    use crate::scene::Produced;
    use std::cell::Cell;

    /// What a run keeps besides.
    fn detail() -> DetailPlaces {
        DetailPlaces {
            stored_max: at(20),
            crossed_max: at(21),
            relative_debt: at(22),
            leaps: at(23),
            most_negative_resistor: at(24),
            second_law_violation: ErrorPlaces::Ratio(at(26)),
            modified: at(27),
            energy_excess: at(29),
            resistors: at(33),
            produced: at(35),
        }
    }

    /// Books a step with these outputs in a region that had nothing.
    fn book(e: &Entries, p: &AccountPlaces, output: &[f64]) -> Ledger {
        let mut ledger = Ledger::default();
        ledger.numbers.resize(40, Cell::new(0.0));
        let booking = Booking { ledger: &ledger, output };
        assert!(book_step(Real::new(), booking, e, p, (false, false)).is_ok());
        ledger
    }

    /// 2 J are put in, and the energy that is kept is as much. Where H is 3 J, what it is above that counts beside what
    /// was given.
    #[test]
    fn what_is_given_excuses_an_energy_that_is_too_large() {
        let p = AccountPlaces { sources: Some(at(31)), detail: Some(detail()), ..account() };
        let supplied = vec![("push".into(), 1)];
        let e = Entries { modified: Some(2), faintest: 0.1, supplied, ..Entries::default() };
        let ledger = book(&e, &p, &[2.0, 2.0, 3.0]);
        assert_eq!([ledger.get(at(27)), ledger.get(at(28))], [-1.0, 1.0]);
        assert_eq!([ledger.get(at(29)), ledger.get(at(30))], [0.5, 1.0]);
        // Of what was taken out nothing is an excuse.
        let ledger = book(&e, &p, &[-2.0, -2.0, 3.0]);
        assert_eq!([ledger.get(at(29)), ledger.get(at(30))], [50.0, 5.0]);
    }

    /// Of two fields whose entropies fall and grow it is the fall that counts, beside what is turned over.
    #[test]
    fn a_fall_of_entropy_is_noted() {
        let p = AccountPlaces { sources: Some(at(31)), detail: Some(detail()), ..account() };
        let field = |n: usize| Produced { name: format!("field {n}"), entropy: 2 * n, heat: 2 * n + 1 };
        let e =
            Entries { supplied: vec![("heat".into(), 0)], produced: vec![field(1), field(2)], ..Entries::default() };
        let ledger = book(&e, &p, &[8.0, 0.0, -0.01, -2.0, 0.04, 6.0]);
        assert_eq!(ledger.get(at(26)), 2.0 / 8.0);
        assert_eq!([ledger.get(at(35)), ledger.get(at(37))], [-0.01, 0.04]);
        assert_eq!(book(&e, &p, &[8.0, 0.0, 0.01, 2.0, 0.04, 6.0]).get(at(26)), 0.0);
    }

    /// An energy that may be below 0 has a top of its own, with or without what a run keeps besides.
    #[test]
    fn the_top_of_an_energy_with_a_least_is_kept() {
        let supplied = vec![("push".into(), 0)];
        for (least, top) in [(-1.0, 3.0), (0.0, 0.0)] {
            let e = Entries { least, supplied: supplied.clone(), ..Entries::default() };
            assert_eq!(book(&e, &account(), &[3.0]).get(at(16)), top, "{least}");
        }
        let e = Entries { supplied, ..Entries::default() };
        let p = AccountPlaces { sources: Some(at(31)), detail: Some(detail()), ..account() };
        assert_eq!(book(&e, &p, &[3.0]).get(at(16)), 3.0);
    }
}
