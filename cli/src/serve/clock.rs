//! Time that only goes forward, and what the system can be asked for so that it is kept.

use std::num::NonZeroU64;

/// Now, ns since some instant.
#[cfg(target_os = "linux")]
pub fn now() -> u64 {
    let t = rustix::time::clock_gettime(rustix::time::ClockId::Monotonic);
    t.tv_sec as u64 * 1_000_000_000 + t.tv_nsec as u64
}

/// Sleeps until an instant of [`now`].
#[cfg(target_os = "linux")]
pub fn sleep_until(at: u64) {
    let request = rustix::time::Timespec {
        tv_sec: (at / 1_000_000_000) as i64,
        tv_nsec: (at % 1_000_000_000) as rustix::time::Nsecs,
    };
    // A signal wakes it early.
    while rustix::thread::clock_nanosleep_absolute(rustix::thread::ClockId::Monotonic, &request).is_err() && now() < at
    {
    }
}

/// What the calling thread has computed so far, ns.
#[cfg(target_os = "linux")]
pub fn worked() -> u64 {
    let t = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
    t.tv_sec as u64 * 1_000_000_000 + t.tv_nsec as u64
}

#[cfg(not(target_os = "linux"))]
pub fn now() -> u64 {
    static START: std::sync::OnceLock<std::time::Instant> = std::sync::OnceLock::new();
    START.get_or_init(std::time::Instant::now).elapsed().as_nanos() as u64
}

#[cfg(not(target_os = "linux"))]
pub fn sleep_until(at: u64) {
    std::thread::sleep(std::time::Duration::from_nanos(at.saturating_sub(now())));
}

/// Not known here: a miss is then taken for the program's own.
#[cfg(not(target_os = "linux"))]
pub fn worked() -> u64 {
    now()
}

/// What to ask the system for.
#[derive(Clone, Copy, Debug, Default)]
pub struct Wishes {
    /// Real-time priority, 1 to 99.
    pub priority: Option<u8>,
    /// The core to run on.
    pub core: Option<usize>,
    /// Memory stays in memory.
    pub lock: bool,
}

/// Asks for all of it, for this thread and those that it starts. What is refused is said with `say`, and not insisted
/// on.
pub fn ask(wishes: Wishes, say: &dyn Fn(&str)) -> Vec<String> {
    let mut refused = Vec::new();
    let mut try_to = |what: &str, result: Result<(), String>, fix: &str| {
        if let Err(why) = result {
            say(&format!("warning: {what}: {why}; continuing without ({fix})"));
            refused.push(format!("{what}: {why}"));
        }
    };
    // Sleeping threads without real-time priority may otherwise be woken 50 us late, all at once with others.
    try_to("the timer's slack stays", slack(), "harmless with --priority");
    if let Some(core) = wishes.core {
        try_to("no core of its own", pin(core), "cores are numbered from 0");
    }
    if wishes.lock {
        try_to("memory is not locked", lock(), "raise `ulimit -l`, or give it CAP_IPC_LOCK");
    }
    if let Some(priority) = wishes.priority {
        try_to("no real-time priority", prioritise(priority), "raise `ulimit -r`, or give it CAP_SYS_NICE");
    }
    refused
}

/// Puts the calling thread, which has taken part in what was granted, behind the one with this priority.
pub fn stand_behind(priority: u8) {
    // It was refused to that one too, or a lower one is always granted.
    let _ = prioritise(priority.saturating_sub(1).max(1));
}

#[cfg(target_os = "linux")]
fn slack() -> Result<(), String> {
    rustix::thread::set_current_timer_slack(NonZeroU64::new(1)).map_err(|e| e.to_string())
}

#[cfg(target_os = "linux")]
fn pin(core: usize) -> Result<(), String> {
    let mut set = rustix::thread::CpuSet::new();
    if core >= rustix::thread::CpuSet::MAX_CPU {
        return Err(format!("there is no core {core}"));
    }
    set.set(core);
    rustix::thread::sched_setaffinity(None, &set).map_err(|e| format!("core {core}: {e}"))
}

#[cfg(target_os = "linux")]
fn lock() -> Result<(), String> {
    use rustix::mm::MlockAllFlags;
    // What is touched is kept; a stack that is reserved and never used is not filled.
    let flags = MlockAllFlags::CURRENT | MlockAllFlags::FUTURE | MlockAllFlags::ONFAULT;
    rustix::mm::mlockall(flags).map_err(|e| e.to_string())
}

#[cfg(not(target_os = "linux"))]
fn slack() -> Result<(), String> {
    let _ = NonZeroU64::MIN;
    Ok(())
}

#[cfg(not(target_os = "linux"))]
fn pin(_: usize) -> Result<(), String> {
    Err("this system does not offer it".into())
}

#[cfg(not(target_os = "linux"))]
fn lock() -> Result<(), String> {
    Err("this system does not offer it".into())
}

#[cfg(unix)]
fn prioritise(priority: u8) -> Result<(), String> {
    use thread_priority::{
        RealtimeThreadSchedulePolicy, ThreadPriority, ThreadPriorityValue, ThreadSchedulePolicy,
        set_thread_priority_and_policy, thread_native_id,
    };
    let value = ThreadPriorityValue::try_from(priority).map_err(|e| e.to_string())?;
    let policy = ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::Fifo);
    let result = set_thread_priority_and_policy(thread_native_id(), ThreadPriority::Crossplatform(value), policy);
    result.map_err(|e| match e {
        thread_priority::Error::OS(code) => std::io::Error::from_raw_os_error(code).to_string(),
        other => format!("{other:?}"),
    })
}

#[cfg(not(unix))]
fn prioritise(_: u8) -> Result<(), String> {
    Err("this system does not offer it".into())
}
