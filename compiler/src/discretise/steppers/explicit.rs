//! Explicit methods, to compare with: Euler's, the classical one of Runge and Kutta, those of Dormand and Prince of
//! order 5 and 8, and the semi-implicit Euler method. Their steps do not keep the balance.

use crate::discretise::cluster::{Cluster, missing, verified};
use crate::discretise::equations::{angle_addition, inputs, ledger, output_equations};
use crate::discretise::steppers::label::{Label, Refusal, Step};
use crate::expression::{Expr, Lowering};
use crate::model::{Model, Variable};
use crate::structure::Form;
use bond_grammar::diagnostic::Diagnostic;
use bond_runtime::ir::{Array, Builder, Slot, Unary, Value};
use bond_runtime::scene::{Branch, Entries, Stepper};

/// A stage: the part of the step that is behind it, the weights of the rates of the stages before it in its state, and
/// the weight of its own in the step.
struct Row {
    at: f64,
    from: &'static [f64],
    weight: f64,
}

/// A method: its stages, and the weights with which their rates estimate the error, where they do: one row, or a second
/// one of lower order beside it.
pub(crate) struct Tableau {
    /// Whether the first stage moves the I storages and the second one, at which they have moved, all else.
    halved: bool,
    rows: &'static [Row],
    error: &'static [&'static [f64]],
    /// The weights of the rates in the state halfway, where the method determines it. Of order 5 they are of order 4
    /// (Hairer, Norsett, Wanner I, II.6); of order 8 the least ones that integrate powers up to the fifth with the
    /// first stage and those from the sixth on: of order 5.
    middle: &'static [f64],
}

/// Explicit Euler.
pub(crate) const EULER: Tableau =
    Tableau { halved: false, rows: &[Row { at: 0.0, from: &[], weight: 1.0 }], error: &[], middle: &[] };

/// The classical method.
pub(crate) const RK4: Tableau = Tableau {
    halved: false,
    rows: &[
        Row { at: 0.0, from: &[], weight: 1.0 / 6.0 },
        Row { at: 0.5, from: &[0.5], weight: 1.0 / 3.0 },
        Row { at: 0.5, from: &[0.0, 0.5], weight: 1.0 / 3.0 },
        Row { at: 1.0, from: &[0.0, 0.0, 1.0], weight: 1.0 / 6.0 },
    ],
    error: &[],
    middle: &[],
};

/// J. R. Dormand, P. J. Prince, J. Comput. Appl. Math. 6 (1980): RK5(4)7M. The last stage is at the end of the step,
/// and only the estimate asks for it.
pub(crate) const RK45: Tableau = Tableau {
    halved: false,
    rows: &[
        Row { at: 0.0, from: &[], weight: 35.0 / 384.0 },
        Row { at: 0.2, from: &[0.2], weight: 0.0 },
        Row { at: 0.3, from: &[3.0 / 40.0, 9.0 / 40.0], weight: 500.0 / 1113.0 },
        Row { at: 0.8, from: &[44.0 / 45.0, -56.0 / 15.0, 32.0 / 9.0], weight: 125.0 / 192.0 },
        Row {
            at: 8.0 / 9.0,
            from: &[19372.0 / 6561.0, -25360.0 / 2187.0, 64448.0 / 6561.0, -212.0 / 729.0],
            weight: -2187.0 / 6784.0,
        },
        Row {
            at: 1.0,
            from: &[9017.0 / 3168.0, -355.0 / 33.0, 46732.0 / 5247.0, 49.0 / 176.0, -5103.0 / 18656.0],
            weight: 11.0 / 84.0,
        },
        Row {
            at: 1.0,
            from: &[35.0 / 384.0, 0.0, 500.0 / 1113.0, 125.0 / 192.0, -2187.0 / 6784.0, 11.0 / 84.0],
            weight: 0.0,
        },
    ],
    error: &[&[71.0 / 57600.0, 0.0, -71.0 / 16695.0, 71.0 / 1920.0, -17253.0 / 339_200.0, 22.0 / 525.0, -1.0 / 40.0]],
    middle: &[
        0.10013431883002397,
        0.0,
        0.3918321794184261,
        -0.029824601765948255,
        0.058932683372407924,
        -0.04497888809104357,
        0.023904308236133986,
    ],
};

/// That of order 8 with estimates of order 5 and 3: E. Hairer, S. P. Norsett, G. Wanner, Solving Ordinary Differential
/// Equations I, 2nd ed. 1993, II.5 and II.10, after P. J. Prince, J. R. Dormand, J. Comput. Appl. Math. 7 (1981).
pub(crate) const DOP853: Tableau = Tableau {
    halved: false,
    rows: &[
        Row { at: 0.0, from: &[], weight: 0.054293734116568765 },
        Row { at: 0.05260015195876773, from: &[0.05260015195876773], weight: 0.0 },
        Row { at: 0.0789002279381516, from: &[0.0197250569845379, 0.0591751709536137], weight: 0.0 },
        Row { at: 0.1183503419072274, from: &[0.02958758547680685, 0.0, 0.08876275643042054], weight: 0.0 },
        Row {
            at: 0.2816496580927726,
            from: &[0.2413651341592667, 0.0, -0.8845494793282861, 0.924834003261792],
            weight: 0.0,
        },
        Row {
            at: 1.0 / 3.0,
            from: &[0.037037037037037035, 0.0, 0.0, 0.17082860872947386, 0.12546768756682242],
            weight: 4.450312892752409,
        },
        Row {
            at: 0.25,
            from: &[0.037109375, 0.0, 0.0, 0.17025221101954405, 0.06021653898045596, -0.017578125],
            weight: 1.8915178993145003,
        },
        Row {
            at: 4.0 / 13.0,
            from: &[
                0.03709200011850479,
                0.0,
                0.0,
                0.17038392571223998,
                0.10726203044637328,
                -0.015319437748624402,
                0.008273789163814023,
            ],
            weight: -5.801203960010585,
        },
        Row {
            at: 127.0 / 195.0,
            from: &[
                0.6241109587160757,
                0.0,
                0.0,
                -3.3608926294469414,
                -0.868219346841726,
                27.59209969944671,
                20.154067550477894,
                -43.48988418106996,
            ],
            weight: 0.3111643669578199,
        },
        Row {
            at: 0.6,
            from: &[
                0.47766253643826434,
                0.0,
                0.0,
                -2.4881146199716677,
                -0.590290826836843,
                21.230051448181193,
                15.279233632882423,
                -33.28821096898486,
                -0.020331201708508627,
            ],
            weight: -0.1521609496625161,
        },
        Row {
            at: 6.0 / 7.0,
            from: &[
                -0.9371424300859873,
                0.0,
                0.0,
                5.186372428844064,
                1.0914373489967295,
                -8.149787010746927,
                -18.52006565999696,
                22.739487099350505,
                2.4936055526796523,
                -3.0467644718982196,
            ],
            weight: 0.20136540080403034,
        },
        Row {
            at: 1.0,
            from: &[
                2.273310147516538,
                0.0,
                0.0,
                -10.53449546673725,
                -2.0008720582248625,
                -17.9589318631188,
                27.94888452941996,
                -2.8589982771350235,
                -8.87285693353063,
                12.360567175794303,
                0.6433927460157636,
            ],
            weight: 0.04471061572777259,
        },
    ],
    error: &[
        &[
            0.01312004499419488,
            0.0,
            0.0,
            0.0,
            0.0,
            -1.2251564463762044,
            -0.4957589496572502,
            1.6643771824549864,
            -0.35032884874997366,
            0.3341791187130175,
            0.08192320648511571,
            -0.022355307863886294,
        ],
        &[
            -0.18980075407240762,
            0.0,
            0.0,
            0.0,
            0.0,
            4.450312892752409,
            1.8915178993145003,
            -5.801203960010585,
            -0.42268232132379197,
            -0.1521609496625161,
            0.20136540080403034,
            0.022651792198360825,
        ],
    ],
    middle: &[
        0.07522964063875176,
        0.0,
        0.0,
        0.0,
        0.0,
        -0.07064413063857938,
        0.38053251549689243,
        0.0458599577505217,
        0.10521952978513266,
        5.6589574122481445e-05,
        -0.04897701277010144,
        0.012722910163259542,
    ],
};

/// The semi-implicit method: the I storages move first. Powers are the means of both stages.
pub(crate) const SYMPLECTIC: Tableau = Tableau {
    halved: true,
    rows: &[Row { at: 0.0, from: &[], weight: 0.5 }, Row { at: 1.0, from: &[1.0], weight: 0.5 }],
    error: &[],
    middle: &[],
};

/// What a stage gives.
struct Stage {
    rates: Vec<Value>,
    integrals: Vec<Value>,
    means: Vec<Value>,
    /// Power of each column of the ledger: sources and ports, then resistors, region by region.
    powers: Vec<Value>,
    loops: Vec<Value>,
}

impl Tableau {
    pub(crate) const fn stages(&self) -> u32 {
        self.rows.len() as u32
    }
}

/// The step of a cluster by a method.
pub(crate) fn step(
    label: Label,
    c: &Cluster,
    model: &mut Model,
    form: &Form,
    method: &Tableau,
) -> Result<Step, Refusal> {
    let (stepper, entries, _) = write(label, c, model, form, method, &[])?;
    Ok((stepper, entries))
}

/// The step with what `switches` kept on one branch; None of a method that looks at the start of its step alone.
pub(crate) fn branch(
    label: Label,
    c: &Cluster,
    model: &mut Model,
    form: &Form,
    method: &Tableau,
    switches: &[(Expr, usize)],
) -> Result<Option<Branch>, Vec<Diagnostic>> {
    if method.rows.len() == 1 {
        return Ok(None);
    }
    let (stepper, _, middle) = write(label, c, model, form, method, switches)?;
    Ok(Some(Branch { program: stepper.program, middle }))
}

/// Writes the step. What `switches` is kept on the branches that inputs behind the traces give; then the state halfway
/// is given, too, from an output on, where the method determines it.
fn write(
    label: Label,
    c: &Cluster,
    model: &mut Model,
    form: &Form,
    method: &Tableau,
    switches: &[(Expr, usize)],
) -> Result<(Stepper, Vec<Entries>, Option<usize>), Vec<Diagnostic>> {
    let &Tableau { halved, rows, error, middle } = method;
    // An I storage integrates an effort and gives a flow.
    let kicked: Vec<bool> =
        c.states.iter().map(|s| s.column.is_some_and(|i| form.column(i).gives == Variable::Flow)).collect();
    let mut b = Builder::new(c.title(form, &format!("{} step", label.name)));
    let entries = c.reserve(model, &mut b, form);
    let inputs = inputs::inputs(&mut b, c, form, model);
    let count = switches.iter().map(|s| s.1 + 1).max().unwrap_or(0);
    let branches: Vec<Slot> = (0..count).map(|k| b.named(Array::Input, format!("branch({k})"))).collect();
    let branches: Vec<Value> = branches.into_iter().map(|slot| b.load(slot)).collect();
    let mut guesses = inputs.guesses.clone();
    let mut stages: Vec<Stage> = Vec::new();
    for row in rows {
        let f = b.number(row.at);
        let ahead = b.mul(f, inputs.h);
        let time = b.add(inputs.t, ahead);
        let mut lowering = Lowering::new(inputs.env.iter().copied());
        switches.iter().for_each(|(e, k)| lowering.branch(*e, branches[*k]));
        if let Some(t) = c.time {
            lowering.bind(t, time);
        }
        for ((_, u, _), (x, slope)) in c.inputs.iter().zip(&inputs.given) {
            let gone = b.mul(ahead, *slope);
            let x = b.add(*x, gone);
            lowering.bind(*u, x);
        }
        for (i, (s, x)) in c.states.iter().zip(&inputs.states).enumerate() {
            if row.from.is_empty() || (halved && !kicked[i]) {
                continue;
            }
            let d = change(&mut b, inputs.h, &stages, row.from, &|s| s.rates[i]);
            let x = b.add(*x, d);
            lowering.bind(s.symbol, x);
        }
        let stage = stage(c, model, form, &mut b, &mut lowering, &guesses)?;
        guesses.clone_from(&stage.loops);
        stages.push(stage);
    }
    let weighted =
        |b: &mut Builder, pick: &dyn Fn(&Stage) -> Value| sum(b, &stages, rows.iter().map(|r| r.weight), pick);
    b.slots(Array::Next, c.slots());
    inputs::no_carry(&mut b, c);
    let mut next = Vec::new();
    let n = c.states.len();
    let pick = |s: &Stage, i: usize| if i < n { s.rates[i] } else { s.integrals[i - n] };
    let weights: Vec<f64> = rows.iter().map(|r| r.weight).collect();
    for (i, x) in inputs.states.iter().chain(&inputs.integrals).enumerate() {
        let weights: &[f64] = match (halved, kicked.get(i)) {
            (false, _) => &weights,
            (true, Some(true)) => &[1.0],
            (true, Some(false) | None) => &[0.0, 1.0],
        };
        let d = change(&mut b, inputs.h, &stages, weights, &|s| pick(s, i));
        let v = b.add(*x, d);
        b.store(Slot::new(Array::Next, i), v);
        next.push(v);
    }
    for (i, z) in guesses.iter().enumerate() {
        b.store(Slot::new(Array::Next, c.states.len() + c.integrals.len() + i), *z);
    }
    for i in 0..c.ports.len() {
        let mean = weighted(&mut b, &|s| s.means[i]);
        b.store(Slot::new(Array::Output, i), mean);
    }
    let mut k = 0;
    for e in &entries {
        let produced = e.produced.iter().flat_map(|p| [p.entropy, p.heat]);
        let lost = e.dissipated.iter().map(|d| d.1).chain(produced).map(|slot| (slot, false));
        let signs = e.supplied.iter().map(|s| (s.1, true)).chain(lost);
        for (slot, supplied) in signs {
            let p = weighted(&mut b, &|s| s.powers[k]);
            let mut w = b.mul(inputs.h, p);
            if supplied {
                w = b.unary(Unary::Neg, w);
            }
            b.store(Slot::new(Array::Output, slot), w);
            k += 1;
        }
    }
    ledger::energies(c, (model, form), &mut b, (&next[..c.states.len()], &[]), &inputs, &entries)?;
    let estimate = (!error.is_empty()).then(|| {
        let integrals = c.integrals.iter().map(|i| model.pool.name(i.symbol).to_string());
        let names = c.states.iter().map(|s| s.name.clone()).chain(integrals);
        let slots: Vec<Slot> = names.map(|n| b.named(Array::Output, format!("error({n})"))).collect();
        for (i, slot) in slots.iter().enumerate() {
            let mut by = error.iter().map(|w| sum(&mut b, &stages, w.iter().copied(), &|s| pick(s, i)));
            let (rate, coarse) = (by.next(), by.next());
            let rate = rate.unwrap_or_else(|| b.number(0.0));
            let mut off = b.mul(inputs.h, rate);
            if let Some(coarse) = coarse {
                off = sharpened(&mut b, off, rate, coarse);
            }
            b.store(*slot, off);
        }
        slots.first().map_or(0, |s| s.index as usize)
    });
    let slots: Vec<Slot> = match switches.is_empty() || middle.is_empty() {
        true => Vec::new(),
        false => (0..n + c.integrals.len()).map(|i| b.named(Array::Output, format!("middle({i})"))).collect(),
    };
    for ((i, slot), x) in slots.iter().enumerate().zip(inputs.states.iter().chain(&inputs.integrals)) {
        let d = change(&mut b, inputs.h, &stages, middle, &|s| pick(s, i));
        let v = b.add(*x, d);
        b.store(*slot, v);
    }
    let middle = slots.first().map(|s| s.index as usize);
    let program = verified(model, b.finish())?;
    Ok((Stepper { estimate, ..label.stepper(program) }, entries, middle))
}

/// An estimate of an error by one of order 5 and one of order 3, each of a rate: what the first says, times how far it
/// is below a tenth of the second, which goes down with the order of the method (Hairer, Norsett, Wanner I, II.10, with
/// the sum of sizes for the root of the sum of squares).
fn sharpened(b: &mut Builder, off: Value, fine: Value, coarse: Value) -> Value {
    let (fine, coarse) = (b.unary(Unary::Abs, fine), b.unary(Unary::Abs, coarse));
    let (tenth, least) = (b.number(0.1), b.number(f64::MIN_POSITIVE));
    let coarse = b.mul(tenth, coarse);
    let both = b.add(fine, coarse);
    let both = b.add(both, least);
    let part = b.div(fine, both);
    b.mul(off, part)
}

/// What something changes by in a time `h`, by its rates at the stages with these weights. The last one is added last,
/// with a weight that `h` was multiplied with before: the next stage waits for it, and for nothing else.
fn change(b: &mut Builder, h: Value, stages: &[Stage], weights: &[f64], pick: &dyn Fn(&Stage) -> Value) -> Value {
    let of = |b: &mut Builder, weights: &[f64]| {
        let rate = sum(b, stages, weights.iter().copied(), pick);
        b.mul(h, rate)
    };
    let last = weights.iter().rposition(|w| *w != 0.0).unwrap_or(0);
    match weights.split_at_checked(last) {
        Some((before, [w, ..])) if before.iter().any(|w| *w != 0.0) => {
            let d = of(b, before);
            let w = b.number(*w);
            let w = b.mul(h, w);
            let end = b.mul(w, pick(&stages[last]));
            b.add(d, end)
        }
        _ => of(b, weights),
    }
}

/// The sum of something of the stages with these weights; nothing is added where a weight is 0.
fn sum(b: &mut Builder, stages: &[Stage], weights: impl Iterator<Item = f64>, pick: &dyn Fn(&Stage) -> Value) -> Value {
    let mut sum = None;
    for (stage, w) in stages.iter().zip(weights).filter(|(_, w)| *w != 0.0) {
        let w = b.number(w);
        let term = b.mul(w, pick(stage));
        sum = Some(match sum {
            Some(s) => b.add(s, term),
            None => term,
        });
    }
    sum.unwrap_or_else(|| b.number(0.0))
}

fn stage(
    c: &Cluster,
    model: &mut Model,
    form: &Form,
    b: &mut Builder,
    lowering: &mut Lowering,
    guesses: &[Value],
) -> Result<Stage, Vec<Diagnostic>> {
    let flat = output_equations::outputs(
        c,
        model,
        form,
        b,
        lowering,
        (
            guesses,
            output_equations::Pull { curves: c.thresholds.regular.pull, switches: output_equations::Switched::Free },
        ),
        None,
    )?;
    let symbols = c.states.iter().map(|s| s.symbol).collect();
    angle_addition::angles(model, b, lowering, &c.energies(), &symbols)?;
    let mut lower = |model: &mut Model, b: &mut Builder, e| {
        let e = model.pool.substitute(e, &flat);
        lowering.lower(&model.pool, b, e).map_err(|s| missing(model, s))
    };
    let mut rates = Vec::new();
    for s in &c.states {
        rates.push(lower(model, b, s.rate)?);
    }
    let mut integrals = Vec::new();
    for i in &c.integrals {
        integrals.push(lower(model, b, i.rate)?);
    }
    let mut means = Vec::new();
    for p in &c.ports {
        let e = form.input(&mut model.pool, *p);
        means.push(lower(model, b, e)?);
    }
    let mut powers = Vec::new();
    for accounts in c.accounts(model, form) {
        let power = accounts.supplied.into_iter().map(|c| vec![c]).chain(accounts.dissipated);
        for columns in power {
            let mut sum = None;
            for column in columns {
                let (z, i) = (model.pool.var(form.column(column).out), form.input(&mut model.pool, column));
                let (z, i) = (lower(model, b, z)?, lower(model, b, i)?);
                let p = b.mul(z, i);
                sum = Some(sum.map_or(p, |s| b.add(s, p)));
            }
            powers.push(sum.unwrap_or_else(|| b.number(0.0)));
        }
        for columns in accounts.produced {
            let mut sum = b.number(0.0);
            for column in &columns {
                let s = ledger::variable(model, form, *column, Variable::Flow);
                let s = lower(model, b, s)?;
                sum = b.sub(sum, s);
            }
            let temperature = ledger::variable(model, form, columns[0], Variable::Effort);
            let temperature = lower(model, b, temperature)?;
            powers.extend([sum, b.mul(sum, temperature)]);
        }
    }
    let mut loops = Vec::new();
    for z in &c.loops {
        let z = model.pool.var(*z);
        loops.push(lower(model, b, z)?);
    }
    Ok(Stage { rates, integrals, means, powers, loops })
}

#[cfg(test)]
mod tests {
    use super::{DOP853, RK45, Tableau};

    /// How far the state halfway is off after a step of y' = y^2 from 1, whose solution is 1 / (1 - t).
    fn off(method: &Tableau, h: f64) -> f64 {
        let mut rates: Vec<f64> = Vec::new();
        let after = |rates: &[f64], w: &[f64]| 1.0 + h * w.iter().zip(rates).map(|(w, r)| w * r).sum::<f64>();
        for row in method.rows {
            let y = after(&rates, row.from);
            rates.push(y * y);
        }
        (after(&rates, method.middle) - 1.0 / (1.0 - 0.5 * h)).abs()
    }

    #[test]
    fn states_halfway_have_their_orders() {
        for (name, method, order, h) in [("rk45", &RK45, 4.0, 0.02), ("dop853", &DOP853, 5.0, 0.1)] {
            let found = (off(method, h) / off(method, 0.5 * h)).log2() - 1.0;
            assert!(found > order - 0.3, "{name}: order {found}");
        }
    }
}
