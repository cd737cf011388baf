//! Arithmetic of arrays and small matrices. All of it is done here, number by number: what runs knows no arrays.

use super::{Elaborator, ScopeId, Typed, Unit, Value};
use bond_grammar::ast::{self, Binary};
use bond_grammar::diagnostic::Diagnostic;
use bond_grammar::source::Span;

/// An operand: its value, and what was written.
pub(super) type Operand<'e> = (Value, &'e ast::Expr);

impl<'a> Elaborator<'a> {
    /// `[a, b]`: all of one shape, each with a unit of its own.
    pub(super) fn list(&mut self, items: &'a [ast::Expr], span: Span, scope: ScopeId) -> Option<Value> {
        let all: Vec<Option<Value>> = items.iter().map(|e| self.value(e, scope)).collect();
        let all: Vec<Value> = all.into_iter().collect::<Option<_>>()?;
        let Some(first) = all.first() else {
            return self.shape_error(span, "this array is empty".into(), "an array has one entry or more");
        };
        if let Some(i) = all.iter().position(|v| v.shape() != first.shape()) {
            let message =
                format!("this entry is {}, and the first entry of the array is {}", all[i].words(), first.words());
            let error = Diagnostic::error("elaborate::shape", items[i].span, message);
            self.errors.push(
                error.label(items[0].span, "is the first entry").help("all entries of an array have the same shape"),
            );
            return None;
        }
        self.few(all.len() * first.shape().iter().product::<usize>(), span)?;
        Some(Value::List(all))
    }

    /// Says where an array has too many numbers.
    fn few(&mut self, count: usize, span: Span) -> Option<()> {
        let most = self.limits.entries;
        if count <= most {
            return Some(());
        }
        let message = format!("this array has {count} numbers, and may have {most}");
        self.errors.push(Diagnostic::error("elaborate::limit", span, message).help("use fewer entries"));
        None
    }

    pub(super) fn shape_error<T>(&mut self, span: Span, message: String, help: &str) -> Option<T> {
        self.errors.push(Diagnostic::error("elaborate::shape", span, message).help(help));
        None
    }

    /// Two values that must have one shape; says so where they have not.
    pub(super) fn same_shape(
        &mut self,
        what: &str,
        (x, a): (&Value, &ast::Expr),
        (y, b): (&Value, &ast::Expr),
    ) -> bool {
        if x.shape() == y.shape() {
            return true;
        }
        let message = format!("{what}: `{}` is {}, and `{}` is {}", self.words(a), x.words(), self.words(b), y.words());
        let error = Diagnostic::error("elaborate::shape", b.span, message).label(a.span, format!("is {}", x.words()));
        self.errors.push(error.help("both must have the same shape"));
        false
    }

    /// An operation of which at least one side is an array.
    pub(super) fn array_operation(&mut self, op: Binary, (x, a): Operand<'_>, (y, b): Operand<'_>) -> Option<Value> {
        match op {
            Binary::Add | Binary::Sub => {
                let what =
                    if op == Binary::Add { "a sum of different shapes" } else { "a difference of different shapes" };
                if !self.same_shape(what, (&x, a), (&y, b)) {
                    return None;
                }
                x.zip(y, &mut |p, q| self.scalar_operation(op, (p, a), (q, b)))
            }
            Binary::Mul => match (x, y) {
                (Value::Scalar(p), y) => y.map(&mut |q| self.scalar_operation(op, (p.clone(), a), (q, b))),
                (x, Value::Scalar(q)) => x.map(&mut |p| self.scalar_operation(op, (p, a), (q.clone(), b))),
                (x, y) => self.matrix_product((x, a), (y, b)),
            },
            Binary::Div => match (x, y) {
                (x, Value::Scalar(q)) => x.map(&mut |p| self.scalar_operation(op, (p, a), (q.clone(), b))),
                (_, y) => {
                    let message = format!("`{}` is {}, and nothing is divided by an array", self.words(b), y.words());
                    self.shape_error(b.span, message, "divide by its entries one by one")
                }
            },
            Binary::Pow
            | Binary::Lt
            | Binary::Le
            | Binary::Gt
            | Binary::Ge
            | Binary::Eq
            | Binary::Ne
            | Binary::And
            | Binary::Or => {
                let (x, y) = (self.scalar(x, a), self.scalar(y, b));
                x.zip(y).and(None)
            }
        }
    }

    fn matrix_product(&mut self, (x, a): Operand<'_>, (y, b): Operand<'_>) -> Option<Value> {
        let (rows, inner) = match x.shape()[..] {
            [_, n] => (self.rows(x, a)?, n),
            [_] if y.shape().len() == 2 => {
                let help = "a row from the left is `transpose(m)*a`";
                return self.shape_error(
                    a.span,
                    format!("`{}` is {}, and stands left of a matrix", self.words(a), x.words()),
                    help,
                );
            }
            _ => {
                let message = format!(
                    "`{}` is {}, and `{}` is {}: `*` does not multiply these",
                    self.words(a),
                    x.words(),
                    self.words(b),
                    y.words()
                );
                return self.shape_error(a.span.to(b.span), message, "the scalar product of two arrays is `dot(a, b)`");
            }
        };
        if y.shape().first() != Some(&inner) || y.shape().len() > 2 {
            let message = format!("`{}` has {inner} columns, and `{}` is {}", self.words(a), self.words(b), y.words());
            return self.shape_error(b.span, message, "the right side needs as many rows as the left one has columns");
        }
        let about = format!("a term of the product with `{}`", self.words(b));
        let Value::List(items) = y else { return None };
        if let Some(Value::Scalar(_)) = items.first() {
            let column: Vec<Typed> = items.into_iter().filter_map(Value::into_scalar).collect();
            let all = rows.iter().map(|row| Value::Scalar(self.dot_of(row, &column, b.span, &about)));
            return Some(Value::List(all.collect()));
        }
        let right = self.rows(Value::List(items), b)?;
        let width = right.first().map_or(0, Vec::len);
        self.few(rows.len() * width, a.span.to(b.span))?;
        let columns: Vec<Vec<Typed>> =
            (0..width).map(|j| right.iter().filter_map(|row| row.get(j).cloned()).collect()).collect();
        let row = |this: &mut Self, row: &Vec<Typed>| {
            Value::List(columns.iter().map(|c| Value::Scalar(this.dot_of(row, c, b.span, &about))).collect())
        };
        Some(Value::List(rows.iter().map(|r| row(self, r)).collect()))
    }

    fn dot_of(&mut self, a: &[Typed], b: &[Typed], span: Span, about: &str) -> Typed {
        let terms =
            a.iter().zip(b).map(|(x, y)| Typed { expr: self.pool.mul(x.expr, y.expr), unit: x.unit.mul(&y.unit) });
        let terms: Vec<Typed> = terms.collect();
        self.total(&terms, span, about)
    }

    /// The sum of numbers that must have one unit.
    fn total(&mut self, terms: &[Typed], span: Span, about: &str) -> Typed {
        let unit = terms.iter().map(|t| &t.unit).find(|u| **u != Unit::Any).cloned().unwrap_or(Unit::Any);
        for t in terms {
            self.require((&t.unit, span), unit.clone(), None, about, 3);
        }
        let all: Vec<_> = terms.iter().map(|t| t.expr).collect();
        Typed { expr: self.pool.sum(&all), unit }
    }

    /// `len`, `sum`, `dot`, `transpose` and the tables, once the number of arguments is right; `None` for another name.
    pub(super) fn array_function(
        &mut self,
        f: &str,
        values: &[Value],
        args: &'a [ast::Expr],
        span: Span,
    ) -> Option<Option<Value>> {
        let wanted = match f {
            "len" | "sum" | "transpose" => 1,
            "dot" => 2,
            "table" => 3,
            "table2" => 5,
            _ => return None,
        };
        if values.len() != wanted {
            let help = match f {
                "dot" => "write `dot(a, b)`",
                "table" => "write `table(x, [x1, x2, ...], [y1, y2, ...])`",
                "table2" => {
                    "write `table2(x, y, [x1, x2, ...], [y1, y2, ...], [[z11, z21, ...], [z12, z22, ...], ...])`"
                }
                _ => "give it one array",
            };
            let message = format!("`{f}` takes {wanted} argument(s), and got {}", values.len());
            self.errors.push(Diagnostic::error("elaborate::arguments", span, message).help(help));
            return Some(None);
        }
        Some(match (f, values) {
            ("table", [x, places, heights]) => self.table([x, places, heights], args, span).map(Value::Scalar),
            ("table2", [x, y, xs, ys, rows]) => self.surface([x, y, xs, ys, rows], args, span).map(Value::Scalar),
            ("transpose", [m]) => self.rows(m.clone(), &args[0]).map(transposed),
            ("len", [a]) => self.array(a, &args[0]).map(|items| {
                let expr = self.pool.int(items.len() as i64);
                Value::Scalar(Typed { expr, unit: Unit::one() })
            }),
            ("sum", [a]) => self.sum_of(a, &args[0]),
            (_, [a, b]) => self.dot((a, &args[0]), (b, &args[1])),
            (_, _) => None,
        })
    }

    /// The entries of an array.
    pub(super) fn array(&mut self, value: &Value, e: &ast::Expr) -> Option<Vec<Value>> {
        match value {
            Value::List(items) => Some(items.clone()),
            Value::Scalar(_) => {
                let message = format!("`{}` is a number, where an array is needed", self.words(e));
                self.shape_error(e.span, message, "an array is written `[a, b, c]`")
            }
        }
    }

    /// The entries of an array of numbers.
    pub(super) fn numbers(&mut self, value: &Value, e: &ast::Expr) -> Option<Vec<Typed>> {
        let items = self.array(value, e)?;
        let all: Option<Vec<Typed>> = items.into_iter().map(Value::into_scalar).collect();
        if all.is_none() {
            let message = format!("`{}` is {}, where an array of numbers is needed", self.words(e), value.words());
            return self.shape_error(e.span, message, "name a row of it, as in `m[1]`");
        }
        all
    }

    fn sum_of(&mut self, a: &Value, e: &ast::Expr) -> Option<Value> {
        let terms = self.numbers(a, e)?;
        let about = format!("an entry of `{}`, which are added up,", self.words(e));
        Some(Value::Scalar(self.total(&terms, e.span, &about)))
    }

    fn dot(&mut self, (x, a): (&Value, &ast::Expr), (y, b): (&Value, &ast::Expr)) -> Option<Value> {
        let (p, q) = (self.numbers(x, a), self.numbers(y, b));
        let (p, q) = p.zip(q)?;
        if !self.same_shape("a scalar product of different sizes", (x, a), (y, b)) {
            return None;
        }
        let about = format!("a term of the scalar product with `{}`", self.words(b));
        Some(Value::Scalar(self.dot_of(&p, &q, b.span, &about)))
    }
}

impl Value {
    fn into_scalar(self) -> Option<Typed> {
        match self {
            Value::Scalar(t) => Some(t),
            Value::List(_) => None,
        }
    }
}

fn transposed(rows: Vec<Vec<Typed>>) -> Value {
    let width = rows.first().map_or(0, Vec::len);
    let column = |j: usize| Value::List(rows.iter().filter_map(|r| r.get(j).cloned()).map(Value::Scalar).collect());
    Value::List((0..width).map(column).collect())
}
