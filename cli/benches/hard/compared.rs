//! The cases one by one: here, and by ordinary integrators.

use super::case::{ALL, Case};
use super::ours::{self, Ours};
use super::rival::{self, Done, Rival};
use super::table::{short, table, time};
use bond::Steps;
use bond::internal::CompiledInternals;

/// Tolerances that the ordinary ones are tried with, loosest first.
const TOLERANCES: [f64; 5] = [1e-3, 1e-5, 1e-7, 1e-9, 1e-11];

/// A case with all that was found.
struct Found {
    case: &'static Case,
    ours: Result<Ours, String>,
    held: (usize, usize),
    compared: Option<Compared>,
    missing: String,
}

/// A tolerance, and how the run at it ended: with how far it was off.
type Tried = (f64, Result<(Done, f64), String>);

/// Against a reference.
struct Compared {
    reference: String,
    ours: f64,
    rk4: Result<(f64, f64), String>,
    others: [Tried; 2],
}

/// Both tables: what we do, and what ordinary ones do.
///
/// # Errors
/// In words.
pub fn tables(only: Option<&str>) -> Result<(String, String), String> {
    let mut found = Vec::new();
    for case in ALL.iter().filter(|c| only.is_none_or(|o| c.file == o)) {
        eprintln!("{}", case.name());
        found.push(look(case)?);
    }
    Ok((here(&found), others(&found)))
}

/// How far two states are apart: the largest difference, relative to the size of the state.
fn apart(a: &[f64], b: &[f64], size: &[f64]) -> f64 {
    let each = a.iter().zip(b).zip(size).map(|((a, b), s)| (a - b).abs() / s.max(f64::MIN_POSITIVE));
    each.fold(0.0, |m: f64, x| if x.is_nan() { x } else { m.max(x) })
}

fn look(case: &'static Case) -> Result<Found, String> {
    let held = ours::expectations(&case.path(), case.model)?;
    let compiled = ours::compile(&case.options(), &case.path())?;
    let mut field = case.field();
    let names = field.as_ref().map(|f| f.names.clone()).unwrap_or_default();
    let run = ours::run(&compiled, Steps::new(), None, &names);
    let mut found = Found { case, ours: run, held, compared: None, missing: String::new() };
    let field = match &mut field {
        Ok(field) => field,
        Err(why) => {
            found.missing.clone_from(why);
            return Ok(found);
        }
    };
    let settings = &compiled.stages().model.settings;
    let stop = case.until.or(settings.stop).unwrap_or(1.0);
    // What is compared is run to where that says something.
    let near = match case.until {
        Some(_) => ours::run(&compiled, Steps::new(), case.until, &names),
        None => ours::run(&compiled, Steps::new(), None, &names),
    };
    let Ok(near) = near else { return Ok(found) };
    let size: Vec<f64> = near.size.iter().map(|s| if *s > 0.0 { *s } else { 1.0 }).collect();
    // The reference is what is known, else the tightest run of either that comes to its end.
    let known: Vec<f64> = names.iter().filter_map(|n| case.end.iter().find(|e| e.0 == n).map(|e| e.1)).collect();
    let tries = [(Rival::Explicit, 1e-12), (Rival::Implicit, 1e-11), (Rival::Implicit, 1e-9), (Rival::Implicit, 1e-7)];
    let reference = if !case.end.is_empty() && known.len() == names.len() {
        Some(("known".to_string(), known))
    } else {
        tries.iter().find_map(|(rival, tolerance)| {
            let done = rival::run(field, *rival, stop, *tolerance, &size, 4 * rival::CALLS).ok()?;
            Some((format!("{} {tolerance:.0e}", name(*rival)), done.end))
        })
    };
    if !case.end.is_empty() && known_is_wrong(case, &names) {
        return Err(format!("{}: the states are {}", case.name(), names.join(", ")));
    }
    let Some((by, reference)) = reference else {
        found.missing = "neither came to the end at any of the tolerances of a reference".into();
        return Ok(found);
    };
    let end: Vec<f64> = near.end.iter().map(|e| e.1).collect();
    let off = apart(&end, &reference, &size);
    let mut best = |rival| {
        let mut last = (f64::NAN, Err("was not run".to_string()));
        for tolerance in TOLERANCES {
            let done = rival::run(field, rival, stop, tolerance, &size, rival::CALLS);
            let done = done.map(|mut d| {
                for _ in 1..ours::REPEATS {
                    if d.time < ours::LONG
                        && let Ok(again) = rival::run(field, rival, stop, tolerance, &size, rival::CALLS)
                    {
                        d.time = d.time.min(again.time);
                    }
                }
                let far = apart(&d.end, &reference, &size);
                (d, far)
            });
            // A tighter one that fails says less than a looser one that does not.
            let good = matches!(&done, Ok((_, far)) if *far <= off);
            if done.is_ok() || last.1.is_err() {
                last = (tolerance, done);
            }
            if good || last.0 != tolerance {
                break;
            }
        }
        last
    };
    let others = [best(Rival::Explicit), best(Rival::Implicit)];
    // As many steps of the classical rule as were taken here.
    let step = stop / near.steps.max(1) as f64;
    let rk4 = ours::compile(&case.options().method("rk4"), &case.path())
        .and_then(|c| ours::run(&c, Steps::fixed(step), Some(stop), &names))
        .map(|o| (o.total, apart(&o.end.iter().map(|e| e.1).collect::<Vec<_>>(), &reference, &size)));
    found.compared = Some(Compared { reference: by, ours: off, rk4, others });
    if case.until.is_some() {
        found.missing = format!("compared at {stop} s");
        // The time, too, is that of the shorter run.
        if let Ok(o) = &mut found.ours {
            o.time = near.time;
        }
    }
    Ok(found)
}

/// What is known must be of the scene's states.
fn known_is_wrong(case: &Case, names: &[String]) -> bool {
    case.end.len() != names.len() || !case.end.iter().all(|e| names.iter().any(|n| n == e.0))
}

fn name(rival: Rival) -> &'static str {
    match rival {
        Rival::Explicit => "DOPRI5",
        Rival::Implicit => "Radau",
    }
}

fn here(found: &[Found]) -> String {
    let head = ["case", "hard", "stepper", "steps", "worst balance", "whole ledger", "expectations", "time"];
    let row = |f: &Found| {
        let held = format!("{} of {}", f.held.0, f.held.1);
        match &f.ours {
            Ok(o) => vec![
                f.case.name(),
                f.case.hard.into(),
                o.stepper.clone(),
                o.steps.to_string(),
                short(o.worst),
                short(o.total),
                held,
                time(o.time),
            ],
            Err(why) => {
                let gap = || "-".to_string();
                vec![f.case.name(), f.case.hard.into(), why.clone(), gap(), gap(), gap(), held, gap()]
            }
        }
    };
    table(&head, &found.iter().map(row).collect::<Vec<_>>())
}

fn others(found: &[Found]) -> String {
    let head = [
        "case",
        "off here",
        "`rk4`, as many steps: energy; off",
        "DOPRI5: tolerance; energy; off; time",
        "Radau IIA: tolerance; energy; off; time",
        "time here",
        "fastest at that error",
        "reference",
    ];
    let mut rows = Vec::new();
    for f in found {
        let (Some(c), Ok(o)) = (&f.compared, &f.ours) else {
            let why = if f.missing.is_empty() { "the run here failed".into() } else { f.missing.clone() };
            rows.push(vec![f.case.name(), "-".into(), why, "-".into(), "-".into(), "-".into(), "-".into(), "-".into()]);
            continue;
        };
        let rk4 = match &c.rk4 {
            Ok((_, off)) if off.is_nan() || *off >= 1e3 => "blows up".to_string(),
            Ok((energy, off)) => format!("{}; {}", short(*energy), short(*off)),
            Err(why) => {
                if why.contains("finite") || why.contains("not a number") {
                    "blows up".into()
                } else {
                    why.clone()
                }
            }
        };
        let told = |(tolerance, done): &Tried| match done {
            Ok((d, off)) => {
                format!("{tolerance:.0e}; {}; {}; {} ({} steps)", short(d.energy), short(*off), time(d.time), d.steps)
            }
            Err(why) => format!("{tolerance:.0e}: {why}"),
        };
        let mut first = ("here", o.time);
        for (rival, (_, done)) in [Rival::Explicit, Rival::Implicit].into_iter().zip(&c.others) {
            if let Ok((d, off)) = done
                && *off <= c.ours.max(1e-12)
                && d.time < first.1
            {
                first = (name(rival), d.time);
            }
        }
        let mut by = c.reference.clone();
        if !f.missing.is_empty() {
            by += &format!("; {}", f.missing);
        }
        if c.ours > 0.5 {
            first.0 = "-";
        }
        let cells = [short(c.ours), rk4, told(&c.others[0]), told(&c.others[1]), time(o.time), first.0.into(), by];
        rows.push(std::iter::once(f.case.name()).chain(cells).collect());
    }
    table(&head, &rows)
}
