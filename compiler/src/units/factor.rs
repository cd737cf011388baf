//! Factors of units, as double-double numbers.

/// A number as the unevaluated sum of a double and a much smaller one.
#[derive(Clone, Copy, Debug)]
pub(super) struct Factor {
    high: f64,
    low: f64,
}

/// Pi to 32 digits.
pub(super) const PI: Factor = Factor { high: std::f64::consts::PI, low: 1.224_646_799_147_353_2e-16 };

impl Factor {
    /// An integer up to 2^53.
    pub(super) fn whole(n: u64) -> Factor {
        Factor { high: n as f64, low: 0.0 }
    }

    pub(super) fn mul(self, other: Factor) -> Factor {
        let p = self.high * other.high;
        let e = libm::fma(self.high, other.high, -p) + (self.high * other.low + self.low * other.high);
        Factor::sum(p, e)
    }

    pub(super) fn div(self, other: Factor) -> Factor {
        let first = self.high / other.high;
        let rest = self.minus(other.scaled(first));
        let second = rest.high / other.high;
        let rest = rest.minus(other.scaled(second));
        let third = rest.high / other.high;
        let q = Factor::sum(first, second);
        Factor::sum(q.high, q.low + third)
    }

    /// Its power; squaring and multiplying for whole exponents, the root by one step of Newton's method.
    pub(super) fn pow(self, above: i32, below: i32) -> Factor {
        let base = match below {
            0 | 1 => self,
            -1 => return self.pow(above, 1).recip(),
            n => self.root(n),
        };
        let (mut n, mut square, mut result) = (above.unsigned_abs(), base, Factor::whole(1));
        while n > 0 {
            if n % 2 == 1 {
                result = result.mul(square);
            }
            n /= 2;
            if n > 0 {
                square = square.mul(square);
            }
        }
        if above < 0 { result.recip() } else { result }
    }

    pub(super) fn recip(self) -> Factor {
        Factor::whole(1).div(self)
    }

    /// The nearest double.
    pub(super) fn round(self) -> f64 {
        self.high + self.low
    }

    fn root(self, n: i32) -> Factor {
        let guess = libm::pow(self.high, 1.0 / f64::from(n));
        let start = Factor { high: guess, low: 0.0 };
        // x + x (a / x^n - 1) / n
        let ratio = self.div(start.pow(n, 1));
        let error = (ratio.high - 1.0) + ratio.low;
        Factor::sum(guess, guess * error / f64::from(n))
    }

    fn scaled(self, by: f64) -> Factor {
        self.mul(Factor { high: by, low: 0.0 })
    }

    fn minus(self, other: Factor) -> Factor {
        let d = self.high - other.high;
        let back = d - self.high;
        let e = (self.high - (d - back)) - (other.high + back);
        Factor::sum(d, e + (self.low - other.low))
    }

    fn sum(a: f64, b: f64) -> Factor {
        let s = a + b;
        let back = s - a;
        let e = (a - (s - back)) + (b - back);
        if s.is_finite() { Factor { high: s, low: e } } else { Factor { high: s, low: 0.0 } }
    }
}
