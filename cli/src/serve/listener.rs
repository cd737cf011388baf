//! The thread that takes datagrams in as they come, so that their time is known, and turns strangers away, so that the
//! thread that keeps deadlines never sees them.

use super::arrival::Arrival;
use super::clock;
use super::peer::Peer;
use bond::exchange::{
    Effort, Key, LONGEST, LONGEST_SEALED, Measurement, OFFERS, Sealed, measurement_length, sealed_length,
};
use rtrb::{Consumer, Producer};
use std::net::{IpAddr, SocketAddr, UdpSocket};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

/// Most datagrams that are read in a [`WINDOW`]. A flood of more waits in the system's buffer, which drops it; whatever
/// it is, this thread leaves most of its core to others.
const DATAGRAMS_READ: u32 = 64;
/// For which [`DATAGRAMS_READ`] counts, ns.
const WINDOW: u64 = 1_000_000;

/// Who may speak.
pub struct Who {
    /// The one address that may; any without it.
    pub peer: Option<Peer>,
    /// What packets are sealed with.
    pub key: Option<Key>,
}

/// What the two threads tell each other.
pub struct Shared {
    /// The session whose measurements count; 0 for none.
    pub taken: AtomicU64,
    /// The first of the sessions that a device may join; 0 where none may, because one is there.
    pub offered: AtomicU64,
    /// The number of the last sealed packet that was sent.
    pub number: AtomicU64,
    /// Datagrams that were refused.
    pub refused: AtomicU64,
    /// The end.
    pub over: AtomicBool,
}

/// A measurement, and where it came from.
pub struct Letter {
    pub from: SocketAddr,
    /// The number of the packet that it was sealed in; 0 without a key.
    pub number: u64,
    pub arrival: Arrival,
}

/// Writes an effort as it goes over the line; its length. With a key come the number of the last packet and the number
/// of the packet that it answers.
pub fn packed(effort: &Effort, key: Option<(&Key, &AtomicU64, u64)>, to: &mut [u8; LONGEST_SEALED]) -> usize {
    let Some((key, numbers, answered)) = key else { return effort.write(to) };
    let mut packet = [0; LONGEST];
    let n = effort.write(&mut packet);
    let number = numbers.fetch_add(1, Ordering::Relaxed).saturating_add(1);
    key.seal(number, answered, &packet[..n], to)
}

/// The listening end of a socket.
pub struct Listener<'a> {
    pub socket: &'a UdpSocket,
    pub shared: &'a Shared,
    pub who: Who,
    /// What a device gets that asks to join.
    pub offer: Effort,
    pub letters: Producer<Letter>,
    /// Where the device is that joined, each time that it is somewhere else.
    pub places: Consumer<SocketAddr>,
    /// Where it is now.
    pub place: Option<SocketAddr>,
    /// The highest number of a sealed packet in the session that counts and in one that joins, with the session; see
    /// [`place`].
    pub numbers: [(u64, u64); 2],
}

impl Listener<'_> {
    /// Listens until the end.
    pub fn run(&mut self) {
        // A longer one is cut, and refused.
        let mut buffer = [0; LONGEST_SEALED + 1];
        let (mut window, mut read) = (clock::now(), 0);
        while !self.shared.over.load(Ordering::Relaxed) {
            if let Ok((n, from)) = self.socket.recv_from(&mut buffer)
                && self.take(&buffer[..n], from).is_none()
            {
                self.shared.refused.fetch_add(1, Ordering::Relaxed);
            }
            let now = clock::now();
            if now - window >= WINDOW {
                (window, read) = (now, 0);
            }
            read += 1;
            if read >= DATAGRAMS_READ {
                clock::sleep_until(window + WINDOW);
            }
        }
    }

    /// Takes in a datagram; `None` if it is a stranger's, or nothing. What costs least is asked first.
    fn take(&mut self, bytes: &[u8], from: SocketAddr) -> Option<()> {
        let [taken, offered] = [&self.shared.taken, &self.shared.offered].map(|x| x.load(Ordering::Acquire));
        if self.who.peer.is_some_and(|peer| !peer.is_at(from)) {
            return None;
        }
        while let Ok(place) = self.places.pop() {
            self.place = Some(place);
        }
        // Without a key a device is known by its address, as long as it is there.
        if self.who.key.is_none() && offered == 0 && self.place != Some(from) {
            return None;
        }
        let length = measurement_length(self.offer.ports);
        let (number, packet) = match &self.who.key {
            None => (0, bytes),
            Some(_) if bytes.len() != sealed_length(length) => return None,
            Some(key) => {
                let sealed = Sealed::split(bytes)?;
                // A replay costs no hash.
                let session = Measurement::session_of(sealed.packet)?;
                let (known, newest) = self.numbers[place(session)];
                let replayed = known == session && sealed.number <= newest;
                if replayed || !key.has_sealed(&sealed) {
                    return None;
                }
                (sealed.number, sealed.packet)
            }
        };
        let measurement = Measurement::read(packet).filter(|m| m.ports == self.offer.ports)?;
        let session = measurement.session;
        let joins = offered > 0 && session.checked_sub(offered).is_some_and(|n| n < OFFERS);
        if (taken > 0 && session == taken) || joins {
            if self.who.key.is_some() {
                self.numbers[place(session)] = (session, number);
            }
            // If the queue is full they are dropped: a later one has the larger sums.
            let _ = self.letters.push(Letter { from, number, arrival: Arrival::now(measurement) });
            return Some(());
        }
        // It knows no session of this run, or one that is over.
        (offered > 0).then(|| self.offer(offered | mark(from), number, from))
    }

    /// Offers a session. Nothing is remembered of whom it was offered to: only an answer makes a difference.
    fn offer(&self, session: u64, answered: u64, to: SocketAddr) {
        let mut buffer = [0; LONGEST_SEALED];
        let key = self.who.key.as_ref().map(|key| (key, &self.shared.number, answered));
        let n = packed(&Effort { session, ..self.offer }, key, &mut buffer);
        let _ = self.socket.send_to(&buffer[..n], to);
    }
}

/// Where the number of a session is kept: sessions that are offered at once are never the one that counts.
fn place(session: u64) -> usize {
    (session / OFFERS % 2) as usize
}

/// What tells the sessions offered to two addresses apart: below [`OFFERS`].
fn mark(address: SocketAddr) -> u64 {
    let mut bytes = [0; 18];
    let ip = match address.ip() {
        IpAddr::V4(ip) => ip.to_ipv6_mapped(),
        IpAddr::V6(ip) => ip,
    };
    bytes[..16].copy_from_slice(&ip.octets());
    bytes[16..].copy_from_slice(&address.port().to_le_bytes());
    u64::from(bond::exchange::crc(&bytes)) % OFFERS
}
