//! A handle, a hand and a wall: the scenes, and how they run.

use bond::internal::{CompiledInternals, SimulationInternals, StepsInternals};
use bond::{Compiled, Options, RunError, Simulation, Steps, Text};
use std::fmt;

/// The period, s.
pub const PERIOD: f64 = 1e-3;
/// The mass of the handle, kg.
pub const MASS: f64 = 0.1;
/// The friction of the device itself, N s/m.
pub const FRICTION: f64 = 1.0;
/// How fast a hand leads the handle, and how fast it is let go, m/s.
pub const SPEED: f64 = 0.1;

/// Where the wall stands in the texts.
const PLACE: &str = "PLACE";
/// What joins it to the handle in the texts.
const JOINT: &str = "JOINT";

/// A wall that pushes and pulls.
const WALL: &str = "
    model Wall(k = 1000 N/m, b = 1 N*s/m) {
      port tip
      C:spring { stiffness = k }
      R:damper = b
      tip -> 1:contact -> spring, damper
    }";

/// A hand pushes the handle: a constant force and a sine. The device has no friction of its own.
const PUSHED: &str = "
    model Pushed(m = 0.1 kg, k = 1000 N/m, b = 1 N*s/m, base = 1 N, swing = 0 N, period = 1 s) {
      Se:hand = base + swing*sin(2*pi*t/period)
      I:handle = m
      PLACE
      hand -> 1:v -> handle
      v JOINT wall.tip
      let place = integral(v.f, 0 m)
      probe x = place
      probe sum = integral(place, 0 m*s)
      probe impulse = integral(hand.e - handle.e, 0 N*s)
    }";

/// A hand leads the handle to and fro at one speed, and turns at every such instant.
const LED: &str = "
    model Led(k = 1000 N/m, b = 1 N*s/m, friction = 1 N*s/m, speed = 1 m/s, turn = 1 s) {
      Sf:hand = if mod(t, 2*turn) < turn then speed else -speed
      R:bearing = friction
      PLACE
      hand -> 1:v -> bearing
      v JOINT wall.tip
      expect passive at hand
    }";

/// The handle is let go at the wall's rest with a speed.
const FREE: &str = "
    model Free(m = 0.1 kg, k = 1000 N/m, b = 1 N*s/m, friction = 1 N*s/m, speed = 1 m/s) {
      I:handle { inertia = m; f0 = speed }
      R:bearing = friction
      PLACE
      1:v -> handle, bearing
      v JOINT wall.tip
      probe x = integral(v.f, 0 m)
      probe fast = v.f
    }";

/// A hold of the language.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Hold {
    /// What is measured at the sample.
    Lagged,
    /// A step with the flow of the last interval.
    Predicted,
    /// A step with the flow that answers it.
    Matched,
}

/// All of them.
pub const HOLDS: [Hold; 3] = [Hold::Lagged, Hold::Predicted, Hold::Matched];

impl fmt::Display for Hold {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Hold::Lagged => "lagged",
            Hold::Predicted => "predicted",
            Hold::Matched => "matched",
        })
    }
}

/// How the wall is computed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Computed {
    /// In continuous time.
    Continuously,
    /// By samples, with the budget or without.
    Sampled(Hold, bool),
}

impl Computed {
    /// A text with the wall in its place.
    fn text(self, scene: &str) -> String {
        let (wall, joint) = match self {
            Computed::Continuously => ("Wall:wall(k = k, b = b)".to_string(), "->"),
            Computed::Sampled(hold, budget) => {
                let budget = if budget { "on" } else { "off" };
                let clock = format!("sampled every {} s hold {hold} budget {budget}", PERIOD);
                (format!("{clock} {{ Wall:wall(k = k, b = b) }}"), "||>")
            }
        };
        WALL.to_string() + &scene.replace(PLACE, &wall).replace(JOINT, joint)
    }
}

/// The wall that is written.
#[derive(Clone, Copy, Debug)]
pub struct Wall {
    /// Stiffness, N/m.
    pub k: f64,
    /// Damping, N s/m.
    pub b: f64,
}

/// A push: a constant force, and a sine with a period.
#[derive(Clone, Copy, Debug)]
pub struct Push {
    /// N
    pub base: f64,
    /// N
    pub swing: f64,
    /// In samples.
    pub period: u32,
}

/// What the handle did in an interval.
#[derive(Clone, Copy, Debug)]
pub struct Interval {
    /// Where it was at the end, m.
    pub x: f64,
    /// Where it was in the mean, m.
    pub mean: f64,
    /// How fast it was in the mean, m/s.
    pub speed: f64,
    /// What it felt in the mean, N.
    pub force: f64,
}

/// A push against a wall, interval by interval.
pub struct Pushed {
    /// The intervals.
    pub intervals: Vec<Interval>,
    /// How often the wall let go within one.
    pub releases: u64,
    /// Whether the motion grew until the run was broken off.
    pub grows: bool,
}

/// What an amplitude must exceed, as a part of where the push would rest, to count as growing without end.
const GROWN: f64 = 1e3;

/// One scene for one way to compute the wall: a text that compiles for many walls.
pub struct Scene(Text);

impl Scene {
    /// A hand pushes.
    pub fn pushed(computed: Computed) -> Self {
        Self(Text::new("pushed.bond", computed.text(PUSHED)))
    }

    /// A hand leads.
    pub fn led(computed: Computed) -> Self {
        Self(Text::new("led.bond", computed.text(LED)))
    }

    /// Nobody holds the handle.
    pub fn free(computed: Computed) -> Self {
        Self(Text::new("free.bond", computed.text(FREE)))
    }

    fn compile(&self, wall: Wall, more: &[(&str, String)]) -> Result<Compiled, String> {
        let mut options = Options::new().set("k", &format!("{} N/m", wall.k)).set("b", &format!("{} N*s/m", wall.b));
        for (name, value) in more {
            options = options.set(*name, value);
        }
        options.compile_text(&self.0).map_err(|e| e.to_string())
    }

    /// Pushes for so many intervals, or until the motion is far too large.
    ///
    /// # Errors
    /// In words.
    pub fn push(&self, wall: Wall, push: Push, intervals: u32) -> Result<Pushed, String> {
        let compiled = self.compile(
            wall,
            &[
                ("m", format!("{MASS} kg")),
                ("base", format!("{} N", push.base)),
                ("swing", format!("{} N", push.swing)),
                ("period", format!("{} s", f64::from(push.period) * PERIOD)),
            ],
        )?;
        let far = GROWN * (push.base.abs() + push.swing.abs()) / wall.k;
        let mut sim = start(&compiled, intervals)?;
        let (mut list, mut grows) = (Vec::new(), false);
        let mut before = [0.0; 3];
        for i in 1..=intervals {
            let now = advance(&mut sim, i)?;
            let mean = |j: usize| (now[j] - before[j]) / PERIOD;
            let force = mean(2);
            list.push(Interval { x: now[0], mean: mean(1), speed: mean(0), force });
            // Neither is what is not a number.
            let near = now[0].abs() < far;
            if !near {
                grows = true;
                break;
            }
            before = now;
        }
        let releases = sim.summary().regions.iter().map(|r| r.releases).sum();
        Ok(Pushed { intervals: list, releases, grows })
    }

    /// Whether no more is drawn at the hand than was put in, where it turns after so many samples.
    ///
    /// # Errors
    /// In words.
    pub fn passive(&self, wall: Wall, turn: u32, intervals: u32) -> Result<bool, String> {
        let more = [
            ("friction", format!("{FRICTION} N*s/m")),
            ("speed", format!("{SPEED} m/s")),
            ("turn", format!("{} s", f64::from(turn) * PERIOD)),
        ];
        let compiled = self.compile(wall, &more)?;
        let mut sim = start(&compiled, intervals)?;
        match sim.advance(f64::from(intervals) * PERIOD) {
            Ok(()) => Ok(sim.summary().watched.iter().all(|w| w.broken.is_none())),
            Err(e) => diverged(&e).map(|()| false),
        }
    }

    /// Whether the motion of the handle that is let go becomes less: the largest energy in the last quarter of the run
    /// is less than that in its first quarter.
    ///
    /// # Errors
    /// In words.
    pub fn settles(&self, wall: Wall, intervals: u32) -> Result<bool, String> {
        let more =
            [("m", format!("{MASS} kg")), ("friction", format!("{FRICTION} N*s/m")), ("speed", format!("{SPEED} m/s"))];
        let compiled = self.compile(wall, &more)?;
        let mut sim = start(&compiled, intervals)?;
        let (mut first, mut last) = (0.5 * MASS * SPEED * SPEED, 0.0f64);
        for i in 1..=intervals {
            if let Err(e) = sim.advance(f64::from(i) * PERIOD) {
                return diverged(&e).map(|()| false);
            }
            let [x, v] = match sim.probes().map_err(|e| e.to_string())? {
                [x, v, ..] => [*x, *v],
                _ => return Err("there are no probes".into()),
            };
            let energy = 0.5 * (MASS * v * v + wall.k * x * x);
            if energy > GROWN * first {
                return Ok(false);
            }
            if 4 * i <= intervals {
                first = first.max(energy);
            } else if 4 * i > 3 * intervals {
                last = last.max(energy);
            }
        }
        Ok(last < first)
    }
}

/// A run at its start.
fn start(compiled: &Compiled, intervals: u32) -> Result<Simulation<'_>, String> {
    let settings = &compiled.stages().model.settings;
    let stop = f64::from(intervals) * PERIOD;
    let options = Steps::fixed(PERIOD).resolve(settings, stop, None).map_err(|e| e.to_string())?;
    Simulation::new(compiled.scene(), &options).map_err(|e| e.to_string())
}

/// Runs to the end of an interval: the first three probes there.
fn advance(sim: &mut Simulation<'_>, interval: u32) -> Result<[f64; 3], String> {
    let failed = |e: RunError| e.to_string();
    sim.advance(f64::from(interval) * PERIOD).map_err(failed)?;
    match sim.probes().map_err(failed)? {
        [a, b, c, ..] => Ok([*a, *b, *c]),
        _ => Err("there are no probes".into()),
    }
}

/// A run that ended because its numbers became too large. Another failure is one of this benchmark.
fn diverged(e: &RunError) -> Result<(), String> {
    match e {
        RunError::Numerics(_) => Ok(()),
        _ => Err(e.to_string()),
    }
}

/// How often in 1000 intervals the wall let go.
pub fn releases(run: &Pushed) -> f64 {
    1000.0 * run.releases as f64 / run.intervals.len().max(1) as f64
}
