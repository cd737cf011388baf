//! Mistakes of those who come from other tools, each with what is said of it, and the text in which that is followed.

use bond::{Compiled, Errors, Options};

/// A mistake: what was written, what the first error has to say, and the same with the advice followed.
struct Mistake {
    wrong: &'static str,
    said: &'static [&'static str],
    mended: &'static str,
}

const fn mistake(wrong: &'static str, said: &'static [&'static str], mended: &'static str) -> Mistake {
    Mistake { wrong, said, mended }
}

/// A model of a force on a mass, with further statements; what is not whole by itself begins with `model` or `use`.
fn text(statements: &str) -> String {
    match statements.starts_with("model") || statements.starts_with("use") {
        true => statements.to_string(),
        false => {
            format!("model M {{\n  Se:u = 5 N\n  I:m = 1 kg\n  u -> 1:v -> m\n  {statements}\n  probe y = v.f\n}}\n")
        }
    }
}

fn compile(statements: &str) -> Result<Compiled, Errors> {
    Options::new().compile_str("m.bond", text(statements))
}

#[rustfmt::skip]
const MISTAKES: &[Mistake] = &[
    // Units and numbers.
    mistake("simulate { stop = 5 }", &["`stop`", "write `5 s`"], "simulate { stop = 5 s }"),
    mistake("simulate { stop = 5 s; step = 1e-3 }", &["`step`", "write `1e-3 s`"], "simulate { stop = 5 s; step = 1e-3 s }"),
    mistake("expect y at 1 = 5 m/s within 1 m/s", &["the instant", "write `1 s`"], "expect y at 1 s = 5 m/s within 1 m/s"),
    mistake("R:b = 3\n  v -> b", &["`b`", "write `3 N*s/m`"], "R:b = 3 N*s/m\n  v -> b"),
    mistake("Se:w = 2*sin(2*pi*5 Hz*t)\n  w -> v", &["`w`", "write `2 N*sin(2*pi*5 Hz*t)`"], "Se:w = 2 N*sin(2*pi*5 Hz*t)\n  w -> v"),
    mistake("let a = sin(2*pi*50*t)", &["the argument of `sin`", "`sin(2*pi*50 Hz*t)`"], "let a = sin(2*pi*50 Hz*t)"),
    mistake("R:b = 3 N*sec/m\n  v -> b", &["`sec`", "the unit `s`"], "R:b = 3 N*s/m\n  v -> b"),
    mistake("let x = 2\n  Se:w = 6 kg*x*m/s^2\n  w -> v", &["`m` behind `x`, which is no unit", "`6 kg*m/s^2*x`"], "let x = 2\n  Se:w = 6 kg*m/s^2*x\n  w -> v"),
    mistake("let x = 2\n  let z = 6 kg*x/s", &["`s` behind `x`", "`6 kg/s*x`"], "let x = 2\n  let z = 6 kg/s*x"),
    mistake("C:k = 10 N/m\n  v -> k", &["`k`", "`C:k { stiffness = 10 N/m }`"], "C:k { stiffness = 10 N/m }\n  v -> k"),
    // Names.
    mistake("model M(R = 3 Ohm) { Se:u = 1 V; R:R = R; u -> R }", &["`R`", "`R:r`"], "model M(R = 3 Ohm) { Se:u = 1 V; R:r = R; u -> r }"),
    mistake("R:b = b\n  v -> b", &["names `b` itself", "a parameter by another name"], "let b0 = 2 N*s/m\n  R:b = b0\n  v -> b"),
    mistake("R:b = 2 N*s/m\n  v -> R:b", &["`b` is declared twice", "`b` without `R:`"], "R:b = 2 N*s/m\n  v -> b"),
    mistake("probe w = m.v", &["`m` has no signal `.v`", ".f (its flow: speed"], "probe w = m.f"),
    mistake("probe w = v.e", &["`v` has no signal `.e`", "such as `u.e`"], "probe w = u.e"),
    mistake("probe x = integral(v.f)", &["`integral(v.f, 0)`"], "probe x = integral(v.f, 0)"),
    mistake("L:l = 1 kg\n  v -> l", &["`L` (of `l`)", "an inductor is written `I:l`"], "I:l = 1 kg\n  v -> l"),
    mistake("K:k = 1 N/m\n  v -> k", &["`K` (of `k`)", "`C:k { stiffness = ... }`"], "C:k { stiffness = 1 N/m }\n  v -> k"),
    mistake("J0:n\n  v -> n", &["`J0` (of `n`)", "`0:n`"], "R:b = 1 N*s/m\n  v -> 0:n -> b"),
    // Statements of other tools.
    mistake("parameter Real k = 10 N/m;\n  C:c { stiffness = k }\n  v -> c", &["`model M(k = 10 N/m)`"], "let k = 10 N/m;\n  C:c { stiffness = k }\n  v -> c"),
    mistake("simulate(10 s)", &["settings stand in braces", "`simulate { stop = 10 s }`"], "simulate { stop = 10 s }"),
    mistake("C:k = 1 m/N\n  v -> k\n  k.q0 = 2 m", &["`C:k { compliance = 1 m/N; q0 = ... }`"], "C:k { compliance = 1 m/N; q0 = 2 m }\n  v -> k"),
    mistake("for i = 1:3 {\n    R:r[i] = 1 N*s/m\n    v -> r[i]\n  }", &["`for i in 1..3 { ... }`"], "for i in 1..3 {\n    R:r[i] = 1 N*s/m\n    v -> r[i]\n  }"),
    mistake("R:r[3] = 1 N*s/m\n  v -> r[3]\n  probe w = r(3).e", &["`r[3].e`"], "R:r[3] = 1 N*s/m\n  v -> r[3]\n  probe w = r[3].e"),
    mistake("if t > 1 s { let a = 1 } else { let a = 2 }", &["time is not known before the run", "`R:r = if t < 1 s then"], "let a = if t > 1 s then 1 else 2"),
    mistake("let a = if t < 1 s then 1", &["`else 0`"], "let a = if t < 1 s then 1 else 0"),
    mistake("model Circuit\n  Modelica.Electrical.Analog.Basic.Resistor R1(R=10);\nequation\n  der(x) = -x;\nend Circuit;\n", &["text of Modelica", "`R:R1 = 10 Ohm`"], "model Circuit {\n  Se:u = 1 V\n  R:R1 = 10 Ohm\n  u -> R1\n  state x = 1 { dx = -x/(1 s) }\n}"),
    mistake("use std.mechanics\nmodel M {\n  Mass m(m = 2 kg)\n  Se:u = 1 N\n  u -> m.push\n}", &["`Mass:m`"], "use std.mechanics\nmodel M {\n  Mass:m(m = 2 kg)\n  Se:u = 1 N\n  u -> m.push\n}"),
    mistake("use std.mechanics\nmodel M {\n  Damper:d(10 N*s/m)\n  Se:u = 1 N\n  u -> d.a\n  d.b_end -> R:x\n}", &["`Damper:d(parameter = 10 N*s/m)`"], "use std.mechanics\nmodel M {\n  Damper:d(b = 10 N*s/m)\n  Ground:g\n  Se:u = 1 N\n  u -> d.a\n  d.b_end -> g.hold\n}"),
    mistake("use std.electrical\nmodel M {\n  VoltageSource:s(V = 5 V)\n  R:r = 1 Ohm\n  s.out -> r\n}", &["its one parameter is `u`: write `u = 5 V`"], "use std.electrical\nmodel M {\n  VoltageSource:s(u = 5 V)\n  R:r = 1 Ohm\n  s.out -> r\n}"),
    mistake("use std.electrical\nmodel M {\n  VoltageSource:s\n  R:r = 1 Ohm\n  s.p -> r\n}", &["its one port is `out`: write `s.out`"], "use std.electrical\nmodel M {\n  VoltageSource:s\n  R:r = 1 Ohm\n  s.out -> r\n}"),
    mistake("use std.electrical\nmodel M {\n  VoltageSource:s\n  Resistor:r(R = 10)\n  s.out -> r.p\n}", &["write `10 Ohm`"], "use std.electrical\nmodel M {\n  VoltageSource:s\n  Resistor:r(R = 10 Ohm)\n  s.out -> r.p\n}"),
    // Bonds.
    mistake("use std.electrical\nmodel M {\n  Se:u = 1 V\n  R:r = 1 kOhm\n  Diode:a\n  u -> 1:i -> r, 0:x -> a.p\n}", &["bonded twice outside", "the arrow behind a list bonds each of its ends"], "use std.electrical\nmodel M {\n  Se:u = 1 V\n  R:r = 1 kOhm\n  Diode:a\n  u -> 1:i -> r, 0:x\n  x -> a.p\n}"),
    mistake("TF:gear = 0.1 m\n  I:J = 1 kg*m^2\n  v -> gear -> 1:w -> J", &["`gear` joins mechanical (translation: N, m/s) to mechanical (rotation: N*m, rad/s)", "in m^-1", "`1/(0.1 m)`"], "TF:gear = 1/(0.1 m)\n  I:J = 1 kg*m^2\n  v -> gear -> 1:w -> J"),
    mistake("model M {\n  Se:u = 5 V\n  TF:motor = 0.1 V*s\n  I:J = 1 kg*m^2\n  R:r = 1 Ohm\n  u -> 1:i -> r, motor\n  motor -> 1:w -> J\n}", &["joins electrical (V, A) to mechanical (rotation: N*m, rad/s)", "in V/(N*m)", "`GY:motor = 0.1 V*s`"], "model M {\n  Se:u = 5 V\n  GY:motor = 0.1 V*s\n  I:J = 1 kg*m^2\n  R:r = 1 Ohm\n  u -> 1:i -> r, motor\n  motor -> 1:w -> J\n}"),
    mistake("model M {\n  Se:u = 5 V\n  GY:motor = 0.1\n  I:J = 1 kg*m^2\n  R:r = 1 Ohm\n  u -> 1:i -> r, motor\n  motor -> 1:w -> J\n}", &["the ratio of a GY is an effort over a flow, here in V/(rad/s)", "write `0.1 V/(rad/s)`"], "model M {\n  Se:u = 5 V\n  GY:motor = 0.1 V/(rad/s)\n  I:J = 1 kg*m^2\n  R:r = 1 Ohm\n  u -> 1:i -> r, motor\n  motor -> 1:w -> J\n}"),
    mistake("TF:lever = 2\n  C:k = 1 m/N\n  1:w -> lever\n  v -> lever\n  w -> k", &["2 in and 0 out", "turn a half arrow, `lever -> v`"], "TF:lever = 2\n  C:k = 1 m/N\n  1:w -> lever\n  lever -> v\n  w -> k"),
    mistake("TF:lever = 2\n  C:k = 1 m/N\n  lever -> k", &["0 in and 1 out", "`a -> lever -> k`"], "TF:lever = 2\n  C:k = 1 m/N\n  v -> lever -> k"),
    mistake("R:drag { e = 2 N*s^2/m^2*f^2 }\n  v -> drag", &["`drag` gives power", "`f^2` is written `f*abs(f)`"], "R:drag { e = 2 N*s^2/m^2*f*abs(f) }\n  v -> drag"),
    mistake("R:d { e = 2 N*min(max(s, -1), 1); f = 1 m/s*s }\n  v -> d", &["write `1 m/s * s`"], "R:d { e = 2 N*min(max(s, -1), 1); f = 1 m/s * s }\n  v -> d"),
    mistake("use std.electrical\nmodel M {\n  Se:u = 1 V\n  R:r = 1 kOhm\n  Diode:a\n  Diode:b\n  u -> 1:i -> r, 0:x\n  x -> a.p\n  b.p -> x\n}", &["`b.p` meet head on", "write `x -> b.p`", "`1:n -> b.p, x`"], "use std.electrical\nmodel M {\n  Se:u = 1 V\n  R:r = 1 kOhm\n  Diode:a\n  Diode:b\n  u -> 1:i -> r, 0:x\n  x -> a.p\n  1:n -> b.p, x\n}"),
    mistake("for i in 1..3 {\n    R:r[i] = 1 N*s/m\n    v -> 0:x -> r[i]\n  }", &["if all rounds share it, declare it once before the `for`, `0:x`", "`x[i]`"], "v -> 0:x\n  for i in 1..3 {\n    R:r[i] = 1 N*s/m\n    x -> r[i]\n  }"),
    mistake("C:c = 1 m/N\n  R:b = 1 N*s/m\n  v -> b -> c", &["`b` has 2 bonds", "at a junction"], "C:c = 1 m/N\n  R:b = 1 N*s/m\n  v -> 0:node -> b, c"),
];

/// Each mistake is told, with its element and the mend, and the text that follows the advice is right.
#[test]
fn advice_that_is_followed_gives_a_model_that_works() {
    for m in MISTAKES {
        let Err(errors) = compile(m.wrong) else { panic!("this compiles, and should not:\n{}", m.wrong) };
        let told = errors.to_string();
        for said in m.said {
            assert!(told.contains(said), "{said} is not said of\n{}\n\n{told}", m.wrong);
        }
        if let Err(errors) = compile(m.mended) {
            panic!("the mended text is wrong:\n{}\n\n{errors}", m.mended);
        }
    }
}

/// What is said of each, word by word.
#[test]
fn words_of_advice() {
    let all = MISTAKES
        .iter()
        .map(|m| format!("{}\n\n{}", m.wrong, compile(m.wrong).err().map_or(String::new(), |e| e.to_string())));
    insta::assert_snapshot!(all.collect::<Vec<_>>().join("\n----\n"));
}

/// A diode that is turned round by a 1-junction carries the current that the other one does not.
#[test]
fn a_diode_is_turned_round() -> Result<(), Box<dyn std::error::Error>> {
    let text = |turned: &str| {
        format!(
            "use std.electrical
            model M {{
              Se:u = -1 V
              R:r = 1 kOhm
              Diode:a
              Diode:b
              u -> 1:i -> r, 0:x
              x -> a.p
              {turned}
              probe v = x.e
            }}"
        )
    };
    let drop = |turned: &str| -> Result<f64, Box<dyn std::error::Error>> {
        let compiled = Options::new().compile_str("m.bond", text(turned))?;
        let mut sim = compiled.simulate(bond::Steps::new())?;
        sim.advance(1e-3)?;
        Ok(sim.probe("v")?)
    };
    // Alike, both block; one that is turned round conducts, and holds its own voltage.
    let (alike, turned) = (drop("x -> b.p")?, drop("1:n -> b.p, x")?);
    assert!(alike < -0.99, "{alike}");
    assert!(turned > -0.6 && turned < -0.4, "{turned}");
    Ok(())
}

/// Products behind a unit: by hand, each written with spaces.
#[test]
fn a_factor_that_is_no_unit_makes_a_product() -> Result<(), Box<dyn std::error::Error>> {
    for (tight, apart) in [
        ("6 V*x", "6 V * x"),
        ("6 V/x", "6 V / x"),
        ("6 V*x^2", "6 V * x^2"),
        ("6 V*x^-1", "6 V / x"),
        ("6 V*x^(1/2)", "6 V * sqrt(x)"),
        ("6 V*x^2^y", "6 V * x^(2^y)"),
        ("6 V*x*y/x", "6 V * x*y/x"),
        ("6 V/(x*y)", "6 V / (x*y)"),
        ("6 V/(x*y)^2", "6 V / (x*y)^2"),
        ("6 V*(x + y)", "6 V * (x + y)"),
        ("4 V*exp(-x)", "4 V * exp(-x)"),
        ("4 V*s/s*exp(-x)*y", "4 V * exp(-x)*y"),
        ("8 V/2 rad*x", "4 V * x"),
        ("-6 V*x^2", "-(6 V * x^2)"),
        ("2^2 rad*x*1 V", "4*x*1 V"),
        ("3 V*c.q/(1 C)", "3 V * c.q/(1 C)"),
        ("3 V*a[2]", "3 V * a[2]"),
        ("3 V*pi", "3 V * pi"),
        ("3 V/s*t", "3 V/s * t"),
    ] {
        let text = format!(
            "model M(x = 2, y = 3) {{
              let a = [1, 5]
              Se:u = 1 V
              C:c {{ compliance = 1 F; q0 = 1 C }}
              R:r = 1 Ohm
              u -> 1:i -> r, c
              probe tight = ({tight})/(1 V)
              probe apart = ({apart})/(1 V)
            }}"
        );
        let compiled = Options::new().compile_str("m.bond", text).map_err(|e| format!("{tight}: {e}"))?;
        let mut sim = compiled.simulate(bond::Steps::new())?;
        sim.advance(0.5)?;
        let (a, b) = (sim.probe("tight")?, sim.probe("apart")?);
        assert!((a - b).abs() <= 1e-15 * b.abs(), "{tight}: {a}, {apart}: {b}");
        assert!(a != 0.0, "{tight}");
    }
    Ok(())
}
