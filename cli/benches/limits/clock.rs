//! Time that this thread computed, so that what else the machine does counts little.

/// Processor time of this thread, ns; where the system does not tell, the time that went by.
pub fn now() -> f64 {
    #[cfg(target_os = "linux")]
    {
        let t = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
        1e9 * t.tv_sec as f64 + t.tv_nsec as f64
    }
    #[cfg(not(target_os = "linux"))]
    {
        static START: std::sync::OnceLock<std::time::Instant> = std::sync::OnceLock::new();
        1e9 * START.get_or_init(std::time::Instant::now).elapsed().as_secs_f64()
    }
}

/// The middle of some times, ns; NaN of none.
pub fn median(mut times: Vec<f64>) -> f64 {
    times.sort_by(f64::total_cmp);
    times.get(times.len() / 2).copied().unwrap_or(f64::NAN)
}

/// Processor time of ended children so far, s; None where the system does not tell.
pub fn children() -> Option<f64> {
    let text = std::fs::read_to_string("/proc/self/stat").ok()?;
    // After the name in brackets: state is field 3, cutime and cstime are 16 and 17, in hundredths.
    let fields: Vec<&str> = text.rsplit_once(')')?.1.split_whitespace().collect();
    let ticks = |i: usize| fields.get(i - 3).and_then(|x| x.parse::<f64>().ok());
    Some((ticks(16)? + ticks(17)?) / 100.0)
}
