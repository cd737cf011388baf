//! Storages that are given by a law: what drives a run is the law as it is written, and its integral the energy.

use crate::common::{close, end, errors, finish, probe, start, with};
use bond::internal::CompiledInternals;
use bond::{Options, Steps};

/// A law in a length q, where it starts, its value there, and its integral from 1 m to there.
const LAWS: &[(&str, f64, f64, f64)] = &[
    ("-1 N*m^2 / q^2", 2.0, -0.25, -0.5),
    ("1 N*m / q", 2.0, 0.5, std::f64::consts::LN_2),
    ("-2 N * ((1 m) / q)^1.4", 2.0, -0.757_858_283_255_199_1, -1.210_708_583_724_005),
    ("if abs(q) > 0.5 m then 4 N/m * (q - sign(q)*0.5 m) else 0", 0.8, 1.2, -0.32),
    ("4 N/m * sign(q)*max(abs(q) - 0.5 m, 0)", -0.75, -1.0, -0.375),
    ("if q > 1 m and q < 2 m then 3 N else 1 N", 1.5, 3.0, 1.5),
    ("if q < 1 m or q > 2 m then 3 N else 1 N", 0.5, 3.0, -1.5),
    ("if q^2 > 2.25 m^2 then 3 N else 1 N", 2.0, 3.0, 2.0),
    ("if exp(q/(1 m)) > exp(1.5) then 3 N else 1 N", 2.0, 3.0, 2.0),
    ("1 N * max(min(q/(1 m), 1), q^2/(4 m^2))", 3.0, 2.25, 1.0 + 19.0 / 12.0),
    ("1 N/m^2 * q*abs(q - 1 m)", 3.0, 6.0, 26.0 / 3.0 - 4.0),
    ("1 N * sign(q)*max(0, abs(q/(1 m)) - 0.75)^1.5", -1.0, -0.125, 0.0),
    ("5 N * tanh(q/(1 mm))", 0.5, 5.0, -2.5),
    ("1 N * q/(1 m + abs(q))", -1.0, -0.5, 0.0),
    // no closed form: 20 nodes do
    ("1 N * sin(q/(1 m))/(q/(1 m))", 2.0, 0.454_648_713_412_840_8, 0.659_329_906_435_511_8),
];

#[test]
fn the_law_is_the_law() {
    for &(law, q0, force, energy) in LAWS {
        for method in ["gonzalez", "collocation4", "collocation8", "sav", "rk4"] {
            let model = |q0: f64| {
                format!(
                    "model M {{
                       C:c {{ e = {law}; q0 = {q0} m }}  I:m = 1 kg  R:b = 0.1 N*s/m
                       1:v -> c, m, b
                       probe F = c.e  probe H = c.H
                     }}"
                )
            };
            let at = |q0: f64| {
                let compiled = with(Options::new().method(method), &model(q0));
                let mut sim = start(&compiled, Steps::fixed(1e-3));
                let found = (probe(&mut sim, "F"), probe(&mut sim, "H"));
                finish(&mut sim, 0.3);
                (found, sim.summary().worst_step)
            };
            let ((found, high), worst) = at(q0);
            assert!(method == "rk4" || worst <= 1e-12, "{law}, {method}: a step's balance is off by {worst:e}");
            close(found, force, 1e-14 * force.abs(), law);
            close(high - at(1.0).0.1, energy, 4e-15 * high.abs().max(1.0), &format!("the energy of {law}"));
        }
    }
}

/// What cannot be integrated is refused, and nothing else put in its place.
#[test]
fn laws_without_an_energy_are_refused() {
    for law in [
        "1 N/m * (1 + tanh((q - 1 m)/(10 mm)))*(q - 1 m)",
        "1 N * log(1 + exp((q - 1 m)/(50 mm)))",
        "1 N * exp(-((q - 1 m)/(1 um))^2) + 1 N/m * q",
        "1 N * abs(sin(q/(1 m)))",
        "if sin(q/(1 m)) > 0 then 1 N else 0",
        "1 N * log(abs(q/(1 m)))*sin(q/(1 m))",
    ] {
        let found = errors(&format!("model M {{ C:c {{ e = {law}; q0 = 4 m }} I:m = 1 kg c -> m }}"));
        assert!(found.list().iter().any(|d| d.code == "elaborate::law"), "{law}: {found:?}");
    }
    // At 0 nothing is seen of it but its own rounding.
    let found = errors("model M { C:c { e = 1 N * log(1 + exp((q - 1 m)/(50 mm))) } I:m = 1 kg c -> m }");
    assert!(found.list().iter().any(|d| d.code == "elaborate::law"), "{found:?}");
}

/// A quotient whose closed form cancels where the storage is all but empty: the energy is right there all the same, and
/// the balance closes.
#[test]
fn small_energies_of_quotients_are_exact() {
    for (law, q, energy) in [
        ("10 N/m * q/(1 + abs(q)/(1 m))", 1e-5, 10.0 * (1e-5 - 1e-5f64.ln_1p())),
        ("10 N/m * q/(1 + abs(q)/(1 m))", 20.0, 10.0 * (20.0 - 20f64.ln_1p())),
        ("1 N * q/(1 m - q)", 0.95, -0.95 - 0.05f64.ln()),
        ("1 N * (q/(1 m))^5*sqrt(1 + q/(1 m))", 1e-3, 1e-18 / 6.0 + 1e-21 / 14.0),
    ] {
        let text = format!(
            "model M {{ C:c {{ e = {law}; q0 = {q} m }} I:m = 1 kg  R:r = 1 N*s/m  1:v -> c, m, r  probe H = c.H }}"
        );
        let compiled = with(Options::new(), &text);
        let mut sim = start(&compiled, Steps::tolerance(1e-6));
        let h = probe(&mut sim, "H");
        // The closed form that is compared with cancels, too.
        assert!((h / energy - 1.0).abs() < 1e-5, "{law}: {h:e} beside {energy:e}");
        finish(&mut sim, 1.0);
        let worst = sim.summary().regions[0].worst_step;
        assert!(worst < 1e-12, "{law} from {q}: {worst:e}");
    }
}

/// An energy in pieces, or of `log(abs(..))`, is as exact near rest as a polynomial, and so is that of a law which is a
/// small difference there, together with the law: a motion that dies away keeps its balance.
#[test]
fn energies_of_laws_are_exact_near_rest() {
    let (lncosh, half) = (|z: f64| z * z / 2.0 - z.powi(4) / 12.0, |z: f64| z * z / 2.0);
    let series = |of: &dyn Fn(f64) -> f64| (1..12).map(|k| of(f64::from(k))).sum::<f64>();
    let factorial = |k: f64| (1..=k as u32).map(f64::from).product::<f64>();
    let binomial = |n: f64, k: f64| (0..k as u32).map(|j| (n - f64::from(j)) / f64::from(j + 1)).product::<f64>();
    let sign = |k: f64| if k % 2.0 == 0.0 { -1.0 } else { 1.0 };
    let cases: [(&str, &dyn Fn(f64) -> f64); 15] = [
        ("exp(z) - 1", &|z| series(&|k| z.powf(k + 1.0) / factorial(k + 1.0))),
        ("if z > 0 then exp(z) - 1 else 0", &|z| series(&|k| z.powf(k + 1.0) / factorial(k + 1.0))),
        ("1 - exp(-2*z)", &|z| series(&|k| sign(k) * (2.0 * z).powf(k + 1.0) / factorial(k + 1.0)) / 2.0),
        ("log(1 + z)", &|z| series(&|k| sign(k) * z.powf(k + 1.0) / (k * (k + 1.0)))),
        ("(1 + z)^1.4 - 1", &|z| series(&|k| binomial(1.4, k) * z.powf(k + 1.0) / (k + 1.0))),
        ("1 - (1 + z)^(-1.4)", &|z| series(&|k| -binomial(-1.4, k) * z.powf(k + 1.0) / (k + 1.0))),
        ("sqrt(z + 2) - sqrt(2)", &|z| {
            series(&|k| binomial(0.5, k) * 2f64.powf(0.5 - k) * z.powf(k + 1.0) / (k + 1.0))
        }),
        ("z - sin(3*z)/3", &|z| {
            series(&|k| sign(k) * 9f64.powf(k) * z.powf(2.0 * k + 2.0) / ((2.0 * k + 2.0) * factorial(2.0 * k + 1.0)))
        }),
        ("z*log(1 + z^2)", &|z| series(&|k| sign(k) * z.powf(2.0 * k + 2.0) / (k * (2.0 * k + 2.0)))),
        ("tanh(z)", &lncosh),
        ("z/(1 + z^2)", &|z| half(z) - z.powi(4) / 4.0),
        ("2*tan(z/2)", &|z| half(z) + z.powi(4) / 48.0),
        ("2*sinh(z)/(1 + cosh(z))", &|z| half(z) - z.powi(4) / 48.0),
        ("atan(z)", &|z| half(z) - z.powi(4) / 12.0),
        ("z*exp(-z^2)", &|z| half(z) - z.powi(4) / 4.0),
    ];
    for (law, energy) in cases {
        for q in [1e-9, 1e-6, 1e-3, 0.02] {
            let law = law.replace('z', "(q/(1 m))");
            let text = format!(
                "model M {{ C:c {{ e = 1 N * ({law}); q0 = {q} m }} I:m = 1 kg  R:r = 0.5 N*s/m  1:v -> c, m, r }}"
            );
            let compiled = with(Options::new(), &text);
            let mut sim = start(&compiled, Steps::tolerance(1e-6));
            let h = sim.summary().regions[0].h_initial;
            assert!((h / energy(q) - 1.0).abs() < 1e-7, "{law}: {h:e} beside {:e}", energy(q));
            finish(&mut sim, 20.0);
            let summary = sim.summary();
            assert!(summary.passive && summary.worst_step < 1e-13, "{law} from {q}: {:e}", summary.worst_step);
        }
    }
}

/// Near rest a law swings as its slope there tells, forwards and back, by every stepper that iterates.
#[test]
fn small_motions_are_those_of_the_slope_at_rest() {
    let slope = 3.0 / 1f64.cosh().powi(2);
    for (law, k) in [("exp(z) - 1", 1.0), ("(1 + z)^1.4 - 1", 1.4), ("tanh(3*z - 1) + tanh(1)", slope)] {
        for method in ["gonzalez", "collocation4", "collocation8", "radau"] {
            let law = law.replace('z', "(q/(1 m))");
            let text = format!(
                "model M {{ C:c {{ e = 1 N * ({law}); q0 = 1 nm }} I:m = 1 kg  1:v -> c, m  probe x = c.q / (1 nm) }}"
            )
            .replace("c.q", "integral(v.f, 1 nm)");
            let compiled = with(Options::new().method(method), &text);
            let mut sim = start(&compiled, Steps::fixed(1e-3));
            finish(&mut sim, 5.0);
            close(probe(&mut sim, "x"), (k.sqrt() * 5.0).cos(), 5e-6, &format!("{law}, {method}"));
            let summary = sim.summary();
            assert!(method == "radau" || summary.worst_step < 1e-14, "{law}, {method}: {:e}", summary.worst_step);
        }
    }
}

/// Beyond the reach of the rule for a law without closed form a run stops.
#[test]
fn beyond_its_reach_a_law_stops_the_run() {
    let compiled = with(
        Options::new().method("gonzalez"),
        "model M {
           C:c { e = 1 N * sin(q/(1 m))/(q/(1 m)); q0 = 1 m }  I:m = 1 kg  Se:F = 3 N
           F -> 1:v
           v -> c, m
         }",
    );
    let mut sim = start(&compiled, Steps::fixed(1e-2));
    let told = sim.finish(100.0).err().map(|e| e.to_string());
    assert!(told.is_some_and(|e| e.contains("no finite value")), "stopped by something else");
}

/// A body of any heat capacity has a least energy, at 0 K, however far below that is; a well without a ground has none.
#[test]
fn energies_that_level_off_have_a_least() {
    let passive = |law: &str| {
        let compiled =
            crate::common::text(&format!("model M {{ C:c {law} R:r = 1 Ohm c -> r simulate {{ stop = 1 s }} }}"));
        let summary = crate::common::run(&compiled).unwrap_or_else(|e| panic!("{law}: {e}"));
        !summary.reasons.iter().any(|why| why.contains("no lower bound"))
    };
    for capacity in ["1e-3", "1", "2e3", "2e6", "1e9"] {
        assert!(passive(&format!("{{ e = 3 V * exp(q/({capacity} C)) }}")), "{capacity}");
    }
    assert!(!passive("{ H = -1 V^2*F * log(1 + (q/1 C)^2); q0 = 1 C }"));
    assert!(!passive("{ e = 1 V/C * q - 1e-6 V/C^3 * q^3; q0 = 1 C }"));
}

/// n log(n/V) has values where both are negative, and falls there without end: no gas gets to them. Its terms cancel
/// but for rounding while it is near its least, which is no energy from nothing.
#[test]
fn a_gas_is_as_far_as_its_start_leads() {
    let text = |energy: &str| {
        format!(
            "model Gas(pa = 1 bar, V0 = 20 cm^3, A = 8 cm^2) {{
               C(n, x):gas {{ H = {energy}; n_0 = 20 cm^3 }}
               R:valve = 1e8 Pa*s/m^3
               Se:supply = 1e5 Pa
               I:piston = 1 kg
               R:seal = 10 N*s/m
               supply -> 1:in -> valve
               in -> gas.n
               1:v -> piston, seal
               v -> gas.x
               simulate {{ stop = 0.1 s }}
             }}"
        )
    };
    for energy in [
        "pa*n*log(n/(V0 + A*x)) - pa*(n - V0 - A*x)",
        "pa*n*(log(n/(20 cm^3)) - log((V0 + A*x)/V0)) - pa*(n - V0 - A*x)",
    ] {
        let summary = crate::common::run(&crate::common::text(&text(energy))).unwrap_or_else(|e| panic!("{e}"));
        assert!(summary.passive, "{energy}: {:?}", summary.reasons);
        assert!(summary.worst_step < 1e-14, "{energy}: {:e}", summary.worst_step);
    }
    // With the other sign the same scene has none.
    let other = crate::common::text(&text("pa*n*log((V0 + A*x)/n)"));
    let excluded = &other.scene().excluded;
    assert!(excluded.iter().any(|x| x.why.contains("no lower bound")), "{excluded:?}");
}

/// A stiffness that depends on the storage's own state is the law e = k(q) q, whose energy is not k(q) q^2/2.
#[test]
fn values_of_the_own_state_are_laws() {
    for (short, law) in [
        ("stiffness = 1 N/m + (1 N/m^3)*c.q^2", "e = 1 N/m * q + (1 N/m^3)*q^3"),
        ("compliance = 1 m/N + (1/(1 N))*abs(c.q)", "e = q/(1 m/N + (1/(1 N))*abs(q))"),
    ] {
        let [own, plain] = [short, law].map(|field| {
            let model = format!(
                "model M {{ I:m = 1 kg  C:c {{ {field}; q0 = 1 m }}  1:v -> m, c  probe q = c.q  probe h = c.H }}"
            );
            with(Options::new(), &model)
        });
        for name in ["q", "h"] {
            let [a, b] = [&own, &plain].map(|c| end(c, Steps::tolerance(1e-9), 0.5, name));
            close(a, b, 1e-7, &format!("{name} of {short}"));
        }
    }
    let pushed = with(
        Options::new(),
        "model M { Se:s = 1 N  I:m = 1 kg + (1 s/m)*abs(m.p)  s -> 1:v -> m  probe h = m.H  probe w = integral(s.P, 0 J) }",
    );
    for name in ["h", "w"] {
        close(end(&pushed, Steps::tolerance(1e-9), 1.0, name), 1.0 - f64::ln(2.0), 1e-7, name);
    }
}

/// What else a condition depends on may turn it round: nothing is proved by it then.
#[test]
fn a_condition_of_another_signal_proves_nothing() {
    let law = |condition: &str| {
        let scene = format!(
            "model M {{
              Se:s = 1 N
              I:m = 1 kg
              state z = 0 {{ dz = -10 Hz }}
              R:r {{ e = (if {condition} > 0 then (f/(1 m/s))^2 else -(f/(1 m/s))^2)*1 N }}
              s -> 1:v -> m, r
              probe x = r.e + z*1 N
            }}"
        );
        with(Options::new(), &scene).show("phs")
    };
    assert!(law("f").contains("proved to take power"), "{}", law("f"));
    assert!(law("f*(z + 3)").contains("not proved to take power"), "{}", law("f*(z + 3)"));
}
