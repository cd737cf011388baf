//! Ctrl-C, and the other ways to ask a program for its end.

use crate::output;
use crate::report;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Exit status of what ended because it was asked to.
pub const ASKED: u8 = 130;
/// What comes this soon after the first time is the same wish: `timeout` sends it to a process and to its group.
const SAME: Duration = Duration::from_millis(500);

/// From now on a wish for the end is noted in what this gives, so that what is done can be kept, and `end` says when it
/// is met; one more ends it at once. Who is to outlive the terminal, as `nohup` wants it, is left as it is: hanging up
/// must not be taken for a wish.
pub fn watch(end: &'static str) -> Arc<AtomicBool> {
    let asked = Arc::new(AtomicBool::new(false));
    let flag = asked.clone();
    let mut first: Option<Instant> = None;
    let watch = move || match first {
        None => {
            first = Some(Instant::now());
            flag.store(true, Ordering::Relaxed);
            report::say(&format!("note: asked to end, it does so {end}; once more, and it ends at once"));
        }
        Some(t) if t.elapsed() < SAME => {}
        Some(_) => {
            output::abandon();
            std::process::exit(i32::from(ASKED));
        }
    };
    // A shell lets what it runs behind its back ignore Ctrl-C; it may still be asked in other ways.
    let watched = if hangs_up() { ctrlc::set_handler(watch) } else { ctrlc::try_set_handler(watch) };
    // Not being able to watch is no reason not to run.
    drop(watched);
    asked
}

/// Whether it is known that this process ends when its terminal does.
fn hangs_up() -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let ignored = status.lines().find_map(|l| l.strip_prefix("SigIgn:"));
    // The first signal is that one.
    ignored.and_then(|bits| u64::from_str_radix(bits.trim(), 16).ok()).is_some_and(|bits| bits & 1 == 0)
}
