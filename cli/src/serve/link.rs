//! Lines to the outside.

use super::arrival::Arrival;
use super::pipe::Pipe;
use super::shared::Shared;
use super::udp::Udp;
use crate::stop::Stop;
use bond::exchange::Exchange;

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
    /// Hands over what is held. If the line is vacant, a device that asks is offered a session.
    ///
    /// # Errors
    /// Nobody reads it any more.
    pub fn send(&mut self, exchange: &Exchange<'_>, vacant: bool) -> Result<(), Stop> {
        match self {
            Link::Udp(l) => {
                l.send(exchange, vacant);
                Ok(())
            }
            Link::Pipe(l) => l.send(exchange.effort()),
            Link::Shared(l) if vacant => l.send(&exchange.offer()),
            Link::Shared(l) => l.send(exchange.effort()),
        }
    }

    /// What came, if something did; it does not wait.
    ///
    /// # Errors
    /// What came makes no sense, and nothing after it can.
    pub fn receive(&mut self, vacant: bool) -> Result<Option<Arrival>, Stop> {
        match self {
            Link::Udp(l) => Ok(l.receive(vacant)),
            Link::Pipe(l) => l.receive(),
            Link::Shared(l) => Ok(l.receive()),
        }
    }

    /// What was received last counts: efforts go to where it came from.
    pub fn accept(&mut self) {
        match self {
            Link::Udp(l) => l.accept(),
            Link::Pipe(_) | Link::Shared(_) => {}
        }
    }

    /// Whether devices come and go, and packets may be lost. Who is at the other end of a pipe stays there until it
    /// ends.
    pub fn changes_hands(&self) -> bool {
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
