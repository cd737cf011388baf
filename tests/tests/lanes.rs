//! Scenes side by side in emitted C have the bits of scenes that run alone, whatever each of them does.

use crate::common::{all_scenes, file, stop, with};
use crate::emitted::{Folder, WALL, emit, is_there, options};
use bond::Options;
use bond::internal::CompiledInternals;
use bond_compiler::backend::{c, standalone};
use std::path::PathBuf;

/// Runs lanes beside scenes alone: from different starts, each moved in its own way. What fails stands still. Prints
/// how many lanes failed, and how many intervals were gone.
const MAIN: &str = r#"
#include "m.h"
#include <stdio.h>
#include <string.h>
static bond_lanes b;
static bond_state one[BOND_LANES], other;
static int why[BOND_LANES];
static bond_real moved[(BOND_PORTS + 1) * BOND_LANES], held[(BOND_PORTS + 1) * BOND_LANES];
static bond_real own[BOND_PORTS + 1], saved[BOND_SAVED], wanted[BOND_SAVED];
static bond_real pattern(int k, int i, int l) { return (bond_real)(((k * 7 + i * 3 + l * 5) % 11 - 5) * 0.1 * (1 + l % 3)); }
static int alone(int l, int k) {
    int i;
    for (i = 0; i < BOND_PORTS; ++i) own[i] = pattern(k, i, l) * (bond_real)BOND_INTERVAL;
    return bond_commit(&one[l], own);
}
static int differ(int count) {
    int i;
    for (i = 0; i < count; ++i)
        if (memcmp(saved + i, wanted + i, sizeof *saved) && (saved[i] == saved[i] || wanted[i] == wanted[i])) return 1;
    return 0;
}
static int same(int l) {
    memset(&other, 255, sizeof other);
    bond_lanes_get(&b, l, &other);
    bond_save(&other, saved);
    bond_save(&one[l], wanted);
    if (differ(BOND_SAVED)) fprintf(stderr, "lane %d at %g s\n", l, (double)bond_time(&one[l]));
    return !differ(BOND_SAVED);
}
int main(void) {
    int i, k, l, still = 0;
    memset(&b, 255, sizeof b);
    bond_lanes_init(&b);
    bond_lanes_put(&b, -1, one);
    bond_lanes_put(&b, BOND_LANES, one);
    bond_lanes_get(&b, -1, one);
    bond_lanes_input(&b, BOND_LANES, 0, 7);
    bond_lanes_input(&b, 0, -1, 7);
    bond_lanes_input(&b, 0, BOND_INPUTS, 7);
    for (l = 0; l < BOND_LANES; ++l) {
        bond_init(&one[l]);
        if (!same(l)) return 2;
        for (k = 0; k < (l * 5) % 23; ++k)
            if (alone(l, k)) break;
        bond_lanes_put(&b, l, &one[l]);
        if (!same(l)) return 3;
    }
    for (k = 0; k < COUNT && still < BOND_LANES; ++k) {
        int failed;
        for (l = 0; l < BOND_LANES; ++l) {
            for (i = 0; i < BOND_INPUTS && (k + l) % 9 == 0; ++i) {
                bond_input(&one[l], i, pattern(k, i, l));
                bond_lanes_input(&b, l, i, pattern(k, i, l));
            }
            for (i = 0; i < BOND_PORTS; ++i) moved[i * BOND_LANES + l] = pattern(k, i, l) * (bond_real)BOND_INTERVAL;
        }
        failed = bond_lanes_commit(&b, moved);
        still = 0;
        for (l = 0; l < BOND_LANES; ++l) {
            if (!why[l]) why[l] = alone(l, k);
            still += why[l] != 0;
            if (b.failed[l] != why[l]) return 4;
            if ((k % 16 == 0 || k + 1 == COUNT) && !same(l)) return 5;
        }
        if (failed != still) return 6;
        bond_lanes_output(&b, held);
        for (l = 0; l < BOND_LANES; ++l) {
            bond_output(&one[l], own);
            for (i = 0; i < BOND_PORTS; ++i) {
                saved[0] = held[i * BOND_LANES + l];
                wanted[0] = own[i];
                if (differ(1)) return 7;
            }
        }
    }
    for (l = 0; l < BOND_LANES; ++l)
        if (!same(l)) return 8;
#if BOND_PORTS == 0
    if (bond_lanes_run(&b, 0) != still) return 9;
    bond_lanes_run(&b, 37);
    for (l = 0; l < BOND_LANES; ++l) {
        for (k = 0; k < 37 && !why[l]; ++k) why[l] = bond_commit(&one[l], 0);
        if (b.failed[l] != why[l] || !same(l)) return 10;
    }
#endif
    printf("%d %d\n", still, k);
    return bond_lanes_size() == sizeof b ? 0 : 11;
}
"#;

/// Numbers are single.
const SINGLE: &str = "-DBOND_FLOAT";

/// How many lanes fail, of a scene whose lanes have the bits of scenes alone.
fn lanes(u: &standalone::StandaloneModule, flags: &[&str]) -> f64 {
    let here = Folder::new();
    let names = options("bond", "m.h");
    here.put("m.h", c::header(u, &names));
    here.put("m.c", c::source(u, &names));
    here.put("main.c", MAIN.replace("COUNT", "200"));
    here.cc(&[flags, &["-DBOND_LANES=64", "-DBOND_SIMD=1", "m.c", "main.c", "-lm", "-o", "main"]].concat());
    here.rows("main").first().map_or(f64::NAN, |row| row[0])
}

#[test]
fn lanes_have_the_bits_of_scenes_alone() {
    if !is_there() {
        return;
    }
    // The C compiler takes minutes: every second scene, and as many at a time as there are threads.
    let scenes: Vec<_> = all_scenes().into_iter().step_by(2).collect();
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    let done: Vec<bool> = std::thread::scope(|scope| {
        let parts: Vec<_> =
            scenes.chunks(scenes.len().div_ceil(threads)).map(|part| scope.spawn(|| part_of(part))).collect();
        parts.into_iter().flat_map(|part| part.join().unwrap_or_else(|e| std::panic::resume_unwind(e))).collect()
    });
    let (seen, converted) = (done.len(), done.iter().filter(|converted| **converted).count());
    assert!(seen > 40 && converted > 20, "{converted} of {seen} scenes have a lane form");
}

/// Of each scene that has a form in C, whether it has a lane form. Every fourth has single numbers too.
fn part_of(scenes: &[(String, PathBuf, String)]) -> Vec<bool> {
    let mut done = Vec::new();
    for (title, path, scene) in scenes {
        let compiled = file(path, Options::new().model(scene));
        let h = compiled.stages().model.settings.step.unwrap_or(stop(&compiled) / 2000.0);
        let Ok((u, _)) = emit(&compiled, h) else { continue };
        println!("{title}: {:?}", u.lane_forms.iter().map(|s| s.body.len()).collect::<Vec<_>>());
        lanes(&u, &["-O0"]);
        if done.len() % 4 == 0 {
            lanes(&u, &["-O0", SINGLE]);
        }
        done.push(!u.lane_forms.is_empty());
    }
    done
}

/// What compilers make of it for this machine.
#[test]
fn vectors_have_the_same_bits() {
    if !is_there() {
        return;
    }
    let cases = [
        (
            "an iteration",
            "model A { C:s { e = q*(1 N/m) + q^3*(1 N/m^3); q0 = 1 m } I:m = 1 kg 1:v -> s, m probe q = s.q }",
            0.05,
        ),
        (
            "a law with a jump, and an input",
            "model A { input push = 1 N MSe:hand = push I:m = 1 kg sampled at 1 kHz { Wall:w } hand -> 1:v -> m v ||> w.tip probe q = w.spring.q }",
            1e-3,
        ),
        ("an open port", "model A { port tip sampled at 1 kHz { Wall:w } tip ||> w.tip probe q = w.spring.q }", 1e-3),
        (
            "functions",
            "model A { C:s { e = sin(q/(1 m))*(1 N); q0 = 1 m } I:m = 1 kg R:r { e = tanh(f/(1 m/s))*(0.1 N) } 1:v -> s, m, r probe q = s.q }",
            0.05,
        ),
        (
            "the smaller and the larger",
            "model A { C:s { stiffness = 1 N/m; q0 = 1 m } I:m = 1 kg R:r { e = max(min(f, 0.3 m/s), -0.2 m/s)*(1 N*s/m) } 1:v -> s, m, r probe q = s.q }",
            0.05,
        ),
    ];
    for (name, text, h) in cases {
        let compiled = with(Options::new().model("A").method("gonzalez"), &format!("{WALL}{text}"));
        let (u, _) = emit(&compiled, h).unwrap_or_else(|e| panic!("{name}: {e}"));
        // Lanes begin where nothing is foretold, and so go by the form that goes on as well.
        assert_eq!(u.lane_forms.len(), if name == "an iteration" { 2 } else { u.lane_forms.len().max(1) }, "{name}");
        for flags in [&["-O3", "-march=native"][..], &["-O3", "-march=native", SINGLE], &["-O2"]] {
            assert_eq!(lanes(&u, flags), 0.0, "{name}");
        }
    }
}

/// A lane that fails stands still, and the others go on.
#[test]
fn lanes_that_fail_stand_still() {
    if !is_there() {
        return;
    }
    let text = "model A { input left = 1 N Se:u = (1 N) * sqrt(left/(1 N) + 0.55)  I:m = 1 kg  C:s { e = q^3 * (1 N/m^3) }  1:v -> m, s  u -> v
        probe f = m.f }";
    let compiled = with(Options::new().model("A"), text);
    let (u, _) = emit(&compiled, 1e-2).unwrap_or_else(|e| panic!("{e}"));
    let [double, single] = [&["-O3"][..], &["-O3", SINGLE]].map(|flags| lanes(&u, flags));
    assert!(double > 0.0 && double < 64.0 && single > 0.0, "{double} and {single} of 64 lanes fail");
}
