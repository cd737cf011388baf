//! A whole scene as one block of numbers and three routines: begin an interval, end it, look. What runs without this
//! program is made of it: C text and object files.
//!
//! It does what `bond_runtime::simulate` does at fixed steps, operation by operation, so that its numbers are the same.
//! What it does not have: admittances that are taken anew at each sample, adaptive steps, steps that are halved where
//! Newton's method fails (they end the interval), tables of inputs, ledgers of single elements, outsides that are
//! silent. Steps that neither meet the samples nor are concerned by them are laid between them.

mod block;
mod block_program;
mod budget;
mod delay_line;
mod memory;
mod past;
mod places;
mod sample;
mod scalar_promotion;
mod specialisation;
mod step;

use super::code::{Cond, Memory, Place, Reason, Routine, Stmt, Value, size};
use super::if_conversion::{ConversionOptions, LaneForm, lane_forms};
use super::lower::writer::{At, Writer, scratch};
use super::lower::{Solvers, with_solvers, write};
use block::Block;
use bond_runtime::energy::PortResponse;
use bond_runtime::exponential;
use bond_runtime::history::{NODES, Shape};
use bond_runtime::interpreter::Interpret;
use bond_runtime::ir::{Array, Program};
use bond_runtime::scene::{GIVEN, Scene};
use bond_runtime::simulate::{Options, Simulation, Start, paced};
use places::Cluster;
use scalar_promotion::{Promoted, Uses, promote};
use specialisation::SpecialisationConstants;
use std::collections::BTreeSet;
use std::ops::Range;

/// A scene ready to be printed as a program of its own.
#[derive(Clone, Debug)]
pub struct StandaloneModule {
    /// The model's name.
    pub name: String,
    /// Length of an interval, s: the longest time of which all periods are multiples, or the step where nothing is
    /// sampled.
    pub interval: f64,
    /// The block at the start.
    pub image: Vec<f64>,
    /// So many of its first numbers go from interval to interval; the others are made anew before they are read.
    pub kept: usize,
    /// Numbers that never change.
    pub table: Vec<f64>,
    /// Ends the interval that runs, and begins the next one. [`Memory::State`] is the block; [`Memory::Input`] is, for
    /// each open port, how far the outside moved, or for one of a continuous region, what it gives.
    pub commit: Routine,
    /// Whether an interval that fails has changed nothing of the block.
    pub whole: bool,
    /// States that [`Self::commit`] leaves where they are and puts the new ones elsewhere: who runs it takes these for
    /// the old ones, where it did not fail.
    pub late: Vec<Late>,
    /// A number that is 0 at the start, for who exchanges the places of [`Self::late`]; not one that is saved.
    pub turned: usize,
    /// Goes so many intervals on as [`Memory::Input`] tells, and leaves in [`Memory::Output`] how many it has gone
    /// where it fails; then it has changed nothing of the block. None where there are open ports, or a scene is too
    /// large to be gone through without looking into the block.
    pub run: Option<Routine>,
    /// An interval of many scenes side by side, where the numbers of the block are few enough for that; first without
    /// what few scenes do.
    pub lane_forms: Vec<LaneForm>,
    /// Looks: [`Memory::Output`] gets the probes.
    pub observe: Routine,
    /// Takes the first samples anew, of a block that is as at the start but for what is given from outside. None where
    /// these do not depend on that.
    pub begin: Option<Routine>,
    /// How many numbers of scratch the routines take, one after the other, and where those of [`Self::observe`] begin:
    /// beyond those of [`Self::commit`] where factors stay there.
    pub scratch: usize,
    /// See above.
    pub observe_scratch: usize,
    /// Open ports: name, unit-free place in the block of what is held or given out, and whether a sampled region holds
    /// it.
    pub open: Vec<Open>,
    /// Signals given from outside, one after the other in the block.
    pub inputs: Vec<Given>,
    /// Names of the probes.
    pub probes: Vec<String>,
    /// Regions and where their ledgers are.
    pub regions: Vec<Region>,
    /// The place of the time, s.
    pub time: usize,
}

/// An open port of a unit.
#[derive(Clone, Debug)]
pub struct Open {
    /// Its name.
    pub name: String,
    /// Whether a sampled region holds it.
    pub held: bool,
    /// Where what is held is, or, of a continuous region, the mean of what it gave out over the last interval.
    pub at: usize,
    /// What is given out is this times the number there.
    pub sign: f64,
}

/// A signal given from outside.
#[derive(Clone, Debug)]
pub struct Given {
    /// Its path.
    pub name: String,
    /// Place of its value.
    pub at: usize,
}

/// A region's ledger in the block: one number each.
#[derive(Clone, Debug)]
pub struct Region {
    /// Its name.
    pub name: String,
    /// Where its ledger begins: in the order of [`NAMES`].
    pub at: usize,
}

/// Many states of a region.
#[derive(Clone, Debug)]
pub struct Late {
    /// Where they are.
    pub state: Range<usize>,
    /// Where the first of the new ones is.
    pub next: usize,
}

pub use block_program::{BlockConstants, BlockProgram, block_program};
pub use bond_runtime::energy::ACCOUNT as NAMES;
pub use specialisation::code_shape;

/// The unit of a scene, at fixed steps.
///
/// # Errors
/// In words: what of the scene has no form as a unit, and what to do about it.
pub fn module(scene: &Scene, options: &Options) -> Result<StandaloneModule, String> {
    if options.tolerance.is_some() && scene.clusters.iter().any(|c| c.period.is_none() && c.step.linear.is_none()) {
        return Err("a compiled scene takes fixed steps: give one with --step, or in the model's `simulate`".into());
    }
    let simulation = Simulation::on(&Interpret, scene, options, Vec::new()).map_err(|e| e.to_string())?;
    let start = simulation.start();
    let plan = Plan::new(scene, options, &start)?;
    let mut unit = Writing::new(scene, &start, &plan, false, None)?;
    let (time, given) = (unit.time, unit.given);
    let (observe, looked) = unit.observe()?;
    let begin = unit.begin()?;
    let mut kept = unit.public();
    kept.extend(looked);
    let Routines { commit, whole, run } = unit.routines(&kept)?;
    let turned = unit.block.take(1);
    let open = (0..scene.open.len()).map(|o| unit.open(o)).collect();
    let inputs = scene.inputs.iter().enumerate().map(|(i, s)| Given { name: s.name.clone(), at: given + i }).collect();
    let regions = unit.regions();
    let lane_forms = if whole { lane_forms(&commit, ConversionOptions::default()) } else { Vec::new() };
    let keeps_factors = !commit.systems.is_empty();
    let few = |routine| with_solvers(routine, Solvers::AllButLines);
    let [commit, observe] = [commit, observe].map(few);
    let [run, begin] = [run, begin].map(|routine| routine.map(few));
    let size = |routine: &Routine| with_solvers(routine.clone(), Solvers::All).scratch as usize;
    // Nothing that is in use when the first samples are taken has to stay.
    let most = [&run, &begin].into_iter().flatten().map(size).fold(size(&commit), usize::max);
    let observe_scratch = if keeps_factors { most } else { 0 };
    let scratch = most.max(observe_scratch + size(&observe)).max(1);
    Ok(StandaloneModule {
        name: scene.name.clone(),
        interval: plan.interval,
        image: unit.block.image,
        kept: unit.kept,
        table: unit.table,
        commit,
        whole,
        late: unit.late,
        turned,
        run,
        lane_forms,
        observe,
        begin,
        scratch,
        observe_scratch,
        open,
        inputs,
        probes: scene.probes.names.clone(),
        regions,
        time,
    })
}

/// Routines with more statements than this look into the block: a compiler would not keep so much elsewhere.
const LARGEST: usize = 20_000;

/// See [`StandaloneModule`].
struct Routines {
    commit: Routine,
    whole: bool,
    run: Option<Routine>,
}

/// How a scene's clusters step, known before it runs.
struct Plan {
    interval: f64,
    /// The step that was asked for, s.
    wanted: f64,
    /// By cluster: of a sampled one, intervals a period.
    ratio: Vec<u32>,
    /// By cluster.
    steps: Vec<Steps>,
}

/// How a cluster steps in an interval.
#[derive(Clone, Copy)]
struct Steps {
    /// Length of a step, s; of a sampled cluster, its period.
    h: f64,
    /// How many make an interval.
    n: u32,
    /// Whether their instants are multiples of their length, rather than counted from the interval's start.
    own: bool,
}

/// So many steps at most are laid in an interval, or kept of a delay.
const MOST_STEPS: usize = 1_000_000;

/// Parts of a period that are rounding: instants so close are one.
const SAME: f64 = 1e-12;

impl Plan {
    fn new(scene: &Scene, options: &Options, start: &Start) -> Result<Self, String> {
        let periods = scene.clusters.iter().filter_map(|c| c.period);
        let wanted = options.step.unwrap_or(options.default_step);
        let sampled = periods.clone().next().is_some();
        let interval = common(periods).unwrap_or(wanted);
        if let Some(c) = paced(scene).map(|i| &scene.clusters[i]) {
            return Err(format!(
                "`{}` holds for a sampled region whose period is in no whole ratio to its own: such scenes have no compiled form; make one period a multiple of the other, or take --emit exe",
                c.name
            ));
        }
        if let Some(c) = scene.clusters.iter().find(|c| c.latency > 0.0) {
            return Err(format!(
                "`{}` has a latency: such scenes have no compiled form; leave it to the program that calls, and take it out here, or take --emit exe",
                c.name
            ));
        }
        if let Some(w) = scene.waves.first() {
            return Err(format!(
                "the port `{}` carries waves: such scenes have no compiled form; take --emit exe, whose `serve` exchanges them",
                w.name
            ));
        }
        let open = scene.open.iter().map(|o| (&o.name, o.resolution));
        let mut read = scene.bars.iter().map(|b| (&b.name, b.resolution)).chain(open);
        if let Some((name, _)) = read.find(|(_, resolution)| *resolution > 0.0) {
            return Err(format!(
                "the motion at `{name}` is read in steps: such scenes have no compiled form; take the resolution out, or take --emit exe"
            ));
        }
        let (mut ratio, mut steps) = (Vec::new(), Vec::new());
        for (c, s) in scene.clusters.iter().zip(&start.clusters) {
            let period = c.period.unwrap_or(interval);
            if !is_multiple(period, interval) {
                return Err(format!(
                    "the period {period} s of `{}` and the shortest one have no common measure of at least a hundredth of that: such scenes have no compiled form; make one a multiple of the other, or take --emit exe",
                    c.name
                ));
            }
            ratio.push((period / interval).round() as u32);
            if c.period.is_none() && c.step.linear.is_some() && c.guards.is_some() {
                return Err(format!(
                    "`{}` has a source that switches inside exact steps: such scenes have no compiled form; take --method gonzalez, or --emit exe",
                    c.name
                ));
            }
            steps.push(match c.period {
                Some(period) => Steps { h: period, n: 1, own: false },
                None if !sampled => Steps { h: wanted, n: 1, own: true },
                None => Self::between(interval, c, s.connected, options)?,
            });
        }
        for (c, s) in scene.clusters.iter().zip(&steps) {
            let all = past::delays(c);
            if let Some(delay) = all.iter().find(|d| Shape::room(**d, (s.h, wanted), &all) > MOST_STEPS) {
                return Err(format!(
                    "`{}` has a delay of {delay} s, for which more than {MOST_STEPS} steps of {} s would be kept: give longer ones with --step",
                    c.name, s.h
                ));
            }
        }
        Ok(Self { interval, wanted, ratio, steps })
    }

    /// The steps of a continuous cluster beside sampled ones. One that no sample concerns has steps of its own length,
    /// where they meet the samples; else they would have to be cut for whoever looks, and are laid between two samples
    /// as the others are.
    fn between(
        interval: f64,
        c: &bond_runtime::scene::Cluster,
        connected: bool,
        options: &Options,
    ) -> Result<Steps, String> {
        let whole = c.step.linear.is_some() && c.step.properties.order == 0;
        let usual = options.step.unwrap_or(options.default_step);
        let h = options.step.unwrap_or(if whole && connected { interval } else { options.default_step });
        let n = (interval / h - 1e-9).ceil().max(1.0);
        if n > MOST_STEPS as f64 {
            return Err(format!(
                "steps of {h} s make {n:e} in an interval of {interval} s: give longer ones with --step"
            ));
        }
        let laid = interval / n;
        let own = !connected && (n * h - interval).abs() <= SAME * interval;
        // Lengths that differ by the rounding of an instant are one, that which was asked for.
        let same = (laid - usual).abs() <= (4.0 * f64::EPSILON * interval).min(1e-6 * laid);
        Ok(Steps { h: if own || same { usual } else { laid }, n: n as u32, own })
    }
}

/// The longest time of which all periods are multiples, where it is not far shorter than they are; else the shortest.
fn common(periods: impl Iterator<Item = f64> + Clone) -> Option<f64> {
    let shortest = periods.clone().min_by(f64::total_cmp)?;
    let parts = (1..=FINEST).map(|n| shortest / f64::from(n));
    Some(parts.into_iter().find(|t| periods.clone().all(|p| is_multiple(p, *t))).unwrap_or(shortest))
}

/// Whether a period is a multiple of a time, but for rounding.
fn is_multiple(period: f64, time: f64) -> bool {
    (period - (period / time).round() * time).abs() <= SAME * period
}

/// The shortest period has so many intervals at most.
const FINEST: u32 = 100;

/// A unit on its way.
struct Writing<'a> {
    scene: &'a Scene,
    start: &'a Start,
    plan: &'a Plan,
    time: usize,
    /// Places of the signals given from outside, and of what open ports of continuous regions gave out on average.
    given: usize,
    means: usize,
    /// Whether all is kept that `bond_runtime::simulate` keeps, for a run within this program.
    full: bool,
    /// Numbers that do not stand in the code.
    constants: Option<SpecialisationConstants<'a>>,
    clusters: Vec<Cluster>,
    block: Block,
    kept: usize,
    table: Vec<f64>,
    /// Where the nodes of a step that is taken down are in the table.
    nodes: usize,
    /// States that are kept last of all, and where they are until then.
    late: Vec<Late>,
}

impl<'a> Writing<'a> {
    /// With everything in its place.
    fn new(
        scene: &'a Scene,
        start: &'a Start,
        plan: &'a Plan,
        full: bool,
        constants: Option<SpecialisationConstants<'a>>,
    ) -> Result<Self, String> {
        let mut block = Block::default();
        let time = block.take(2); // and how many intervals are over
        let values: Vec<f64> = scene.inputs.iter().map(|i| i.value).collect();
        let given = block.put(&values);
        let means = block.take(scene.open.len());
        let (clusters, table) = (Vec::new(), Vec::new());
        let mut unit = Self {
            scene,
            start,
            plan,
            time,
            given,
            means,
            full,
            constants,
            clusters,
            block,
            kept: 0,
            table,
            nodes: 0,
            late: Vec::new(),
        };
        unit.lay_out()?;
        Ok(unit)
    }
}

impl Writing<'_> {
    /// Gives everything its place.
    fn lay_out(&mut self) -> Result<(), String> {
        for (i, (c, s)) in self.scene.clusters.iter().zip(&self.start.clusters).enumerate() {
            let steps = (self.plan.steps[i].h, self.plan.wanted);
            let mut place = Cluster::new(&mut self.block, (i, c), (s, steps), self.full);
            if let Some(linear) = &c.step.linear {
                place.table = self.table.len();
                let table = exponential::table(linear, self.plan.steps[i].h).map_err(|e| e.to_string())?;
                self.table.extend(table);
            }
            self.block.image[place.left] = f64::from(self.plan.ratio[i] - 1);
            self.clusters.push(place);
        }
        if self.clusters.iter().any(|place| !place.pasts.is_empty()) {
            self.nodes = self.table.len();
            self.table.extend(NODES);
        }
        self.kept = self.block.image.len();
        for (place, (c, s)) in self.clusters.iter_mut().zip(self.scene.clusters.iter().zip(&self.start.clusters)) {
            place.work(&mut self.block, c, s);
        }
        Ok(())
    }

    /// Places that are read from outside.
    fn public(&self) -> BTreeSet<u32> {
        let mut list: BTreeSet<u32> = [self.time, self.time + 1].map(|at| at as u32).into();
        let mut add = |at: usize, n: usize| list.extend((at..at + n).map(|at| at as u32));
        add(self.given, self.scene.inputs.len());
        add(self.means, self.scene.open.len());
        for place in &self.clusters {
            place.layout.held.iter().for_each(|h| add(place.at(h.v), 1));
            place.layout.accounts.iter().for_each(|p| add(place.at(p.first), NAMES.len()));
        }
        list
    }

    /// The routines that go on, where these places are looked at besides.
    fn routines(&mut self, kept: &BTreeSet<u32>) -> Result<Routines, String> {
        let mut w = self.commit()?;
        let body = w.close();
        let mut kept = kept.clone();
        kept.extend(Uses::of(&body).read);
        w.open();
        let promoted =
            if size(&body) > LARGEST || !self.late.is_empty() { None } else { promote(&mut w, &body, &kept) };
        let name = format!("interval of {}", self.scene.name);
        let Some(Promoted { before, body, after }) = promoted else {
            body.into_iter().for_each(|s| w.push(s));
            return Ok(Routines { commit: w.routine(name), whole: false, run: None });
        };
        let mut many = w.clone();
        before.iter().chain(&body).chain(&after).for_each(|s| w.push(s.clone()));
        let commit = w.routine(name);
        if !self.scene.open.is_empty() {
            return Ok(Routines { commit, whole: true, run: None });
        }
        before.into_iter().for_each(|s| many.push(s));
        let (count, one) = (many.starting(0.0), many.number(1.0));
        let most = many.load(Place::new(Memory::Input, 0));
        many.repeat(|w| {
            let k = w.get(count);
            w.push(Stmt::Store(Place::new(Memory::Output, 0), k));
            let more = w.lt(k, most);
            w.when(more.not(), |w| w.push(Stmt::Break));
            body.into_iter().for_each(|s| w.push(s));
            let k = w.add(k, one);
            w.set(count, k);
        });
        after.into_iter().for_each(|s| many.push(s));
        Ok(Routines { commit, whole: true, run: Some(many.routine(format!("intervals of {}", self.scene.name))) })
    }

    /// What an interval's end and the next one's begin do.
    fn commit(&mut self) -> Result<Writer, String> {
        let mut w = Writer::new();
        if let Some(constants) = &self.constants {
            w.data.clone_from(&constants.data);
        }
        let zero = w.number(0.0);
        for (o, open) in self.scene.open.iter().enumerate() {
            let (cluster, port) = open.port;
            let (c, place) = (&self.scene.clusters[cluster], &self.clusters[cluster]);
            let x = w.load(Place::new(Memory::Input, o as u32));
            // What is so large, or no number, would be in sums that nothing takes it out of again.
            let square = w.mul(x, x);
            let sound = w.finite(square);
            w.when(sound.not(), |w| w.push(Stmt::Fail(Reason::NotFinite)));
            if c.period.is_none() {
                // What the outside gives, as the region counts it.
                let along = w.number(open.along);
                let x = w.mul(along, x);
                w.keep(place.input + c.ports[port].input, x);
                w.keep(place.moved + port, zero);
            } else if let Some(k) = self.start.clusters[cluster].held.iter().position(|h| h.open == Some(o)) {
                // A period may be several intervals.
                let at = place.at(place.layout.held[k].q);
                let (before, sign) = (w.kept(at), w.number(open.sign()));
                let more = w.mul(sign, x);
                let sum = w.add(before, more);
                w.keep(at, sum);
            }
        }
        for i in (0..self.clusters.len()).filter(|i| self.scene.clusters[*i].period.is_none()) {
            self.latch(&mut w, i);
        }
        let mut w = self.steps(w)?;
        let length = w.number(self.plan.interval);
        for (o, open) in self.scene.open.iter().enumerate() {
            let (cluster, port) = open.port;
            if self.scene.clusters[cluster].period.is_none() {
                let sum = w.kept(self.clusters[cluster].moved + port);
                let mean = w.div(sum, length);
                w.keep(self.means + o, mean);
            }
        }
        let mut w = self.samples(w)?;
        if self.full {
            self.late.iter().for_each(|late| step::keep(&mut w, late.state.clone(), late.next));
        }
        Ok(w)
    }

    /// The routine that looks, and where.
    fn observe(&mut self) -> Result<(Routine, BTreeSet<u32>), String> {
        let mut w = Writer::new();
        let told: Vec<usize> = self.start.probed.iter().flat_map(|i| self.told(*i)).collect();
        let before: Vec<Value> = told.iter().map(|at| w.kept(*at)).collect();
        for &i in &self.start.probed {
            w = self.look(w, i, None)?;
        }
        // Who looks and saves then has what who only saves has.
        for (at, x) in told.into_iter().zip(before) {
            w.keep(at, x);
        }
        let Some(program) = &self.scene.probes.program else {
            return Ok((w.routine("probes".into()), BTreeSet::new()));
        };
        let inputs = self.block.take(program.size(bond_runtime::ir::Array::Input));
        let t = w.kept(self.time);
        w.keep(inputs, t);
        for (k, (cluster, output)) in self.scene.probes.gather.iter().enumerate() {
            let x = w.kept(self.clusters[*cluster].seen + output);
            w.keep(inputs + 1 + k, x);
        }
        let at = inputs + 1 + self.scene.probes.gather.len();
        for (k, i) in self.scene.probes.inputs.iter().enumerate() {
            let x = w.kept(self.given + i);
            w.keep(at + k, x);
        }
        let seen = self.block.take(program.size(bond_runtime::ir::Array::Output));
        let mut w = self.program(w, program, 0, 0, inputs, seen, "the probes")?;
        // After the probes, the program gives what expectations ask for.
        for k in 0..self.scene.probes.names.len() {
            let x = w.kept(seen + k);
            w.push(Stmt::Store(Place::new(Memory::Output, k as u32), x));
        }
        let routine = w.routine("probes".into());
        let read = Uses::of(&routine.body).read;
        Ok((routine, read))
    }

    /// Writes an observation of a cluster at the time that is now, a sampled one's last sample; where it is `due`, one
    /// is taken now.
    fn look(&mut self, mut w: Writer, i: usize, due: Option<Cond>) -> Result<Writer, String> {
        let (c, place) = (&self.scene.clusters[i], self.clusters[i].clone());
        let mut t = w.kept(self.time);
        if c.period.is_some() && c.instant.reads(Array::Input, 0..1) {
            let (count, one, length) = (w.kept(place.count), w.number(1.0), w.number(self.plan.steps[i].h));
            let last = w.sub(count, one);
            let last = w.mul(last, length);
            t = due.map_or(last, |due| w.select(due, t, last));
        }
        w.keep(place.input, t);
        if c.period.is_none() {
            self.latch(&mut w, i);
            self.arriving(&mut w, i, t);
        }
        self.program(w, &c.instant, place.state, 0, place.input, place.seen, &c.name)
    }

    /// Places of what a cluster is told where somebody looks at it.
    fn told(&self, i: usize) -> Vec<usize> {
        let (c, place) = (&self.scene.clusters[i], &self.clusters[i]);
        let given = (0..c.inputs.len()).filter(|_| c.period.is_none()).map(|k| place.input + c.given_at() + GIVEN * k);
        let arriving = place.pasts.iter().flat_map(|p| p.told().map(|at| place.input + at));
        [place.input].into_iter().chain(given).chain(arriving).collect()
    }

    /// Tells a cluster what is given from outside now. What it is told is constant: of value, slope and instant, the
    /// value alone ever changes.
    fn latch(&self, w: &mut Writer, i: usize) {
        let (c, place) = (&self.scene.clusters[i], &self.clusters[i]);
        for (k, input) in c.inputs.iter().enumerate() {
            let x = w.kept(self.given + input);
            w.keep(place.input + c.given_at() + GIVEN * k, x);
        }
    }

    /// Writes a program: places of state, next state, inputs and outputs.
    #[expect(clippy::too_many_arguments, reason = "a program has as many arrays")]
    fn program(
        &self,
        w: Writer,
        program: &Program,
        state: usize,
        next: usize,
        input: usize,
        output: usize,
        of: &str,
    ) -> Result<Writer, String> {
        let s = |at: usize| (Memory::State, at as u32);
        let table = self.clusters.iter().find(|c| c.state == state && c.next == next).map_or(0, |c| c.table);
        let places = [s(state), s(next), s(input), (Memory::Table, table as u32), (Memory::Scratch, 0), s(output)];
        let numbers = self
            .constants
            .as_ref()
            .map(|constants| constants.program(program).ok_or("a program of none of its clusters"));
        write(w, program, places, numbers.transpose()?)
            .ok_or_else(|| format!("`{of}` has iterations inside iterations, which have no compiled form"))
    }

    /// A number of how the other sides respond to what a cluster holds.
    fn response(&self, w: &mut Writer, i: usize, which: PortResponse, k: usize) -> Value {
        match &self.constants {
            Some(constants) => w.load(Place::new(Memory::Data, constants.response(i, which) + k as u32)),
            None => w.number(self.start.clusters[i].response(which)[k]),
        }
    }

    fn open(&self, o: usize) -> Open {
        let open = &self.scene.open[o];
        let (cluster, port) = open.port;
        let held = self.start.clusters[cluster].held.iter().position(|h| h.port == port);
        let (at, sign) = match held {
            Some(k) => (self.clusters[cluster].at(self.clusters[cluster].layout.held[k].v), open.sign()),
            None => (self.means + o, open.answers),
        };
        Open { name: open.name.clone(), held: held.is_some(), at, sign }
    }

    fn regions(&self) -> Vec<Region> {
        let clusters = self.scene.clusters.iter().zip(&self.clusters);
        let accounts = clusters.flat_map(|(c, place)| {
            c.entries.iter().zip(&place.layout.accounts).map(|(e, p)| (e.region, place.at(p.first)))
        });
        let mut list: Vec<(usize, usize)> = accounts.collect();
        list.sort_unstable();
        list.into_iter().map(|(r, at)| Region { name: self.scene.regions[r].name.clone(), at }).collect()
    }
}

impl Writer {
    /// A number of the block.
    fn kept(&mut self, at: usize) -> Value {
        self.load(Place::new(Memory::State, at as u32))
    }

    /// Keeps a number in the block.
    fn keep(&mut self, at: usize, x: Value) {
        self.push(Stmt::Store(Place::new(Memory::State, at as u32), x));
    }

    /// One of some numbers of the block.
    fn read(&mut self, base: usize, at: At) -> Value {
        self.load(Place { memory: Memory::State, ..scratch(base as u32, at) })
    }

    /// Keeps one of some numbers of the block.
    fn put_at(&mut self, base: usize, at: At, x: Value) {
        self.push(Stmt::Store(Place { memory: Memory::State, ..scratch(base as u32, at) }, x));
    }

    /// The larger.
    fn larger(&mut self, a: Value, b: Value) -> Value {
        let more = self.lt(a, b);
        self.select(more, b, a)
    }
}
