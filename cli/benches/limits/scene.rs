//! Scenes that run in this process: driven as `bond run` does, or their step alone.

use super::figure::Figure;
use bond::internal::{Code, CompiledInternals, SimulationInternals, StepsInternals};
use bond::{Compiled, Options, Simulation, Steps};
use bond_runtime::exponential;
use bond_runtime::interpreter::Interpret;
use bond_runtime::kernel::{Backend, Kernel, Workspace};
use bond_runtime::simulate;

/// Compiles a figure's scene.
///
/// # Errors
/// What is wrong with it.
pub fn compile(figure: &Figure) -> Result<Compiled, String> {
    compile_text(figure.text, figure.method, figure.text.contains("n = ").then_some(figure.size))
}

/// Compiles a text, with so many cells.
///
/// # Errors
/// What is wrong with it.
pub fn compile_text(text: &str, method: Option<&str>, cells: Option<usize>) -> Result<Compiled, String> {
    let mut options = Options::new();
    if let Some(m) = method {
        options = options.method(m);
    }
    if let Some(n) = cells {
        options = options.set("n", &n.to_string());
    }
    options.compile_str("limits.bond", text).map_err(|e| e.to_string())
}

/// How a figure's scene is stepped.
///
/// # Errors
/// A step that makes no sense.
pub fn options(figure: &Figure, compiled: &Compiled) -> Result<simulate::Options, String> {
    let settings = &compiled.stages().model.settings;
    Steps::fixed(figure.step).resolve(settings, 1.0, None).map_err(|e| e.to_string())
}

/// Scenes stepped by the runtime's own driver, ledger included.
pub struct Driven<'a> {
    sims: Vec<Simulation<'a>>,
    step: f64,
    pulls: bool,
    done: u64,
}

impl<'a> Driven<'a> {
    /// At their start.
    ///
    /// # Errors
    /// In words.
    pub fn new(figure: &Figure, compiled: &'a Compiled, code: Code) -> Result<Self, String> {
        let options = options(figure, compiled)?;
        let shared = code.shared(figure.scenes as u64);
        let backend: &dyn Backend = if figure.scenes > 1 { &*shared } else { code.backend() };
        let sims = (0..figure.scenes)
            .map(|_| Simulation::on(backend, compiled.scene(), &options, []).map_err(|e| e.to_string()))
            .collect::<Result<Vec<_>, _>>()?;
        Ok(Self { sims, step: figure.step, pulls: figure.pulls, done: 0 })
    }

    /// Goes so many steps on.
    ///
    /// # Errors
    /// A step that fails.
    pub fn go(&mut self, steps: u64) -> Result<(), String> {
        let end = self.done + steps;
        while self.done < end {
            let mut next = end;
            if self.pulls {
                let at = self.done % 30;
                let push = match at {
                    0 => Some(5.0),
                    25 => Some(-5.0),
                    _ => None,
                };
                if let Some(push) = push {
                    for sim in &mut self.sims {
                        sim.set_input("push", push).map_err(|e| e.to_string())?;
                    }
                }
                next = next.min(self.done + if at < 25 { 25 - at } else { 30 - at });
            }
            for sim in &mut self.sims {
                sim.advance(next as f64 * self.step).map_err(|e| e.to_string())?;
            }
            self.done = next;
        }
        Ok(())
    }

    /// Probes of the first one.
    ///
    /// # Errors
    /// An observation that fails.
    pub fn probes(&mut self) -> Result<Vec<f64>, String> {
        match self.sims.first_mut() {
            Some(sim) => sim.probes().map(<[f64]>::to_vec).map_err(|e| e.to_string()),
            None => Ok(Vec::new()),
        }
    }
}

/// The step of a scene with one cluster and nothing around it: no clock, no ledger.
pub struct Bare {
    kernel: Box<dyn Kernel>,
    work: Workspace,
    state: Vec<f64>,
    input: Vec<f64>,
    table: Vec<f64>,
}

impl Bare {
    /// At its start; None where a scene has several clusters.
    pub fn new(figure: &Figure, compiled: &Compiled) -> Option<Self> {
        let scene = compiled.scene();
        let [cluster] = &scene.clusters[..] else { return None };
        let options = options(figure, compiled).ok()?;
        let start = simulate::Simulation::on(&Interpret, scene, &options, Vec::new()).ok()?.start();
        let start = start.clusters.into_iter().next()?;
        let table = match &cluster.step.linear {
            Some(linear) => exponential::table(linear, figure.step).ok()?,
            None => Vec::new(),
        };
        let kernel = Code::Native.backend().kernel(&cluster.step.program);
        let work = kernel.workspace();
        let mut input = start.input;
        *input.get_mut(1)? = figure.step;
        Some(Self { kernel, work, state: start.state, input, table })
    }

    /// Goes so many steps on.
    ///
    /// # Errors
    /// A step that fails.
    pub fn go(&mut self, steps: u64) -> Result<(), String> {
        for _ in 0..steps {
            self.kernel.run(&self.state, &self.input, &self.table, &mut self.work).map_err(|e| e.to_string())?;
            let n = self.work.next.len();
            self.state[..n].copy_from_slice(&self.work.next);
        }
        Ok(())
    }
}
