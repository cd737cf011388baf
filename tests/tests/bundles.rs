//! Bundles of bonds, and two-ports by matrices: against the textbooks' equations by the method of Runge and Kutta, and
//! against the same graph written element by element.

use crate::common::{advance, close, end, errors, file, models, probe, start, text};
use bond::internal::{CompiledInternals, OptionsInternals};
use bond::{Compiled, Options, Steps};
use bond_compiler::discretise::Accuracy;

/// A state of N numbers at an instant, by steps of h of the method of order 4.
fn runge_kutta<const N: usize>(rate: impl Fn(f64, [f64; N]) -> [f64; N], start: [f64; N], h: f64, n: u32) -> [f64; N] {
    let mut y = start;
    for k in 0..n {
        let t = f64::from(k) * h;
        let at = |slope: [f64; N], part: f64| std::array::from_fn(|i| y[i] + part * h * slope[i]);
        let a = rate(t, y);
        let b = rate(t + 0.5 * h, at(a, 0.5));
        let c = rate(t + 0.5 * h, at(b, 0.5));
        let d = rate(t + h, at(c, 1.0));
        y = std::array::from_fn(|i| y[i] + h / 6.0 * (a[i] + 2.0 * b[i] + 2.0 * c[i] + d[i]));
    }
    y
}

fn model(path: &str) -> Compiled {
    file(&models().join(path), Options::new().accuracy(Accuracy::Tolerance(1e-10)))
}

/// Runs to an instant, where the probes have these values, and the run is passive.
fn compare(compiled: &Compiled, until: f64, wanted: &[(&str, f64)], within: f64) {
    let mut sim = start(compiled, Steps::tolerance(1e-10));
    advance(&mut sim, until);
    for (name, value) in wanted {
        close(probe(&mut sim, name), *value, within, name);
    }
    let summary = sim.summary();
    assert!(summary.passive && summary.worst_step < 1e-11, "balance {:e}", summary.worst_step);
}

/// M(q) q'' + m J^T J' q' + J^T (0, m g) = 0 with M = diag(J1, J2) + m J^T J.
#[test]
fn an_arm_by_its_jacobian_moves_as_the_textbook_says() {
    let (l1, l2, j1, j2, m, g) = (0.5, 0.4, 0.3, 0.1, 2.0, 9.81);
    let rate = |_: f64, [a, q, wa, wq]: [f64; 4]| {
        let (b, wb) = (a + q, wa + wq);
        let jacobian = [[-l1 * a.sin() - l2 * b.sin(), -l2 * b.sin()], [l1 * a.cos() + l2 * b.cos(), l2 * b.cos()]];
        // The acceleration of the hand that is left where the joints' speeds are constant.
        let rest = [-l1 * a.cos() * wa * wa - l2 * b.cos() * wb * wb, -l1 * a.sin() * wa * wa - l2 * b.sin() * wb * wb];
        let force = [m * rest[0], m * rest[1] + m * g];
        let torque = |i: usize| -(jacobian[0][i] * force[0] + jacobian[1][i] * force[1]);
        let dot = |i: usize, k: usize| m * (jacobian[0][i] * jacobian[0][k] + jacobian[1][i] * jacobian[1][k]);
        let (m11, m12, m22) = (j1 + dot(0, 0), dot(0, 1), j2 + dot(1, 1));
        let det = m11 * m22 - m12 * m12;
        [wa, wq, (m22 * torque(0) - m12 * torque(1)) / det, (m11 * torque(1) - m12 * torque(0)) / det]
    };
    let [a, q, wa, wq] = runge_kutta(rate, [0.3, 0.8, 0.0, 0.0], 1e-4, 10_000);
    let wanted = [("turned[1]", a), ("turned[2]", q), ("speed[1]", wa), ("speed[2]", wq)];
    compare(&model("mechanisms/planar_arm.bond"), 1.0, &wanted, 1e-8);
}

/// J1 w1' = (J2 - J3) w2 w3, and round. The run's steps keep energy and momentum (expectations of the model).
#[test]
fn a_body_with_a_skew_gyrator_moves_as_euler_says() {
    let rate =
        |_: f64, [x, y, z]: [f64; 3]| [(2.0 - 3.0) * y * z, (3.0 - 1.0) * z * x / 2.0, (1.0 - 2.0) * x * y / 3.0];
    let [x, y, z] = runge_kutta(rate, [0.01, 3.0, 0.01], 1e-4, 50_000);
    compare(&model("mechanisms/free_body.bond"), 5.0, &[("speed[1]", x), ("speed[2]", y), ("speed[3]", z)], 1e-8);
}

/// Park's equations, with the voltages of the axes from those of the phases.
#[test]
fn a_three_phase_motor_by_parks_matrix_follows_parks_equations() {
    let (u, w, r, ld, lq, flux, n, j, b) = (60.0, 300.0, 0.5, 4e-3, 7e-3, 0.15, 3.0, 5e-3, 0.02);
    let third = 2.0 * std::f64::consts::PI / 3.0;
    let rate = |t: f64, [id, iq, speed, place]: [f64; 4]| {
        let th = n * place;
        let (mut ud, mut uq) = (0.0, 0.0);
        for k in [0.0, 1.0, 2.0] {
            let phase = u * (w * t - k * third).cos();
            ud += (2.0f64 / 3.0).sqrt() * (th - k * third).cos() * phase;
            uq -= (2.0f64 / 3.0).sqrt() * (th - k * third).sin() * phase;
        }
        [
            (ud - r * id + n * speed * lq * iq) / ld,
            (uq - r * iq - n * speed * (ld * id + flux)) / lq,
            (n * (flux * iq + (ld - lq) * id * iq) - b * speed) / j,
            speed,
        ]
    };
    let [id, iq, speed, place] = runge_kutta(rate, [0.0, 0.0, 100.0, -0.6], 1e-6, 100_000);
    // The currents of the phases: the axes' turned by the angle.
    let phase = |k: f64| {
        let angle = n * place - k * third;
        (2.0f64 / 3.0).sqrt() * (angle.cos() * id - angle.sin() * iq)
    };
    let wanted = [
        ("current[1]", id),
        ("current[2]", iq),
        ("speed", speed),
        ("phases[1]", phase(0.0)),
        ("phases[2]", phase(1.0)),
        ("phases[3]", phase(2.0)),
    ];
    compare(&model("examples/three_phase_motor.bond"), 0.1, &wanted, 1e-8);
}

/// f_b = J f_a and e_a = J^T e_b, of any size; entries that are 0 have no bond.
#[test]
fn a_transformer_by_a_matrix_is_that_of_both_variables() {
    let compiled = text(
        "model M {
           Sf:a[1..3] = [1 A, -2 A, 5 A]; R:b[1..2] = [3 Ohm, 7 Ohm]
           TF(x[1..3], y[1..2]):t { matrix = [[2, 0, -1], [0.5, 4, 0]] }
           a -> t.x; t.y -> b
           probe f = b.f; probe e = a.e }",
    );
    let flows = [2.0 - 5.0, 0.5 - 8.0];
    let efforts = [3.0 * flows[0], 7.0 * flows[1]];
    let back = [2.0 * efforts[0] + 0.5 * efforts[1], 4.0 * efforts[1], -efforts[0]];
    for (name, value) in
        [("f[1]", flows[0]), ("f[2]", flows[1]), ("e[1]", back[0]), ("e[2]", back[1]), ("e[3]", back[2])]
    {
        close(end(&compiled, Steps::fixed(0.1), 0.1, name), value, 1e-12, name);
    }
    let two_ports = compiled.stages().model.elements.iter().filter(|e| e.name.starts_with("t[")).count();
    assert_eq!(two_ports, 4, "a bond for each entry that is not 0");
}

/// e_b = R f_a and e_a = R^T f_b, which for one entry is the scalar gyrator.
#[test]
fn a_gyrator_by_a_matrix_is_that_of_both_variables() {
    let compiled = text(
        "model M {
           Sf:a[1..2] = [1 A, -2 A]; Sf:b[1..3] = [-1 A, 3 A, 4 A]
           GY(x[1..2], y[1..3]):g { matrix = [[2 Ohm, 1 Ohm], [0, 3 Ohm], [5 Ohm, -1 Ohm]] }
           a -> g.x; g.y -> b
           probe e = a.e }",
    );
    let back = [-2.0 + 5.0 * 4.0, -1.0 + 3.0 * 3.0 - 4.0];
    for (name, value) in [("e[1]", back[0]), ("e[2]", back[1])] {
        close(end(&compiled, Steps::fixed(0.1), 0.1, name), value, 1e-12, name);
    }
}

/// Bundles are their entries: as many elements and bonds, with the same rates.
#[test]
fn a_bundle_is_its_entries() {
    let ours = text(
        "model Foot(k = 1 N/m) { port tip[1..2]; C:c[1..2] = 1/k; tip -> c }
         model M { I:m[1..2] = [1 kg, 2 kg]; Se:g[1..2] = -9.81 N; Foot:foot[1..2](k = 3 N/m)
           1:v[1..2] -> m; g -> v; v[1] -> foot[1].tip[1]; v[2] -> foot[1].tip[2]
           R:r[1..2] = 1 N*s/m; 1:w[1..2] -> r, foot[2].tip }",
    );
    let theirs = text(
        "model Foot(k = 1 N/m) { port a; port b; C:c1 = 1/k; C:c2 = 1/k; a -> c1; b -> c2 }
         model M { I:m1 = 1 kg; I:m2 = 2 kg; Se:g1 = -9.81 N; Se:g2 = -9.81 N
           Foot:foot1(k = 3 N/m); Foot:foot2(k = 3 N/m)
           1:v1 -> m1; 1:v2 -> m2; g1 -> v1; g2 -> v2; v1 -> foot1.a; v2 -> foot1.b
           R:r1 = 1 N*s/m; R:r2 = 1 N*s/m; 1:w1 -> r1; 1:w2 -> r2; w1 -> foot2.a; w2 -> foot2.b }",
    );
    let [a, b] = [&ours, &theirs].map(|c| {
        let model = &c.stages().model;
        (model.elements.len(), model.bonds.len())
    });
    assert_eq!(a, b);
    for (name, other) in [("m[1].p", "m1.p"), ("m[2].p", "m2.p")] {
        let [x, y] = [(&ours, name), (&theirs, other)].map(|(c, name)| {
            c.rates(1.0, &|_| Some(0.1)).map(|r| r.iter().find(|r| r.0 == name).map(|r| r.1)).ok().flatten()
        });
        assert!(x.is_some() && x == y, "{name}: {x:?} {y:?}");
    }
}

/// `0:a[0]` stays one junction, of the index 0.
#[test]
fn one_index_is_one_element() {
    let compiled = text(
        "model M { 0:a[0]; C:c = 1 F; R:r = 1 Ohm; a[0] -> c; a[0] -> r; C:d[3] = 1 F; R:s = 1 Ohm
        1:v[3] -> d[3], s }",
    );
    let named = |name: &str| compiled.stages().model.elements.iter().filter(|e| e.name == name).count();
    assert_eq!((named("a[0]"), named("v[3]"), named("d[3]"), named("v[1]")), (1, 1, 1, 0));
}

/// No text about bundles panics, and each error says what to write.
#[test]
fn wrong_bundles_are_told() {
    let body = "I:m[1..3] = 1 kg; I:n[1..2] = 1 kg; 1:v[1..3] -> m; ";
    for (slip, code) in [
        ("v -> n", "elaborate::bundle"),
        ("R:r = 1 N*s/m; v -> r", "elaborate::bundle"),
        ("1:u[3..1]", "elaborate::bundle"),
        ("1:u[1..100000]", "elaborate::limit"),
        ("let x = v[1..2].f", "elaborate::bundle"),
        ("Se:g[1..3] = [1 N, 2 N]; g -> v", "elaborate::bundle"),
        ("TF(a[1..3]):t { matrix = [[1]] }", "elaborate::two_port"),
        ("TF(a, b):t { matrix = [[1]] }", "elaborate::two_port"),
        ("TF(a[1..3], b[1..2]):t { matrix = [[1, 2, 3], [4, 5, 6]] }; v -> t.a", "elaborate::port"),
        ("TF(a[1..3], b[1..2]):t { matrix = [[1, 2], [3, 4], [5, 6]] }; v -> t.a; t.b -> n", "elaborate::matrix"),
        ("TF(a[1..3], b[1..2]):t { ratio = 2 }; v -> t.a; t.b -> n", "elaborate::field"),
        ("TF(a[1..3], b[1..2]):t { matrix = [[1, 2, 3], [4, 5, 6 m]] }; v -> t.a; t.b -> n", "units::mismatch"),
        ("GY(a[1..3]):t { matrix = [[0, 1, 2], [-1, 0, 3], [-2, 3, 0]] }; v -> t.a", "elaborate::matrix"),
        ("GY(a[1..3]):t { matrix = [[0, 1, 2], [-1, 1, 3], [-2, -3, 0]] }; v -> t.a", "elaborate::matrix"),
        ("v -> v.f.g", "elaborate::end"),
        ("GY(a[1..9999]):t { matrix = [[0]] }", "elaborate::limit"),
        ("port p[3]", "elaborate::bundle"),
        ("R:v = 1 N*s/m", "elaborate::twice"),
    ] {
        let found = errors(&format!("model M {{ {body}{slip} }}"));
        assert!(found.list().iter().any(|e| e.code == code), "{slip}: {found}");
    }
}
