//! A compiled scene: the step programs of all its clusters and how they are joined. Made by the compiler, run by
//! [`crate::simulate`].
//!
//! A *cluster* is what steps as one: a sampled region, or several that hold alike for the same cluster; the signal
//! states of a `sampled` block; or the continuous regions and signal states that read each other's signals.

use crate::exponential::Linear;
use crate::history::{NODES, SLOTS};
use crate::ir::{Array, Program};
use crate::options::NumericOptions;
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::cmp::Ordering;
use std::collections::BTreeSet;

mod check;
mod image;

pub use check::Unsound;

/// A compiled scene.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Scene {
    /// Name of the model.
    pub name: String,
    /// What steps as one.
    pub clusters: Vec<Cluster>,
    /// Regions, in the order of the graph.
    pub regions: Vec<Region>,
    /// Double bars.
    pub bars: Vec<Bar>,
    /// Open ports.
    pub open: Vec<Open>,
    /// Signals given from outside, in order of declaration.
    pub inputs: Vec<Input>,
    /// What is shown.
    pub probes: Probes,
    /// Elements that may give energy, so that no passivity is claimed: what is active, steered sources of sampled
    /// regions under `budget off`, storages whose energy has no lower bound.
    pub excluded: Vec<Excluded>,
    /// Where `expect passive at` looks.
    pub watched: Vec<Watched>,
    /// Lossless lines.
    pub lines: Vec<TransmissionLine>,
    /// Open ports that carry waves, in order of declaration.
    pub waves: Vec<WavePort>,
    /// What of the model is not in it, since no probe, open port or expectation depends on it.
    pub left_out: LeftOut,
    /// What its programs were made for.
    pub made: Made,
    /// The size of its energies, J; 0 where nothing tells it. Far less is next to nothing in any units.
    pub energy: f64,
    /// The numbers that the methods of its runs go by.
    pub numeric: NumericOptions,
}

/// An element for which no passivity is claimed.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Excluded {
    /// Its name, as the ledger has it.
    pub element: String,
    /// Why, in words that name it.
    pub why: String,
}

/// A source, open port or double bar at which what is drawn is held against what was put in and stored at the start.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Watched {
    /// Its name.
    pub name: String,
    /// The cluster that books what crosses there.
    pub cluster: usize,
    /// Which of the cluster's entries, and which of `supplied` there.
    pub entry: (usize, usize),
    /// 1 where that is what was put in, -1 where it is what was drawn.
    pub sign: f64,
    /// What is stored behind it at the start, above its least and apart from heat, J.
    pub stored: f64,
}

/// What programs were made for besides what they compute: to make the same ones again.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Made {
    /// How long steps of continuous regions would be, s.
    pub pace: f64,
    /// The error to which they would be fitted, relative, where they are not of one length.
    pub tolerance: Option<f64>,
}

/// What of a model does not run, by name.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct LeftOut {
    /// Regions.
    pub regions: Vec<String>,
    /// Signal states.
    pub states: Vec<String>,
}
impl Scene {
    /// Sampled clusters in the order in which they take a common sample: those of shorter periods first; of one period
    /// what answers before what holds for it, and else as they stand in the scene.
    pub fn order(&self) -> Vec<usize> {
        let rank = |i: usize| self.clusters[i].period;
        let bars: BTreeSet<(usize, usize)> = self.bars.iter().map(|b| (b.other.0, b.holder.0)).collect();
        let (mut waits, mut after) = (vec![0; self.clusters.len()], vec![Vec::new(); self.clusters.len()]);
        // Two that hold for each other wait for neither.
        for &(a, b) in bars.iter().filter(|&&(a, b)| rank(a) == rank(b) && !bars.contains(&(b, a))) {
            waits[b] += 1;
            after[a].push(b);
        }
        let mut sampled: Vec<usize> = (0..self.clusters.len()).filter(|i| rank(*i).is_some()).collect();
        sampled.sort_by(|a, b| rank(*a).partial_cmp(&rank(*b)).unwrap_or(Ordering::Equal));
        let mut order = Vec::with_capacity(sampled.len());
        for alike in sampled.chunk_by(|a, b| rank(*a) == rank(*b)) {
            let mut left: BTreeSet<(usize, usize)> = alike.iter().map(|i| (waits[*i], *i)).collect();
            // In a ring nothing waits for nothing: what waits for the fewest goes first.
            while let Some((_, i)) = left.pop_first() {
                order.push(i);
                for &j in &after[i] {
                    if left.remove(&(waits[j], j)) {
                        waits[j] -= 1;
                        left.insert((waits[j], j));
                    }
                }
            }
        }
        order
    }
}

/// A signal given from outside.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Input {
    /// Its path.
    pub name: String,
    /// Its unit as text, where determined.
    pub unit: Option<String>,
    /// What it is where nothing is given, SI.
    pub value: f64,
}

/// A region, as the ledger names it.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Region {
    /// Its name.
    pub name: String,
    /// Its period in s; `None` where it is continuous.
    pub period: Option<f64>,
    /// How many energy states it has.
    pub states: usize,
    /// Its cluster.
    pub cluster: usize,
    /// Effort times flow is no power in it, so that its ledger is of a pseudo energy.
    pub pseudo: bool,
}

/// What is known of a stepper, by which it is chosen and run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Properties {
    /// The order of its error; 0 where it has none.
    pub order: u32,
    /// The order of the method that a step is compared with, where that is far below its own; else 0.
    pub estimated: u32,
    /// How many stages a step has; 0 where it has none, as the matrix exponential.
    pub stages: u32,
    /// Whether a step follows from rates alone, without equations to solve.
    pub explicit: bool,
    /// Whether a step back undoes a step: the method is its own adjoint.
    pub symmetric: bool,
    /// Whether its stages damp what is far too fast for a step.
    pub l_stable: bool,
    /// Whether the last stage stands at the end of the step.
    pub stiffly_accurate: bool,
    /// Whether its steps keep the balance.
    pub passive: bool,
}

impl Properties {
    /// Nothing known.
    pub const NONE: Properties = Properties {
        order: 0,
        estimated: 0,
        stages: 0,
        explicit: false,
        symmetric: false,
        l_stable: false,
        stiffly_accurate: false,
        passive: false,
    };

    /// The power of a step's length that its estimated error goes with.
    pub fn error_exponent(&self) -> u32 {
        1 + if self.estimated > 0 { self.estimated } else { self.order }
    }

    /// Whether a step solves for several stages at once.
    fn couples_stages(&self) -> bool {
        !self.explicit && self.stages > 1
    }

    /// Whether what is far too fast for a step stays in it or turns round, so that a step and its two halves may say
    /// the same of it: the stability function of a symmetric method of s > 1 stages tends to (-1)^s.
    pub fn repeats_fast_modes(&self) -> bool {
        self.symmetric && self.couples_stages()
    }

    /// Whether it stays: s is even.
    pub fn keeps_fast_modes(&self) -> bool {
        self.repeats_fast_modes() && self.stages.is_multiple_of(2)
    }
}

/// A stepper's program.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Stepper {
    /// `gonzalez`
    pub name: Cow<'static, str>,
    /// Why it was taken; empty where there was no choice.
    pub why: Cow<'static, str>,
    /// What is known of it.
    pub properties: Properties,
    /// One step.
    pub program: Program,
    /// The first of the outputs of `program` that estimate the error of the step, absolute and in the unit of each: of
    /// the energy and signal states, then of the integrals. It is that of a method one order below, or of
    /// [`Properties::estimated`]. Without one, adaptive steps are doubled.
    pub estimate: Option<usize>,
    /// The output of `program` that tells how stiff the step before was: its length times the largest eigenvalue of the
    /// region, about. Where it says that stability bounds the steps, `fallback` takes over.
    pub stiffness: Option<usize>,
    /// For `exact`: what the table is made of.
    pub linear: Option<Linear>,
    /// For `exact`: the same without the energies, for a look between two steps. It has none itself.
    #[serde(deserialize_with = "image::inner")]
    pub glance: Option<Box<Stepper>>,
    /// What takes a step that this one cannot take, or whose balance it does not keep, however short. It has none
    /// itself.
    #[serde(deserialize_with = "image::inner")]
    pub fallback: Option<Box<Stepper>>,
}

impl Stepper {
    /// A stepper that is its program and nothing else.
    pub fn new(name: &'static str, properties: Properties, program: Program) -> Self {
        let why = Cow::Borrowed("");
        Self {
            name: name.into(),
            why,
            properties,
            program,
            estimate: None,
            stiffness: None,
            linear: None,
            glance: None,
            fallback: None,
        }
    }
}

/// How the held variable of a sampled region is found.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Respond {
    /// Its outputs are the efforts (or flows) that the ports call for, given the means of the last interval, and what
    /// the region's own sources are to supply in the next one. Where there is a fallback, it solves for them instead:
    /// its last inputs are the free responses and the port admittance, and between its outputs is a 1 where it found a
    /// solution.
    pub program: Program,
    /// What the ports call for at given means: a law that switches may leave no solution.
    pub fallback: Option<Program>,
}

impl Respond {
    /// Its programs.
    pub fn programs(&self) -> impl Iterator<Item = &Program> {
        [&self.program].into_iter().chain(&self.fallback)
    }
}

/// What a steered source is to the claim of passivity and to its region's account.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Steering {
    /// Of a sampled region at a double bar or open port, within the budget: it draws on the account as storages do.
    Drawing,
    /// The same under `budget off`: it counts as a source, and no passivity is claimed.
    Unbounded,
    /// It is said to be meant, `active`: the same.
    Active,
    /// It counts as a source, and stands beside the verdict.
    Beside,
}

impl Entries {
    /// Whether energy comes in by more than the ports that a sampled region holds, and what draws on its account.
    pub fn is_driven(&self) -> bool {
        self.own().next().is_some()
    }

    /// The region's own sources, as places in `supplied`: all but the ports that it holds, and the steered sources that
    /// draw on its account.
    pub fn own(&self) -> impl Iterator<Item = usize> {
        let counts = |i: &usize| !self.held.contains(i) && !self.steered.contains(&(*i, Steering::Drawing));
        (0..self.supplied.len()).filter(counts)
    }

    /// Those of them that are no ports: what crosses a port at which another one holds is its own to count.
    pub fn sources(&self) -> impl Iterator<Item = usize> {
        self.own().filter(|i| !self.met.contains(i))
    }

    /// Whether a steered source draws on the region's account.
    pub fn is_drawn_on(&self) -> bool {
        self.steered.iter().any(|s| s.1 == Steering::Drawing)
    }
}

/// What leaves at an end of a line in a sampled region.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Leaving {
    /// The end, as a place in [`Entries::supplied`].
    pub source: usize,
    /// The output of the step that has the wave e + Z f.
    pub wave: usize,
    /// What its square is multiplied by for its energy over an interval, J.
    pub scale: f64,
}

/// A lossless line: what is on its way in it is what its ends took in.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TransmissionLine {
    /// Its name.
    pub name: String,
    /// Its ends: the cluster that books what crosses there, which of its entries, and which of `supplied` there.
    pub ends: [(usize, usize, usize); 2],
    /// One over its impedance, SI.
    pub admittance: f64,
    /// Of a line in continuous time, whose ends are of one cluster: the first input slots there of what comes out at
    /// each end.
    pub out: Option<[usize; 2]>,
}

/// An open port of a sampled region that carries waves: half a line, the other half of which is in another program.
///
/// With f counted into the port, the wave u = (e + Z f) / (2 √Z) leaves, and w = (e - Z f) / (2 √Z) comes in.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct WavePort {
    /// Its name.
    pub name: String,
    /// Its cluster, and which of the delays there.
    pub cluster: usize,
    /// Which of [`Cluster::lines`] has what leaves and what comes in.
    pub line: usize,
    /// The impedance, SI.
    pub impedance: f64,
    /// Its unit.
    pub unit: Option<String>,
}

impl WavePort {
    /// The energy of a wave e + Z f over an interval of this length, J.
    pub fn energy(&self, wave: f64, period: f64) -> f64 {
        0.25 * period / self.impedance * wave * wave
    }
}

/// Where the parts of a region's ledger are among the outputs of a step.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Entries {
    /// Which region.
    pub region: usize,
    /// H at the end of the step.
    pub energy: usize,
    /// H at its start, where that depends on time: the end of the step before is not the same instant to the last bit.
    pub before: Option<usize>,
    /// Sum of the magnitudes of the storages' energies, and of how far each is above its least: the same output as
    /// `energy` where none can be negative.
    pub size: usize,
    /// Where each step's balance is looked at before it counts: the change of H, had without the difference of two of
    /// its values, and the sum of the magnitudes of its parts.
    pub change: Option<(usize, usize)>,
    /// Energy in by each source: name, output.
    pub supplied: Vec<(String, usize)>,
    /// Energy lost in each resistor: name, output.
    pub dissipated: Vec<(String, usize)>,
    /// What of H is no more than its zero: the sum of the storages' least energies.
    pub floor: f64,
    /// Which of `supplied` are ports that a sampled region holds: what crossed there is booked at the end of the
    /// interval.
    pub held: Vec<usize>,
    /// Which of `supplied` are ports at which others hold for a sampled region.
    pub met: Vec<usize>,
    /// Which of `supplied` are steered sources, whose values read the scene's own signals, and what that makes them.
    pub steered: Vec<(usize, Steering)>,
    /// Which of `supplied` are ends of lines, and what leaves there.
    pub leaving: Vec<Leaving>,
    /// The least that H can be, where there is such a level: what a sampled region has to give is counted from there.
    pub least: f64,
    /// Where heat is stored, or held for others: what of the energy may be drawn as work.
    pub work: Option<Work>,
    /// J. What it turned over in a step is counted as at least. Nothing is told of less: of a body that is held at
    /// rest, rounding is all that moves.
    pub faintest: f64,
    /// Entropy produced in each field with thermal ports.
    pub produced: Vec<Produced>,
    /// Energy that an energy leap of `ray` missed (created where positive), and 1 where there was one.
    pub leap: Option<(usize, usize)>,
    /// Of a stepper that keeps another energy than H, which then is `energy`: H itself at the end of the step.
    pub modified: Option<usize>,
}

/// What of a sampled region's energy may be drawn as work: that of the storages that heat has no part in, and of the
/// others (a gas) what is drawn while each entropy stays. The rest is heat, which bars of temperature alone may draw.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Work {
    /// It at the end of the step: an output.
    pub energy: usize,
    /// It at the start, J.
    pub initial: f64,
    /// The least that it can be, J: what there is to give is counted from there.
    pub least: f64,
    /// Which of [`Entries::supplied`] supply heat.
    pub heats: Vec<usize>,
}

/// What a field with thermal ports produces in a step, as outputs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Produced {
    /// The field.
    pub name: String,
    /// The entropy, J/K.
    pub entropy: usize,
    /// The same times the temperature of its first thermal port, J.
    pub heat: usize,
}

/// A port of a cluster: a double bar or an open port. Its variable comes in, the conjugate goes out.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Port {
    /// Name of what is at its far end.
    pub name: String,
    /// The region it belongs to.
    pub region: usize,
    /// Input slot of what comes in.
    pub input: usize,
    /// Output of the step: mean over the step of what goes out.
    pub mean: usize,
    /// Output of the instant program: what goes out now.
    pub instant: usize,
    /// Whether its effort is a temperature, so that heat crosses it.
    pub is_thermal: bool,
}

/// A delay of a cluster.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Line {
    /// Its name.
    pub name: String,
    /// What it is until the first that is delayed arrives.
    pub start: f64,
    /// What is delayed.
    pub carried: Carried,
}

/// What is delayed.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Carried {
    /// Of a sampled cluster, a state, by so many periods. It has one input slot.
    State {
        /// Which state.
        state: usize,
        /// By how many periods, at least 1.
        periods: u32,
    },
    /// Of a sampled one, what a step reports, by so many periods after its end. It has one input slot.
    Wave {
        /// Which output of [`Cluster::step`].
        output: usize,
        /// By how many periods, from 0 on.
        periods: u32,
    },
    /// Of a sampled one, what a step reports, which leaves at an open port. It has one input slot, for what comes in
    /// there: told from outside before each interval, and 0 where nothing is.
    Leaving {
        /// Which output of [`Cluster::step`].
        output: usize,
    },
    /// Of a continuous one, a signal. It has [`SLOTS`] input slots: a polynomial over the step.
    Signal {
        /// Which output of [`Cluster::instant`].
        output: usize,
        /// By how long, s.
        time: f64,
    },
}

impl Carried {
    /// How many input slots there are for what arrives.
    pub fn slots(&self) -> usize {
        match self {
            Carried::State { .. } | Carried::Wave { .. } | Carried::Leaving { .. } => 1,
            Carried::Signal { .. } => SLOTS,
        }
    }
}

/// Input slots of a signal given from outside: value, slope, and the instant at which it has that value. It is
/// `value + slope (t - instant)` over a whole step.
pub const GIVEN: usize = 3;

/// Where the laws of a cluster switch.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Guards {
    /// What the conditions of laws compare, less what they compare it with: 0 where a law switches. Inputs as for
    /// [`Cluster::instant`]. Where they depend on what the step solves its loops for, they are taken at what it found,
    /// and then come the loops' residuals, these residuals' derivatives by the loops' unknowns, row by row, and the
    /// guards'.
    pub program: Program,
    /// How many guards.
    pub count: usize,
    /// How many unknowns of loops they depend on: all, or 0.
    pub loops: usize,
    /// Which of them time alone tells.
    pub times: Vec<usize>,
    /// Whether the stepper's last node is the end of its step: such a step ends just before a switch, where others end
    /// just past it.
    pub ends: bool,
    /// The step along a branch, where the stepper looks at the end of its step or beyond: what it saw behind a switch
    /// would spoil the step to there.
    pub branch: Option<Branch>,
    /// Whether a guard jumps, as one of what comes again with each turn does: it may change its sign twice in a step,
    /// the second time where it jumps.
    pub jumps: bool,
}

/// A cluster's step with each law on one branch all along.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Branch {
    /// It gives what the step gives, and more after that. Inputs behind the traces tell the branches: as each guard is,
    /// 1 or -1, or 0 where the law looks for itself.
    pub program: Program,
    /// The first of the outputs that tell the states and integrals halfway, nearly, where they do: to look at the
    /// guards there.
    pub middle: Option<usize>,
}

/// What steps as one.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Cluster {
    /// Its name: that of its first region, else of its first state.
    pub name: String,
    /// Period in s; `None` where it is continuous.
    pub period: Option<f64>,
    /// `lagged`, `predicted`, `matched`; only for a sampled one.
    pub hold: Cow<'static, str>,
    /// How long after a sample what was found there is held, s: at most a period.
    pub latency: f64,
    /// Whether the energy budget is on.
    pub budget: bool,
    /// Energy states, then signal states; they come first in the state.
    pub states: usize,
    /// Integrals; they come next.
    pub integrals: usize,
    /// What an iteration starts from; they come next, and then what rounding took from each state.
    pub guesses: usize,
    /// What the stepper keeps of its last step; that comes last.
    pub memory: usize,
    /// The number of the memory that is 0 where the last step says nothing of where the next one's iteration should
    /// start. Where a law has switched in between, it is made 0.
    pub recall: Option<usize>,
    /// The state at the start.
    pub initial: Vec<f64>,
    /// Names of all of them.
    pub names: Vec<String>,
    /// One step. Inputs: t at its start, its length h, then the ports, foreign signals and what is given from outside.
    pub step: Stepper,
    /// The held variables of a sampled cluster, in the order of `holds`.
    pub respond: Option<Respond>,
    /// Observation at one instant. Inputs as for the step (h is not used).
    pub instant: Program,
    /// Where its laws switch.
    pub guards: Option<Guards>,
    /// Whether it is solved for arguments of exponentials: by such laws a state may be moved in next to no time where
    /// it starts.
    pub has_exponentials: bool,
    /// Whether a law is a curve with corners, as that of dry friction: what that holds moves by less than it begins to.
    pub is_non_smooth: bool,
    /// What is stored: H of each region, then d2H/dx2 and the grain of each state. Inputs as for `instant`; it depends
    /// on the state alone.
    pub stored: Program,
    /// H of each region of the cluster: region, output of `stored`.
    pub energies: Vec<(usize, usize)>,
    /// d2H/dx2 of each state, as an output of `stored`; 0 of a signal state.
    pub curvatures: Vec<usize>,
    /// How large states, and then integrals, are: a part of it that is less than a rounding is none. Those of a state
    /// by the scene's energy; 0 where nothing drives it.
    pub sizes: Vec<f64>,
    /// States of storages of heat, on bonds of temperature and entropy.
    pub heats: Vec<usize>,
    /// What dH/dx of each state is uncertain by where the parameter of a curve is rounded at a corner, likewise; 0 of
    /// most.
    pub grains: Vec<usize>,
    /// The ports.
    pub ports: Vec<Port>,
    /// Ports (by index) whose outgoing variable this cluster holds.
    pub holds: Vec<usize>,
    /// Signals of other clusters that it reads: cluster, output of its `instant`; in order of the input slots.
    pub foreign: Vec<(usize, usize)>,
    /// First input slot of the foreign signals; after them come [`GIVEN`] slots for each of `inputs`, then those of
    /// `lines`, then for each state a trace of the largest value it had.
    pub foreign_at: usize,
    /// Signals given from outside that it reads, as indices into the scene's.
    pub inputs: Vec<usize>,
    /// Delays.
    pub lines: Vec<Line>,
    /// The ledger's parts.
    pub entries: Vec<Entries>,
    /// Whether its laws are linear, and its step is exact.
    pub is_linear: bool,
    /// Whether what it answers at its ports depends on its state: of a continuous cluster whose laws are not linear.
    pub has_changing_response: bool,
    /// The fastest that its states turn, rad/s, where its laws are linear: the largest imaginary part of an eigenvalue.
    pub fastest_turn: f64,
    /// Shortest period of what swings by time alone, s.
    pub fastest_period: Option<f64>,
    /// Resistors whose laws jump where what they are given changes its sign: what they hold still has no solution.
    pub jumps: Vec<String>,
}

impl Cluster {
    /// First input slot of what is given from outside.
    pub fn given_at(&self) -> usize {
        self.foreign_at + self.foreign.len()
    }

    /// First input slot of what arrives by delays.
    pub fn lines_at(&self) -> usize {
        self.given_at() + GIVEN * self.inputs.len()
    }

    /// First input slot of the traces.
    pub fn traces_at(&self) -> usize {
        self.lines_at() + self.lines.iter().map(|line| line.carried.slots()).sum::<usize>()
    }

    /// Whether it delays signals in continuous time.
    pub fn has_continuous_delays(&self) -> bool {
        self.lines.iter().any(|line| matches!(line.carried, Carried::Signal { .. }))
    }

    /// By how many values in a step its delayed signals are taken down: as many as the order of the step is worth.
    pub fn nodes(&self) -> usize {
        let order = self.step.properties.order as usize;
        if order == 0 { NODES.len() } else { (order + 2).clamp(5, NODES.len()) }
    }

    /// The step along a branch, where there is one.
    pub fn branch(&self) -> Option<&Branch> {
        self.guards.as_ref().and_then(|g| g.branch.as_ref())
    }

    /// First input slot of the branches of laws.
    pub fn branches_at(&self) -> usize {
        self.traces_at() + self.states
    }

    /// Whether one of its programs looks at a trace: where none does, fixed steps need not keep the largest values.
    pub fn is_traced(&self) -> bool {
        let stepper = |s: &Stepper| self.looks(&s.program);
        let beside = [&self.step.glance, &self.step.fallback];
        stepper(&self.step)
            || beside.into_iter().flatten().any(|s| stepper(s))
            || self.looks(&self.instant)
            || self.respond.iter().flat_map(Respond::programs).any(|p| self.looks(p))
    }

    fn looks(&self, program: &Program) -> bool {
        let at = self.traces_at();
        program.reads(Array::Input, at..at + self.states)
    }
}

/// A double bar between two clusters. The holder's variable v is held over its period; the other side answers with q,
/// the integral of the conjugate. `sign` is 1 where the answer is a flow, -1 where it is an effort: the other side's
/// input is `sign * v`, and q = `sign` times the integral of what it gives out. The energy v q enters the holder.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Bar {
    /// Name of the bond.
    pub name: String,
    /// Cluster and port of the holder.
    pub holder: (usize, usize),
    /// Cluster and port of the other side.
    pub other: (usize, usize),
    /// See above.
    pub sign: f64,
    /// In what steps the holder reads the motion of the other side, SI; 0 where it does so exactly.
    pub resolution: f64,
}

impl Bar {
    /// Whether a flow is held, and the other side answers with an effort.
    pub fn holds_flow(&self) -> bool {
        self.sign < 0.0
    }
}

/// An open port of the scene, held by a sampled cluster, or met by a continuous one.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Open {
    /// Its name.
    pub name: String,
    /// Its cluster and port.
    pub port: (usize, usize),
    /// Least inertia of the outside, SI.
    pub inertia: Option<f64>,
    /// In what steps the motion of the outside is read, SI; 0 where it is read exactly.
    pub resolution: f64,
    /// Whether the outside gives the flow there, and the scene the effort.
    pub takes_flow: bool,
    /// Unit as text of what the scene gives there, where determined.
    pub unit: Option<String>,
    /// Unit as text of the integral over time of what the outside gives, where determined.
    pub moved: Option<String>,
    /// 1 where what the outside gives, as the region counts it, runs along the half arrow; -1 where it runs against it.
    pub along: f64,
    /// The same of what the region gives out there.
    pub answers: f64,
}

impl Open {
    /// What a sampled region holds there and is told, as the outside counts it, is this times what the region counts:
    /// an effort is an effort, and a flow runs into the scene, so that their product is the power that the outside puts
    /// in.
    pub fn sign(&self) -> f64 {
        if self.takes_flow { 1.0 } else { -1.0 }
    }
}

/// What is shown: a program over signals of all clusters.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Probes {
    /// Names in order.
    pub names: Vec<String>,
    /// Units as text, where determined.
    pub units: Vec<Option<String>>,
    /// Inputs: t, then the gathered signals, then what is given from outside. Outputs: the probes, then the values of
    /// the expectations.
    pub program: Option<Program>,
    /// Which signals: cluster, output of its `instant`.
    pub gather: Vec<(usize, usize)>,
    /// Signals given from outside, as indices into the scene's; their values come after the gathered signals.
    pub inputs: Vec<usize>,
    /// What is expected of a run.
    pub expectations: Vec<Expectation>,
}

/// An `expect`.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Expectation {
    /// As written.
    pub text: String,
    /// What it asks.
    pub kind: ExpectationKind,
}

/// What an `expect` asks.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub enum ExpectationKind {
    /// The ledger shows a passive run.
    Passive,
    /// At this one of the scene's `watched`, no more was drawn than was put in and stored at the start.
    PassiveAt(usize),
    /// An output of the probes' program at an instant.
    At {
        /// Which output.
        output: usize,
        /// s
        time: f64,
        /// What it should be.
        target: f64,
        /// By how much it may be off.
        tolerance: f64,
    },
    /// A condition at every row. Extremes over the run are outputs (with whether the largest is meant), and inputs of
    /// `program`.
    Holds {
        /// Outputs whose extremes over the run are taken, and whether the largest.
        extremes: Vec<(usize, bool)>,
        /// Output that is the condition where there are no extremes.
        output: usize,
        /// Where there are extremes: their values in, 1 or 0 out.
        program: Option<Program>,
    },
}
