//! The cases: a scene of `models/hard/`, what is hard in it in few words, and over what time it is compared.

use super::field::Field;
use bond::Options;
use std::path::PathBuf;

/// A case.
pub struct Case {
    /// Its file, without `.bond`.
    pub file: &'static str,
    /// Its scene, where that is not the last.
    pub model: Option<&'static str>,
    /// In few words.
    pub hard: &'static str,
    /// s; where the end of the run says nothing, since it is chaos, an earlier one. The whole run otherwise.
    pub until: Option<f64>,
    /// The end in closed form, or by other means as the file tells, where no integrator is a reference: states by name,
    /// SI.
    pub end: &'static [(&'static str, f64)],
}

const fn case(file: &'static str, hard: &'static str) -> Case {
    Case { file, model: None, hard, until: None, end: &[] }
}

const fn scene(file: &'static str, model: &'static str, hard: &'static str) -> Case {
    Case { file, model: Some(model), hard, until: None, end: &[] }
}

const fn until(case: Case, until: f64) -> Case {
    Case { until: Some(until), ..case }
}

const fn known(case: Case, end: &'static [(&'static str, f64)]) -> Case {
    Case { end, ..case }
}

/// At 10 000 s, 1e7 rad.
const TURNED: [(&str, f64); 2] = [("spring.q", -0.001283074084877692), ("mass.p", -0.5947443927564802)];

/// All of them.
pub const ALL: [Case; 43] = [
    known(case("undamped", "159 turns a step, solved"), &TURNED),
    known(scene("undamped", "Undamped", "the same by the midpoint rule"), &TURNED),
    case("stiff_circuit", "time constants 1e12 apart"),
    known(
        scene("stiff_oscillator", "StiffOscillator", "stiffnesses 1e12 apart, no loss, linear"),
        &[
            ("soft.q", -0.004968705578437077),
            ("first.p", -0.6727270815091408),
            ("stiff.q", -8.739208830980358e-08),
            ("second.p", -0.7414689532744578),
        ],
    ),
    case("stiff_oscillator", "the same, hardening"),
    case("pendulum_over", "not convex; all but stands on its head"),
    scene("double_well", "DoubleWellFromTop", "not convex, counted from the top"),
    case("double_well", "counted from the floor"),
    until(case("double_pendulum", "chaos, IC field"), 4.0),
    until(case("henon_heiles", "chaos, no lower bound"), 20.0),
    scene("fput", "FputAlpha", "32 cubic springs"),
    case("fput", "32 springs of fourth degree"),
    case("rigid_body", "Lie-Poisson D(x), middle axis"),
    case("kepler", "singular H, eccentricity 0.99"),
    case("figure_eight", "six singularities, barely stable"),
    case("saturating_inductor", "flux to the ninth, ferroresonance"),
    case("varactor", "exponential condenser, driven hard"),
    case("diode_clipper", "exponentials under 100 V"),
    case("ring_modulator", "stiff and ringing, 15 states"),
    case("diode_bridge", "four exponentials without causality"),
    case("ideal_bridge", "four diodes with corners"),
    scene("r_bridge", "AllFive", "five laws in one loop, from a start that is far"),
    case("r_bridge", "four laws in one loop"),
    scene("tight_coils", "TightCoilsExact", "all but singular inductances, solved"),
    case("tight_coils", "the same by the midpoint rule"),
    known(case("orifice", "infinite slope; level in finite time"), &[("left.q", 5e-3), ("right.q", 5e-3)]),
    known(scene("orifice", "Filled", "the same, filled from a constant pressure"), &[("tank.q", 1.0)]),
    known(case("coulomb", "dry friction to rest"), &[("spring.q", -0.02), ("block.p", 0.0)]),
    known(scene("coulomb", "Held", "at rest until the push is more than the friction"), &[("body.p", 4.5)]),
    scene("coulomb", "Steep", "friction that turns in a thousandth of a swing"),
    known(
        case("stick_slip", "three blocks that stick and slip"),
        &[
            ("leaf1.q", 0.08350163262803467),
            ("leaf2.q", 0.08846145420298529),
            ("leaf3.q", 0.09445230962168333),
            ("block1.p", 0.1992838694282319),
            ("block2.p", 0.14178960565215634),
            ("block3.p", 0.12178748969821855),
            ("link12.q", -0.004959821574950618),
            ("link23.q", -0.005990855418698038),
        ],
    ),
    known(
        case("bouncing", "0.5 s of flight, 100 us of contact"),
        &[("floor.q", -0.3001663394162968), ("ball.p", 1.980084952887693)],
    ),
    case("hertz_chain", "q^(3/2), no linear part"),
    case("pendulum_cartesian", "ratios through 0, dependent masses"),
    case("crank", "rod as long as the crank, but for 1e-4"),
    case("four_bar", "closed chain, five dependent inertias"),
    case("gear_chain", "19 dependent wheels, 1 to 1e18"),
    scene("thermal", "ThermalFine", "1000 K to 1 K by true bonds"),
    scene("thermal", "Thermal", "the same, 100 time constants a step"),
    scene("sampled", "SampledPushed", "T three times the fastest time, pushed"),
    case("sampled", "T ten times the fastest time"),
    case("irrational_rates", "periods in the ratio sqrt(2)"),
    case("hostile", "parameters of no physics, at their usual values"),
];

impl Case {
    /// Where it is.
    pub fn path(&self) -> PathBuf {
        path(self.file)
    }

    /// Its name in a table.
    pub fn name(&self) -> String {
        self.model.map_or(format!("`{}`", self.file), |m| format!("`{}` {m}", self.file))
    }

    /// What it is compiled with.
    pub fn options(&self) -> Options {
        self.model.map_or(Options::new(), |m| Options::new().model(m))
    }

    /// Its right side.
    ///
    /// # Errors
    /// In words, where it has none.
    pub fn field(&self) -> Result<Field, String> {
        Field::new(self.options(), &self.path())
    }
}

/// A file of `models/hard/`.
pub fn path(file: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../models/hard").join(file).with_extension("bond")
}
