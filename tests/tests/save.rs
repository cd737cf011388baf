//! A run that is saved and goes on gives the same bits as one that was never stopped.

use crate::common::{RUN, all_scenes, cases, file, models, stop, text};
use bond::internal::{Code, CompiledInternals, SimulationInternals, StepsInternals, refusal};
use bond::{Compiled, InputSignal, Options, Simulation, Steps};
use bond_runtime::envelope::{HEAD, digest};
use bond_runtime::simulate::{self, Refused};
use proptest::prelude::*;

/// Rows of a run.
const ROWS: u32 = 200;

fn instant(end: f64, k: u32) -> f64 {
    f64::from(k) * end / f64::from(ROWS)
}

fn row(sim: &mut Simulation<'_>) -> Vec<u64> {
    sim.probes().map(|p| p.iter().map(|x| x.to_bits()).collect()).unwrap_or_default()
}

/// The rows after `from`, the ledger and the whole state at the end; the error that ends it, if there is one.
fn rest(sim: &mut Simulation<'_>, end: f64, from: u32) -> (Vec<Vec<u64>>, String, Vec<u8>) {
    let mut rows = Vec::new();
    for k in from + 1..=ROWS {
        if let Err(e) = sim.advance(instant(end, k)) {
            return (rows, e.to_string(), sim.save().unwrap_or_default());
        }
        rows.push(row(sim));
    }
    let last = sim.save().unwrap_or_default();
    let _ = sim.finish(end * 1.001);
    (rows, format!("{:?}", sim.summary()), last)
}

/// Runs on, saves, and lets both go on.
fn splits(
    title: &str,
    compiled: &Compiled,
    options: &simulate::Options,
    end: f64,
    at: u32,
    signal: &[(String, InputSignal)],
) {
    let scene = compiled.scene();
    let Ok(mut whole) = Simulation::with(scene, options, signal.to_vec()) else { return };
    for k in 1..=at {
        if whole.advance(instant(end, k)).is_err() {
            return;
        }
        row(&mut whole);
    }
    let bytes = whole.save().unwrap_or_else(|e| panic!("{title}: {e}"));
    assert!(whole.save().as_ref() == Ok(&bytes), "{title}: saving changes something");
    let mut second =
        Simulation::resume(Code::default().backend(), scene, &bytes, []).unwrap_or_else(|e| panic!("{title}: {e}"));
    assert!(second.save().as_ref() == Ok(&bytes), "{title}: what goes on is not what was saved");
    assert!(
        rest(&mut whole, end, at) == rest(&mut second, end, at),
        "{title}: split at {at} of {ROWS} it runs otherwise"
    );
}

#[test]
fn every_scene_goes_on_bit_for_bit() {
    assert!(RUN.contains(&"examples"));
    for (title, path, scene) in all_scenes() {
        let compiled = file(&path, Options::new().model(&scene));
        let settings = &compiled.stages().model.settings;
        let end = 0.3 * stop(&compiled);
        let options =
            Steps::new().resolve(settings, stop(&compiled), settings.every).unwrap_or_else(|e| panic!("{title}: {e}"));
        splits(&title, &compiled, &options, end, 77, &[]);
    }
}

/// Whoever looks, and wherever within the steps, the run goes on with the same bits.
#[test]
fn looking_changes_no_scene() {
    for (title, path, scene) in all_scenes() {
        let compiled = file(&path, Options::new().model(&scene));
        let settings = &compiled.stages().model.settings;
        let options =
            Steps::new().resolve(settings, stop(&compiled), settings.every).unwrap_or_else(|e| panic!("{title}: {e}"));
        let end = 0.03 * stop(&compiled);
        let run = |looks: bool| {
            let mut sim = Simulation::with(compiled.scene(), &options, []).ok()?;
            for k in 1..=37 {
                sim.advance(f64::from(k) * end / 37.0).ok()?;
                if looks {
                    row(&mut sim);
                }
            }
            // Inputs of the programs are those of the last run of one: a look's, here.
            sim.advance(1.1 * end).ok()?;
            Some((row(&mut sim), sim.save().ok()?))
        };
        assert!(run(true) == run(false), "{title}");
    }
}

/// Scenes of every kind: exact and not, sampled at several rates, every hold.
const KINDS: [(&str, &str); 12] = [
    ("virtual_wall", "VirtualWall"),
    ("virtual_wall", "Lagged"),
    ("virtual_wall", "Ray"),
    ("two_rates", ""),
    ("two_computers", ""),
    ("sampled_mass", ""),
    ("mass_spring_sampled", ""),
    ("pid_motor", "Sampled"),
    ("pendulum", ""),
    ("bouncing_mass", ""),
    ("quarter_car", ""),
    ("diode_clipper", ""),
];

proptest! {
    #![proptest_config(ProptestConfig { cases: cases(60), ..ProptestConfig::default() })]

    #[test]
    fn any_split_of_any_kind(kind in 0..KINDS.len(), at in 0..ROWS, length in 0.01f64..0.4, way in 0..3, part in 20.0f64..3000.0, hold: bool) {
        let (name, scene) = KINDS[kind];
        let mut options = Options::new();
        if !scene.is_empty() {
            options = options.model(scene);
        }
        let compiled = file(&models().join("examples").join(format!("{name}.bond")), options);
        let end = length * stop(&compiled);
        let steps = match way {
            0 => Steps::new(),
            1 => Steps::fixed(end / part),
            _ => Steps::tolerance(1e-3 / part),
        };
        let settings = &compiled.stages().model.settings;
        let options = steps.resolve(settings, stop(&compiled), settings.every)?;
        let signal = compiled.inputs().iter().map(|name| {
            let instants: Vec<f64> = (0..50).map(|k| f64::from(k) * end / 37.3).collect();
            let values: Vec<f64> = (0..50).map(|k| f64::from(k * k % 7) * 0.1).collect();
            Ok((name.to_string(), InputSignal::table(&instants, &values, hold)?))
        }).collect::<Result<Vec<_>, Box<dyn std::error::Error>>>().map_err(|e| TestCaseError::fail(e.to_string()))?;
        splits(&format!("{name} {scene} way {way}"), &compiled, &options, end, at, &signal);
    }
}

/// A spring that goes by the clock of one of its sides, in the midst of an interval of the other.
#[test]
fn clocks_of_others_are_kept() {
    let compiled = text(
        "model Clocks {
          sampled every 3 ms { I:left { inertia = 1 kg; f0 = 0.3 m/s } }
          sampled every 7 ms { C:spring { stiffness = 100 N/m }  0:n -> spring }
          sampled every 5 ms { I:right = 0.5 kg }
          left ||> n
          n ||> right
          probe a = left.f
          probe e = spring.e
        }",
    );
    let settings = &compiled.stages().model.settings;
    let options = Steps::new().resolve(settings, 0.5, None).unwrap_or_else(|e| panic!("{e}"));
    for at in [5, 26, 40] {
        splits("clocks", &compiled, &options, 0.13, at, &[]);
    }
}

const FED: &str = "
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

/// Inputs that were set on the way are part of the state.
#[test]
fn inputs_set_on_the_way_are_kept() -> Result<(), Box<dyn std::error::Error>> {
    let compiled = text(FED);
    let settings = &compiled.stages().model.settings;
    for steps in [Steps::new(), Steps::fixed(1.7e-3), Steps::tolerance(1e-8)] {
        let options = steps.resolve(settings, 1.0, None)?;
        let mut whole = Simulation::new(compiled.scene(), &options)?;
        for k in 1..50 {
            whole.advance(f64::from(k) * 0.0071)?;
            whole.set_input("push", f64::from(k % 5))?;
        }
        let mut second = Simulation::resume(Code::default().backend(), compiled.scene(), &whole.save()?, [])?;
        assert!(rest(&mut whole, 1.0, 80) == rest(&mut second, 1.0, 80), "{steps:?}");
    }
    Ok(())
}

/// Why a scene does not go on from saved bytes.
fn why(scene: &Compiled, bytes: &[u8]) -> Result<Refused, String> {
    match Simulation::resume(Code::default().backend(), scene.scene(), bytes, []) {
        Err(e) => refusal(&e).cloned().ok_or_else(|| format!("another error: {e}")),
        Ok(_) => Err("it goes on".to_string()),
    }
}

/// A state says how many weights predict what a bar feels: more than there are would be read.
#[test]
fn a_state_with_too_many_weights_is_refused() -> Result<(), Box<dyn std::error::Error>> {
    let compiled = text(FED);
    let options = Steps::new().resolve(&compiled.stages().model.settings, 1.0, None)?;
    let bytes = Simulation::new(compiled.scene(), &options)?.save()?;
    // One weight, three that are not used, the same as the crude one, and their count.
    let is_rule = |w: &[u8]| {
        let of = |k: usize| f64::from_le_bytes(w[8 * k..8 * k + 8].try_into().unwrap_or_default());
        (0.1..1.0).contains(&of(0)) && of(4) == of(0) && of(5) == 1.0 && (1..4).all(|k| of(k) == 0.0)
    };
    let at = bytes.windows(48).position(is_rule).ok_or("there are no weights")? + 40;
    for (orders, refused) in [(1.0f64, false), (0.0, true), (1.5, true), (5.0, true), (1e300, true), (f64::NAN, true)] {
        let mut changed = bytes.clone();
        changed[at..at + 8].copy_from_slice(&orders.to_le_bytes());
        let whole = digest(&changed[HEAD..]).to_le_bytes();
        changed[HEAD - 8..HEAD].copy_from_slice(&whole);
        let answer = why(&compiled, &changed);
        assert_eq!(matches!(answer, Ok(Refused::Shape("what is predicted"))), refused, "{orders}: {answer:?}");
    }
    Ok(())
}

#[test]
fn the_state_of_another_scene_is_refused() -> Result<(), Box<dyn std::error::Error>> {
    let compiled = text(FED);
    let options = Steps::new().resolve(&compiled.stages().model.settings, 1.0, None)?;
    let mut sim = Simulation::new(compiled.scene(), &options)?;
    sim.advance(0.5)?;
    let bytes = sim.save()?;
    let other = text(&FED.replace("100 N/m", "101 N/m"));
    assert!(matches!(why(&other, &bytes)?, Refused::Changed(_)));
    let other = text(&FED.replace("Fed", "Fred"));
    assert!(matches!(why(&other, &bytes)?, Refused::Model { .. }));
    let mut cut = bytes.clone();
    cut.pop();
    assert!(matches!(why(&compiled, &cut)?, Refused::Damaged(_)));
    Ok(())
}
