//! Waves over datagrams, to and from another program. They are read where deadlines are kept, a bounded number at a
//! time: what a flood crowds out is lost, which costs energy and no deadline.

use super::Meeting;
use super::clock;
use super::device::patience;
use super::listener::Who;
use super::log::Row;
use super::meter::Meter;
use crate::stop::Stop;
use bond::RunError;
use bond::exchange::{Heard, Key, LONGEST, LONGEST_SEALED, Sealed, WaveExchange, Waves};
use std::net::{SocketAddr, UdpSocket};

/// Most datagrams that are read at a time.
const DATAGRAMS_READ: usize = 64;
/// How long after one call the next one is made, ns, while the other program is waited for.
const CALL_PAUSE: u64 = 1_000_000;

/// A running exchange of waves.
pub struct WaveMeeting<'a, 'b> {
    exchange: &'a mut WaveExchange<'b>,
    socket: UdpSocket,
    who: Who,
    /// Where the other program is, as far as that is known.
    place: Option<SocketAddr>,
    /// Whether an interval waits for its waves.
    lockstep: bool,
    /// The number of the last sealed packet.
    number: u64,
    refused: u64,
    /// When something new was heard, and how long after that the other program has left; when it was last called; ns.
    heard: u64,
    patience: u64,
    called: u64,
}

impl<'a, 'b> WaveMeeting<'a, 'b> {
    /// Listens at an address.
    ///
    /// # Errors
    /// The address is taken, or is not this machine's.
    pub fn new(
        exchange: &'a mut WaveExchange<'b>,
        address: SocketAddr,
        who: Who,
        lockstep: bool,
    ) -> Result<Self, Stop> {
        let failed = |e: std::io::Error| Stop::Usage(format!("cannot listen at {address}: {e}"));
        let socket = UdpSocket::bind(address).map_err(failed)?;
        socket.set_nonblocking(true).map_err(failed)?;
        let place = who.peer.and_then(|peer| peer.place(address.is_ipv6()));
        // Later runs have higher numbers, as they have higher sessions.
        let number = exchange.waves().session;
        let patience = patience(exchange.period());
        Ok(Self { exchange, socket, who, place, lockstep, number, refused: 0, heard: 0, patience, called: 0 })
    }

    /// Where it listens.
    pub fn name(&self) -> String {
        self.socket.local_addr().map_or_else(|_| "udp".into(), |address| format!("udp {address}"))
    }

    /// Datagrams that were nothing, or somebody else's.
    pub fn refused(&self) -> u64 {
        self.refused
    }

    /// Takes in a datagram; `None` if it is a stranger's, or nothing. Otherwise whether it is new.
    fn take(&mut self, bytes: &[u8], from: SocketAddr) -> Option<bool> {
        let now = clock::now();
        let is_there = self.exchange.is_joined() && now.saturating_sub(self.heard) <= self.patience;
        if self.who.peer.is_some_and(|peer| !peer.is_at(from)) {
            return None;
        }
        // Without a key a program is known by its address, as long as it is there.
        if self.who.key.is_none() && is_there && self.place != Some(from) {
            return None;
        }
        let waves = Waves::read(opened(self.who.key.as_ref(), bytes)?)?;
        match self.exchange.hear(&waves) {
            Heard::New => {
                (self.place, self.heard) = (Some(from), now);
                Some(true)
            }
            Heard::Asks => {
                self.place = Some(from);
                Some(false)
            }
            _ => Some(false),
        }
    }
}

/// The packet in a datagram.
fn opened<'a>(key: Option<&Key>, bytes: &'a [u8]) -> Option<&'a [u8]> {
    let Some(key) = key else { return Some(bytes) };
    let sealed = Sealed::split(bytes)?;
    key.has_sealed(&sealed).then_some(sealed.packet)
}

impl Meeting for WaveMeeting<'_, '_> {
    fn period(&self) -> f64 {
        self.exchange.period()
    }

    fn latency(&self) -> f64 {
        0.0
    }

    fn send(&mut self) -> Result<(), Stop> {
        let Some(place) = self.place else { return Ok(()) };
        let (mut packet, mut buffer) = ([0; LONGEST], [0; LONGEST_SEALED]);
        let n = self.exchange.waves().write(&mut packet);
        self.number = self.number.saturating_add(1);
        let bytes = match &self.who.key {
            None => &packet[..n],
            Some(key) => {
                let n = key.seal(self.number, 0, &packet[..n], &mut buffer);
                &buffer[..n]
            }
        };
        // That it does not come is the line's affair.
        let _ = self.socket.send_to(bytes, place);
        Ok(())
    }

    fn call(&mut self) -> Result<(), Stop> {
        let now = clock::now();
        if now.saturating_sub(self.called) < CALL_PAUSE {
            return Ok(());
        }
        self.called = now;
        self.send()
    }

    fn hear(&mut self, _: &mut Meter) -> Result<bool, Stop> {
        // A longer one is cut, and refused.
        let mut buffer = [0; LONGEST_SEALED + 1];
        let mut new = false;
        for _ in 0..DATAGRAMS_READ {
            let Ok((n, from)) = self.socket.recv_from(&mut buffer) else { break };
            match self.take(&buffer[..n], from) {
                None => self.refused += 1,
                Some(is_new) => new |= is_new,
            }
        }
        Ok(if self.lockstep && self.exchange.intervals() > 0 { self.exchange.is_ready() } else { new })
    }

    fn tick(&mut self) -> Result<(), RunError> {
        self.exchange.tick()
    }

    /// Without a clock, the end of the other program is the end of this one.
    fn is_over(&self) -> bool {
        self.lockstep && self.exchange.is_over()
    }

    fn end(&mut self) {
        self.exchange.end();
    }

    fn has_farewell(&self) -> bool {
        true
    }

    fn farewell(&mut self) {
        let _ = self.send();
    }

    fn row(&self, row: &mut Row) {
        let x = &*self.exchange;
        row.count = x.entering().len();
        let all = || (0..row.count).map(|i| x.energy(i));
        let time = x.intervals() as f64 * x.period();
        let [sent, received, waiting, lost] =
            all().fold([0.0; 4], |[a, b, c, d], e| [a + e.sent, b + e.received, c + e.waiting, d + e.lost]);
        row.head = [time, x.count().missing as f64, waiting, sent, received, lost];
        for (i, entering) in x.entering().iter().enumerate() {
            row.ports[i] = [x.waves().wave[i], *entering];
        }
    }
}
