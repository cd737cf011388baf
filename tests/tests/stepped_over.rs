//! What fitted steps must not step over: sources that swing while nothing moves, known times after laws that go to and
//! fro, what is far too fast at the start, and what is small beside stored heat.

use crate::common::{advance, close, finish, probe, start, with};
use bond::internal::{CompiledInternals, OptionsInternals, SimulationInternals, StepsInternals};
use bond::{Compiled, Options, Steps};
use bond_compiler::discretise::Accuracy;

/// Compiled for a tolerance, by a method or the default.
fn compiled(text: &str, method: Option<&str>, tolerance: Option<f64>) -> Compiled {
    let mut options = Options::new();
    options = method.into_iter().fold(options, |o, m| o.method(m));
    options = tolerance.into_iter().fold(options, |o, x| o.accuracy(Accuracy::Tolerance(x)));
    options.compile_str("scene.bond", text).unwrap_or_else(|e| panic!("{e}"))
}

/// A probe at an instant, and how many steps that took.
fn at(compiled: &Compiled, tolerance: Option<f64>, probe: &str, t: f64) -> (f64, u64) {
    let steps = tolerance.map_or(Steps::new(), Steps::tolerance);
    let settings = &compiled.stages().model.settings;
    let options = steps.resolve(settings, settings.stop.unwrap_or(t), None).unwrap();
    let mut sim = bond::Simulation::new(compiled.scene(), &options).unwrap();
    sim.advance(t).unwrap();
    let summary = sim.summary();
    assert!(!summary.regions[0].passive_stepper || summary.passive, "{probe}");
    (sim.probe(probe).unwrap(), summary.regions[0].steps)
}

/// A half-wave rectifier: while the diode blocks nothing moves by which a step would know of the next pulse. The
/// numbers are of an implicit Runge-Kutta method with steps of a thousandth of the period, and tolerances of 1e-12.
#[test]
fn pulses_of_diodes() {
    let rectifier = |diode: &str, rs: &str| {
        format!(
            "model Rect {{
               Se:u = 10 V * sin(2*pi*50 Hz * t)
               R:rs = {rs}
               R:d {{ {diode} }}
               C:c = 1 mF
               R:load = 1 kOhm
               u -> 1:m -> rs, d, 0:o
               o -> c, load
               probe uo = o.e
               simulate {{ stop = 0.1 s }}
             }}"
        )
    };
    let ideal = rectifier("e = min(s, 0) * 1 V; f = max(s, 0) * 1 A", "2 Ohm");
    let exact = [(0.049, 9.576_029), (0.0688, 9.653_887), (0.0886, 9.685_734)];
    let mut tried = vec![(None, None)];
    for x in [1e-5, 1e-7, 1e-8, 1e-9, 1e-10] {
        tried.push((None, Some(x)));
    }
    tried.extend([Some("radau"), Some("dop853"), Some("collocation4")].map(|m| (m, Some(1e-9))));
    for (method, tolerance) in tried {
        let scene = compiled(&ideal, method, tolerance);
        for (t, value) in exact {
            let (uo, _) = at(&scene, tolerance, "uo", t);
            assert!((uo - value).abs() < 2e-3, "{method:?} {tolerance:?} at {t}: {uo}");
        }
    }
    let shockley = rectifier("f = 1e-9 A * (exp(e/(40 mV)) - 1)", "0.5 Ohm");
    let reference = compiled(&shockley, Some("dop853"), Some(1e-11));
    for tolerance in [None, Some(1e-9)] {
        let scene = compiled(&shockley, None, tolerance);
        for t in [0.049, 0.0688, 0.0886] {
            let (uo, _) = at(&scene, tolerance, "uo", t);
            let (value, _) = at(&reference, Some(1e-11), "uo", t);
            assert!((uo - value).abs() < 2e-3, "{tolerance:?} at {t}: {uo}, {value}");
        }
    }
}

/// Two diodes to one condenser: collocation does not solve short steps where they begin to conduct, and the other
/// stepper takes these.
#[test]
fn diodes_that_begin_to_conduct() {
    let text = "model Centre {
      Se:u1 = 17 V * sin(100*pi*t * 1 s^-1)
      Se:u2 = -17 V * sin(100*pi*t * 1 s^-1)
      R:r1 = 1 Ohm
      R:r2 = 1 Ohm
      R:d1 { f = 1e-9 A * (exp(e/(40 mV)) - 1) + 1e-9 S * e }
      R:d2 { f = 1e-9 A * (exp(e/(40 mV)) - 1) + 1e-9 S * e }
      C:c = 1 mF
      R:load = 60 Ohm
      u1 -> 1:m1 -> r1, d1
      u2 -> 1:m2 -> r2, d2
      m1 -> 0:a
      m2 -> a
      a -> c, load
      probe v = c.e
      simulate { stop = 0.1 s }
    }";
    let (value, _) = at(&compiled(text, Some("dop853"), Some(1e-9)), Some(1e-9), "v", 0.1);
    for (method, tolerance) in [(None, 1e-6), (None, 1e-8), (Some("collocation6"), 1e-6), (Some("gonzalez"), 1e-6)] {
        let (v, steps) = at(&compiled(text, method, Some(tolerance)), Some(tolerance), "v", 0.1);
        assert!((v - value).abs() < 2e-3 && steps < 50_000, "{method:?} {tolerance:e}: {v}, {value}, {steps} steps");
    }
}

/// What switches by a sine of time does so in each of its periods: a charge that is let go for a known part of each.
#[test]
fn switches_of_time() {
    let text = "model S {
      C:c { compliance = 1 mF; e0 = 10 V }
      MR:r { f = (if sin(2*pi*50 Hz * t) > 0.9 then 10 mS else 0 S) * e }
      c -> r
      probe u = c.e
      simulate { stop = 2 s }
    }";
    let on = 100.0 * 0.02 * (0.5 - 0.9f64.asin() / std::f64::consts::PI);
    let exact = 10.0 * (-10.0 * on).exp();
    let (u, _) = at(&compiled(text, None, None), None, "u", 2.0);
    assert!((u / exact - 1.0).abs() < 1e-4, "{u}, {exact}");
}

/// A linear region takes `exact` where that follows its sources, whatever they swing like, and a method whose steps are
/// fitted where it does not.
#[test]
fn sources_of_linear_regions() {
    let low_pass = |source: &str| {
        format!(
            "model S {{
               Se:u = {source}
               R:r = 1 kOhm
               C:c = 100 uF
               u -> 1:i -> r, c
               probe out = c.e
               simulate {{ stop = 1 s }}
             }}"
        )
    };
    // 10 V sin^2 is 5 V less 5 V cos(2 w t), of which next to nothing comes through.
    let charged = |v: f64| v * (1.0 - (-10.0f64).exp());
    let squared = compiled(&low_pass("10 V * sin(2*pi*1 kHz * t)^2"), None, None);
    assert_eq!(&*squared.scene().clusters[0].step.name, "exact");
    let (w, tau) = (4000.0 * std::f64::consts::PI, 0.1);
    let ripple = |t: f64| {
        let z = w * tau;
        5.0 / (1.0 + z * z) * ((w * t).cos() + z * (w * t).sin() - (-t / tau).exp())
    };
    let (u, _) = at(&squared, None, "out", 1.0);
    assert!((u - (charged(5.0) - ripple(1.0))).abs() < 1e-12, "{u}");
    let product = compiled(&low_pass("10 V * sin(2*pi*1 kHz * t) * cos(2*pi*1 kHz * t - pi/2)"), None, None);
    assert!((at(&product, None, "out", 1.0).0 - u).abs() < 1e-12);
    // On for a known part of each of 10 000 periods.
    let text = low_pass("if sin(2*pi*10 kHz * t) > 0.3 then 10 V else 0 V");
    let switched = compiled(&text, None, None);
    assert_eq!(&*switched.scene().clusters[0].step.name, "collocation6");
    let mean = 10.0 * (0.5 - 0.3f64.asin() / std::f64::consts::PI);
    let (u, steps) = at(&switched, None, "out", 1.0);
    assert!((u - charged(mean)).abs() < 1e-2 && steps > 20_000, "{u}, {steps} steps");
    // Known times and pieces of low degree are followed; a step that is told is taken.
    for source in ["if t < 0.3 s then 10 V else 2 V/s * t", "10 V * min(t, 0.2 s)/(1 s)", "3 V * cos(t * 1 s^-1)"] {
        assert_eq!(&*compiled(&low_pass(source), None, None).scene().clusters[0].step.name, "exact", "{source}");
    }
    let fixed = Options::new().accuracy(Accuracy::Fixed).compile_str("scene.bond", text).unwrap();
    assert_eq!(&*fixed.scene().clusters[0].step.name, "exact");
}

/// A tank runs empty, so that its orifice goes to and fro by rounding; the pump that starts later does so on time.
#[test]
fn known_times_after_rest() {
    // From level 0 at 40 s on, A dh/dt = pump - a sqrt(2 g h), which has a closed form: t as a function of the root of
    // h.
    let one = "model One(A = 0.1 m^2, a = 1e-3 m^2, rho = 1000 kg/m^3, g = 9.81 m/s^2) {
      Sf:pump = if t > 40 s then 2e-3 m^3/s else 0
      C:tank { stiffness = rho*g/A; q0 = 0.01 m^3 }
      R:hole { f = a*sqrt(2/rho)*sign(e)*sqrt(abs(e)) }
      pump -> 0:p -> tank, hole
      probe h = tank.q/A
      simulate { stop = 80 s }
    }";
    let time_to = |h: f64| {
        let (area, inflow, k) = (0.1, 2e-3, 1e-3 * (2.0 * 9.81f64).sqrt());
        let root = h.sqrt();
        -2.0 * area / k * (root + inflow / k * (1.0 - k * root / inflow).ln())
    };
    for tolerance in [None, Some(1e-4), Some(1e-7), Some(1e-8), Some(1e-10)] {
        let (h, _) = at(&compiled(one, None, tolerance), tolerance, "h", 44.0);
        let off = (time_to(h) - 4.0).abs();
        assert!(off < 1e-2 && (tolerance != Some(1e-10) || off < 1e-5), "{tolerance:?}: {h}, off by {off} s");
    }
    let two = "model Two(A = 0.1 m^2, a = 1e-3 m^2, rho = 1000 kg/m^3, g = 9.81 m/s^2) {
      Sf:pump = if t > 60 s then 2e-3 m^3/s else 0
      C:t1 { stiffness = rho*g/A; q0 = 0.02 m^3 }
      C:t2 { stiffness = rho*g/A; q0 = 0.01 m^3 }
      R:hole { f = a*sqrt(2/rho)*sign(e)*sqrt(abs(e)) }
      pump -> 0:p -> t1
      p -> 1:pipe -> hole
      pipe -> 0:p2 -> t2
      probe h = t1.q/A - t2.q/A
      simulate { stop = 70 s }
    }";
    for (method, tolerance) in [(None, None), (None, Some(1e-9)), (Some("collocation6"), Some(1e-10))] {
        let (h, _) = at(&compiled(two, method, tolerance), tolerance, "h", 62.0);
        assert!((h - 0.021_267_8).abs() < 2e-6, "{method:?} {tolerance:?}: {h}");
    }
}

/// Two condensers over a small resistor, one charged otherwise: 1e-12 s are all that it takes, of 5 s.
#[test]
fn what_is_far_too_fast_at_the_start() {
    for link in ["1e-6 Ohm", "1e-4 Ohm"] {
        let text = format!(
            "model Stiff {{
               Se:battery = 1 V
               R:feed {{ e = 1 Ohm * f + 0.1 Ohm/A^2 * f^3 }}
               R:link = {link}
               C:slow = 1 F
               C:fast {{ compliance = 1 uF; e0 = -1 V }}
               battery -> 1:a -> feed
               a -> 0:n1 -> slow
               n1 -> 1:b -> link, 0:n2
               n2 -> fast
               probe apart = fast.e - slow.e
               simulate {{ stop = 5 s }}
             }}"
        );
        for method in [None, Some("collocation4"), Some("collocation12"), Some("gonzalez")] {
            let (apart, steps) = at(&compiled(&text, method, Some(1e-6)), Some(1e-6), "apart", 5.0);
            assert!(apart.abs() < 1e-6 && steps < 30_000, "{link} {method:?}: {apart} after {steps} steps");
        }
    }
}

/// What moves within microseconds is seen by the first step, however long the run is: a coil that is thrown onto a
/// charged capacitor, against DOP853 of scipy at 1e-12.
#[test]
fn a_start_is_resolved_in_a_run_of_any_length() {
    for stop in ["1 ms", "60 s", "3600 s", "1e6 s"] {
        let text = format!(
            "model Coil {{
              C:cap {{ compliance = 100 nF; e0 = 10 V }}
              I:coil {{ f = p/(1 mH) + p^3 * 1e9 A/Wb^3 }}
              R:wire = 5 Ohm
              1:loop -> coil, wire
              cap -> loop
              probe i = loop.f
              simulate {{ stop = {stop} }}
            }}"
        );
        for (method, tolerance) in [(None, None), (Some("radau"), None), (Some("sav"), None), (None, Some(1e-8))] {
            let compiled = compiled(&text, method, tolerance);
            for (t, wanted) in [(1e-5, 0.0825864), (1e-4, -0.0439912)] {
                let (i, _) = at(&compiled, tolerance, "i", t);
                close(i, wanted, 2e-5, &format!("at {t} s of {stop}, {method:?}, {tolerance:?}"));
            }
        }
    }
}

/// `radau` damps what is too fast for its steps: after a long rest its steps are long, and a push then throws a mass on
/// a spring, that must not be passed over.
#[test]
fn a_push_after_a_long_rest() {
    let text = "model Jump {
      Se:u = if t < 1e6 s then 0 N else 1 N
      I:mass = 1 kg
      C:spring { H = 0.5*(1 N/m)*q^2 + 0.25*(1 N/m^3)*q^4; q0 = 0.1 m }
      R:d = 0.05 N*s/m
      u -> 1:v -> mass, spring, d
      probe x = spring.q
      simulate { stop = 2e6 s }
    }";
    let (x, _) = at(&compiled(text, Some("radau"), None), None, "x", 1e6 + 10.0);
    close(x, 0.93419, 1e-4, "10 s after the push");
}

/// A longest step that is longer than the run says nothing.
#[test]
fn a_longest_step_beyond_the_run() {
    let text = "model Duffing {
      I:mass = 1 kg
      C:spring { H = 0.5*(1 N/m)*q^2 + 0.25*(1 N/m^3)*q^4; q0 = 1 m }
      1:v -> mass, spring
      probe x = spring.q
      simulate { stop = 10 s }
    }";
    let compiled = compiled(text, None, None);
    let run = |longest: f64| crate::common::end(&compiled, Steps::new().longest(longest), 10.0, "x");
    let whole = run(10.0);
    close(whole, 0.79888, 1e-3, "with a step as long as the run");
    for longest in [20.0, 1e5, 1e50, 1e300] {
        assert_eq!(run(longest), whole, "{longest}");
    }
}

/// A small circuit heats a body: its errors are measured by its own sizes, however much heat there is.
#[test]
fn small_beside_heat() {
    let exact = 0.127_173_379_763;
    for heat in ["1 J/K", "33 kJ/K"] {
        let text = format!(
            "model Chip(C0 = {heat}) {{
               C:c {{ compliance = 1 uF; e0 = 1 V }}
               I:l = 1 mH
               RS(r, th):res = 2 Ohm
               C:body {{ H = C0*(300 K)*(exp(q/C0) - 1) + C0*(300 K) }}
               1:i -> c, l, res.r
               res.th -> body
               probe u = c.e
               simulate {{ stop = 2 ms }}
             }}"
        );
        for (tolerance, most) in [(None, 5e-4), (Some(1e-6), 1e-6), (Some(1e-9), 1e-9)] {
            let (u, _) = at(&compiled(&text, None, tolerance), tolerance, "u", 2e-3);
            assert!((u - exact).abs() < most, "{heat} {tolerance:?}: {u}");
        }
    }
}

/// Two conductors of heat in a row, until they are at rest: that no entropy falls is told to rounding.
#[test]
fn conductors_in_a_row() {
    let text = "model Row(h = 2 W/K) {
      C:hot { H = 500 J/K*300 K * exp(q/(500 J/K)); q0 = 50 J/K }
      C:cold { H = 800 J/K*300 K * exp(q/(800 J/K)) }
      R(a, b):one { a.f = h*(a.e - b.e)/a.e; b.f = h*(b.e - a.e)/b.e }
      R(a, b):two { a.f = 5*h*(a.e - b.e)/a.e; b.f = 5*h*(b.e - a.e)/b.e }
      0:warm -> hot; warm -> one.a
      0:between -> one.b; between -> two.a
      0:cool -> two.b; cool -> cold
      probe apart = warm.e - cool.e
      simulate { stop = 1e5 s }
    }";
    let (apart, _) = at(&compiled(text, None, None), None, "apart", 1e5);
    assert!(apart.abs() < 1e-6, "{apart}");
    // What does let entropy fall is told all the same, in short steps too.
    let wrong = text.replace("= h*", "= -h*").replace("= 5*h*", "= -5*h*");
    let scene = compiled(&wrong, None, None);
    let mut sim = scene.simulate(Steps::fixed(1e-3)).unwrap();
    sim.advance(0.1).unwrap();
    assert!(sim.summary().reasons.iter().any(|r| r.contains("entropy fell")), "{:?}", sim.summary().reasons);
}

/// A law at its corner, where it has no slope, says nothing of one that it shares no unknown with: both start.
#[test]
fn laws_that_share_nothing_start_by_themselves() {
    for oil in ["f = (0.1 m/s)*sinh(e/(50 N))", "f = (0.1 m/s)*sign(e)*sqrt(abs(e)/(50 N))"] {
        let text = format!(
            "model S {{
               I:m0 = 1 kg
               I:m1 {{ inertia = 1 kg; f0 = 1 m/s }}
               R:dry {{ e = (1 N)*min(max(s,-1),1); f = (s-min(max(s,-1),1))*(1 m/s) }}
               R:oil {{ {oil} }}
               C:c {{ stiffness = 100 N/m }}
               1:v0 -> m0, dry
               1:v1 -> m1, oil
               v1 -> 0:n -> v0
               n -> c
               probe f0 = v0.f
               simulate {{ stop = 1 s }}
             }}"
        );
        let (f0, _) = at(&compiled(&text, None, Some(1e-6)), Some(1e-6), "f0", 1.0);
        assert!(f0.is_finite() && f0.abs() < 1.0, "{f0}");
    }
}

/// A circuit beside a car: the car's energy is no measure of the circuit's errors. The circuit rings under the constant
/// voltage that the car induces.
#[test]
fn small_beside_what_coasts() {
    let text = "model Tacho {
      I:car { inertia = 1500 kg; f0 = 30 m/s }
      R:drag { e = 0.5 N*s^2/m^2 * f*abs(f) }
      GY:tacho = 1e-3 N/A
      I:l = 1 mH
      C:c { compliance = 1 nF; e0 = 1 V }
      R:r = 10 Ohm
      1:v -> car, drag, tacho
      tacho -> 1:i -> l, c, r
      probe u = c.e
      simulate { stop = 1 ms }
    }";
    let (decay, turn, t) = (5000.0_f64, (1e12_f64 - 2.5e7).sqrt(), 1e-3);
    let free = (-decay * t).exp() * ((turn * t).cos() + decay / turn * (turn * t).sin());
    let exact = 0.03 + (1.0 - 0.03) * free;
    for (tolerance, most) in [(None, 5e-3), (Some(1e-9), 1e-6)] {
        let (u, _) = at(&compiled(text, None, tolerance), tolerance, "u", t);
        assert!((u - exact).abs() < most, "{tolerance:?}: {u}, and not {exact}");
    }
}

/// A first step far beyond what an explicit method can take: what it throws far off is not taken for the size of
/// things.
#[test]
fn what_explodes_is_not_its_own_measure() {
    for law in ["R:rs = 1 uOhm", "R:rs { f = if e > 0 V then e/(1 uOhm) else 0 A }"] {
        let text = format!(
            "model Stiff {{
               Se:s = 10 kV * sin(2*pi*50 Hz * t)
               {law}
               C:c = 1 mF
               s -> 1:a -> rs, c
               probe behind = s.e - c.e
               simulate {{ stop = 0.2 s }}
             }}"
        );
        for method in ["rk4", "rk45", "dop853"] {
            // C du/dt times R.
            let wanted = 1e-9 * 1e4 * 100.0 * std::f64::consts::PI;
            let (behind, _) = at(&compiled(&text, Some(method), Some(1e-6)), Some(1e-6), "behind", 1e-5);
            assert!((behind - wanted).abs() < 1e-4, "{law}, {method}: {behind}");
        }
    }
}

/// Laws with kinks and roots, of which one matrix a step tells one side alone: the stages of a step are solved
/// together.
#[test]
fn stages_beyond_a_kink() {
    let boost = "model Boost {
      Se:s = 12 V
      I:l = 100 uH
      C:c = 10 uF
      R:load = 20 Ohm
      R:d { f = if e > 0 V then e/(10 mOhm) else e/(1 MOhm) }
      R:rl = 50 mOhm
      s -> 1:a -> l, rl, 0:o
      o -> 1:b -> d, 0:q
      q -> c, load
      let on = if sin(2*pi*50 kHz * t) > 0 then 20 S else 1 uS
      R:switch { f = on*e }
      o -> switch
      probe v = c.e
      probe i = l.f
      simulate { stop = 0.2 ms }
    }";
    let fine = compiled(boost, Some("gonzalez"), Some(1e-10));
    let (want, _) = at(&fine, Some(1e-10), "v", 2e-4);
    for (method, tolerance, most) in [("radau", 1e-7, 1000), ("collocation6", 1e-8, 2000), ("collocation8", 1e-9, 2000)]
    {
        let (v, steps) = at(&compiled(boost, Some(method), Some(tolerance)), Some(tolerance), "v", 2e-4);
        assert!((v - want).abs() < 1e-5 * want.abs(), "{method}: {v} where {want} is due");
        assert!(steps < most, "{method}: {steps} steps");
    }
}

/// A tank that runs empty through an orifice, q' = -k sqrt(q/C): sqrt(q) falls by k/(2 sqrt(C)) a second. At tolerances
/// that ask for order 8 that order is taken, whatever the slope at the end.
#[test]
fn orifices_at_order_8() {
    let text = "model Tank {
      C:tank { compliance = 1e-8 m^3/Pa; q0 = 4e-4 m^3 }
      R:hole { f = 1e-6 m^3/(s*Pa^(1/2)) * sign(e)*sqrt(abs(e)) }
      tank -> hole
      probe q = tank.q
      simulate { stop = 6 s }
    }";
    let tank = compiled(text, None, Some(1e-9));
    let start = 4e-4f64.sqrt();
    let rate = 1e-6 / (2.0 * 1e-8f64.sqrt());
    for t in [1.0, 3.0, 3.9] {
        let (q, steps) = at(&tank, Some(1e-9), "q", t);
        let want = (start - rate * t).powi(2);
        assert!((q - want).abs() < 1e-9 * 4e-4, "{q} where {want} is due");
        assert!(steps < 200, "{steps} steps");
    }
    let (empty, _) = at(&tank, Some(1e-9), "q", 6.0);
    assert!(empty.abs() < 1e-8 * 4e-4, "{empty}");
    // From rest, where the slope has no bound, by what damps what is stiff too.
    let text = "model Line {
      Sf:pump = 1e-4 m^3/s
      C:acc = 1.4e-10 m^3/Pa
      I:line = 1e7 kg/m^4
      C:load = 1e-12 m^3/Pa
      R:hole { f = 5e-8 m^3/(s*Pa^(1/2)) * sqrt(abs(e))*sign(e) }
      pump -> 0:p -> acc
      p -> 1:l -> line, 0:o
      o -> load, hole
      probe pressure = p.e
      simulate { stop = 5 s }
    }";
    let (want, _) = at(&compiled(text, Some("gonzalez"), Some(1e-9)), Some(1e-9), "pressure", 5.0);
    for method in [Some("radau"), Some("collocation8"), None] {
        let (p, steps) = at(&compiled(text, method, Some(1e-8)), Some(1e-8), "pressure", 5.0);
        assert!((p / want - 1.0).abs() < 1e-7 && steps < 600, "{method:?}: {p} where {want} is due, {steps} steps");
    }
}

/// Newton's cradle by Hertz' law: bodies that touch, whose contacts have no stiffness yet, and pass on next to nothing
/// in the first step (1e-200 m at the last of them).
#[test]
fn bodies_that_touch() {
    let row = |n: u32, law: &str| {
        format!(
            "model Row {{
               for i in 1..{n} {{
                 I:m[i] {{ inertia = 0.1 kg; f0 = if i == 1 then 1 m/s else 0 m/s }}
                 m[i] -> 1:v[i]
                 if i < {n} {{ C:h[i] {{ e = {law} }} v[i] -> 0:d[i] -> h[i]; d[i] -> v[i+1] }}
               }}
               probe last = m[{n}].f
               probe momentum = {}
               simulate {{ stop = 5 ms }}
             }}",
            (1..=n).map(|i| format!("m[{i}].p")).collect::<Vec<_>>().join(" + ")
        )
    };
    let hertz = "(1e8 N/m^(3/2))*max(q, 0 m)^1.5";
    let fine = at(&compiled(&row(3, hertz), None, Some(1e-10)), Some(1e-10), "last", 5e-3).0;
    for tolerance in [1e-6, 3e-8, 1e-8, 1e-9] {
        let scene = compiled(&row(3, hertz), None, Some(tolerance));
        let (last, steps) = at(&scene, Some(tolerance), "last", 5e-3);
        assert!((last - fine).abs() < 1e-4 && steps < 4000, "{tolerance}: {last} and {fine}, {steps} steps");
        assert!((at(&scene, Some(tolerance), "momentum", 5e-3).0 - 0.1).abs() < 1e-12);
    }
    for law in [hertz, "(1e12 N/m^2)*max(q, 0 m)^2"] {
        let scene = compiled(&row(8, law), None, None);
        assert!(at(&scene, Some(1e-4), "last", 5e-3).0 > 0.9, "{law}");
        assert!((at(&scene, Some(1e-4), "momentum", 5e-3).0 - 0.1).abs() < 1e-11, "{law}");
    }
}

/// `e sqrt|e|` has its slope at 0 however it is written: a backlash 10 cm wide in series with such a damper, driven
/// through it at constant speed, presses on its other flank by what the damper lets through, (v/c)^(2/3).
#[test]
fn broken_powers_have_their_slope_at_rest() {
    for law in ["e*sqrt(abs(e))", "sign(e)*abs(e)^1.5", "e*abs(e)^(1/2)"] {
        let text = format!(
            "model Gap {{
               Sf:v = 1 m/s
               C:gap {{ e = (400 N/m)*(max(q - 0.05 m, 0 m) + min(q + 0.05 m, 0 m)); q0 = -0.1 m }}
               R:r {{ f = (1.2 m/(s*N^(3/2)))*{law} }}
               v -> 0:d -> gap, r
               probe q = gap.q
               simulate {{ stop = 2 s }}
             }}"
        );
        let (q, _) = at(&compiled(&text, None, None), None, "q", 2.0);
        let wanted = 0.05 + (1.0f64 / 1.2).powf(2.0 / 3.0) / 400.0;
        assert!((q - wanted).abs() < 1e-9, "{law}: {q} and {wanted}");
    }
}

/// Two unlike diodes in series from 0 V, where the residual of the loop is rounding; and a resistor that heats itself,
/// whose temperature has no value at 0.
#[test]
fn loops_that_start_at_nothing() {
    let diodes = "model D {
       Se:s = 5 V * sin(20*t/(1 s))
       R:r1 = 20 Ohm
       R:d1 { f = (8e-10 A)*(exp(e/(0.02585 V)) - 1) }
       R:d2 { f = (4e-12 A)*(exp(e/(0.02585 V)) - 1) }
       s -> 1:a -> r1, d1, d2
       probe i = a.f
       simulate { stop = 1 s }
     }";
    let (i, _) = at(&compiled(diodes, None, None), None, "i", 1.0);
    let drop = |is: f64| 0.02585 * (i / is).ln_1p();
    assert!((20.0 * i + drop(8e-10) + drop(4e-12) - 5.0 * 20f64.sin()).abs() < 1e-6, "{i}");
    let heats = "model T {
       Se:v = 5 V; Se:amb = 300 K
       I:l = 1 mH
       RS(r, th):n = (100 Ohm)*exp((3000 K)/T.e - 10)
       R(w, k):c { w.f = (5 mW/K)*(w.e - k.e)/w.e; k.f = (5 mW/K)*(k.e - w.e)/k.e }
       v -> 1:i -> n.r, l
       n.th -> 0:T -> c.w
       amb -> c.k
       probe warm = T.e
       probe i2 = l.f
       simulate { stop = 1 ms }
     }";
    let (warm, _) = at(&compiled(heats, None, None), None, "warm", 1e-3);
    assert!(warm.is_finite() && warm > 299.0, "{warm}");
}

/// A coil behind a diode that blocks half of the time.
const HALF_WAVE: &str = "model HalfWave {
  Se:mains = 20 V * sin(2*pi*50 Hz * t)
  R:diode { f = 1e-9 A * (exp(e/(50 mV)) - 1) }
  I:coil = 20 mH
  R:load = 5 Ohm
  mains -> 1:mesh -> diode, coil, load
  probe i = mesh.f
  probe u = diode.e
  simulate { stop = 60 ms }
}";

/// The same by methods that ring: the current may end beyond what the diode lets through, where it has no voltage. Rows
/// show what half a step more leaves; while it conducts, what its law says; and the current alone asks for
/// none of it.
#[test]
fn rows_beyond_a_diode() {
    let text = HALF_WAVE.replace("probe u = diode.e", "");
    for method in ["gonzalez", "collocation4", "collocation8"] {
        for steps in [Steps::new(), Steps::fixed(1e-5), Steps::fixed(1e-4)] {
            let compiled = with(Options::new().method(method), &text);
            let mut sim = start(&compiled, steps);
            finish(&mut sim, 0.1);
            assert!(sim.summary().passive, "{method}: {:?}", sim.summary().reasons);

            let compiled = with(Options::new().method(method), HALF_WAVE);
            let mut sim = start(&compiled, steps);
            for k in 1..=100 {
                let t = 1e-3 * f64::from(k);
                advance(&mut sim, t);
                let (i, u) = (probe(&mut sim, "i"), probe(&mut sim, "u"));
                let mains = 20.0 * (100.0 * std::f64::consts::PI * t).sin();
                if i > 0.01 {
                    close(u, 0.05 * (1.0 + i / 1e-9).ln(), 1e-4, &format!("{method}, conducting at {t}"));
                }
                // Just after it is let go, what rings may be off by more than the mains, but is no number of another
                // order.
                assert!((u - mains.min(0.0)).abs() < 100.0, "{method} at {t}: {u} V, mains {mains} V");
            }
        }
    }
}

/// Rows within fixed steps that are far too long: what is stored stays, and no temperature comes to 0 or to anything.
#[test]
fn rows_within_long_steps() {
    let text = "model Two {
      C:a { H = 100 J/K * 300 K * exp(q/(100 J/K)); q0 = 50 J/K }
      C:b { H = 1 J/K * 300 K * exp(q/(1 J/K)); q0 = -1 J/K }
      R(h, k):w { h.f = 5 W/K * (h.e - k.e)/h.e; k.f = 5 W/K * (k.e - h.e)/k.e }
      0:na -> a, w.h
      0:nb -> b, w.k
      probe Ta = na.e
      probe Tb = nb.e
      probe H = a.H + b.H
    }";
    for method in ["collocation4", "collocation6", "collocation8"] {
        for step in [3e3, 7e3, 3e4, 5e4] {
            let compiled = with(Options::new().method(method), text);
            let mut sim = start(&compiled, Steps::fixed(step));
            let stored = probe(&mut sim, "H");
            for k in 1..=500 {
                advance(&mut sim, 0.1 * step * f64::from(k));
                let [a, b, h] = ["Ta", "Tb", "H"].map(|name| probe(&mut sim, name));
                assert!(a > 1.0 && b > 1.0 && a < 1e5 && b < 1e5, "{method} {step} {k}: {a} K, {b} K");
                close(h / stored, 1.0, 1e-12, &format!("{method} {step} {k}"));
            }
            assert!(sim.summary().passive, "{method} {step}: {:?}", sim.summary().reasons);
        }
    }
}

/// What a coil asks of a diode that blocks, and a spring of a slider: nothing but the states decides it, and the law
/// has an end. A symmetric method rings there, and what the law gives comes to anything.
#[test]
fn beyond_a_diode() {
    let battery = "use std.electrical
    model Charger {
      SineVoltage:ac(amplitude = 20 V)
      Inductor:coil(L = 1 mH, R = 0.2 Ohm)
      Diode:d(Is = 1 nA)
      C:bat { compliance = 10 F; e0 = 12 V }
      ac.out -> 1:m -> coil.p, d.p, bat
      probe i = m.f
      simulate { stop = 15 ms }
    }";
    let slider = "use std.contact
    model Jenkins {
      Sf:drive = 0.1 m/s * cos(2*pi*1 Hz * t)
      C:spring { stiffness = 1000 N/m }
      SmoothFriction:slider(Fc = 3 N)
      drive -> 0:F -> spring, slider.slide
      probe force = F.e
      probe x = integral(slider.slide.f, 0 m)
      simulate { stop = 2 s }
    }";
    // Switched off, what is left of the coil's current goes through the switch that leaks.
    let relay = "use std.electrical
    model Relay {
      Se:supply = 24 V
      R:sw { conductance = if t < 20 ms then 10 S else 1e-7 S }
      Inductor:coil(L = 50 mH, R = 48 Ohm)
      Diode:d(Is = 1 nA)
      TF:flip = -1
      supply -> 1:m -> sw, 0:x
      x -> coil.p
      x -> flip -> d.p
      probe u = x.e
      simulate { stop = 60 ms }
    }";
    for tolerance in [None, Some(1e-5), Some(1e-8)] {
        let (u, _) = at(&compiled(relay, None, tolerance), tolerance, "u", 0.06);
        assert!((u - 24.0 * 48.0 * 1e-7).abs() < 1e-7, "{tolerance:?}: {u}");
        let coil = compiled(HALF_WAVE, None, tolerance);
        // While it conducts, by an implicit Runge-Kutta method at 1e-12; while it blocks, -Is flows and the source is
        // left.
        let (i, _) = at(&coil, tolerance, "i", 5e-3);
        assert!((i - 1.965_91).abs() < 2e-3, "{tolerance:?}: {i}");
        for t in [0.013, 0.015, 0.0185, 0.019, 0.0545] {
            let source = 20.0 * (100.0 * std::f64::consts::PI * t).sin();
            let (u, steps) = at(&coil, tolerance, "u", t);
            let (i, _) = at(&coil, tolerance, "i", t);
            assert!((u - source).abs() < 1e-5 && (i + 1e-9).abs() < 1e-13, "{tolerance:?} at {t}: {u}, {i}");
            assert!(steps < 1000, "{steps} steps");
        }
        let battery = compiled(battery, None, tolerance);
        for (t, exact, most) in [(0.005, 11.348_11, 3e-3), (0.0085, 13.039_04, 0.02), (0.013, -1.028_18e-9, 1e-13)] {
            let (i, _) = at(&battery, tolerance, "i", t);
            assert!((i - exact).abs() < most, "{tolerance:?} at {t}: {i}, {exact}");
        }
        let slider = compiled(slider, None, tolerance);
        let (force, _) = at(&slider, tolerance, "force", 1.1);
        let (x, _) = at(&slider, tolerance, "x", 1.1);
        let held = 0.1 * (0.2 * std::f64::consts::PI).sin() / (2.0 * std::f64::consts::PI) - 0.003;
        assert!((force - 3.0).abs() < 1e-5 && (x - held).abs() < 1e-5, "{tolerance:?}: {force} N, {x} m, {held} m");
    }
}

/// An angle that `atan2` turns back by a whole turn is met there: a sawtooth of time, and one of a state, against the
/// same made of `if`.
#[test]
fn where_an_angle_is_turned_back() {
    let saw = |of: &str| {
        format!(
            "model Saw {{
               Se:u = 1 V * ({of})
               R:r = 10 Ohm
               C:c = 1 mF
               I:l = 10 mH
               u -> 1:j -> r, c, l
               probe i = l.f
               probe x = integral(c.e, 0 V*s)
             }}"
        )
    };
    let [angle, plain] = ["atan2(sin(20 Hz * t), cos(20 Hz * t))", "20 Hz * t - (if t < pi/(20 Hz) then 0 else 2*pi)"]
        .map(|of| compiled(&saw(of), None, Some(1e-8)));
    let [a, b] = [&angle, &plain].map(|compiled| at(compiled, Some(1e-8), "i", 0.3).0);
    assert!((a - b).abs() < 1e-7, "{a}, {b}");
    // A rotor with a torque that is a sawtooth of its angle, which wraps seven times.
    let text = "model Rotor {
      I:j { inertia = 0.01 kg*m^2; f0 = 20 rad/s }
      C:th { H = 0 J }
      R:b = 0.02 N*m*s
      Se:saw = 0.3 N*m * (1 + atan2(sin(th.q), cos(th.q)))
      saw -> 1:turn -> j, th, b
      probe w = turn.f
    }";
    for (method, tolerance, off) in [(None, None, 1e-2), (None, Some(1e-9), 1e-5), (Some("radau"), Some(1e-8), 1e-5)] {
        // Integrated by another program, from wrap to wrap.
        let (w, _) = at(&compiled(text, method, tolerance), tolerance, "w", 2.982);
        assert!((w - 20.528030).abs() < off, "{method:?} {tolerance:?}: {w}");
    }
}

/// Knees of diodes that the middle of a step does not see: a small capacitor that a current drives up to a clamp, and
/// what is on each side of series resistors, whose diodes' arguments are not what the states leave.
#[test]
fn knees_at_the_end_of_a_step() {
    let clamp = "model Clamp {
      Sf:i = 10 A
      C:small = 200 pF
      R:diode { f = 1e-12 A * (exp(e/(26 mV)) - 1) }
      C:out { compliance = 47 uF; e0 = 25 V }
      i -> 0:x -> small
      x -> 1:d -> diode, out
      probe u = x.e
      simulate { stop = 10 us }
    }";
    // All of the charge but for what the small one takes, and the diode's own voltage.
    let knee = 0.026 * 1e13f64.ln();
    let exact = 25.0 + knee + (1e-4 - 200e-12 * 27.9) / 47e-6;
    for tolerance in [None, Some(1e-5), Some(1e-8)] {
        let (u, steps) = at(&compiled(clamp, None, tolerance), tolerance, "u", 1e-5);
        assert!((u - exact).abs() < 1e-5 && steps < 300, "{tolerance:?}: {u} V of {exact}, {steps} steps");
    }
    let network = "model Network {
      Se:s = 12 V * sin(1300 Hz * t)
      C:a { compliance = 334 nF; e0 = -2 V }
      C:b = 56.6 uF
      R:d1 { f = 0.647 nA * (exp(e/(25.85 mV)) - 1) }
      R:d2 { f = 3.31 nA * (exp(e/(51.7 mV)) - 1) }
      R:r1 = 39.7 Ohm
      R:r2 = 276 Ohm
      R:r3 = 199 Ohm
      s -> 1:j1 -> d1, r1, 0:x
      x -> a
      x -> 1:j3 -> r3, 0:y
      y -> b
      y -> 1:j2 -> d2, r2, 0:x2
      C:c { compliance = 1.42 uF; e0 = 1 V }
      x2 -> c
      probe u = x.e
      simulate { stop = 14.5 ms }
    }";
    let exact = at(&compiled(network, Some("radau"), Some(1e-11)), Some(1e-11), "u", 0.0145).0;
    for (method, tolerance, most) in [
        (None, None, 500),
        (Some("radau"), Some(1e-8), 1000),
        (Some("collocation6"), Some(1e-6), 500),
        (None, Some(1e-8), 1000),
        (Some("gonzalez"), Some(1e-6), 10_000),
    ] {
        let (u, steps) = at(&compiled(network, method, tolerance), tolerance, "u", 0.0145);
        assert!((u - exact).abs() < 1e-3 && steps < most, "{method:?} {tolerance:?}: {u} V of {exact}, {steps} steps");
    }
}

/// A stiff branch that is entered again with the steps in which it was left: Gauss' method lets stay what is far too
/// fast for a step, and so do its halves. A chamber with a valve, 0.1 ms fast, that opens twice.
#[test]
fn a_stiff_branch_that_is_entered_again() {
    let text = "model Chamber {
      Sf:piston { f = 1 m^3/s * (0.2 + sin(10 Hz * t)) }
      C:chamber { compliance = 1e-3 m^3/Pa; q0 = -0.05 m^3 }
      R:valve { f = max(10 m^3/(Pa*s) * e, 0) }
      piston -> 0:a -> chamber, valve
      probe q = valve.f
      simulate { stop = 1 s }
    }";
    // Once it is open, what comes in goes out, but for what the chamber takes: q = f - tau f' + tau^2 f'' - ...
    let (tau, w) = (1e-4, 10.0);
    let gain = 1.0 / (1.0 + (tau * w) * (tau * w));
    let flow = |t: f64| 0.2 + gain * (f64::sin(w * t) - tau * w * f64::cos(w * t));
    for tolerance in [1e-4, 1e-5, 1e-6, 1e-8] {
        for t in [0.12, 0.8, 0.85, 0.9] {
            let q = at(&compiled(text, None, Some(tolerance)), Some(tolerance), "q", t).0;
            assert!(
                (q / flow(t) - 1.0).abs() < (100.0 * tolerance).max(1e-6),
                "{q} of {} at {t} s, {tolerance:e}",
                flow(t)
            );
        }
    }
}

/// The far end of a row of springs with a kink is moved by next to nothing, whose square is nothing. To a tight
/// tolerance a row as long takes a method of high order, in far fewer steps.
#[test]
fn springs_with_a_kink_in_a_row() {
    let text = "model Chain {
      for i in 1..40 {
        I:m[i] = 1 kg
        C:k[i] { e = (if q > 0 then 2 N/m else 1 N/m) * q }
        R:r[i] = 0.01 N*s/m
        1:v[i] -> m[i]
        0:f[i] -> 1:d[i] -> k[i], r[i]
      }
      for i in 1..39 { v[i] -> f[i] -> v[i+1] }
      v[40] -> f[40]
      Se:u = 1 N * sin(t * 2 rad/s)
      u -> v[1]
      probe x = k[1].q
    }";
    let tight = compiled(text, None, Some(1e-8));
    assert_eq!(tight.scene().clusters[0].step.name, "collocation6");
    let (y, few) = at(&tight, Some(1e-8), "x", 5.0);
    let (z, more) = at(&compiled(text, Some("gonzalez"), Some(1e-8)), Some(1e-8), "x", 5.0);
    close(z / y, 1.0, 1e-6, "by order 2");
    assert!(50 * few < more, "{few} steps, and {more} by order 2");
}
