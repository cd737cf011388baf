//! Two-ports by a matrix, `TF(a[1..3], b[1..2]):arm { matrix = J }`, taken apart into two-ports of one ratio each.
//!
//! Of a transformer, f_b = J f_a and e_a = J^T e_b: each entry of `a` is a 1-junction, each of `b` a 0-junction, and
//! between them stands a transformer for each entry of the matrix. Of a gyrator, e_b = R f_a and e_a = R^T f_b, both
//! sides are 1-junctions. A gyrator on one bundle, e = S f with S skew, has 1-junctions with a gyrator between each
//! two of them. So no power is made or lost, whatever the entries do, and all that comes later knows no matrices.
//! (Breedveld 1985, "Multibond graph elements in physical systems theory".)

use super::{Decl, Elaborator, Entity, Instance, RawBond, RawEnd, ScopeId, Typed};
use crate::model::{ElementId, Kind};
use bond_grammar::ast::{self, ExprKind, Unary};
use bond_grammar::diagnostic::Diagnostic;
use std::rc::Rc;

/// A two-port by a matrix.
pub(crate) struct MatrixTwoPort<'a> {
    pub(crate) name: String,
    pub(crate) ast: &'a ast::Element,
    /// The scope that it is declared in.
    pub(crate) scope: ScopeId,
    sampling: Option<usize>,
    /// The instance that its ports are of.
    instance: usize,
    /// The ports of each bundle, of one or two.
    sides: Vec<Vec<usize>>,
    /// Its matrix once that is made; nothing within where it is wrong, which is said.
    pub(crate) rows: Option<Option<Rc<Vec<Vec<Typed>>>>>,
}

impl MatrixTwoPort<'_> {
    /// Its rows and columns.
    pub(crate) fn size(&self) -> (usize, usize) {
        let side = |i: usize| self.sides.get(i).map_or(0, Vec::len);
        if self.is_skew() { (side(0), side(0)) } else { (side(1), side(0)) }
    }

    /// Whether it is a gyrator on one bundle.
    pub(crate) fn is_skew(&self) -> bool {
        self.sides.len() == 1
    }

    fn is_gyrator(&self) -> bool {
        self.ast.kind.text.ends_with("GY")
    }
}

impl<'a> Elaborator<'a> {
    /// Declares a two-port by a matrix with its ports. What is in it is made once all names of the model are known.
    pub(super) fn matrix_two_port(
        &mut self,
        e: &'a ast::Element,
        key: String,
        name: String,
        scope: ScopeId,
        sampling: Option<usize>,
    ) {
        let kind = e.kind.text.as_str();
        let gyrator = kind.ends_with("GY");
        let example = match gyrator {
            true => "`GY(a[1..3], b[1..3]):g { matrix = ... }`, or `GY(w[1..3]):g { matrix = ... }` with a skew matrix",
            false => "`TF(a[1..3], b[1..2]):arm { matrix = ... }`",
        };
        let wrong = match &e.ports[..] {
            _ if e.active => Some((e.span, format!("`{name}` cannot be active: only an `R` and a source can"))),
            _ if !e.args.is_empty() => Some((e.span, format!("`{name}` takes no arguments in parentheses"))),
            [_] if gyrator => None,
            [a, b] if a.name.text != b.name.text => None,
            [_, b] => Some((b.name.span, format!("`{name}` has two bundles `{}`", b.name.text))),
            _ => Some((e.kind.span, format!("`{name}` (a `{kind}`) has {} bundles", e.ports.len()))),
        };
        let own_kind = e.ports.iter().find_map(|p| p.kind.as_ref());
        let own_kind = own_kind.map(|k| (k.span, format!("a bundle of `{name}` has a kind of its own")));
        if let Some((span, message)) = wrong.or(own_kind) {
            self.errors.push(
                Diagnostic::error("elaborate::two_port", span, message).help(format!("such a two-port is {example}")),
            );
            self.declare(scope, key, Entity::Missing, e.name.span);
            return;
        }
        let mut ranges = Vec::new();
        for p in &e.ports {
            match self.range(&p.name.text, &p.index, scope) {
                Some(Some(range)) if p.index.len() == 1 => ranges.push(range),
                Some(_) => {
                    let message = format!("the port `{}` of `{name}` is no bundle", p.name.text);
                    let help = format!("give it its range, as in {example}");
                    self.errors.push(Diagnostic::error("elaborate::two_port", p.name.span, message).help(help));
                }
                None => {}
            }
        }
        let sizes = ranges.iter().map(super::bundle::Range::size);
        // A matrix on one bundle is square.
        let cells = sizes.clone().product::<usize>() * if e.ports.len() == 1 { sizes.product() } else { 1 };
        if cells > self.limits.entries {
            let message = format!("the matrix of `{name}` has {cells} entries, and may have {}", self.limits.entries);
            self.wrong::<()>("elaborate::limit", e.span, message, "use smaller bundles");
            ranges.clear();
        }
        let instance = self.instances.len();
        let entity = if ranges.len() == e.ports.len() { Entity::Instance(instance) } else { Entity::Missing };
        if !self.declare(scope, key, entity, e.name.span) || ranges.len() != e.ports.len() {
            return;
        }
        let outer = self.scopes[scope].instance;
        let inner = self.new_scope(instance, None, None);
        let span = e.kind.span.to(e.name.span);
        let mut made = Instance::new(self.instances[outer].model, name.clone(), inner, outer, span);
        made.kind = Some(kind);
        self.instances.push(made);
        let mut sides = Vec::new();
        for (range, p) in ranges.iter().zip(&e.ports) {
            self.declare_bundle(inner, range, p.name.span);
            sides.push(range.keys().filter_map(|key| self.inner_port(inner, key, p.name.span)).collect());
        }
        self.two_ports.push(MatrixTwoPort { name, ast: e, scope, sampling, instance, sides, rows: None });
    }

    /// Makes what is in the two-ports by matrices from one of them on, if they stand in this instance.
    pub(super) fn expand_two_ports(&mut self, instance: usize, from: usize) {
        for i in from..self.two_ports.len() {
            if self.scopes[self.two_ports[i].scope].instance == instance {
                self.expand_two_port(i);
            }
        }
    }

    fn expand_two_port(&mut self, which: usize) {
        let it = &self.two_ports[which];
        let (rows, columns) = it.size();
        let (skew, gyrator, scope, inner) = (it.is_skew(), it.is_gyrator(), it.scope, it.instance);
        let (ast, sides) = (it.ast, it.sides.clone());
        let value = ast.value.as_ref().or_else(|| {
            let fields = ast.fields.iter().flat_map(|f| &f.0);
            fields.clone().find(|f| f.name() == "matrix").map(|f| &f.value)
        });
        let zeros = value.and_then(|value| self.zeros(value, scope, 0));
        let zeros = zeros.filter(|z| z.len() == rows && z.iter().all(|row| row.len() == columns));
        let is_zero = |row: usize, column: usize| zeros.as_ref().is_some_and(|z| z[row][column]);
        let inner_scope = self.instances[inner].scope;
        let mut junctions: Vec<Vec<ElementId>> = Vec::new();
        for (side, ports) in sides.iter().enumerate() {
            let kind = if side == 1 && !gyrator { Kind::ZERO } else { Kind::ONE };
            let list = ports.iter().map(|&port| {
                let junction = self.inner_element(which, self.ports[port].name.clone(), kind, None, inner_scope);
                let (outside, own) = (RawEnd::Port(port, true), RawEnd::Element(junction));
                match side {
                    0 => self.inner_bond(which, outside, own),
                    _ => self.inner_bond(which, own, outside),
                }
                junction
            });
            junctions.push(list.collect());
        }
        let kind = if gyrator { Kind::GY } else { Kind::TF };
        for row in 0..rows {
            for column in 0..columns {
                // Of a skew matrix each two entries are one gyrator, that of the upper one.
                let (none, tail, head) = match skew {
                    true => {
                        let none = column <= row || is_zero(row, column) && is_zero(column, row);
                        (none, junctions[0][row], junctions[0][column])
                    }
                    false => (is_zero(row, column), junctions[0][column], junctions[1][row]),
                };
                if none || self.too_big(ast.span) {
                    continue;
                }
                let cell = self.new_scope(self.scopes[scope].instance, Some(scope), None);
                self.scopes[cell].cell = Some((which, row, column));
                let name = format!("{}[{},{}]", self.two_ports[which].name, row + 1, column + 1);
                let middle = self.inner_element(which, name, kind, Some(ast), cell);
                self.inner_bond(which, RawEnd::Element(tail), RawEnd::Element(middle));
                self.inner_bond(which, RawEnd::Element(middle), RawEnd::Element(head));
            }
        }
    }

    fn inner_element(
        &mut self,
        which: usize,
        name: String,
        kind: Kind,
        ast: Option<&'a ast::Element>,
        scope: ScopeId,
    ) -> ElementId {
        let it = &self.two_ports[which];
        let (sampling, span) = (it.sampling, it.ast.kind.span.to(it.ast.name.span));
        let id = ElementId(self.elements.len() as u32);
        self.elements.push(Decl { name, kind, ast, scope, sampling, span, field: None });
        id
    }

    fn inner_bond(&mut self, which: usize, tail: RawEnd, head: RawEnd) {
        let (index, span) = (self.raw_bonds.len(), self.two_ports[which].ast.name.span);
        for (end, out) in [(tail, true), (head, false)] {
            if let RawEnd::Port(p, _) = end {
                self.ports[p].inside.push((index, out));
            }
        }
        let word = |this: &Self, end: RawEnd| match end {
            RawEnd::Element(id) => this.elements[id.at()].name.clone(),
            RawEnd::Port(p, _) => this.ports[p].name.clone(),
        };
        let name = format!("{} -> {}", word(self, tail), word(self, head));
        self.raw_bonds.push(RawBond { tail, head, sampled: false, resolution: None, stroke: None, name, span });
    }

    /// Which entries of a matrix are written as the literal 0, where its rows are written out: in its place, or where
    /// the name or the function is declared that stands there.
    fn zeros(&self, e: &'a ast::Expr, scope: ScopeId, depth: usize) -> Option<Vec<Vec<bool>>> {
        if depth > self.limits.nesting {
            return None;
        }
        match &e.kind {
            ExprKind::Paren(inner) | ExprKind::Unary(Unary::Neg, inner) => self.zeros(inner, scope, depth + 1),
            ExprKind::List(rows) => rows.iter().map(zeros_of_row).collect(),
            ExprKind::Path(path) => {
                let [name] = &path.segments[..] else { return None };
                if !name.index.is_empty() {
                    return None;
                }
                let (value, scope) = self.written(&name.name.text, scope)?;
                self.zeros(value, scope, depth + 1)
            }
            ExprKind::Call(name, args) => match (self.function(&name.text, scope), &args[..]) {
                (Some(f), _) => {
                    let value = self.functions.value(f)?;
                    // A name in it may be an argument, which is not known here.
                    let mut value = value;
                    while let ExprKind::Paren(inner) | ExprKind::Unary(Unary::Neg, inner) = &value.kind {
                        value = inner;
                    }
                    match &value.kind {
                        ExprKind::List(rows) => rows.iter().map(zeros_of_row).collect(),
                        ExprKind::Number { .. }
                        | ExprKind::Bool(_)
                        | ExprKind::Path(_)
                        | ExprKind::Unary(..)
                        | ExprKind::Binary(..)
                        | ExprKind::If(..)
                        | ExprKind::Call(..)
                        | ExprKind::Range(..)
                        | ExprKind::Paren(_) => None,
                    }
                }
                (None, [inner]) if name.text == "transpose" => {
                    let rows = self.zeros(inner, scope, depth + 1)?;
                    let width = rows.first().map_or(0, Vec::len);
                    let column = |j: usize| rows.iter().map(|row| row.get(j).copied()).collect::<Option<Vec<bool>>>();
                    (0..width).map(column).collect()
                }
                (None, _) => None,
            },
            ExprKind::Number { .. }
            | ExprKind::Bool(_)
            | ExprKind::Unary(Unary::Not, _)
            | ExprKind::Binary(..)
            | ExprKind::If(..)
            | ExprKind::Range(..) => None,
        }
    }

    /// What a name is declared to be, as it is written, and the scope that it is written in.
    fn written(&self, name: &str, scope: ScopeId) -> Option<(&'a ast::Expr, ScopeId)> {
        let mut at = Some(scope);
        let mut found = None;
        while let (Some(s), None) = (at, found) {
            found = self.scopes[s].locals.get(name).map(|local| local.0);
            at = self.scopes[s].parent;
        }
        let names = &self.instances[self.scopes[scope].instance].names;
        match found.or_else(|| names.get(name).map(|known| known.0))? {
            Entity::Let(l) => self.lets.get(l).map(|l| (l.value, l.scope)),
            Entity::Param(p) => self.params.get(p)?.value,
            Entity::Element(_)
            | Entity::Instance(_)
            | Entity::Port(_)
            | Entity::Function(_)
            | Entity::Bond(_)
            | Entity::Input(_)
            | Entity::Memory(_)
            | Entity::Field(_)
            | Entity::Bundle(_)
            | Entity::Missing => None,
        }
    }

    /// Looks at all matrices, also at those that have no entry but 0.
    pub(super) fn check_two_ports(&mut self) {
        for i in 0..self.two_ports.len() {
            self.matrix_of(i);
        }
    }

    /// The matrix of a two-port by its rows. What is wrong with it is said once.
    pub(crate) fn matrix_of(&mut self, which: usize) -> Option<Rc<Vec<Vec<Typed>>>> {
        let it = &self.two_ports[which];
        if let Some(made) = &it.rows {
            return made.clone();
        }
        let sampling = std::mem::replace(&mut self.sampling, it.sampling);
        let made = self.make_matrix(which).map(Rc::new);
        self.sampling = sampling;
        self.two_ports[which].rows = Some(made.clone());
        made
    }

    /// Which entry of which matrix the ratio in a scope is.
    pub(crate) fn cell(&self, scope: ScopeId) -> Option<(usize, usize, usize)> {
        self.scopes[scope].cell
    }
}

/// Which entries of a written row are the literal 0.
fn zeros_of_row(row: &ast::Expr) -> Option<Vec<bool>> {
    match &row.kind {
        ExprKind::Paren(inner) => zeros_of_row(inner),
        ExprKind::List(entries) => Some(entries.iter().map(is_zero).collect()),
        ExprKind::Number { .. }
        | ExprKind::Bool(_)
        | ExprKind::Path(_)
        | ExprKind::Unary(..)
        | ExprKind::Binary(..)
        | ExprKind::If(..)
        | ExprKind::Call(..)
        | ExprKind::Range(..) => None,
    }
}

/// Whether an expression is the literal 0, with or without a unit.
fn is_zero(e: &ast::Expr) -> bool {
    match &e.kind {
        ExprKind::Number { digits, .. } => digits.parse::<f64>() == Ok(0.0),
        ExprKind::Paren(inner) | ExprKind::Unary(Unary::Neg, inner) => is_zero(inner),
        ExprKind::Bool(_)
        | ExprKind::Path(_)
        | ExprKind::Unary(Unary::Not, _)
        | ExprKind::Binary(..)
        | ExprKind::If(..)
        | ExprKind::Call(..)
        | ExprKind::List(_)
        | ExprKind::Range(..) => false,
    }
}
