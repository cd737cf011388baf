//! A scene as one routine for a run within this program: it goes many intervals on, and keeps all that
//! `bond_runtime::simulate` keeps, to the same bits.

use super::specialisation::SpecialisationConstants;
use super::{Plan, Routines, Writing};
use crate::backend::code::Routine;
use bond_runtime::exponential;
use bond_runtime::scene::Scene;
use bond_runtime::simulate::{ClusterPlaces, Options, Places, Start};
use std::collections::BTreeSet;

/// Routines with more statements than this take longer to compile than most runs would gain.
const LARGEST: usize = 6000;

/// The routine, and what it works on.
#[derive(Clone, Debug)]
pub struct BlockProgram {
    /// As [`super::StandaloneModule::run`].
    pub run: Routine,
    /// Where everything is in its block.
    pub places: Places,
    /// Numbers that never change.
    pub table: Vec<f64>,
}

/// The routine of a scene that starts, or goes on, from here; None where a run of it looks at it in each interval,
/// steps its parts at different times, or is too large to gain. With `constants`, it is that of all scenes of its
/// [`super::code_shape`], which differ in [`BlockConstants`].
pub fn block_program(scene: &Scene, options: &Options, start: &Start, constants: bool) -> Option<BlockProgram> {
    let sampled = scene.clusters.iter().any(|c| c.period.is_some());
    let produced = scene.clusters.iter().flat_map(|c| &c.entries).any(|e| !e.produced.is_empty());
    let adaptive =
        options.tolerance.is_some() && scene.clusters.iter().any(|c| c.period.is_none() && c.step.linear.is_none());
    // What another stepper may have to take, or is kept beside H, is seen to step by step.
    let watched = scene.clusters.iter().any(|c| c.step.fallback.is_some())
        || scene.clusters.iter().flat_map(|c| &c.entries).any(|e| e.modified.is_some());
    // What is on its way in delays is not in the block of a run.
    let delayed = scene.clusters.iter().any(|c| !c.lines.is_empty());
    if !scene.open.is_empty() || delayed || produced || adaptive || watched || start.takes_tangents {
        return None;
    }
    let plan = Plan::new(scene, options, start).ok()?;
    let alone = scene.clusters.iter().zip(&start.clusters).any(|(c, s)| c.period.is_none() && !s.connected);
    if plan.ratio.iter().any(|r| *r != 1) || (sampled && alone) {
        return None;
    }
    let constants = constants.then(|| SpecialisationConstants::new(scene, start));
    let mut unit = Writing::new(scene, start, &plan, true, constants).ok()?;
    let places = unit.places();
    let kept: BTreeSet<u32> = (0..unit.block.image.len() as u32).collect();
    let Routines { run, .. } = unit.routines(&kept).ok()?;
    let run = run.filter(|r| r.size() <= LARGEST)?;
    Some(BlockProgram { run, places, table: unit.table })
}

/// In what a scene differs from others of its code shape.
#[derive(Clone, Debug, Default)]
pub struct BlockConstants {
    /// Where everything is, which is the same, and what is no place there.
    pub places: Places,
    /// See [`BlockProgram::table`].
    pub table: Vec<f64>,
    /// The routine's data.
    pub data: Vec<f64>,
}

impl BlockConstants {
    /// That of a scene, from the places of another of its code shape; None where an exact step cannot be prepared.
    pub fn new(scene: &Scene, start: &Start, places: &Places) -> Option<Self> {
        let (mut own, mut table) = (places.clone(), Vec::new());
        for ((c, s), p) in scene.clusters.iter().zip(&start.clusters).zip(&mut own.clusters) {
            if let Some(linear) = &c.step.linear {
                table.extend(exponential::table(linear, p.h).ok()?);
            }
            p.port_admittance.clone_from(&s.port_admittance);
            p.delayed_response.clone_from(&s.delayed_response);
            p.ar_coefficients.clone_from(&s.ar_coefficients);
        }
        Some(Self { places: own, table, data: SpecialisationConstants::new(scene, start).data })
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
            port_admittance: s.port_admittance.clone(),
            delayed_response: s.delayed_response.clone(),
            ar_coefficients: s.ar_coefficients.clone(),
            ledger: p.ledger,
            logs: p.layout.logs,
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
