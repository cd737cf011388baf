//! Datagrams.

use super::arrival::{Arrival, MEASUREMENTS_QUEUED};
use super::clock;
use super::listener::{Letter, Listener, Shared, Who, packed};
use crate::stop::Stop;
use bond::exchange::{Exchange, Key, LONGEST_SEALED};
use rtrb::{Consumer, Producer, RingBuffer};
use std::net::{SocketAddr, UdpSocket};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

/// Places of the device that wait until the listener looks, which it does before it takes in a datagram.
const PLACES_QUEUED: usize = 64;

/// A socket and who is at the other end.
pub struct Udp {
    socket: UdpSocket,
    shared: Arc<Shared>,
    letters: Consumer<Letter>,
    places: Producer<SocketAddr>,
    key: Option<Key>,
    /// Where the device is that joined, and the number of its newest sealed packet.
    device: Option<(SocketAddr, u64)>,
    /// The same of the measurement that was received last.
    last: Option<(SocketAddr, u64)>,
    thread: Option<JoinHandle<()>>,
    buffer: [u8; LONGEST_SEALED],
}

impl Udp {
    /// Listens at an address. `priority` is that of the thread that keeps the deadlines.
    ///
    /// # Errors
    /// The address is taken, or is not this machine's.
    pub fn new(address: SocketAddr, who: Who, exchange: &Exchange<'_>, priority: Option<u8>) -> Result<Self, Stop> {
        let failed = |e: std::io::Error| Stop::Usage(format!("cannot listen at {address}: {e}"));
        let socket = UdpSocket::bind(address).map_err(failed)?;
        let ears = socket.try_clone().map_err(failed)?;
        // So that it sees the end.
        ears.set_read_timeout(Some(Duration::from_millis(100))).map_err(failed)?;
        let shared = Arc::new(Shared {
            taken: AtomicU64::new(0),
            offered: AtomicU64::new(0),
            // Later runs have higher numbers, as they have higher sessions.
            number: AtomicU64::new(exchange.effort().session),
            refused: AtomicU64::new(0),
            over: AtomicBool::new(false),
        });
        let (letters, received) = RingBuffer::new(MEASUREMENTS_QUEUED);
        let (places, found) = RingBuffer::new(PLACES_QUEUED);
        let (known, key, offer) = (shared.clone(), who.key.clone(), exchange.offer());
        let thread = std::thread::spawn(move || {
            // On one core, the deadline comes first.
            priority.into_iter().for_each(clock::stand_behind);
            let (socket, shared) = (&ears, &*known);
            let numbers = [(0, 0); 2];
            Listener { socket, shared, who, offer, letters, places: found, place: None, numbers }.run();
        });
        Ok(Self {
            socket,
            shared,
            letters: received,
            places,
            key,
            device: None,
            last: None,
            thread: Some(thread),
            buffer: [0; LONGEST_SEALED],
        })
    }

    /// Sends to the device, once one has joined; that it does not come is the line's affair. While nobody is there, the
    /// listener offers a session to whoever asks.
    pub fn send(&mut self, exchange: &Exchange<'_>, vacant: bool) {
        let offered = if vacant { exchange.offer().session } else { 0 };
        let taken = exchange.session().filter(|_| exchange.is_joined()).unwrap_or(0);
        self.shared.taken.store(taken, Ordering::Release);
        self.shared.offered.store(offered, Ordering::Release);
        if let Some((place, answered)) = self.device {
            let key = self.key.as_ref().map(|key| (key, &self.shared.number, answered));
            let n = packed(exchange.effort(), key, &mut self.buffer);
            let _ = self.socket.send_to(&self.buffer[..n], place);
        }
    }

    /// What came. Without a key, what others sent before the listener knew where the device is does not count.
    pub fn receive(&mut self, vacant: bool) -> Option<Arrival> {
        loop {
            let Letter { from, number, arrival } = self.letters.pop().ok()?;
            let elsewhere = self.device.is_some_and(|(place, _)| place != from);
            if self.key.is_none() && !vacant && elsewhere {
                self.shared.refused.fetch_add(1, Ordering::Relaxed);
                continue;
            }
            self.last = Some((from, number));
            return Some(arrival);
        }
    }

    /// What was received last is the device's: it gets the efforts from now on.
    pub fn accept(&mut self) {
        let moved = self.last.map(|l| l.0).filter(|place| self.device.is_none_or(|(old, _)| old != *place));
        self.device = self.last;
        if let Some(place) = moved {
            let _ = self.places.push(place);
        }
    }

    /// Datagrams that were nothing, or somebody else's.
    pub fn refused(&self) -> u64 {
        self.shared.refused.load(Ordering::Relaxed)
    }

    /// Where it listens.
    pub fn name(&self) -> String {
        match self.socket.local_addr() {
            Ok(address) => format!("udp {address}"),
            Err(_) => "udp".into(),
        }
    }
}

impl Drop for Udp {
    fn drop(&mut self) {
        self.shared.over.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}
