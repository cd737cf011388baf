//! From the port-Hamiltonian form to step programs: one file a stepper, one for the holds.

mod accounts;
mod ahead;
mod choice;
mod cluster;
mod collocation;
mod exact;
mod explicit;
mod gather;
mod gonzalez;
mod guard;
mod hold;
mod instant;
mod jump;
mod level;
mod measure;
mod near;
mod order;
mod probes;
mod ray;
mod root;
mod sav;
mod start;
mod stiff;
mod stored;
mod swing;
mod switching;
mod tear;
mod tie;
mod tight;
mod turn;
mod upright;
mod whole;
mod write;

pub(crate) use probes::mixed;

use crate::Options;
use crate::expression::Symbol;
use crate::model::{Model, Signal, Variable};
use crate::structure::{ColumnId, Form, Role};
use crate::units::Dimension;
use bond_grammar::diagnostic::Diagnostic;
use bond_runtime::scene::{self, Made, Scene};
pub use choice::Accuracy;
use cluster::Cluster;
use rustc_hash::FxHashMap;
pub use switching::{Switching, is_uncut, switching};

/// A stepper that can be asked for by name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// The matrix exponential, for linear regions.
    Exact,
    /// The discrete gradient.
    Gonzalez,
    /// Energy-preserving collocation of 2 stages.
    Collocation4,
    /// The same of 3.
    Collocation6,
    /// The same of 4.
    Collocation8,
    /// The same of 5.
    Collocation10,
    /// The same of 6.
    Collocation12,
    /// Radau IIA of 3 stages, which damps what is stiff.
    Radau,
    /// Linearly implicit with a quadratised energy: one linear solve.
    Sav,
    /// The paper's own, for sampled regions.
    Ray,
    /// Explicit Euler.
    Euler,
    /// The classical Runge-Kutta method.
    Rk4,
    /// That of Dormand and Prince, of order 5 with an estimate of order 4.
    Rk45,
    /// Theirs of order 8 with estimates of order 5 and 3.
    Dop853,
    /// The semi-implicit Euler method.
    SymplecticEuler,
}

impl Method {
    /// All of them.
    pub const ALL: [Method; 15] = [
        Method::Exact,
        Method::Gonzalez,
        Method::Collocation4,
        Method::Collocation6,
        Method::Collocation8,
        Method::Collocation10,
        Method::Collocation12,
        Method::Radau,
        Method::Sav,
        Method::Ray,
        Method::Euler,
        Method::SymplecticEuler,
        Method::Rk4,
        Method::Rk45,
        Method::Dop853,
    ];

    /// As it is written.
    pub fn name(self) -> &'static str {
        match self {
            Method::Exact => "exact",
            Method::Gonzalez => "gonzalez",
            Method::Collocation4 => "collocation4",
            Method::Collocation6 => "collocation6",
            Method::Collocation8 => "collocation8",
            Method::Collocation10 => "collocation10",
            Method::Collocation12 => "collocation12",
            Method::Radau => "radau",
            Method::Sav => "sav",
            Method::Ray => "ray",
            Method::Euler => "euler",
            Method::Rk4 => "rk4",
            Method::Rk45 => "rk45",
            Method::Dop853 => "dop853",
            Method::SymplecticEuler => "symplectic_euler",
        }
    }

    /// The method of this name.
    pub fn named(name: &str) -> Option<Method> {
        Method::ALL.into_iter().find(|m| m.name() == name)
    }
}

/// What is wrong with a method that the model names, and with one that the user asks for in its place.
const NAMED: &str = "discretise::method";
const ASKED: &str = "discretise::asked";

/// The method that the user or the model names.
///
/// # Errors
/// A name that there is not, or a method for what the model has not.
pub fn method(model: &Model, options: &Options) -> Result<Option<Method>, Vec<Diagnostic>> {
    let (name, span, code) = match (&options.method, &model.settings.method) {
        (Some(name), _) => (name, model.span, ASKED),
        (None, Some((name, span))) => (name, *span, NAMED),
        (None, None) => return Ok(None),
    };
    match Method::named(name) {
        Some(Method::Ray) if model.samplings.is_empty() => {
            let what = "the method `ray` steps sampled regions, and there is none";
            Err(vec![
                Diagnostic::error(code, span, what)
                    .help("take `gonzalez`, which steps every region, or leave the method out"),
            ])
        }
        Some(method) => Ok(Some(method)),
        None => Err(cluster::unknown_method(name, span)),
    }
}

/// Writes the programs of a scene. `method` is for all regions that can take it; without one, the accuracy chooses.
///
/// # Errors
/// A method that a region cannot take.
pub fn discretise(
    model: &mut Model,
    form: &Form,
    method: Option<Method>,
    (accuracy, step): (Accuracy, Option<f64>),
) -> Result<Scene, Vec<Diagnostic>> {
    let tolerance = accuracy.tolerance(model.settings.tolerance);
    let accuracy = match accuracy {
        Accuracy::AsModel if tolerance.is_none() && step.or(model.settings.step).is_some() => Accuracy::Fixed,
        other => other,
    };
    let mut clusters = gather::gather(model, form, method == Some(Method::Ray));
    let wanted = probes::wanted(model, form);
    // Which signals does each cluster have to show to the others and to the probes?
    let mut shows: Vec<Vec<Symbol>> = vec![Vec::new(); clusters.len()];
    let owner: FxHashMap<Symbol, usize> =
        clusters.iter().enumerate().flat_map(|(i, c)| c.owned(form).into_iter().map(move |s| (s, i))).collect();
    let mut places: FxHashMap<Symbol, (usize, usize)> = FxHashMap::default();
    for s in clusters.iter().flat_map(|c| c.foreign.iter().copied()).chain(wanted) {
        if let Some(&i) = owner.get(&s)
            && !places.contains_key(&s)
        {
            places.insert(s, (i, shows[i].len()));
            shows[i].push(s);
        }
    }
    let place = |s: Symbol| places.get(&s).copied();
    let made = Made { pace: model.settings.pace, tolerance };
    let mut scene = Scene { name: model.name.clone(), excluded: excluded(model, form), made, ..Scene::default() };
    for (i, c) in clusters.iter_mut().enumerate() {
        let foreign = c.foreign.iter().map(|s| place(*s).ok_or_else(|| cluster::missing(model, *s)));
        let foreign = foreign.collect::<Result<Vec<_>, _>>()?;
        c.fitted = tolerance.is_some();
        scene.clusters.push(c.build(model, form, (method, tolerance, accuracy), &shows[i], foreign)?);
    }
    for i in &model.inputs {
        let (name, unit) = (i.name.clone(), i.unit.map(|u| u.to_string()));
        scene.inputs.push(scene::Input { name, unit, value: i.value });
    }
    let mut home = vec![0; form.regions.len()];
    for (i, c) in clusters.iter().enumerate() {
        c.regions.iter().for_each(|r| home[r.at()] = i);
    }
    for (i, r) in form.regions.iter().enumerate() {
        scene.regions.push(scene::Region {
            name: r.name.clone(),
            period: r.sampling.map(|s| model.samplings[s].period),
            states: r.states.len(),
            cluster: home[i],
            pseudo: r.pseudo,
        });
    }
    let ports =
        clusters.iter().enumerate().flat_map(|(i, c)| c.ports.iter().enumerate().map(move |(p, id)| (*id, (i, p))));
    let ports: FxHashMap<ColumnId, (usize, usize)> = ports.collect();
    let port_of = |column: ColumnId| ports.get(&column).copied();
    for bar in &form.bars {
        let (Some(holder), Some(other)) = (port_of(bar.holder), port_of(bar.held)) else { continue };
        let answer = form.column(bar.holder).gives;
        let sign = if answer == Variable::Flow { 1.0 } else { -1.0 };
        scene.bars.push(scene::Bar { name: model.bond(bar.bond).name.clone(), holder, other, sign });
    }
    for (i, c) in form.columns.iter().enumerate() {
        if let Role::Open(inertia) = c.role
            && let Some(port) = port_of(ColumnId(i as u32))
        {
            let takes_flow = c.gives == Variable::Flow;
            let other = if takes_flow { Variable::Effort } else { Variable::Flow };
            let (along, answers) = (c.sign_of(c.gives) as f64, c.sign_of(other) as f64);
            let (effort, flow) = model.units.get(c.bond.at()).copied().unwrap_or_default();
            let (own, other) = if takes_flow { (effort, flow) } else { (flow, effort) };
            scene.open.push(scene::Open {
                name: c.name.clone(),
                port,
                inertia,
                takes_flow,
                unit: own.map(|u| u.to_string()),
                moved: other.map(|u| u.mul(Dimension::SECOND).to_string()),
                along,
                answers,
            });
        }
    }
    scene.probes = probes::build(model, form, &place);
    Ok(scene)
}

/// Elements for which no passivity can be claimed.
fn excluded(model: &Model, form: &Form) -> Vec<String> {
    // A field is named once.
    let active = model.elements.iter().filter(|e| e.active && e.field.is_none_or(|f| f.1 == 0));
    let name = |e: &crate::model::Element| e.field.map_or(e.name.clone(), |f| model.fields[f.0].name.clone());
    let mut list: Vec<String> = active.map(|e| format!("active `{}`", name(e))).collect();
    for r in &form.regions {
        for g in r.groups.iter().filter(|g| !g.bounded) {
            for s in &g.states {
                list.push(format!("`{}`, whose energy has no lower bound", r.states[*s].name));
            }
        }
    }
    list
}

/// Whether a symbol is time.
fn is_time(model: &Model, s: Symbol) -> bool {
    model.signals.get(&s) == Some(&Signal::Time)
}

/// Which input a symbol is, or is the slope of.
fn input_of(model: &Model, s: Symbol) -> Option<usize> {
    match model.signals.get(&s) {
        Some(Signal::Input(i) | Signal::Slope(i)) => Some(*i),
        Some(
            Signal::Time
            | Signal::Effort(_)
            | Signal::Flow(_)
            | Signal::State(_)
            | Signal::Integral(_)
            | Signal::Argument(_)
            | Signal::Parameter(_)
            | Signal::Memory(_),
        )
        | None => None,
    }
}

/// Makes the error for a method that a region cannot take.
fn unfit(model: &Model, cluster: &Cluster, form: &Form, method: Method, why: &str) -> Vec<Diagnostic> {
    let own = cluster.sampling.map(|s| &model.samplings[s]).filter(|s| s.method.is_some()).map(|s| s.span);
    let named = own.or(model.settings.method.as_ref().map(|m| m.1));
    let (code, span) = named.map_or((ASKED, model.span), |span| (NAMED, span));
    let region = cluster.name(form);
    vec![
        Diagnostic::error(
            code,
            span,
            format!("the method `{}` cannot step the region `{region}`: {why}", method.name()),
        )
        .help("take `gonzalez`, which steps every region, or leave the method out"),
    ]
}
