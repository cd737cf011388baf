//! Where the numbers of a cluster's ledger and holds are in its block.

use crate::history::{EXACT, RADAU, Rule, STAGES};
use crate::scene::{Cluster, Entries, Properties, Scene, TransmissionLine};

/// Order of the autoregressive model that predicts the free response: two coefficients for each way in which the other
/// side can swing.
pub const AR_ORDER: usize = 4;
/// Numbers per port that predict its free response: the weights of the free responses before, what is left of a motion
/// after one interval, and how many of the weights count.
pub const AR_COEFFICIENTS: usize = AR_ORDER + 2;

/// The place of a number.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Place {
    /// The cluster.
    pub cluster: usize,
    /// Which of its block's numbers.
    pub at: usize,
}

impl Place {
    /// The place so many numbers further on.
    #[must_use]
    pub fn plus(self, n: usize) -> Self {
        Self { at: self.at + n, ..self }
    }
}

/// The numbers of an account that a stand-alone module shows, in their order. A sum has two numbers: the second is what
/// rounding took from the first.
pub const ACCOUNT: [&str; 18] = [
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

/// Places of a region's account.
#[derive(Clone, Debug)]
pub struct AccountPlaces {
    /// The first of [`ACCOUNT`].
    pub first: Place,
    /// Energy now, J.
    pub h: Place,
    /// Energy at the start.
    pub h_initial: Place,
    /// The largest magnitude of the energy.
    pub h_max: Place,
    /// Energy supplied, a sum.
    pub supplied: Place,
    /// Energy dissipated, a sum.
    pub dissipated: Place,
    /// Energy created by holds and energy leaps, a sum.
    pub leaked: Place,
    /// What the balances of the steps are off by in all: a sum of roundings.
    pub residual: Place,
    /// What the balance of a step is off by.
    pub worst: ErrorPlaces,
    /// The largest energy turned over in a step.
    pub turnover_max: Place,
    /// The largest sum of the magnitudes of what is stored, which may cancel in the energy.
    pub size_max: Place,
    /// What a sampled region has to give: the energy above its least, and what the tank holds. Counted by itself: where
    /// a hold has the energy grow and shrink by far more than crosses, that would be lost in the energy's rounding.
    pub stored: Place,
    /// The largest debt.
    pub debt_max: Place,
    /// What resistors gave in a step.
    pub gained: ErrorPlaces,
    /// The highest energy, with its sign.
    pub h_top: Place,
    /// The least that the energy can be.
    pub h_least: Place,
    /// Where heat is stored, or held for others: `stored` then is what may be drawn as work.
    pub work: Option<WorkPlaces>,
    /// Where it has sources of its own: what they took back since there last was something to give.
    pub absorbed: Option<AbsorbedPlaces>,
    /// A sum per source; the region's own where there is one source alone. A stand-alone module keeps them where a line
    /// in continuous time gives back what it was given.
    pub sources: Option<Place>,
    /// What a run keeps besides, and a stand-alone module does not.
    pub detail: Option<DetailPlaces>,
}

/// Places of what a region's own sources took back: as work, and as heat. It is no debt of its bars.
#[derive(Clone, Copy, Debug)]
pub struct AbsorbedPlaces {
    /// Since there last was something to give, two numbers.
    pub sums: Place,
    /// What they had put in when it let go within the interval that runs, two numbers.
    pub counted_on: Place,
}

/// Places of what of a region's energy may be drawn as work, and of the rest.
#[derive(Clone, Copy, Debug)]
pub struct WorkPlaces {
    /// The energy that may be drawn as work.
    pub energy: Place,
    /// The most that it was.
    pub top: Place,
    /// The least that it can be.
    pub least: Place,
    /// What the region has to give as heat.
    pub heat: Place,
}

/// Where the largest error of the steps is kept.
#[derive(Clone, Copy, Debug)]
pub enum ErrorPlaces {
    /// One number: the largest error beside its scale.
    Ratio(Place),
    /// The largest error, and the largest relative one, each with its relative or absolute value; larger ones are noted
    /// in the log with this number.
    Tops(Place, usize),
}

/// Places of what a run keeps of a region besides.
#[derive(Clone, Debug)]
pub struct DetailPlaces {
    /// The most that it ever had to give.
    pub stored_max: Place,
    /// The largest energy that crossed its ports in an interval.
    pub crossed_max: Place,
    /// The largest debt beside the energies that were there then.
    pub relative_debt: Place,
    /// Energy leaps so far.
    pub leaps: Place,
    /// Which resistor gave most in a step, and how much (below 0).
    pub most_negative_resistor: Place,
    /// The worst fall of entropy in a step, as heat at the temperature there.
    pub second_law_violation: ErrorPlaces,
    /// What the energy that the stepper keeps is off H by: now, and at most.
    pub modified: Place,
    /// The most that H was above what it was at the start and what was given since: relative to the largest that was
    /// held until then, and in J.
    pub energy_excess: Place,
    /// A sum per resistor; the region's own where there is one resistor alone.
    pub resistors: Place,
    /// A sum per field with thermal ports: the entropy that it produced, J/K.
    pub produced: Place,
}

/// A line in continuous time, whose ends are of one cluster.
#[derive(Clone, Debug)]
pub struct Waves {
    /// First input slots of what comes out at its ends.
    pub slots: [usize; 2],
    /// What the ends gave: sums.
    pub given: [Place; 2],
    /// One over its impedance, SI.
    pub admittance: f64,
    /// The quadratures by which steps book what crosses its ends.
    pub rules: Vec<Rule>,
}

/// Places of a port that a sampled cluster holds.
#[derive(Clone, Debug)]
pub struct HeldPlaces {
    /// The cluster's port.
    pub port: usize,
    /// Whether what it draws is heat, of a region that counts that by itself.
    pub is_thermal: bool,
    /// What is held.
    pub v: Place,
    /// The answer since the last sample.
    pub q: Place,
    /// Energy that crossed since the last sample, where the other side is sampled too and may have latched earlier
    /// values.
    pub w: Place,
    /// The answer of the last interval.
    pub last_q: Place,
    /// The free responses of the last intervals, the last one first: two more than [`AR_ORDER`].
    pub free_response: Place,
    /// What was held in them.
    pub before: Place,
    /// How many intervals are over.
    pub intervals: Place,
    /// Energy that crossed in the interval that ended last.
    pub crossed: Place,
    /// What a run counts besides, and a stand-alone module does not.
    pub counts: Option<CountPlaces>,
}

/// Places of what crossed a held port in all, as each side counts it.
#[derive(Clone, Debug)]
pub struct CountPlaces {
    /// The energy into the holder: what it held, times how far the other side moved. A sum.
    pub holder: Place,
    /// The energy out of the other side: what it met, times how far it moved. A sum.
    pub other: Place,
    /// The largest difference of the two at the end of an interval.
    pub difference: Place,
}

/// Places of what was at stake in a sampled cluster, and what is promised to an outside.
#[derive(Clone, Debug)]
pub struct StakePlaces {
    /// The largest energy that it had to give, or that crossed and sources put in in an interval, by magnitude, J.
    pub most: Place,
    /// How often it let go of what it held within an interval; of a run alone.
    pub releases: Option<Place>,
    /// What its tank keeps for an outside that was promised it, J; of a run alone.
    pub reserve: Option<Place>,
    /// The part to which the waves that leave into lines are shortened, so that they take no more than there is: of a
    /// cluster that holds within a budget.
    pub shortened: Option<Place>,
}

/// Places of all that a cluster's ledger and holds keep.
#[derive(Clone, Debug)]
pub struct Layout {
    /// How many numbers there are.
    pub size: usize,
    /// How many logs of errors there are.
    pub logs: usize,
    /// One per port that it holds.
    pub held: Vec<HeldPlaces>,
    /// See [`StakePlaces`].
    pub stake: StakePlaces,
    /// One per region.
    pub accounts: Vec<AccountPlaces>,
}

/// Gives out places.
struct Taking {
    cluster: usize,
    size: usize,
    logs: usize,
    detail: bool,
}

impl Taking {
    fn take(&mut self, n: usize) -> Place {
        self.size += n;
        Place { cluster: self.cluster, at: self.size - n }
    }

    fn tops(&mut self) -> ErrorPlaces {
        self.logs += 1;
        ErrorPlaces::Tops(self.take(4), self.logs - 1)
    }

    fn account(&mut self, c: &Cluster, e: &Entries) -> AccountPlaces {
        let first = self.take(ACCOUNT.len());
        let named = |name: &str| first.plus(ACCOUNT.iter().position(|n| *n == name).unwrap_or(0));
        let detail = self.detail.then(|| self.detail(e, named("dissipated")));
        let alone = c.holds.is_empty() && e.supplied.len() == 1;
        let sources = (self.detail || c.has_continuous_delays())
            .then(|| if alone { named("supplied") } else { self.take(2 * e.supplied.len()) });
        let (worst, gained) = match &detail {
            Some(_) => (self.tops(), self.tops()),
            None => (ErrorPlaces::Ratio(named("worst")), ErrorPlaces::Ratio(named("gained"))),
        };
        AccountPlaces {
            first,
            h: named("h"),
            h_initial: named("h_initial"),
            h_max: named("h_max"),
            supplied: named("supplied"),
            dissipated: named("dissipated"),
            leaked: named("leaked"),
            residual: named("residual"),
            worst,
            turnover_max: named("turnover_max"),
            size_max: named("size_max"),
            stored: named("stored"),
            debt_max: named("debt_max"),
            gained,
            h_top: named("h_top"),
            h_least: named("h_least"),
            work: e.work.as_ref().map(|_| WorkPlaces {
                energy: self.take(1),
                top: self.take(1),
                least: self.take(1),
                heat: self.take(1),
            }),
            absorbed: e.sources().next().map(|_| AbsorbedPlaces { sums: self.take(2), counted_on: self.take(2) }),
            sources,
            detail,
        }
    }

    fn detail(&mut self, e: &Entries, dissipated: Place) -> DetailPlaces {
        DetailPlaces {
            stored_max: self.take(1),
            crossed_max: self.take(1),
            relative_debt: self.take(1),
            leaps: self.take(1),
            most_negative_resistor: self.take(2),
            second_law_violation: self.tops(),
            modified: self.take(2),
            energy_excess: self.take(2),
            resistors: if e.dissipated.len() == 1 { dissipated } else { self.take(2 * e.dissipated.len()) },
            produced: self.take(2 * e.produced.len()),
        }
    }

    fn held(&mut self, c: &Cluster, port: usize) -> HeldPlaces {
        let own = |e: &&Entries| e.region == c.ports[port].region;
        HeldPlaces {
            port,
            is_thermal: c.ports[port].is_thermal && c.entries.iter().find(own).is_some_and(|e| e.work.is_some()),
            v: self.take(1),
            q: self.take(1),
            w: self.take(1),
            last_q: self.take(1),
            free_response: self.take(AR_ORDER + 2),
            before: self.take(AR_ORDER + 2),
            intervals: self.take(1),
            crossed: self.take(1),
            counts: self.detail.then(|| CountPlaces {
                holder: self.take(2),
                other: self.take(2),
                difference: self.take(1),
            }),
        }
    }
}

/// The quadrature by which a step of a method books what crosses its ports, where that has positive weights: at its
/// stages. Of any other, an exact one.
fn rule(p: &Properties) -> Rule {
    match p.stages {
        s @ 1..=6 if p.symmetric && p.order == 2 * s => STAGES[s as usize - 1],
        3 if p.l_stable && p.stiffly_accurate => &RADAU,
        _ => &EXACT,
    }
}

impl Layout {
    /// That of the cluster with this number; with `detail` all that a run keeps, without it what a stand-alone module
    /// does.
    pub fn new(cluster: usize, c: &Cluster, detail: bool) -> Self {
        let mut taking = Taking { cluster, size: 0, logs: 0, detail };
        let held = c.holds.iter().map(|port| taking.held(c, *port)).collect();
        let stake = StakePlaces {
            most: taking.take(1),
            releases: detail.then(|| taking.take(1)),
            reserve: detail.then(|| taking.take(1)),
            shortened: (c.budget && !c.holds.is_empty() && c.entries.iter().any(|e| !e.leaving.is_empty()))
                .then(|| taking.take(1)),
        };
        let accounts = c.entries.iter().map(|e| taking.account(c, e)).collect();
        Self { size: taking.size, logs: taking.logs, held, stake, accounts }
    }

    /// The lines in continuous time whose ends are of the cluster with this number, which has this layout.
    pub fn waves(&self, cluster: usize, scene: &Scene) -> Vec<Waves> {
        let of = |line: &TransmissionLine| {
            let slots = line.out.filter(|_| line.ends[0].0 == cluster)?;
            let given = |(_, entry, at): (usize, usize, usize)| Some(self.accounts.get(entry)?.sources?.plus(2 * at));
            let given = [given(line.ends[0])?, given(line.ends[1])?];
            let step = &scene.clusters.get(cluster)?.step;
            let steppers = [step].into_iter().chain(step.fallback.as_deref());
            let rules = steppers.map(|s| rule(&s.properties)).collect();
            Some(Waves { slots, given, admittance: line.admittance, rules })
        };
        scene.lines.iter().filter_map(of).collect()
    }

    /// The block of a cluster whose regions start with these energies, J.
    pub fn start(&self, c: &Cluster, energies: impl IntoIterator<Item = f64>) -> Vec<f64> {
        let mut block = vec![0.0; self.size];
        for ((p, e), h) in self.accounts.iter().zip(&c.entries).zip(energies) {
            let numbers = [
                (p.h, h),
                (p.h_initial, h),
                (p.h_max, h.abs()),
                (p.h_top, h),
                (p.h_least, e.least),
                (p.stored, h - e.least),
                (p.turnover_max, e.faintest),
            ];
            numbers.into_iter().for_each(|(at, x)| block[at.at] = x);
            if let (Some(at), Some(work)) = (&p.work, &e.work) {
                let stored = work.initial - work.least;
                let numbers = [
                    (at.energy, work.initial),
                    (at.top, work.initial),
                    (at.least, work.least),
                    (at.heat, (h - e.least) - stored),
                    (p.stored, stored),
                ];
                numbers.into_iter().for_each(|(at, x)| block[at.at] = x);
            }
            if let Some(d) = &p.detail {
                block[d.stored_max.at] = block[p.stored.at];
            }
        }
        block
    }
}
