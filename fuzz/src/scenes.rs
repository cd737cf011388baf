//! Small scenes of every kind.

use bond::{Compiled, Options};

/// A mass that is pushed by an input, with a sampled spring.
pub const FED: &str = "
model Fed(r = 2 N*s/m) {
  input push = 1 N
  I:mass = 1 kg
  R:drag = r
  MSe:hand = push
  sampled at 50 Hz { C:spring { stiffness = 100 N/m } }
  hand -> 1:v -> mass, drag
  v ||> spring
  probe x = integral(v.f, 0 m)
  probe e = spring.e
  simulate { stop = 1 s }
}";

/// A pendulum, which is not linear, stepped by fitted steps.
const SWINGING: &str = "
model Swinging {
  C:weight { H = (20 N*m)*(1 - cos(q)); q0 = 0.5 }
  I:bob = 2 kg*m^2
  R:bearing = 0.1 N*m*s
  1:w -> weight, bob, bearing
  probe angle = weight.q
  simulate { stop = 1 s; tolerance = 1e-6 }
}";

/// A mass on a floor, whose law switches.
const FALLING: &str = "
model Falling {
  Se:weight = 10 N
  I:mass = 1 kg
  C:floor { H = if q > 0 then (5e3 N/m)*q^2 else 0; q0 = -0.01 m }
  R:damper { e = if floor.q > 0 then (20 N*s/m)*f else 0 }
  weight -> 1:v -> mass, floor, damper
  probe depth = floor.q
  simulate { stop = 1 s; tolerance = 1e-5 }
}";

/// Two sampled regions of different periods, between them a continuous mass.
const RATES: &str = "
model Rates {
  sampled every 3 ms { I:left { inertia = 1 kg; f0 = 0.3 m/s } }
  sampled every 7 ms { C:spring { stiffness = 100 N/m }  0:n -> spring }
  sampled every 5 ms { I:right = 0.5 kg }
  left ||> n
  n ||> right
  probe a = left.f
  probe e = spring.e
  simulate { stop = 0.1 s }
}";

/// A mass that is pushed, and sends on how it moves by waves.
pub const NEAR: &str = "
model Near {
  I:handle { inertia = 0.5 kg; f0 = 1 m/s }
  Se:hand = 8 N*sin(5 rad/s*t)
  sampled at 100 Hz {
    port link { impedance = 20 N*s/m }
    1:m -> link
  }
  hand -> 1:v -> handle
  v ||> m
  simulate { stop = 1 s }
}";

/// A mass between springs, at the other end of the waves.
pub const FAR: &str = "
model Far {
  I:tool = 0.2 kg
  C:wall { stiffness = 4e3 N/m; q0 = 0.01 m }
  sampled at 100 Hz {
    port link { impedance = 20 N*s/m }
    link -> 1:s
  }
  1:w -> tool, wall
  w ||> s
  simulate { stop = 1 s }
}";

/// A spring that is stretched at the start, and another behind a lever, at two open ports.
pub const TWO: &str = "
model Two {
  port left { inertia = 0.2 kg }
  port right
  sampled at 500 Hz {
    C:spring { stiffness = 400 N/m; q0 = 0.05 m }
    R:damper = 2 N*s/m
    C:far { stiffness = 100 N/m; q0 = 0.1 m }
    1:w -> spring, damper
    TF:lever = 2
    lever -> far
    1:z -> lever
  }
  left ||> w
  right ||> z
  simulate { stop = 1 s }
}";

/// A wall that is a source which reads how far the tip moved, with something of the past in it.
pub const STEERED: &str = "
model Steered {
  port tip { inertia = 0.2 kg }
  sampled at 500 Hz {
    state late = 0 m { next = place.q }
    C:place { H = 0; q0 = 0 m }
    Se:wall = -(300 N/m)*late - (2 N*s/m)*place.f
    1:w -> place
    wall -> w
  }
  tip ||> w
  simulate { stop = 1 s }
}";

/// A wall that pushes and never pulls.
pub const WALL: &str = "
model Wall {
  port tip { inertia = 0.1 kg }
  sampled at 1 kHz {
    C:spring { H = if q > 0 then (500 N/m)*q^2 else 0; q0 = -0.01 m }
    R:damper { e = if spring.q > 0 then (30 N*s/m)*f else 0 }
    1:contact -> spring, damper
  }
  tip ||> contact
  simulate { stop = 1 s }
}";

/// All of them.
pub const ALL: [&str; 7] = [FED, SWINGING, FALLING, RATES, TWO, STEERED, WALL];

/// Compiles one of them.
///
/// # Panics
/// If it does not compile.
pub fn compiled(text: &str) -> Compiled {
    Options::new().compile_str("scene.bond", text).unwrap_or_else(|e| panic!("{e}"))
}
