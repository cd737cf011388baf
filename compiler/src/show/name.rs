//! What things are called in print: elements, bonds, variables, numbers, units.

use super::Shown;
use super::modulation::is_modulated;
use crate::expression::{Expr, Pool};
use crate::model::{Bond, BondId, Element, ElementId, Kind, Law, Model, OnePort, Signal, TwoPort, Variable};
use crate::structure::{ColumnId, Form, Role};
use crate::units::{self, DisplayUnit};
use bond_grammar::ast::Stroke;
use rustc_hash::FxHashMap;

/// An expression with more nodes than this, when written out, is not written out.
const LONGEST: u64 = 1_000_000;

/// The kind as it is written in the language, with an `M` where signals drive it.
pub(super) fn kind(model: &Model, e: &Element) -> String {
    let plain = plain_kind(e.kind);
    if is_modulated(model, e) { format!("M{plain}") } else { plain.to_string() }
}

/// The kind, whether or not signals drive it.
fn plain_kind(kind: Kind) -> &'static str {
    match kind {
        Kind::OnePort(one_port) => match one_port {
            OnePort::Source(Variable::Effort) => "Se",
            OnePort::Source(Variable::Flow) => "Sf",
            OnePort::Detector(Variable::Effort) => "De",
            OnePort::Detector(Variable::Flow) => "Df",
            OnePort::Storage(Variable::Effort) => "C",
            OnePort::Storage(Variable::Flow) => "I",
            OnePort::Resistor => "R",
            OnePort::Open => "port",
            OnePort::Multiplier(_) => "multiplier",
        },
        Kind::TwoPort(TwoPort::Transformer) => "TF",
        Kind::TwoPort(TwoPort::Gyrator) => "GY",
        Kind::Junction(Variable::Effort) => "0",
        Kind::Junction(Variable::Flow) => "1",
    }
}

/// `I:mass`
pub(super) fn element(model: &Model, e: &Element) -> String {
    match e.kind {
        Kind::PORT => format!("port {}", e.name),
        _ => format!("{}{}:{}", if e.active { "active " } else { "" }, kind(model, e), e.name),
    }
}

/// The arrow of a bond, with its name where it has one, and its stroke where that is to be shown.
pub(super) fn arrow(model: &Model, bond: &Bond, stroke: Option<Stroke>) -> String {
    let name = own_name(model, bond).map(|n| format!("[{n}]")).unwrap_or_default();
    let (tail, head) = match (stroke, bond.sampled) {
        (Some(Stroke::Head), false) => ("", "|"),
        (Some(Stroke::Head), true) => ("", " |"),
        (Some(Stroke::Tail), false) => ("|", ""),
        // A double bar with a stroke can't be written in the language.
        (Some(Stroke::Tail), true) => ("| ", ""),
        (None, _) => ("", ""),
    };
    match (bond.sampled, name.is_empty()) {
        (true, _) => format!("{tail}||{name}>{head}"),
        (false, true) => format!("{tail}->{head}"),
        (false, false) => format!("{tail}-{name}->{head}"),
    }
}

/// The name that the user gave a bond.
pub(super) fn own_name<'m>(model: &Model, bond: &'m Bond) -> Option<&'m str> {
    let made = format!("{} -> {}", model.element(bond.tail).name, model.element(bond.head).name);
    // Bonds are called after their ends, as these are written; such names have an arrow in them.
    (bond.name != made && !bond.name.contains('>')).then_some(&bond.name)
}

/// Where a bond ends as the model has it.
pub(super) fn head<'m>(model: &'m Model, b: &Bond) -> &'m Element {
    model.element(head_id(model, b))
}

/// The same, as an id.
pub(super) fn head_id(model: &Model, b: &Bond) -> ElementId {
    if !model.element(b.head).added {
        return b.head;
    }
    let goes_on = |o: &&Bond| o.tail == b.head && !model.element(o.head).added;
    model.bonds.iter().rfind(goes_on).map_or(b.head, |o| o.head)
}

/// `hand -> v`
pub(super) fn bond(model: &Model, id: BondId, stroke: Option<Stroke>) -> String {
    let b = model.bond(id);
    format!("{} {} {}", model.element(b.tail).name, arrow(model, b, stroke), head(model, b).name)
}

/// The flow or effort unit of a bond.
pub(super) fn bond_unit(model: &Model, bond: BondId, variable: Variable) -> Option<&DisplayUnit> {
    let (e, f) = model.units.get(bond.at())?;
    match variable {
        Variable::Effort => e.as_ref(),
        Variable::Flow => f.as_ref(),
    }
}

/// A unit; empty where it is not known or none.
pub(super) fn unit(unit: Option<&DisplayUnit>) -> String {
    unit.filter(|u| !u.is_one()).map(|u| u.to_string()).unwrap_or_default()
}

/// A unit where one is always said.
pub(super) fn in_prose(unit: &DisplayUnit) -> String {
    units::in_prose(&unit.to_string()).to_string()
}

/// A number as short as it reads back.
pub(super) fn number(x: f64) -> String {
    if x == 0.0 || (1e-4..1e7).contains(&x.abs()) { format!("{x}") } else { format!("{x:e}") }
}

/// A number with its unit.
pub(super) fn quantity(x: f64, u: Option<&DisplayUnit>) -> String {
    format!("{} {}", number(x), unit(u)).trim_end().to_string()
}

/// How many nodes an expression has when written out.
fn size(pool: &Pool, e: Expr) -> u64 {
    let mut sizes: FxHashMap<Expr, u64> = FxHashMap::default();
    let mut stack = vec![e];
    while let Some(&at) = stack.last() {
        let mut sum = 1u64;
        let mut missing = false;
        pool.node(at).each_child(&mut |c| match sizes.get(&c) {
            Some(n) => sum = sum.saturating_add(*n),
            None => {
                missing = true;
                stack.push(c);
            }
        });
        if !missing {
            sizes.insert(at, sum);
            stack.pop();
        }
    }
    sizes.get(&e).copied().unwrap_or(1)
}

/// An expression as text of the language, unless it is too long to be read.
pub(super) fn expression(pool: &Pool, e: Expr) -> String {
    match size(pool, e) {
        n if n > LONGEST => format!("(an expression of {n} terms)"),
        _ => pool.print(e),
    }
}

/// An expression as a formula, unless it is too long to be read.
pub(super) fn formula(pool: &Pool, e: Expr) -> String {
    match size(pool, e) {
        n if n > LONGEST => r"\ldots".into(),
        _ => pool.latex(e),
    }
}

/// What each column is called: by its element, or by its bond where two of a region would share that name.
pub(super) fn columns(model: &Model, form: &Form) -> Vec<String> {
    let mut count: FxHashMap<(u32, &str), usize> = FxHashMap::default();
    for c in &form.columns {
        *count.entry((c.region.0, &c.name)).or_default() += 1;
    }
    let name = |c: &crate::structure::Column| {
        if count.get(&(c.region.0, c.name.as_str())).is_some_and(|n| *n > 1) && c.role == Role::Bar {
            model.bond(c.bond).name.replace(' ', "")
        } else {
            c.name.clone()
        }
    };
    form.columns.iter().map(name).collect()
}

/// An input of a region and its conjugate output, as signals of their bond, so that their product is the power
/// supplied.
pub(super) struct Port {
    /// `hand.e`
    pub(super) input: String,
    /// `hand.f`, or `-hand.f` where the half arrow points at the source.
    pub(super) output: String,
    /// Whether the input is the negative of what the column gives.
    pub(super) turned: bool,
}

/// The port that a column is, from inside the region.
pub(super) fn port(form: &Form, names: &[String], id: ColumnId) -> Port {
    let c = form.column(id);
    let name = &names[id.at()];
    let (give, take) = (c.gives.letter(), c.gives.other().letter());
    let outward = c.sign < 0 && c.role != Role::Resistor;
    Port {
        input: format!("{name}.{give}"),
        output: format!("{}{name}.{take}", if outward { "" } else { "-" }),
        turned: outward && c.sign_of(c.gives) < 0,
    }
}

/// Several expressions, as `a, b`.
pub(super) fn expressions(pool: &Pool, all: &[Expr]) -> String {
    all.iter().map(|e| expression(pool, *e)).collect::<Vec<_>>().join(", ")
}

/// The law of a resistor in its own variables: `damper.e = b*damper.f`, and what is right of the sign. Of a curve,
/// both.
pub(super) fn resistor(model: &mut Model, id: ElementId) -> Option<(String, Vec<Expr>)> {
    let e = model.element(id);
    let Law::Resistor(r) = e.law.clone() else { return None };
    if let Some(curve) = r.curve {
        return Some((format!("{0}.e, {0}.f", e.name), vec![curve.effort, curve.flow]));
    }
    let left = format!("{}.{}", e.name, r.gives.letter());
    let mut map: FxHashMap<_, _> = FxHashMap::default();
    for s in model.pool.symbols(r.output) {
        let Some(Signal::Argument(id)) = model.signals.get(&s) else { continue };
        let Law::Resistor(other) = &model.element(*id).law else { continue };
        let name = format!("{}.{}", model.element(*id).name, other.gives.other().letter());
        let x = model.pool.symbol(&name);
        map.insert(s, model.pool.var(x));
    }
    Some((left, vec![model.pool.substitute(r.output, &map)]))
}

/// The law of an element, in a few words.
pub(super) fn law(shown: &Shown<'_>, id: ElementId) -> String {
    let e = shown.model.element(id);
    let pool = &shown.model.pool;
    let text = |x: Expr| expression(pool, x);
    match &e.law {
        Law::Source(_) if e.kind.is_detector() => String::new(),
        Law::Source(v) => format!("{} = {}", if e.kind == Kind::SE { "e" } else { "f" }, text(*v)),
        Law::Storage(s) => format!("H = {}", text(s.energy)),
        Law::Resistor(r) => {
            if let Some(curve) = r.curve {
                return format!("e = {}, f = {}", text(curve.effort), text(curve.flow));
            }
            let argument = r.gives.other().letter();
            match r.linear {
                Some(k) => {
                    let factor = text(k);
                    let factor = if factor.contains([' ', '/']) { format!("({factor})") } else { factor };
                    format!("{} = {factor}*{argument}", r.gives.letter())
                }
                None => {
                    // The argument is a symbol named after the element: here it is called as it is in the law.
                    let mut own = pool.clone();
                    let x = own.symbol(&argument.to_string());
                    let x = own.var(x);
                    let map: FxHashMap<_, _> = std::iter::once((r.argument, x)).collect();
                    let output = own.substitute(r.output, &map);
                    format!("{} = {}", r.gives.letter(), expression(&own, output))
                }
            }
        }
        Law::Ratio(v) if e.kind == Kind::TF => format!("e_in = ({0})*e_out, f_out = ({0})*f_in", text(*v)),
        Law::Ratio(v) => format!("e_in = ({0})*f_out, e_out = ({0})*f_in", text(*v)),
        Law::Junction | Law::Multiplier => String::new(),
        Law::Port(None) => "open".into(),
        Law::Port(Some(x)) => format!("open, inertia at least {}", number(*x)),
    }
}
