//! C and object files: what is written, and that it does what `models/embed/` says it does.

use super::{Folder, OSCILLATOR, is_there, model, ran};

/// What `haptic.c` and `haptic.py` print.
#[track_caller]
fn felt(text: &str) {
    for part in ["after 5.000 s the handle is at 0.0120", "feels 2.000000 N", "put back, it is at 2.501 s again"] {
        assert!(text.contains(part), "{part}: {text}");
    }
}

#[test]
fn the_haptic_loop_runs_around_both() {
    let here = Folder::new();
    for name in ["embed/haptic.c", "embed/haptic.mjs", "embed/haptic.py", "embed/many.c", "examples/open_port.bond"] {
        let path = here.0.join("models").join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::copy(model(name), path).unwrap();
    }
    let module = ["build", "models/examples/open_port.bond", "--emit", "wasm", "-o", "wall.wasm"];
    here.bond(&module).is(0, &[], &["built wall.wasm", "0.001 s, 1 open port, 0 inputs, 2 probes"]);
    if is_there("node") {
        felt(&ran(&here, "node", &["models/embed/haptic.mjs", "wall.wasm"]));
    }
    let built = here.bond(&["build", "models/examples/open_port.bond", "--emit", "c", "-o", "wall.c"]);
    assert_eq!(built.is(0, &[], &["built wall.c and wall.h", "0.001 s, 1 open port, 0 inputs, 2 probes"]).out, "");
    if !is_there("cc") {
        return;
    }
    // As the files say.
    let c = ["-std=c99", "-O2", "-I.", "wall.c", "models/embed/haptic.c", "-lm", "-o", "haptic"];
    ran(&here, "cc", &c);
    let text = ran(&here, "./haptic", &[]);
    felt(&text);
    let some = "-DBOND_LANES=64";
    for flags in [&["-O3", "-march=native", some][..], &["-O2", "-DBOND_SIMD=0", some], &["-O2", "-DBOND_LANES=8"]] {
        let many = ["-std=c99", "-ffp-contract=off", "-I.", "wall.c", "models/embed/many.c", "-lm", "-o", "many"];
        ran(&here, "cc", &[flags, &many].concat());
        let text = ran(&here, "./many", &[]);
        assert!(
            text.contains("handles are between 0.01200 m and")
                || text.contains("between 0.0120 and 0.0120 m at 5.000 s"),
            "{text}"
        );
        assert!(text.contains("the first one has the same bits as alone"), "{text}");
    }
    #[cfg(feature = "native")]
    {
        let emit = ["build", "models/examples/open_port.bond", "--emit", "object", "-o", "wall.o"];
        std::fs::remove_file(here.0.join("wall.h")).unwrap();
        here.bond(&emit).is(0, &[], &["built wall.o and wall.h"]);
        let object = ["-std=c99", "-O2", "-I.", "wall.o", "models/embed/haptic.c", "-lm", "-o", "object"];
        ran(&here, "cc", &object);
        assert_eq!(ran(&here, "./object", &[]), text);
    }
    if is_there("python3") {
        ran(&here, "cc", &["-std=c99", "-O2", "-shared", "-fPIC", "wall.c", "-lm", "-o", "wall.so"]);
        felt(&ran(&here, "python3", &["models/embed/haptic.py", "wall.so", "wall.h"]));
    }
}

/// A method of several stages solves for more than eight unknowns; modules take it.
#[test]
fn a_method_of_many_unknowns_is_emitted() {
    let charger = "use std.electrical
model Charger {
  SineVoltage:ac(amplitude = 20 V)
  Inductor:coil(L = 1 mH, R = 0.2 Ohm)
  Diode:d
  C:bat { compliance = 10 F; e0 = 12 V }
  ac.out -> 1:m -> coil.p, d.p, bat
}
";
    let here = Folder::new().with("charger.bond", charger);
    for (form, file) in [("c", "charger.c"), ("object", "object.o"), ("wasm", "charger.wasm")] {
        let build = ["build", "charger.bond", "--step", "10us", "--method", "radau", "--emit", form, "-o", file];
        here.bond(&build).is(0, &[], &["built"]);
    }
}

/// Two clocks in no whole ratio, joined by a double bar, are not what emitted code does.
#[test]
fn clocks_in_no_whole_ratio_are_refused() {
    let two = |slow: &str| {
        format!(
            "model Two {{
               sampled every 2 ms {{ I:m {{ inertia = 1 kg; f0 = 1 m/s }}  1:v -> m }}
               sampled every {slow} {{ C:k = 1 mm/N  1:w -> k }}
               v ||> w  probe x = k.q  simulate {{ stop = 0.1 s }} }}"
        )
    };
    let here = Folder::new().with("odd.bond", two("3 ms")).with("even.bond", two("4 ms"));
    here.bond(&["build", "odd.bond", "--emit", "c", "-o", "odd.c"]).is(1, &[], &["no whole ratio", "--emit exe"]);
    here.bond(&["build", "even.bond", "--emit", "c", "-o", "even.c"]).is(0, &[], &[]);
}

#[test]
fn files_go_where_they_are_told() {
    let here = Folder::new().with("my first.model.bond", OSCILLATOR).with("out/x", "").with("a.h", OSCILLATOR);
    let file = "my first.model.bond";
    here.bond(&["build", file, "--emit", "c", "--step", "1ms"]).is(
        0,
        &[],
        &["built my first.model.c and my first.model.h"],
    );
    here.bond(&["build", file, "--emit", "c", "-o", "out/1.c", "--prefix", "osc", "--step", "1ms"]).is(0, &[], &[]);
    let source = here.read("out/1.c");
    assert!(source.contains("#include \"1.h\"") && source.contains("int osc_commit("), "{source}");
    assert!(here.read("out/1.h").contains("#define OSC_PROBE_X 0"));
    assert_eq!(here.list(), ["a.h", "my first.model.bond", "my first.model.c", "my first.model.h", "out"]);
    // The same bytes again.
    here.bond(&["build", file, "--emit", "c", "-o", "out/1.c", "--prefix", "osc", "--step", "1ms"]).is(0, &[], &[]);
    assert_eq!(here.read("out/1.c"), source);
    if is_there("cc") {
        ran(
            &here,
            "cc",
            &["-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-c", "my first.model.c", "-o", "a.o"],
        );
    }
    // Both or none.
    std::fs::create_dir(here.0.join("q.c")).unwrap();
    here.bond(&["build", file, "--emit", "c", "-o", "q.c", "--step", "1ms"]).is(2, &[], &["q.c: it is a directory"]);
    assert!(!here.list().contains(&"q.h".to_string()));
    std::fs::remove_dir(here.0.join("q.c")).unwrap();
    let wrong: [(&[&str], &str); 7] = [
        (&["-o", "-"], "does not go to standard output: give a name with -o"),
        (&["-o", "wall"], "name it wall.c"),
        (&["-o", "wall.h"], "name it wall.h.c"),
        (&["-o", "nowhere/wall.c"], "cannot write nowhere/wall.h"),
        (&["-o", "a\"b.c"], "no C compiler finds a header of that name"),
        (&["--prefix", "1x"], "--prefix 1x: it must be a name in C"),
        (&["--prefix", ""], "it must be a name in C"),
    ];
    for (args, why) in wrong {
        here.bond(&[&["build", file, "--emit", "c"], args].concat()).is(2, &[], &[why]);
    }
    here.bond(&["build", "a.h", "--emit", "c"]).is(2, &[], &["a.h: it is the model itself"]);
    assert_eq!(here.read("a.h"), OSCILLATOR);
    here.fed(&["build", "-", "--emit", "c", "--step", "1ms"], OSCILLATOR).is(
        0,
        &[],
        &["built Oscillator.c and Oscillator.h"],
    );
    here.bond(&["build", file, "--step", "1ms"]).is(2, &[], &["--step and --prefix are not for executables"]);
}

/// The header of C and that of an object differ: who compiled against the wrong one would not be told.
#[test]
fn a_header_goes_with_its_kind() {
    let here = Folder::new().with("a.bond", OSCILLATOR);
    let build = |kind: &str, to: &str| here.bond(&["build", "a.bond", "--emit", kind, "--step", "1ms", "-o", to]);
    build("c", "a.c").is(0, &[], &[]);
    build("c", "a.c").is(0, &[], &[]);
    let header = here.read("a.h");
    build("object", "a.o").is(2, &[], &["a.h goes with C: name an object otherwise with -o"]);
    assert_eq!((here.read("a.h"), here.list().len()), (header, 3));
    build("object", "b.o").is(0, &[], &[]);
    build("c", "b.c").is(2, &[], &["b.h goes with an object: name C otherwise with -o"]);
}

#[test]
fn what_has_no_compiled_form_is_told() {
    let curved = "model A { C:s { H = (1 N/m^3)*q^4; q0 = 1 m } I:m = 1 kg 1:v -> s, m simulate { stop = 1 s } }";
    let here = Folder::new().with("a.bond", curved);
    here.bond(&["build", "a.bond", "--emit", "c"]).is(1, &[], &["takes fixed steps: give one with --step"]);
    assert_eq!(here.list(), ["a.bond"]);
    here.bond(&["build", "a.bond", "--emit", "c", "--step", "0"]).is(2, &[], &["longer than 0 s"]);
    // Periods with a common measure, and a source that switches, have one; `exact` has none then.
    let file = |name: &str| model(name).to_str().unwrap().to_string();
    let told = ["built r.c and r.h: intervals of 0.002 s"];
    here.bond(&["build", &file("examples/two_rates.bond"), "--emit", "c", "-o", "r.c"]).is(0, &[], &told);
    let car = file("examples/quarter_car.bond");
    here.bond(&["build", &car, "--emit", "c", "-o", "q.c"]).is(0, &[], &["built q.c"]);
    let exact = ["build", &car, "--emit", "c", "-o", "e.c", "--method", "exact"];
    here.bond(&exact).is(1, &[], &["switches inside exact steps"]);
    let rates = model("hard/irrational_rates.bond");
    here.bond(&["build", rates.to_str().unwrap(), "--emit", "c"]).is(1, &[], &["have no common measure"]);
    // Iterations of many unknowns have every form.
    let stages = "model S { Se:s = 2 V + 1 V * sin(60 Hz * t)  R:r = 2 Ohm  R:d { f = 1e-3 A * (exp(e/(1 V)) - 1) }
  I:l { H = p^2/(2*10 mH) + 1e3 J/Wb^4 * p^4 }  C:c { H = q^2/(2*100 uF) + 3e9 J/C^4 * q^4 }
  state z = 0 V { dz = (out.e - z)/(2 ms) }  s -> 1:m -> l, r  m -> 0:out -> c, d  probe i = m.f }";
    let here = here.with("s.bond", stages);
    for method in ["collocation6", "collocation8"] {
        for (form, ending) in [("c", "c"), ("object", "o"), ("wasm", "wasm")] {
            let file = format!("{method}_{form}.{ending}");
            let build = ["build", "s.bond", "--emit", form, "--step", "1ms", "--method", method, "-o", &file];
            here.bond(&build).is(0, &[], &["built "]);
        }
    }
}

/// What switches within steps, where a run would meet it, is named; not where steps end there, nor of what runs itself.
#[test]
fn what_switches_within_steps_is_named() {
    let pwm = "model P { Se:u = if mod(t, 200 us) < 66 us then 24 V else 0  I:l = 2 mH  R:r = 1 Ohm  u -> 1:i -> l, r
  probe cur = i.f  simulate { stop = 20 ms; step = 20 us } }";
    let wall =
        "model W { C:c { H = if q > 0 then 0.5*(1 N/m)*q^2 else 0; q0 = -1 m }  I:m { inertia = 1 kg; p0 = 1 N*s }
  R:b { e = tanh(f/(1 m/s))*(1 N) }  1:v -> c, m, b  probe x = c.q SIMULATE }";
    let here = Folder::new()
        .with("p.bond", pwm)
        .with("w.bond", wall.replace("SIMULATE", "simulate { stop = 1 s }"))
        .with("f.bond", wall.replace("SIMULATE", "simulate { stop = 1 s; step = 1 ms }"));
    let build = |file: &str, more: &[&str]| here.bond(&[&["build", file], more].concat()).is(0, &[], &["built "]).err;
    let timed = "note: `u` switches within steps: bond run meets these instants, where its step is not given; what is built does not; take a step";
    for emit in ["c", "fmu", "wasm"] {
        let told = build("p.bond", &["--emit", emit]);
        assert!(told.contains(timed), "{told}");
    }
    let told = build("p.bond", &["--emit", "c", "--step", "2us"]);
    assert!(
        !told.contains("within steps") && told.contains("stepped by gonzalez here, and by exact in bond run"),
        "{told}"
    );
    for (file, more) in [("p.bond", &[][..]), ("f.bond", &["--emit", "c"])] {
        let told = build(file, more);
        assert!(!told.contains("note: "), "{file} {more:?}: {told}");
    }
    let told = build("w.bond", &["--emit", "c", "--step", "1ms"]);
    assert!(told.contains("note: `c` may switch within") && told.contains("keep steps short"), "{told}");
}
