use super::{Folder, OSCILLATOR, WRONG};

#[test]
fn good_models_are_counted() {
    let here = Folder::new().with("a.bond", OSCILLATOR);
    let done = here.bond(&["check", "a.bond"]).is(0, &[], &["ok: a.bond (Oscillator: 1 region, 2 states)"]);
    assert_eq!(done.out, "");
    here.fed(&["check", "-"], OSCILLATOR).is(0, &[], &["ok: <stdin>"]);
}

/// What means something that nobody may have meant is said, and no error.
#[test]
fn notes_are_made() {
    let volt =
        "model A { Se:F = 10 N; I:m = 1 kg; De:gauge; F -> 1:v -> m, gauge; probe x = v.f; simulate { stop = 1 s } }";
    let here = Folder::new()
        .with("a.bond", volt)
        .with("b.bond", "model B { Sf:i = 1 A; C:c = 1 F; Df:meter; i -> 0:n -> c, meter }")
        .with("c.bond", "model Loose { Se:u = 10 V; R:r = 1 Ohm; R:q = 2 Ohm; u -> 1:j -> r; 1:k -> q }");
    let a = "note: the detector `gauge` holds the flow of `m` at 0: a De stands on a 0-junction";
    here.bond(&["check", "a.bond"]).is(0, &[], &["ok: a.bond", a]);
    here.bond(&["run", "a.bond"]).is(0, &[], &[a]);
    let b = "note: the detector `meter` holds the effort of `c` at 0: a Df stands on a 1-junction";
    here.bond(&["check", "b.bond"]).is(0, &[], &[b]);
    here.bond(&["check", "c.bond"]).is(0, &[], &["note: nothing gives power to `q`"]);
    let still = "model Still { sampled at 100 Hz method ray { I:m { inertia = 1 kg; f0 = 1 m/s }  C:k = 1 m/N  1:v -> m, k }  probe x = k.q }";
    let unloaded = "model Still { sampled at 100 Hz method ray { C:k = 1 m/N }  I:m = 1 kg  Se:u = 2 N  u -> 1:w -> m  w ||> k  probe x = k.q }";
    let here = here.with("r.bond", still).with("s.bond", unloaded);
    here.bond(&["check", "r.bond"]).is(0, &[], &["note: `ray` does not move in the region of `m.p`"]);
    here.bond(&["run", "s.bond"]).is(
        0,
        &[],
        &["note: `ray` cannot raise H from a state where dH/dx is 0, and `k.q` starts"],
    );
    let shut = "model Shut { I:m { inertia = 1 kg; f0 = 1 m/s }  1:v -> m
        sampled at 100 Hz { active R:n = -0.3 N*s/m  C:k = 1 m/N  1:w -> n, k }  v ||> w  probe x = k.q }";
    let here = here.with("e.bond", shut).with("f.bond", shut.replace("Hz {", "Hz budget off {"));
    here.bond(&["check", "e.bond"]).is(
        0,
        &[],
        &["note: the energy budget of the sampled region of `n` gives out only"],
    );
    assert!(!here.bond(&["check", "f.bond"]).is(0, &[], &[]).err.contains("note"));
    // A double pendulum whose strokes ask for the sideways speeds of its masses, not for its joints' turning.
    let arm = "model Arm { C:q1 { H = 0; q0 = 1.2 rad }  C:q2 { H = 0; q0 = 2 rad }  1:w1 -> q1  1:w2 -> q2
        I:x1 = 1 kg  I:y1 = 1 kg  I:x2 = 1 kg  I:y2 = 1 kg
        MTF:a1 = 1 m * cos(q1.q)  MTF:b1 = 1 m * sin(q1.q)  MTF:a2 = 1 m * cos(q2.q)  MTF:b2 = 1 m * sin(q2.q)
        w1 -> a1 -> 1:u1 ->| x1  w1 -> b1 -> 1:v1 -> y1  w2 -> a2 -> 0:s ->| x2  u1 -> s  w2 -> b2 -> 0:z -> y2  v1 -> z }";
    let here = here.with("g.bond", arm).with("h.bond", arm.replace("->|", "->"));
    here.bond(&["check", "g.bond"]).is(0, &[], &["by a division by `cos(q2.q)`: where it is 0"]);
    assert!(!here.bond(&["check", "h.bond"]).is(0, &[], &[]).err.contains("division"));
    let done = here.with("d.bond", OSCILLATOR).bond(&["check", "d.bond"]).is(0, &[], &["ok: d.bond"]);
    assert!(!done.err.contains("note"), "{}", done.err);
}

/// A detector on the other junction is noted whatever it holds: a state that it gives no rate, in a part too.
#[test]
fn held_rates_are_noted() {
    let volts = "model Cell { port p  Se:u = 1 V  R:r = 1 Ohm  C:c = 1 F  De:volts  u -> 1:i -> r, c, p  i -> volts }
        model A { Cell:cell  R:load = 1 Ohm  cell.p -> load  probe v = cell.c.e }";
    let amps = "model B { Sf:u = 1 A  R:r = 1 Ohm  I:l = 1 H  Df:amps  u -> 0:n -> r, l  n -> amps  probe i = l.f }";
    let here = Folder::new().with("a.bond", volts).with("b.bond", amps);
    let a = "note: the detector `cell.volts` holds the flow of `cell.c` at 0: a De stands on a 0-junction";
    here.bond(&["check", "a.bond"]).is(0, &[], &[a]);
    let b = "note: the detector `amps` holds the effort of `l` at 0: a Df stands on a 1-junction";
    here.bond(&["run", "b.bond"]).is(0, &[], &[b]);
}

/// A probe with the name of the time has another column, and keeps its name elsewhere.
#[test]
fn columns_of_other_names_are_noted() {
    let model = "model M { I:m = 1 kg  Se:F = 1 N  F -> m  probe t = m.p  probe t_ = 2*m.f  simulate { stop = 2 s } }";
    let here = Folder::new().with("a.bond", model);
    let notes =
        ["note: the column of the probe `t` is `t_` in the table", "note: the column of the probe `t_` is `t__` in"];
    here.bond(&["check", "a.bond"]).is(0, &[], &notes);
    here.bond(&["run", "a.bond", "-o", "a.csv"]).is(0, &[], &notes);
    assert!(here.read("a.csv").starts_with("t,t_,t__\n"));
}

#[test]
fn all_errors_of_all_files_come_out() {
    let here = Folder::new().with("a.bond", WRONG).with("b.bond", "model B { I:m = }").with("c.bond", OSCILLATOR);
    let done = here.bond(&["check", "a.bond", "b.bond", "c.bond"]);
    done.is(1, &[], &["a.bond:3:", "a.bond:4:", "b.bond:1:", "ok: c.bond"]);
}

#[test]
fn json_has_one_object_a_line() {
    let here = Folder::new().with("a.bond", WRONG);
    let done = here.bond(&["check", "a.bond", "--message-format", "json"]).is(1, &[], &[]);
    let lines: Vec<serde_json::Value> = done.out.lines().map(|l| serde_json::from_str(l).unwrap()).collect();
    assert!(lines.len() >= 2);
    for d in &lines {
        assert_eq!(d["file"], "a.bond");
        assert_eq!(d["severity"], "error");
        assert!(d["code"].as_str().unwrap().contains("::"));
        assert!(d["line"].as_u64().unwrap() >= 3 && d["column"].as_u64().unwrap() >= 1);
        assert!(d["end_line"].is_u64() && d["end_column"].is_u64() && d["labels"].is_array());
    }
    let done = here.bond(&["check", "none.bond", "--message-format", "json"]).is(2, &["file::read"], &[]);
    assert_eq!(done.out.lines().count(), 1);
}

/// A byte order mark is no character of the first line.
#[test]
fn a_byte_order_mark_moves_no_column() {
    let here = Folder::new().with("a.bond", "\u{feff}model A { Se:u = 1 kgg; R:r = 1 Ohm; u -> r }\n");
    here.bond(&["check", "a.bond"]).is(1, &[], &["a.bond:1:20"]);
    here.bond(&["check", "a.bond", "--message-format", "json"]).is(1, &["\"line\":1,\"column\":20"], &[]);
}

/// The status is that of the models, whoever reads what is said of them.
#[test]
fn a_closed_pipe_does_not_make_it_good() {
    let here = Folder::new().with("a.bond", WRONG).with("b.bond", OSCILLATOR);
    assert_eq!(here.unread(&["check", "a.bond", "--message-format", "json"]), (Some(1), String::new()));
    assert_eq!(here.unread(&["check", "none.bond", "--message-format", "json"]).0, Some(2));
    let (status, told) = here.unread(&["check", "a.bond", "b.bond", "--message-format", "json"]);
    assert!(status == Some(1) && told.contains("ok: b.bond"), "{told}");
    assert_eq!(here.unread(&["check", "b.bond"]).0, Some(0));
    let here = here.with("c.bond", "model   C { }");
    assert_eq!(here.unread(&["fmt", "--check", "c.bond", "b.bond"]), (Some(1), String::new()));
}

#[test]
fn used_files_are_named_as_the_user_wrote_them() {
    let here = Folder::new()
        .with("parts/wheel.bond", "model Wheel { port p\n I:m = 1 kg\n p -> 1:v -> m, nothere }\n")
        .with("car.bond", "use \"parts/wheel.bond\"\nmodel Car { Wheel:w\n Se:F = 1 N\n F -> w.p }\n");
    here.bond(&["check", "car.bond"]).is(1, &[], &["parts/wheel.bond:3:"]);
    let here = Folder::new()
        .with("a.bond", "use \"sub/b.bond\"\nmodel A { }\n")
        .with("sub/b.bond", "use \"../a.bond\"\nmodel B { }\n");
    here.bond(&["check", "a.bond"]).is(1, &[], &["cyclic use: a.bond uses sub/b.bond uses a.bond", "sub/b.bond:1:"]);
    here.bond(&["check", "./sub/../a.bond"]).is(1, &[], &["cyclic use"]);
    let here = Folder::new().with("a.bond", "use \"none.bond\"\nuse \".\"\nmodel A { }\n");
    here.bond(&["check", "a.bond"]).is(1, &[], &["a.bond:1:", "there is no such file", "a.bond:2:", "directory"]);
}

#[test]
fn labels_at_the_end_of_the_text_are_drawn() {
    for text in [
        "model A {",
        "model",
        "model A { I:m = 1 kg",
        "model A { ä",
        "model A { I:m = \"",
        "\u{feff}",
        "//",
        "model A {\r\n",
    ] {
        let here = Folder::new().with("a.bond", text);
        here.bond(&["check", "a.bond"]).is(1, &[], &["a.bond"]);
    }
}

#[test]
fn places_in_other_files_are_drawn_too() {
    let here =
        Folder::new().with("source.bond", "model Belt {\n  port out\n  Sf:belt = 1 m/s\n  belt -> out\n}\n").with(
            "a.bond",
            "use \"source.bond\"\nmodel A {\n  Belt:b\n  Sf:hand = 1 m/s\n  hand -> 1:v\n  b.out -> v\n}\n",
        );
    here.bond(&["check", "a.bond"]).is(
        1,
        &[],
        &["causality::conflict", "a.bond:", "see source.bond", "source.bond:3:"],
    );
}

/// A start that does not go with a source is told by the numbers as they are written.
#[test]
fn starts_beside_sources() {
    let text = "model S {\n  Se:u = 3 V\n  C:b { compliance = 0.5 F; e0 = 3 V }\n  C:d { compliance = 0.5 F; q0 = 1 C }\n  \
                u -> 0:n -> b, d\n  probe q = b.q\n}\n";
    let here = Folder::new().with("s.bond", text);
    here.bond(&["check", "s.bond"]).is(1, &[], &["which gives it 3 V where 2 V is stated"]);
}

#[test]
fn a_file_of_functions_alone_is_fine() {
    let here = Folder::new().with("f.bond", "let f(x) = x^2\nlet g(x, y) = x + y\n").with("u.bond", "use \"f.bond\"\n");
    here.bond(&["check", "f.bond"]).is(0, &[], &["ok: f.bond (no model; functions: f, g)"]);
    here.bond(&["check", "f.bond", "--model", "M"]).is(2, &[], &["there is no model `M`"]);
    here.bond(&["check", "u.bond"]).is(1, &[], &["there is no model in this file"]);
    here.bond(&["run", "f.bond"]).is(1, &[], &["there is no model in this file"]);
}

/// What the structure says that the author may not know, by the names of his elements: derivative causality, a storage
/// that a source alone moves, an algebraic loop. Each once, and a model without them has none.
#[test]
fn structure_is_noted() {
    let geared = "model G { Se:u = 12 N*m  I:motor = 1 kg*m^2  TF:gear = 1/3  I:load = 2 kg*m^2
        u -> 1:a -> motor, gear  gear -> 1:b -> load  probe w = b.f }";
    let across = "use std.electrical
        model A { VoltageSource:battery  Capacitor:c  Resistor:r  battery.out -> 0:n -> c.p, r.p  probe u = n.e }";
    let driven = "model D { Sf:spin = 3 A  I:l1 = 1 H  I:l2 = 2 H  spin -> 1:v -> l1, l2  probe w = v.f }";
    let divider = "model L { Se:u = 12 V  R:a = 1 Ohm  R:b = 2 Ohm  R:c = 2 Ohm  C:k = 1 F
        u -> 1:i -> a, 0:n  n -> b  n -> 1:j -> c, k  probe w = k.e }";
    let curved = divider.replace("R:b = 2 Ohm", "R:b { e = 1 Ohm*f + 1 V/A^3*f^3 }");
    let here = Folder::new()
        .with("g.bond", geared)
        .with("a.bond", across)
        .with("d.bond", driven)
        .with("l.bond", divider)
        .with("c.bond", curved);
    let g = "note: `load` is in derivative causality: it follows `motor` rigidly, which is computed exactly";
    let done = here.bond(&["check", "g.bond"]).is(0, &[], &["ok: g.bond", g]);
    assert_eq!(done.err.matches("note").count(), 1, "{}", done.err);
    // It is no news in each run.
    assert!(!here.bond(&["run", "g.bond"]).is(0, &[], &[]).err.contains("derivative"));
    let a = "note: `c.charge` is across the source `battery.voltage`, with nothing between: it has no state";
    here.bond(&["check", "a.bond"]).is(0, &[], &[a, "real sources have an R between"]);
    let d = "note: `l1` and `l2` have the flow of the source `spin`, with nothing between: they have no state";
    let done = here.bond(&["check", "d.bond"]).is(0, &[], &[d]);
    assert_eq!(done.err.matches("note").count(), 1, "{}", done.err);
    let l = "note: `a`, `b` and `c` determine one another at each instant (an algebraic loop), which is solved exactly";
    here.bond(&["check", "l.bond"]).is(0, &[], &[l]);
    here.bond(&["check", "c.bond"]).is(0, &[], &["(an algebraic loop), which is solved by iteration"]);
}

/// A model that stands last is the scene: where another one may be meant, that is said, with a wrong scene too.
#[test]
fn the_other_scene_is_noted() {
    let scene = "model Scene { Se:u = 4 V  Load:load  u -> load.p  probe i = load.p.f  simulate { stop = 2 s } }";
    let load = "model Load(r = 2 Ohm) { port p  R:a = r  p -> a }";
    let alone = "model Second { Se:w = 4 V  R:a = 2 Ohm  w -> a  probe i = a.f }";
    let here = Folder::new()
        .with("last.bond", format!("{scene}\n{load}"))
        .with("wrong.bond", format!("{scene}\n{}", load.replace(" = 2 Ohm", "")))
        .with("two.bond", format!("{load}\n{scene}\n{alone}"))
        .with("right.bond", format!("{load}\n{scene}"));
    let note =
        "note: `Load` is the scene because it stands last in its file; `--model Scene` takes `Scene`, which uses it";
    here.bond(&["check", "last.bond"]).is(0, &[], &[note]);
    here.bond(&["run", "last.bond"]).is(0, &[], &[note]);
    here.bond(&["check", "wrong.bond"]).is(1, &[], &["the parameter `r` has no value", note]);
    here.bond(&["run", "wrong.bond"]).is(1, &[], &["the parameter `r` has no value", note]);
    let note = "note: `Second` is the scene because it stands last in its file; `--model Scene` takes `Scene`";
    here.bond(&["check", "two.bond"]).is(0, &[], &[note]);
    for args in [&["check", "right.bond"][..], &["check", "last.bond", "--model", "Scene"]] {
        assert!(!here.bond(args).is(0, &[], &[]).err.contains("note"));
    }
}

/// A name of the model that is read as a unit, where nothing else shows which is meant.
#[test]
fn names_that_are_units_are_noted() {
    let model = |probe: &str| {
        format!(
            "model M(m = 3 kg, l = 2 L) {{ Se:u = 1 N  I:i = m  u -> 1:v -> i  probe x = integral(v.f, -1 m)  probe y = {probe} }}"
        )
    };
    let here =
        Folder::new().with("a.bond", model("6 N*m")).with("b.bond", model("6 N * m")).with("c.bond", model("2 l"));
    let a = "note: line 1: `m` in `6 N*m` is read as a unit; if the name is meant, write `6 N * m`";
    here.bond(&["check", "a.bond"]).is(0, &[], &[a]);
    assert!(!here.bond(&["check", "b.bond"]).is(0, &[], &[]).err.contains("note"));
    here.bond(&["check", "c.bond"]).is(0, &[], &["note: line 1: `l` in `2 l` is read as a unit"]);
}
