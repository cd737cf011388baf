//! Model reduction: leaves out parts, the least active first, as long as no probe changes by more than a given error.

mod json;
mod table;

pub use json::json;
pub use table::text;

use crate::bench::{Difference, Kernels, Look, Lost, Quantities, Run, Runner, Setting, Task, Thresholds, Way, timed};
use crate::input;
use crate::stop::Stop;
use bond::internal::{CompiledInternals, OptionsInternals};
use bond::{Compiled, InputSignal, Options, Text};
use bond_compiler::reduction::{self, Part};
use bond_runtime::kernel::Backend;
use bond_runtime::scene::LeftOut;

/// Rows at which the power of parts is summed, and runs are compared.
const ROWS_COMPARED: u32 = 2000;
/// A reduced model may take this many times as long as the whole one, plus `SLOWER_SECONDS` seconds.
const SLOWER_TIMES: f64 = 100.0;
const SLOWER_SECONDS: f64 = 60.0;

/// A request for a reduction.
pub struct Setup<'a> {
    /// The model.
    pub text: &'a Text,
    /// What it is compiled with.
    pub options: Options,
    /// How far a probe may move, relative.
    pub error: f64,
    /// End of the run, s.
    pub stop: f64,
    /// How continuous regions are stepped.
    pub setting: Setting,
    /// Signals from outside.
    pub given: Vec<(String, InputSignal)>,
    /// What runs the programs.
    pub backend: &'a dyn Backend,
    /// How runs are measured.
    pub thresholds: Thresholds,
}

/// The result of a reduction.
pub struct Reduction {
    /// Name of the model.
    pub model: String,
    /// What was asked for.
    pub error: f64,
    /// End of the run, s.
    pub stop: f64,
    /// How it was stepped.
    pub setting: Setting,
    /// What no probe, port or expectation depends on, so that it never runs.
    pub unneeded: LeftOut,
    /// All other parts, the least active first.
    pub parts: Vec<Entry>,
    /// The model as it is.
    pub whole: Size,
    /// The model without what is left out.
    pub reduced: Size,
    /// How far each probe moved, relative.
    pub moved: Vec<(String, f64)>,
}

impl Reduction {
    /// What is left out, in order of declaration.
    pub fn without(&self) -> Vec<&str> {
        let mut list: Vec<&Entry> = self.parts.iter().filter(|e| e.kept.is_none()).collect();
        list.sort_by_key(|e| e.part.members.clone());
        list.into_iter().map(|e| e.part.name.as_str()).collect()
    }
}

/// A part, and whether it was left out.
pub struct Entry {
    /// The part.
    pub part: Part,
    /// The integral of |power| over the run, J.
    pub activity: f64,
    /// Its activity relative to that of all parts.
    pub share: f64,
    /// Why it is kept; None if it is left out.
    pub kept: Option<String>,
}

/// The size of a model, and the cost of its run.
pub struct Size {
    /// Storages, resistors and fields.
    pub parts: usize,
    /// Energy states.
    pub states: usize,
    /// Steps of continuous regions.
    pub steps: u64,
    /// Processor time for a simulated second, s.
    pub seconds: f64,
}

/// A compiled model to be run.
struct Trial {
    compiled: Compiled,
    way: Way,
}

impl Trial {
    fn new(text: &Text, options: &Options) -> Result<Self, bond::Errors> {
        let compiled = options.compile_text(text)?;
        let scene = compiled.scene().clone();
        Ok(Self { compiled, way: Way { name: "the model", order: 0, passive: true, adaptive: true, scene } })
    }

    fn on<T>(&self, setup: &Setup, work: impl FnOnce(&Runner) -> T) -> T {
        let rows = || -> Box<dyn Iterator<Item = (f64, Look)>> {
            Box::new((0..ROWS_COMPARED).map(|k| (setup.stop * f64::from(k) / f64::from(ROWS_COMPARED), Look::Keep)))
        };
        let (stop, given) = (setup.stop, setup.given.as_slice());
        let task = Task {
            stop,
            longest: None,
            every: None,
            given,
            rows: &rows,
            shows: false,
            ledger: false,
            thresholds: setup.thresholds,
        };
        let kernels = Kernels::new(setup.backend);
        work(&Runner::new(&self.way, &task, &kernels))
    }

    /// Runs once through the rows, for `limit` seconds at most.
    fn run(&self, setup: &Setup, limit: f64) -> Result<Run, Lost> {
        self.on(setup, |runner| runner.track(setup.setting, limit))
    }

    fn size(&self, setup: &Setup) -> Result<Size, Lost> {
        let timing = setup.thresholds.timing;
        let (run, seconds) = self.on(setup, |runner| timed(runner, setup.setting, timing.readings, timing.limit))?;
        let stages = self.compiled.stages();
        Ok(Size {
            parts: reduction::parts(&stages.model).len(),
            states: stages.form.regions.iter().map(|r| r.states.len()).sum(),
            steps: run.steps,
            seconds: seconds / setup.stop,
        })
    }
}

/// Reduces.
///
/// # Errors
/// A model that is wrong, has no probes, or fails as a whole.
pub fn reduce(setup: &Setup, progress: &dyn Fn(f64)) -> Result<Reduction, Stop> {
    let compile = |options: &Options| Trial::new(setup.text, options).map_err(|e| input::wrong(&e));
    let fails = |lost| match lost {
        Lost::Failed(why) => Stop::Numerics(format!("the whole model does not run to its end: {why}")),
        Lost::Late => Stop::Numerics("the whole model takes too long".into()),
    };
    let whole = compile(&setup.options)?;
    let name = whole.way.scene.name.clone();
    if whole.way.scene.probes.names.is_empty() {
        return Err(Stop::Model(format!(
            "`{name}` has no probe, so nothing says what it needs; add one, such as `probe x = spring.q`"
        )));
    }
    let quantities = Quantities::new(&whole.compiled);
    let run = whole.run(setup, f64::INFINITY).map_err(fails)?;
    let scales = quantities.scales(&run);
    let mut entries = active(setup, &whole)?;
    // Parts that are read, or bonded without a junction, are not tried.
    for entry in &mut entries {
        if entry.kept.is_none() {
            entry.kept = reduction::kept(&whole.compiled.stages().model, &entry.part.name);
        }
    }
    let order: Vec<usize> = (0..entries.len()).filter(|i| entries[*i].kept.is_none()).collect();
    let limit = SLOWER_TIMES * run.seconds + SLOWER_SECONDS;
    let attempt = |out: &[usize]| -> Result<Trial, String> {
        let options = out.iter().fold(setup.options.clone(), |o, i| o.without(&entries[*i].part.name));
        let trial = Trial::new(setup.text, &options).map_err(|e| first(&e))?;
        let other = trial.run(setup, limit).map_err(|lost| match lost {
            Lost::Failed(why) => format!("without it the run fails: {why}"),
            Lost::Late => "without it the run takes far longer".into(),
        })?;
        let moved = Difference::new(&other, &run, &scales).along;
        let far = moved.iter().copied().fold(0.0, f64::max);
        if far <= setup.error {
            return Ok(trial);
        }
        let worst = moved.iter().position(|x| *x == far).map_or("", |i| quantities.names[i].as_str());
        Err(format!("without it `{worst}` changes by {}", percent(far)))
    };
    let (mut out, mut best) = (Vec::new(), None);
    let mut why: Vec<(usize, String)> = Vec::new();
    // Several at a time while that succeeds, and half as many when it does not.
    let (mut i, mut size) = (0, 1);
    while i < order.len() {
        progress(i as f64 / order.len() as f64);
        let end = (i + size).min(order.len());
        let more: Vec<usize> = out.iter().chain(&order[i..end]).copied().collect();
        match attempt(&more) {
            Ok(trial) => {
                (out, best) = (more, Some(trial));
                (i, size) = (end, 2 * size);
            }
            Err(_) if end - i > 1 => size = (end - i).div_ceil(2),
            Err(reason) => {
                why.push((order[i], reason));
                (i, size) = (i + 1, 1);
            }
        }
    }
    for (i, reason) in why {
        entries[i].kept = Some(reason);
    }
    let best = best.unwrap_or(compile(&setup.options)?);
    let moved = Difference::new(&best.run(setup, f64::INFINITY).map_err(fails)?, &run, &scales).along;
    let moved = quantities.names.iter().cloned().zip(moved).collect();
    Ok(Reduction {
        model: name,
        error: setup.error,
        stop: setup.stop,
        setting: setup.setting,
        unneeded: whole.way.scene.left_out.clone(),
        whole: whole.size(setup).map_err(fails)?,
        reduced: best.size(setup).map_err(fails)?,
        parts: entries,
        moved,
    })
}

/// The parts of a model by their activity in a run, the least active first.
fn active(setup: &Setup, whole: &Trial) -> Result<Vec<Entry>, Stop> {
    let watched = Trial::new(setup.text, &setup.options.clone().powers()).map_err(|e| input::wrong(&e))?;
    let shown = whole.way.scene.probes.names.len();
    let run = watched
        .run(setup, f64::INFINITY)
        .map_err(|_| Stop::Numerics("the power of its parts is infinite or undefined at some row of the run".into()))?;
    let parts = reduction::parts(&whole.compiled.stages().model);
    let width = setup.stop / f64::from(ROWS_COMPARED);
    let rows: Vec<&[f64]> = run.rows.iter().map(Vec::as_slice).chain([run.end.as_slice()]).collect();
    let integral = |k: usize| -> f64 {
        rows.windows(2).map(|w| 0.5 * width * (w[0][shown + k].abs() + w[1][shown + k].abs())).sum()
    };
    let mut list: Vec<Entry> = parts
        .into_iter()
        .enumerate()
        .map(|(k, part)| {
            let kept = (!part.power).then(|| "effort times flow is not a power at its bond".to_string());
            let activity = if part.power { integral(k) } else { 0.0 };
            Entry { part, activity, share: 0.0, kept }
        })
        .collect();
    let total: f64 = list.iter().map(|e| e.activity).sum();
    for entry in &mut list {
        entry.share = if total > 0.0 { entry.activity / total } else { 0.0 };
    }
    list.sort_by(|a, b| a.activity.total_cmp(&b.activity));
    Ok(list)
}

/// The first error of a model without a part.
fn first(errors: &bond::Errors) -> String {
    let message = errors.list().first().map_or("it does not compile", |d| d.message.as_str());
    format!("without it: {}", message.replace('\n', " "))
}

/// A part of a whole in percent, with two digits.
pub fn percent(x: f64) -> String {
    let x = 100.0 * x;
    match x.abs() {
        0.0 => "0 %".into(),
        s if (1e-3..1e3).contains(&s) => {
            let digits = (1 - s.log10().floor() as i32).max(0) as usize;
            format!("{x:.digits$} %")
        }
        _ => format!("{x:.1e} %"),
    }
}
