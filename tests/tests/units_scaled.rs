//! The same scene in other units is the same run: no number of a method is an absolute one in SI. Base units are
//! multiplied by powers of two, so that nothing is rounded otherwise: the same steppers take the same steps, and the
//! rows have the same bits.

use crate::common::{file, scenes_of, with};
use bond::internal::{CompiledInternals, OptionsInternals};
use bond::{Compiled, Options, Steps};
use bond_compiler::units::BaseUnits;
use std::path::PathBuf;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Powers of two by which kg, m, s, A, K, mol and cd are multiplied: one unit at a time would hide what cancels.
const UNITS: [[i32; 7]; 2] = [[6, -12, -6, 12, 6, -6, 6], [-18, 12, 6, -24, -6, 12, -12]];

/// Rows of a run that are compared.
const ROWS: u32 = 40;

/// What a scene came to.
struct Run {
    /// By region: stepper, steps, attempts that were not kept, events, iterations.
    work: Vec<(String, [u64; 4])>,
    /// Rows of probes, in SI but for the units' powers of two.
    rows: Vec<Vec<f64>>,
    /// How it ended.
    error: Option<String>,
}

impl Run {
    fn of(compiled: &Compiled) -> Self {
        let mut run = Run { work: Vec::new(), rows: Vec::new(), error: None };
        let stop = compiled.stages().model.settings.stop.unwrap_or(1.0);
        let mut sim = match compiled.simulate(Steps::new()) {
            Ok(sim) => sim,
            Err(e) => return Run { error: Some(e.to_string()), ..run },
        };
        for k in 0..=ROWS {
            let t = stop * (f64::from(k) / f64::from(ROWS));
            match sim.advance(t).and_then(|()| Ok(sim.probes()?.to_vec())) {
                Ok(row) => run.rows.push(row),
                Err(e) => {
                    run.error = Some(e.to_string());
                    break;
                }
            }
        }
        let of =
            |r: &bond::RegionSummary| (r.stepper.to_string(), [r.steps, r.rejected, r.events, r.newton_iterations]);
        run.work = sim.summary().regions.iter().map(of).collect();
        run
    }

    /// The first thing in which another run differs, in words; None where it has the same bits.
    fn differs(&self, other: &Run) -> Option<String> {
        if self.error.is_some() != other.error.is_some() {
            return Some(format!("ends by {:?} and {:?}", self.error, other.error));
        }
        for (a, b) in self.work.iter().zip(&other.work) {
            if a.0 != b.0 {
                return Some(format!("stepper {} and {}", a.0, b.0));
            }
        }
        let columns = self.rows.first().map_or(0, Vec::len);
        let mut most = 0.0f64;
        for k in 0..columns {
            let column = |run: &Run| run.rows.iter().filter_map(|r| r.get(k).copied()).collect::<Vec<f64>>();
            let (a, b) = (column(self), column(other));
            let size = |list: &[f64]| list.iter().fold(0.0f64, |m, x| m.max(x.abs()));
            // The unit of the probe: a power of two.
            let first = a.iter().zip(&b).find(|(x, y)| **x != 0.0 && **y != 0.0).map_or(1.0, |(x, y)| y / x);
            let unit = first.abs().log2().round().exp2();
            if a.iter().zip(&b).all(|(x, y)| (x * unit).to_bits() == y.to_bits() || x.is_nan() && y.is_nan()) {
                continue;
            }
            let off = a.iter().zip(&b).fold(0.0f64, |m, (x, y)| m.max((x * unit - y).abs()));
            most = most.max(off / (size(&a) * unit)).max(f64::MIN_POSITIVE);
        }
        let steps = self.work != other.work;
        let work = |r: &Run| r.work.iter().fold([0; 4], |s, w| std::array::from_fn(|i| s[i] + w.1[i]));
        (steps || most > 0.0).then(|| format!("work {:?} and {:?}, rows differ by {most:.0e}", work(self), work(other)))
    }
}

/// All scenes of the models that run.
fn all() -> Vec<(String, PathBuf, String)> {
    ["examples", "elements", "components", "classics", "hard"].iter().flat_map(|folder| scenes_of(folder)).collect()
}

/// How a scene in other units differs.
fn off((_, path, scene): &(String, PathBuf, String)) -> Option<String> {
    let run = |units: [i32; 7]| Run::of(&file(path, Options::new().model(scene).base_units(BaseUnits(units))));
    let plain = run([0; 7]);
    UNITS.into_iter().find_map(|units| run(units).differs(&plain))
}

/// Scenes that are not yet, or cannot be, the same to the last bit, and in what they differ: by how much, as a part of
/// the largest value in a column. (A column of rounding alone may differ by 1.)
const KNOWN: [(&str, &str); 37] = [
    ("classics/electromagnet Electromagnet", "iterations, rows by 1e-15"),
    ("classics/electrostatic_actuator ElectrostaticActuator", "rows by 1e-15"),
    ("classics/heater Heater", "iterations, rows by 4e-15"),
    ("classics/hydraulic_servo HydraulicServo", "iterations, rows by 3e-13"),
    ("classics/muscle Muscle", "rows by 4e-16"),
    ("classics/pump_relief PumpRelief", "rows by 6e-16"),
    ("components/contact HertzImpact", "rows by 2e-16"),
    ("components/control Ways", "rows by 1e-15"),
    ("components/electrical Switched", "iterations"),
    ("components/magnetics Saturated", "rows by 2e-16"),
    ("components/transducers Membrane", "iterations"),
    ("elements/C_field Scene", "iterations, rows by 5e-15"),
    ("elements/IC_field Scene", "rows by 1e0"),
    ("elements/R_level Levelling", "iterations, rows by 6e-17"),
    ("elements/R_root RootDrag", "iterations"),
    ("elements/TL Lines", "iterations"),
    ("examples/measured_clamp MeasuredClamp", "rows by 2e-15"),
    ("examples/pendulum_chain Chain", "rows by 3e-12"),
    ("examples/real_loop RealLoop", "rows by 8e-12"),
    ("examples/transistor_amplifier TransistorAmplifier", "rows by 2e-14"),
    ("examples/two_computers TwoComputers", "rows by 1e-11"),
    ("examples/virtual_wall Lagged", "rows by 6e-1"),
    ("examples/virtual_wall Predicted", "rows by 2e-13"),
    ("examples/virtual_wall Ray", "iterations"),
    ("examples/virtual_wall VirtualWall", "rows by 7e-14"),
    ("hard/coulomb Coulomb", "rows by 1e-13"),
    ("hard/coulomb Held", "rows by 4e-33"),
    ("hard/diode_bridge DiodeBridge", "iterations, rows by 1e-24"),
    ("hard/fput Fput", "rows by 5e-16"),
    ("hard/fput FputAlpha", "rows by 4e-16"),
    ("hard/ideal_bridge IdealBridge", "iterations, rows by 5e-14"),
    ("hard/orifice Orifice", "iterations, rows by 3e-5"),
    ("hard/r_bridge AllFive", "the steps, rows by 9e-11"),
    ("hard/r_bridge ResistorBridge", "rows by 5e-12"),
    ("hard/ring_modulator RingModulator", "the steps, rows by 4e-9"),
    ("hard/sampled SampledPushed", "rows by 4e-15"),
    ("hard/stick_slip StickSlip", "iterations, rows by 1e0"),
];

#[test]
fn other_units_change_nothing() {
    let scenes = all();
    let only = std::env::var("ONLY").unwrap_or_default();
    let (next, found) = (AtomicUsize::new(0), Mutex::new(Vec::new()));
    std::thread::scope(|s| {
        for _ in 0..2 {
            s.spawn(|| {
                while let Some(scene) = scenes.get(next.fetch_add(1, Ordering::Relaxed)) {
                    if !scene.0.contains(&only) {
                        continue;
                    }
                    if let Some(why) = off(scene) {
                        found.lock().expect("no thread fails").push((scene.0.clone(), why));
                    }
                }
            });
        }
    });
    let mut found = found.into_inner().expect("no thread fails");
    found.sort();
    let known = |title: &str| KNOWN.iter().any(|k| k.0 == title);
    let new: Vec<String> =
        found.iter().filter(|f| !known(&f.0)).map(|(title, why)| format!("{title}: {why}")).collect();
    let held: Vec<&str> = KNOWN.iter().map(|k| k.0).filter(|k| !found.iter().any(|f| f.0 == *k)).collect();
    assert!(
        new.is_empty() && held.is_empty(),
        "{} of {}:\n{}\nhold now: {held:?}",
        new.len(),
        scenes.len(),
        new.join("\n")
    );
}

/// A coil behind a diode of three lines, and a body on a spring that rubs: `s` is the size of all that they are given.
const SIZED: [&str; 2] = [
    "model Coil(s = 1) {
       Se:u = s * 10 V * sin(2*pi*50 Hz * t)
       I:l = 0.1 H
       R:r = 1 Ohm
       R:d {
         e = if f > s * 1 mA then 1 Ohm * f + s * 1 V
             else (if f > -s * 1 mA then 1001 Ohm * f else 1e7 Ohm * (f + s * 1 mA) - s*1.001 V)
       }
       u -> 1:i -> l, r, d
       probe x = i.f / s
       probe ud = d.e / s
       simulate { stop = 0.055 s }
     }",
    "model Slide(s = 1) {
       I:m { inertia = s * 1 kg; f0 = 1 m/s }
       C:k { stiffness = s * 1 N/m; q0 = 0 m }
       R:fr { e = if abs(f) < 1 mm/s then s*1000 N*s/m * f else s*(0.1 N*s/m * f + sign(f)*0.9999 N) }
       1:v -> m, k, fr
       probe x = k.q
       probe speed = m.f
       simulate { stop = 2 s }
     }",
];

#[test]
fn size_changes_nothing() {
    for text in SIZED {
        let run = |s: &str| Run::of(&with(Options::new().set("s", s), text));
        let plain = run("1");
        for size in ["1e-3", "1e-9", "1e3"] {
            let other = run(size);
            let steps = |r: &Run| r.work.iter().map(|w| (w.0.clone(), w.1[..3].to_vec())).collect::<Vec<_>>();
            assert_eq!(steps(&plain), steps(&other), "s = {size}\n{text}");
            let largest = plain.rows.iter().flatten().fold(0.0f64, |m, x| m.max(x.abs()));
            let pairs = plain.rows.iter().flatten().zip(other.rows.iter().flatten());
            let off = pairs.fold(0.0f64, |m, (x, y)| m.max((x - y).abs()));
            assert!(off <= 1e-9 * largest, "s = {size}: off by {off:e}\n{text}");
        }
    }
}
