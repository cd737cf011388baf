//! The summary of a run, for people and for programs.

use crate::bench::Setting;
use crate::choose::Chosen;
use crate::stop::Stop;
use bond::{LineSummary, RegionSummary, RunError, SteeredSource, Summary};
use bond_compiler::elaborate::told;
use bond_compiler::units;
use bond_runtime::scene::{LeftOut, Scene, Steering};
use serde::ser::{Serialize, SerializeMap, Serializer};
use std::fmt::Write;

/// Why a run ended early.
pub enum Early {
    /// The numerics failed.
    Failed(RunError),
    /// Somebody asked for it, at this instant, s.
    Asked(f64),
}

impl Early {
    /// What became of it.
    fn words(&self) -> &'static str {
        match self {
            Early::Failed(_) => "then the numerics failed",
            Early::Asked(_) => "then it was interrupted",
        }
    }

    /// The failure, if it is one.
    pub fn failure(&self) -> Option<&RunError> {
        match self {
            Early::Failed(e) => Some(e),
            Early::Asked(_) => None,
        }
    }
}

impl std::fmt::Display for Early {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Early::Failed(e) => e.fmt(f),
            Early::Asked(t) => write!(f, "it was interrupted at t = {} s", told(*t)),
        }
    }
}

/// The results of a run.
pub struct Outcome<'a> {
    /// What ran.
    pub scene: &'a Scene,
    /// The chosen stepper, if one was chosen.
    pub chosen: Option<&'a Chosen>,
    /// The time from which it was resumed, s; otherwise 0.
    pub from: f64,
    /// The end that was asked for, s.
    pub stop: f64,
    /// How long it took, s.
    pub wall: f64,
    /// The ledger.
    pub summary: &'a Summary,
    /// The probes at the end.
    pub values: &'a [f64],
    /// Why it ended early, if it did.
    pub early: Option<&'a Early>,
}

impl Outcome<'_> {
    /// Up to where the run got, s: not beyond a failure, though rows within the step that failed lie behind it.
    fn reached(&self) -> f64 {
        let failed = self.early.and_then(Early::failure).and_then(RunError::time);
        failed.map_or(self.summary.time, |t| t.clamp(self.from, self.summary.time.max(self.from)))
    }
}

/// For people.
pub fn text(o: &Outcome) -> String {
    let mut out = String::new();
    // Writing to a string cannot fail.
    let _ = write_text(&mut out, o);
    out
}

fn write_text(out: &mut String, o: &Outcome) -> std::fmt::Result {
    let s = o.summary;
    writeln!(out, "{:11} {}", "scene", o.scene.name)?;
    let reached = if o.early.is_some() { o.reached() } else { o.stop };
    let pace = if o.wall > 0.0 { (reached - o.from) / o.wall } else { f64::INFINITY };
    let early = o.early.map(|e| format!(" of {} s, {}", short(o.stop), e.words())).unwrap_or_default();
    writeln!(
        out,
        "{:11} {}{} s in {} s of wall time ({} times real time){early}",
        "simulated",
        if o.from > 0.0 { format!("from {} s to ", short(o.from)) } else { String::new() },
        short(reached),
        short(o.wall),
        short(pace)
    )?;
    if let Some(c) = o.chosen {
        writeln!(out, "{:11} {} with {}: {}", "chosen", c.method, c.setting.words(), c.why)?;
        writeln!(out, "{:11} error about {:.1e}, measured against {}", "", c.error, c.against)?;
    }
    if s.passive {
        let inside = match s.regions.iter().any(|r| r.leaks_much) {
            true => ": no port gave out more than was put in; a hold changed what is inside (see there)",
            false => "",
        };
        writeln!(out, "{:11} yes{inside}", "passive")?;
    } else {
        for (i, reason) in s.reasons.iter().enumerate() {
            writeln!(
                out,
                "{:11} {}{reason}",
                if i == 0 { "passive" } else { "" },
                if i == 0 { "NO: " } else { "    " }
            )?;
        }
        for hint in hints(o) {
            writeln!(out, "{:11}     hint: {hint}", "")?;
        }
    }
    for (i, line) in steered(s).iter().enumerate() {
        writeln!(out, "{:11} {line}", if i == 0 { "steered" } else { "" })?;
    }
    if s.regions.iter().all(|r| !r.passive_stepper) && !s.regions.is_empty() {
        writeln!(out, "{:11} not measured: no stepper of this run keeps it", "balance")?;
    } else {
        writeln!(out, "{:11} worst step {}, total {} (relative)", "balance", short(s.worst_step), short(s.total))?;
    }
    for (i, l) in s.lines.iter().enumerate() {
        let what = if i == 0 { "lines" } else { "" };
        writeln!(out, "{what:11} {}: {} J on the way", l.name, short(l.energy))?;
    }
    if let Some(left) = left_out(&o.scene.left_out) {
        writeln!(out, "{:11} {left}", "left out")?;
    }
    for r in &s.regions {
        region(out, r)?;
        leak(out, r, o.scene)?;
    }
    for b in &s.bars {
        writeln!(out, "\n{:11} {}", "double bar", b.name)?;
        writeln!(out, "  {:11} {} J into the holder", "crossed", short(b.holder))?;
        writeln!(out, "  {:11} {} J between the two sides' counts", "difference", short(b.difference))?;
        if b.resolution > 0.0 {
            let (step, wrong) = (short(b.resolution), short(b.miscounted));
            writeln!(
                out,
                "  {:11} {step} (SI): a device that counts the energy is off by at most {wrong} J an interval",
                "resolution"
            )?;
        }
    }
    let failed = o.early.and_then(Early::failure).is_some();
    let untold = failed && o.values.iter().any(|x| x.is_nan());
    if !o.values.is_empty() && !untold {
        let instant = if failed { format!("{} s", short(reached)) } else { "the end".into() };
        writeln!(out, "\nat {instant}")?;
        let width = o.scene.probes.names.iter().map(|n| n.chars().count()).max().unwrap_or(0).clamp(11, 40);
        for (i, (name, x)) in o.scene.probes.names.iter().zip(o.values).enumerate() {
            let unit = o.scene.probes.units.get(i).and_then(Option::as_deref).map_or("", units::in_prose);
            let value = short(*x);
            writeln!(out, "  {name:width$} {}", format!("{value} {unit}").trim_end())?;
        }
    }
    Ok(())
}

/// Most names that a message lists.
pub const MAX_LISTED: usize = 8;

/// The parts of a model that do not run, and why; None if all runs.
pub fn left_out(left: &LeftOut) -> Option<String> {
    let regions = left.regions.iter().map(|r| format!("the region `{r}`"));
    let mut names: Vec<String> = regions.chain(left.states.iter().map(|z| format!("the state `{z}`"))).collect();
    let it = if names.len() == 1 { "it" } else { "them" };
    if let Some(more) = names.len().checked_sub(MAX_LISTED).filter(|more| *more > 1) {
        names.truncate(MAX_LISTED);
        names.push(format!("{more} more"));
    }
    let why = format!("no probe, open port or expectation depends on {it}");
    (!names.is_empty()).then(|| format!("{}: {why}", names.join(", ")))
}

fn region(out: &mut String, r: &RegionSummary) -> std::fmt::Result {
    let unit = if r.pseudo { "(of a pseudo energy)" } else { "J" };
    let kind = match r.period {
        Some(period) => format!("sampled every {} s", short(period)),
        None => "continuous".to_string(),
    };
    let plural = if r.states == 1 { "" } else { "s" };
    writeln!(out, "\n{:11} {}: {kind}, {} state{plural}", "region", r.name, r.states)?;
    let order = if r.order == 0 { "without error".to_string() } else { format!("order {}", r.order) };
    // An explicit method iterates in its fallback alone.
    let implicit = match (&r.fallback, r.explicit) {
        (Some((_, n)), true) => *n,
        (_, _) => r.steps,
    };
    let newton = if r.newton_iterations > 0 && implicit > 0 {
        let each = short(r.newton_iterations as f64 / implicit as f64);
        format!(", {each} Newton iteration{} each", if each == "1" { "" } else { "s" })
    } else {
        String::new()
    };
    let counted = |n: u64, what: &str| if n > 0 { format!(", {n} {what}") } else { String::new() };
    let rejected = counted(r.rejected, "rejected");
    let events = counted(r.events, if r.events == 1 { "event" } else { "events" });
    let others = r.fallback.as_ref().map(|(name, n)| format!(" ({n} by {name})")).unwrap_or_default();
    writeln!(out, "  {:11} {} ({order}), {} steps{others}{rejected}{events}{newton}", "stepper", r.stepper, r.steps)?;
    if !r.why.is_empty() {
        writeln!(out, "  {:11} {}", "because", r.why)?;
    }
    if let Some(hold) = &r.hold {
        let late = if r.latency > 0.0 { format!(", {} s after each sample", short(r.latency)) } else { String::new() };
        writeln!(out, "  {:11} {hold}{late}", "hold")?;
    }
    writeln!(out, "  {:11} {} -> {} {unit}", "H", short(r.h_initial), short(r.h_final))?;
    for (name, x) in
        [("supplied", r.supplied), ("dissipated", r.dissipated), ("leaked", r.leaked), ("debt", r.debt_max)]
    {
        if x != 0.0 || matches!(name, "supplied" | "dissipated") {
            writeln!(out, "  {name:11} {} {unit}", short(x))?;
        }
    }
    if r.releases > 0 {
        let often = if r.releases == 1 { "once".into() } else { format!("{} times", r.releases) };
        writeln!(out, "  {:11} {often} within an interval: what it had to give was drawn", "let go")?;
    }
    if let Some(m) = r.modified {
        let (most, part) = (short(m.max_difference), short(m.relative));
        let grown = (m.energy_excess > 0.0).then(|| {
            format!(
                "; H at most {} {unit} ({} of the stored energy) above the energy given",
                short(m.energy_excess),
                short(m.relative_energy_excess)
            )
        });
        let grown = grown.unwrap_or_default();
        writeln!(out, "  {:11} of a modified energy, at most {most} {unit} ({part} relative) from H{grown}", "ledger")?;
    }
    // The rounding error of a resistor almost at rest does not count.
    let turned = r.resistors.iter().fold(r.h_max, |most, x| most.max(x.energy.abs()));
    for x in r.resistors.iter().filter(|x| x.energy < 0.0 && -x.energy > 1e-9 * turned) {
        writeln!(out, "  {:11} {} {unit} by {}", "injected", short(-x.energy), x.name)?;
    }
    for x in &r.produced {
        writeln!(out, "  {:11} {} J/K by {}", "entropy", short(x.entropy), x.name)?;
    }
    if r.leaps > 0 {
        writeln!(out, "  {:11} {}", "leaps", r.leaps)?;
    }
    Ok(())
}

/// What the hold of a sampled region makes of the energy inside, apart from what crosses its ports.
fn leak(out: &mut String, r: &RegionSummary, scene: &Scene) -> std::fmt::Result {
    if !r.leaks_much {
        return Ok(());
    }
    let cluster = scene.regions.iter().find(|x| x.name == r.name).and_then(|x| scene.clusters.get(x.cluster));
    let stays = match cluster.is_some_and(|c| c.budget) {
        true => "which stay there: no port gives them out",
        false => "which may come out, under `budget off`",
    };
    let (came, size) = (short(r.supplied), short(r.leaked.abs()));
    let what = match r.leaked > 0.0 {
        true => format!("{came} J came in, and the hold added {size} J, {stays}"),
        false => format!("{came} J came in, and the hold took {size} J of that away"),
    };
    writeln!(out, "  {:11} {what}", "inside")?;
    let what = "more than a hundredth of H: the wall felt is not the wall written";
    let lagging = matches!(r.hold.as_deref(), Some("lagged" | "predicted"));
    let fix = if r.steered.iter().any(|x| x.steering == Steering::Drawing) {
        "a steered source returns no more than was put in; write the wall as a `C`, which stores that"
    } else if lagging {
        "take `hold matched`, or sample faster"
    } else {
        "sample faster, or make it softer or more damped"
    };
    writeln!(out, "  {:11} {what}; {fix}", "")
}

/// Each steered source with what it gave, in words.
pub fn steered(s: &Summary) -> Vec<String> {
    let one = |(region, x): (&RegionSummary, &SteeredSource)| {
        let what = match x.steering {
            Steering::Drawing => format!("it draws on what was put into `{}`", region.name),
            Steering::Unbounded => "it counts as a source, under `budget off`".into(),
            Steering::Active => "it counts as a source, `active`".into(),
            Steering::Beside => "it counts as a source".into(),
        };
        let gave = if x.energy < 0.0 { "took" } else { "gave" };
        format!("`{}` {gave} {} J: it reads the scene's own signals; {what}", x.name, short(x.energy.abs()))
    };
    s.regions.iter().flat_map(|r| r.steered.iter().map(move |x| (r, x))).map(one).collect()
}

/// The same for programs.
pub fn steered_json(s: &Summary) -> serde_json::Value {
    let role = |x: &SteeredSource| match x.steering {
        Steering::Drawing => "draws on the account",
        Steering::Unbounded => "unbounded",
        Steering::Active => "active",
        Steering::Beside => "source",
    };
    let one = |(region, x): (&RegionSummary, &SteeredSource)| serde_json::json!({"name": x.name, "region": region.name, "energy": x.energy, "role": role(x)});
    s.regions.iter().flat_map(|r| r.steered.iter().map(move |x| (r, x))).map(one).collect()
}

/// What may help where a run was not passive.
fn hints(o: &Outcome) -> Vec<String> {
    let regions = &o.summary.regions;
    let mut list = Vec::new();
    if let Some(r) = regions.iter().find(|r| !r.passive_stepper) {
        list.push(format!("`{}` does not keep the balance; `--method gonzalez` does", r.stepper));
    }
    if let Some(r) = regions
        .iter()
        .find(|r| matches!(r.hold.as_deref(), Some("lagged" | "predicted")) && (r.leaked > 0.0 || r.debt_max > 0.0))
    {
        list.push(format!("the hold of `{}` created energy; try `hold matched`", r.name));
    }
    list
}

/// Six digits.
pub fn short(x: f64) -> String {
    let size = x.abs();
    if x == 0.0 {
        return "0".into();
    }
    if !x.is_finite() {
        return format!("{x}");
    }
    let trim = |s: &str| {
        if s.contains('.') { s.trim_end_matches('0').trim_end_matches('.').to_string() } else { s.to_string() }
    };
    if (1e-4..1e6).contains(&size) {
        let digits = 5 - size.log10().floor() as i32;
        return trim(&format!("{x:.*}", digits.clamp(0, 12) as usize));
    }
    let text = format!("{x:.5e}");
    match text.split_once('e') {
        Some((mantissa, exponent)) => format!("{}e{exponent}", trim(mantissa)),
        None => text,
    }
}

/// For programs.
///
/// # Errors
/// None that is known.
pub fn json(o: &Outcome) -> Result<String, Stop> {
    serde_json::to_string_pretty(&Json(o)).map(|s| s + "\n").map_err(|e| Stop::Usage(e.to_string()))
}

struct Json<'a>(&'a Outcome<'a>);

impl Serialize for Json<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let o = self.0;
        let s = o.summary;
        let mut map = serializer.serialize_map(None)?;
        map.serialize_entry("model", &o.scene.name)?;
        map.serialize_entry("stop", &o.stop)?;
        map.serialize_entry("reached", &o.reached())?;
        map.serialize_entry("wall_seconds", &o.wall)?;
        map.serialize_entry("passive", &s.passive)?;
        map.serialize_entry("reasons", &s.reasons)?;
        map.serialize_entry("steered", &steered_json(s))?;
        map.serialize_entry("balance", &serde_json::json!({"worst_step": s.worst_step, "total": s.total}))?;
        let left = &o.scene.left_out;
        map.serialize_entry("left_out", &serde_json::json!({"regions": left.regions, "states": left.states}))?;
        map.serialize_entry("regions", &s.regions.iter().map(Region).collect::<Vec<_>>())?;
        let bars: Vec<_> = s
            .bars
            .iter()
            .map(|b| {
                let mut bar = serde_json::json!({"name": b.name, "holder": b.holder, "other": b.other, "difference": b.difference});
                if let (Some(bar), true) = (bar.as_object_mut(), b.resolution > 0.0) {
                    bar.insert("resolution".into(), b.resolution.into());
                    bar.insert("miscounted".into(), b.miscounted.into());
                }
                bar
            })
            .collect();
        map.serialize_entry("bars", &bars)?;
        let line = |l: &LineSummary| serde_json::json!({"name": l.name, "on_the_way": l.energy});
        map.serialize_entry("lines", &s.lines.iter().map(line).collect::<Vec<_>>())?;
        map.serialize_entry("final", &Final(o))?;
        if let Some(c) = o.chosen {
            map.serialize_entry("chosen", &Choice(c))?;
        }
        if let Some(why) = o.early {
            map.serialize_entry("error", &why.to_string())?;
        }
        map.end()
    }
}

struct Choice<'a>(&'a Chosen);

impl Serialize for Choice<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let c = self.0;
        let mut map = serializer.serialize_map(None)?;
        map.serialize_entry("method", c.method)?;
        match c.setting {
            Setting::Step(h) => map.serialize_entry("step", &h)?,
            Setting::Tolerance(x) => map.serialize_entry("tolerance", &x)?,
        }
        map.serialize_entry("estimated_error", &c.error)?;
        map.serialize_entry("why", &c.why)?;
        map.serialize_entry("against", &c.against)?;
        map.serialize_entry("choosing_seconds", &c.took)?;
        map.end()
    }
}

struct Region<'a>(&'a RegionSummary);

impl Serialize for Region<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let r = self.0;
        let mut map = serializer.serialize_map(None)?;
        map.serialize_entry("name", &r.name)?;
        map.serialize_entry("kind", r.kind)?;
        map.serialize_entry("period", &r.period)?;
        map.serialize_entry("states", &r.states)?;
        map.serialize_entry("stepper", &r.stepper)?;
        map.serialize_entry("why", &r.why)?;
        map.serialize_entry("order", &r.order)?;
        map.serialize_entry("hold", &r.hold)?;
        if r.latency > 0.0 {
            map.serialize_entry("latency", &r.latency)?;
        }
        map.serialize_entry("steps", &r.steps)?;
        if let Some((method, steps)) = &r.fallback {
            map.serialize_entry("fallback", &serde_json::json!({ "method": method, "steps": steps }))?;
        }
        map.serialize_entry("rejected", &r.rejected)?;
        map.serialize_entry("events", &r.events)?;
        map.serialize_entry("newton_iterations", &r.newton_iterations)?;
        map.serialize_entry("H_initial", &r.h_initial)?;
        map.serialize_entry("H_final", &r.h_final)?;
        map.serialize_entry("supplied", &r.supplied)?;
        map.serialize_entry("dissipated", &r.dissipated)?;
        map.serialize_entry("leaked", &r.leaked)?;
        map.serialize_entry("leaks_much", &r.leaks_much)?;
        map.serialize_entry("debt_max", &r.debt_max)?;
        map.serialize_entry("releases", &r.releases)?;
        map.serialize_entry("leaps", &r.leaps)?;
        map.serialize_entry("pseudo", &r.pseudo)?;
        if let Some(m) = r.modified {
            let modified = serde_json::json!({"difference": m.difference, "max_difference": m.max_difference, "relative": m.relative, "grown": m.energy_excess, "grown_relative": m.relative_energy_excess});
            map.serialize_entry("modified", &modified)?;
        }
        let energies = |list: &[bond::ElementEnergy]| -> Vec<_> {
            list.iter().map(|x| serde_json::json!({"name": x.name, "energy": x.energy})).collect()
        };
        map.serialize_entry("sources", &energies(&r.sources))?;
        map.serialize_entry("resistors", &energies(&r.resistors))?;
        let produced: Vec<_> =
            r.produced.iter().map(|x| serde_json::json!({"name": x.name, "entropy": x.entropy})).collect();
        map.serialize_entry("entropy", &produced)?;
        map.end()
    }
}

/// Probes in order of declaration.
struct Final<'a>(&'a Outcome<'a>);

impl Serialize for Final<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(None)?;
        for (name, x) in self.0.scene.probes.names.iter().zip(self.0.values) {
            map.serialize_entry(name, x)?;
        }
        map.end()
    }
}

#[cfg(test)]
mod tests {
    use super::short;

    #[test]
    fn six_digits() {
        let list = [0.0, 1.0, 0.1, 1.0 / 3.0, -123456.7, 1e6, 1.5e-9, 999999.9, 1e-4, f64::NAN, 100.0];
        let text: Vec<String> = list.into_iter().map(short).collect();
        assert_eq!(text, ["0", "1", "0.1", "0.333333", "-123457", "1e6", "1.5e-9", "1000000", "0.0001", "NaN", "100"]);
    }
}
