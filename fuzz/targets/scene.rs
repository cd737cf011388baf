//! Any bytes as the body of a compiled scene, with the digest that lets them in.
//!
//! What is refused is refused in words. What is sound is read back from its own bytes as it is, and runs: a run that is
//! saved and goes on gives the same bits as one that is not.
#![no_main]

use bond::Options;
use bond::internal::CompiledInternals;
use bond_fuzz::limited::Limited;
use bond_fuzz::{scenes, sealed, seeds};
use bond_runtime::envelope::{HEAD, Kind, digest};
use bond_runtime::ir::Program;
use bond_runtime::scene::{Respond, Scene};
use bond_runtime::simulate::{self, Simulation};
use libfuzzer_sys::fuzz_target;

/// Bytes of the largest scene that is a seed, and of the longest text that it is made of.
const LONGEST: usize = 6000;
/// Numbers in all arrays of the largest scene that runs.
const MOST: usize = 20_000;
/// Steps that are taken before the state is saved, and after that.
const STEPS: [u32; 2] = [3, 6];

/// How many numbers a run would hold.
fn size(scene: &Scene) -> usize {
    let of = |p: &Program| p.sizes.iter().map(|n| *n as usize).sum::<usize>() + p.values as usize;
    let mut sum = scene.probes.program.as_ref().map_or(0, of) + scene.open.len() + scene.bars.len();
    for c in &scene.clusters {
        let steppers = [Some(&c.step), c.step.glance.as_deref(), c.step.fallback.as_deref()];
        for s in steppers.into_iter().flatten() {
            sum += of(&s.program) + s.linear.as_ref().map_or(0, |l| 64 * l.a.len());
        }
        let guards =
            c.guards.iter().flat_map(|g| [&g.program].into_iter().chain(g.branch.as_ref().map(|b| &b.program)));
        sum += [&c.instant, &c.stored].into_iter().chain(guards).map(of).sum::<usize>();
        sum += c.respond.iter().flat_map(Respond::programs).map(of).sum::<usize>();
        sum += c.initial.len() + c.foreign_at + c.holds.len() * c.holds.len() + c.ports.len();
    }
    sum
}

/// The probes at each of some instants, as bits; it ends where a step fails.
fn rows(sim: &mut Simulation<'_>, h: f64, steps: std::ops::Range<u32>) -> Vec<Vec<u64>> {
    let mut rows = Vec::new();
    for k in steps {
        if sim.advance(f64::from(k + 1) * h).is_err() {
            break;
        }
        let Ok(row) = sim.probes() else { break };
        rows.push(row.iter().map(|x| x.to_bits()).collect());
    }
    rows
}

/// Takes a few steps, of one length or fitted.
fn run(scene: &Scene, fitted: bool) {
    let periods = scene.clusters.iter().filter_map(|c| c.period);
    let h = periods.fold(1e-2, f64::min);
    let options = simulate::Options {
        step: (!fitted).then_some(h / 2.0),
        tolerance: fitted.then_some(1e-3),
        default_step: h / 2.0,
        longest: None,
    };
    let limits = [(); 2].map(|()| Limited::default());
    let Ok(mut whole) = Simulation::on(&limits[0], scene, &options, Vec::new()) else { return };
    let first = rows(&mut whole, h, 0..STEPS[0]);
    let width = scene.probes.program.as_ref().map_or(0, |p| p.size(bond_runtime::ir::Array::Output));
    assert!(first.iter().all(|row| row.len() == width && width >= scene.probes.names.len()));
    let _ = whole.summary();
    if first.len() < STEPS[0] as usize {
        return;
    }
    let saved = whole.save().unwrap_or_else(|e| panic!("{e}"));
    let mut second = match Simulation::resume(&limits[1], scene, &saved, Vec::new()) {
        Ok(second) => second,
        Err(why) => panic!("what was saved is refused: {why}"),
    };
    let (a, b) = (rows(&mut whole, h, STEPS[0]..STEPS[1]), rows(&mut second, h, STEPS[0]..STEPS[1]));
    assert!(a == b || limits.iter().any(Limited::is_over), "it goes on otherwise: {a:?}, {b:?}");
}

fuzz_target!(
    init: {
        let models = ["elements", "examples"].into_iter().flat_map(|folder| seeds::models(folder, LONGEST));
        let own = scenes::ALL.iter().enumerate().map(|(i, text)| (format!("scene-{i}"), (*text).to_string()));
        let compiled = models.chain(own).filter_map(|(name, text)| {
            let compiled = Options::new().compile_str("scene.bond", text).ok()?;
            let body = compiled.scene().to_bytes().ok()?.split_off(HEAD);
            (body.len() <= LONGEST).then_some((name, body))
        });
        seeds::write("scene", compiled);
    },
    |data: &[u8]| {
        let scene = match Scene::from_bytes(&sealed(Kind::Scene, data)) {
            Ok(scene) => scene,
            Err(why) => {
                assert!(!why.to_string().is_empty());
                return;
            }
        };
        let bytes = scene.to_bytes().unwrap_or_else(|e| panic!("{e}"));
        let back = Scene::from_bytes(&bytes).unwrap_or_else(|e| panic!("what was written is refused: {e}"));
        assert!(back.to_bytes().as_ref() == Ok(&bytes), "written again, it differs");
        if size(&scene) <= MOST {
            run(&scene, digest(data).is_multiple_of(2));
        }
    }
);
