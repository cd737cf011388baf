//! Measurements that came, and how many packets are remembered.

use super::clock;
use bond::exchange::Measurement;

/// Efforts that are remembered until their answer comes.
pub const EFFORTS_KEPT: usize = 4096;

/// Most measurements that wait to be taken.
pub const MEASUREMENTS_QUEUED: usize = 256;

/// A measurement that came.
#[derive(Clone, Copy, Debug)]
pub struct Arrival {
    /// When, ns of [`clock::now`].
    pub at: u64,
    /// What it says.
    pub measurement: Measurement,
}

impl Arrival {
    /// It came now.
    pub fn now(measurement: Measurement) -> Self {
        Self { at: clock::now(), measurement }
    }
}
