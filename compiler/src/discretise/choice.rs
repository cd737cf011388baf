//! Which stepper a continuous cluster takes where none is named: a table of rules, of which the first that applies
//! decides.

use crate::discretise::analysis::{index2, polynomial, relay, smoothness, switching_conditions};
use crate::discretise::cluster::Cluster;
use crate::discretise::steppers::exact::{self, Exact};
use crate::discretise::steppers::explicit::projection::Projection;
use crate::discretise::steppers::label::Step;
use crate::discretise::steppers::{Method, collocation};
use crate::expression::{Expr, Node};
use crate::model::Model;
use crate::structure::Form;
use crate::thresholds::ChoiceThresholds;
use bond_grammar::diagnostic::Diagnostic;

/// The error of a step, relative, where neither the run nor the model says one, nor a step.
pub const DEFAULT_TOLERANCE: f64 = 1e-6;

/// What was asked of a run's accuracy besides the method.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Accuracy {
    /// What the model's `simulate` says; [`DEFAULT_TOLERANCE`] if it says nothing.
    #[default]
    AsModel,
    /// Steps are of a fixed length.
    Fixed,
    /// Steps are of a fixed length, and none is cut where a law switches, as in a program of its own.
    Uncut,
    /// Steps are fitted to this tolerance.
    Tolerance(f64),
}

impl Accuracy {
    /// What it comes to where the model's `simulate` says a tolerance or a step, or the run a step.
    pub(crate) fn of_model(self, tolerance: Option<f64>, step: Option<f64>) -> Self {
        match (self, tolerance, step) {
            (Accuracy::AsModel, Some(x), _) => Accuracy::Tolerance(x),
            (Accuracy::AsModel, None, Some(_)) => Accuracy::Fixed,
            (Accuracy::AsModel, None, None) => Accuracy::Tolerance(DEFAULT_TOLERANCE),
            (other, _, _) => other,
        }
    }

    /// The tolerance that steps are fitted to, if they are.
    pub(crate) fn tolerance(self) -> Option<f64> {
        match self {
            Accuracy::Tolerance(x) => Some(x),
            Accuracy::AsModel | Accuracy::Fixed | Accuracy::Uncut => None,
        }
    }
}

/// Counts of unknowns that the choice goes by.
struct Limits {
    /// Unknowns of a stage up to which collocation is cheap; above, the sparse system of order 2 is known to be.
    unknowns: usize,
    /// The same of a linear region with storages that follow a moving source: its matrix is constant.
    unknowns_linear: usize,
    /// The same where the tolerance is at most `large`, or of a region with kinks `corners` ([`ChoiceThresholds`]): far
    /// fewer steps of order 6 are worth what each costs, and compiling it. A region with many diodes would begin far
    /// more steps.
    unknowns_tight: usize,
}

const LIMITS: Limits = Limits { unknowns: 16, unknowns_linear: 64, unknowns_tight: 512 };

/// What the rules ask of a cluster. Facts that take work are found once, when the first rule asks for them.
struct Facts<'a> {
    c: &'a Cluster,
    model: &'a mut Model,
    form: &'a Form,
    by: ChoiceThresholds,
    accuracy: Accuracy,
    tolerance: Option<f64>,
    /// The step by the matrix exponential, where there is one.
    exact: Option<Exact>,
    laws: Vec<Expr>,
    damps: Option<bool>,
    kinked: Option<bool>,
}

impl Facts<'_> {
    /// Unknowns of a stage of collocation, but arguments of exponentials: what these are solved with is linear in the
    /// rest.
    fn unknowns(&self) -> usize {
        self.c.states.len() + self.c.loops.len() - self.c.exponential_arguments().len()
    }

    fn is_small(&self) -> bool {
        self.unknowns() <= LIMITS.unknowns
    }

    fn is_linear(&self) -> bool {
        self.c.nodes.iter().all(|n| !n.curved)
    }

    fn all_quadratic(&mut self) -> bool {
        polynomial::all_quadratic(self.c, &mut self.model.pool)
    }

    /// Whether `radau` can step it and books what it damps. Its steps end before a switch: no node of it may find what
    /// a state takes across.
    fn damps(&mut self) -> bool {
        if let Some(damps) = self.damps {
            return damps;
        }
        let damps = !self.c.has_moving_source_driven_storage(&self.model.pool)
            && collocation::is_coupled(self.c, stages(Method::Radau))
            && self.all_quadratic()
            && !relay::has_state_dependent_switch(self.c, self.model, self.form);
        *self.damps.insert(damps)
    }

    fn any_law(&self, test: &dyn Fn(&Node) -> bool) -> bool {
        self.laws.iter().any(|e| self.model.pool.any_node(*e, test))
    }

    fn is_kinked(&mut self) -> bool {
        let found = self.kinked.unwrap_or_else(|| self.any_law(&smoothness::is_kink) || self.is_non_smooth());
        *self.kinked.insert(found)
    }

    fn is_non_smooth(&self) -> bool {
        smoothness::is_non_smooth(self.c)
    }

    fn has_flat_law(&mut self) -> bool {
        let pool = &mut self.model.pool;
        self.c.nodes.iter().any(|n| smoothness::is_flat(n, pool))
    }

    /// Whether explicit steps can be put on the balance, and see all that there is: no law has a kink, or a slope
    /// without a bound.
    fn is_smooth(&mut self) -> bool {
        self.c.loops.is_empty()
            && self.c.exponential_arguments().is_empty()
            && self.unknowns() <= LIMITS.unknowns_tight
            && !self.is_kinked()
            && !self.any_law(&smoothness::is_root)
            && !self.has_flat_law()
            && Projection::of(self.c, self.model, self.form).is_ok()
    }

    fn has_energy(&self) -> bool {
        !self.c.groups.is_empty()
    }

    fn follows_source(&self) -> bool {
        !self.c.driving_sources.is_empty()
    }

    /// Whether steps are fitted to a tolerance.
    fn is_fitted(&self) -> bool {
        self.tolerance.is_some()
    }

    /// Whether steps are fitted to a tolerance of at most this.
    fn is_within(&self, tolerance: f64) -> bool {
        self.tolerance.is_some_and(|t| t <= tolerance)
    }
}

fn stages(method: Method) -> usize {
    method.properties().stages as usize
}

/// A rule: a cluster takes this stepper, for this reason, where the rule applies and none before it does.
struct Rule {
    take: Method,
    because: &'static str,
    when: fn(&mut Facts) -> bool,
}

/// Why a linear cluster that `exact` would cut its steps for is not stepped by that.
pub(crate) const UNCUT: &str = "a source switches, and no step of it is cut there";

const RULES: [Rule; 23] = [
    // Of an odd number of stages: what is stiff and was set off by a jump of the source is damped at last. Not of what
    // is sampled, in intervals that are short beside what moves.
    Rule {
        take: Method::Collocation6,
        because: "it is linear, but for a source that `exact` does not follow",
        when: |f| f.is_fitted() && f.exact.as_ref().is_some_and(|e| e.strays) && f.is_small() && f.c.ports.is_empty(),
    },
    Rule {
        take: Method::Gonzalez,
        because: UNCUT,
        when: |f| {
            f.accuracy == Accuracy::Uncut
                && f.exact.is_some()
                && switching_conditions::find(f.c, f.model, f.form, true).is_some()
        },
    },
    Rule { take: Method::Exact, because: "it is linear", when: |f| f.exact.is_some() },
    // They agree where positions do, which are kept at the ends of its steps; the nodes of others lie between.
    Rule {
        take: Method::Gonzalez,
        because: "constraints of it say the same, and only its steps keep the positions by which they agree",
        when: |f| f.c.redundant,
    },
    // A probe is to cost no accuracy.
    Rule {
        take: Method::Collocation8,
        because: "it is linear, but for what a probe integrates",
        when: |f| exact::takes_states(f.c, f.model, f.form),
    },
    Rule {
        take: Method::Radau,
        because: "a law is all but a switch, and what it damps within a step must not ring on",
        when: |f| f.damps() && relay::has_relay(f.c, f.model, f.form),
    },
    Rule {
        take: Method::Radau,
        because: "a law whose vertical branch ties a storage to a source must not let the storage ring about it",
        when: |f| f.damps() && index2::has_index2_constraint(f.c, f.model, f.form),
    },
    // The middle of a step, and of its halves, may all lie below a knee that its end is far beyond.
    Rule {
        take: Method::Radau,
        because: "it has exponentials, and a step must see where on them it ends",
        when: |f| {
            f.damps() && f.is_fitted() && !f.is_within(f.by.exponentials) && !f.c.exponential_arguments().is_empty()
        },
    },
    Rule {
        take: Method::Gonzalez,
        because: "a storage follows a source",
        when: |f| {
            let fits = f.is_small() || f.is_linear() && f.unknowns() <= LIMITS.unknowns_linear;
            f.follows_source() && (!fits || f.is_kinked() || !f.all_quadratic())
        },
    },
    Rule {
        take: Method::Collocation8,
        because: "it is linear, but for a storage that follows a source",
        when: |f| f.follows_source() && f.is_linear(),
    },
    Rule {
        take: Method::Collocation8,
        because: "it is linear and large, and the tolerance asks for order 8",
        when: |f| !f.is_small() && f.is_linear() && f.all_quadratic() && f.has_energy() && f.is_within(f.by.order_2),
    },
    Rule {
        take: Method::Gonzalez,
        because: "it is linear, and large",
        when: |f| !f.is_small() && f.is_linear() && f.all_quadratic() && f.has_energy(),
    },
    // No energy is there to be kept, so what damps may go on.
    Rule {
        take: Method::Projected8,
        because: "it is smooth; where a step finds it stiff, `radau` goes on",
        when: |f| !f.has_energy() && f.is_within(f.by.order_2) && f.is_smooth(),
    },
    Rule {
        take: Method::Projected8,
        because: "it is smooth; where a step finds it stiff, `collocation8` goes on",
        when: |f| f.is_within(f.by.order_2) && f.is_smooth(),
    },
    Rule { take: Method::Gonzalez, because: "it is not linear", when: |f| !f.is_within(f.by.order_2) },
    Rule {
        take: Method::Gonzalez,
        because: "it is not linear, and large",
        when: |f| {
            let limit = if f.is_kinked() { f.by.corners } else { f.by.large };
            // Constraints name neighbours alone: a step takes time in proportion to them.
            let few = f.unknowns() <= LIMITS.unknowns_tight || f.c.has_constraints();
            let fits = few && f.c.exponential_arguments().is_empty() && !f.is_non_smooth();
            !(f.is_small() || f.is_within(limit) && fits)
        },
    },
    // Where branched laws hold one another, as dry friction on both sides of a gear, only steps of order 2 go on well.
    Rule {
        take: Method::Gonzalez,
        because: "it is not linear, and not smooth",
        when: |f| {
            let ideal = f.is_non_smooth() && smoothness::ideal_laws(f.c, &mut f.model.pool) > 1;
            let corners = if ideal { f.by.ideal } else { f.by.corners };
            let limit = if f.is_non_smooth() { corners } else { f.by.order_8 };
            f.is_kinked() && !f.is_within(limit)
        },
    },
    // A tank that runs dry does so in finite time: nodes on both sides of that instant would fill it again.
    Rule {
        take: Method::Radau,
        because: "it comes to rest by a root, in finite time, and must not go on beyond",
        when: |f| f.is_kinked() && f.damps() && !f.c.states.is_empty() && smoothness::empties(f.c, &mut f.model.pool),
    },
    Rule {
        take: Method::Gonzalez,
        because: "it is not linear, and has kinks and a root",
        when: |f| {
            f.is_kinked()
                && !collocation::is_coupled(f.c, stages(Method::Collocation8))
                && (f.any_law(&smoothness::is_root) || f.has_flat_law())
        },
    },
    Rule {
        take: Method::Collocation6,
        because: "it is large, and the tolerance asks for order 6",
        when: |f| !f.is_small(),
    },
    Rule {
        take: Method::Collocation8,
        because: "steps end at its kinks, and the tolerance asks for order 8",
        when: |f| f.is_kinked(),
    },
    Rule {
        take: Method::Collocation8,
        because: "it is smooth, and the tolerance asks for order 8",
        when: |f| f.is_within(f.by.order_8),
    },
    Rule { take: Method::Collocation6, because: "it is smooth, and the tolerance asks for order 6", when: |_| true },
];

/// The stepper of a cluster, and why.
pub(crate) struct Choice {
    pub(crate) method: Method,
    pub(crate) because: &'static str,
    /// The step, where choosing has made it already.
    pub(crate) step: Option<Step>,
}

/// Chooses the stepper of a continuous cluster. Every one that is chosen is passive.
///
/// # Errors
/// Those of writing a step by the matrix exponential, which is how it is found whether a cluster is linear.
pub(crate) fn choose(
    c: &Cluster,
    model: &mut Model,
    form: &Form,
    (accuracy, tolerance): (Accuracy, Option<f64>),
) -> Result<Choice, Vec<Diagnostic>> {
    let exact = exact::write(Method::Exact.label(), c, model, form)?;
    let laws = smoothness::laws(c);
    let by = model.settings.thresholds.choice;
    let mut facts = Facts { c, model, form, by, accuracy, tolerance, exact, laws, damps: None, kinked: None };
    let rule = RULES.iter().find(|rule| (rule.when)(&mut facts));
    let (method, because) = rule.map_or((Method::Gonzalez, ""), |rule| (rule.take, rule.because));
    let step = facts.exact.filter(|_| method == Method::Exact).map(|exact| exact.step);
    Ok(Choice { method, because, step })
}

#[cfg(test)]
mod tests {
    use super::{Accuracy, RULES};
    use crate::elaborate::NoFiles;
    use bond_grammar::source::Sources;

    /// Dividers of 12 outlets and a spring that hardens: too many unknowns for `radau`.
    const OUTLETS: &str = "model M {
      C:spring { H = 0.5*(1 Pa/m^3)*q^2 + 0.25*(1 Pa/m^9)*q^4 }
      spring -> 0:low
      for i in 1..12 {
        C:tank[i] { stiffness = 1 Pa/m^3; e0 = 1 Pa }
        R:hole[i] { f = (1 m^3/(s*Pa^(1/2)))*sign(e)*sqrt(abs(e)) }
        tank[i] -> 1:q[i] -> hole[i]
        q[i] -> low
      }
    }";

    const LADDER: &str = "model M {
      Se:u = 1 V
      u -> 0:node[0]
      for i in 1..100 {
        R:r[i] = 1 kOhm
        C:c[i] = 1 uF
        node[i-1] -> 1:s[i] -> r[i]
        s[i] -> 0:node[i] -> c[i]
      }
    }";

    const CHAIN_WITH_KINKS: &str = "model M {
      for i in 1..20 {
        I:mass[i] = 1 kg
        C:spring[i] { H = if q > 0 m then 0.5*(1 N/m)*q^2 + 0.25*(1 N/m^3)*q^4 else 0 J;  q0 = 1 m }
        0:force[i] -> spring[i]
        1:v[i] -> mass[i], force[i]
      }
      for i in 2..20 { force[i] -> v[i-1] }
    }";

    /// Two resistors in series, neither of which tells what the other bears.
    const LOOP: &str = "model M {
      Se:u = 1 V * sin(1 Hz * t)
      R:a { e = 1 Ohm * f + 1 Ohm/A^2 * f^3 }
      R:b { e = 2 Ohm * f + 1 Ohm/A^2 * f^3 }
      C:c = 1 F
      u -> 1:i -> a, b, c
    }";

    const PENDULUM: &str = "model M { I:m = 1 kg  C:c { e = (1 N)*sin(q/(1 m)); q0 = 1 m }  1:v -> m, c }";

    const STOP: &str =
        "model M { I:m = 1 kg  C:c { H = if q > 0 m then 0.5*(1 N/m)*q^2 else 0 J; q0 = 1 m }  1:v -> m, c }";

    /// Three parallel cranks of one coupler, of which two would do.
    const CRANKS: &str = "model M {
      for i in 1..3 {
        C:a[i] { H = 0; q0 = 1 rad }
        MTF:ax[i] = -(0.1 m)*sin(a[i].q)
        MTF:ay[i] = (0.1 m)*cos(a[i].q)
        I:ia[i] = 0.001 kg*m^2
        1:w[i] -> a[i], ia[i], ax[i], ay[i]
        MTF:bx[i] = -(i*0.1 m)*sin(t.q) - (i*i*0.1 m)*cos(t.q)
        MTF:by[i] = (i*0.1 m)*cos(t.q) - (i*i*0.1 m)*sin(t.q)
        wt -> bx[i], by[i]
        ax[i] -> 0:x[i] -> vx
        ay[i] -> 0:y[i] -> vy
        bx[i] -> x[i]
        by[i] -> y[i]
      }
      C:t { H = 0 }
      I:mx = 2 kg
      I:my = 2 kg
      I:it = 0.01 kg*m^2
      1:vx -> mx
      1:vy -> my
      1:wt -> t, it
    }";

    /// For each rule a model that it decides on.
    const DECIDES: [(&str, Accuracy); RULES.len()] = [
        ("model M { Se:u = 1 V * sin((3 Hz * t)^2)  R:r = 1 Ohm  C:c = 1 F  u -> 1:i -> r, c }", Accuracy::Tolerance(1e-6)),
        ("model M { Se:u = if t < 0.5 s then 1 V else 0 V  R:r = 1 Ohm  C:c = 1 F  u -> 1:i -> r, c }", Accuracy::Uncut),
        ("model M { Se:u = 1 V  R:r = 1 Ohm  C:c = 1 F  u -> 1:i -> r, c }", Accuracy::Tolerance(1e-6)),
        (CRANKS, Accuracy::Tolerance(1e-6)),
        (
            "model M { Se:u = 1 V  R:r = 1 Ohm  C:c = 1 F  u -> 1:i -> r, c  probe p = integral(abs(c.e), 0 V*s) }",
            Accuracy::Tolerance(1e-6),
        ),
        (
            "model M { Se:push = 1 N  I:m = 1 kg  R:hole { f = (1 m/(s*N^(1/2)))*sign(e)*sqrt(abs(e)) }
             push -> 1:v -> m, hole }",
            Accuracy::Tolerance(1e-6),
        ),
        (
            "model M { Se:u = 10 V * sin(100 Hz * t)  R:d { e = min(s, 0) * 1 V; f = max(s, 0) * 1 A }  C:c = 1 uF  R:r = 1 kOhm
             u -> 1:i -> d  i -> 0:n -> c, r }",
            Accuracy::Tolerance(1e-4),
        ),
        (
            "model M { Se:u = 4 V * sin(6 kHz * t)  R:series = 2.2 kOhm  C:c = 10 nF  R:d { f = 2.5 nA * (exp(e/(45 mV)) - 1) }
             u -> 1:i -> series  i -> 0:n -> c, d }",
            Accuracy::Tolerance(1e-4),
        ),
        (
            "model M { Se:u = 10 V * sin(100 Hz * t)  C:c = 1 uF  R:r { e = 1 Ohm * f + 1 Ohm * abs(f) }  I:l = 1 H
             u -> 0:n -> c  n -> 1:i -> l, r }",
            Accuracy::Fixed,
        ),
        ("model M { Se:u = 10 V * sin(100 Hz * t)  C:c = 1 uF  u -> c }", Accuracy::Tolerance(1e-4)),
        (LADDER, Accuracy::AsModel),
        (LADDER, Accuracy::Fixed),
        ("model M { state x = 1 { dx = -x^2*1 Hz } }", Accuracy::AsModel),
        (PENDULUM, Accuracy::Tolerance(1e-6)),
        (PENDULUM, Accuracy::Fixed),
        (CHAIN_WITH_KINKS, Accuracy::Tolerance(1e-4)),
        (STOP, Accuracy::Tolerance(1e-4)),
        (
            "model M { C:high { stiffness = 1 Pa/m^3; e0 = 1 Pa }  C:low { stiffness = 1 Pa/m^3 }
             R:hole { f = (0.1 m^3/(s*Pa^(1/2)))*sign(e)*sqrt(abs(e)) }  high -> 1:q -> hole, low }",
            Accuracy::Tolerance(1e-6),
        ),
        (OUTLETS, Accuracy::Tolerance(1e-8)),
        (CHAIN_WITH_KINKS, Accuracy::Tolerance(1e-8)),
        (STOP, Accuracy::Tolerance(1e-6)),
        (LOOP, Accuracy::Tolerance(1e-6)),
        (LOOP, Accuracy::Tolerance(1e-4)),
    ];

    #[test]
    fn every_rule_decides_on_a_model() {
        for (rule, (text, accuracy)) in RULES.iter().zip(DECIDES) {
            let mut sources = Sources::new();
            let id = sources.add("model.bond", text);
            let options = crate::Options { accuracy, ..crate::Options::default() };
            let compiled = match crate::compile(&mut sources, id, &mut NoFiles, &options) {
                Ok(compiled) => compiled,
                Err(errors) => {
                    let errors: Vec<String> = errors.iter().map(|e| e.render(&sources)).collect();
                    panic!("{text}: {}", errors.join("\n"))
                }
            };
            let step = &compiled.scene.clusters[0].step;
            assert_eq!((&*step.name, &*step.why), (rule.take.name(), rule.because), "{text}");
        }
    }
}
