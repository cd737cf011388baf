//! The budget within the interval: whatever pushes, however long the period and however many bars, the outside gets no
//! more from sampled regions than they had and were given. Drawn scenes, and a count that never looks at the ledger:
//! what the outside has, less what it had and what pushed it.

use crate::common::{cases, probe, start, text};
use std::fmt::Write;
use std::sync::atomic::{AtomicU64, Ordering};

/// Numbers of a scene's own.
struct Draw(u64);

impl Draw {
    fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Between two numbers, evenly in the logarithm.
    fn log(&mut self, from: f64, to: f64) -> f64 {
        from * (to / from).powf(self.unit())
    }

    fn chance(&mut self, part: f64) -> bool {
        self.unit() < part
    }

    fn of<T: Copy>(&mut self, list: &[T]) -> T {
        list[((self.unit() * list.len() as f64) as usize).min(list.len() - 1)]
    }
}

/// A scene, and what has to be known of it for the count.
struct Scene {
    text: String,
    period: f64,
    /// What is written of it where it fails.
    kind: String,
}

const HOLDS: [&str; 5] = ["", "hold lagged", "hold predicted", "hold matched", "hold lagged method ray"];

/// A body that is pushed, with springs and friction of its own, at one or several sampled regions: walls, springs with
/// dampers, warm ones, masses that hold a flow, chains, of one or of several periods.
fn scene(seed: u64) -> Scene {
    let mut d = Draw(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ 0x1234_5678);
    let (m, period, ratio) = (d.log(0.1, 10.0), d.log(1e-3, 0.3), d.log(0.01, 100.0));
    let k = ratio * m / (period * period);
    let root = (k * m).sqrt();
    let (hold, force, wait) = (d.of(&HOLDS), d.log(0.1, 10.0), period * d.log(2.0, 100.0));
    let rate = 2.0 * std::f64::consts::PI / wait;
    let push = match d.of(&[0, 1, 2]) {
        0 => format!("{force} N"),
        1 => format!("({force} N)*sin({rate} rad/s * t)"),
        // Without warning, and within intervals.
        _ => format!("if sin({rate} rad/s * t) > 0 then {force} N else -{force} N"),
    };
    let speed = if d.chance(0.4) { force * period / m } else { 0.0 };
    let (mut outside, mut has, mut kinds) = (String::new(), "m.H".to_string(), vec![hold]);
    if d.chance(0.3) {
        write!(outside, "  C:o {{ stiffness = {} N/m }}  v -> o", k * d.log(0.1, 10.0)).expect("a text");
        has += " + o.H";
    }
    if d.chance(0.3) {
        write!(outside, "  R:fr = {} N*s/m  v -> fr", root * d.log(0.01, 1.0)).expect("a text");
    }
    if d.chance(0.2) {
        write!(outside, "  R:dry {{ e = ({} N)*tanh(f/(1 mm/s)) }}  v -> dry", 0.3 * force).expect("a text");
        kinds.push("dry");
    }
    let spring = |d: &mut Draw, name: &str, k: f64| match d.of(&[0, 1]) {
        0 => format!("C:{name} {{ stiffness = {k} N/m }}"),
        _ => format!("C:{name} {{ H = if q > 0 then 0.5*({k} N/m)*q^2 else 0 }}"),
    };
    let damping = root * d.of(&[0.0, 0.05, 0.3, 1.0]);
    let mut inner = format!("{}  1:p -> s", spring(&mut d, "s", k));
    if d.chance(0.15) {
        inner += &format!("  RS(r, th):damper = {} N*s/m  Body:body(C = 1 J/K, T0 = 300 K)", damping.max(0.01 * root));
        inner += "  p -> damper.r  damper.th -> 0:T -> body.heat";
        kinds.push("warm");
    } else if damping > 0.0 {
        inner += &format!("  R:d = {damping} N*s/m  p -> d");
    }
    if d.chance(0.2) {
        inner += &format!("  Se:own = {} N  own -> p", force * (2.0 * d.unit() - 1.0));
        kinds.push("own");
    }
    let (mut more, mut tip) = (String::new(), "p");
    let other = period * d.of(&[1.0, 2.0, 0.5, 0.370_1, 1.732_1]);
    match d.of(&[0, 0, 1, 2, 3]) {
        1 => {
            let soft = k * d.log(0.1, 10.0);
            let spring = spring(&mut d, "s2", soft);
            write!(more, "  sampled every {other} s {{ {spring}  1:p2 -> s2 }}  v ||> p2").expect("a text");
            kinds.push("two walls");
        }
        2 => {
            // The wall's far end is another sampled body.
            let far = m * d.log(0.1, 3.0);
            (inner, tip) = (format!("{inner}  0:tip -> p"), "tip");
            write!(more, "  sampled every {other} s {{ I:n = {far} kg  1:w -> n }}  tip ||> w").expect("a text");
            kinds.push("chain");
        }
        3 => {
            let far = m * d.log(0.1, 3.0);
            write!(more, "  C:soft {{ stiffness = {} N/m }}  v -> 0:y -> soft", k * d.log(0.1, 10.0)).expect("a text");
            write!(more, "  sampled every {other} s {{ I:n = {far} kg  1:w -> n }}  y ||> w").expect("a text");
            has += " + soft.H";
            kinds.push("flow held");
        }
        _ => {}
    }
    let uses = if kinds.contains(&"warm") { "use std.thermal\n" } else { "" };
    let latency = match d.chance(0.2) {
        true => format!("latency {} s", period * d.unit()),
        false => String::new(),
    };
    let resolution = match d.chance(0.2) {
        true => format!("resolution {} m", force / k * d.log(1e-4, 0.3)),
        false => String::new(),
    };
    kinds.extend(
        [(!latency.is_empty()).then_some("late"), (!resolution.is_empty()).then_some("in steps")].iter().flatten(),
    );
    let text = format!(
        "{uses}model Drawn {{
  Se:push = {push}
  I:m {{ inertia = {m} kg; f0 = {speed} m/s }}
  1:v -> m  push -> v{outside}
  sampled every {period} s {hold} {latency} {{ {inner} }}
  v ||> {tip} {resolution}
{more}
  probe has = {has}
  probe given = integral(push.e*m.f, 0 J)
  simulate {{ stop = 1 s }}
}}"
    );
    Scene { text, period, kind: format!("{ratio:.2e} {}", kinds.join(", ")) }
}

/// What fails of a scene; nothing where all holds. The count is a sum over steps: where it fails alone, it is made anew
/// with steps that follow a push of any frequency here.
fn failures(scene: &Scene) -> Vec<String> {
    let list = failures_by(scene, bond::Steps::new());
    match !list.is_empty() && list.iter().all(|why| why.starts_with(DREW)) {
        true => failures_by(scene, bond::Steps::fixed(scene.period / 16.0)),
        false => list,
    }
}

const DREW: &str = "the outside drew";

fn failures_by(scene: &Scene, steps: bond::Steps) -> Vec<String> {
    let compiled = text(&scene.text);
    let mut sim = start(&compiled, steps);
    let mut list = Vec::new();
    let first = probe(&mut sim, "has");
    let (mut most, mut drawn) = (first, 0.0f64);
    for n in 1..=420 {
        // Rows lie within intervals.
        if let Err(why) = sim.advance(f64::from(n) * scene.period / 1.4) {
            list.push(why.to_string());
            break;
        }
        let (has, given) = (probe(&mut sim, "has"), probe(&mut sim, "given"));
        drawn = drawn.max(has - first - given);
        most = most.max(has).max(given.abs());
    }
    let summary = sim.summary();
    list.extend(summary.reasons.iter().cloned());
    let crossed = summary.regions.iter().filter(|r| r.hold.is_some()).map(|r| r.h_max).fold(most, f64::max);
    // What a region's own source puts in may be drawn, too: that is the verdict's to judge.
    if drawn > 1e-11 * crossed && !scene.kind.contains("own") {
        list.push(format!("{DREW} {drawn:e} J, beside {crossed:e} J"));
    }
    list.extend(summary.bars.iter().filter(|b| b.difference != 0.0).map(|b| format!("`{}` differs", b.name)));
    list
}

/// More are drawn by `PROPTEST_CASES=10000 cargo test --release -p bond-tests budget`.
#[test]
fn nothing_is_given_that_is_not_there() {
    let (next, all) = (AtomicU64::new(0), u64::from(cases(120)));
    let failing = || {
        let mut found = Vec::new();
        loop {
            let seed = next.fetch_add(1, Ordering::Relaxed);
            if seed >= all {
                return found;
            }
            let scene = scene(seed);
            let list = failures(&scene);
            if !list.is_empty() {
                found.push((seed, format!("{seed}: {}: {list:?}", scene.kind)));
            }
        }
    };
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let mut failed: Vec<(u64, String)> = std::thread::scope(|scope| {
        let threads: Vec<_> = (0..cores).map(|_| scope.spawn(failing)).collect();
        threads.into_iter().flat_map(|thread| thread.join().expect("no panic")).collect()
    });
    failed.sort_unstable();
    let failed: Vec<String> = failed.into_iter().map(|f| f.1).collect();
    assert!(failed.is_empty(), "{} fail:\n{}", failed.len(), failed.join("\n"));
}

/// Scenes of these seeds failed once: a region with a source of its own and a latency or a sampled side; leaps of `ray`
/// that turned heat into work; forecasts that counted on what a limited side had not met; sources that were drawn on by
/// another motion than an encoder reads; and the count itself, of a push that is fast beside its steps.
#[test]
fn what_failed_once_holds() {
    for seed in [42, 150, 460, 1027, 1668, 1876, 2194, 3059, 3336, 6200, 6222, 6586, 7277] {
        let scene = scene(seed);
        assert_eq!(failures(&scene), Vec::<String>::new(), "{seed}: {}", scene.kind);
    }
}

/// A step of a sampled side meets as much of what is held as the holder can give: all that a stretched spring stores
/// goes over, and no more.
#[test]
fn a_step_meets_as_much_as_there_is() {
    for (stretch, speed) in [(0.1, 5.0), (0.03, 5.0), (0.2, 40.0)] {
        let compiled = text(&format!(
            "model Meets {{
  sampled at 10 Hz {{ I:n {{ inertia = 1 kg; f0 = {speed} m/s }}  1:w -> n }}
  sampled at 10 Hz hold lagged {{ C:s {{ stiffness = 200 N/m; q0 = -{stretch} m }}  1:p -> s }}
  w ||> p
  simulate {{ stop = 0.1 s }}
}}"
        ));
        let mut sim = start(&compiled, bond::Steps::new());
        sim.advance(0.1).expect("a run");
        let (crossed, stored) = (sim.summary().bars[0].holder, 100.0 * stretch * stretch);
        assert!((crossed + stored).abs() <= 1e-12 * stored, "{crossed} of {stored}");
    }
}

/// A leap of `ray` leaves entropies as they are: the heat of a body is not there to move a spring.
#[test]
fn leaps_take_no_heat() {
    let compiled = text(
        "use std.thermal
model Warm {
  Se:push = (2 N)*sin(40 rad/s * t)
  I:m = 1 kg
  1:v -> m  push -> v
  sampled at 80 Hz hold lagged method ray {
    C:s { H = if q > 0 then (400 N/m)*q^2 else 0 }
    RS(r, th):damper = 9 N*s/m
    Body:body(C = 1 J/K, T0 = 300 K)
    1:p -> s
    p -> damper.r
    damper.th -> 0:T -> body.heat
  }
  v ||> p
  probe temperature = T.e
  simulate { stop = 2 s }
}",
    );
    let mut sim = start(&compiled, bond::Steps::new());
    for n in 1..=160 {
        let before = probe(&mut sim, "temperature");
        sim.advance(f64::from(n) / 80.0).expect("a run");
        assert!(probe(&mut sim, "temperature") >= before, "at sample {n}");
    }
    let leaps: u64 = sim.summary().regions.iter().map(|r| r.leaps).sum();
    assert!(leaps > 10, "{leaps} leaps");
}
