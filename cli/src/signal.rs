//! Ctrl-C, and the other ways to ask a program for its end.

use crate::output;
use crate::report;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, Once, PoisonError};
use std::time::{Duration, Instant};

/// Exit status of what ended because it was asked to.
pub const ASKED: u8 = 130;
/// What comes this soon after the first time is the same wish: `timeout` sends it to a process and to its group.
const SAME_INTERRUPT: Duration = Duration::from_millis(500);

/// Whether somebody asked for the end.
static WISH: AtomicBool = AtomicBool::new(false);
/// When a wish for the end is met; None while there is nothing yet that could be kept.
static MET: Mutex<Option<&'static str>> = Mutex::new(None);
/// Set once this program listens.
static LISTENS: Once = Once::new();

/// From now on a wish for the end ends the program at once, in words, with [`ASKED`]. Who is to outlive the terminal,
/// as `nohup` wants it, is left as it is: hanging up must not be taken for a wish.
pub fn listen() {
    LISTENS.call_once(|| {
        let mut first: Option<Instant> = None;
        let hear = move || match (first, *MET.lock().unwrap_or_else(PoisonError::into_inner)) {
            (None, None) => {
                report::say("interrupted: the run had not started, and there is nothing to keep");
                leave();
            }
            (None, Some(end)) => {
                first = Some(Instant::now());
                WISH.store(true, Ordering::Relaxed);
                report::say(&format!("note: interrupted; the run ends {end}; a second interrupt ends it at once"));
            }
            (Some(t), _) if t.elapsed() < SAME_INTERRUPT => {}
            (Some(_), _) => leave(),
        };
        // A shell lets what it runs behind its back ignore Ctrl-C; it may still be asked in other ways.
        let heard = if hangs_up() { ctrlc::set_handler(hear) } else { ctrlc::try_set_handler(hear) };
        // A run does not need the handler.
        drop(heard);
    });
}

/// From now on a wish for the end is noted in what this gives, so that what is done can be kept, and `end` says when it
/// is met; one more ends the program at once.
pub fn watch(end: &'static str) -> &'static AtomicBool {
    *MET.lock().unwrap_or_else(PoisonError::into_inner) = Some(end);
    listen();
    &WISH
}

/// Ends the program; nothing half-written is left.
fn leave() {
    output::abandon();
    std::process::exit(i32::from(ASKED));
}

/// Whether it is known that this process ends when its terminal does.
fn hangs_up() -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let ignored = status.lines().find_map(|l| l.strip_prefix("SigIgn:"));
    // The first signal is that one.
    ignored.and_then(|bits| u64::from_str_radix(bits.trim(), 16).ok()).is_some_and(|bits| bits & 1 == 0)
}
