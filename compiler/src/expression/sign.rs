//! What is known of a sign, and how it goes through sums and products.

/// What is known of the sign of a value.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub enum Sign {
    /// It is 0.
    Zero,
    /// Above 0.
    Positive,
    /// 0 or above.
    NonNegative,
    /// Below 0.
    Negative,
    /// 0 or below.
    NonPositive,
    /// Nothing.
    Unknown,
}

impl Sign {
    /// Of a number; NaN has none.
    pub fn of(x: f64) -> Sign {
        if x > 0.0 {
            Sign::Positive
        } else if x < 0.0 {
            Sign::Negative
        } else if x == 0.0 {
            Sign::Zero
        } else {
            Sign::Unknown
        }
    }

    /// What it may be: below 0, 0, above 0.
    fn parts(self) -> [bool; 3] {
        match self {
            Sign::Zero => [false, true, false],
            Sign::Positive => [false, false, true],
            Sign::NonNegative => [false, true, true],
            Sign::Negative => [true, false, false],
            Sign::NonPositive => [true, true, false],
            Sign::Unknown => [true, true, true],
        }
    }

    /// The least that says all of it.
    fn from_parts(parts: [bool; 3]) -> Sign {
        match parts {
            [false, true, false] => Sign::Zero,
            [false, false, true] => Sign::Positive,
            [false, true, true] => Sign::NonNegative,
            [true, false, false] => Sign::Negative,
            [true, true, false] => Sign::NonPositive,
            [true, _, true] | [false, false, false] => Sign::Unknown,
        }
    }

    /// Whether it cannot be below 0.
    pub fn is_nonnegative(self) -> bool {
        !self.parts()[0]
    }

    /// Whether it cannot be above 0.
    pub fn is_nonpositive(self) -> bool {
        !self.parts()[2]
    }

    /// Whether it cannot be 0.
    pub fn is_nonzero(self) -> bool {
        !self.parts()[1]
    }

    /// Of the negative.
    pub fn negative(self) -> Sign {
        let [a, b, c] = self.parts();
        Sign::from_parts([c, b, a])
    }

    /// Of one or the other.
    pub fn join(self, other: Sign) -> Sign {
        let (a, b) = (self.parts(), other.parts());
        Sign::from_parts(std::array::from_fn(|i| a[i] || b[i]))
    }

    /// Of a sum.
    pub fn plus(self, other: Sign) -> Sign {
        self.combine(other, |a, b| match a + b {
            0 if a != 0 => &[-1, 0, 1],
            0 => &[0],
            1 | 2 => &[1],
            _ => &[-1],
        })
    }

    /// Of a product.
    pub fn times(self, other: Sign) -> Sign {
        self.combine(other, |a, b| match a * b {
            0 => &[0],
            1 => &[1],
            _ => &[-1],
        })
    }

    fn combine(self, other: Sign, rule: fn(i32, i32) -> &'static [i32]) -> Sign {
        let mut parts = [false; 3];
        for (i, _) in self.parts().iter().enumerate().filter(|(_, may)| **may) {
            for (j, _) in other.parts().iter().enumerate().filter(|(_, may)| **may) {
                for &k in rule(i as i32 - 1, j as i32 - 1) {
                    parts[(k + 1) as usize] = true;
                }
            }
        }
        Sign::from_parts(parts)
    }
}
