//! The comparison for programs: a list with an object for each point.

use super::Bench;
use super::point::{Measured, Point};
use super::setting::Setting;
use crate::stop::Stop;
use serde::ser::{Serialize, SerializeMap, Serializer};

/// Most states that are listed; of more, only the worst.
const MAX_STATES: usize = 32;

/// All points. Values that are not numbers, such as the error of a failed run, are null.
///
/// # Errors
/// None that is known.
pub fn json(b: &Bench) -> Result<String, Stop> {
    let list: Vec<Object> = b.points.iter().map(|p| Object(b, p)).collect();
    serde_json::to_string_pretty(&list).map(|s| s + "\n").map_err(|e| Stop::Usage(e.to_string()))
}

struct Object<'a>(&'a Bench, &'a Point);

impl Serialize for Object<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let Object(b, p) = self;
        let m = p.result.as_ref().ok();
        let mut map = serializer.serialize_map(None)?;
        map.serialize_entry("problem", &b.problem)?;
        map.serialize_entry("model", &b.model)?;
        map.serialize_entry("stop", &b.stop)?;
        map.serialize_entry("method", p.method)?;
        map.serialize_entry("order", &p.order)?;
        map.serialize_entry("passive_stepper", &p.passive)?;
        map.serialize_entry("keeps_balance", &p.keeps())?;
        let (step, tolerance) = match p.setting {
            Setting::Step(h) => (Some(h), None),
            Setting::Tolerance(x) => (None, Some(x)),
        };
        map.serialize_entry("step", &step)?;
        map.serialize_entry("tolerance", &tolerance)?;
        map.serialize_entry("error", &m.map(|m| m.error))?;
        map.serialize_entry("seconds", &m.map(|m| m.seconds))?;
        map.serialize_entry("seconds_per_second", &m.map(|m| m.seconds / b.stop))?;
        map.serialize_entry("front", &p.front)?;
        map.serialize_entry("floor", &m.map(|m| m.floor))?;
        map.serialize_entry("reference_error", &b.reference.error)?;
        map.serialize_entry("probes", &m.map(|m| Probes(b, m)))?;
        map.serialize_entry("states", &m.map(|m| States(b, m)))?;
        map.serialize_entry("drift", &m.map(|m| m.drift))?;
        map.serialize_entry("balance", &m.map(|m| m.balance))?;
        map.serialize_entry("steps", &m.map(|m| m.steps))?;
        map.serialize_entry("newton_iterations", &m.map(|m| m.iterations))?;
        if let Err(why) = &p.result {
            map.serialize_entry("failed", why)?;
        }
        map.end()
    }
}

/// Of each probe: relative error at the end and the largest along the run, and what they are relative to.
struct Probes<'a>(&'a Bench, &'a Measured);

impl Serialize for Probes<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let Probes(b, m) = self;
        let mut map = serializer.serialize_map(None)?;
        for (i, name) in b.quantities.names.iter().take(b.quantities.probes).enumerate() {
            let (end, along) = (m.difference.end.get(i), m.difference.along.get(i));
            let scale = b.reference.scales.get(i);
            map.serialize_entry(name, &serde_json::json!({"end": end, "largest": along, "scale": scale}))?;
        }
        map.end()
    }
}

/// The errors of the states at the end, or of the worst if there are many.
struct States<'a>(&'a Bench, &'a Measured);

impl Serialize for States<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let States(b, m) = self;
        let names = b.quantities.names.iter().zip(&m.difference.end).zip(&b.reference.scales);
        let mut list: Vec<((&String, &f64), &f64)> = names.skip(b.quantities.probes).collect();
        if list.len() > MAX_STATES {
            list.sort_by(|a, b| b.0.1.total_cmp(a.0.1));
            list.truncate(1);
        }
        let mut map = serializer.serialize_map(None)?;
        for ((name, end), scale) in list {
            map.serialize_entry(name, &serde_json::json!({"end": end, "scale": scale}))?;
        }
        map.end()
    }
}
