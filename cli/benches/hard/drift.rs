//! Long runs without loss: what becomes of the energy, and whether what is off has a trend.

use super::case::path;
use super::ours::compile;
use super::table::{short, table};
use bond::internal::{Code, CompiledInternals, OptionsInternals, SimulationInternals, StepsInternals};
use bond::{Compiled, Options, Simulation, Steps};
use bond_compiler::discretise::{Accuracy, Method};
use std::time::Instant;

/// Instants at which the energy is looked at.
const LOOKS: u64 = 1000;

/// What a run of many steps came to.
pub struct Drift {
    /// Largest distance of H from that of the start, over it.
    pub most: f64,
    /// The fitted slope of that distance, a step.
    pub slope: f64,
    /// What a slope would be that is no more than chance: its standard error.
    pub chance: f64,
    /// Worst balance of a step.
    pub worst: f64,
    /// ns a step.
    pub time: f64,
}

/// Runs so many steps of a length.
///
/// # Errors
/// In words: what failed, and when.
pub fn drift(compiled: &Compiled, h: f64, steps: u64) -> Result<Drift, String> {
    let options = Steps::fixed(h).resolve(&compiled.stages().model.settings, 1.0, None).map_err(|e| e.to_string())?;
    let mut sim =
        Simulation::on(Code::Native.backend(), compiled.scene(), &options, Vec::new()).map_err(|e| e.to_string())?;
    let energy = |sim: &Simulation<'_>| sim.summary().regions.iter().map(|r| r.h_final).sum::<f64>();
    let h0 = energy(&sim);
    let mut looks = Vec::new();
    let begin = Instant::now();
    for k in 1..=LOOKS {
        let n = steps * k / LOOKS;
        sim.advance(n as f64 * h).map_err(|e| e.to_string())?;
        looks.push((n as f64, (energy(&sim) - h0) / h0.abs().max(f64::MIN_POSITIVE)));
    }
    let time = begin.elapsed().as_secs_f64();
    let summary = sim.summary();
    let n = looks.len() as f64;
    let (mx, my) = (looks.iter().map(|l| l.0).sum::<f64>() / n, looks.iter().map(|l| l.1).sum::<f64>() / n);
    let xx: f64 = looks.iter().map(|l| (l.0 - mx).powi(2)).sum();
    let slope = looks.iter().map(|l| (l.0 - mx) * (l.1 - my)).sum::<f64>() / xx;
    let rest: f64 = looks.iter().map(|l| (l.1 - my - slope * (l.0 - mx)).powi(2)).sum();
    let taken = summary.regions.iter().map(|r| r.steps).sum::<u64>();
    Ok(Drift {
        most: looks.iter().map(|l| l.1.abs()).fold(0.0, f64::max),
        slope,
        chance: (rest / (n - 2.0) / xx).sqrt(),
        worst: summary.regions.iter().map(|r| r.worst_step).fold(0.0, f64::max),
        time: time / taken.max(1) as f64 * 1e9,
    })
}

/// A scene by each stepper that takes it, the passive ones first; by one alone where it is named.
fn steppers(options: &Options, file: &str, only: Option<&str>) -> Vec<(&'static str, Compiled)> {
    let mut list = Vec::new();
    for method in Method::ALL.into_iter().filter(|m| only.is_none_or(|o| o == m.name())) {
        if let Ok(compiled) = compile(&options.clone().accuracy(Accuracy::Fixed).method(method.name()), &path(file))
            && compiled.scene().clusters.iter().all(|c| c.step.name == method.name())
        {
            list.push((method.name(), compiled));
        }
    }
    list.sort_by_key(|(_, c)| !c.scene().clusters.iter().all(|c| c.step.properties.passive));
    list
}

fn row(name: &str, h: &str, found: Result<Drift, String>) -> Vec<String> {
    match found {
        Ok(d) if d.most.is_finite() && d.most < 1e6 => {
            let fall = format!("{} (chance {})", short(d.slope), short(d.chance));
            vec![
                name.into(),
                h.into(),
                short(d.most),
                fall,
                short(d.most * 1e10),
                short(d.worst),
                format!("{:.0}", d.time),
            ]
        }
        Ok(_) => vec![name.into(), h.into(), "blows up".into(), "-".into(), "-".into(), "-".into(), "-".into()],
        Err(why) => vec![name.into(), h.into(), why, "-".into(), "-".into(), "-".into(), "-".into()],
    }
}

/// The head of such a table. The bar is 1e-10.
const HEAD: [&str; 7] =
    ["stepper", "step", "largest energy error", "trend a step", "over the bar of 1e-10", "worst balance", "ns a step"];

fn tidy(mut rows: Vec<Vec<String>>) -> String {
    for row in &mut rows {
        // How many times the bar is told as yes or no.
        let met = row[4].parse::<f64>().map_or("-".to_string(), |x| if x <= 1.0 { "no" } else { "yes" }.to_string());
        row[4] = met;
    }
    table(&HEAD, &rows)
}

/// The undamped oscillator, h omega from 1e-3 to 1e3.
pub fn oscillator(steps: u64, only: Option<&str>) -> String {
    let mut rows = Vec::new();
    for exponent in -3..=3 {
        let w = 10f64.powi(exponent);
        let options = Options::new().model("Undamped").set("w", &format!("{w:e} rad/s"));
        for (name, compiled) in steppers(&options, "undamped", only) {
            eprintln!("undamped, h w = 1e{exponent}, {name}");
            rows.push(row(name, &format!("h w = 1e{exponent}"), drift(&compiled, 1.0, steps)));
        }
    }
    tidy(rows)
}

/// What is not linear, at a step each: the pendulum that swings and that turns, both chains, and others.
///
/// # Errors
/// A name that there is not.
pub fn chain(mark: &str, steps: u64, slow: u64, only: Option<&str>) -> Result<String, String> {
    let (file, options, h, n) = match mark {
        "swing" => ("pendulum_over", Options::new().set("excess", "-0.05"), 0.02, steps),
        "pendulum" => ("pendulum_over", Options::new(), 0.02, steps),
        "alpha" => ("fput", Options::new().model("FputAlpha"), 0.1, slow),
        "beta" => ("fput", Options::new(), 0.1, slow),
        "rigid" => ("rigid_body", Options::new(), 0.02, steps),
        "henon" => ("henon_heiles", Options::new(), 0.05, steps),
        other => return Err(format!("there is no long run `{other}`")),
    };
    let mut rows = Vec::new();
    for (name, compiled) in steppers(&options, file, only) {
        eprintln!("{file}, {n} steps, {name}");
        rows.push(row(name, &format!("{h} s"), drift(&compiled, h, n)));
    }
    Ok(format!("{n} steps.\n\n{}", tidy(rows)))
}

/// A ratio of 1e12: steps from 1e-3 to 1e3 of the fastest time, with loss (the circuit) and without (the masses).
pub fn stiffness(steps: u64) -> String {
    let head = [
        "scene",
        "stepper",
        "step over the fastest time",
        "H at the end over the largest allowed",
        "worst balance",
        "passive",
    ];
    let mut rows = Vec::new();
    // 1 over the fastest rate: r2 c2; sqrt(m/(2 k ratio)).
    let list = [
        ("stiff_circuit", None, 1e-12),
        ("stiff_oscillator", Some("StiffOscillator"), 0.5f64.sqrt() * 1e-6),
        ("stiff_oscillator", None, 0.5f64.sqrt() * 1e-6),
    ];
    for (file, model, fastest) in list {
        let options = model.map_or(Options::new(), |m| Options::new().model(m));
        for (name, compiled) in steppers(&options, file, None) {
            for exponent in -3..=3 {
                let h = fastest * 10f64.powi(exponent);
                eprintln!("{file} {}, {name}, 1e{exponent}", model.unwrap_or(""));
                rows.push(stiff(file, model, name, &compiled, h, exponent, steps));
            }
        }
    }
    table(&head, &rows)
}

fn stiff(
    file: &str,
    model: Option<&str>,
    name: &str,
    compiled: &Compiled,
    h: f64,
    exponent: i32,
    steps: u64,
) -> Vec<String> {
    let title = format!("`{file}` {}", model.unwrap_or(""));
    let settings = &compiled.stages().model.settings;
    let run = || -> Result<(f64, f64, bool), String> {
        let options = Steps::fixed(h).resolve(settings, 1.0, None).map_err(|e| e.to_string())?;
        let mut sim = Simulation::on(Code::Native.backend(), compiled.scene(), &options, Vec::new())
            .map_err(|e| e.to_string())?;
        sim.finish(steps as f64 * h).map_err(|e| e.to_string())?;
        let s = sim.summary();
        let r = s.regions.first().ok_or("there is no region")?;
        Ok((r.h_final / (r.h_initial + r.supplied.max(0.0)), r.worst_step, s.passive))
    };
    let (grown, worst, passive) = match run() {
        Ok((grown, worst, passive)) => (
            if grown > 1e6 { "blows up".into() } else { format!("{grown:.12}") },
            short(worst),
            if passive { "yes" } else { "no" },
        ),
        Err(why) => (why, "-".into(), "-"),
    };
    vec![title, name.into(), format!("1e{exponent}"), grown, worst, passive.into()]
}
