//! How long the steps of a run are.

use bond::Steps;

/// Fixed steps, or steps that are fitted to a tolerance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Setting {
    /// All of one length, s.
    Step(f64),
    /// Error allowed in each, relative.
    Tolerance(f64),
}

impl Setting {
    /// Its number.
    pub fn value(self) -> f64 {
        match self {
            Setting::Step(x) | Setting::Tolerance(x) => x,
        }
    }

    /// The same kind with another number.
    pub fn with(self, x: f64) -> Self {
        match self {
            Setting::Step(_) => Setting::Step(x),
            Setting::Tolerance(_) => Setting::Tolerance(x),
        }
    }

    /// The steps for the library; adaptive ones are at most `longest`, s, if given.
    pub fn steps(self, longest: Option<f64>) -> Steps {
        let steps = match self {
            Setting::Step(h) => Steps::fixed(h),
            Setting::Tolerance(x) => Steps::tolerance(x),
        };
        longest.map_or(steps, |h| steps.longest(h))
    }

    /// For people: `steps of 2 ms`.
    pub fn words(self) -> String {
        match self {
            Setting::Step(h) => format!("steps of {}", time(h)),
            Setting::Tolerance(x) => format!("tolerance {}", digits(x)),
        }
    }

    /// For a table: `step 2 ms`.
    pub fn cell(self) -> String {
        match self {
            Setting::Step(h) => format!("step {}", time(h)),
            Setting::Tolerance(x) => format!("tol {}", digits(x)),
        }
    }
}

/// A number with three digits, as a power of ten: `3.16e-8`.
fn digits(x: f64) -> String {
    let text = format!("{x:.2e}");
    match text.split_once('e') {
        Some((mantissa, exponent)) => format!("{}e{exponent}", mantissa.trim_end_matches('0').trim_end_matches('.')),
        None => text,
    }
}

/// A time with three digits and its unit.
pub fn time(t: f64) -> String {
    if t == 0.0 || !t.is_finite() {
        return format!("{t} s");
    }
    // Rounded first: 999.9 ms is 1 s.
    let rounded: f64 = format!("{t:.2e}").parse().unwrap_or(t);
    let (factor, unit) = match rounded.abs() {
        x if x < 1e-11 => (1e12, "ps"),
        x if x < 1e-6 => (1e9, "ns"),
        x if x < 1e-3 => (1e6, "us"),
        x if x < 1.0 => (1e3, "ms"),
        _ => (1.0, "s"),
    };
    let x = rounded * factor;
    let digits = (2 - x.abs().log10().floor() as i32).clamp(0, 2) as usize;
    let text = format!("{x:.digits$}");
    let text = if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.') } else { &text };
    format!("{text} {unit}")
}

#[cfg(test)]
mod tests {
    use super::time;

    #[test]
    fn three_digits() {
        let list = [0.0, 1.0, 0.0123456, 3.4e-6, 999.96e-3, 250e-6, 12345.0, 5e-10, 1e-12];
        let text: Vec<String> = list.into_iter().map(time).collect();
        assert_eq!(text, ["0 s", "1 s", "12.3 ms", "3.4 us", "1 s", "250 us", "12300 s", "0.5 ns", "1 ps"]);
    }
}
