//! Where a routine that goes through whole stretches of a run has its numbers.

/// Places in its block.
#[derive(Clone, Debug, Default)]
pub struct Places {
    /// What the block holds at the start of a run.
    pub image: Vec<f64>,
    /// The time, s, and how many intervals are over.
    pub time: usize,
    /// Values of the signals given from outside, in the scene's order.
    pub given: usize,
    /// Length of an interval, s: the period of what is sampled, or the step where nothing is.
    pub interval: f64,
    /// By cluster.
    pub clusters: Vec<ClusterPlaces>,
}

impl Places {
    /// How many notes an interval can leave.
    pub fn notes(&self) -> u64 {
        self.clusters.iter().map(|c| 2 * u64::from(c.steps) * c.books.len() as u64).sum()
    }
}

/// Places of a cluster.
#[derive(Clone, Debug, Default)]
pub struct ClusterPlaces {
    /// The state.
    pub state: usize,
    /// The inputs of its step.
    pub input: usize,
    /// The largest value of each state.
    pub largest: usize,
    /// What each port gave out since it was collected.
    pub moved: usize,
    /// Of a sampled one, the number of its next sample.
    pub count: usize,
    /// Iterations so far.
    pub iterations: usize,
    /// Length of a step, s; no place.
    pub h: f64,
    /// Steps an interval; no place.
    pub steps: u32,
    /// What the routine takes for the answer of what is held, as in [`super::StartCluster`]; no places.
    pub beta: Vec<f64>,
    /// See above.
    pub gamma: Vec<f64>,
    /// See above.
    pub decay: Vec<f64>,
    /// What it risks where it is in debt: the largest debt, what is trusted, the risk, the largest risk.
    pub caution: usize,
    /// One for each of its regions.
    pub books: Vec<BookPlaces>,
    /// One for each port that it holds.
    pub held: Vec<HeldPlaces>,
}

/// Places of a region's ledger; sums have two numbers.
#[derive(Clone, Copy, Debug, Default)]
pub struct BookPlaces {
    /// Energy now.
    pub h: usize,
    /// The largest.
    pub h_max: usize,
    /// The highest.
    pub h_top: usize,
    /// The least that it can be.
    pub least: usize,
    /// Energy in, a sum.
    pub supplied: usize,
    /// Energy lost, a sum.
    pub dissipated: usize,
    /// Energy created by holds and leaps, a sum.
    pub leaked: usize,
    /// What the balance is off by in all.
    pub residual: usize,
    /// The errors of the balance on top: error and relative error of two.
    pub worst: usize,
    /// The same of what resistors gave.
    pub gained: usize,
    /// The largest energy turned over in a step.
    pub turnover: usize,
    /// The largest sum of magnitudes.
    pub size: usize,
    /// What it has to give: H above its least, and the tank.
    pub stored: usize,
    /// The most that ever was.
    pub stored_max: usize,
    /// The largest debt.
    pub debt: usize,
    /// The largest debt beside the energies that were there then.
    pub owed: usize,
    /// The largest energy that crossed in an interval.
    pub crossed: usize,
    /// Leaps.
    pub leaps: usize,
    /// Which resistor gave most in a step, and how much.
    pub giver: usize,
    /// A sum for each source; None where the only one has the region's own.
    pub sources: Option<usize>,
    /// A sum for each resistor, likewise.
    pub resistors: Option<usize>,
}

/// Places of a held port.
#[derive(Clone, Copy, Debug, Default)]
pub struct HeldPlaces {
    /// What is held.
    pub v: usize,
    /// The answer since the last sample.
    pub q: usize,
    /// Energy that crossed since then.
    pub w: usize,
    /// Energy that crossed in the last interval.
    pub crossed: usize,
    /// The answer of the last interval.
    pub last_q: usize,
    /// alpha of the last intervals, one more than [`super::TERMS`].
    pub alpha: usize,
    /// What was held in them.
    pub before: usize,
    /// What alpha is foretold to be, and what forecasts were off by.
    pub forecast: usize,
    /// How many intervals are over; more than [`super::TERMS`] count as one more.
    pub intervals: usize,
    /// Energy in, a sum.
    pub energy: usize,
}
