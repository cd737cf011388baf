//! A scene as one routine for a run within this program: it goes many intervals on, and keeps all that
//! `bond_runtime::simulate` keeps, to the same bits.

use super::apart::Apart;
use super::{Plan, Routines, Writing, ledger};
use crate::backend::code::Routine;
use bond_runtime::exponential;
use bond_runtime::scene::Scene;
use bond_runtime::simulate::{BookPlaces, ClusterPlaces, HeldPlaces, Options, Places, Start};
use std::collections::BTreeSet;

/// Routines with more statements than this take longer to compile than most runs would gain.
const LARGEST: usize = 6000;

/// The routine, and what it works on.
#[derive(Clone, Debug)]
pub struct Stretch {
    /// As [`super::Unit::run`].
    pub run: Routine,
    /// Where everything is in its block.
    pub places: Places,
    /// Numbers that never change.
    pub table: Vec<f64>,
}

/// The routine of a scene that starts, or goes on, from here; None where a run of it looks at it in each interval,
/// steps its parts at different times, or is too large to gain. With `apart`, it is that of all scenes of its
/// [`super::code_shape`], which differ in [`Own`].
pub fn stretch(scene: &Scene, options: &Options, start: &Start, apart: bool) -> Option<Stretch> {
    let sampled = scene.clusters.iter().any(|c| c.period.is_some());
    let produced = scene.clusters.iter().flat_map(|c| &c.entries).any(|e| !e.produced.is_empty());
    let adaptive =
        options.tolerance.is_some() && scene.clusters.iter().any(|c| c.period.is_none() && c.step.linear.is_none());
    // What another stepper may have to take, or is kept beside H, is seen to step by step.
    let watched = scene.clusters.iter().any(|c| c.step.fallback.is_some())
        || scene.clusters.iter().flat_map(|c| &c.entries).any(|e| e.modified.is_some());
    if !scene.open.is_empty() || produced || adaptive || watched {
        return None;
    }
    let plan = Plan::new(scene, options, start).ok()?;
    let alone = scene.clusters.iter().zip(&start.clusters).any(|(c, s)| c.period.is_none() && !s.connected);
    if plan.ratio.iter().any(|r| *r != 1) || (sampled && alone) {
        return None;
    }
    let apart = apart.then(|| Apart::new(scene, start));
    let mut unit = Writing::new(scene, start, &plan, true, apart).ok()?;
    let places = unit.places();
    let kept: BTreeSet<u32> = (0..unit.block.image.len() as u32).collect();
    let Routines { run, .. } = unit.routines(&kept).ok()?;
    let run = run.filter(|r| r.size() <= LARGEST)?;
    Some(Stretch { run, places, table: unit.table })
}

/// In what a scene differs from others of its code shape.
#[derive(Clone, Debug, Default)]
pub struct Own {
    /// Where everything is, which is the same, and what is no place there.
    pub places: Places,
    /// See [`Stretch::table`].
    pub table: Vec<f64>,
    /// The routine's data.
    pub data: Vec<f64>,
}

impl Own {
    /// That of a scene, from the places of another of its code shape; None where an exact step cannot be prepared.
    pub fn new(scene: &Scene, start: &Start, places: &Places) -> Option<Self> {
        let (mut own, mut table) = (places.clone(), Vec::new());
        for ((c, s), p) in scene.clusters.iter().zip(&start.clusters).zip(&mut own.clusters) {
            if let Some(linear) = &c.step.linear {
                table.extend(exponential::table(linear, p.h).ok()?);
            }
            p.beta.clone_from(&s.beta);
            p.gamma.clone_from(&s.gamma);
            p.decay.clone_from(&s.decay);
        }
        Some(Self { places: own, table, data: Apart::new(scene, start).data })
    }
}

impl Writing<'_> {
    /// Where everything is that a run keeps.
    fn places(&self) -> Places {
        let clusters = self.clusters.iter().zip(&self.start.clusters).enumerate().map(|(i, (p, s))| ClusterPlaces {
            state: p.state,
            input: p.input,
            largest: p.largest,
            moved: p.moved,
            count: p.count,
            iterations: p.iterations.unwrap_or(0),
            h: self.plan.steps[i].h,
            steps: self.plan.steps[i].n,
            beta: s.beta.clone(),
            gamma: s.gamma.clone(),
            decay: s.decay.clone(),
            caution: p.caution,
            books: p.books.iter().zip(&p.more).map(|(at, m)| book(*at, m)).collect(),
            held: p.held.iter().map(held).collect(),
        });
        Places {
            image: self.block.image.clone(),
            time: self.time,
            given: self.given,
            interval: self.plan.interval,
            clusters: clusters.collect(),
        }
    }
}

fn book(at: usize, m: &super::more::More) -> BookPlaces {
    let [h, h_max, h_top, least, supplied, dissipated, leaked, residual, turnover, size, stored, debt] =
        ledger::KEPT.map(|k| at + k);
    BookPlaces {
        h,
        h_max,
        h_top,
        least,
        supplied,
        dissipated,
        leaked,
        residual,
        worst: m.worst,
        gained: m.gained,
        turnover,
        size,
        stored,
        stored_max: m.stored,
        debt,
        crossed: m.crossed,
        owed: m.owed,
        leaps: m.leaps,
        giver: m.giver,
        sources: m.sources,
        resistors: m.resistors,
    }
}

fn held(h: &super::places::Held) -> HeldPlaces {
    HeldPlaces {
        v: h.v,
        q: h.q,
        w: h.w,
        crossed: h.crossed,
        last_q: h.last_q,
        alpha: h.alpha,
        before: h.before,
        forecast: h.forecast,
        intervals: h.intervals,
        energy: h.energy,
    }
}
