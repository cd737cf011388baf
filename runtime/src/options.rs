//! The numbers that solvers go by, each with its meaning and its scale.

/// What Newton's method goes by; [`crate::solve::newton`] says where each is used. Norms are the weighted ones of
/// there, all squared, and so are parts of them.
#[derive(Clone, Debug, PartialEq)]
pub struct NewtonOptions {
    /// The part of the unknowns that is rounding.
    pub rounding: f64,
    /// Where else to start, in scales of the unknowns, where the Jacobian at the start cannot be solved.
    pub nudges: [f64; 6],
    /// How often an update that ends where the Jacobian is singular is made longer, to get beyond.
    pub stretches: u32,
    /// The first so many times it is made twice as long: where a flow of next to nothing turns, dry friction goes from
    /// one side to the other by an update of next to nothing.
    pub doublings: u32,
    /// By what it is made longer after that.
    pub stretch: f64,
    /// After so many updates in a row that do not shrink, and are small, rounding moves an unknown that the equations
    /// hardly determine.
    pub stalls: u32,
    /// So many iterations may go by without a residual that falls. Then each update has to make it smaller: about a
    /// steep law that saturates, as friction does, updates may else go from one side to the other for ever, at the same
    /// residual. Of equations that only take power the square of the residual falls along the update.
    pub patience: u32,
    /// The part of the residual's square that a whole update has to take off then; a half one half of it, and so on
    /// (Armijo, Pacific J. Math. 16, 1966).
    pub decrease: f64,
    /// An update that is a smaller part than this of unknowns and scales is let be then: rounding may keep the residual
    /// from falling.
    pub negligible: f64,
    /// How often one update is halved at most.
    pub halvings: u32,
    /// A residual above so many times the smallest so far halves the update.
    pub growth: f64,
    /// But for a residual that is at most this part of the unknowns.
    pub noise: f64,
    /// After so many iterations updates are no longer halved for what the residual becomes: beyond the corner of a law
    /// it may have to be larger first, as where a body that slid one way is to slide the other, or on the way to a
    /// solution of an energy that is not convex, over steps of many turns.
    pub damped: u32,
    /// What converges then needs no more iterations than these.
    pub grace: u32,
    /// A residual of this part of the unknowns is rounding.
    pub residual: f64,
    /// The square of an update over that of the one before, at most, after which a residual that is larger says
    /// nothing: its equations weigh more than they determine (a natural test of monotonicity; Deuflhard, Numer. Math.
    /// 22, 1974).
    pub closer: f64,
    /// Of an update that takes back the one before but for this part, half is made.
    pub turned: f64,
    /// An update below this part of the one before shows quadratic convergence.
    pub quadratic: f64,
    /// The largest last update then, as a part of the unknowns.
    pub last: f64,
    /// An update of at least this part of the one before does not shrink.
    pub slow: f64,
    /// The last update that does not shrink, as a part of the unknowns.
    pub stalled: f64,
    /// The same after [`NewtonOptions::stalls`] of them.
    pub hardly_determined: f64,
    /// The same where the residual is rounding.
    pub undetermined: f64,
    /// The part of the unknowns that such a residual is at most.
    pub quiet: f64,
    /// The last update of an iteration that converges linearly, as a part of the unknowns, and the same where it does
    /// not shrink.
    pub linear: (f64, f64),
    /// How often the residual is looked at that is left by what was to be the last update.
    pub looks: u32,
    /// The part of the unknowns that this may leave, and the same where it was no more than [`NewtonOptions::growth`]
    /// times as large before.
    pub cleared: (f64, f64),
    /// Updates of an unknown of so many units of an exponent at most are made as they are.
    pub straight: f64,
    /// An update from far up an exponential goes beyond its knee by so many units at most.
    pub beyond_knee: f64,
    /// Of the chord start.
    pub chord: ChordOptions,
}

/// What the chord start goes by; [`crate::solve::iteration::chord`] says where each is used.
#[derive(Clone, Debug, PartialEq)]
pub struct ChordOptions {
    /// Bodies of more instructions than this do not begin so: back ends write them anew for it.
    pub instructions: usize,
    /// So many times the square of the last update over the one before are at most what may be left.
    pub next: f64,
    /// The second update of one equation is corrected where it is at most this part of the first.
    pub corrected: f64,
    /// The largest size that is taken: squares of larger ones overflow.
    pub range: f64,
    /// The largest first update, as a part of the unknowns, after which the second one may be the last. What is far
    /// from where it began says nothing by the matrix from there: of a pendulum over many of its periods a residual may
    /// be small by chance, or beside a matrix that was large.
    pub near: f64,
    /// How far an entry of the matrix may be from what it was, as a part of it, where the iteration ends far from its
    /// start.
    pub alike: f64,
    /// The largest second update that may be rounding alone, as a part of the unknowns.
    pub stalled: f64,
    /// The part of the first update that the second one is at most, where the iteration goes on from it.
    pub good: f64,
}

/// What linear systems are solved by; [`crate::solve::dense`] and [`crate::solve::sparse`] say where each is used. All
/// are parts of entries of the matrix, or of products of them.
#[derive(Clone, Debug, PartialEq)]
pub struct LinearOptions {
    /// A pivot below this part of its column's largest entry before elimination is taken for 0.
    pub tiny: f64,
    /// Where equations may leave unknowns undetermined, so may a pivot up to this part: rounding leaves that of none.
    pub poor: f64,
    /// What equations that say the same may differ by, as a part of the terms of the right side: in an iteration on its
    /// way to rounding, which is in their last digits. What is left of them is in the next update.
    pub alike: f64,
    /// Two unknowns are solved by Cramer's rule where the determinant is above this part of the sum of its terms,
    pub digits: f64,
    /// and within this range: beyond, products of numbers overflow or lose digits.
    pub range: (f64, f64),
}

impl LinearOptions {
    /// What back ends go by.
    pub const DEFAULT: Self = Self { tiny: 1e-16, poor: 1e-14, alike: 1e-6, digits: 1e-6, range: (1e-200, 1e200) };
}

impl Default for LinearOptions {
    fn default() -> Self {
        Self::DEFAULT
    }
}

impl NewtonOptions {
    /// What back ends go by.
    pub const DEFAULT: Self = Self {
        rounding: 4e-16,
        nudges: [1e-3, -1e-3, 2.0, -2.0, 30.0, -30.0],
        stretches: 16,
        doublings: 6,
        stretch: 32.0,
        stalls: 6,
        patience: 12,
        decrease: 0.1,
        negligible: 1e-12,
        halvings: 30,
        growth: 4.0,
        noise: 1e-26,
        damped: 140,
        grace: 20,
        residual: 1e-32,
        closer: 0.25,
        turned: 0.0625,
        quadratic: 1e-6,
        last: 1e-11,
        slow: 0.25,
        stalled: 1e-12,
        hardly_determined: 1e-10,
        undetermined: 1e-6,
        quiet: 1e-20,
        linear: (1e-12, 1e-14),
        looks: 3,
        cleared: (1e-28, 1e-24),
        straight: 0.125,
        beyond_knee: 1e4,
        chord: ChordOptions {
            instructions: 2000,
            next: 8.0,
            corrected: 0.1,
            range: 1e100,
            near: 1e-2,
            alike: 0.1,
            stalled: 1e-12,
            good: 0.1,
        },
    };

    /// By what an update is made longer after so many times.
    pub fn stretch(&self, times: u32) -> f64 {
        if times < self.doublings { 2.0 } else { self.stretch }
    }

    /// How far all stretches of an update went, as a part of what it is in the end, and how many times as long that is
    /// as it was.
    pub fn stretched(&self) -> (f64, f64) {
        let (mut sum, mut size) = (0.0, 1.0);
        for k in 0..self.stretches {
            size *= self.stretch(k);
            sum += size;
        }
        (sum / size, size)
    }
}

impl Default for NewtonOptions {
    fn default() -> Self {
        Self::DEFAULT
    }
}
