//! Scenes as C and as object files do what `Simulation` does: driven from outside, saved and restored, in single
//! numbers.
//!
//! Compiled with the C compiler of this machine; where there is none, that is said, and nothing is tested.

use crate::backend::large;
use crate::common::{all_scenes, file, models, stop, with};
use bond::internal::{CompiledInternals, StepsInternals};
use bond::{Compiled, Options, Steps};
use bond_compiler::backend::code::Reason;
use bond_compiler::backend::{c, native, standalone, wasm};
use bond_runtime::interpreter::Interpret;
use bond_runtime::simulate;
use std::path::PathBuf;
use std::process::Command;
use std::sync::atomic::{AtomicU32, Ordering};

/// Intervals of a run.
const ROWS: u32 = 100;

/// As strictly as can be.
const STRICT: [&str; 7] = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-ffp-contract=off", "-O1"];

/// Drives a scene with a pattern, prints a row an interval (probes, open ports, energy), and holds the state to its
/// promises: a saved one goes on as the first did, and a failed interval leaves it as it was.
const MAIN: &str = r#"
#include "m.h"
#include <stdio.h>
#include <string.h>
static bond_state b, other;
static bond_real before[BOND_SAVED], after[BOND_SAVED], half[BOND_SAVED];
static bond_real moved[BOND_PORTS + 1], out[BOND_PROBES + 1], held[BOND_PORTS + 1];
static double pattern(int k, int i) { return ((k * 7 + i * 3) % 11 - 5) * 0.1; }
static int step(bond_state *s, int k) {
    int i;
    for (i = 0; i < BOND_INPUTS; ++i) bond_input(s, i, (bond_real)pattern(k, i));
    for (i = 0; i < BOND_PORTS; ++i) moved[i] = (bond_real)(pattern(k, i) * BOND_INTERVAL);
    return bond_commit(s, moved);
}
static int row(bond_state *s, int shown) {
    int j, failed = bond_probes(s, out);
    if (failed || !shown) return failed;
    for (j = 0; j < BOND_PROBES; ++j) printf("%.17g ", (double)out[j]);
    bond_output(s, held);
    for (j = 0; j < BOND_PORTS; ++j) printf("%.17g ", (double)held[j]);
    printf("%.17g\n", (double)bond_energy(s));
    return 0;
}
/* Many intervals at once are as many one by one, up to one that fails. */
static int runs(void) {
#ifdef RUNS
    int k, failed = 0;
    bond_init(&b);
    bond_init(&other);
    for (k = 0; k < BOND_INPUTS; ++k) {
        bond_input(&b, k, (bond_real)pattern(1, k));
        bond_input(&other, k, (bond_real)pattern(1, k));
    }
    for (k = 0; k < 3 * COUNT && !failed; ++k) failed = bond_commit(&b, 0);
    if (bond_run(&other, 0) || bond_run(&other, 3 * COUNT) != failed) return 3;
    bond_save(&b, before);
    bond_save(&other, after);
    if (memcmp(before, after, sizeof before)) return 2;
#endif
    return 0;
}
int main(void) {
    int k, failed;
    bond_init(&b);
    bond_input(&b, -1, 7);
    bond_input(&b, BOND_INPUTS, 7);
    if (row(&b, 1)) return 0;
    for (k = 1; k <= COUNT; ++k) {
        bond_save(&b, before);
        failed = step(&b, k);
        if (failed) {
            int i;
            for (i = 0; i < BOND_INPUTS; ++i) bond_input(&b, i, (bond_real)pattern(k - 1, i));
            bond_save(&b, after);
            if (k > 1 && memcmp(before, after, sizeof before)) return 9;
            return failed > BOND_GROSS_BALANCE ? 8 : runs();
        }
        bond_save(&b, before);
        if (row(&b, 1)) return 0;
        bond_save(&b, after);
        if (memcmp(before, after, sizeof before)) return 10;
        if (k == COUNT / 2) bond_save(&b, half);
    }
    memset(&other, 255, sizeof other);
    bond_restore(&other, half);
    for (k = COUNT / 2 + 1; k <= COUNT; ++k) if (step(&other, k) || row(&other, 0)) return 7;
    bond_save(&b, before);
    bond_save(&other, after);
    if (memcmp(before, after, sizeof before)) return 6;
    if (bond_ledger(&b, -1, 0) == 0 || bond_ledger(&b, BOND_REGIONS, 0) == 0 || bond_ledger(&b, 0, BOND_LEDGER_H_LEAST + 1) == 0) return 5;
    return bond_size() == sizeof b ? runs() : 4;
}
"#;

/// The same in JavaScript, for modules.
const SCRIPT: &str = r#"
import { readFileSync } from "node:fs";
const { module, instance } = await WebAssembly.instantiate(readFileSync(process.argv[2]), { Math });
const about = JSON.parse(new TextDecoder().decode(WebAssembly.Module.customSections(module, "bond")[0]));
const e = instance.exports;
const numbers = (at, n) => new Float64Array(e.memory.buffer, at.value, n);
const [moved, held] = [e.moved, e.held].map((at) => numbers(at, about.ports.length));
const probed = numbers(e.probed, about.probes.length);
const state = numbers(e.state, e.saved.value);
const pattern = (k, i) => (((k * 7 + i * 3) % 11) - 5) * 0.1;
const same = (a, b) => a.every((x, k) => Object.is(x, b[k]));
const out = [];
const step = (k) => {
  about.inputs.forEach((_, i) => e.input(i, pattern(k, i)));
  about.ports.forEach((_, i) => (moved[i] = pattern(k, i) * about.interval));
  return e.commit();
};
const row = () => {
  if (e.probes()) return 1;
  e.output();
  out.push([...probed, ...held, e.energy()].join(" "));
  return 0;
};
/* Many intervals at once are as many one by one, up to one that fails. */
const runs = () => {
  if (!e.run) return 0;
  e.init();
  about.inputs.forEach((_, i) => e.input(i, pattern(1, i)));
  let failed = 0;
  for (let k = 0; k < 3 * COUNT && !failed; ++k) failed = e.commit();
  const after = state.slice();
  e.init();
  about.inputs.forEach((_, i) => e.input(i, pattern(1, i)));
  if (e.run(0) || e.run(3 * COUNT) !== failed) return 3;
  return same(state, after) ? 0 : 2;
};
const main = () => {
  e.input(-1, 7);
  e.input(about.inputs.length, 7);
  if (row()) return 0;
  let half;
  for (let k = 1; k <= COUNT; ++k) {
    const before = state.slice();
    const failed = step(k);
    if (failed) {
      about.inputs.forEach((_, i) => e.input(i, pattern(k - 1, i)));
      if (k > 1 && !same(state, before)) return 9;
      return failed > REASONS ? 8 : runs();
    }
    const mine = state.slice();
    if (row()) return 0;
    if (!same(state, mine)) return 10;
    if (k === COUNT / 2) half = state.slice();
  }
  const end = state.slice();
  e.init();
  state.set(half);
  for (let k = COUNT / 2 + 1; k <= COUNT; ++k) if (step(k)) return 7;
  if (!same(state, end)) return 6;
  if (e.ledger(-1, 0) === 0 || e.ledger(about.regions.length, 0) === 0 || e.ledger(0, about.ledger.length) === 0) return 5;
  return runs();
};
process.exitCode = main();
console.log(out.join("\n"));
"#;

/// Whether there is a C compiler.
pub fn is_there() -> bool {
    has("cc")
}

/// Whether a command is there; where it is not, that is said.
fn has(name: &str) -> bool {
    let there = Command::new(name).arg("--version").output().is_ok_and(|o| o.status.success());
    if !there {
        println!("there is no {name}: left out");
    }
    there
}

/// A folder of its own.
pub struct Folder(PathBuf);

impl Folder {
    pub fn new() -> Self {
        static COUNT: AtomicU32 = AtomicU32::new(0);
        let n = COUNT.fetch_add(1, Ordering::Relaxed);
        let path = std::env::temp_dir().join(format!("bond-emitted-{}-{n}", std::process::id()));
        std::fs::create_dir_all(&path).expect("a folder can be made");
        Self(path)
    }

    pub fn put(&self, name: &str, text: impl AsRef<[u8]>) {
        std::fs::write(self.0.join(name), text).expect("a file can be written");
    }

    pub fn cc(&self, args: &[&str]) {
        let out = Command::new("cc").args(STRICT).args(args).current_dir(&self.0).output().expect("cc runs");
        assert!(out.status.success(), "{args:?}: {}", String::from_utf8_lossy(&out.stderr));
    }

    /// The numbers that a program prints.
    pub fn rows(&self, name: &str) -> Vec<Vec<f64>> {
        Self::printed(name, &mut Command::new(self.0.join(name)))
    }

    fn printed(name: &str, command: &mut Command) -> Vec<Vec<f64>> {
        let out = command.output().expect("it runs");
        assert_eq!(out.status.code(), Some(0), "{name}: {}", String::from_utf8_lossy(&out.stderr));
        let text = String::from_utf8_lossy(&out.stdout);
        text.lines().map(|l| l.split_whitespace().filter_map(|x| x.parse().ok()).collect()).collect()
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// A scene's unit, and the options of the run that it is to equal.
pub fn emit(compiled: &Compiled, h: f64) -> Result<(standalone::StandaloneModule, simulate::Options), String> {
    let settings = &compiled.stages().model.settings;
    let options = Steps::fixed(h).resolve(settings, stop(compiled), settings.every).map_err(|e| e.to_string())?;
    standalone::module(compiled.scene(), &options).map(|u| (u, options))
}

pub fn options(prefix: &str, header: &str) -> c::Options {
    c::Options { prefix: prefix.into(), header: header.into(), single: true, begin: false }
}

/// A folder with the C of a unit and a `main.c` beside it, built as `run`.
fn built(u: &standalone::StandaloneModule, main: &str) -> Folder {
    let (here, names) = (Folder::new(), options("bond", "m.h"));
    here.put("m.h", c::header(u, &names));
    here.put("m.c", c::source(u, &names));
    here.put("main.c", main);
    here.cc(&["m.c", "main.c", "-lm", "-o", "run"]);
    here
}

/// Numbers that a scene shows, interval by interval.
type Rows = Vec<Vec<f64>>;

/// Rows of a scene in C, as an object and as a module.
struct Emitted {
    c: Rows,
    object: Rows,
    /// None where nothing here runs modules. And whether it calls functions of its host.
    module: Option<(Rows, bool)>,
}

/// The scene in each form.
fn emitted(compiled: &Compiled, u: &standalone::StandaloneModule) -> Emitted {
    let here = Folder::new();
    let names = options("bond", "m.h");
    here.put("m.h", c::header(u, &names));
    here.put("m.c", c::source(u, &names));
    here.put("main.c", MAIN.replace("COUNT", &ROWS.to_string()));
    // What a compiler says of single numbers; how they come out, other tests tell.
    here.cc(&["-DBOND_FLOAT", "-fsyntax-only", "m.c"]);
    let runs = if u.run.is_some() { "-DRUNS" } else { "-DNONE" };
    here.cc(&[runs, "-c", "main.c"]);
    here.cc(&["m.c", "main.o", "-lm", "-o", "run"]);
    here.put("m.o", native::object(u, "bond").unwrap_or_else(|e| panic!("{}: {e}", u.name)));
    here.cc(&["m.o", "main.o", "-lm", "-o", "object"]);
    let module = has("node").then(|| {
        let code = wasm::module(compiled.scene(), u).unwrap_or_else(|e| panic!("{}: {e}", u.name));
        let calls = code.windows(5).any(|w| w == b"\x04Math");
        here.put("m.wasm", code);
        here.put(
            "main.mjs",
            SCRIPT.replace("COUNT", &ROWS.to_string()).replace("REASONS", &Reason::ALL.len().to_string()),
        );
        let node = &mut Command::new("node");
        (Folder::printed("module", node.args(["main.mjs", "m.wasm"]).current_dir(&here.0)), calls)
    });
    Emitted { c: here.rows("run"), object: here.rows("object"), module }
}

/// The pattern of [`MAIN`].
fn pattern(k: u32, i: usize) -> f64 {
    f64::from((k as i32 * 7 + i as i32 * 3) % 11 - 5) * 0.1
}

/// The same rows by [`simulate::Simulation`], until a step fails.
fn simulated(
    compiled: &Compiled,
    u: &standalone::StandaloneModule,
    options: &simulate::Options,
) -> (Vec<Vec<f64>>, bool) {
    let scene = compiled.scene();
    let mut sim = simulate::Simulation::on(&Interpret, scene, options, Vec::new()).unwrap_or_else(|e| panic!("{e}"));
    let shown = compiled.probes().len();
    // Of each open port that a sampled region holds: intervals a period, and what it moved in the period that runs.
    let ratio = |o: usize| scene.clusters[scene.open[o].port.0].period.map(|p| (p / u.interval).round() as u32);
    let mut gone = vec![0.0; scene.open.len()];
    let mut rows = Vec::new();
    for k in 0..=ROWS {
        if k > 0 {
            (0..scene.inputs.len()).for_each(|i| sim.set_input(i, pattern(k, i)));
            for (o, sum) in gone.iter_mut().enumerate() {
                let x = pattern(k, o) * u.interval;
                match ratio(o) {
                    Some(n) => {
                        *sum = if (k - 1) % n == 0 { x } else { *sum + x };
                        sim.report(o, *sum);
                    }
                    None => sim.drive(o, x),
                }
            }
            if sim.advance(f64::from(k) * u.interval).is_err() {
                break;
            }
        }
        let Ok(probes) = sim.probes().map(<[f64]>::to_vec) else { break };
        let mut row = probes[..shown].to_vec();
        row.extend((0..scene.open.len()).map(|o| if ratio(o).is_some() { sim.held_at(o) } else { f64::NAN }));
        let regions = sim.summary().regions;
        if regions.iter().any(|r| r.releases > 0) {
            return (rows, true);
        }
        row.push(regions.iter().map(|r| r.h_final).sum());
        rows.push(row);
    }
    (rows, false)
}

/// Asserts that a scene's C, its object and its module do what the simulation does.
fn same(name: &str, compiled: &Compiled, h: f64) -> Result<(), String> {
    let (u, options) = emit(compiled, h)?;
    let Emitted { c: rows, object, module } = emitted(compiled, &u);
    let (wanted, let_go) = simulated(compiled, &u, &options);
    assert!(rows.len() > 1 && (let_go || wanted.len() > 1), "{name} has rows");
    // A step that fails is halved there, and ends the run here; the simulation's own failures end both.
    assert!(let_go || rows.len() <= wanted.len(), "{name}: {} rows in C, {} here", rows.len(), wanted.len());
    let ports = compiled.scene().open.len();
    if let Some((module, calls)) = &module {
        assert_eq!(module.len(), rows.len(), "{name}, rows of the module");
        for (k, (ours, theirs)) in module.iter().zip(&rows).enumerate() {
            assert_eq!(ours.len(), theirs.len(), "{name}, row {k} of the module");
            for (i, (a, b)) in ours.iter().zip(theirs).enumerate() {
                // Functions of the host are its own.
                let off = if *calls { 1e-9 * b.abs() + 1e-12 } else { 0.0 };
                let close = (a - b).abs() <= off || a == b || (a.is_nan() && b.is_nan());
                assert!(close, "{name}, row {k}, number {i}: {a:e} in the module, {b:e} in C");
            }
        }
    }
    // A module does not let go within an interval: it is the same until then.
    for (k, (row, wanted)) in rows.iter().zip(&wanted).enumerate() {
        assert_eq!(row.len(), wanted.len(), "{name}, row {k}");
        let first_port = row.len() - 1 - ports;
        for (i, (ours, theirs)) in row.iter().zip(wanted).enumerate() {
            let mean = (first_port..first_port + ports).contains(&i) && theirs.is_nan();
            let close = (ours - theirs).abs() <= 1e-9 * theirs.abs() + 1e-12 || (ours.is_nan() && theirs.is_nan());
            assert!(close || mean, "{name}, row {k}, number {i}: {ours:e} in C, {theirs:e} here");
        }
    }
    let bits = |rows: &[Vec<f64>]| -> Vec<u64> {
        rows.iter().flatten().map(|x| if x.is_nan() { u64::MAX } else { x.to_bits() }).collect()
    };
    assert_eq!(bits(&object), bits(&rows), "{name}: the object against C");
    Ok(())
}

#[test]
fn scenes_driven_from_outside_give_the_same_numbers() {
    if !is_there() {
        return;
    }
    let mut seen = 0;
    for (title, path, scene) in all_scenes() {
        if !(title.starts_with("examples/") || title.starts_with("elements/")) {
            continue;
        }
        let compiled = file(&path, Options::new().model(&scene));
        let h = compiled.stages().model.settings.step.unwrap_or(stop(&compiled) / 2000.0);
        match same(&format!("{title} {scene}"), &compiled, h) {
            Ok(()) => seen += 1,
            Err(why) => assert!(why.contains("no compiled form") || why.contains("in an interval"), "{title}: {why}"),
        }
    }
    assert!(seen > 50, "{seen} scenes have a compiled form");
}

/// What the non-iterative step keeps of its last steps, and starts from, is in the block as any state is.
#[test]
fn the_non_iterative_step_gives_the_same_numbers() {
    if !is_there() {
        return;
    }
    for (name, h) in [("pendulum", 0.01), ("kepler", 0.01), ("spring_pendulum", 0.01), ("pump_relief", 0.005)] {
        let path = models().join("classics").join(format!("{name}.bond"));
        let compiled = file(&path, Options::new().method("sav"));
        same(name, &compiled, h).unwrap_or_else(|e| panic!("{name}: {e}"));
    }
}

/// A wall whose law jumps, for rates and holds that the examples do not have.
pub const WALL: &str = "\
model Wall(k = 1000 N/m, b = 5 N*s/m, gap = 1e-4 m) {
  port tip
  C:spring { H = if q > 0 then 0.5*k*q^2 else 0; q0 = -gap }
  R:damper { e = if spring.q > 0 then b*f else 0 }
  tip -> 1:contact -> spring, damper
}
";

/// More frictions than are eliminated where they stand, until they come to rest: no step of this length goes there.
const TRAIN: &str = "
model A(n = 10) {
  Se:u = 10 N*m * sin(3 rad/s * t)
  I:a { inertia = 0.5 kg*m^2; f0 = 2 rad/s }
  for i in 1..n {
    R:f[i] { e = 1 N*m * min(max(s, -1), 1); f = (s - min(max(s, -1), 1)) * 1 rad/s }
    1:w[i] -> f[i]
  }
  for i in 2..n { TF:g[i] = 1.2  w[i - 1] -> g[i] -> w[i] }
  u -> w[1] -> a
  probe p = a.p
  simulate { stop = 1 s }
}";

/// Springs with natural lengths, and a pendulum counted from its rest.
pub const FROM_BELOW: &str = "
model A {
  I:mass { inertia = 0.5 kg; f0 = 1 m/s }
  1:v -> mass
  sampled at 200 Hz hold lagged { C:s { e = 100 N/m * (q - 0.3 m); q0 = 0.25 m } R:d = 0.2 N*s/m 1:w -> s, d }
  sampled at 200 Hz { C:p { H = 2 J * -cos(q/(0.3 m)); q0 = 0.1 m } 1:z -> p }
  v ||> w
  v ||> z
  I:other { inertia = 2 kg; f0 = -1 m/s }
  1:u -> other
  sampled at 100 Hz { C:l { e = 40 N/m * (q - 0.2 m) } R:b = 3 N*s/m 1:y -> l, b }
  u ||> y
  probe x = s.q
  probe q = l.q
  simulate { stop = 1 s }
}";

#[test]
fn what_the_examples_do_not_have() {
    if !is_there() {
        return;
    }
    let cases = [
        (
            "two rates at open ports, one with an inertia",
            "model A {
  port one { inertia = 0.1 kg }
  port other
  sampled at 2 kHz { Wall:fast }
  sampled at 1 kHz hold lagged { Wall:slow }
  one ||> fast.tip
  other ||> slow.tip
  probe p = fast.spring.q
  probe q = slow.spring.q
  probe f = fast.contact.f
  simulate { stop = 1 s }
}",
            1e-3,
        ),
        (
            "a source of a region's own, from rest",
            "model A {
  sampled at 1 kHz hold lagged { Se:u = 1 N  R:r = 0.8 N*s/m  1:x  u -> x -> r }
  sampled at 500 Hz hold predicted { Se:z = 0.5 N  C:k = 0.1 m/N  1:y  z -> y -> k }
  I:m = 1 kg  I:n = 2 kg
  1:v -> m  1:w -> n
  v ||> x
  w ||> y
  probe p = m.p
  probe q = n.p
  simulate { stop = 1 s }
}",
            1e-3,
        ),
        (
            "an own source that the outside balances but for rounding, from rest",
            "model A {
  port a
  port b
  port c
  port d
  sampled every 6 ms { Wall:x }
  sampled every 6 ms { Wall:y }
  sampled every 6 ms { Wall:z }
  sampled every 6 ms {
    Se:own = -1 N - 2 N * sin(40 Hz * t)
    C:k { stiffness = 100 N/m }
    R:l = 4 N*s/m
    own -> 1:v -> k, l
  }
  a ||> x.tip
  b ||> y.tip
  c ||> z.tip
  d ||> v
  probe q = k.q
  simulate { stop = 1 s }
}",
            6e-3,
        ),
        ("frictions of a train of gears, which leave their shares open", TRAIN, 1e-3),
        ("energies that are least below 0, of two regions together and of one", FROM_BELOW, 1e-3),
        (
            "roots that begin where nothing flows",
            "model Tank(a = 1 m^3/(s*Pa^(1/2))) {
  port top
  port bottom
  C:c = 1 m^3/Pa
  R:hole { f = a*sqrt(e) }
  top -> 0:p -> c
  p -> 1:out -> hole
  out -> bottom
}
model A {
  Sf:inflow = 1 m^3/s
  Se:sink = 0 Pa
  Tank:one
  C:c = 1 m^3/Pa
  R:hole { f = 1 m^3/(s*Pa^(1/2)) * (if e < 0 Pa then 0 else sqrt(e)) }
  inflow -> one.top
  one.bottom -> sink
  Sf:rain = 2 m^3/s
  rain -> 0:p -> c, hole
  probe x = one.c.q
  probe y = c.q
  simulate { stop = 1 s }
}",
            1e-3,
        ),
        (
            "a mass between two rates, and a region that nothing concerns",
            "model A {
  I:mass { inertia = 0.2 kg; f0 = 1 m/s }
  sampled at 2 kHz { Wall:fast }
  sampled at 1 kHz hold predicted { Wall:slow }
  1:v -> mass
  v ||> fast.tip
  v ||> slow.tip
  C:tank { stiffness = 40 N/m; q0 = 0.1 m }
  I:load { inertia = 1 kg }
  R:loss { e = f^3*(1 N*s^3/m^3) }
  1:w -> tank, load, loss
  probe x = integral(v.f, 0 m)
  probe q = tank.q
  simulate { stop = 1 s }
}",
            1.25e-4,
        ),
        (
            "dry friction held over an interval",
            "model Brake { port tip
  R:dry { e = sign(f)*(2 N) }
  C:spring { stiffness = 300 N/m }
  tip -> 1:contact -> spring, dry
}
model A {
  Se:hand = 5 N
  I:mass { inertia = 0.1 kg; f0 = 0.5 m/s }
  sampled at 200 Hz { Brake:brake }
  hand -> 1:v -> mass
  v ||> brake.tip
  probe f = brake.contact.f
  probe e = brake.tip.e
  probe x = integral(v.f, 0 m)
  simulate { stop = 1 s }
}",
            5e-3,
        ),
        (
            "a flow that is held, beside a port of a continuous region and inputs of both",
            "model Body { port p
  input lift = 1 N
  I:mass = 2 kg
  MSe:push = lift
  p -> 1:v -> mass
  push -> v
}
model A {
  input wind = 0.5 N
  port tip
  port side
  sampled at 1 kHz { Body:b }
  tip ||> b.p
  I:car = 3 kg
  MSe:blow = wind
  blow -> 1:w -> car, side
  probe f = b.mass.f
  probe g = car.f
  probe given = wind
  simulate { stop = 1 s }
}",
            2.5e-4,
        ),
        (
            "a source that is no number after 70 intervals, where the run ends",
            "model A { Se:u = 1 N * sqrt(0.705 - t / (1 s))  I:m = 1 kg  C:s { e = q^3 * (1 N/m^3) }  1:v -> m, s  u -> v
  probe f = m.f
  simulate { stop = 1 s }
}",
            1e-2,
        ),
        (
            "two regions that hold for one body at once, and a third at another rate",
            "model A {
  sampled every 300 ms { C:k1 { stiffness = 50 N/m; q0 = 0.1 m }; R:b1 = 0.5 N*s/m; 1:s1 -> k1, b1; I:n = 0.4 kg }
  sampled every 600 ms { C:k2 { stiffness = 50 N/m; q0 = 0.1 m } }
  I:mass = 1 kg; C:d { stiffness = 20 N/m; q0 = 0.2 m }; 1:v -> mass
  v ||> s1; v ||> k2; v -> 0:f -> d; f ||> n
  probe x = mass.f
  simulate { stop = 30 s }
}",
            0.3,
        ),
        (
            "sources of time that are held from sample to sample, of two rates, and whole numbers",
            "model A {
  sampled every 40 ms { Se:slow = (2 V/s)*t R:r1 = 1 Ohm slow -> r1 }
  sampled every 10 ms { Se:fast = slow.e*mod(floor(t/(30 ms)), 2) R:r2 = 1 Ohm fast -> r2 }
  I:m = 1 H; R:r3 = 2 Ohm; Se:u = slow.e + fast.e; u -> 1:v -> m, r3
  probe a = slow.e
  probe b = fast.e
  probe c = round(100*m.f/(1 A))
  probe d = integral(slow.e*t, 0 V*s^2)
  simulate { stop = 1 s }
}",
            1e-2,
        ),
        (
            "no probe and no port",
            "model A { C:s { stiffness = 1 N/m; q0 = 1 m } I:m = 1 kg 1:v -> s, m simulate { stop = 1 s } }",
            1e-2,
        ),
    ];
    for (name, text, h) in cases {
        let compiled = with(Options::new().model("A"), &format!("{WALL}{text}"));
        same(name, &compiled, h).unwrap_or_else(|e| panic!("{name}: {e}"));
    }
}

/// What moves is summed from sample to sample, also where intervals end between them.
#[test]
fn periods_of_several_intervals_give_the_same_bits() {
    if !is_there() {
        return;
    }
    let text = "model A {
  Se:pull = 2 N
  I:m1 = 1 kg
  I:m2 { inertia = 2 kg; f0 = 0.3 m/s }
  R:d1 = 1.5 N*s/m
  C:link = 2 mm/N
  sampled every 4 ms hold lagged { C:c1 { e = 300 N/m * q + 5e4 N/m^3 * q^3 } R:b1 = 3 N*s/m 1:s1 -> c1, b1 }
  sampled every 6 ms { C:c2 { e = 100 N/m * q + 5e4 N/m^3 * q^3 } R:b2 = 3 N*s/m 1:s2 -> c2, b2 }
  pull -> 1:v1 -> m1, d1
  1:v2 -> m2
  v1 -> 0:n -> v2
  n -> link
  v1 ||> s1
  v2 ||> s2
  probe q = link.q
  probe e1 = c1.e
  probe e2 = c2.e
  simulate { stop = 0.6 s; step = 2 ms; method = gonzalez }
}";
    let compiled = with(Options::new(), text);
    let (u, options) = emit(&compiled, 2e-3).unwrap_or_else(|e| panic!("{e}"));
    let (rows, wanted) = (emitted(&compiled, &u).c, simulated(&compiled, &u, &options).0);
    assert!(rows.len() == wanted.len() && rows.len() > 100, "{} rows", rows.len());
    for (k, (row, wanted)) in rows.iter().zip(&wanted).enumerate() {
        assert_eq!(row[..3], wanted[..3], "row {k}");
    }
}

/// The matrix of a large linear region is kept between intervals, and made anew where a state is restored.
#[test]
fn large_linear_regions_keep_their_matrices() {
    if !is_there() {
        return;
    }
    for method in ["gonzalez", "collocation6"] {
        let compiled = large("tree", 300, method);
        let (u, _) = emit(&compiled, 1e-3).unwrap_or_else(|e| panic!("{method}: {e}"));
        assert!(u.observe_scratch > 0, "{method} keeps its factors");
        same(method, &compiled, 1e-3).unwrap_or_else(|e| panic!("{method}: {e}"));
    }
}

/// Lines of cells that meet in a node, driven there: their matrices are lines from as many ends.
fn arms(arms: usize, cells: usize) -> String {
    format!(
        "model A(m = {arms}, n = {cells}) {{
  Se:u = 1 V * sin(t * 40 rad/s)
  R:r = 2 Ohm
  C:hub = 1 mF
  0:centre -> hub
  1:feed -> r
  u -> feed
  feed -> centre
  for i in 1..m {{
    R:load[i] = 1 Ohm * i
    for k in 1..n {{
      I:l[i,k] = 10 mH * (1 + 0.1*sin(k))
      C:c[i,k] = 10 mF
      1:s[i,k] -> l[i,k]
      s[i,k] -> 0:p[i,k] -> c[i,k]
    }}
    centre -> s[i,1]
    for k in 2..n {{ p[i,k-1] -> s[i,k] }}
    p[i,n] -> load[i]
  }}
  probe last = c[1,n].q
  probe q = hub.q
  simulate {{ stop = 1 s }}
}}"
    )
}

#[test]
fn large_linear_regions_give_the_same_numbers() {
    if !is_there() {
        return;
    }
    for (m, n, method) in
        [(1, 60, "gonzalez"), (1, 60, "collocation6"), (3, 40, "gonzalez"), (3, 40, "collocation4"), (4, 30, "radau")]
    {
        let name = format!("{m} arms of {n} cells by {method}");
        let compiled = with(Options::new().method(method), &arms(m, n));
        same(&name, &compiled, 2e-3).unwrap_or_else(|e| panic!("{name}: {e}"));
    }
}

/// Iterations of many unknowns: eliminated densely, sparsely, and with complex numbers.
#[test]
fn iterations_of_many_unknowns_give_the_same_bits() {
    if !is_there() {
        return;
    }
    for (kind, n, method) in
        [("line", 6, "gonzalez"), ("line", 40, "gonzalez"), ("line", 12, "collocation4"), ("line", 30, "radau")]
    {
        let name = format!("{n} cells of a {kind} by {method}");
        let compiled = large(kind, n, method);
        let (u, steps) = emit(&compiled, 1e-3).unwrap_or_else(|e| panic!("{name}: {e}"));
        let Emitted { c: rows, object, module } = emitted(&compiled, &u);
        assert_eq!(rows.len(), ROWS as usize + 1, "{name}");
        assert_eq!(rows, object, "{name}");
        let close = |ours: &Rows, theirs: &Rows, what: &str| {
            for (a, b) in ours.iter().flatten().zip(theirs.iter().flatten()) {
                assert!((a - b).abs() <= 1e-9 * b.abs() + 1e-12, "{name}: {a:e} {what}, {b:e}");
            }
        };
        close(&rows, &simulated(&compiled, &u, &steps).0, "in C");
        module.iter().for_each(|(module, _)| close(module, &rows, "in the module"));
    }
}

/// Many states change places in C, and are copied in objects and modules; an interval that fails leaves them where they
/// were.
#[test]
fn many_states_go_from_interval_to_interval() {
    if !is_there() {
        return;
    }
    let line = "model Line(n = 60) {
  Se:u = 1 V * sin(t * 40 rad/s)
  R:load = 1 Ohm
  for k in 1..n {
    I:l[k] = 10 mH
    C:c[k] = 10 mF
    1:s[k] -> l[k]
    s[k] -> 0:p[k] -> c[k]
  }
  u -> s[1]
  for k in 2..n { p[k-1] -> s[k] }
  p[n] -> load
  probe first = l[1].p
  probe last = c[n].q
  simulate { stop = 1 s }
}";
    for (text, method, h) in [
        (line, "gonzalez", 1e-3),
        (line, "rk4", 2e-3),
        (line, "euler", 20.0),
        (&arms(2, 50), "gonzalez", 1e-3),
        (&arms(2, 50), "euler", 20.0),
    ] {
        let compiled = with(Options::new().method(method), text);
        let (u, options) = emit(&compiled, h).unwrap_or_else(|e| panic!("{method}: {e}"));
        assert!(u.late.iter().any(|l| l.state.len() >= 120), "{method}: {:?}", u.late);
        let name = format!("{method} by {h} s");
        same(&name, &compiled, h).unwrap_or_else(|e| panic!("{name}: {e}"));
        assert_eq!(simulated(&compiled, &u, &options).0.len() <= ROWS as usize, method == "euler", "{name}");
    }
}

/// Lines of so many unknowns that all forms of their ends and of where these meet are there.
#[test]
fn lines_of_any_length() {
    if !is_there() {
        return;
    }
    for n in 68..76 {
        let (cells, odd) = (n / 2, n % 2 == 1);
        let last = if odd { "I:end = 20 mH\n  p[n] -> 1:v -> end, load" } else { "p[n] -> load" };
        let text = format!(
            "model Line(n = {cells}) {{
  Se:u = 1 V
  R:load = 1 Ohm
  for k in 1..n {{
    I:l[k] = 10 mH * k
    C:c[k] = 10 mF / k
    1:s[k] -> l[k]
    s[k] -> 0:p[k] -> c[k]
  }}
  u -> s[1]
  for k in 2..n {{ p[k-1] -> s[k] }}
  {last}
  probe first = l[1].p
  probe last = c[n].q
  simulate {{ stop = 1 s }}
}}"
        );
        let compiled = with(Options::new().method("gonzalez"), &text);
        let (u, steps) = emit(&compiled, 1e-2).unwrap_or_else(|e| panic!("{n}: {e}"));
        let Emitted { c: rows, object, module } = emitted(&compiled, &u);
        assert!(rows.len() > 1, "{n} unknowns");
        assert_eq!(rows, simulated(&compiled, &u, &steps).0, "{n} unknowns");
        assert_eq!(rows, object, "{n} unknowns");
        module.into_iter().for_each(|(module, _)| assert_eq!(rows, module, "{n} unknowns"));
    }
}

/// Signals that are delayed in continuous time, with jumps and bends that arrive between steps, with several delays
/// that cut the steps of one another, beside a computer, with a law that switches, and over lines: each form gives the
/// bits of a run, and where its state is put back it goes on as it did.
#[test]
fn delays_in_continuous_time_give_the_same_bits() {
    if !is_there() {
        return;
    }
    let cable = |delay: f64| {
        format!(
            "model Cable {{
               Se:u = 2 V / (1 + ((t - 1 s)/(0.2 s))^2)
               R:r = 4 Ohm
               TL(a, b):line {{ impedance = 4 Ohm; delay = {delay} s }}
               C:end = 0.05 F
               I:beside {{ inertia = 1 H; f0 = 0.1 A }}
               u -> 1:in -> r, line.a
               line.b -> 0:out -> end, beside
               probe near = line.a.e
               probe far = line.b.e
               simulate {{ stop = 10 s }}
             }}"
        )
    };
    let (short, long) = (cable(0.13), cable(1.0));
    let models: [(&str, &str, f64); 8] = [
        ("steps", "state x = 1 { dx = -delay(x, 1 s, 1)*1 Hz } probe y = x probe was = delay(x, 1 s, 1)", 0.25),
        ("steps between", "state x = 1 { dx = -delay(x, 1 s, 1)*1 Hz } probe y = x", 0.3),
        ("steps beyond", "state x = 1 { dx = -delay(x, 0.1 s, 1)*1 Hz } probe y = x", 0.35),
        (
            "jumps",
            "input u = 0
             state a = 0 s { da = delay(u, 0.25 s) }
             sampled every 0.1 s { state n = 0 { next = n + 1 } state late = 0 s { next = was } }
             state b = 0 s { db = delay(n, 0.33 s) }
             let was = delay(a, 0.42 s)
             probe x = a probe y = b probe z = late probe w = was",
            0.03,
        ),
        (
            "several",
            "Se:push = 1 N * delay(mass.f*1 s/1 m, 0.37 s, 1) + 1 N*delay(t/1 s, 0.71 s)
             R:rub = 0.5 N*s/m
             I:mass = 1 kg
             push -> 1:v -> mass, rub
             sampled every 0.05 s { state z = 0 N*s { next = delay(mass.p, 0.2 s) - delay(z, 0.35 s)/2 } }
             probe p = mass.p probe zz = z",
            0.02,
        ),
        (
            "a switch",
            "state x = 0 { dx = (if delay(x, 0.5 s) < 0.2 then 1 else -1)*1 Hz }
             state y = 0 s { dy = delay(if x < 0.3 then 1 else 0, 0.33 s) }
             probe xx = x probe yy = y",
            0.07,
        ),
        ("a short cable", short.as_str(), 0.02),
        ("a long cable", long.as_str(), 0.05),
    ];
    for (name, body, h) in models {
        for method in ["gonzalez", "collocation4", "collocation6"] {
            let text = match body.starts_with("model") {
                true => body.to_string(),
                false => format!("model M {{\n{body}\nsimulate {{ stop = 10 s }}\n}}"),
            };
            let compiled = with(Options::new().method(method), &text);
            let (u, steps) = emit(&compiled, h).unwrap_or_else(|e| panic!("{name}: {e}"));
            let Emitted { c: rows, object, module } = emitted(&compiled, &u);
            assert!(rows.len() as u32 > ROWS / 2, "{name} by {method}: {} rows", rows.len());
            assert_eq!(rows, object, "{name} by {method}");
            assert_eq!(rows, simulated(&compiled, &u, &steps).0, "{name} by {method}");
            if let Some((module, _)) = module {
                assert_eq!(rows, module, "{name} by {method}: the module");
            }
        }
    }
}

#[test]
fn random_parameters_and_starts() {
    if !is_there() {
        return;
    }
    let mut seed = 12345u64;
    let mut any = |low: f64, high: f64| {
        seed = seed.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        low * (high / low).powf((seed >> 11) as f64 / (1u64 << 53) as f64)
    };
    for round in 0..6 {
        let hold = ["matched", "lagged", "predicted", "matched"][round % 4];
        let budget = if round % 3 == 2 { " budget off" } else { "" };
        let method = if round == 3 { " method ray" } else { "" };
        let text = format!(
            "model A {{
  input push = {} N
  port tip {{ inertia = {} kg }}
  MSe:hand = push
  I:mass {{ inertia = {} kg; f0 = {} m/s }}
  sampled at 500 Hz hold {hold}{budget}{method} {{ Wall:wall(k = {} N/m, b = {} N*s/m, gap = {} m) }}
  sampled at 1 kHz {{ Wall:other(k = {} N/m, gap = {} m) }}
  hand -> 1:v -> mass
  v ||> wall.tip
  tip ||> other.tip
  probe depth = wall.spring.q
  probe force = wall.tip.e
  probe x = integral(v.f, 0 m)
  probe y = other.spring.q
  simulate {{ stop = 1 s }}
}}",
            any(1.0, 20.0),
            any(0.05, 2.0),
            any(0.05, 5.0),
            any(0.01, 3.0),
            any(100.0, 1e5),
            any(0.1, 100.0),
            any(1e-5, 1e-2),
            any(100.0, 1e4),
            any(1e-5, 1e-4),
        );
        let compiled = with(Options::new().model("A"), &format!("{WALL}{text}"));
        let h = [1e-3, 2.5e-4, 1e-4][round % 3];
        same(&format!("round {round}: {text}"), &compiled, h).unwrap_or_else(|e| panic!("{text}: {e}"));
    }
}

/// A signal that no sampled state can follow is refused by the commit that would take it, which leaves the scene as it
/// was: with a better one it goes on.
#[test]
fn what_spoils_the_next_sample_is_refused_before() {
    if !is_there() {
        return;
    }
    let main = "#include \"m.h\"\n#include <math.h>\n#include <stdio.h>\n#include <string.h>\n\
                static bond_state b;\nstatic bond_real x[2][BOND_SAVED];\n\
                static void commit(double u) {\n    int failed, same;\n    bond_input(&b, 0, (bond_real)u);\n    \
                bond_save(&b, x[0]);\n    failed = bond_commit(&b, 0);\n    bond_save(&b, x[1]);\n    \
                same = !memcmp(x[0], x[1], sizeof x[0]);\n    printf(\"%d %d\\n\", failed, same);\n}\n\
                int main(void) {\n    int k;\n    bond_init(&b);\n    for (k = 0; k < 10; ++k) commit(2);\n    \
                commit(NAN);\n    commit(BAD);\n    commit(-INFINITY);\n    \
                for (k = 0; k < 10; ++k) commit(3);\n    return 0;\n}\n";
    // As it is, through a root, beside ports, and at every other interval.
    let states = |next: &str, more: &str| {
        format!(
            "model N {{ input u = 0 V  Se:s = z  R:r = 1 Ohm  I:l = 1 H  s -> 1:m -> r, l {more} \
             sampled every 10 ms {{ state z = 0 V {{ next = {next} }} }} probe i = l.f simulate {{ stop = 1 s }} }}"
        )
    };
    let sampled = "model N { input u = 1 V Se:s = u I:l = 1 H sampled every 10 ms { R:r = 1 Ohm Se:b = u 1:w -> r, b } \
                   s -> 1:m -> l  m ||> w probe i = l.f simulate { stop = 1 s } }";
    let slow = "sampled every 5 ms { state y = 0 V { next = z } }";
    for (text, bad, every) in [
        (states("u", ""), "NAN", 1),
        (states("sqrt(u/(1 V)) * 1 V", ""), "-1", 1),
        (states("u", slow), "NAN", 2),
        (sampled.to_string(), "NAN", 1),
    ] {
        let compiled = with(Options::new().model("N"), &text);
        let (u, _) = emit(&compiled, 1e-3).unwrap_or_else(|e| panic!("{text}: {e}"));
        let here = built(&u, &main.replace("BAD", bad));
        let rows = here.rows("run");
        assert!(rows[..10].iter().chain(&rows[14..]).all(|r| r[0] == 0.0), "{text}: {rows:?}");
        let refused = rows[10..13].iter().filter(|r| r[..] == [3.0, 1.0]).count();
        assert!(refused + 1 >= 4 - every, "{text}: {rows:?}");
    }
}

/// Ports of a continuous region: what is given and what is answered run along the half arrow, whichever way it points.
#[test]
fn the_mean_of_an_answer_is_that_over_the_interval() {
    if !is_there() {
        return;
    }
    let main = "#include \"m.h\"\n#include <stdio.h>\nint main(void) {\n    static bond_state b;\n    bond_real give = 4, out = 0;\n    int k;\n    \
                bond_init(&b);\n    for (k = 0; k < 10; ++k) {\n        if (bond_commit(&b, &give)) return 1;\n        bond_output(&b, &out);\n        \
                printf(\"%.17g %.17g\\n\", out, bond_energy(&b));\n    }\n    return 0;\n}\n";
    for (chain, into) in [("p -> 1:v -> mass", 1.0), ("1:v -> mass, p", -1.0)] {
        // A sampled region elsewhere makes intervals of 1 ms, and four steps in each.
        let text = format!(
            "model A {{ port p I:mass = 2 kg {chain} sampled at 1 kHz {{ C:s {{ stiffness = 1 N/m; q0 = 1 m }} I:m = 1 kg 1:w -> s, m }} \
             probe f = mass.f expect passive simulate {{ stop = 1 s }} }}"
        );
        let compiled = with(Options::new().model("A"), &text);
        let (u, _) = emit(&compiled, 2.5e-4).unwrap_or_else(|e| panic!("{e}"));
        let here = built(&u, main);
        for (k, row) in here.rows("run").iter().enumerate() {
            // 4 N on 2 kg for k ms: the mean speed of an interval is that in its middle.
            let wanted = into * 2.0 * (k as f64 + 0.5) * 1e-3;
            assert!((row[0] - wanted).abs() < 1e-12, "{chain}, interval {k}: {} where {wanted} is due", row[0]);
        }
    }
}

/// The sign of a flow that is held: into the scene, as the half arrow of `tip ||> b.p` says, and efforts as they are.
#[test]
fn a_held_flow_runs_into_the_scene() {
    for (chain, port) in [("p -> 1:v -> mass", "tip ||> b.p"), ("1:v -> mass, p", "b.p ||> tip")] {
        let text = format!(
            "model Body {{ port p I:mass {{ inertia = 2 kg; f0 = 3 m/s }} {chain} }}
             model A {{ port tip sampled at 1 kHz {{ Body:b }} {port} probe f = b.mass.f simulate {{ stop = 1 s }} }}"
        );
        let compiled = with(Options::new().model("A"), &text);
        let into = if chain.starts_with('p') { 1.0 } else { -1.0 };
        let mut sim = compiled.simulate(Steps::fixed(1e-3)).unwrap_or_else(|e| panic!("{e}"));
        let first = sim.held()[0].1;
        assert!((first - into * 3.0).abs() < 0.1, "{chain}: {first}");
        // An effort of 500 N that pushes into the scene for 1 ms.
        sim.report("tip", into * 0.5).and_then(|()| sim.advance(1e-3)).unwrap_or_else(|e| panic!("{e}"));
        let f = sim.probe("f").unwrap_or(f64::NAN);
        assert!((f - 3.25).abs() < 1e-9, "{chain}: {f}");
    }
}

/// Of 1 N and 1 m, single numbers keep three digits over thousands of intervals, and two where friction brings to rest.
#[test]
fn single_numbers_are_close() {
    if !is_there() {
        return;
    }
    let main = "#include \"m.h\"\n#include <stdio.h>\nint main(void) {\n    static bond_state b;\n    bond_real out[BOND_PROBES];\n    int k, j;\n    \
                bond_init(&b);\n    for (k = 0; k < 250; ++k) {\n        if (bond_commit(&b, 0) || bond_probes(&b, out)) return 1;\n        \
                for (j = 0; j < BOND_PROBES; ++j) printf(\"%.9g \", (double)out[j]);\n        printf(\"%.9g\\n\", (double)bond_ledger(&b, BOND_REGIONS - 1, BOND_LEDGER_WORST));\n    }\n    return 0;\n}\n";
    // A law that is a curve has places without a slope: what bounds an iteration there bounds single numbers, too.
    let friction = "model Brake {
  I:m { inertia = 1 kg; f0 = 0.8 m/s }
  1:v -> m
  sampled every 5 ms {
    R:r { e = (3.5 N)*min(max(s,-1),1); f = (s-min(max(s,-1),1))*(1 m/s) }
    1:d -> r
  }
  v ||> d
  probe x = integral(v.f, 0 m)
  simulate { stop = 1 s }
}";
    let wall = file(&models().join("examples/virtual_wall.bond"), Options::new().model("VirtualWall"));
    for (compiled, h, least, kept) in [(wall, 0.04, 1e-9, 1e-3), (with(Options::new(), friction), 1e-3, 0.0, 0.02)] {
        let (u, _) = emit(&compiled, h).unwrap_or_else(|e| panic!("{e}"));
        let here = built(&u, main);
        here.cc(&["-DBOND_FLOAT", "m.c", "main.c", "-lm", "-o", "short"]);
        let (long, short) = (here.rows("run"), here.rows("short"));
        assert_eq!((long.len(), short.len()), (250, 250));
        let probes = compiled.probes().len();
        for j in 0..probes {
            let scale = long.iter().map(|r| r[j].abs()).fold(0.0, f64::max);
            let off = long.iter().zip(&short).map(|(a, b)| (a[j] - b[j]).abs()).fold(0.0, f64::max);
            assert!(off < kept * scale, "{}: off by {off:e} of {scale:e}", compiled.probes()[j]);
            assert!(off > 0.0 || scale == 0.0, "{}: single numbers are shorter", compiled.probes()[j]);
        }
        let worst = short.last().map_or(f64::NAN, |r| r[probes]);
        assert!(worst >= least && worst < 1e-5, "the balance is kept to the rounding of single numbers: {worst:e}");
    }
}

/// Two scenes, one as C and one as an object, in one program.
#[test]
fn scenes_of_different_prefixes_live_together() {
    if !is_there() {
        return;
    }
    let scene = |name: &str, model: &str, h: f64| {
        let compiled = file(&models().join(name), Options::new().model(model));
        emit(&compiled, h).map_or_else(|e| panic!("{e}"), |e| e.0)
    };
    let (wall, pendulum) =
        (scene("examples/virtual_wall.bond", "Ray", 0.04), scene("examples/pendulum.bond", "Pendulum", 0.01));
    let here = Folder::new();
    let (one, other) = (options("wall", "wall.h"), options("Bond", "arm.h"));
    here.put("wall.h", c::header(&wall, &one));
    here.put("wall.c", c::source(&wall, &one));
    here.put("arm.h", c::header(&pendulum, &other));
    here.put("arm.c", c::source(&pendulum, &other));
    let object = native::object(&pendulum, "Bond").unwrap_or_else(|e| panic!("{e}"));
    here.put("arm.o", object);
    here.put(
        "main.c",
        "#include \"wall.h\"\n#include \"arm.h\"\n#include <stdio.h>\nint main(void) {\n    static wall_state w;\n    static Bond_state p;\n    int k;\n    \
         wall_init(&w);\n    Bond_init(&p);\n    for (k = 0; k < 100; ++k) {\n        if (wall_commit(&w, 0) || Bond_commit(&p, 0)) return 1;\n        \
         printf(\"%.17g %.17g\\n\", wall_energy(&w), Bond_energy(&p));\n    }\n    return WALL_DONE + BOND_DONE;\n}\n",
    );
    here.cc(&["wall.c", "arm.c", "main.c", "-lm", "-o", "both"]);
    here.cc(&["wall.c", "arm.o", "main.c", "-lm", "-o", "mixed"]);
    let rows = here.rows("both");
    assert_eq!(rows, here.rows("mixed"));
    assert!(rows.len() == 100 && rows[99][1] > 0.0, "{:?}", rows.last());
}

#[test]
fn names_are_told_apart() {
    let text = "model A { C:a_b { stiffness = 1 N/m; q0 = 1 m } I:m = 1 kg 1:v -> a_b, m probe a_1 = m.f probe a = a_b.q \
                probe A = a_b.q probe a_2 = m.f simulate { stop = 1 s } }";
    let compiled = with(Options::new().model("A"), text);
    let (u, _) = emit(&compiled, 1e-2).unwrap_or_else(|e| panic!("{e}"));
    let header = c::header(&u, &options("bond", "m.h"));
    let mut names: Vec<&str> =
        header.lines().filter_map(|l| l.strip_prefix("#define ")).filter_map(|l| l.split(' ').next()).collect();
    let all = names.len();
    names.sort_unstable();
    names.dedup();
    assert!(names.len() == all && all > 20, "{header}");
}

/// Families of resistors are booked in a loop: twice as many make the routines no longer, but for tables of numbers.
#[test]
fn lossy_ladders_grow_in_tables_alone() {
    let statements = |n: usize| {
        let text = format!(
            "model Lossy {{ Se:u = 1 V  u -> 1:i[1]  for k in 1..{n} {{ I:l[k] = 1 mH  R:r[k] = 0.1 Ohm  i[k] -> l[k], r[k] }} \
             for k in 1..{n} {{ 0:o[k] C:c[k] {{ stiffness = 1e3 V/C }} i[k] -> o[k] -> c[k] }} \
             for k in 2..{n} {{ 1:i[k] o[k-1] -> i[k] }} \
             probe v = o[{n}].e simulate {{ stop = 1 s; step = 1 ms; method = gonzalez }} }}"
        );
        let compiled = with(Options::new().model("Lossy"), &text);
        let (u, _) = emit(&compiled, 1e-3).unwrap_or_else(|e| panic!("{n}: {e}"));
        c::source(&u, &options("bond", "m.h")).lines().filter(|l| l.trim_end().ends_with(';')).count()
    };
    let (some, many) = (statements(200), statements(400));
    assert!(many <= some + some / 20, "{some} statements of 200 cells, {many} of 400");
}

/// Each function means the same in C, in an object and in a module, for numbers at the ends of what there is, too.
#[test]
fn functions_mean_the_same_in_each_form() {
    use bond_runtime::eval;
    use bond_runtime::ir::{Binary, Unary};
    if !is_there() {
        return;
    }
    let one = [
        "sqrt", "exp", "log", "sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh", "abs", "sign",
        "floor",
    ];
    let two = ["min", "max", "atan2"];
    let mut text = "model F {\n  input x = 1\n  input y = 1\n  C:c = 1 F\n  R:r = 1 Ohm\n  c -> r\n".to_string();
    for name in one {
        text += &format!("  probe of_{name} = {name}(x)\n");
    }
    for name in two {
        text += &format!("  probe of_{name} = {name}(x, y)\n");
    }
    text += "  probe of_pow = x^y\n  probe less = if x < y then 1 else 0\n  probe ratio = x/y\n  simulate { stop = 1 s }\n}";
    let compiled = with(Options::new(), &text);
    let (u, _) = emit(&compiled, 1e-3).unwrap_or_else(|e| panic!("{e}"));
    let numbers =
        [0.0, -0.0, 1.0, -1.0, 0.5, -2.0, 3.0, 1e-300, -1e300, 700.0, f64::INFINITY, f64::NEG_INFINITY, f64::NAN];
    let list: Vec<String> = numbers.iter().map(|x| format!("{}", x.to_bits())).collect();
    let (here, names) = (Folder::new(), options("bond", "m.h"));
    here.put("m.h", c::header(&u, &names));
    here.put("m.c", c::source(&u, &names));
    let main = format!(
        "#include \"m.h\"\n#include <stdio.h>\n#include <string.h>\nint main(void) {{\n    static bond_state b;\n    \
         static const unsigned long long list[] = {{ {} }};\n    bond_real x, y, out[BOND_PROBES];\n    int i, j, k;\n    bond_init(&b);\n    \
         for (i = 0; i < {n}; ++i) for (j = 0; j < {n}; ++j) {{\n        memcpy(&x, list + i, 8);\n        memcpy(&y, list + j, 8);\n        \
         bond_input(&b, 0, x);\n        bond_input(&b, 1, y);\n        (void)bond_probes(&b, out);\n        \
         for (k = 0; k < BOND_PROBES; ++k) printf(\"%.17g \", out[k]);\n        puts(\"\");\n    }}\n    return 0;\n}}\n",
        list.iter().map(|x| format!("{x}ull")).collect::<Vec<_>>().join(", "),
        n = numbers.len(),
    );
    here.put(
        "main.c",
        main.replace("static const unsigned long long", "static const uint64_t")
            .replace("#include <stdio.h>", "#include <stdint.h>\n#include <stdio.h>"),
    );
    here.cc(&["m.c", "main.c", "-lm", "-o", "run"]);
    here.put("m.o", native::object(&u, "bond").unwrap_or_else(|e| panic!("{e}")));
    here.cc(&["m.o", "main.c", "-lm", "-o", "object"]);
    let mut all = vec![("C", here.rows("run")), ("object", here.rows("object"))];
    if has("node") {
        here.put("m.wasm", wasm::module(compiled.scene(), &u).unwrap_or_else(|e| panic!("{e}")));
        let script = format!(
            "import {{ readFileSync }} from \"node:fs\";\n\
             const {{ instance: {{ exports: e }} }} = await WebAssembly.instantiate(readFileSync(\"m.wasm\"), {{ Math }});\n\
             const list = new Float64Array(new BigUint64Array([{}]).buffer);\n\
             const out = new Float64Array(e.memory.buffer, e.probed.value, {});\n\
             for (const x of list) for (const y of list) {{\n  e.input(0, x);\n  e.input(1, y);\n  e.probes();\n  \
             console.log([...out].map((z) => (Object.is(z, -0) ? \"-0\" : z)).join(\" \"));\n}}\n",
            list.iter().map(|x| format!("{x}n")).collect::<Vec<_>>().join(", "),
            compiled.probes().len(),
        );
        here.put("main.mjs", script);
        all.push(("module", Folder::printed("module", Command::new("node").arg("main.mjs").current_dir(&here.0))));
    }
    let unary = |name: &str| Unary::ALL.into_iter().find(|f| f.name() == name).unwrap_or_else(|| panic!("{name}"));
    for (form, rows) in all {
        let mut rows = rows.into_iter();
        for (x, y) in numbers.iter().flat_map(|x| numbers.iter().map(move |y| (*x, *y))) {
            let mut wanted: Vec<(String, f64)> = one.iter().map(|f| ((*f).into(), eval::unary(unary(f), x))).collect();
            for (f, name) in
                [(Binary::Min, "min"), (Binary::Max, "max"), (Binary::Atan2, "atan2"), (Binary::Pow, "pow")]
            {
                wanted.push((name.into(), eval::binary(f, x, y)));
            }
            wanted.push(("less".into(), f64::from(u8::from(x < y))));
            wanted.push(("ratio".into(), x / y));
            let row = rows.next().unwrap_or_default();
            assert_eq!(row.len(), wanted.len(), "{form}");
            for ((name, wanted), found) in wanted.iter().zip(row) {
                let zero = found == 0.0 && found.is_sign_negative() != wanted.is_sign_negative();
                let close = (found - wanted).abs() <= 4e-16 * wanted.abs() && !zero;
                let same = close || found.to_bits() == wanted.to_bits() || (found.is_nan() && wanted.is_nan());
                // Of what is infinite below, `bond` has no broken power, and libm an infinite one.
                let apart = name == "pow" && x == f64::NEG_INFINITY;
                assert!(same || apart, "{form}: {name} of {x:?}, {y:?} is {found:?}, and not {wanted:?}");
            }
        }
    }
}

/// A movement that is no number, or beyond all numbers once it is counted, is refused when it is told, also at a port
/// whose region takes no sample yet: it would be in a sum that nothing takes it out of again.
#[test]
fn what_no_device_moves_is_refused() {
    if !is_there() {
        return;
    }
    let main = "#include \"m.h\"\n#include <math.h>\n#include <stdio.h>\n#include <string.h>\n\
                static bond_state b;\nstatic bond_real x[2][BOND_SAVED], moved[BOND_PORTS];\n\
                static void commit(double far) {\n    int failed, same;\n    moved[1] = (bond_real)far;\n    \
                bond_save(&b, x[0]);\n    failed = bond_commit(&b, moved);\n    bond_save(&b, x[1]);\n    \
                same = !memcmp(x[0], x[1], sizeof x[0]);\n    printf(\"%d %d\\n\", failed, same);\n}\n\
                int main(void) {\n    int k;\n    bond_init(&b);\n    for (k = 0; k < 12; ++k) commit(1e-3);\n    \
                commit(NAN);\n    commit(1e308);\n    commit(-INFINITY);\n    \
                for (k = 0; k < 12; ++k) commit(-1e-3);\n    return 0;\n}\n";
    let compiled = with(
        Options::new(),
        "model N {
           port fast { inertia = 0.1 kg }
           port slow { inertia = 0.2 kg }
           sampled every 4 ms { C:a { stiffness = 100 N/m; q0 = 0.01 m } 1:x -> a }
           sampled every 10 ms { C:c { stiffness = 100 N/m } 1:y -> c }
           fast ||> x
           slow ||> y
           probe q = c.q
         }",
    );
    let (u, _) = emit(&compiled, 1e-3).unwrap_or_else(|e| panic!("{e}"));
    let here = built(&u, main);
    let rows = here.rows("run");
    assert_eq!(rows[12..15], [[3.0, 1.0], [3.0, 1.0], [3.0, 1.0]], "{rows:?}");
    assert!(rows[..12].iter().chain(&rows[15..]).all(|r| r[0] == 0.0), "{rows:?}");
}

/// Every number of such a step is finite, and so is not what is wrong with it.
#[test]
fn a_gross_balance_has_a_reason_of_its_own() {
    if !is_there() {
        return;
    }
    let text = "model M { I:m = 1 kg  C:s { stiffness = 1e300 N/m; q0 = 1 m }  1:v -> m, s  probe x = s.q }";
    let compiled = with(Options::new(), text);
    let (u, _) = emit(&compiled, 0.01).unwrap_or_else(|e| panic!("{e}"));
    let main = "#include \"m.h\"\n#include <stdio.h>\n#include <string.h>\nstatic bond_state b;\n\
                static bond_real x[2][BOND_SAVED];\nint main(void) {\n    int failed;\n    bond_init(&b);\n    \
                bond_save(&b, x[0]);\n    failed = bond_commit(&b, 0);\n    bond_save(&b, x[1]);\n    \
                printf(\"%d %d\\n\", failed == BOND_GROSS_BALANCE, !memcmp(x[0], x[1], sizeof x[0]));\n    \
                return 0;\n}\n";
    let here = built(&u, main);
    assert_eq!(here.rows("run"), [[1.0, 1.0]]);
    here.put("m.o", native::object(&u, "bond").unwrap_or_else(|e| panic!("{e}")));
    here.cc(&["m.o", "main.c", "-lm", "-o", "object"]);
    assert_eq!(here.rows("object"), [[1.0, 1.0]]);
    if has("node") {
        here.put("m.wasm", wasm::module(compiled.scene(), &u).unwrap_or_else(|e| panic!("{e}")));
        here.put(
            "main.mjs",
            "import { readFileSync } from \"node:fs\";\n\
             const { instance: { exports: e } } = await WebAssembly.instantiate(readFileSync(\"m.wasm\"), { Math });\n\
             const state = new Float64Array(e.memory.buffer, e.state.value, e.saved.value), before = state.slice();\n\
             const failed = e.commit();\n\
             console.log(failed, Number(state.every((x, k) => Object.is(x, before[k]))));\n",
        );
        let rows = Folder::printed("module", Command::new("node").arg("main.mjs").current_dir(&here.0));
        assert_eq!(rows, [[Reason::GrossBalance.code() as f64, 1.0]]);
    }
}

#[test]
fn the_guide_lists_every_reason() {
    let guide = std::fs::read_to_string("../docs/reference/embedding.md").expect("the guide can be read");
    let missing: Vec<&str> =
        Reason::ALL.iter().map(|r| r.0).filter(|r| !guide.contains(&format!("`BOND_{r}`"))).collect();
    assert!(missing.is_empty(), "docs/reference/embedding.md does not list {missing:?}");
}

/// Where a wave begins to arrive, energies are subnormal, and most of their digits rounding: that is no worst balance.
#[test]
fn the_worst_balance_is_of_energies_that_are_some() {
    if !is_there() {
        return;
    }
    let text = "
      model Chain(n = 200) {
        Se:drive = 1 N
        for i in 1..n { 1:v[i]  I:m[i] = 0.01 kg  v[i] -> m[i] }
        drive -> v[1]
        for i in 2..n {
          0:z[i]
          C:k[i] { e = 4000 N/m * q + 1e9 N/m^3 * q^3 }
          v[i-1] -> z[i] -> v[i]
          z[i] -> k[i]
        }
        R:end = 5 N*s/m
        v[n] -> end
        sampled at 500 Hz { C:s { stiffness = 300 N/m }  R:r = 2 N*s/m  1:h -> s, r }
        v[100] ||> h
        probe e = s.e
        simulate { stop = 0.2 s; step = 0.2 ms }
      }";
    let compiled = with(Options::new(), text);
    let (u, _) = emit(&compiled, 2e-4).unwrap_or_else(|e| panic!("{e}"));
    let main = r#"
#include "m.h"
#include <stdio.h>
int main(void) {
    static bond_state s;
    int k, r;
    bond_init(&s);
    for (k = 0; k < 100; ++k)
        if (bond_commit(&s, 0)) return 1;
    for (r = 0; r < BOND_REGIONS; ++r) printf("%g\n", (double)bond_ledger(&s, r, BOND_LEDGER_WORST));
    return 0;
}
"#;
    let rows = built(&u, main).rows("run");
    assert_eq!(rows.len(), 2);
    assert!(rows.iter().all(|row| row[0] < 1e-12), "{rows:?}");
}

/// What numbers that are none would go unseen by is refused.
#[test]
fn fast_mathematics_is_refused() {
    if !is_there() {
        return;
    }
    let compiled = with(Options::new(), "model A { C:s = 1 m/N  I:m = 1 kg  1:v -> s, m  probe q = s.q }");
    let (u, _) = emit(&compiled, 1e-3).unwrap_or_else(|e| panic!("{e}"));
    let here = built(&u, "int main(void) { return 0; }");
    for flag in ["-ffast-math", "-ffinite-math-only"] {
        let cc = Command::new("cc").args([flag, "-c", "m.c"]).current_dir(&here.0).output().expect("cc runs");
        let said = String::from_utf8_lossy(&cc.stderr);
        assert!(!cc.status.success() && said.contains("not with -ffast-math"), "{flag}: {said}");
    }
}
