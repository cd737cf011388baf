//! What sparse elimination computes with: real numbers, or complex ones.

use std::fmt::Debug;
use wide::f64x2;

/// Numbers that elimination adds, multiplies and divides by.
pub trait Scalar: Copy + Debug + Default + PartialEq + Send + Sync {
    /// How many numbers of a list one of these takes.
    const PARTS: usize;
    /// Two of them, part by part: so one instruction does something for both.
    type Two: Copy;
    /// Two as [`Scalar::Two`].
    fn two(x: [Self; 2]) -> Self::Two;
    /// Each of two.
    fn each(x: Self::Two) -> [Self; 2];
    /// [`Scalar::less`] for each of two.
    fn less_two(x: Self::Two, a: Self::Two, y: Self::Two) -> Self::Two;
    /// [`Scalar::times`] for each of two.
    fn times_two(x: Self::Two, y: Self::Two) -> Self::Two;
    /// The i-th of a list.
    fn at(list: &[f64], i: usize) -> Self;
    /// Becomes the i-th of a list.
    fn put(self, list: &mut [f64], i: usize);
    /// `self + x`
    fn plus(self, x: Self) -> Self;
    /// `self - a x`
    fn less(self, a: Self, x: Self) -> Self;
    /// `self x`
    fn times(self, x: Self) -> Self;
    /// `self` times a real number.
    fn by(self, x: f64) -> Self;
    /// `1 / self`
    fn inverse(self) -> Self;
    /// The magnitude, but for a factor of 1.5 at most.
    fn size(self) -> f64;
    /// It, with at least this magnitude.
    fn raised(self, floor: f64) -> Self;
}

/// `f` of each of two pairs.
#[inline(always)]
fn both(x: [f64; 2], y: [f64; 2], f: impl Fn(f64, f64) -> f64) -> [f64; 2] {
    [f(x[0], y[0]), f(x[1], y[1])]
}

#[inline(always)]
fn product(x: [f64; 2], y: [f64; 2]) -> [f64; 2] {
    both(x, y, |x, y| x * y)
}

#[inline(always)]
fn difference(x: [f64; 2], y: [f64; 2]) -> [f64; 2] {
    both(x, y, |x, y| x - y)
}

impl Scalar for f64 {
    const PARTS: usize = 1;
    type Two = f64x2;

    #[inline(always)]
    fn two(x: [Self; 2]) -> f64x2 {
        f64x2::new(x)
    }

    #[inline(always)]
    fn each(x: f64x2) -> [Self; 2] {
        x.to_array()
    }

    #[inline(always)]
    fn less_two(x: f64x2, a: f64x2, y: f64x2) -> f64x2 {
        x - a * y
    }

    #[inline(always)]
    fn times_two(x: f64x2, y: f64x2) -> f64x2 {
        x * y
    }

    #[inline(always)]
    fn at(list: &[f64], i: usize) -> Self {
        list[i]
    }

    #[inline(always)]
    fn put(self, list: &mut [f64], i: usize) {
        list[i] = self;
    }

    #[inline(always)]
    fn plus(self, x: Self) -> Self {
        self + x
    }

    #[inline(always)]
    fn less(self, a: Self, x: Self) -> Self {
        self - a * x
    }

    #[inline(always)]
    fn times(self, x: Self) -> Self {
        self * x
    }

    #[inline(always)]
    fn by(self, x: f64) -> Self {
        self * x
    }

    fn inverse(self) -> Self {
        1.0 / self
    }

    fn size(self) -> f64 {
        self.abs()
    }

    fn raised(self, floor: f64) -> Self {
        if self.abs() < floor { floor.copysign(self) } else { self }
    }
}

/// A complex number; in lists its parts stand side by side.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Complex {
    /// The real part.
    pub re: f64,
    /// The imaginary part.
    pub im: f64,
}

/// Two complex numbers: their real parts, and their imaginary ones.
#[derive(Clone, Copy, Debug)]
pub struct Two {
    re: [f64; 2],
    im: [f64; 2],
}

impl Scalar for Complex {
    const PARTS: usize = 2;
    type Two = Two;

    #[inline(always)]
    fn two(x: [Self; 2]) -> Two {
        Two { re: [x[0].re, x[1].re], im: [x[0].im, x[1].im] }
    }

    #[inline(always)]
    fn each(x: Two) -> [Self; 2] {
        [Self { re: x.re[0], im: x.im[0] }, Self { re: x.re[1], im: x.im[1] }]
    }

    #[inline(always)]
    fn less_two(x: Two, a: Two, y: Two) -> Two {
        let product = Self::times_two(a, y);
        Two { re: difference(x.re, product.re), im: difference(x.im, product.im) }
    }

    #[inline(always)]
    fn times_two(x: Two, y: Two) -> Two {
        let sum = |x, y| both(x, y, |x, y| x + y);
        Two {
            re: difference(product(x.re, y.re), product(x.im, y.im)),
            im: sum(product(x.re, y.im), product(x.im, y.re)),
        }
    }

    #[inline(always)]
    fn at(list: &[f64], i: usize) -> Self {
        Self { re: list[2 * i], im: list[2 * i + 1] }
    }

    #[inline(always)]
    fn put(self, list: &mut [f64], i: usize) {
        list[2 * i] = self.re;
        list[2 * i + 1] = self.im;
    }

    #[inline(always)]
    fn plus(self, x: Self) -> Self {
        Self { re: self.re + x.re, im: self.im + x.im }
    }

    #[inline(always)]
    fn less(self, a: Self, x: Self) -> Self {
        let product = a.times(x);
        Self { re: self.re - product.re, im: self.im - product.im }
    }

    #[inline(always)]
    fn times(self, x: Self) -> Self {
        Self { re: self.re * x.re - self.im * x.im, im: self.re * x.im + self.im * x.re }
    }

    #[inline(always)]
    fn by(self, x: f64) -> Self {
        Self { re: self.re * x, im: self.im * x }
    }

    fn inverse(self) -> Self {
        let one = 1.0 / (self.re * self.re + self.im * self.im);
        Self { re: self.re * one, im: -(self.im * one) }
    }

    fn size(self) -> f64 {
        self.re.abs() + self.im.abs()
    }

    fn raised(self, floor: f64) -> Self {
        if self.size() < floor { Self { re: floor.copysign(self.re), im: 0.0 } } else { self }
    }
}
