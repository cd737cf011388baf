//! The right side of a scene as a function, for integrators that know nothing of ports or energy: dx/dt = f(t, x).

use bond::internal::{Code, CompiledInternals, StepsInternals};
use bond::{Compiled, Options, Steps};
use bond_runtime::interpreter::Interpret;
use bond_runtime::kernel::{Kernel, Workspace};
use bond_runtime::simulate::Simulation;

/// The step that the rates are read off from: so long that the state is lost beside it, and a power of two, so that
/// nothing is rounded.
const LONG: f64 = (1u128 << 100) as f64;

/// A scene's right side: that of the explicit Euler step, taken apart again.
pub struct Field {
    step: Box<dyn Kernel>,
    work: Workspace,
    stored: Box<dyn Kernel>,
    shown: Workspace,
    state: Vec<f64>,
    input: Vec<f64>,
    energies: Vec<usize>,
    given: Vec<usize>,
    taken: Vec<usize>,
    guesses: std::ops::Range<usize>,
    /// Names of the states.
    pub names: Vec<String>,
    /// The state at the start.
    pub start: Vec<f64>,
    /// How often it was asked.
    pub calls: u64,
    whole: Vec<f64>,
}

impl Field {
    /// Of a compiled scene.
    ///
    /// # Errors
    /// In words, where it is not one continuous cluster.
    pub fn new(options: Options, path: &std::path::Path) -> Result<Self, String> {
        let compiled: Compiled = options.method("euler").compile_file(path).map_err(|e| first(&e.to_string()))?;
        let scene = compiled.scene();
        let [cluster] = &scene.clusters[..] else { return Err("it is sampled".into()) };
        if cluster.period.is_some() || !cluster.ports.is_empty() {
            return Err("it is sampled".into());
        }
        let settings = &compiled.stages().model.settings;
        let options = Steps::fixed(1.0).resolve(settings, 1.0, None).map_err(|e| e.to_string())?;
        let sim = Simulation::on(&Interpret, scene, &options, Vec::new()).map_err(|e| e.to_string())?;
        let begin = sim.start().clusters.into_iter().next().ok_or("there is nothing")?;
        let step = Code::Native.backend().kernel(&cluster.step.program);
        let stored = Code::Native.backend().kernel(&cluster.stored);
        let n = cluster.states;
        let ledger = |pick: &dyn Fn(&bond_runtime::scene::Entries) -> Vec<usize>| {
            cluster.entries.iter().flat_map(pick).collect()
        };
        Ok(Self {
            work: step.workspace(),
            step,
            shown: stored.workspace(),
            stored,
            energies: cluster.energies.iter().map(|e| e.1).collect(),
            given: ledger(&|e| e.supplied.iter().map(|s| s.1).collect()),
            taken: ledger(&|e| e.dissipated.iter().map(|s| s.1).collect()),
            guesses: n + cluster.integrals..n + cluster.integrals + cluster.guesses,
            names: cluster.names[..n].to_vec(),
            start: begin.state[..n].to_vec(),
            whole: begin.state.clone(),
            state: begin.state,
            input: begin.input,
            calls: 0,
        })
    }

    /// Back to the start: loops are looked for from there again.
    pub fn reset(&mut self) {
        self.state.copy_from_slice(&self.whole);
        self.calls = 0;
    }

    /// Rates at a state into `f`; gives the power that is supplied less what is lost, W. None where the loops of
    /// resistors have no solution that is found, or something is no number.
    pub fn rates(&mut self, t: f64, x: &[f64], f: &mut [f64]) -> Option<f64> {
        self.calls += 1;
        self.state[..x.len()].copy_from_slice(x);
        (self.input[0], self.input[1]) = (t, LONG);
        self.step.run(&self.state, &self.input, &[], &mut self.work).ok()?;
        for (i, f) in f.iter_mut().enumerate() {
            *f = (self.work.next[i] - x[i]) / LONG;
        }
        let (state, next, guesses) = (&mut self.state, &self.work.next, self.guesses.clone());
        if let Some(next) = next.get(guesses.clone()) {
            state[guesses].copy_from_slice(next);
        }
        let sum = |list: &[usize]| list.iter().map(|i| self.work.output[*i]).sum::<f64>();
        let power = (sum(&self.given) - sum(&self.taken)) / LONG;
        (power.is_finite() && f.iter().all(|f| f.is_finite())).then_some(power)
    }

    /// The energy at a state, J.
    pub fn energy(&mut self, t: f64, x: &[f64]) -> f64 {
        self.state[..x.len()].copy_from_slice(x);
        self.input[0] = t;
        match self.stored.run(&self.state, &self.input, &[], &mut self.shown) {
            Ok(()) => self.energies.iter().map(|i| self.shown.output[*i]).sum(),
            Err(_) => f64::NAN,
        }
    }
}

/// The first line that says something.
pub fn first(text: &str) -> String {
    text.lines().map(str::trim).find(|l| !l.is_empty()).unwrap_or_default().to_string()
}
