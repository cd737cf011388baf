//! The numbers by which a comparison decides, each with its meaning and default.

/// The numbers by which a comparison decides.
#[derive(Clone, Copy, Debug, Default)]
pub struct Thresholds {
    /// How a time is measured.
    pub timing: Timing,
    /// How a reference is found.
    pub reference: ReferenceThresholds,
    /// Which settings a method is run with.
    pub sweep: SweepThresholds,
    /// Which points are added between those of the sweeps.
    pub refine: RefineThresholds,
}

/// How a time is measured.
#[derive(Clone, Copy, Debug)]
pub struct Timing {
    /// Least computing per reading of the clock, s; a shorter run is repeated.
    pub reading: f64,
    /// Most runs per reading.
    pub runs: usize,
    /// Most time for setting up the runs of one reading, s.
    pub set_up: f64,
    /// Readings per time; the default.
    pub readings: usize,
    /// Most processor time per method, s; the default.
    pub limit: f64,
}

impl Default for Timing {
    fn default() -> Self {
        Self { reading: 0.02, runs: 256, set_up: 0.1, readings: 5, limit: 5.0 }
    }
}

/// How a reference is found.
#[derive(Clone, Copy, Debug)]
pub struct ReferenceThresholds {
    /// No reference counts as better than this relative error, because of rounding.
    pub rounding: f64,
    /// The change between two runs below which no further method is tried.
    pub good: f64,
    /// A second method is wanted whose change is at most this many times that of the first.
    pub second: f64,
    /// The two highest orders are extrapolated if no run changes by less than this.
    pub extrapolate_two: f64,
    /// All orders are extrapolated if no run changes by less than this.
    pub extrapolate_all: f64,
    /// A run counts as finer than another from this ratio of their numbers of steps on.
    pub finer: f64,
    /// Failures in a row after which a method is given up.
    pub failures: u32,
    /// Time for all methods together, per time for one.
    pub methods: f64,
    /// A run whose energy balance is off by more than this part of its energy is not used.
    pub off_balance: f64,
    /// Most halvings of a fixed step.
    pub halvings: u32,
}

impl Default for ReferenceThresholds {
    fn default() -> Self {
        Self {
            rounding: 1e-15,
            good: 1e-12,
            second: 1e3,
            extrapolate_two: 1e-11,
            extrapolate_all: 1e-9,
            finer: 1.1,
            failures: 3,
            methods: 2.0,
            off_balance: 0.1,
            halvings: 14,
        }
    }
}

/// Which settings a method is run with.
#[derive(Clone, Copy, Debug)]
pub struct SweepThresholds {
    /// Most points per method and kind of setting.
    pub points: usize,
    /// The longest fixed step, in mean steps of a rough adaptive run.
    pub coarsest: f64,
    /// Tolerance of that rough run.
    pub rough: f64,
    /// A sweep ends after this many points in a row that are as good as the reference.
    pub floors: usize,
    /// A sweep ends after this many points in a row that fail, or that rounding keeps from improving.
    pub stale: usize,
    /// Errors below this may be rounding.
    pub rounding: f64,
    /// Errors below this many per step may be rounding.
    pub rounding_per_step: f64,
    /// Errors below this many times that of the reference may be rounding.
    pub rounding_of_reference: f64,
}

impl Default for SweepThresholds {
    fn default() -> Self {
        Self {
            points: 20,
            coarsest: 16.0,
            rough: 1e-3,
            floors: 2,
            stale: 3,
            rounding: 1e-10,
            rounding_per_step: 1e-15,
            rounding_of_reference: 100.0,
        }
    }
}

/// Which points are added between those of the sweeps.
#[derive(Clone, Copy, Debug)]
pub struct RefineThresholds {
    /// Part of a method's time that its sweep leaves for added points.
    pub part: f64,
    /// The error aimed at, per decade to be met: below 1, because errors do not lie on a line.
    pub aim: f64,
    /// A point is measured if its predicted time is at most this part of the cheapest measured one.
    pub worth: f64,
    /// Most points per decade, for the steppers that keep the balance and for all.
    pub tries: usize,
}

impl Default for RefineThresholds {
    fn default() -> Self {
        Self { part: 0.1, aim: 0.8, worth: 0.9, tries: 6 }
    }
}
