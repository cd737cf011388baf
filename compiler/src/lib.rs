//! From a syntax tree to step programs: elaboration, graph, causality, port-Hamiltonian structure, discretisation, and
//! the back ends that make code of step programs. It opens no files and reads no clock.
//!
//! # Stages
//!
//! [`compile`] runs all but the last in this order; between `graph` and `causality`, [`slice`](mod@slice) leaves out
//! what the scene does not need. `bond show` prints graph, causality, form, regions and programs.
//!
//! | module | gives | holds afterwards |
//! | --- | --- | --- |
//! | [`elaborate`] | [`Model`] | every instance is expanded, every name resolved, every value an expression in SI, every unit checked; the model owns the [`Pool`](expression::Pool) of expressions |
//! | [`graph`] | [`BondGraph`] | elements and bonds; cutting the double bars left connected regions, continuous or sampled |
//! | [`causality`] | [`Causality`] | one stroke per bond, with the reason for it; no two causes conflict. The graph may be another one then: massless inertias and multipliers are added |
//! | [`structure`] | [`Form`] | one *column* per element, which receives one variable and gives the other; inputs = D outputs, and D is skew (`Form::validate`); storages in derivative causality are merged into others |
//! | [`discretise`] | [`Scene`] | step programs of each cluster, verified; ledger entries, probes, schedule |
//! | [`backend`] | kernels, C, objects, modules | the same operations in the same order as the interpreter's; bits differ only in functions that the host computes |
//!
//! Everything runs in the order of declarations, and sums and products are sorted, so the same text gives the same
//! programs. All errors are [`Diagnostic`]s; no input panics.
//!
//! # What is evaluated when
//!
//! - *When the model is compiled*: parameters, indices, bounds of loops, initial states, and the start of algebraic
//!   loops (by Newton's method at t = 0). Expressions are exact fractions as long as possible, and become `f64` once.
//! - *When a step length is new*: tables, such as the matrix exponential of `exact`.
//! - *In each step*: everything else, by step programs. What a program may assume, and what may be assumed of it, is in
//!   the documentation of [`bond_runtime`].
//!
//! # Where a step is written
//!
//! Each step method is a module of [`discretise`]. Its function gets a *cluster* (what steps as one, see
//! [`bond_runtime::scene`]) and writes one step of it with a [`Builder`](bond_runtime::ir::Builder). It sees columns
//! and energies, never bonds. It returns the stepper (a step program and its properties) and the entries of the ledger.
//!
//! The interpreter runs the program as it is. For the other back ends `backend/lower` turns it into a
//! `backend::code::Routine` (statements, loops, branches). `backend/native` gives that to Cranelift; `backend/c` and
//! `backend/wasm` print it. `backend::standalone` makes routines for a whole scene, with its schedule and ledger.
//!
//! # Example
//!
//! ```
//! use bond_compiler::{Options, compile, elaborate::NoFiles};
//! use bond_grammar::source::Sources;
//!
//! let mut sources = Sources::new();
//! let main = sources.add("oscillator.bond", "
//!     model Oscillator {
//!       C:spring { stiffness = 4 N/m;  q0 = 1 m }
//!       I:mass = 1 kg
//!       1:v -> spring, mass
//!       probe x = spring.q
//!     }");
//! let compiled = compile(&mut sources, main, &mut NoFiles, &Options::default()).unwrap();
//!
//! // The structure: two columns, tied by a skew D.
//! let form = &compiled.stages.form;
//! assert_eq!(form.columns.len(), 2);
//! assert!(form.validate(&compiled.stages.model.pool).is_ok());
//!
//! // The scene: one cluster, linear, so it is stepped by the matrix exponential.
//! let cluster = &compiled.scene.clusters[0];
//! assert_eq!(cluster.step.name, "exact");
//! assert!(cluster.step.program.verify().is_ok());
//! println!("{}", cluster.step.program);
//! ```
//!
//! # How to add a stepper
//!
//! 1. `discretise/steppers/NAME.rs`: a function that writes the step of a `Cluster` with the builder, and returns a
//!    `Stepper` and the ledger's `Entries`. `discretise/equations/` has the common pieces: inputs, Newton's method,
//!    error weights, the terms of the ledger. `gonzalez.rs` is the shortest implicit one. Where it cannot step a
//!    cluster it says so in words (`Refusal::Unfit`). It writes each slot of `n` once, in the order states, integrals,
//!    guesses, carries, memory, and ends with `verified`.
//! 2. `discretise/steppers/mod.rs`: its `mod`, and a row of the table, with what it is, its name, its
//!    [`Properties`](bond_runtime::scene::Properties), the regions that it steps, and the function. The runtime and the
//!    command read the properties and never ask for the name. (The compiler asks for `ray`, in the partition and the
//!    hold.)
//! 3. A row in `docs/theory/steppers.md`, which has the table of methods. If it is to be taken unasked, a rule of
//!    `discretise/choice.rs`, with a model on which it decides.
//!
//! `tests/tests/hard.rs` tries it if it is passive. Its name in `orders.rs`, `backend.rs` and `emitted.rs` beside that
//! has its order and its bits tested.
//!
//! # How to add a back end
//!
//! 1. `backend/NAME/`: a printer of the statements of `backend/code.rs`, each with the meaning that
//!    [`eval`](bond_runtime::eval) gives its operations (NaN, signed zeros). It looks at nothing else of a program.
//!    `lower::with_solvers` writes large systems out for it.
//! 2. `backend/mod.rs`: its module. If `bond build` writes it: an `Emitter` of a
//!    `backend::standalone::StandaloneModule`, which is a row of [`EMITTERS`](backend::EMITTERS). If it runs inside
//!    `bond`: a [`Backend`](bond_runtime::kernel::Backend) that makes a `Kernel`, and uses the interpreter for programs
//!    that `lower` does not take.
//! 3. A test: `tests/tests/backend.rs` (random programs, special values) or `tests/tests/emitted.rs` (whole scenes). It
//!    must give the interpreter's bits, except where the host computes a function
//!    (`docs/reference/embedding.md`, Same bits).
//!
//! # How to add an element kind
//!
//! 1. `model.rs`: a role of [`OnePort`](model::OnePort) or [`TwoPort`](model::TwoPort), and a variant of
//!    [`Law`](model::Law) if none fits. The compiler then lists the places that must know it.
//! 2. `element/`: its file, which reads fields and makes the law, called from `elaborate/finish.rs`; a line in
//!    `element::ALL`.
//! 3. `elaborate/join.rs`: how many bonds it takes; `elaborate/reading.rs`: its signals.
//! 4. `causality/strokes.rs`: which variable it must or would like to impose, and `propagate.rs` if it has several
//!    bonds; `structure/mod.rs`: the role of its column, or `causality/junction.rs` its rule.
//! 5. `show/`: how it is drawn; `models/elements/`: the smallest model with it; `docs/reference/language.md`.
//!
//! # How to add a scalar operation
//!
//! A function of one value of a mathematical library:
//! 1. `runtime/src/ir/op.rs`: a row at the end of `unary!` with its name and its function. The language, all back ends
//!    and the text of programs have it then.
//! 2. `expression/unary.rs`: a row with its derivative and what else is known of it.
//! 3. `docs/reference/language.md`: its name; `elaborate/suggest.rs`: what was suggested in its place.
//!
//! C takes the function from the host under this name, and modules import it (`docs/reference/embedding.md`). An
//! instruction, or an operation of two values, is a row of `binary!` or `unary!` too. Back ends name those:
//! `c/print.rs`, `wasm/print.rs` and `native/` say how each is written.

#![cfg_attr(not(test), warn(clippy::disallowed_methods))]

pub mod backend;
pub mod causality;
pub mod discretise;
pub mod elaborate;
pub mod element;
pub mod expression;
pub mod graph;
pub mod linearize;
pub mod model;
mod modes;
pub mod rates;
pub mod reduction;
pub mod show;
pub mod slice;
pub mod structure;
pub mod thresholds;
pub mod units;

use bond_grammar::ast::Item;
use bond_grammar::diagnostic::{Diagnostic, once};
use bond_grammar::source::{SourceId, Sources};
use bond_runtime::options::NumericOptions;
use bond_runtime::scene::{LeftOut, Scene};
use causality::Causality;
use elaborate::{Broken, Loader};
use graph::BondGraph;
use model::Model;
use slice::Unneeded;
use structure::Form;
use thresholds::Thresholds;
use units::{BaseUnits, Dimension};

/// What the user asks for besides the text.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// The scene; the last model of the file where absent.
    pub model: Option<String>,
    /// Parameters by path: a number with its unit, or without one in SI.
    pub set: Vec<(String, f64, Option<Dimension>)>,
    /// The stepper, in the place of the one that `simulate` names.
    pub method: Option<String>,
    /// What was asked of the accuracy, by which a stepper that is not named is chosen.
    pub accuracy: discretise::Accuracy,
    /// Length of the run's steps, or of the longest, s, in the place of what `simulate` says.
    pub step: Option<f64>,
    /// End of the run, s, in the place of what `simulate` says.
    pub stop: Option<f64>,
    /// Parts that are left out, by path.
    pub without: Vec<String>,
    /// Whether the scene's probes end with the powers of its [`reduction::parts`].
    pub powers: bool,
    /// Whether what the scene does not need runs too.
    pub whole: bool,
    /// Bounds on the size of the model.
    pub limits: elaborate::Limits,
    /// The base units that all numbers are in: for tests.
    pub base_units: BaseUnits,
    /// The numbers that numeric methods go by: for tests, which see what each of them is for.
    pub numeric: NumericOptions,
    /// The numbers that step programs are chosen and written by, likewise.
    pub thresholds: Thresholds,
}

/// The part of a run that a long one of its fitted steps takes.
const PART: f64 = 0.01;

impl Options {
    /// How long the steps are that programs are made for, s.
    fn pace(&self, settings: &model::Settings) -> f64 {
        self.step.or(settings.step).unwrap_or(PART * self.stop.or(settings.stop).unwrap_or(1.0))
    }
}

/// A compiled model, with all that was made on the way.
#[derive(Clone, Debug)]
pub struct Compiled {
    /// What runs: all that the scene needs.
    pub stages: Stages,
    /// All of the model, where there is more.
    pub whole: Option<Box<Whole>>,
    /// The step programs.
    pub scene: Scene,
}

/// A model and what is made of it before its step programs.
#[derive(Clone, Debug)]
pub struct Stages {
    /// The flat model, which holds the expressions of everything below.
    pub model: Model,
    /// The bond graph.
    pub graph: BondGraph,
    /// Its strokes.
    pub causality: Causality,
    /// Its port-Hamiltonian form.
    pub form: Form,
}

/// A model of which a part is left out, as it is written.
#[derive(Clone, Debug)]
pub struct Whole {
    /// All of it.
    pub stages: Stages,
    /// What is left out.
    pub unneeded: Unneeded,
}

/// Compiles a source: text to step programs.
///
/// # Errors
/// All that is wrong with it, in order of place.
pub fn compile(
    sources: &mut Sources,
    main: SourceId,
    loader: &mut dyn Loader,
    options: &Options,
) -> Result<Compiled, Vec<Diagnostic>> {
    let loaded = load(sources, main, loader);
    compile_loaded(sources, &loaded, options)
}

/// A source and all that it uses, parsed: to be compiled many times with other options.
#[derive(Debug)]
pub struct Loaded {
    main: SourceId,
    files: elaborate::Files,
    errors: Vec<Diagnostic>,
}

impl Loaded {
    /// The names of the source's functions, where it has no model: there is nothing to compile, but other files may use
    /// it.
    pub fn functions_alone(&self) -> Vec<&str> {
        let items = self.files.list.first().map_or(&[][..], |file| &file.items);
        if items.iter().any(|item| matches!(item, Item::Model(_))) {
            return Vec::new();
        }
        self.files.functions_of(0).map(|(_, f)| f.name.text.as_str()).collect()
    }

    /// That the scene is the last model of the file, where another model may have been meant: one without ports that
    /// has outputs, settings or expectations, or that uses the last one, and that the last one does not use.
    pub fn other_scene(&self, options: &Options) -> Option<String> {
        if options.model.is_some() {
            return None;
        }
        let (scene, others) = self.files.other_scenes();
        let scene = scene?;
        let (user, first) = (others.iter().find(|o| o.1), others.first()?);
        Some(match user {
            Some((name, _)) => format!(
                "`{scene}` is the scene because it stands last in its file; `--model {name}` takes `{name}`, which uses it"
            ),
            None => {
                let names: Vec<String> = others.iter().map(|o| format!("`{}`", o.0)).collect();
                let more =
                    if names.len() > 1 { format!(" (others are {})", names[1..].join(", ")) } else { String::new() };
                format!(
                    "`{scene}` is the scene because it stands last in its file; `--model {0}` takes `{0}`{more}",
                    first.0
                )
            }
        })
    }
}

/// Reads and parses a source, and all that it uses. What is wrong with them is said when it is compiled.
pub fn load(sources: &mut Sources, main: SourceId, loader: &mut dyn Loader) -> Loaded {
    let mut errors = Vec::new();
    let files = elaborate::load(sources, main, loader, &mut errors);
    Loaded { main, files, errors }
}

/// Compiles what was loaded, with the sources that it was loaded into.
///
/// # Errors
/// All that is wrong with it, in order of place.
pub fn compile_loaded(sources: &Sources, loaded: &Loaded, options: &Options) -> Result<Compiled, Vec<Diagnostic>> {
    let elaborated = elaborate::elaborate(sources, loaded.main, &loaded.files, options, loaded.errors.clone());
    let mut model = elaborated.map_err(|broken| all_errors(broken, options))?;
    model.remarks.extend(loaded.other_scene(options));
    reduction::leave_out(&mut model, &options.without)?;
    model.settings.thresholds = options.thresholds;
    model.settings.pace = options.pace(&model.settings);
    model.settings.end = options.stop.or(model.settings.stop).unwrap_or(1.0);
    if options.method.is_some() {
        model.settings.method = None; // it does not count
    }
    let method = discretise::method(&model, options);
    let graph = graph::build(&model);
    let unneeded = Unneeded::of(&model, &graph).filter(|_| !options.whole);
    let mut needed = unneeded.map(|u| (u.names(&model, &graph), u.without(model.clone(), &graph), u));
    if options.powers {
        reduction::watch(needed.as_mut().map_or(&mut model, |n| &mut n.1));
    }
    let (mut stages, method) = match (structured(model, graph), method) {
        (Ok(stages), Ok(method)) => (stages, method),
        (stages, method) => return Err([stages.err(), method.err()].into_iter().flatten().flatten().collect()),
    };
    let (mut left_out, mut whole) = (LeftOut::default(), None);
    if let Some((names, model, unneeded)) = needed {
        let graph = graph::build(&model);
        let all = std::mem::replace(&mut stages, structured(model, graph)?);
        (left_out, whole) = (names, Some(Box::new(Whole { stages: all, unneeded })));
    }
    let scene = discretise::discretise(&mut stages.model, &stages.form, method, (options.accuracy, options.step))?;
    Ok(Compiled { stages, whole, scene: Scene { left_out, numeric: options.numeric, ..scene } })
}

/// The strokes and the form; a condition that cannot be told is wrong here too. What is wrong in every round of a loop
/// is said once.
fn structured(mut model: Model, graph: BondGraph) -> Result<Stages, Vec<Diagnostic>> {
    let within = graph.bars_within(&model);
    if !within.is_empty() {
        return Err(once(within));
    }
    let (graph, causality) = causality::assign(&mut model, graph).map_err(once)?;
    let (graph, causality, form) = structure::build(&mut model, graph, causality).map_err(once)?;
    let mixed = discretise::mixed(&model, &form);
    if mixed.is_empty() { Ok(Stages { model, graph, causality, form }) } else { Err(mixed) }
}

/// What is wrong with a model: what its elaboration says, and what the later stages say where all but outputs and units
/// is right.
fn all_errors(Broken { mut errors, model }: Broken, options: &Options) -> Vec<Diagnostic> {
    let Some(mut model) = model else { return errors };
    errors.extend(discretise::method(&model, options).err().unwrap_or_default());
    // Where a unit is wrong, so may be the number, and by numbers goes the form.
    let later = if errors.iter().any(|e| e.code.starts_with("units::")) {
        let graph = graph::build(&model);
        causality::assign(&mut model, graph).err().map(once)
    } else {
        let graph = graph::build(&model);
        structured(*model, graph).err()
    };
    errors.extend(later.unwrap_or_default());
    errors
}
