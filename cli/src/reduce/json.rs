//! The results of a reduction as JSON.

use super::{Reduction, Size};
use crate::bench::Setting;
use crate::stop::Stop;
use serde_json::{Map, Value, json};

/// An object: the parts by activity, both models, and what is left out.
///
/// # Errors
/// It cannot be written.
pub fn json(r: &Reduction) -> Result<String, Stop> {
    let parts: Vec<Value> = r
        .parts
        .iter()
        .map(|e| {
            json!({
                "name": e.part.name,
                "kind": e.part.kind,
                "activity": e.activity,
                "share": e.share,
                "left_out": e.kept.is_none(),
                "kept_because": e.kept,
            })
        })
        .collect();
    let size = |s: &Size| {
        json!({
            "parts": s.parts,
            "states": s.states,
            "steps": s.steps,
            "seconds_a_second": s.seconds,
        })
    };
    let moved: Map<String, Value> = r.moved.iter().map(|(name, x)| (name.clone(), json!(x))).collect();
    let (step, tolerance) = match r.setting {
        Setting::Step(h) => (Some(h), None),
        Setting::Tolerance(x) => (None, Some(x)),
    };
    let object = json!({
        "model": r.model,
        "error": r.error,
        "stop": r.stop,
        "step": step,
        "tolerance": tolerance,
        "unneeded": {"regions": r.unneeded.regions, "states": r.unneeded.states},
        "parts": parts,
        "whole": size(&r.whole),
        "reduced": size(&r.reduced),
        "moved": moved,
        "without": r.without(),
    });
    serde_json::to_string_pretty(&object).map(|text| text + "\n").map_err(|e| Stop::Usage(e.to_string()))
}
