//! The flat model: instances, loops, conditions, parameters, units.

use crate::common::{example, text, with};
use bond::Options;
use bond::internal::CompiledInternals;
use bond_compiler::elaborate::Loader;
use bond_compiler::model::ExpectationKind;
use bond_grammar::source::Sources;

#[test]
fn graphs() {
    for (name, scene) in
        [("virtual_wall", "VirtualWall"), ("rc_ladder", "RcLadder"), ("crane", "Crane"), ("two_rates", "TwoRates")]
    {
        insta::assert_snapshot!(format!("graph_{name}"), example(name, scene).show("graph"));
    }
}

#[test]
fn regions() {
    for (name, scene) in [
        ("virtual_wall", "VirtualWall"),
        ("two_computers", "TwoComputers"),
        ("open_port", "Device"),
        ("sampled_mass", "SampledMass"),
    ] {
        insta::assert_snapshot!(format!("regions_{name}"), example(name, scene).show("regions"));
    }
}

#[test]
fn a_graph_as_json_names_all() {
    let compiled = example("virtual_wall", "VirtualWall");
    let json = compiled.show_as("graph", "json").unwrap_or_else(|e| panic!("{e}"));
    let value: serde_json::Value = serde_json::from_str(&json).unwrap_or_else(|e| panic!("{e}"));
    for name in ["hand", "handle", "wall.spring", "wall.damper", "wall.contact"] {
        assert!(value.to_string().contains(&format!("\"{name}\"")), "{name} is missing in {json}");
    }
}

/// In a round, a value that is not picked may name what is beyond the ends.
#[test]
fn ends_of_a_row() {
    let row = text(
        "model M(n = 3, first = 4 N) {
            for i in 1..n {
                C:c[i] { stiffness = 1 N/m; q0 = 1 m }
                R:r[i] = 1 N*s/m
                1:v[i] -> c[i], r[i]
                probe before = if i == 1 then first else c[i-1].e
                probe after = if i < n then c[i+1].e else 0
            }
        }",
    );
    let mut sim = crate::common::start(&row, bond::Steps::fixed(0.1));
    let values = ["before[1]", "before[2]", "after[2]", "after[3]"].map(|x| crate::common::probe(&mut sim, x));
    assert_eq!(values, [4.0, 1.0, 1.0, 0.0]);
}

/// The order of declaration does not matter to what is computed.
#[test]
fn order_of_declaration() {
    let a = text("model M { I:m = 2 kg C:c { stiffness = 8 N/m; q0 = 1 m } 1:v -> m, c probe x = c.q }");
    let b = text("model M { probe x = c.q v -> c, m 1:v C:c { q0 = 1 m; stiffness = 8 N/m } I:m = 2 kg }");
    for c in [&a, &b] {
        let x = crate::common::end(c, bond::Steps::fixed(0.1), 1.0, "x");
        crate::common::close(x, 2.0f64.cos(), 1e-14, "x");
    }
}

/// Which unknowns a loop of exponentials is solved for follows the order of declaration; that it is solved does not.
#[test]
fn order_of_declaration_in_loops() {
    let text = crate::common::read(&crate::common::models().join("examples/transistor_amplifier.bond"));
    let resistors: Vec<&str> = text.lines().filter(|l| l.trim_start().starts_with("R:r")).collect();
    assert_eq!(resistors.len(), 10);
    for r in resistors {
        let without = text.replace(&format!("{r}\n"), "");
        for before in ["  Se:signal", "  probe y1"] {
            let moved = without.replace(before, &format!("{r}\n{before}"));
            let compiled = with(Options::new(), &moved);
            let y = crate::common::end(&compiled, bond::Steps::fixed(2e-5), 0.01, "y8");
            let wanted = crate::common::end(&with(Options::new(), &text), bond::Steps::fixed(2e-5), 0.01, "y8");
            crate::common::close(y, wanted, 1e-9, &format!("y8 with `{r}` before `{before}`"));
        }
    }
}

/// Parameters from outside, with unit and without, of the scene and of an instance.
#[test]
fn parameters_from_outside() {
    let model = "model Spring(k = 1 N/m) { port end  C:c { stiffness = k;  q0 = 1 m }  end -> c }
      model M(m = 1 kg) { I:mass = m  Spring:s  1:v -> mass  v -> s.end  probe x = s.c.q }";
    for (m, k) in [("2", "8"), ("2000 g", "8 N/m"), ("2 kg", "0.08 N/cm")] {
        let compiled = with(Options::new().set("m", m).set("s.k", k), model);
        let x = crate::common::end(&compiled, bond::Steps::fixed(0.1), 1.0, "x");
        crate::common::close(x, 2.0f64.cos(), 1e-13, &format!("x with m = {m}, k = {k}"));
    }
    for (path, value, says) in [("s.q", "1", "s.q"), ("m", "1 s", "unit"), ("k", "1 N/m", "`k`")] {
        match Options::new().set(path, value).compile_str("m.bond", model) {
            Ok(_) => panic!("--set {path}={value} is taken"),
            Err(e) => assert!(e.to_string().contains(says), "{e}"),
        }
    }
}

/// Every unit of the language page, against SI.
#[test]
fn units() {
    for (literal, si) in [
        ("10 N", 10.0),
        ("1.5e3 kg*m^2", 1500.0),
        ("2 kOhm", 2000.0),
        ("40 ms", 0.04),
        ("1500 rpm", 50.0 * std::f64::consts::PI),
        ("45 deg", std::f64::consts::FRAC_PI_4),
        ("3 rad", 3.0),
        ("2 bar", 2e5),
        ("6 L/min", 1e-4),
        ("5 min", 300.0),
        ("2 h", 7200.0),
        ("36 km/h", 10.0),
        ("25 Hz", 25.0),
        ("470 nF", 470e-9),
        ("3 kg*m/s^2", 3.0),
        ("5 m^(1/2)", 5.0),
    ] {
        let compiled = text(&format!("model M {{ Se:u = 1 V R:r = 1 Ohm u -> r probe x = {literal} }}"));
        let x = crate::common::end(&compiled, bond::Steps::fixed(0.5), 1.0, "x");
        crate::common::close(x, si, 1e-15 * si, literal);
    }
}

/// A name without an index may stand in a loop where one round alone declares it.
#[test]
fn names_of_one_round() {
    let compiled = text(
        "model M { Se:u = 6 V 0:i u -> i
         for k in 1..3 { if k == 2 { R:r = k * 1 Ohm i -> r } }
         for k in 1..1 { R:s = 1 Ohm i -> s }
         probe f = r.f + s.f }",
    );
    let f = crate::common::end(&compiled, bond::Steps::fixed(0.5), 1.0, "f");
    crate::common::close(f, 9.0, 1e-15, "f");
}

/// Loops may run as often as the limit says, and what follows them is there.
#[test]
fn all_rounds_that_are_allowed() {
    let compiled = text("model M { Se:u = 6 V for k in 1..4000000 { } R:r = 1 Ohm u -> r probe f = r.f }");
    assert_eq!(compiled.probes(), ["f"]);
}

/// A `let` that nothing uses is checked, and is no part of what runs.
#[test]
fn unused_lets_do_not_run() {
    let plain = "Se:u = 6 V C:c = 1 F u -> 1:i -> r, c R:r = 1 Ohm probe f = r.f";
    let without = text(&format!("model M {{ {plain} }}"));
    let with = text(&format!("model M {{ {plain} let x = integral(r.f, 0 C) + r.f * 1 s let y = x * 2 }}"));
    assert_eq!(without.show("all"), with.show("all"));
}

/// The instant of an expectation is any expression, also one that ends with a unit.
#[test]
fn instants_are_expressions() {
    let compiled = text(
        "model M { I:m = 1 kg Se:F = 1 N F -> m
         expect m.f at 0.5 s + 0.2 s = 0.7 m/s within 1 mm/s
         expect m.f at 2 * 0.5 s = 1 m/s within 1 mm/s
         expect m.f at 1 s - (0.5 s) = 0.5 m/s within 1 mm/s }",
    );
    let times: Vec<f64> = compiled
        .stages()
        .model
        .expectations
        .iter()
        .filter_map(|e| match e.kind {
            ExpectationKind::At { time, .. } => Some(time),
            ExpectationKind::Passive | ExpectationKind::PassiveAt(_) | ExpectationKind::Holds { .. } => None,
        })
        .collect();
    assert_eq!(times, [0.7, 1.0, 0.5]);
}

/// Files that need no folder.
struct Texts(&'static [(&'static str, &'static str)]);

impl Loader for Texts {
    fn load(&mut self, _: &str, path: &str) -> Result<(String, String), String> {
        let found = self.0.iter().find(|(name, _)| *name == path).ok_or("there is no such file")?;
        Ok((path.to_string(), found.1.to_string()))
    }
}

/// A name that two used files declare is wrong where it is used; what the file itself declares comes before, and a file
/// that is used on two ways is one file.
#[test]
fn names_of_several_files() {
    let files = &[
        ("a", "let f(x) = x let g(x) = x model P { port p R:r = 1 Ohm p -> r } model Q { port p R:r = 1 Ohm p -> r }"),
        ("b", "use \"a\" let f(x) = 2*x model P { port p R:r = 2 Ohm p -> r }"),
    ];
    let said = |text: &str| {
        let mut sources = Sources::new();
        let main = sources.add("main", text);
        let errors = bond_compiler::compile(&mut sources, main, &mut Texts(files), &bond_compiler::Options::default());
        errors.err().map_or(String::new(), |list| list.iter().map(|e| e.render(&sources)).collect())
    };
    let uses = "use \"a\" use \"b\" use \"a\"";
    for (own, body) in [
        ("", "Q:k"),
        ("model P { port p R:r = 3 Ohm p -> r }", "P:k"),
        ("let f(x) = 3*x", "Q:k let y = f(2)"),
        ("", "Q:k let f(x) = 4*x let y = f(2) + g(2)"),
    ] {
        let text = format!("{uses} {own} model M {{ Se:u = 1 V u -> k.p {body} }}");
        assert_eq!(said(&text), "", "{text}");
    }
    for (what, body) in [("`P` is a model", "P:k"), ("`f` is a function", "Q:k let y = f(2)")] {
        let text = said(&format!("{uses} model M {{ Se:u = 1 V u -> k.p {body} }}"));
        assert!(
            text.contains(what) && text.contains("\"a\" and \"b\"") && text.matches("error[").count() == 1,
            "{text}"
        );
    }
}

/// A start that is given as effort is found wherever the law has one, on the way to it not leaving where it has values.
#[test]
fn starts_by_effort() {
    for (law, e0, q) in [
        ("e = 1 V * log(1 + q/(1 C))", "-2 V", (-2f64).exp() - 1.0),
        ("e = 1 V * log(q/(1 C))", "-1 V", (-1f64).exp()),
        ("e = 1 V * log(q/(1 C))", "3 V", 3f64.exp()),
        ("e = 1 V * sqrt(1 + q/(1 C))", "0.5 V", -0.75),
        ("e = 1 V/C^3 * q^3 - 5 V", "0 V", 5f64.cbrt()),
        ("e = 1 V/C^3 * q^3", "8 V", 2.0),
        ("e = 1 V/C * (q - 0.3 C)", "0 V", 0.3),
        ("e = 1 V * tanh(q/(1 C))", "-0.5 V", (-0.5f64).atanh()),
        ("e = 1 V * tanh(q/(1 C))", "0.999 V", 0.999f64.atanh()),
        // Where the slope is 0, or ends; as good as at rest.
        ("e = 1 V/C^3 * q^3", "0 V", 0.0),
        ("e = 1 V * min(max(q/(2 C), -1), 1)", "1 V", 2.0),
        ("e = 0.3 V + 1 V/C * q^3/(1 C)^2", "0.3 V", 0.0),
        ("e = 0.1 V + 1 V * tanh(q/(1 C))", "0.1 V + 1e-17 V", 0.0),
    ] {
        let compiled = crate::common::text(&format!(
            "model S {{ C:c {{ {law}; e0 = {e0} }} R:r = 1 Ohm 0:n -> c, r probe q = c.q }}"
        ));
        let mut sim = crate::common::start(&compiled, bond::Steps::new());
        let found = crate::common::probe(&mut sim, "q");
        assert!((found - q).abs() <= 1e-12 * q.abs().max(1.0), "{law}, {e0}: {found}, {q}");
    }
}

/// The largest whole numbers have no opposite.
#[test]
fn powers_at_the_end_of_whole_numbers() {
    let compiled = crate::common::text(
        "model P { Se:u = 1 V R:r = 1 Ohm u -> r probe x = (-2)^(-127) probe y = (-2)^(-128) probe z = (-2)^(-63) }",
    );
    let mut sim = crate::common::start(&compiled, bond::Steps::new());
    let at = |sim: &mut bond::Simulation<'_>, name| crate::common::probe(sim, name);
    let found = ["x", "y", "z"].map(|name| at(&mut sim, name));
    assert_eq!(found, [-(0.5f64.powi(127)), 0.5f64.powi(128), -(0.5f64.powi(63))]);
}

/// A product has no more numbers than an array may have.
#[test]
fn products_are_not_larger_than_arrays() {
    let product = |n: usize| {
        let (column, row) = (vec!["[1]"; n].join(", "), vec!["1"; n].join(", "));
        format!(
            "model M {{ let a = [{column}] let b = [[{row}]] let m = a*b Se:u = m[1, {n}] * 1 V R:r = 1 Ohm u -> r }}"
        )
    };
    text(&product(100));
    let error = crate::common::errors(&product(101)).to_string();
    assert!(error.contains("this array has 10201 numbers, and may have 10000"), "{error}");
}
