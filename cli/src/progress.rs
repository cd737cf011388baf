//! A bar on a terminal, for work that takes longer than a second.

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::io::IsTerminal;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Sender, channel};
use std::thread::JoinHandle;
use std::time::Duration;

/// Parts of the bar.
const PARTS: u64 = 1000;

/// Shows how far a run has come, from a thread of its own.
pub struct Progress {
    done: Arc<AtomicU64>,
    thread: Option<(Sender<()>, JoinHandle<()>)>,
}

impl Progress {
    /// A bar that appears after a second, and only if standard error is a terminal.
    pub fn new() -> Self {
        let done = Arc::new(AtomicU64::new(0));
        if !std::io::stderr().is_terminal() {
            return Self { done, thread: None };
        }
        let (send, receive) = channel::<()>();
        let shared = done.clone();
        let thread = std::thread::spawn(move || {
            let quiet = |time| receive.recv_timeout(time) == Err(std::sync::mpsc::RecvTimeoutError::Timeout);
            if !quiet(Duration::from_secs(1)) {
                return;
            }
            let bar = ProgressBar::with_draw_target(Some(PARTS), ProgressDrawTarget::stderr())
                .with_elapsed(Duration::from_secs(1));
            if let Ok(style) = ProgressStyle::with_template("{elapsed} {wide_bar} {percent} %") {
                bar.set_style(style);
            }
            loop {
                bar.set_position(shared.load(Ordering::Relaxed));
                if !quiet(Duration::from_millis(100)) {
                    break;
                }
            }
            bar.finish_and_clear();
        });
        Self { done, thread: Some((send, thread)) }
    }

    /// Tells how much is done, from 0 to 1.
    pub fn at(&self, part: f64) {
        self.done.store((part * PARTS as f64) as u64, Ordering::Relaxed);
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        if let Some((send, thread)) = self.thread.take() {
            drop(send);
            let _ = thread.join();
        }
    }
}
