//! Arrays, functions, tables: what expressions mean; and domains that are bonded without a transducer.

use crate::common::{close, end, errors, finish, probe, start, text, with};
use bond::internal::CompiledInternals;
use bond::{Options, Steps};

/// The value of an expression, with what stands before it in the model and in the file.
fn value(file: &str, model: &str, expr: &str) -> f64 {
    let compiled = text(&format!("{file}\nmodel M {{ {model}\n Se:u = 1 V R:r = 1 Ohm u -> r probe x = {expr} }}"));
    end(&compiled, Steps::fixed(0.5), 1.0, "x")
}

#[test]
fn arrays() {
    let lets = "let a = [2 m, 3 m, 5 m] let k = [[1 N, 2 N], [3 N, 4 N], [5 N, 6 N]] let m = [[2, 1], [0, 3]]
      let e = transpose(m)*[1 m, 10 m] let mm = m*m let mixed = [[1 kg, 2 kg*m], [2 kg*m, 9 kg*m^2]]*[3 s^-1, 5 m^-1*s^-1]";
    for (expr, wanted) in [
        ("a[2]", 3.0),
        ("a[1] + a[len(a)]", 7.0),
        ("k[3, 1]", 5.0),
        ("k[3][2]", 6.0),
        ("sum(a)", 10.0),
        ("len(k)", 3.0),
        ("len(k[1])", 2.0),
        ("sum(2*a + a/2 - [1 m, 1 m, 1 m])", 22.0),
        ("dot(a, -a)", -38.0),
        ("sum(k*[1 m, 10 m])", 21.0 + 43.0 + 65.0),
        ("e[1]", 2.0),
        ("e[2]", 31.0),
        ("mm[1, 2]", 5.0),
        ("mm[2, 2]", 9.0),
        ("dot(m[2], [7, 11])", 33.0),
        ("sum(if 1 < 2 then a else 2*a)", 10.0),
        ("mixed[1]", 13.0),
        ("mixed[2]", 51.0),
        ("max(a[1], a[3])", 5.0),
        ("a[len(m[1])]", 3.0),
    ] {
        close(value("", lets, expr), wanted, 1e-14 * wanted.abs(), expr);
    }
}

/// Arrays of parameters, by default and by argument; bounds from their length; entries as outputs.
#[test]
fn arrays_of_parameters() {
    let compiled = text(
        "model Chain(ks = [1 N/m], ms = 2*[1 kg]) {
           for i in 1..len(ks) {
             C:c[i] { stiffness = ks[i]; q0 = 1 m }
             I:m[i] = ms[i]
             1:v[i] -> m[i], c[i]
           }
         }
         model M(first = 8 N/m) {
           Chain:a(ks = [first, 2*first, 18 N/m], ms = [2 kg, 1 kg, 2 kg])
           Chain:b
           probe x = [a.c[1].q, a.c[2].q, a.c[3].q]
           probe known = [a.ks[2]]
         }",
    );
    let mut sim = start(&compiled, Steps::fixed(0.05));
    finish(&mut sim, 1.0);
    for (i, w) in [2.0f64, 4.0, 3.0].into_iter().enumerate() {
        close(probe(&mut sim, &format!("x[{}]", i + 1)), w.cos(), 1e-13, "x");
    }
    assert_eq!(probe(&mut sim, "known[1]"), 16.0);
    let listed: Vec<(String, f64)> =
        compiled.stages().model.parameters.iter().map(|p| (p.name.clone(), p.value)).collect();
    for wanted in [("first", 8.0), ("a.ks[1]", 8.0), ("a.ks[3]", 18.0), ("a.ms[2]", 1.0), ("b.ms[1]", 2.0)] {
        assert!(listed.contains(&(wanted.0.to_string(), wanted.1)), "{wanted:?} is missing in {listed:?}");
    }
    assert!(compiled.show("phs").contains("a.ks[1]"));
}

/// An indexed declaration goes before the entry of an array, and `--set` gives no entries.
#[test]
fn indexed_names_and_set() {
    let model = "model M(c = [7 m, 8 m]) {
      for i in 2..2 { C:c[i] { stiffness = 1 N/m; q0 = 3 m } I:m[i] = 1 kg m[i] -> c[i] }
      probe x = c[2].q + c[1]
    }";
    let compiled = text(model);
    let mut sim = start(&compiled, Steps::fixed(0.1));
    close(probe(&mut sim, "x"), 10.0, 1e-14, "x at the start");
    for (path, says) in [("c", "an array of 2"), ("c[1]", "an entry of the array `c`"), ("c[2].q", "no parameter")] {
        match Options::new().set(path, "1 m").compile_str("m.bond", model) {
            Ok(_) => panic!("--set {path} is taken"),
            Err(e) => assert!(e.to_string().contains(says), "{e}"),
        }
    }
}

#[test]
fn functions() {
    let file =
        "let square(x) = x^2 let mean(a) = sum(a)/len(a) let hyp(x, y) = sqrt(square(x) + square(y)) let four() = 4";
    let model = "let k = 2 let far(x) = k*x + near let near = 1 let q = 5 let rise(x) = x[2] - x[1]
      let c = [10, 20]";
    for (expr, wanted) in [
        ("square(3)", 9.0),
        ("square(3 m)", 9.0),
        ("hyp(3 N, 4 N)", 5.0),
        ("square(square(2))", 16.0),
        ("mean([1 V, 2 V, 6 V])", 3.0),
        ("four()*four()", 16.0),
        ("far(3)", 7.0),
        ("rise(c)", 10.0),
        ("rise([square(2), far(4)])", 5.0),
        ("far(far(q))", 23.0),
    ] {
        close(value(file, model, expr), wanted, 1e-14 * wanted, expr);
    }
    // A function of the model goes before one of the file, and both before those of the language.
    close(value("let sin(x) = 2*x let f(x) = 1", "let f(x) = sin(x)", "f(3)"), 6.0, 0.0, "f");
    // In a loop a function belongs to the round; arguments hide what the model declares.
    let compiled = text(
        "model M {
           for i in 1..3 {
             let times(x) = i*x
             C:c[i] { stiffness = times(1 N/m); q0 = 1 m }
             I:m[i] = 1 kg
             m[i] -> c[i]
             probe w = times(2)
           }
           let second(c) = c[2]
           probe s = second([1, 9])
         }",
    );
    let mut sim = start(&compiled, Steps::fixed(0.1));
    assert_eq!((probe(&mut sim, "w[3]"), probe(&mut sim, "s")), (6.0, 9.0));
    finish(&mut sim, 1.0);
}

/// Functions of used files, of instances, in laws and energies.
#[test]
fn functions_in_models() {
    let compiled = text(
        "let hooke(k, x) = 0.5*k*x^2
         model Spring(k = 1 N/m) { port end  C:c { H = hooke(k, q); q0 = 1 m }  end -> c }
         model M {
           let push(x) = c0*x
           let c0 = 0.2 N*s/m
           Spring:s(k = 4 N/m)
           I:mass = 1 kg
           R:drag { e = push(f) }
           1:v -> mass, drag, s.end
           probe x = s.c.q
           expect abs(hooke(2 N/m, x)) < 2 J
         }",
    );
    let (a, w) = (0.1f64, (4.0f64 - 0.01).sqrt());
    let wanted = (-a).exp() * (w.cos() + a / w * w.sin());
    close(end(&compiled, Steps::fixed(0.01), 1.0, "x"), wanted, 1e-12, "x");
    let folder = std::env::temp_dir().join(format!("bond_functions_{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a folder can be made");
    let write = |name: &str, text: &str| std::fs::write(folder.join(name), text).expect("a file can be written");
    write(
        "a.bond",
        "let inner(x) = x + 1\nlet shared(x) = 2*inner(x)\nmodel A { Se:u = shared(1)*1 V R:r = 1 Ohm u -> r }",
    );
    write(
        "b.bond",
        "use \"a.bond\"\nlet inner(x) = 100\nmodel B { A:a probe x = shared(3) + inner(0) probe u = a.u.e }",
    );
    let compiled = crate::common::file(&folder.join("b.bond"), Options::new());
    std::fs::remove_dir_all(&folder).expect("a folder can be removed");
    let mut sim = start(&compiled, Steps::fixed(0.1));
    assert_eq!((probe(&mut sim, "x"), probe(&mut sim, "u")), (108.0, 4.0));
}

/// Chains of functions that double at each link end in an error, not in a run for ever.
#[test]
fn too_many_calls() {
    let mut file = "let f0(x) = x\n".to_string();
    for i in 1..40 {
        file += &format!("let f{i}(x) = f{}(x) + f{}(x)\n", i - 1, i - 1);
    }
    let all = errors(&format!("{file} model M {{ Se:u = 1 V R:r = 1 Ohm u -> r probe x = f39(1) }}"));
    assert!(all.list().len() == 1 && all.list()[0].code == "elaborate::limit", "{all}");
    let mut file = "let f0(x) = x\n".to_string();
    for i in 1..100 {
        file += &format!("let f{i}(x) = f{}(x)\n", i - 1);
    }
    let all = errors(&format!("{file} model M {{ Se:u = 1 V R:r = 1 Ohm u -> r probe x = f99(1) }}"));
    assert!(all.list().len() == 1 && all.list()[0].code == "elaborate::limit", "{all}");
}

/// A measured spring: place in m, force in N.
const SPRING: [(f64, f64); 6] = [(-2.0, -6.0), (-1.0, -1.5), (0.0, 0.0), (1.0, 1.0), (2.0, 4.0), (3.0, 4.5)];
/// A measured damper: speed in m/s, force in N.
const DAMPER: [(f64, f64); 5] = [(-4.0, -0.2), (0.0, 0.0), (1.0, 0.1), (2.0, 0.15), (4.0, 1.0)];

fn array(values: impl Iterator<Item = f64>, unit: &str) -> String {
    format!("[{}]", values.map(|v| format!("{v} {unit}")).collect::<Vec<_>>().join(", "))
}

fn measured(q0: f64, damped: bool) -> String {
    let (xs, es) = (array(SPRING.iter().map(|k| k.0), "m"), array(SPRING.iter().map(|k| k.1), "N"));
    let (fs, ds) = (array(DAMPER.iter().map(|k| k.0), "m/s"), array(DAMPER.iter().map(|k| k.1), "N"));
    let damper = if damped { format!("R:damper {{ e = table(f, {fs}, {ds}) }} v -> damper") } else { String::new() };
    format!(
        "model Measured {{
           C:spring {{ e = table(q, {xs}, {es}); q0 = {q0} m }}
           I:mass = 1 kg
           1:v -> mass, spring
           {damper}
           probe x = spring.q
           probe energy = spring.H + mass.H
         }}"
    )
}

/// The monotone cubic by Hermite's basis, with the slopes of Fritsch and Carlson.
fn curve(knots: &[(f64, f64)], x: f64) -> f64 {
    let n = knots.len();
    let h: Vec<f64> = knots.windows(2).map(|k| k[1].0 - k[0].0).collect();
    let d: Vec<f64> = knots.windows(2).zip(&h).map(|(k, h)| (k[1].1 - k[0].1) / h).collect();
    let mut m: Vec<f64> = (0..n)
        .map(|i| match i {
            0 => ((2.0 * h[0] + h[1]) * d[0] - h[0] * d[1]) / (h[0] + h[1]),
            i if i == n - 1 => ((2.0 * h[n - 2] + h[n - 3]) * d[n - 2] - h[n - 2] * d[n - 3]) / (h[n - 2] + h[n - 3]),
            i => (h[i] * d[i - 1] + h[i - 1] * d[i]) / (h[i - 1] + h[i]),
        })
        .collect();
    for i in [0, n - 1] {
        m[i] = if m[i] * d[i.min(n - 2)] > 0.0 { m[i] } else { 0.0 };
    }
    for i in 0..n - 1 {
        let (a, b) = (m[i] / d[i], m[i + 1] / d[i]);
        let tau = 3.0 / a.hypot(b);
        if tau < 1.0 {
            (m[i], m[i + 1]) = (tau * a * d[i], tau * b * d[i]);
        }
    }
    if x <= knots[0].0 {
        return knots[0].1 + m[0] * (x - knots[0].0);
    }
    let Some(i) = (0..n - 1).find(|&i| x < knots[i + 1].0) else {
        return knots[n - 1].1 + m[n - 1] * (x - knots[n - 1].0);
    };
    let t = (x - knots[i].0) / h[i];
    let (p, s) = (1.0 - t, t);
    p * p * ((1.0 + 2.0 * s) * knots[i].1 + h[i] * s * m[i])
        + s * s * ((1.0 + 2.0 * p) * knots[i + 1].1 - h[i] * p * m[i + 1])
}

/// x of the measured oscillator by the classical method of order 4, written here.
fn reference(q0: f64, damped: bool, stop: f64) -> f64 {
    let rate = |[q, p]: [f64; 2]| [p, -curve(&SPRING, q) - if damped { curve(&DAMPER, p) } else { 0.0 }];
    let (n, mut y) = (200_000u32, [q0, 0.0]);
    let h = stop / f64::from(n);
    for _ in 0..n {
        let move_by = |y: [f64; 2], k: [f64; 2], h: f64| [y[0] + h * k[0], y[1] + h * k[1]];
        let k1 = rate(y);
        let k2 = rate(move_by(y, k1, 0.5 * h));
        let k3 = rate(move_by(y, k2, 0.5 * h));
        let k4 = rate(move_by(y, k3, h));
        for i in 0..2 {
            y[i] += h / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]);
        }
    }
    y[0]
}

/// Order 2 where the run stays between two knots, and across them, where the curve has a slope but no curvature.
#[test]
fn order_two_on_measured_curves() {
    for (q0, damped, stop) in [(2.9, false, 0.4), (2.5, false, 8.0), (2.5, true, 8.0)] {
        let wanted = reference(q0, damped, stop);
        let compiled = with(Options::new().method("gonzalez"), &measured(q0, damped));
        let errors: Vec<f64> =
            [100.0, 200.0, 400.0].map(|n| (end(&compiled, Steps::fixed(stop / n), stop, "x") - wanted).abs()).to_vec();
        let orders: Vec<f64> = errors.windows(2).map(|e| (e[0] / e[1]).log2()).collect();
        let within = if stop < 1.0 { 0.05 } else { 0.3 };
        assert!(orders.iter().all(|o| (o - 2.0).abs() <= within), "from {q0}: orders {orders:?} of {errors:?}");
        let fitted = end(&compiled, Steps::tolerance(1e-10), stop, "x");
        close(fitted, wanted, 2e-6, "x with fitted steps");
    }
}

/// The balance closes over a hundred thousand steps, many of them across knots; the energy is that of the curve.
#[test]
fn measured_energies_are_exact() {
    let compiled = text(&measured(2.5, false));
    let mut sim = start(&compiled, Steps::fixed(0.01));
    let first = probe(&mut sim, "energy");
    // The integral of the curve by Simpson's rule on each half of a step between knots, exact for cubics.
    let places = [0.0, 1.0, 2.0, 2.5];
    let simpson =
        |a: f64, b: f64| (b - a) / 6.0 * (curve(&SPRING, a) + 4.0 * curve(&SPRING, 0.5 * (a + b)) + curve(&SPRING, b));
    let wanted: f64 = places.windows(2).map(|p| simpson(p[0], p[1])).sum();
    close(first, wanted, 1e-14 * wanted, "the energy at the start");
    finish(&mut sim, 1000.0);
    close(probe(&mut sim, "energy"), first, 1e-12 * first, "the energy at the end");
    let summary = sim.summary();
    assert!(summary.passive && summary.regions[0].steps >= 100_000);
    assert!(summary.worst_step <= 1e-13 && summary.total <= 1e-11, "{} {}", summary.worst_step, summary.total);
    for step in [0.3, 1.0, 3.0] {
        let mut sim = start(&compiled, Steps::fixed(step));
        finish(&mut sim, 300.0);
        assert!(sim.summary().worst_step <= 1e-12, "steps of {step}: {}", sim.summary().worst_step);
    }
}

/// A spring that comes to rest on a knot of its curve: the steps become as short as rounding, and cross it all the
/// time.
#[test]
fn rest_on_a_knot() {
    let (xs, es) = (array(SPRING.iter().map(|k| k.0), "m"), array(SPRING.iter().map(|k| k.1), "N"));
    for r in [1e-3, 1e-2, 1.0] {
        let compiled = text(&format!(
            "model Rest {{
               Se:u = 1 N
               R:b = {r} N*s/m
               C:spring {{ e = table(q, {xs}, {es}) }}
               u -> 1:v -> b, spring
               probe x = spring.q
             }}"
        ));
        let mut sim = start(&compiled, Steps::fixed(0.01));
        finish(&mut sim, 10.0 + 10.0 * r);
        close(probe(&mut sim, "x"), 1.0, 1e-4, "x");
        let summary = sim.summary();
        assert!(summary.passive && summary.worst_step <= 1e-12, "{r}: {}", summary.worst_step);
    }
}

/// A curve through the origin is proved passive, or refused, or left open.
#[test]
fn measured_resistors() {
    let model = |knots: &str| {
        format!("model M {{ Sf:u = 1 A * sin(t/1 s) R:r {{ e = table(f, {knots}) }} u -> r probe e = r.e }}")
    };
    let proved = |knots: &str| text(&model(knots)).show("phs").contains("e f >= 0 proved for r");
    assert!(proved("[-1 A, 0 A, 1 A, 2 A], [-3 V, 0 V, 0.5 V, 4 V]"));
    assert!(proved("[0 A, 1 A], [0 V, 2 V]"));
    let all = errors(&model("[-1 A, 0 A, 1 A, 2 A, 3 A], [-3 V, 0 V, 5 V, 3 V, 0.4 V]"));
    assert_eq!(all.list()[0].code, "elaborate::law", "beyond its last point it falls below 0: {all}");
    let all = errors(&model("[-1 A, 0 A, 1 A], [-1 V, 0.5 V, 1 V]"));
    assert_eq!(all.list()[0].code, "elaborate::law", "{all}");
    let compiled = with(Options::new(), &model("[-1 A, 0 A, 1 A, 2 A], [-3 V, 0 V, 0.5 V, 4 V]"));
    let knots = [(-1.0, -3.0), (0.0, 0.0), (1.0, 0.5), (2.0, 4.0)];
    for t in [0.5, 1.0, 4.0, 5.0] {
        close(end(&compiled, Steps::fixed(0.1), t, "e"), curve(&knots, f64::sin(t)), 1e-13, "e");
    }
}

/// What is said where two domains are bonded without a transducer: code, and words.
#[test]
fn domains() {
    for (body, code, words) in [
        (
            "Se:u = 5 V I:m = 2 kg u -> 1:v -> m",
            "units::domain",
            "`m` is mechanical (translation: N, m/s), and is bonded to what is electrical (V, A)",
        ),
        ("Se:u = 5 N*m I:m = 2 kg u -> m", "units::domain", "bonded to what is mechanical (rotation: N*m, rad/s)"),
        ("I:j = 1 kg*m^2 C:k = 3 F 1:v -> j, k", "units::domain", "`k` is electrical (V, A)"),
        ("C:tank = 1e-6 m^3/Pa I:coil = 3 mH 1:v -> tank, coil", "units::domain", "electrical"),
        ("Se:u = 1 bar R:r = 3 Ohm u -> r", "units::domain", "what is hydraulic (Pa, m^3/s)"),
        ("Se:u = 300 K C:c { stiffness = 3 N/m } 0:n -> c u -> n", "units::domain", "what is thermal"),
        ("Sf:i = 3 A C:core = 2 uF I:m = 1 kg i -> 0:n -> core, m", "units::domain", "transducer"),
        ("Se:u = 2 J/mol C:k = 3 F u -> 0:n -> k", "units::domain", "chemical (J/mol, mol/s)"),
        (
            "Se:u = 5 V I:m = 2 kg C:k { stiffness = 3 N/m } R:d = 5 N*s/m u -> 1:v -> m, k, d",
            "units::domain",
            "`m`, `k` and `d` are mechanical",
        ),
        // A wrong unit within one domain stays what it was.
        ("Se:u = 5 V R:r = 2 S u -> r", "units::mismatch", "in S where Ohm is needed"),
        ("Se:u = 5 A R:r = 2 Ohm u -> r", "units::mismatch", "wrong unit"),
        ("Se:u = 5 N I:m { inertia = 2 kg; f0 = 1 A } u -> m", "units::mismatch", "`f0` of `m`"),
        ("Se:u = 5 N I:m = 2 m u -> m", "units::mismatch", "the inertia of `m`"),
        ("Se:u = 5 N C:k = 100 N/m u -> k", "units::mismatch", "the compliance of `k`"),
        ("Se:u = 5 V TF:t = 2 N/V I:m = 2 kg u -> t t -> m", "units::mismatch", "wrong unit"),
    ] {
        let all = errors(&format!("model M {{ {body} }}"));
        let list = all.list();
        assert_eq!((list.len(), list[0].code), (1, code), "{body}\n{all}");
        assert!(all.to_string().contains(words), "{body}\n{all}");
    }
}
