//! Scenes as bytes: what is read back is what was written, and what is damaged is refused.

use crate::common::{all_scenes, file, start, stop};
use bond::internal::{CompiledInternals, SimulationInternals, StepsInternals};
use bond::{Compiled, Options, Simulation, Steps};
use bond_runtime::envelope::{HEAD, Kind, digest};
use bond_runtime::ir::{Inst, Program};
use bond_runtime::options::NumericOptions;
use bond_runtime::scene::{Respond, Scene};
use bond_runtime::{Interpreter, simulate};
use std::fmt::Write;

/// A hundredth of the run, as bits.
fn bits(sim: &mut Simulation<'_>, end: f64) -> String {
    let mut all = String::new();
    for k in 0..=20 {
        if let Err(e) = sim.advance(f64::from(k) * end / 2000.0) {
            return format!("{all}{e}");
        }
        let row: Vec<u64> = sim.probes().map(|p| p.iter().map(|x| x.to_bits()).collect()).unwrap_or_default();
        let _ = writeln!(all, "{row:?}");
    }
    format!("{all}{:?}", sim.summary())
}

fn options(compiled: &Compiled) -> simulate::Options {
    let settings = &compiled.stages().model.settings;
    Steps::new().resolve(settings, stop(compiled), settings.every).unwrap_or_else(|e| panic!("{e}"))
}

#[test]
fn scenes_are_read_back_as_they_were() {
    for (title, path, scene) in all_scenes() {
        let compiled = file(&path, Options::new().model(&scene));
        compiled.scene().validate().unwrap_or_else(|e| panic!("{title}: {e}"));
        let bytes = compiled.scene().to_bytes().unwrap_or_else(|e| panic!("{title}: {e}"));
        let back = Scene::from_bytes(&bytes).unwrap_or_else(|e| panic!("{title}: {e}"));
        assert!(back.to_bytes().as_ref() == Ok(&bytes), "{title}: written again, it differs");
        let end = stop(&compiled);
        let mut second = Simulation::new(&back, &options(&compiled)).unwrap_or_else(|e| panic!("{title}: {e}"));
        let mut first = start(&compiled, Steps::new());
        assert!(bits(&mut first, end) == bits(&mut second, end), "{title}: it runs otherwise");
    }
}

/// All programs of a scene.
fn programs(scene: &Scene) -> Vec<&Program> {
    let mut list = Vec::new();
    for c in &scene.clusters {
        list.extend([&c.step.program, &c.instant, &c.stored]);
        list.extend(c.guards.iter().map(|g| &g.program));
        list.extend(c.step.glance.iter().map(|g| &g.program));
        list.extend(c.respond.iter().flat_map(Respond::programs));
    }
    list.extend(&scene.probes.program);
    list
}

/// Bytes that are wrong and bear the right digest: what reads them says so, or finds a scene that is sound.
#[test]
fn no_bytes_make_it_panic() {
    let mut seed = 0x9e37_79b9_7f4a_7c15u64;
    let mut random = |n: usize| {
        seed ^= seed << 13;
        seed ^= seed >> 7;
        seed ^= seed << 17;
        (seed % n as u64) as usize
    };
    let (mut refused, mut sound) = (0, 0);
    for name in ["virtual_wall", "two_computers", "pendulum", "open_port", "pid_motor"] {
        let path = crate::common::models().join("examples").join(format!("{name}.bond"));
        let compiled = file(&path, Options::new());
        let bytes = compiled.scene().to_bytes().unwrap_or_else(|e| panic!("{name}: {e}"));
        for _ in 0..3000 {
            let mut wrong = bytes.clone();
            for _ in 0..=random(3) {
                let at = HEAD + random(wrong.len() - HEAD);
                wrong[at] = if random(2) == 0 { random(256) as u8 } else { wrong[at] ^ (1 << random(8)) };
            }
            if random(4) == 0 {
                wrong.truncate(HEAD + random(wrong.len() - HEAD));
            }
            let body = wrong[HEAD..].to_vec();
            wrong[12..20].copy_from_slice(&(body.len() as u64).to_le_bytes());
            wrong[20..28].copy_from_slice(&digest(&body).to_le_bytes());
            match Scene::from_bytes(&wrong) {
                Err(_) => refused += 1,
                Ok(scene) => {
                    sound += 1;
                    for p in programs(&scene) {
                        let _ = Interpreter::new(p);
                    }
                }
            }
        }
    }
    assert!(refused > 1000 && sound > 100, "{refused} were refused and {sound} were sound");
}

/// Numbers by which steps would be tried again for ever, or counted until the count has no room, are refused.
#[test]
fn a_run_by_its_numbers_has_an_end() {
    let compiled = file(&crate::common::models().join("examples").join("pendulum.bond"), Options::new());
    let reads = |change: fn(&mut NumericOptions)| {
        let mut scene = compiled.scene().clone();
        change(&mut scene.numeric);
        let bytes = scene.to_bytes().unwrap_or_else(|e| panic!("{e}"));
        Scene::from_bytes(&bytes).is_ok()
    };
    assert!(reads(|_| ()) && reads(|n| n.controller.failure_shrink = 0.5));
    assert!(!reads(|n| n.controller.failure_shrink = 1.0) && !reads(|n| n.controller.safety = f64::NAN));
    assert!(!reads(|n| n.controller.overshoot_min = 1.0) && !reads(|n| n.controller.stable = -1.0));
    assert!(!reads(|n| n.controller.max_crawling = u32::MAX) && !reads(|n| n.error.looks = -1));
    assert!(!reads(|n| n.events.max_gap = f64::INFINITY));
    let mut scene = compiled.scene().clone();
    let body = &mut scene.clusters[0].step.program.body;
    let newton = body.iter_mut().find_map(|inst| if let Inst::Newton(n) = inst { Some(n) } else { None });
    newton.unwrap_or_else(|| panic!("no iteration")).limit = u32::MAX;
    assert!(scene.validate().is_err());
}

/// Iterations inside iterations without end are refused before they exhaust the stack.
#[test]
fn nested_iterations_have_an_end() {
    let deep = [2u8, 0, 1].repeat(1_000_000);
    // A program's name, its six sizes, no names, then one instruction.
    let mut body = vec![0, 0, 0, 0, 0, 0, 0, 0, 1];
    body.extend(deep);
    let mut bytes = Kind::State.magic().to_vec();
    bytes.extend(1u32.to_le_bytes());
    bytes.extend((body.len() as u64).to_le_bytes());
    bytes.extend(digest(&body).to_le_bytes());
    bytes.extend(body);
    assert!(bond_runtime::envelope::open::<Program>(Kind::State, &bytes).is_err());
}
