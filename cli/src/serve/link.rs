//! Lines to the outside.

use super::arrival::Arrival;
use super::pipe::Pipe;
use super::shared::Shared;
use super::udp::Udp;
use crate::stop::Stop;
use bond::exchange::Effort;

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
