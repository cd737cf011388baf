//! Datagrams. A thread of its own takes them in as they come, so that their time is known.

use super::arrival::{Arrival, MEASUREMENTS_QUEUED};
use crate::stop::Stop;
use bond::exchange::{Effort, LONGEST, Measurement};
use rtrb::{Consumer, Producer, RingBuffer};
use std::net::{SocketAddr, UdpSocket};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, OnceLock};
use std::thread::JoinHandle;
use std::time::Duration;

/// A socket and who is at the other end.
pub struct Udp {
    socket: UdpSocket,
    shared: Arc<Shared>,
    arrivals: Consumer<Arrival>,
    thread: Option<JoinHandle<()>>,
    buffer: [u8; LONGEST],
}

/// What both threads know.
struct Shared {
    peer: OnceLock<SocketAddr>,
    refused: AtomicU64,
    over: AtomicBool,
}

impl Udp {
    /// Listens at an address, for ports in this number; without a peer the first one that speaks is it.
    ///
    /// # Errors
    /// The address is taken, or is not this machine's.
    pub fn new(address: SocketAddr, peer: Option<SocketAddr>, ports: usize) -> Result<Self, Stop> {
        let failed = |e: std::io::Error| Stop::Usage(format!("cannot listen at {address}: {e}"));
        let socket = UdpSocket::bind(address).map_err(failed)?;
        let ears = socket.try_clone().map_err(failed)?;
        // So that it sees the end.
        ears.set_read_timeout(Some(Duration::from_millis(100))).map_err(failed)?;
        let shared = Arc::new(Shared {
            peer: peer.map(OnceLock::from).unwrap_or_default(),
            refused: AtomicU64::new(0),
            over: AtomicBool::new(false),
        });
        let (producer, arrivals) = RingBuffer::new(MEASUREMENTS_QUEUED);
        let known = shared.clone();
        let thread = std::thread::spawn(move || listen(&ears, &known, producer, ports));
        Ok(Self { socket, shared, arrivals, thread: Some(thread), buffer: [0; LONGEST] })
    }

    /// Sends to the peer, once there is one; that it does not come is the line's affair.
    pub fn send(&mut self, effort: &Effort) {
        if let Some(peer) = self.shared.peer.get() {
            let n = effort.write(&mut self.buffer);
            let _ = self.socket.send_to(&self.buffer[..n], peer);
        }
    }

    /// What came.
    pub fn receive(&mut self) -> Option<Arrival> {
        self.arrivals.pop().ok()
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

fn listen(socket: &UdpSocket, shared: &Shared, mut arrivals: Producer<Arrival>, ports: usize) {
    // A longer one is cut, and refused.
    let mut buffer = [0; LONGEST + 1];
    while !shared.over.load(Ordering::Relaxed) {
        let Ok((n, from)) = socket.recv_from(&mut buffer) else { continue };
        let found = Measurement::read(&buffer[..n]).filter(|m| m.ports == ports);
        match found {
            Some(m) if *shared.peer.get_or_init(|| from) == from => {
                // If the queue is full they are dropped: a later one has the larger sums.
                let _ = arrivals.push(Arrival::now(m));
            }
            Some(_) | None => {
                shared.refused.fetch_add(1, Ordering::Relaxed);
            }
        }
    }
}
