//! The figures: a scene, the C of the same work, and what they should come to.

/// Times that are asked for, ns.
#[derive(Clone, Copy, Debug)]
pub struct Bars {
    /// What C written by hand took where the bars were set.
    pub hand: f64,
    /// Of machine code in `bond run`, at most.
    pub run: f64,
    /// Of emitted C, at most.
    pub c: f64,
}

/// One kind of work.
#[derive(Clone, Copy)]
pub struct Figure {
    /// Its name.
    pub title: &'static str,
    /// What one time is of.
    pub unit: &'static str,
    /// The model.
    pub text: &'static str,
    /// The stepper, where it is not the usual one.
    pub method: Option<&'static str>,
    /// Step, or period of what is sampled, s.
    pub step: f64,
    /// The C of it, `kernels/NAME.c`, and a faster one with vector lanes.
    pub kernel: &'static str,
    /// See above.
    pub lanes: Option<&'static str>,
    /// What the C is told: cells; 1 where the hand pulls at times.
    pub size: usize,
    /// How many units a step has.
    pub per: usize,
    /// How many scenes there are.
    pub scenes: usize,
    /// Whether an input pulls for 5 samples of every 30.
    pub pulls: bool,
    /// How far scene and C may differ after [`Figure::CHECKED`] steps, as a part: rounding where both step alike.
    pub agree: f64,
    /// What is asked for.
    pub bars: Bars,
}

impl Figure {
    /// After so many steps scene and C are compared.
    pub const CHECKED: u64 = 100;

    /// Whether it is too large to be measured by the way.
    pub fn is_large(&self) -> bool {
        self.size > 1000
    }
}

/// The virtual wall, pushed steadily.
pub const WALL: &str = "
model Wall(k = 1000 N/m, b = 30 N*s/m, gap = 0.1 m) {
  port tip
  C:spring { H = if q > 0 then 0.5*k*q^2 else 0;  q0 = -gap }
  R:damper { e = if spring.q > 0 then b*f else 0 }
  tip -> 1:contact -> spring, damper
}
model VirtualWall {
  Se:hand = 5 N
  I:handle = 1 kg
  sampled at 25 Hz { Wall:wall }
  hand -> 1:v -> handle
  v ||> wall.tip
  probe x = wall.spring.q
  probe p = handle.p
}";

/// The same with a push that is given from outside.
const PULLED: &str = "
model Wall(k = 1000 N/m, b = 30 N*s/m, gap = 0.1 m) {
  port tip
  C:spring { H = if q > 0 then 0.5*k*q^2 else 0;  q0 = -gap }
  R:damper { e = if spring.q > 0 then b*f else 0 }
  tip -> 1:contact -> spring, damper
}
model PulledWall {
  input push = 5 N
  Se:hand = push
  I:handle = 1 kg
  sampled at 25 Hz { Wall:wall }
  hand -> 1:v -> handle
  v ||> wall.tip
  probe x = wall.spring.q
  probe p = handle.p
}";

const DUFFING: &str = "
model Duffing(k = 1 N/m, k3 = 1 N/m^3) {
  C:spring { e = k * q + k3 * q^3;  q0 = 1 m }
  I:mass = 1 kg
  1:v -> spring, mass
  probe q = spring.q
  probe p = mass.p
}";

const DAMPER: &str = "
model Damper {
  Se:force = 1 N
  C:spring { stiffness = 100 N/m;  q0 = 0.1 m }
  I:mass = 1 kg
  R:damper = 0.5 N*s/m
  force -> 1:v -> spring, mass, damper
  probe q = spring.q
  probe p = mass.p
}";

/// A ladder of `n` cells, all of which move from the start on: those that a wave has yet to reach hold subnormal
/// numbers, with which some processors are many times slower.
pub const LADDER: &str = "
model Ladder(n = 100) {
  Se:u = 1 V
  R:load = 1 Ohm
  for k in 1..n {
    I:l[k] = 10 mH
    C:c[k] { compliance = 10 mF;  q0 = 1 mC * sin(k) }
    1:s[k] -> l[k]
    s[k] -> 0:p[k] -> c[k]
  }
  u -> s[1]
  for k in 2..n { p[k-1] -> s[k] }
  p[n] -> load
  probe first = l[1].p
  probe last = c[n].q
}";

const PENDULUM: &str = "
model DoublePendulum(m = 1 kg, l = 1 m, g = 9.81 m/s^2) {
  IC(I p1, I p2, C q1, C q2):arm {
    H = (p1^2 + 2*p2^2 - 2*p1*p2*cos(q1 - q2))/(2*m*l^2*(1 + sin(q1 - q2)^2)) - m*g*l*(2*cos(q1) + cos(q2))
    q1_0 = 90 deg
    q2_0 = 90 deg
  }
  1:w1 -> arm.p1, arm.q1
  1:w2 -> arm.p2, arm.q2
  probe p1 = arm.p1
  probe p2 = arm.p2
  probe q1 = arm.q1
  probe q2 = arm.q2
}";

/// All figures.
pub fn all() -> Vec<Figure> {
    let wall = Figure {
        title: "virtual wall, sampled, the hand pushes steadily",
        unit: "a sample",
        text: WALL,
        method: None,
        step: 0.04,
        kernel: "wall",
        lanes: None,
        size: 0,
        per: 1,
        scenes: 1,
        pulls: false,
        agree: 1e-9,
        bars: Bars { hand: 21.0, run: 32.0, c: 26.0 },
    };
    let pulled =
        Figure { title: "virtual wall, sampled, in and out of contact", text: PULLED, pulls: true, size: 1, ..wall };
    let duffing = Figure {
        title: "Duffing, discrete gradient",
        unit: "a step",
        text: DUFFING,
        step: 0.05,
        kernel: "duffing",
        bars: Bars { hand: 23.0, run: 35.0, c: 28.0 },
        ..wall
    };
    let damper = Figure {
        title: "mass, spring and damper, exact",
        unit: "a step",
        text: DAMPER,
        step: 1e-3,
        kernel: "damper",
        bars: Bars { hand: 4.1, run: 6.2, c: 5.0 },
        ..wall
    };
    let ladder = |title, size| Figure {
        title,
        unit: "a cell and step",
        text: LADDER,
        method: Some("gonzalez"),
        step: 1e-3,
        kernel: "ladder",
        // Eight blocks of cells.
        lanes: (size % 8 == 0).then_some("lanes"),
        size,
        per: size,
        bars: Bars { hand: 3.0, run: 4.5, c: 3.6 },
        ..wall
    };
    let pendulum = Figure {
        title: "double pendulum, IC field",
        unit: "a step",
        text: PENDULUM,
        step: 2e-3,
        kernel: "pendulum",
        // Another discrete gradient of the same order.
        agree: 1e-5,
        bars: Bars { hand: 220.0, run: 330.0, c: 270.0 },
        ..wall
    };
    let together = Figure {
        title: "4096 Duffing oscillators together",
        unit: "an instance and step",
        kernel: "together",
        size: 0,
        per: 4096,
        scenes: 4096,
        bars: Bars { hand: 0.63, run: 2.0, c: 0.95 },
        ..duffing
    };
    vec![
        pulled,
        wall,
        duffing,
        damper,
        ladder("ladder of 100 cells, midpoint", 100),
        ladder("ladder of 1000 cells, midpoint", 1000),
        ladder("ladder of 10 000 cells, midpoint", 10_000),
        pendulum,
        together,
    ]
}
