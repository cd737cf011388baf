//! What the ordinary integrators share: a run with its own energy account, limits, and how it ends.

use super::field::Field;

/// More evaluations than this, and an integrator is given up.
pub const CALLS: u64 = 3_000_000;

/// Which one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rival {
    /// Dormand and Prince's explicit method of order 5(4).
    Explicit,
    /// Radau IIA of order 5, with a Jacobian by differences.
    Implicit,
}

/// One step from `x` at `t`.
pub trait Method {
    /// Tries a step of length `h`: the error relative to the tolerance (at most 1 to be taken), and the factor by which
    /// the next may be longer. None where it fails, so that it must be shorter.
    fn step(&mut self, field: &mut Field, t: f64, x: &[f64], h: f64, scale: &[f64], next: &mut [f64]) -> Option<Tried>;
}

/// What a step came to.
pub struct Tried {
    /// The error over the tolerance.
    pub error: f64,
    /// What the next step's length is this one's times.
    pub factor: f64,
    /// Supplied less dissipated, by the method's own quadrature, J.
    pub work: f64,
}

/// What a run came to.
#[derive(Clone, Debug)]
pub struct Done {
    /// The state at the end.
    pub end: Vec<f64>,
    /// Steps taken.
    pub steps: u64,
    /// Off from H at the start and what was supplied and lost, over the largest |H| seen.
    pub energy: f64,
    /// s of wall time.
    pub time: f64,
}

/// Runs from the start to `stop`. `size` is how large each state gets.
///
/// # Errors
/// In words: that it gave up, and where.
pub fn run(
    field: &mut Field,
    rival: Rival,
    stop: f64,
    tolerance: f64,
    size: &[f64],
    calls: u64,
) -> Result<Done, String> {
    let n = field.start.len();
    let mut method: Box<dyn Method> = match rival {
        Rival::Explicit => Box::new(super::explicit::Pair::new(n)),
        Rival::Implicit => Box::new(super::implicit::Radau::new(n, tolerance)),
    };
    field.reset();
    let begin = std::time::Instant::now();
    let mut x = field.start.clone();
    let mut next = x.clone();
    let mut largest = size.to_vec();
    let mut scale = vec![0.0; n];
    let h0 = field.energy(0.0, &x);
    let mut most = h0.abs();
    let (mut t, mut h, mut work, mut steps) = (0.0, stop * 1e-6, 0.0, 0u64);
    while t < stop {
        h = h.min(stop - t).min(stop / 50.0);
        if h < 1e-15 * stop {
            return Err(format!("stands at {t:.3e} s: no step is short enough"));
        }
        if field.calls > calls {
            return Err(format!("given up at {t:.3e} s, after {} evaluations", field.calls));
        }
        for i in 0..n {
            largest[i] = largest[i].max(x[i].abs());
            scale[i] = tolerance * largest[i].max(f64::MIN_POSITIVE);
        }
        match method.step(field, t, &x, h, &scale, &mut next) {
            Some(tried) if tried.error <= 1.0 && next.iter().all(|x| x.is_finite()) => {
                // The last step ends where the run does.
                t = if h >= stop - t { stop } else { t + h };
                x.copy_from_slice(&next);
                work += tried.work;
                steps += 1;
                h *= tried.factor;
                most = most.max(field.energy(t, &x).abs());
            }
            Some(tried) if tried.error.is_finite() => h *= tried.factor.min(0.9),
            _ => h *= 0.2,
        }
    }
    let energy = (field.energy(stop, &x) - h0 - work).abs() / most.max(f64::MIN_POSITIVE);
    Ok(Done { end: x, steps, energy, time: begin.elapsed().as_secs_f64() })
}
