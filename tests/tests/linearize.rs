//! The linear model around a state, against matrices by hand.

use crate::common::{close, file, models, text};
use bond::{Compiled, Options};

fn at(compiled: &Compiled, states: &[(&str, f64)]) -> bond_compiler::linearize::Linearized {
    let given = |name: &str| states.iter().find(|s| s.0 == name).map(|s| s.1);
    compiled.linearize(0.0, &given).unwrap_or_else(|e| panic!("{e}"))
}

/// A of the damped oscillator has the eigenvalues -b/2m +- sqrt(b^2/4m^2 - k/m): trace -b/m, determinant k/m.
#[test]
fn the_damped_oscillator() {
    let compiled = text(
        "model M {
          C:spring { stiffness = 8 N/m;  q0 = 1 m }
          I:mass = 2 kg
          R:drag = 3 N*s/m
          1:v -> spring, mass, drag
          probe x = spring.q
          probe force = drag.e
        }",
    );
    let l = at(&compiled, &[]);
    assert_eq!(l.states.len(), 2);
    assert_eq!(l.outputs, ["x", "force"]);
    close(l.a.trace(), -1.5, 1e-15, "trace");
    close(l.a.determinant(), 4.0, 1e-14, "determinant");
    let (q, p) = (l.states.iter().position(|s| s.contains("spring")), l.states.iter().position(|s| s.contains("mass")));
    let (Some(q), Some(p)) = (q, p) else { panic!("{:?}", l.states) };
    for (found, wanted) in [(l.a[(q, q)], 0.0), (l.a[(q, p)], 0.5), (l.a[(p, q)], -8.0), (l.a[(p, p)], -1.5)] {
        close(found, wanted, 1e-15, "A");
    }
    close(l.c[(0, q)], 1.0, 0.0, "C");
    close(l.c[(1, p)], 1.5, 1e-15, "C");
}

/// The pendulum: +-i sqrt(g/l) at the bottom, +-sqrt(g/l) at the top, sqrt(-g/l cos(angle)) between.
#[test]
fn the_pendulum_below_and_above() {
    let compiled = file(&models().join("examples/pendulum.bond"), Options::new());
    let name = at(&compiled, &[]).states.iter().find(|s| s.contains("gravity")).cloned().unwrap_or_default();
    for angle in [0.0, 1.0, std::f64::consts::PI, 2.0] {
        let l = at(&compiled, &[(&name, angle)]);
        close(l.a.trace(), 0.0, 0.0, "trace");
        close(l.a.determinant(), 9.81 * f64::cos(angle), 1e-13, "determinant");
    }
}

/// The Wheatstone bridge: one state, whose rate is that of c with the Thevenin resistance.
#[test]
fn a_loop_of_resistors() {
    let compiled = file(&models().join("examples/wheatstone.bond"), Options::new());
    let l = at(&compiled, &[]);
    let r: f64 = 1e3 * 2e3 / 3e3 + 1e3 * 3e3 / 4e3;
    assert_eq!(l.a.shape(), (1, 1));
    close(l.a[(0, 0)], -1.0 / (r * 1e-6), 1e-9, "A");
}

/// A nonlinear resistor counts by its slope.
#[test]
fn a_law_counts_by_its_slope() {
    let compiled = file(&models().join("elements/R_law.bond"), Options::new());
    let l = at(&compiled, &[]);
    // e = b f^2, slope 2 b f = 4 N s/m at 4 m/s; over 2 kg.
    close(l.a[(0, 0)], -2.0, 1e-14, "A");
}

/// A battery charges a capacitor through a diode and a resistor: A = -1/(C (R + r)), where the diode's slope is
/// r = U/(i + I) at the current i of U log(1 + i/I) + R i = E.
#[test]
fn a_diode_that_a_battery_drives() {
    for battery in [1.0, 12.0, 30.0, 400.0] {
        for resistor in [0.1, 100.0, 1e4] {
            let compiled = text(&format!(
                "model M {{
                  Se:battery = {battery} V
                  R:diode {{ f = 1 nA * (exp(e/50 mV) - 1) }}
                  R:lead = {resistor} Ohm
                  C:store = 100 uF
                  battery -> 1:i -> diode, lead, store
                }}"
            ));
            let mut low = (0.0, battery / resistor);
            for _ in 0..200 {
                let i = 0.5 * (low.0 + low.1);
                let over = 0.05 * f64::ln_1p(i / 1e-9) + resistor * i > battery;
                low = if over { (low.0, i) } else { (i, low.1) };
            }
            let a = -1.0 / (1e-4 * (resistor + 0.05 / (low.0 + 1e-9)));
            close(at(&compiled, &[]).a[(0, 0)] / a, 1.0, 1e-9, &format!("{battery} V, {resistor} Ohm"));
        }
    }
}

/// A diode that a coil asks, at rest: its slope there is all that the loop has, and is known to all digits.
#[test]
fn a_diode_behind_a_coil() {
    for law in ["1e-9 A * (exp(e/50 mV) - 1)", "1 nA * (exp(e/50 mV) - 1)", "2e-8 S * e + 1e-3 A/V^3 * e^3"] {
        let compiled = text(&format!(
            "model M {{
              Se:u = 0 V
              R:diode {{ f = {law} }}
              I:coil = 20 mH
              R:load = 5 Ohm
              u -> 1:m -> diode, coil, load
            }}"
        ));
        close(at(&compiled, &[]).a[(0, 0)] / -2_500_000_250.0, 1.0, 1e-14, law);
    }
}

/// Two sources that balance: no current flows, and the loop of resistors is known to rounding alone.
#[test]
fn a_balanced_loop() {
    let compiled = text(
        "model M {
  input u = 1 V
  Se:b = 1 V  R:r = 3 Ohm  R:s = 1 Ohm  Se:a = u
  1:k
  k -> b
  s -> k
  k -> r
  a -> k
  probe i = r.f
}",
    );
    let l = at(&compiled, &[]);
    assert_eq!(l.d.len(), 1, "{l:?}");
    assert!((l.d[(0, 0)] - 0.25).abs() < 1e-14, "{l:?}");
}

/// A root at 0: no number is its slope.
#[test]
fn an_infinite_slope_is_told() {
    let compiled = text("model M { C:tank = 1 m^3/Pa  R:hole { f = 1 m^3/(s*Pa^(1/2)) * sqrt(e) }  tank -> hole }");
    let told = compiled.linearize(0.0, &|_| None);
    assert!(told.as_ref().is_err_and(|e| e.starts_with("`tank.q` has no finite slope there")), "{told:?}");
}
