//! What a scene starts from, for those who carry on by themselves: compiled scenes that run without this crate.

use crate::energy::PortResponse;

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
    /// Whether a run takes the answers of other sides anew at its samples.
    pub takes_tangents: bool,
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
    /// Whether samples of others concern it.
    pub connected: bool,
    /// The ports that it holds, in order.
    pub held: Vec<StartHeld>,
    /// How the answer over a period falls with what is held: a matrix of the held ports.
    pub port_admittance: Vec<f64>,
    /// The same of the periods after, apart from what follows from the answers before: [`crate::energy::AR_ORDER`]
    /// matrices.
    pub delayed_response: Vec<f64>,
    /// What follows from them: [`crate::energy::AR_COEFFICIENTS`] numbers for each held port.
    pub ar_coefficients: Vec<f64>,
}

impl StartCluster {
    /// How the other sides respond to what it holds.
    pub fn response(&self, which: PortResponse) -> &[f64] {
        match which {
            PortResponse::PortAdmittance => &self.port_admittance,
            PortResponse::DelayedResponse => &self.delayed_response,
            PortResponse::ArCoefficients => &self.ar_coefficients,
        }
    }
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
}
