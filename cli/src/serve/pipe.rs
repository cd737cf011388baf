//! Standard input and output: packets, or lines of numbers.
//!
//! A line in has how far each port moved under the efforts of one line out, the first under the first, the second under
//! the second. A pipe loses nothing, so that the energy of a line that comes late is known all the same.

use super::arrival::{Arrival, EFFORTS_KEPT, MEASUREMENTS_QUEUED};
use crate::stop::Stop;
use bond::exchange::{Effort, LONGEST, Measurement, PORTS, measurement_length};
use rtrb::{Consumer, Producer, RingBuffer};
use std::fmt::Write as _;
use std::io::{self, BufRead, Read, Stdout, Write};

/// Most bytes per number of a line, with the blanks around it.
const NUMBER_WIDTH: usize = 64;
/// Letters of a cell that a message shows.
const CELL_SHOWN: usize = 24;

/// What the reading thread hands over: a packet, or a line as one whose `q` is of that line alone; or what is wrong.
type Item = Result<Arrival, String>;

/// Both pipes.
pub struct Pipe {
    binary: bool,
    ports: usize,
    items: Consumer<Item>,
    out: Stdout,
    text: String,
    buffer: [u8; LONGEST],
    /// Of lines: the sums, and by number the efforts and what may be drawn under them, J.
    sums: Measurement,
    sent: Vec<[f64; PORTS]>,
    promised: Vec<f64>,
    next: u64,
}

impl Pipe {
    /// Begins to read.
    pub fn new(binary: bool, ports: usize, session: u64) -> Self {
        let (producer, items) = RingBuffer::new(MEASUREMENTS_QUEUED);
        // It ends with the process: nothing can wake it from waiting for a line.
        std::thread::spawn(move || if binary { packets(producer, ports) } else { lines(producer, ports) });
        Self {
            binary,
            ports,
            items,
            out: io::stdout(),
            text: String::with_capacity(NUMBER_WIDTH * (PORTS + 1)),
            buffer: [0; LONGEST],
            sums: Measurement { session, ports, ..Measurement::default() },
            sent: vec![[0.0; PORTS]; EFFORTS_KEPT],
            promised: vec![0.0; EFFORTS_KEPT],
            next: 0,
        }
    }

    /// Writes what is held.
    ///
    /// # Errors
    /// Nobody reads it any more.
    pub fn send(&mut self, effort: &Effort) -> Result<(), Stop> {
        let mut out = self.out.lock();
        if self.binary {
            let n = effort.write(&mut self.buffer);
            out.write_all(&self.buffer[..n])?;
            return Ok(out.flush()?);
        }
        let place = |k: u64| (k % EFFORTS_KEPT as u64) as usize;
        // All of it may be drawn at ports of one region.
        let groups = effort.group[..self.ports].iter().copied().max().unwrap_or(0);
        let rooms = (0..=groups).filter(|_| groups > 0).filter_map(|group| {
            let own = |i: &usize| effort.group[*i] == group;
            let given: f64 = (0..self.ports).filter(own).map(|i| self.sums.w[i]).sum();
            (0..self.ports).find(own).map(|i| given - effort.limit[i])
        });
        let stored = rooms.fold(effort.stored, f64::min);
        // What lines without an answer allow may still be drawn under them.
        let open = (self.sums.sequence..effort.sequence)
            .rev()
            .take(EFFORTS_KEPT)
            .map(|k| self.promised[place(k)])
            .sum::<f64>();
        let promised = (stored - open).max(0.0);
        self.promised[place(effort.sequence)] = promised;
        self.sent[place(effort.sequence)] = effort.v;
        self.next = effort.sequence + 1;
        self.text.clear();
        for v in &effort.v[..self.ports] {
            let _ = write!(self.text, "{v},");
        }
        let _ = writeln!(self.text, "{promised}");
        out.write_all(self.text.as_bytes())?;
        Ok(out.flush()?)
    }

    /// What came.
    ///
    /// # Errors
    /// A malformed line, or one for an effort that is no longer remembered.
    pub fn receive(&mut self) -> Result<Option<Arrival>, Stop> {
        // A line that is early waits for its effort, also if it is malformed: the lines before it count, however fast
        // they are read.
        if !self.binary && self.items.peek().is_ok() && self.sums.sequence >= self.next {
            return Ok(None);
        }
        match self.items.pop() {
            Err(_) => Ok(None),
            Ok(Ok(arrival)) if self.binary => Ok(Some(arrival)),
            Ok(Err(why)) => Err(Stop::Usage(format!("standard input: {why}"))),
            Ok(Ok(Arrival { at, measurement: Measurement { q, .. } })) => {
                let k = self.sums.sequence;
                if self.next - k > EFFORTS_KEPT as u64 {
                    return Err(Stop::Usage(format!("standard input: line {} is {EFFORTS_KEPT} lines late", k + 1)));
                }
                let v = &self.sent[(k % EFFORTS_KEPT as u64) as usize];
                for i in 0..self.ports {
                    self.sums.q[i] += q[i];
                    self.sums.w[i] += v[i] * q[i];
                }
                if self.sums.is_beyond() {
                    let what = format!("line {}: a sum since the start is beyond 1e150", k + 1);
                    return Err(Stop::Usage(format!("standard input: {what}")));
                }
                self.sums.echo = k;
                self.sums.sequence = k + 1;
                Ok(Some(Arrival { at, measurement: self.sums }))
            }
        }
    }

    /// Whether standard input has ended, and all of it is taken.
    pub fn is_over(&self) -> bool {
        self.items.is_abandoned() && self.items.is_empty()
    }

    /// What it is.
    pub fn name(&self) -> String {
        if self.binary { "standard input and output, packets" } else { "standard input and output, lines" }.into()
    }
}

/// Hands over an item; whether somebody is there to take it.
fn hand(items: &mut Producer<Item>, mut item: Item) -> bool {
    loop {
        match items.push(item) {
            Ok(()) => return true,
            Err(_) if items.is_abandoned() => return false,
            // A pipe must not lose a line: it waits.
            Err(rtrb::PushError::Full(back)) => item = back,
        }
        std::thread::sleep(std::time::Duration::from_millis(1));
    }
}

fn packets(mut items: Producer<Item>, ports: usize) {
    let mut input = io::stdin().lock();
    let mut buffer = [0; LONGEST];
    let n = measurement_length(ports);
    while input.read_exact(&mut buffer[..n]).is_ok() {
        let item = match Measurement::read(&buffer[..n]) {
            Some(m) => Ok(Arrival::now(m)),
            None => Err(format!("{n} bytes that are no measurement of {ports} ports")),
        };
        if !hand(&mut items, item) {
            return;
        }
    }
}

fn lines(mut items: Producer<Item>, ports: usize) {
    let mut input = io::stdin().lock();
    let mut line = Vec::new();
    let most = NUMBER_WIDTH * (ports + 1);
    for number in 1u64.. {
        line.clear();
        // A line that never ends is not waited for.
        let wrong = match input.by_ref().take(most as u64).read_until(b'\n', &mut line) {
            Ok(0) => return,
            Ok(n) if n == most && !line.ends_with(b"\n") => {
                Some(format!("line {number}: it is longer than {most} bytes"))
            }
            Ok(_) => None,
            Err(e) => Some(e.to_string()),
        };
        if let Some(why) = wrong {
            hand(&mut items, Err(why));
            return;
        }
        let item = match numbers(String::from_utf8_lossy(&line).trim(), ports) {
            Ok(q) => Ok(Arrival::now(Measurement { ports, q, ..Measurement::default() })),
            Err(why) => Err(format!("line {number}: {why}")),
        };
        if !hand(&mut items, item) {
            return;
        }
    }
}

/// The numbers of a line, with commas or blanks between them.
fn numbers(line: &str, ports: usize) -> Result<[f64; PORTS], String> {
    let mut list = [0.0; PORTS];
    let mut count = 0;
    let commas = line.contains(',');
    let cells = line.split(|c: char| if commas { c == ',' } else { c.is_whitespace() });
    // Several blanks are as one.
    for cell in cells.map(str::trim).filter(|c| commas || !c.is_empty()) {
        let x = cell.parse::<f64>().ok().filter(|x| x.is_finite());
        let x = x.ok_or_else(|| {
            let start: String = cell.chars().take(CELL_SHOWN).collect();
            let more = if start.len() < cell.len() { "..." } else { "" };
            format!("`{}{more}` is no number", start.escape_default())
        })?;
        if let Some(place) = list.get_mut(count) {
            *place = x;
        }
        count += 1;
    }
    if count == ports {
        Ok(list)
    } else {
        let are = if count == 1 { "is 1 number".into() } else { format!("are {count} numbers") };
        let open = if ports == 1 { "1 open port".into() } else { format!("{ports} open ports") };
        Err(format!("there {are} for {open}: write one per port, with commas or blanks between them"))
    }
}
