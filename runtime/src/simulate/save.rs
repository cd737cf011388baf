//! The whole state of a run as bytes, and a run that goes on from them, bit for bit.
//!
//! What is kept is all that a later step reads: states, what is held and predicted, the ledger, and the grids of steps.
//! Workspaces and tables are not: the next run reads nothing of the first, and makes the second again.

use super::cluster::Run;
use super::controller::{Control, Fit};
use super::delay_line::DelayLines;
use super::hold::{Held, Report};
use super::input_signal::{ClusterInputs, InputSignal};
use super::stepping::Stepping;
use super::trial::{Taken, copy};
use super::watched::Most;
use super::{Error, Options, Simulation};
use crate::energy::{AR_COEFFICIENTS, AR_ORDER, Ledger};
use crate::envelope::{self, Damaged, Kind};
use crate::kernel::Backend;
use crate::scene::{Made, Scene};
use serde::{Deserialize, Serialize};
use thiserror::Error as Failure;

/// Why a run cannot go on from saved bytes.
#[derive(Clone, Debug, PartialEq, Failure)]
pub enum Refused {
    /// The bytes are no state.
    #[error("{0}")]
    Damaged(#[from] Damaged),
    /// It is of another model.
    #[error("it is the state of `{saved}`, and this is `{here}`")]
    Model {
        /// The model that was saved.
        saved: String,
        /// The model that should go on.
        here: String,
    },
    /// It is of the same model in another form.
    #[error(
        "it is the state of another `{0}`: the text, a parameter or a method has changed since, or another version compiled it"
    )]
    Changed(String),
    /// The lists in it have other lengths than those of the scene.
    #[error("its part {0} does not fit the model")]
    Shape(&'static str),
    /// The scene itself does not start.
    #[error("{0}")]
    Start(#[from] Error),
}

/// What is written.
#[derive(Serialize, Deserialize)]
struct Saved {
    model: String,
    fingerprint: u64,
    made: Made,
    options: Options,
    time: f64,
    last_sample: f64,
    clusters: Vec<Part>,
    open: Vec<Report>,
    given: Vec<InputSignal>,
}

/// What is written of a cluster.
#[derive(Serialize, Deserialize)]
struct Part {
    state: Vec<f64>,
    input: Vec<f64>,
    /// Where it is not what the scene was given: of a run whose inputs were set on the way.
    signals: Option<ClusterInputs>,
    /// What is on its way in delays.
    lines: DelayLines,
    ledger: Ledger,
    /// What was drawn where an expectation looks.
    watched: Vec<Most>,
    steps: u64,
    iterations: u64,
    base: f64,
    count: u64,
    h: f64,
    /// Where its steps are fitted.
    fit: Option<SavedFit>,
    largest: Vec<f64>,
    held: Vec<Held>,
    port_admittance: Vec<f64>,
    delayed_response: Vec<f64>,
    ar_coefficients: Vec<f64>,
    next: u64,
    moved: Vec<f64>,
}

/// What is written of fitted steps.
#[derive(Serialize, Deserialize)]
struct SavedFit {
    control: Control,
    /// The next instant that is met.
    limit: f64,
    /// What moved through the integrals.
    through: Vec<f64>,
    /// The largest that guards were.
    tops: Vec<f64>,
    /// The first half of the step within which was looked last, where that was looked at from its end.
    half: Option<Taken>,
}

/// What the scene whose state was saved was made for.
///
/// # Errors
/// Bytes that are no state.
pub fn made(bytes: &[u8]) -> Result<Made, Damaged> {
    let saved: Saved = envelope::open(Kind::State, bytes)?;
    Ok(saved.made)
}

impl Simulation<'_> {
    /// The whole state, as bytes. Saving changes nothing.
    ///
    /// # Errors
    /// In words; no run is known that gives one.
    pub fn save(&self) -> Result<Vec<u8>, String> {
        let saved = Saved {
            model: self.scene.name.clone(),
            fingerprint: self.scene.fingerprint()?,
            made: self.scene.made,
            options: self.options.clone(),
            time: self.time,
            last_sample: self.last_sample,
            clusters: (0..self.runs.len()).map(|i| self.part(i)).collect(),
            open: self.open.clone(),
            given: self.given.clone(),
        };
        envelope::seal(Kind::State, &saved)
    }

    fn part(&self, i: usize) -> Part {
        let run = &self.runs[i];
        let fed = ClusterInputs::new(&self.scene.clusters[i], &self.given, &self.options);
        let (fit, iterations) = match &self.stepping[i] {
            Stepping::Fixed(_) => (None, run.iterations()),
            Stepping::Fitted(fit) => {
                let (control, iterations) = fit.kept(run.iterations());
                let (through, tops) = (fit.moved.clone(), fit.tops.clone());
                let half = (fit.shown == Some(self.time) && fit.midway).then(|| fit.half.clone());
                (Some(SavedFit { control, limit: fit.limit, through, tops, half }), iterations)
            }
        };
        Part {
            state: run.state.clone(),
            input: run.input.clone(),
            signals: (run.signals.without_lines() != fed.without_lines()).then(|| run.signals.without_lines()),
            lines: run.signals.lines.clone(),
            ledger: run.ledger.clone(),
            watched: run.watched.iter().map(|d| d.most).collect(),
            steps: run.steps,
            iterations,
            base: run.base,
            count: run.count,
            h: run.h,
            fit,
            largest: run.largest.clone(),
            held: self.held[i].clone(),
            port_admittance: self.port_admittance[i].clone(),
            delayed_response: self.delayed_response[i].clone(),
            ar_coefficients: self.ar_coefficients[i].clone(),
            next: self.next[i],
            moved: self.moved[i].clone(),
        }
    }
}

impl<'a> Simulation<'a> {
    /// A run that goes on from what [`Self::save`] gave, with the step and the tolerance that it had. Signals given
    /// from outside are what they were, but for the signals listed with their index.
    ///
    /// # Errors
    /// Bytes that are damaged, or the state of another scene.
    pub fn resume(
        backend: &dyn Backend,
        scene: &'a Scene,
        bytes: &[u8],
        signals: Vec<(usize, InputSignal)>,
    ) -> Result<Self, Refused> {
        let saved: Saved = envelope::open(Kind::State, bytes)?;
        if saved.model != scene.name {
            return Err(Refused::Model { saved: saved.model, here: scene.name.clone() });
        }
        let here = scene.fingerprint().map_err(|e| Refused::Damaged(Damaged::Meaning(e)))?;
        if saved.fingerprint != here {
            return Err(Refused::Changed(saved.model));
        }
        let good = |x: f64| x.is_finite() && x >= 0.0;
        if !good(saved.time) || !good(saved.last_sample) || !good(saved.options.default_step) {
            return Err(Refused::Shape("time"));
        }
        let mut sim = Self::on(backend, scene, &saved.options, Vec::new())?;
        same("the clusters", &saved.clusters, &sim.runs)?;
        same("the open ports", &saved.open, &sim.open)?;
        same("the inputs", &saved.given, &sim.given)?;
        sim.given = saved.given;
        for (i, signal) in signals {
            if let Some(place) = sim.given.get_mut(i) {
                *place = signal;
            }
        }
        for (i, part) in saved.clusters.into_iter().enumerate() {
            sim.put(i, part)?;
        }
        sim.open = saved.open;
        sim.time = saved.time;
        sim.last_sample = saved.last_sample;
        sim.look_again();
        Ok(sim)
    }

    fn put(&mut self, i: usize, mut part: Part) -> Result<(), Refused> {
        let c = &self.scene.clusters[i];
        let run = &mut self.runs[i];
        same("the states", &part.state, &run.state)?;
        same("the inputs", &part.input, &run.input)?;
        if !part.ledger.alike(&run.ledger) {
            return Err(Refused::Shape("the ledger"));
        }
        same("the expectations", &part.watched, &run.watched)?;
        same("the traces", &part.largest, &run.largest)?;
        same("what is held", &part.held, &self.held[i])?;
        if part.held.iter().zip(&self.held[i]).any(|(a, b)| (a.bar, a.open) != (b.bar, b.open)) {
            return Err(Refused::Shape("what is held"));
        }
        for (saved, own) in [
            (&part.port_admittance, &self.port_admittance[i]),
            (&part.delayed_response, &self.delayed_response[i]),
            (&part.ar_coefficients, &self.ar_coefficients[i]),
        ] {
            same("what is predicted", saved, own)?;
        }
        // So many weights are read.
        let mut orders = part.ar_coefficients.chunks(AR_COEFFICIENTS).filter_map(|rule| rule.last());
        if !orders.all(|order| (1..=AR_ORDER).any(|n| *order == n as f64)) {
            return Err(Refused::Shape("what is predicted"));
        }
        same("the ports", &part.moved, &self.moved[i])?;
        let signals = ClusterInputs::new(c, &self.given, &self.options);
        match part.signals.take() {
            None => run.signals = signals.clone(),
            Some(saved) if saved.alike(&signals) => run.signals = saved,
            Some(_) => return Err(Refused::Shape("the inputs")),
        }
        if !part.lines.alike(&signals.lines) {
            return Err(Refused::Shape("the delays"));
        }
        run.signals.lines = std::mem::take(&mut part.lines);
        if !(positive(part.h) && part.base.is_finite()) {
            return Err(Refused::Shape("the steps"));
        }
        match (&mut self.stepping[i], &part.fit) {
            (Stepping::Fixed(_), None) => {}
            (Stepping::Fitted(fit), Some(saved)) => saved.put(fit)?,
            _ => return Err(Refused::Shape("the steps")),
        }
        part.fill(run);
        self.held[i] = part.held;
        self.port_admittance[i] = part.port_admittance;
        self.delayed_response[i] = part.delayed_response;
        self.ar_coefficients[i] = part.ar_coefficients;
        if let Some(p) = &mut self.transitions[i] {
            p.find_port_admittances(
                self.held[i].len(),
                &self.port_admittance[i],
                &self.delayed_response[i],
                &self.ar_coefficients[i],
            );
        }
        self.next[i] = part.next;
        self.moved[i] = part.moved;
        Ok(())
    }
}

impl Part {
    /// Gives a cluster what is its own.
    fn fill(&self, run: &mut Run) {
        run.state.copy_from_slice(&self.state);
        run.input.copy_from_slice(&self.input);
        run.ledger.clone_from(&self.ledger);
        run.watched.iter_mut().zip(&self.watched).for_each(|(d, most)| d.most = *most);
        run.steps = self.steps;
        run.step.work.newton_iterations = self.iterations;
        run.base = self.base;
        run.count = self.count;
        run.h = self.h;
        run.largest.copy_from_slice(&self.largest);
    }
}

impl SavedFit {
    /// Gives fitted steps what is their own.
    fn put(&self, fit: &mut Fit) -> Result<(), Refused> {
        let half = self.half.as_ref().map_or(1.0, |half| half.h);
        if !(positive(self.control.ahead) && positive(half) && self.limit.is_finite()) {
            return Err(Refused::Shape("the steps"));
        }
        same("the integrals", &self.through, &fit.moved)?;
        same("the switches", &self.tops, &fit.tops)?;
        fit.midway = self.half.is_some();
        if let Some(half) = &self.half {
            same("the steps", &half.next, &fit.half.next)?;
            same("the steps", &half.output, &fit.half.output)?;
            copy(half, &mut fit.half);
        }
        fit.control = self.control;
        fit.limit = self.limit;
        fit.moved.copy_from_slice(&self.through);
        fit.tops.copy_from_slice(&self.tops);
        Ok(())
    }
}

fn positive(x: f64) -> bool {
    x.is_finite() && x > 0.0
}

/// Lists of one length.
fn same<A, B>(what: &'static str, saved: &[A], own: &[B]) -> Result<(), Refused> {
    if saved.len() == own.len() { Ok(()) } else { Err(Refused::Shape(what)) }
}
