//! Runs instances on threads, a chunk of consecutive ones at a time, and passes on their outcomes as they arrive.

use super::chunks::{Chunks, weight};
use super::collect::Collect;
use super::job::Job;
use crate::progress::Progress;
use crate::signal::ASKED;
use crate::stop::Stop;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Bytes that may wait to be collected.
const BYTES_WAITING: usize = 64 << 20;
/// So often it is looked whether the end is wished for.
const LOOK: Duration = Duration::from_millis(100);
/// A chunk that is done, or that a thread has died on.
type Report = Result<(u64, Vec<u8>), Died>;

/// A thread has died of a defect.
struct Died;

struct Shared {
    job: Arc<Job>,
    chunks: Chunks,
    state: Mutex<State>,
    room: Condvar,
}

struct State {
    /// Chunks to be run, in order.
    next: Box<dyn Iterator<Item = u64> + Send>,
    /// Bytes that wait to be collected.
    waiting: usize,
}

impl Shared {
    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The next chunk, as soon as there is room for its outcomes.
    fn take(&self) -> Option<u64> {
        let full = |s: &mut State| s.waiting > BYTES_WAITING;
        self.room.wait_while(self.state(), full).unwrap_or_else(PoisonError::into_inner).next.next()
    }

    fn work(&self, send: &Sender<Report>) {
        while let Some(chunk) = self.take() {
            let mut bytes = Vec::new();
            self.chunks.instances(chunk).for_each(|instance| self.job.run(instance).encode(&mut bytes));
            self.state().waiting += weight(&bytes);
            if send.send(Ok((chunk, bytes))).is_err() {
                return;
            }
        }
    }

    fn release(&self, weight: usize) {
        self.state().waiting -= weight;
        self.room.notify_all();
    }
}

/// Says so when a thread dies.
struct Witness(Sender<Report>);

impl Drop for Witness {
    fn drop(&mut self) {
        if std::thread::panicking() {
            let _ = self.0.send(Err(Died));
        }
    }
}

/// Runs all chunks that `collect` does not have yet.
///
/// The threads are left to themselves when this ends early: what they compute then is lost.
///
/// # Errors
/// What is done cannot be collected, a thread cannot be started, or one died of a defect; [`ASKED`] where it was
/// `asked` to end.
pub fn run(
    job: &Arc<Job>,
    chunks: Chunks,
    threads: u64,
    asked: &AtomicBool,
    collect: &mut dyn Collect,
) -> Result<(), Stop> {
    let had: Arc<[bool]> = (0..chunks.count()).map(|c| collect.has(c)).collect();
    let mut left = had.iter().filter(|h| !**h).count() as u64;
    let next = (0..chunks.count()).filter(move |c| !had[*c as usize]);
    let threads = threads.clamp(1, left.max(1));
    let state = Mutex::new(State { next: Box::new(next), waiting: 0 });
    let shared = Arc::new(Shared { job: job.clone(), chunks, state, room: Condvar::new() });
    let (send, receive) = channel();
    for _ in 0..threads {
        let (shared, witness) = (shared.clone(), Witness(send.clone()));
        let work = move || shared.work(&witness.0);
        let thread = std::thread::Builder::new().stack_size(crate::STACK).spawn(work);
        thread.map_err(|e| Stop::Usage(format!("cannot start a thread: {e}; take fewer with --threads")))?;
    }
    drop(send);
    let progress = Progress::new();
    while left > 0 {
        let mut report = loop {
            if asked.load(Ordering::Relaxed) {
                return Err(Stop::Said(ASKED));
            }
            match receive.recv_timeout(LOOK) {
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => break Err(Died),
                Ok(report) => break report,
            }
        };
        // All that is there is collected at once.
        loop {
            // The thread has told what went wrong.
            let Ok((chunk, bytes)) = report else { return Err(Stop::Said(101)) };
            shared.release(collect.take(chunk, bytes)?);
            left -= 1;
            match next_of(&receive) {
                Some(more) => report = more,
                None => break,
            }
        }
        collect.pause()?;
        progress.at(1.0 - left as f64 / chunks.count() as f64);
    }
    Ok(())
}

fn next_of(receive: &Receiver<Report>) -> Option<Report> {
    receive.try_recv().ok()
}
