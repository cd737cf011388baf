//! The steppers that a model can be run with, each with its scene.

use crate::input;
use crate::stop::Stop;
use bond::internal::CompiledInternals;
use bond::{Compiled, Errors, Options, Text};
use bond_compiler::discretise::Method;
use bond_runtime::scene::Scene;

/// A scene whose continuous regions are stepped by one method. Sampled regions are as the model says: their period and
/// their stepper are part of it.
pub struct Way {
    /// `gonzalez`
    pub name: &'static str,
    /// Its order; 0 if it has no error.
    pub order: u32,
    /// Whether it keeps the balance.
    pub passive: bool,
    /// Whether its steps can be fitted to a tolerance.
    pub adaptive: bool,
    /// What runs.
    pub scene: Scene,
}

/// A method that is not there, and why.
pub struct LeftOut {
    /// `exact`
    pub name: &'static str,
    /// In words.
    pub why: String,
}

/// All of them.
pub struct Ways {
    /// The model as it says itself.
    pub base: Compiled,
    /// Those that can run it, in the order of [`Method::ALL`].
    pub list: Vec<Way>,
    /// Those that cannot.
    pub left_out: Vec<LeftOut>,
}

impl Ways {
    /// Compiles a model for each of the methods that `wanted` takes.
    ///
    /// # Errors
    /// A wrong model, or one without continuous regions.
    pub fn new(text: &Text, options: &Options, wanted: &dyn Fn(Method) -> bool) -> Result<Self, Stop> {
        let mut ways = Self::base(text, options)?;
        ways.add(text, options, wanted);
        Ok(ways)
    }

    /// Compiles a model as it says itself.
    ///
    /// # Errors
    /// A wrong model, or one without continuous regions.
    pub fn base(text: &Text, options: &Options) -> Result<Self, Stop> {
        let base = options.compile_text(text).map_err(|e| input::wrong(&e))?;
        if base.scene().clusters.iter().all(|c| c.period.is_some()) {
            return Err(Stop::Model(format!(
                "`{}` has no continuous region: every region steps at its own period, which is part of the model, so \
                there is no stepper to choose",
                base.scene().name
            )));
        }
        Ok(Self { base, list: Vec::new(), left_out: Vec::new() })
    }

    /// Compiles it for each of the methods that `wanted` takes.
    pub fn add(&mut self, text: &Text, options: &Options, wanted: &dyn Fn(Method) -> bool) {
        for method in Method::ALL.into_iter().filter(|m| wanted(*m)) {
            let name = method.name();
            let made = options.clone().method(name).compile_text(text).map_err(|e| first(&e));
            match made.and_then(|made| join(made.scene(), self.base.scene(), name)) {
                Ok(way) => self.list.push(way),
                Err(why) => self.left_out.push(LeftOut { name, why }),
            }
        }
    }

    /// The model as it says itself, where all its continuous regions are stepped by a method without error.
    pub fn without_error(&self) -> Option<Way> {
        let scene = self.base.scene();
        let mut steppers = scene.clusters.iter().filter(|c| c.period.is_none()).map(|c| &c.step);
        let name = Method::named(&steppers.next()?.name)?.name();
        let way = join(scene, scene, name).ok()?;
        let exact = way.order == 0 && !way.adaptive;
        exact.then_some(way)
    }
}

/// The continuous clusters of a scene that was compiled for a method, with the sampled ones of the model itself.
fn join(made: &Scene, base: &Scene, name: &'static str) -> Result<Way, String> {
    let mut scene = made.clone();
    if scene.clusters.len() != base.clusters.len() {
        return Err("it would group the regions differently".into());
    }
    for (own, asked) in scene.clusters.iter_mut().zip(&base.clusters) {
        if asked.period.is_some() {
            own.clone_from(asked);
        }
    }
    let continuous = || scene.clusters.iter().filter(|c| c.period.is_none());
    if continuous().all(|c| c.step.name != name) {
        let others: Vec<&str> = continuous().map(|c| c.step.name.as_ref()).collect();
        return Err(format!("no continuous region takes it ({} does)", others.first().unwrap_or(&"another")));
    }
    let order = continuous().filter(|c| c.step.name == name).map(|c| c.step.properties.order).min().unwrap_or(0);
    let passive = continuous().all(|c| c.step.properties.passive);
    let adaptive = continuous().any(|c| c.step.linear.is_none());
    Ok(Way { name, order, passive, adaptive, scene })
}

/// What is wrong first, on a line.
fn first(errors: &Errors) -> String {
    errors.list().first().map_or_else(String::new, |d| d.message.replace('\n', " "))
}
