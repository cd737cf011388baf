//! What a scene starts from, for those who carry on by themselves: compiled scenes that run without this crate.

use super::schedule::Simulation;

/// A scene at its start, its first samples taken.
#[derive(Clone, Debug, Default)]
pub struct Start {
    /// By cluster.
    pub clusters: Vec<StartCluster>,
    /// Sampled clusters in the order in which they take a common sample: those that answer before those that hold.
    pub order: Vec<usize>,
    /// Clusters whose signals others read.
    pub read: Vec<usize>,
    /// Clusters that probes read.
    pub probed: Vec<usize>,
}

/// A cluster at its start.
#[derive(Clone, Debug, Default)]
pub struct StartCluster {
    /// Its state.
    pub state: Vec<f64>,
    /// The inputs of its programs.
    pub input: Vec<f64>,
    /// H of each of its regions, J.
    pub energies: Vec<f64>,
    /// The least that each can be, J.
    pub least: Vec<f64>,
    /// Whether samples of others concern it.
    pub connected: bool,
    /// The ports that it holds, in order.
    pub held: Vec<StartHeld>,
    /// How the answer over a period falls with what is held: a matrix of the held ports.
    pub beta: Vec<f64>,
    /// The same of the periods after, apart from what follows from the answers before: [`super::TERMS`] matrices.
    pub gamma: Vec<f64>,
    /// What the interval that runs puts at risk, J.
    pub risk: f64,
    /// The most that it ever was, J.
    pub most: f64,
    /// What follows from them: [`super::RECURRENCE`] numbers for each held port.
    pub decay: Vec<f64>,
}

/// A port that a sampled cluster holds.
#[derive(Clone, Copy, Debug, Default)]
pub struct StartHeld {
    /// Its cluster's port.
    pub port: usize,
    /// The double bar, if it is one.
    pub bar: Option<usize>,
    /// The open port, if it is one.
    pub open: Option<usize>,
    /// What is held.
    pub value: f64,
    /// What its alpha is foretold to be.
    pub forecast: f64,
}

impl Simulation<'_> {
    /// What it starts from, or goes on from.
    pub fn start(&self) -> Start {
        let cluster = |i: usize| StartCluster {
            state: self.runs[i].state.clone(),
            input: self.runs[i].input.clone(),
            energies: self.runs[i].books.iter().map(|b| b.h).collect(),
            least: self.scene.clusters[i].entries.iter().map(|e| e.least).collect(),
            connected: self.connected[i],
            held: self.held[i]
                .iter()
                .map(|h| StartHeld { port: h.port, bar: h.bar, open: h.open, value: h.v, forecast: h.forecast })
                .collect(),
            beta: self.beta[i].clone(),
            gamma: self.gamma[i].clone(),
            risk: self.caution[i].risk,
            most: self.caution[i].most,
            decay: self.decay[i].clone(),
        };
        Start {
            clusters: (0..self.runs.len()).map(cluster).collect(),
            order: self.order.clone(),
            read: self.read.clone(),
            probed: self.probed.clone(),
        }
    }
}
