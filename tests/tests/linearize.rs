//! The linear model around a state, against matrices by hand.

use crate::common::{close, file, models, text};
use bond::internal::CompiledInternals;
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

/// A controller that is sampled drives a mass by its state: that is an input, and the loop is not closed. It may be
/// read by a source that switches on it, too, and what does not read it has no part of it.
#[test]
fn what_is_sampled_is_given() {
    let compiled = text(
        "model S {
          input ref = 1 m/s
          sampled at 100 Hz {
            state u = 4 N { next = (3 N*s/m)*(ref - v.f) }
            state d = 0.5 { next = d/2 }
          }
          MSe:F = u*u/(1 N)
          Se:G = if mod(t, 1 s) < d*(1 s) then 3 N else 1 N
          I:m = 2 kg
          R:b = 1 N*s/m
          F -> 1:v -> m, b
          G -> v
          probe speed = v.f
          probe force = u
          probe pulse = G.e
        }",
    );
    let l = at(&compiled, &[]);
    assert_eq!((l.states.len(), l.inputs.as_slice()), (1, ["ref", "u", "d"].map(String::from).as_slice()));
    assert_eq!((l.a[(0, 0)], l.b.row(0).iter().copied().collect::<Vec<_>>()), (-0.5, vec![0.0, 8.0, 0.0]));
    let d: Vec<Vec<f64>> = l.d.row_iter().map(|r| r.iter().copied().collect()).collect();
    assert_eq!(d, [[0.0; 3], [0.0, 1.0, 0.0], [0.0; 3]]);
    assert_eq!(at(&compiled, &[("u", 5.0)]).b[(0, 1)], 10.0);
}

/// What a source reads of a sampled region is held: its state, what its storage gives, and what a loop of resistors in
/// it comes to. How these follow what is continuous is not looked through, and neither is a sum over samples.
#[test]
fn what_is_sampled_stands_still() {
    let compiled = text(
        "model S {
          sampled every 1 ms {
            Se:s = (2 N*s/m)*v.f  C:c = 1 m/N  R:r = 1 N*s/m  R:q { e = (1 N*s^2/m^2) * f*abs(f) }
            s -> 1:x -> r, c, q
          }
          MSe:F = s.e - (3 N/m)*c.q - r.e
          I:m = 2 kg
          R:b = 1 N*s/m
          F -> 1:v -> m, b
          probe speed = v.f
          probe sum = integral(c.e, 0 N*s)
          probe gone = integral(F.e, 0 N*s)
        }",
    );
    let l = at(&compiled, &[("m.p", 1.0)]);
    assert_eq!((l.states.len(), l.inputs.len()), (2, 3), "{:?} {:?}", l.states, l.inputs);
    close(l.a[(0, 0)], -0.5, 1e-15, "A");
    assert_eq!(l.a[(1, 0)], 0.0);
    for (name, wanted) in [("c.q", -3.0), ("c.e", 1.0), ("q.e", 1.0)] {
        let k = l.inputs.iter().position(|n| n == name).unwrap_or_else(|| panic!("{:?}", l.inputs));
        assert_eq!((l.b[(0, k)], l.b[(1, k)]), (wanted, wanted), "{name}");
    }
}

/// A root at 0: no number is its slope.
#[test]
fn an_infinite_slope_is_told() {
    let compiled = text("model M { C:tank = 1 m^3/Pa  R:hole { f = 1 m^3/(s*Pa^(1/2)) * sqrt(e) }  tank -> hole }");
    let told = compiled.linearize(0.0, &|_| None);
    assert!(told.as_ref().is_err_and(|e| e.starts_with("`tank.q` has no finite slope there")), "{told:?}");
}

/// Poles and response of a damped oscillator driven by a force, whose probe x has the gain 1/(k - m w^2 + j b w):
/// below, at and above resonance. The integral of a probe is a pole at 0 itself, beside fast ones.
#[test]
fn poles_and_response() {
    let compiled = text(
        "model M {
          input u = 0 N
          Se:force = u
          C:spring { stiffness = 8e6 N/m }
          I:mass = 2 kg
          R:drag = 3 N*s/m
          force -> 1:v -> spring, mass, drag
          probe x = spring.q
          probe gone = integral(mass.p, 0 N*s^2)
        }",
    );
    let l = at(&compiled, &[]);
    let poles = l.poles().unwrap();
    let w = f64::sqrt(4e6 - 0.75 * 0.75);
    assert_eq!((poles.len(), poles[0].re, poles[0].im), (3, 0.0, 0.0));
    for (p, sign) in poles[1..].iter().zip([1.0, -1.0]) {
        close(p.re, -0.75, 1e-12, "real part");
        close(p.im, sign * w, 1e-9, "imaginary part");
    }
    for w in [1.0, 2e3, 1e5] {
        let found = l.response(w / std::f64::consts::TAU)[(0, 0)];
        let wanted = nalgebra::Complex::new(8e6 - 2.0 * w * w, 3.0 * w).inv();
        close(found.re, wanted.re, 1e-9 * wanted.norm(), "real part");
        close(found.im, wanted.im, 1e-9 * wanted.norm(), "imaginary part");
    }
    // Its integral has no gain at 0 Hz; it has one itself.
    let still = l.response(0.0);
    assert!(still[(1, 0)].re.is_infinite());
    close(still[(0, 0)].re, 1.0 / 8e6, 1e-20, "compliance");
}

/// A chain of masses between walls, whose frequencies are 2 sin(k pi / (2 n + 2)) (Rayleigh), in units a million apart,
/// so that A has to be balanced.
#[test]
fn poles_of_a_chain() {
    let (n, last) = (40, 39);
    let mut scene = format!(
        "model Chain {{\n for i in 0..{last} {{ I:m[i] = 1e-6 kg  1:v[i] -> m[i] }}\n for i in 0..{n} {{ C:k[i] {{ \
         stiffness = 1e6 N/m }} }}\n v[0] -> k[0]\n v[{last}] -> k[{n}]\n"
    );
    scene += &format!(" for i in 1..{last} {{ v[i-1] -> 0:d[i] -> v[i]  d[i] -> k[i] }}\n}}\n");
    let poles = at(&text(&scene), &[]).poles().unwrap();
    assert_eq!(poles.len(), 2 * n + 1);
    // The springs' lengths have a sum that stays.
    close(poles[0].norm(), 0.0, 1e-6, "the pole that is 0");
    for (k, pair) in poles[1..].chunks(2).enumerate() {
        let wanted = 2e6 * f64::sin((k + 1) as f64 * std::f64::consts::FRAC_PI_2 / (n + 1) as f64);
        close(pair[0].im, wanted, 1e-9 * wanted, "frequency");
        close(pair[0].re, 0.0, 1e-9 * wanted, "damping");
        close(pair[1].im, -wanted, 1e-9 * wanted, "frequency");
    }
}

/// Two pendulums, one on the other, that hang at rest: (2 +- sqrt(2)) g/l are the squares of their frequencies. Joints
/// have no inertia, and no constraint adds a pole.
#[test]
fn a_chain_of_pendulums_swings() {
    let path = models().join("examples/pendulum_chain.bond");
    let compiled = file(&path, Options::new().set("n", "2").set("start", "0"));
    let l = at(&compiled, &[]);
    let poles = l.poles().unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(poles.len(), 4, "{poles:?}");
    for (pair, sign) in poles.chunks(2).zip([-1.0, 1.0]) {
        let wanted = ((2.0 + sign * 2.0f64.sqrt()) * 9.81).sqrt();
        close(pair[0].im, wanted, 1e-12, "a frequency");
        close(pair[0].re, 0.0, 1e-12, "its damping");
    }
}

/// A parallelogram that stands upright falls: its bars and its coupler are one body. Its three angles are one, which
/// leaves two poles at 0.
#[test]
fn a_parallelogram_falls_over() {
    let path = models().join("mechanisms/n_four_bar.bond");
    let compiled = file(&path, Options::new().set("n", "1").set("w0", "0"));
    let poles = at(&compiled, &[]).poles().unwrap_or_else(|e| panic!("{e}"));
    let wanted = (9.81 * 2.0f64 / (2.0 / 3.0 + 1.0)).sqrt();
    assert_eq!(poles.len(), 4, "{poles:?}");
    let found: Vec<f64> = poles.iter().map(|p| p.re.abs()).collect();
    for (found, wanted) in found.into_iter().zip([0.0, 0.0, wanted, wanted]) {
        close(found, wanted, 1e-12, "a pole");
    }
}
