//! Any bytes as the saved state of a small scene, with the digest and the fingerprint that let them in.
//!
//! What is refused is refused in words. What is taken goes on: its state is saved as it is, and a run that is saved
//! once more on its way gives the same bits as one that is not.
#![no_main]

use bond::Compiled;
use bond::internal::CompiledInternals;
use bond_fuzz::feed::Feed;
use bond_fuzz::limited::Limited;
use bond_fuzz::{scenes, sealed, seeds};
use bond_runtime::envelope::{HEAD, Kind, seal};
use bond_runtime::scene::Scene;
use bond_runtime::simulate::{InputSignal, Refused, Simulation, made};
use libfuzzer_sys::fuzz_target;
use std::sync::OnceLock;

/// A scene, and how the body of its saved states begins.
struct Place {
    compiled: Compiled,
    head: Vec<u8>,
}

fn places() -> &'static [Place] {
    static PLACES: OnceLock<Vec<Place>> = OnceLock::new();
    PLACES.get_or_init(|| {
        let place = |text: &&str| {
            let compiled = scenes::compiled(text);
            let scene = compiled.scene();
            let print = scene.fingerprint().unwrap_or_else(|e| panic!("{e}"));
            let head = seal(Kind::State, &(&scene.name, print)).unwrap_or_else(|e| panic!("{e}")).split_off(HEAD);
            Place { compiled, head }
        };
        scenes::ALL.iter().map(place).collect()
    })
}

/// States of each scene, at its start and on its way, without how they begin.
fn states() -> Vec<(String, Vec<u8>)> {
    let mut list = Vec::new();
    for (i, Place { compiled, head }) in places().iter().enumerate() {
        for (k, steps) in
            [bond::Steps::new(), bond::Steps::fixed(1e-3), bond::Steps::tolerance(1e-4)].iter().enumerate()
        {
            let Ok(mut sim) = compiled.simulate(*steps) else { continue };
            for at in [0, 1, 40] {
                let _ = sim.advance(f64::from(at) * 1.3e-3);
                if let Some(input) = compiled.inputs().first() {
                    let _ = sim.set_input(input, f64::from(at));
                }
                let Ok(bytes) = sim.save() else { continue };
                let mut seed = vec![i as u8];
                seed.extend(&bytes[HEAD + head.len()..]);
                list.push((format!("{i}-{k}-{at}"), seed));
            }
        }
    }
    list
}

fn resumed<'a>(limited: &Limited, scene: &'a Scene, bytes: &[u8]) -> Result<Simulation<'a>, Refused> {
    Simulation::resume(limited, scene, bytes, Vec::new())
}

fn saved(sim: &Simulation<'_>) -> Vec<u8> {
    sim.save().unwrap_or_else(|e| panic!("{e}"))
}

/// Goes on over a few steps: the probes at each, as bits, and how it ended.
fn rows(sim: &mut Simulation<'_>, instants: &[f64]) -> (Vec<Vec<u64>>, Option<String>) {
    let mut rows = Vec::new();
    for t in instants {
        if let Err(e) = sim.advance(*t) {
            return (rows, Some(e.to_string()));
        }
        match sim.probes() {
            Ok(row) => rows.push(row.iter().map(|x| x.to_bits()).collect()),
            Err(e) => return (rows, Some(e.to_string())),
        }
    }
    (rows, None)
}

fuzz_target!(
    init: seeds::write("checkpoint", states()),
    |data: &[u8]| {
        let mut feed = Feed(data);
        let Some(Place { compiled, head }) = feed.one(places()) else { return };
        let scene = compiled.scene();
        let bytes = sealed(Kind::State, &[head, feed.0].concat());
        let limits = [(); 4].map(|()| Limited::default());
        let mut sim = match resumed(&limits[0], scene, &bytes) {
            Ok(sim) => sim,
            Err(why) => {
                assert!(!why.to_string().is_empty());
                return;
            }
        };
        assert!(made(&bytes).is_ok(), "it is a state, and nobody knows what it was made for");
        let first = saved(&sim);
        let again = resumed(&limits[1], scene, &first);
        let again = again.unwrap_or_else(|e| panic!("what was saved is refused: {e}"));
        assert!(saved(&again) == first || limits[0].is_over(), "what goes on is not what was saved");
        let options = sim.options();
        let h = options.step.unwrap_or(options.default_step);
        let instants = [1.0, 2.0, 3.0, 4.0].map(|k| sim.time() + k * h);
        let before = rows(&mut sim, &instants[..2]);
        let _ = sim.summary();
        if before.1.is_some() {
            return;
        }
        let other = resumed(&limits[2], scene, &saved(&sim));
        let mut other = other.unwrap_or_else(|e| panic!("what was saved is refused: {e}"));
        let (own, same) = (rows(&mut sim, &instants[2..]), rows(&mut other, &instants[2..]));
        assert!(own == same || limits[0].is_over() || limits[2].is_over(), "it goes on otherwise: {own:?}, {same:?}");
        // As `--resume` does with a table of inputs.
        let signals = (0..scene.inputs.len()).map(|i| (i, InputSignal::constant(1.0))).collect();
        let _ = Simulation::resume(&limits[3], scene, &bytes, signals);
    }
);
