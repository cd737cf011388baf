//! The steppers, a file or folder each, and the table of them.
//!
//! A stepper is one row of the table: what it is, its name, its properties, the regions that it steps and the function
//! that writes its step. Whoever chooses, runs or prints a stepper reads the properties and never asks for the name.

pub(crate) mod collocation;
pub(crate) mod discrete_update;
pub(crate) mod exact;
pub(crate) mod explicit;
pub(crate) mod gonzalez;
mod kept_positions;
pub(crate) mod label;
mod mean_ratios;
pub(crate) mod predictor;
pub(crate) mod ray;
pub(crate) mod sav;

use crate::discretise::cluster::Cluster;
use crate::expression::Expr;
use crate::model::Model;
use crate::structure::Form;
use bond_grammar::diagnostic::Diagnostic;
use bond_grammar::source::Span;
use bond_runtime::scene::{Branch, Properties};
use collocation::tableau::Nodes;
use explicit::tableau::{self, Tableau};
use label::{Label, Refusal, Step};

/// Which regions a stepper steps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Regions {
    Continuous,
    Sampled,
    All,
}

/// What writes the step of a cluster.
enum Write {
    Implicit(fn(Label, &mut Cluster, &mut Model, &Form) -> Result<Step, Refusal>),
    Explicit(&'static Tableau),
}

/// A row of the table of steppers.
struct Row {
    label: Label,
    regions: Regions,
    write: Write,
}

impl Row {
    const fn implicit(
        name: &'static str,
        properties: Properties,
        write: fn(Label, &mut Cluster, &mut Model, &Form) -> Result<Step, Refusal>,
    ) -> Row {
        let label = Label { name, properties, fallback: None };
        Row { label, regions: Regions::Continuous, write: Write::Implicit(write) }
    }

    const fn explicit(name: &'static str, order: u32, tableau: &'static Tableau) -> Row {
        let properties = Properties { order, stages: tableau.stages(), explicit: true, ..Properties::NONE };
        let label = Label { name, properties, fallback: None };
        Row { label, regions: Regions::Continuous, write: Write::Explicit(tableau) }
    }

    /// Of steps that keep the balance.
    const fn passive(self) -> Row {
        let properties = Properties { passive: true, ..self.label.properties };
        Row { label: Label { properties, ..self.label }, ..self }
    }

    /// With other regions than the continuous ones.
    const fn of(self, regions: Regions) -> Row {
        Row { regions, ..self }
    }

    /// With a stepper that takes the steps that this one cannot take.
    const fn or(self, fallback: &'static Label) -> Row {
        Row { label: Label { fallback: Some(fallback), ..self.label }, ..self }
    }
}

/// Makes [`Method`] of the table.
macro_rules! table {
    ($($(#[doc = $what:literal])+ $variant:ident: $row:expr;)+) => {
        /// A stepper that can be asked for by name.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum Method {
            $($(#[doc = $what])+ $variant,)+
        }

        impl Method {
            /// All of them.
            pub const ALL: [Method; [$(Method::$variant),+].len()] = [$(Method::$variant),+];

            fn row(self) -> &'static Row {
                match self {
                    $(Method::$variant => {
                        static ROW: Row = $row;
                        &ROW
                    })+
                }
            }
        }
    };
}

/// Symmetric, of order 2 and without loss, as the implicit midpoint rule.
const MIDPOINT: Properties = Properties { order: 2, stages: 1, symmetric: true, passive: true, ..Properties::NONE };
const GONZALEZ: Label = Label { name: "gonzalez", properties: MIDPOINT, fallback: None };

/// Those of collocation at the nodes of Gauss.
const fn gauss(stages: u32) -> Properties {
    Properties { order: 2 * stages, stages, ..MIDPOINT }
}

const COLLOCATION8: Label = Label { name: "collocation8", properties: gauss(4), fallback: None };

/// Those of Radau IIA of 3 stages.
const RADAU: Label = Label {
    name: "radau",
    properties: Properties {
        order: 5,
        stages: 3,
        l_stable: true,
        stiffly_accurate: true,
        passive: true,
        ..Properties::NONE
    },
    fallback: None,
};

table! {
    /// The matrix exponential, for linear regions.
    Exact: Row::implicit("exact", Properties { passive: true, ..Properties::NONE }, exact::step);
    /// The discrete gradient.
    Gonzalez: Row::implicit(GONZALEZ.name, GONZALEZ.properties, gonzalez::step).of(Regions::All);
    /// Energy-preserving collocation of 2 stages.
    Collocation4: Row::implicit("collocation4", gauss(2), |l, c, m, f| collocation::step(l, c, m, f, Nodes::Gauss(2)))
        .or(&GONZALEZ);
    /// The same of 3.
    Collocation6: Row::implicit("collocation6", gauss(3), |l, c, m, f| collocation::step(l, c, m, f, Nodes::Gauss(3)))
        .or(&GONZALEZ);
    /// The same of 4.
    Collocation8: Row::implicit(COLLOCATION8.name, COLLOCATION8.properties, |l, c, m, f| collocation::step(l, c, m, f, Nodes::Gauss(4)))
        .or(&GONZALEZ);
    /// The same of 5.
    Collocation10: Row::implicit("collocation10", gauss(5), |l, c, m, f| collocation::step(l, c, m, f, Nodes::Gauss(5)))
        .or(&GONZALEZ);
    /// The same of 6.
    Collocation12: Row::implicit("collocation12", gauss(6), |l, c, m, f| collocation::step(l, c, m, f, Nodes::Gauss(6)))
        .or(&GONZALEZ);
    /// Radau IIA of 3 stages, which damps what is stiff.
    Radau: Row::implicit(RADAU.name, RADAU.properties, |l, c, m, f| collocation::step(l, c, m, f, Nodes::Radau));
    /// Linearly implicit with a quadratised energy: one linear solve.
    Sav: Row::implicit("sav", MIDPOINT, sav::step);
    /// The paper's own, for sampled regions.
    Ray: Row::implicit("ray", Properties { order: 1, stages: 1, passive: true, ..Properties::NONE }, ray::step)
        .of(Regions::Sampled);
    /// That of Dormand and Prince of order 8, put back on the balance after each step.
    Projected8: Row::explicit("projected8", 8, &tableau::PROJECTED8).passive().or(&COLLOCATION8);
    /// Explicit Euler.
    Euler: Row::explicit("euler", 1, &tableau::EULER);
    /// The semi-implicit Euler method.
    SymplecticEuler: Row::explicit("symplectic_euler", 1, &tableau::SYMPLECTIC);
    /// The classical Runge-Kutta method.
    Rk4: Row::explicit("rk4", 4, &tableau::RK4);
    /// That of Dormand and Prince, of order 5 with an estimate of order 4.
    Rk45: Row::explicit("rk45", 5, &tableau::RK45);
    /// Theirs of order 8 with estimates of order 5 and 3.
    Dop853: Row::explicit("dop853", 8, &tableau::DOP853);
}

impl Method {
    /// As it is written.
    pub fn name(self) -> &'static str {
        self.row().label.name
    }

    /// What is known of it; of some clusters a stepper may know more, which the scene then says.
    pub fn properties(self) -> Properties {
        self.row().label.properties
    }

    pub(crate) fn label(self) -> Label {
        self.row().label
    }

    /// The method of this name.
    pub fn named(name: &str) -> Option<Method> {
        Method::ALL.into_iter().find(|m| m.name() == name)
    }

    /// Whether it steps continuous regions.
    pub(crate) fn is_for_continuous(self) -> bool {
        self.row().regions != Regions::Sampled
    }

    /// Whether it steps sampled regions.
    pub(crate) fn is_for_sampled(self) -> bool {
        self.row().regions != Regions::Continuous
    }

    /// Writes the step of a cluster.
    ///
    /// # Errors
    /// A cluster that it cannot step.
    pub(crate) fn write(self, c: &mut Cluster, model: &mut Model, form: &Form) -> Result<Step, Vec<Diagnostic>> {
        let Row { label, write, .. } = self.row();
        let step = match write {
            Write::Implicit(write) => write(*label, c, model, form),
            Write::Explicit(tableau) => explicit::step(*label, c, model, form, tableau),
        };
        step.map_err(|refusal| match refusal {
            Refusal::Unfit(why) => self.unfit(model, c, form, &why),
            Refusal::Wrong(list) => list,
        })
    }

    /// The step of an explicit method with what `switches` kept on one branch; None of another method.
    pub(crate) fn write_branch(
        self,
        c: &Cluster,
        model: &mut Model,
        form: &Form,
        switches: &[(Expr, usize)],
    ) -> Result<Option<Branch>, Vec<Diagnostic>> {
        let Row { label, write, .. } = self.row();
        match write {
            Write::Explicit(tableau) => explicit::branch(*label, c, model, form, tableau, switches),
            Write::Implicit(_) => Ok(None),
        }
    }

    /// Says that it cannot step a cluster.
    pub(crate) fn unfit(self, model: &Model, cluster: &Cluster, form: &Form, why: &str) -> Vec<Diagnostic> {
        let own = cluster.sampling.map(|s| &model.samplings[s]).filter(|s| s.method.is_some()).map(|s| s.span);
        let named = own.or(model.settings.method.as_ref().map(|m| m.1));
        let (code, span) = named.map_or((ASKED, model.span), |span| (NAMED, span));
        let region = cluster.name(form);
        let what = format!("the method `{}` cannot step the region `{region}`: {why}", self.name());
        vec![Diagnostic::error(code, span, what).help(OTHERWISE)]
    }
}

/// What else to do where a method cannot be taken.
pub(crate) const OTHERWISE: &str = "take `gonzalez`, which steps every region, or leave the method out";
/// What is wrong with a method that the model names, and with one that the user asks for in its place.
pub(crate) const NAMED: &str = "discretise::method";
pub(crate) const ASKED: &str = "discretise::asked";

/// Says that no method has this name.
pub(crate) fn unknown_method(name: &str, span: Span) -> Vec<Diagnostic> {
    let known: Vec<&str> = Method::ALL.iter().map(|m| m.name()).collect();
    let e = Diagnostic::error(NAMED, span, format!("unknown method `{name}`"));
    vec![match crate::elaborate::nearest(name, known.iter().copied()) {
        Some(n) => e.help(format!("did you mean `{n}`?")),
        None => e.help(format!("the methods are {}", known.join(", "))),
    }]
}
