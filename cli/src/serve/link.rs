//! Lines to the outside.

use super::clock;
use super::pipe::Pipe;
use super::shared::Shared;
use super::udp::Udp;
use crate::stop::Stop;
use bond::exchange::{Effort, Measurement};

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

/// A line to the outside.
pub enum Link {
    /// Datagrams.
    Udp(Udp),
    /// Standard input and output.
    Pipe(Box<Pipe>),
    /// A file in memory that both ends read and write.
    Shared(Shared),
}

impl Link {
    /// Hands over what is held.
    ///
    /// # Errors
    /// Nobody reads it any more.
    pub fn send(&mut self, effort: &Effort) -> Result<(), Stop> {
        match self {
            Link::Udp(l) => {
                l.send(effort);
                Ok(())
            }
            Link::Pipe(l) => l.send(effort),
            Link::Shared(l) => l.send(effort),
        }
    }

    /// What came, if something did; it does not wait.
    ///
    /// # Errors
    /// What came makes no sense, and nothing after it can.
    pub fn receive(&mut self) -> Result<Option<Arrival>, Stop> {
        match self {
            Link::Udp(l) => Ok(l.receive()),
            Link::Pipe(l) => l.receive(),
            Link::Shared(l) => Ok(l.receive()),
        }
    }

    /// Whether packets may be lost, so that an effort is sent again until it is answered.
    pub fn repeats(&self) -> bool {
        match self {
            Link::Udp(_) | Link::Shared(_) => true,
            Link::Pipe(_) => false,
        }
    }

    /// Whether the outside has gone.
    pub fn is_over(&self) -> bool {
        match self {
            Link::Udp(_) | Link::Shared(_) => false,
            Link::Pipe(l) => l.is_over(),
        }
    }

    /// Packets that could not be read, or came from somebody else.
    pub fn refused(&self) -> u64 {
        match self {
            Link::Udp(l) => l.refused(),
            Link::Pipe(_) | Link::Shared(_) => 0,
        }
    }

    /// What it is, in words.
    pub fn name(&self) -> String {
        match self {
            Link::Udp(l) => l.name(),
            Link::Pipe(l) => l.name(),
            Link::Shared(l) => l.name(),
        }
    }
}
