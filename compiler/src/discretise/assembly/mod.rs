//! What a scene has of each cluster: its step, holds, guards, stored energies and observation; and probes.

pub(crate) mod build;
pub(crate) mod guards;
pub(crate) mod hold;
pub(crate) mod observation;
pub(crate) mod probes;
pub(crate) mod stored_energy;
pub(crate) mod switching;
pub(crate) mod watched;
