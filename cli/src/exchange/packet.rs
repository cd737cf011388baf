//! What goes over the line: measurements in, efforts out; waves both ways. All numbers are little-endian;
//! `docs/reference/serve.md` has the layout.

/// Most ports that a line serves.
pub const PORTS: usize = 64;
/// The first bytes of a measurement.
pub const MEASUREMENT: [u8; 4] = *b"BNDM";
/// The first bytes of an effort.
pub const EFFORT: [u8; 4] = *b"BNDE";
/// The first bytes of a packet of waves.
pub const WAVES: [u8; 4] = *b"BNDW";
/// Bytes of the longest packet.
pub const LONGEST: usize = 56 + 24 * PORTS;

/// Nothing was heard of the interval that ended.
pub const MISSING: u32 = 1;
/// What was heard of it had not met its effort yet.
pub const LATE: u32 = 2;
/// Nothing was heard for so long that 0 is held.
pub const SILENT: u32 = 4;
/// The environment ends: 0 is held.
pub const END: u32 = 8;

/// A measurement of a device: sums since it joined, so that a lost packet loses nothing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measurement {
    /// The session that it answers; 0 before it knows one.
    pub session: u64,
    /// Its number; each is higher than the one before.
    pub sequence: u64,
    /// Number of the effort that the device holds.
    pub echo: u64,
    /// Time since that effort arrived, s, for the round trip.
    pub wait: f64,
    /// How many ports.
    pub ports: usize,
    /// How far each port moved since it joined.
    pub q: [f64; PORTS],
    /// The energy that each port put into the environment since then, J, as the device counts it.
    pub w: [f64; PORTS],
}

/// What the environment holds until the next one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Effort {
    /// The session; a later one has a higher number.
    pub session: u64,
    /// Its number, which is that of its interval.
    pub sequence: u64,
    /// When its interval begins, s of the environment's time.
    pub time: f64,
    /// How long it may be held where no other comes, s.
    pub lasts: f64,
    /// What the environment could give back, J.
    pub stored: f64,
    /// [`MISSING`], [`LATE`], [`SILENT`], [`END`].
    pub status: u32,
    /// How many ports.
    pub ports: usize,
    /// The efforts (or flows).
    pub v: [f64; PORTS],
    /// What the sum of `w` over the port's group must not fall below while it is held, J; the same for all of a group.
    pub limit: [f64; PORTS],
    /// The port's group: ports of one region share what it stores.
    pub group: [u64; PORTS],
}

/// The waves that a program sends at the end of an interval, to another program.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Waves {
    /// The sender's session; a later run of it has a higher number.
    pub session: u64,
    /// The session of the other program that it answers; 0 before it knows one.
    pub answers: u64,
    /// Its number: how many intervals have ended; 0 before the first one.
    pub sequence: u64,
    /// Length of an interval, s.
    pub period: f64,
    /// [`END`].
    pub status: u32,
    /// How many ports.
    pub ports: usize,
    /// The impedance Z of each port.
    pub impedance: [f64; PORTS],
    /// The wave e + Z f that left each port over the interval, f counted into the port.
    pub wave: [f64; PORTS],
    /// The energy that left each port by waves since the start of the sender, J, this one included.
    pub sent: [f64; PORTS],
}

impl Default for Waves {
    fn default() -> Self {
        Self {
            session: 0,
            answers: 0,
            sequence: 0,
            period: 0.0,
            status: 0,
            ports: 0,
            impedance: [0.0; PORTS],
            wave: [0.0; PORTS],
            sent: [0.0; PORTS],
        }
    }
}

impl Default for Measurement {
    fn default() -> Self {
        Self { session: 0, sequence: 0, echo: 0, wait: 0.0, ports: 0, q: [0.0; PORTS], w: [0.0; PORTS] }
    }
}

impl Default for Effort {
    fn default() -> Self {
        Self {
            session: 0,
            sequence: 0,
            time: 0.0,
            lasts: 0.0,
            stored: 0.0,
            status: 0,
            ports: 0,
            v: [0.0; PORTS],
            limit: [0.0; PORTS],
            group: [0; PORTS],
        }
    }
}

/// Bytes of a measurement with this number of ports.
pub fn measurement_length(ports: usize) -> usize {
    48 + 16 * ports
}

/// Bytes of an effort with this number of ports.
pub fn effort_length(ports: usize) -> usize {
    56 + 24 * ports
}

/// Bytes of a packet of waves with this number of ports.
pub fn waves_length(ports: usize) -> usize {
    48 + 24 * ports
}

/// CRC-32 as zlib, PNG and Ethernet have it.
pub fn crc(bytes: &[u8]) -> u32 {
    const TABLE: [u32; 256] = {
        let mut table = [0; 256];
        let mut i = 0;
        while i < 256 {
            let (mut x, mut k) = (i as u32, 0);
            while k < 8 {
                x = if x & 1 == 1 { 0xedb8_8320 ^ (x >> 1) } else { x >> 1 };
                k += 1;
            }
            table[i] = x;
            i += 1;
        }
        table
    };
    !bytes.iter().fold(!0, |c, b| TABLE[((c ^ u32::from(*b)) & 0xff) as usize] ^ (c >> 8))
}

/// Writes numbers one after the other.
struct Writer<'a> {
    to: &'a mut [u8],
    at: usize,
}

impl Writer<'_> {
    fn put<const N: usize>(&mut self, bytes: [u8; N]) {
        if let Some(place) = self.to.get_mut(self.at..self.at + N) {
            place.copy_from_slice(&bytes);
        }
        self.at += N;
    }

    fn numbers(&mut self, list: &[f64]) {
        list.iter().for_each(|x| self.put(x.to_le_bytes()));
    }

    /// Ends a packet with its checksum; its length.
    fn seal(mut self) -> usize {
        let sum = crc(self.to.get(..self.at).unwrap_or_default());
        self.put(sum.to_le_bytes());
        self.at
    }
}

/// Reads numbers one after the other.
struct Reader<'a> {
    from: &'a [u8],
}

impl Reader<'_> {
    fn take<const N: usize>(&mut self) -> [u8; N] {
        match self.from.split_first_chunk::<N>() {
            Some((first, rest)) => {
                self.from = rest;
                *first
            }
            None => [0; N],
        }
    }

    fn number(&mut self) -> f64 {
        f64::from_le_bytes(self.take())
    }

    fn numbers(&mut self, n: usize) -> [f64; PORTS] {
        let mut list = [0.0; PORTS];
        list.iter_mut().take(n).for_each(|x| *x = self.number());
        list
    }
}

/// The body of a packet with this mark, and how many ports it has; `None` for anything else.
fn body<'a>(bytes: &'a [u8], mark: [u8; 4], length: fn(usize) -> usize) -> Option<(Reader<'a>, usize)> {
    let rest = bytes.strip_prefix(&mark)?;
    let (ports, rest) = rest.split_first_chunk::<4>()?;
    let ports = usize::try_from(u32::from_le_bytes(*ports)).ok().filter(|n| *n <= PORTS)?;
    let (checked, sum) = bytes.split_last_chunk::<4>()?;
    (bytes.len() == length(ports) && crc(checked) == u32::from_le_bytes(*sum)).then_some((Reader { from: rest }, ports))
}

/// Larger sums cannot come from a device, and their differences may overflow.
const LARGEST_SUM: f64 = 1e150;

impl Measurement {
    /// Whether a sum is not a number, or too large to come from a device.
    pub fn is_beyond(&self) -> bool {
        self.q.iter().chain(&self.w).any(|x| x.is_nan() || x.abs() > LARGEST_SUM)
    }

    /// The session that bytes name if they are a measurement, which is not looked at.
    pub fn session_of(bytes: &[u8]) -> Option<u64> {
        let (session, _) = bytes.strip_prefix(&MEASUREMENT)?.get(4..)?.split_first_chunk::<8>()?;
        Some(u64::from_le_bytes(*session))
    }

    /// Writes it into a buffer of [`LONGEST`] bytes; its length.
    pub fn write(&self, to: &mut [u8]) -> usize {
        let ports = self.ports.min(PORTS);
        let mut w = Writer { to, at: 0 };
        w.put(MEASUREMENT);
        w.put((ports as u32).to_le_bytes());
        for x in [self.session, self.sequence, self.echo] {
            w.put(x.to_le_bytes());
        }
        w.put(self.wait.to_le_bytes());
        w.numbers(&self.q[..ports]);
        w.numbers(&self.w[..ports]);
        w.put(0u32.to_le_bytes());
        w.seal()
    }

    /// Reads one; `None` for anything else, and for numbers that are not finite.
    pub fn read(bytes: &[u8]) -> Option<Self> {
        let (mut r, ports) = body(bytes, MEASUREMENT, measurement_length)?;
        let [session, sequence, echo] = [(); 3].map(|()| u64::from_le_bytes(r.take()));
        let wait = r.number();
        let (q, w) = (r.numbers(ports), r.numbers(ports));
        let sound = q.iter().chain(&w).chain([&wait]).all(|x| x.is_finite());
        sound.then_some(Self { session, sequence, echo, wait, ports, q, w })
    }
}

impl Effort {
    /// Writes it into a buffer of [`LONGEST`] bytes; its length.
    pub fn write(&self, to: &mut [u8]) -> usize {
        let ports = self.ports.min(PORTS);
        let mut w = Writer { to, at: 0 };
        w.put(EFFORT);
        w.put((ports as u32).to_le_bytes());
        w.put(self.session.to_le_bytes());
        w.put(self.sequence.to_le_bytes());
        w.numbers(&[self.time, self.lasts, self.stored]);
        w.numbers(&self.v[..ports]);
        w.numbers(&self.limit[..ports]);
        self.group[..ports].iter().for_each(|g| w.put(g.to_le_bytes()));
        w.put(self.status.to_le_bytes());
        w.seal()
    }

    /// Reads one; `None` for anything else, and for numbers by which nothing can be held. A limit may be infinite:
    /// nothing bounds then what is drawn.
    pub fn read(bytes: &[u8]) -> Option<Self> {
        let (mut r, ports) = body(bytes, EFFORT, effort_length)?;
        let [session, sequence] = [(); 2].map(|()| u64::from_le_bytes(r.take()));
        let [time, lasts, stored] = [(); 3].map(|()| r.number());
        let (v, limit) = (r.numbers(ports), r.numbers(ports));
        let mut group = [0; PORTS];
        group.iter_mut().take(ports).for_each(|g| *g = u64::from_le_bytes(r.take()));
        let status = u32::from_le_bytes(r.take());
        let held = v.iter().chain([&time, &lasts]).all(|x| x.is_finite());
        let sound = held && !limit.iter().chain([&stored]).any(|x| x.is_nan());
        sound.then_some(Self { session, sequence, time, lasts, stored, status, ports, v, limit, group })
    }
}

impl Waves {
    /// Writes it into a buffer of [`LONGEST`] bytes; its length.
    pub fn write(&self, to: &mut [u8]) -> usize {
        let ports = self.ports.min(PORTS);
        let mut w = Writer { to, at: 0 };
        w.put(WAVES);
        w.put((ports as u32).to_le_bytes());
        for x in [self.session, self.answers, self.sequence] {
            w.put(x.to_le_bytes());
        }
        w.put(self.period.to_le_bytes());
        for list in [&self.impedance, &self.wave, &self.sent] {
            w.numbers(&list[..ports]);
        }
        w.put(self.status.to_le_bytes());
        w.seal()
    }

    /// Reads one; `None` for anything else, and for numbers that no wave has: what is not finite, beyond 1e150, or an
    /// energy below 0.
    pub fn read(bytes: &[u8]) -> Option<Self> {
        let (mut r, ports) = body(bytes, WAVES, waves_length)?;
        let [session, answers, sequence] = [(); 3].map(|()| u64::from_le_bytes(r.take()));
        let period = r.number();
        let [impedance, wave, sent] = [(); 3].map(|()| r.numbers(ports));
        let status = u32::from_le_bytes(r.take());
        let small = impedance.iter().chain(&wave).chain(&sent).chain([&period]).all(|x| x.abs() <= LARGEST_SUM);
        let sound = small && sent.iter().all(|x| *x >= 0.0);
        sound.then_some(Self { session, answers, sequence, period, status, ports, impedance, wave, sent })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_checksum_is_the_usual_one() {
        assert_eq!(crc(b"123456789"), 0xcbf4_3926);
    }

    #[test]
    fn packets_are_read_back() {
        for ports in [0, 1, 3, PORTS] {
            let mut buffer = [0; LONGEST];
            let mut m = Measurement { session: 7, sequence: 8, echo: 9, wait: 0.5, ports, ..Measurement::default() };
            m.q[..ports].iter_mut().enumerate().for_each(|(i, x)| *x = i as f64 / 3.0);
            m.w[..ports].iter_mut().enumerate().for_each(|(i, x)| *x = -(i as f64) / 7.0);
            let n = m.write(&mut buffer);
            assert_eq!(n, measurement_length(ports));
            assert_eq!(Measurement::read(&buffer[..n]), Some(m));
            assert_eq!(
                (Measurement::session_of(&buffer[..n]), Measurement::session_of(&buffer[..15])),
                (Some(7), None)
            );
            for at in 0..n {
                let mut wrong = buffer;
                wrong[at] ^= 0x10;
                assert_eq!(Measurement::read(&wrong[..n]), None, "byte {at}");
                assert_eq!(Measurement::read(&buffer[..at]), None);
            }
            let mut e = Effort { session: 1, sequence: 2, time: 3.0, lasts: 4.0, ..Effort::default() };
            (e.stored, e.status, e.ports) = (6.0, MISSING | END, ports);
            e.v[..ports].iter_mut().enumerate().for_each(|(i, x)| *x = (i as f64).sqrt());
            e.limit[..ports].iter_mut().enumerate().for_each(|(i, x)| *x = -(i as f64).cbrt());
            e.group[..ports].iter_mut().enumerate().for_each(|(i, x)| *x = i as u64 / 2);
            let n = e.write(&mut buffer);
            assert_eq!(n, effort_length(ports));
            assert_eq!(Effort::read(&buffer[..n]), Some(e));
            assert_eq!(Measurement::read(&buffer[..n]), None);
            let mut x =
                Waves { session: 3, answers: 4, sequence: 5, period: 1e-3, status: END, ports, ..Waves::default() };
            for i in 0..ports {
                (x.impedance[i], x.wave[i], x.sent[i]) = (1.0 + i as f64, -(i as f64) / 3.0, i as f64 / 9.0);
            }
            let n = x.write(&mut buffer);
            assert_eq!(n, waves_length(ports));
            assert_eq!((Waves::read(&buffer[..n]), Effort::read(&buffer[..n])), (Some(x), None));
            for at in 0..n {
                let mut wrong = buffer;
                wrong[at] ^= 0x10;
                assert_eq!(Waves::read(&wrong[..n]), None, "byte {at}");
            }
        }
    }

    #[test]
    fn waves_that_are_none() {
        let reads = |change: fn(&mut Waves, f64), x: f64| {
            let mut waves = Waves { session: 1, ports: 2, period: 1e-3, ..Waves::default() };
            change(&mut waves, x);
            let mut buffer = [0; LONGEST];
            let n = waves.write(&mut buffer);
            Waves::read(&buffer[..n]) == Some(waves)
        };
        for change in
            [|w: &mut Waves, x| w.wave[1] = x, |w: &mut Waves, x| w.sent[0] = x, |w: &mut Waves, x| w.period = x]
        {
            assert!(reads(change, 1.0));
            assert!(!reads(change, f64::NAN) && !reads(change, f64::INFINITY) && !reads(change, 1e200));
        }
        assert!(reads(|w, x| w.wave[0] = x, -1.0) && !reads(|w, x| w.sent[0] = x, -1.0));
    }

    /// By a number that is none an effort would never end, or would be no effort.
    #[test]
    fn efforts_that_cannot_be_held_are_none() {
        let mut buffer = [0; LONGEST];
        let mut reads = |change: fn(&mut Effort, f64), x: f64| {
            let mut e = Effort { session: 1, ports: 2, lasts: 0.1, ..Effort::default() };
            change(&mut e, x);
            let n = e.write(&mut buffer);
            Effort::read(&buffer[..n]) == Some(e)
        };
        for change in [|e: &mut Effort, x| e.v[1] = x, |e: &mut Effort, x| e.lasts = x, |e: &mut Effort, x| e.time = x]
        {
            assert!(reads(change, 1.0) && !reads(change, f64::NAN) && !reads(change, f64::INFINITY));
        }
        for change in [|e: &mut Effort, x| e.limit[1] = x, |e: &mut Effort, x| e.stored = x] {
            assert!(reads(change, f64::NEG_INFINITY) && !reads(change, f64::NAN));
        }
    }
}
