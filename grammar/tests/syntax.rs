//! Text and the tree it means.

mod common;
use bond_grammar::ast::*;
use bond_grammar::source::Sources;
use common::{good, models, read, shape};

/// The statements of a model's body.
fn body(text: &str) -> Vec<StatementKind> {
    let (_, file) = good(&format!("model M {{\n{text}\n}}\n"));
    let Some(Item::Model(model)) = file.items.into_iter().next() else { panic!("a model") };
    model.body.into_iter().map(|statement| statement.kind).collect()
}

/// An expression with every operation in brackets and units as symbol^exponent.
fn show(expr: &Expr) -> String {
    let list = |items: &[Expr]| items.iter().map(show).collect::<Vec<_>>().join(", ");
    let path = |path: &Path| {
        let segment = |segment: &Segment| match &segment.index[..] {
            [] => segment.name.text.clone(),
            index => format!("{}[{}]", segment.name.text, list(index)),
        };
        path.segments.iter().map(segment).collect::<Vec<_>>().join(".")
    };
    match &expr.kind {
        ExprKind::Number { digits, unit: None } => digits.clone(),
        ExprKind::Number { digits, unit: Some(unit) } => {
            let factor = |(symbol, (above, below), _): &(String, (i32, i32), _)| format!("{symbol}^{above}/{below}");
            format!("<{digits} {}>", unit.factors.iter().map(factor).collect::<Vec<_>>().join(" ")).replace("/1", "")
        }
        ExprKind::Bool(value) => value.to_string(),
        ExprKind::Path(inner) => path(inner),
        ExprKind::Unary(sign, inner) => format!("({sign:?} {})", show(inner)),
        ExprKind::Binary(sign, left, right) => format!("({} {sign:?} {})", show(left), show(right)),
        ExprKind::If(c, a, b) => format!("(if {} then {} else {})", show(c), show(a), show(b)),
        ExprKind::Call(name, args) => format!("{}({})", name.text, list(args)),
        ExprKind::List(items) => format!("[{}]", list(items)),
        ExprKind::Range(from, to) => format!("{}..{}", show(from), show(to)),
        ExprKind::Paren(inner) => show(inner),
    }
}

fn expr(text: &str) -> String {
    match &body(&format!("let it = {text}"))[..] {
        [StatementKind::Let(it)] => show(&it.value),
        other => panic!("{text}: {other:?}"),
    }
}

#[test]
fn models_are_read() {
    let ours = models("grammar/tests/models");
    assert!(ours.len() > 5);
    for (path, text) in models("models").into_iter().chain(ours) {
        if ["invalid", "fail_"].iter().any(|word| path.contains(word)) {
            continue;
        }
        let (sources, file, errors) = read(&text);
        let told: Vec<String> = errors.iter().map(|error| error.render(&sources)).collect();
        assert!(errors.is_empty() && !file.items.is_empty(), "{path}\n{}", told.join(""));
    }
    let (_, file) = good(include_str!("models/virtual_wall.bond"));
    assert_eq!(file.docs, ["A haptic handle pushed against a virtual wall that is computed at 25 Hz."]);
    let [Item::Model(wall), Item::Model(scene)] = &file.items[..] else { panic!("two models") };
    assert_eq!(wall.docs, ["Unilateral spring and damper: pushes, never pulls."]);
    assert_eq!((wall.params.len(), wall.body.len(), scene.body.len()), (3, 4, 8));
}

#[test]
fn precedence() {
    assert_eq!(expr("a + b*c - d/e"), "((a Add (b Mul c)) Sub (d Div e))");
    assert_eq!(expr("-x^2 + 2^-1^y"), "((Neg (x Pow 2)) Add (2 Pow (Neg (1 Pow y))))");
    assert_eq!(expr("a^b^c"), "(a Pow (b Pow c))");
    assert_eq!(expr("-a*b"), "((Neg a) Mul b)");
    assert_eq!(expr("not a < b and c or d == e"), "(((Not (a Lt b)) And c) Or (d Eq e))");
    assert_eq!(expr("a <= b or a >= c or a != d"), "(((a Le b) Or (a Ge c)) Or (a Ne d))");
    assert_eq!(expr("if a then b else c + 1"), "(if a then b else (c Add 1))");
    assert_eq!(expr("2*if a then b else if c then d else true"), "(2 Mul (if a then b else (if c then d else true)))");
    assert_eq!(expr("sin(x, )*[[1, 2], [3, 4]]"), "(sin(x) Mul [[1, 2], [3, 4]])");
    assert_eq!(expr("a . b[i-1][j] .in.e"), "a.b[(i Sub 1), j].in.e");
    assert_eq!(expr("// c\n a // d\n - // e\n b"), "(a Sub b)");
    assert_eq!(expr("a\n - b"), "(a Sub b)");
}

#[test]
fn quantities() {
    assert_eq!(expr("30 N*s/m"), "<30 N^1 s^1 m^-1>");
    assert_eq!(expr("10 N / m"), "(<10 N^1> Div m)");
    assert_eq!(expr("6 V * sin(x)"), "(<6 V^1> Mul sin(x))");
    assert_eq!(expr("6 V*x"), "<6 V^1 x^1>");
    assert_eq!(expr("6 V * sin(x)"), "(<6 V^1> Mul sin(x))");
    assert_eq!(expr("2 m*3"), "(<2 m^1> Mul 3)");
    assert_eq!(expr("1.5e3 J/(kg*K/s)/m^2"), "<1.5e3 J^1 kg^-1 K^-1 s^1 m^-2>");
    assert_eq!(expr("1 m^(2/4)*s^-1/kg^(-1/2)"), "<1 m^1/2 s^-1 kg^1/2>");
    assert_eq!(expr("3 N/(m*s)^2"), "<3 N^1 m^-2 s^-2>");
    assert_eq!(expr("3 m/(s)^2"), "<3 m^1 s^-2>");
    assert_eq!(expr("3 J/(kg*(K/s)^2)^(1/2)*A"), "<3 J^1 kg^-1/2 K^-1 s^1 A^1>");
    assert_eq!(expr("3 N/(m*s) ^ 2"), "(<3 N^1 m^-1 s^-1> Pow 2)");
    assert_eq!(
        expr("2 kΩ + 3 µm + 45 ° + 5 % + .5 m2"),
        "((((<2 kΩ^1> Add <3 µm^1>) Add <45 °^1>) Add <5 %^1>) Add <.5 m2^1>)"
    );
    assert_eq!(expr("if 1 then 2 else 3"), "(if 1 then 2 else 3)");
    assert_eq!(expr("5 m^n"), "(<5 m^1> Pow n)");
    assert_eq!(expr("5 m ^ 2"), "(<5 m^1> Pow 2)");
}

#[test]
fn a_word_after_a_number_is_not_always_a_unit() {
    let kinds = body("R:r = 2 I:mass = 1 kg let x = 5\nN -> 1:v R:s { e = 3 f = 4 } let y = 2 port p");
    assert_eq!(kinds.len(), 7, "{kinds:?}");
    let kinds = body("for N in 1..3 { a -> b } sampled at 25 hold lagged { } expect x at 5 s = 3 m within 1 m");
    assert!(matches!(&kinds[1], StatementKind::Sampled(sampled) if sampled.hold.is_some()));
    let StatementKind::Expect(Expect::At { time, target, .. }) = &kinds[2] else { panic!("{kinds:?}") };
    assert_eq!((show(time), show(target)), ("<5 s^1>".to_string(), "<3 m^1>".to_string()));
}

#[test]
fn elements() {
    let kinds = body(
        "IC(I p1, C q1):arm[i, 2] { H = p1; q1_0 = 1 rad, a.e = 2 } active R:neg = -1 Ohm Wall:w(k = 5 N/m, g = 1,) 0:k",
    );
    let elements: Vec<&Element> = kinds
        .iter()
        .map(|kind| match kind {
            StatementKind::Element(element) => element,
            other => panic!("{other:?}"),
        })
        .collect();
    let arm = elements[0];
    assert_eq!((arm.kind.text.as_str(), arm.ports.len(), arm.index.len()), ("IC", 2, 2));
    assert_eq!(arm.ports[1].kind.as_ref().map(|kind| kind.text.as_str()), Some("C"));
    let (fields, _) = arm.fields.as_ref().expect("fields");
    assert_eq!((fields.len(), fields[2].path.len()), (3, 2));
    assert!(elements[1].active && elements[1].value.is_some() && elements[1].fields.is_none());
    assert_eq!(elements[2].args.len(), 2);
    assert_eq!(elements[3].kind.text, "0");
}

#[test]
fn chains() {
    let kinds =
        body("a, 1:b[i] -> 0:c -[n[2]]->| d.in ||> e |-> f\n|-[m]-> g // end\n let -> hold, at\n active -> input");
    let [StatementKind::Chain(first), StatementKind::Chain(second), StatementKind::Chain(_)] = &kinds[..] else {
        panic!("{kinds:?}")
    };
    assert_eq!(first.groups.iter().map(Vec::len).collect::<Vec<_>>(), [2, 1, 1, 1, 1, 1]);
    assert!(matches!(&first.groups[0][1], End::Declare(element) if element.index.len() == 1));
    let arrow = |index: usize| &first.arrows[index];
    assert_eq!(arrow(1).stroke, Some(Stroke::Head));
    assert_eq!(arrow(1).name.as_ref().map(|(name, index)| (name.text.as_str(), index.len())), Some(("n", 1)));
    assert!(arrow(2).sampled && !arrow(0).sampled);
    assert_eq!((arrow(3).stroke, arrow(4).stroke), (Some(Stroke::Tail), Some(Stroke::Tail)));
    assert_eq!(second.groups[1].len(), 2);
    assert!(matches!(&body("Se:u -> R:r")[..], [StatementKind::Chain(_)]));
}

#[test]
fn the_rest_of_the_statements() {
    let kinds = body(
        "port tip { inertia = 0.1 kg } input u = 0 N; state z = 0 { dz = u } simulate { stop = 10 s; method = gonzalez }\n\
         if n > 2 { a -> b } else if n > 1 { } else { c -> d } expect passive expect max(abs(x)) < 0.2 m\n\
         sampled every 40 ms budget off hold lagged method ray { next -> b }; probe x = integral(v.f, -0.1 m)",
    );
    assert!(matches!(&kinds[0], StatementKind::Port(_, _, fields) if fields.len() == 1));
    assert!(matches!(&kinds[2], StatementKind::State(_, fields) if fields.len() == 1));
    let StatementKind::If(choice) = &kinds[4] else { panic!("{kinds:?}") };
    let Some([Statement { kind: StatementKind::If(next), .. }]) = choice.otherwise.as_deref() else {
        panic!("{choice:?}")
    };
    assert!(next.body.is_empty() && next.otherwise.as_ref().is_some_and(|body| body.len() == 1));
    assert!(matches!(kinds[5], StatementKind::Expect(Expect::Passive)));
    let at = &body("expect passive at wall.hand[2]\n")[0];
    assert!(matches!(at, StatementKind::Expect(Expect::PassiveAt(path)) if path.segments.len() == 2), "{at:?}");
    assert!(matches!(&kinds[6], StatementKind::Expect(Expect::Holds(_))));
    let StatementKind::Sampled(sampled) = &kinds[7] else { panic!("{kinds:?}") };
    assert!(matches!(sampled.clock, Clock::Every(_)) && sampled.budget == Some(false) && sampled.method.is_some());
    let (_, file) = good("use \"a/b.bond\"; use std.mechanics\nmodel M(k, n = 3,) {}");
    assert_eq!(file.items.len(), 3);
    assert!(matches!(&file.items[1], Item::Use(Use { target: UseTarget::Library(names), .. }) if names.len() == 2));
}

#[test]
fn functions() {
    let (sources, file) = good(
        "/// Half a square.\nlet half(x,) = 0.5*x^2\nlet none() = 3 m; model M { let f(a, b) = a*b[2] let g = (a) }",
    );
    let [Item::Function(half), Item::Function(none), Item::Model(model)] = &file.items[..] else { panic!("{file:?}") };
    assert_eq!(half.docs, ["Half a square."]);
    assert_eq!((half.arguments.len(), none.arguments.len()), (1, 0));
    assert_eq!(sources.slice(half.span), "let half(x,) = 0.5*x^2");
    let [StatementKind::Function(f), StatementKind::Let(_)] = [&model.body[0].kind, &model.body[1].kind] else {
        panic!("{model:?}")
    };
    let names: Vec<&str> = f.arguments.iter().map(|a| a.text.as_str()).collect();
    assert_eq!((names, show(&f.value)), (vec!["a", "b"], "(a Mul b[2])".to_string()));
}

#[test]
fn arrays() {
    assert_eq!(expr("[1 Ohm, 2 Ohm,]"), "[<1 Ohm^1>, <2 Ohm^1>]");
    assert_eq!(expr("[[1, 2], [3, 4]]*a"), "([[1, 2], [3, 4]] Mul a)");
    assert_eq!(expr("m[1, 2] + m[1][2] - w.a[i+1]"), "((m[1, 2] Add m[1, 2]) Sub w.a[(i Add 1)])");
    assert_eq!(expr("a -[1, 2]"), "(a Sub [1, 2])");
    assert_eq!(expr("table(x, [0 m, 1 m], -[0 N, 2 N])"), "table(x, [<0 m^1>, <1 m^1>], (Neg [<0 N^1>, <2 N^1>]))");
}

#[test]
fn docs_and_spans() {
    let text = "//! one\n//!  two\n\n/// of M\n// plain\n/// more\nmodel M {\n  a -> b /// none\n  /// of x\n  let x = 1 N // end\n}\n";
    let (sources, file) = good(text);
    assert_eq!(file.docs, ["one", " two"]);
    assert_eq!(file.comments.len(), 8);
    let [Item::Model(model)] = &file.items[..] else { panic!("a model") };
    assert_eq!(model.docs, ["of M", "more"]);
    assert!(model.body[0].docs.is_empty());
    assert_eq!(model.body[1].docs, ["of x"]);
    assert_eq!(sources.slice(model.body[0].span), "a -> b");
    assert_eq!(sources.slice(model.body[1].span), "let x = 1 N");
    assert!(sources.slice(model.span).starts_with("model M {") && sources.slice(model.span).ends_with('}'));
    assert_ne!(shape(&file), shape(&good("model M {}").1));
}

#[test]
fn expressions_alone() {
    let alone = |text: &str| {
        let mut sources = Sources::new();
        let id = sources.add("<argument>", text);
        bond_grammar::parse_expr(&sources, id).map(|expr| show(&expr)).map_err(|error| error.code)
    };
    assert_eq!(alone("40ms"), Ok("<40 ms^1>".to_string()));
    assert_eq!(alone(" -0.1kg*m^2 "), Ok("(Neg <0.1 kg^1 m^2>)".to_string()));
    assert_eq!(alone("0.1 kg"), Ok("<0.1 kg^1>".to_string()));
    assert_eq!(alone("2*(3 N + a)"), Ok("(2 Mul (<3 N^1> Add a))".to_string()));
    assert_eq!(alone("5"), Ok("5".to_string()));
    assert_eq!(alone("2*3N"), Ok("(2 Mul <3 N^1>)".to_string()));
    assert_eq!(alone(""), Err("syntax::value"));
    assert_eq!(alone("1 +"), Err("syntax::value"));
    assert_eq!(alone("1 < 2 < 3"), Err("syntax::comparison"));
    assert_eq!(alone("(1"), Err("syntax::unexpected"));
}

#[test]
fn definitions() {
    let kinds = body(
        "state z[i] = 0 V { next = z[i-1] } input u[1, 2] = 0; output y = u[1][2]; let a[2] = 3 probe output = a[2]",
    );
    let name = |kind: &StatementKind| match kind {
        StatementKind::State(it, _)
        | StatementKind::Input(it)
        | StatementKind::Output(it)
        | StatementKind::Let(it)
        | StatementKind::Probe(it) => (it.name.text.clone(), it.index.len()),
        _ => panic!("{kind:?}"),
    };
    let names: Vec<(String, usize)> = kinds.iter().map(name).collect();
    let wanted = [("z", 1), ("u", 2), ("y", 0), ("a", 1), ("output", 0)];
    assert_eq!(names, wanted.map(|(name, index)| (name.to_string(), index)));
    assert!(matches!(kinds[2], StatementKind::Output(_)));
    // It begins a statement only where one fits.
    assert!(matches!(&body("I:output = 1 kg output -> v")[..], [StatementKind::Element(_), StatementKind::Chain(_)]));
}

/// A unit ends before its first factor that is none, whatever follows, as if there were spaces around its operator.
#[test]
fn units_end_before_names() {
    let read = |text: &str| {
        let mut sources = Sources::new();
        let id = sources.add("a.bond", format!("model M {{ let it = {text} }}"));
        let is_unit = |symbol: &str| matches!(symbol, "V" | "m" | "s");
        let (file, errors) = bond_grammar::parse_with_units(&sources, id, &is_unit);
        assert!(errors.is_empty(), "{text}: {errors:?}");
        match &file.items[..] {
            [Item::Model(model)] => match &model.body[0].kind {
                StatementKind::Let(it) => show(&it.value),
                other => panic!("{text}: {other:?}"),
            },
            other => panic!("{text}: {other:?}"),
        }
    };
    for (tight, apart) in [
        ("6 V*x", "6 V * x"),
        ("6 V*s/m^2", "6 V*s/m^2"),
        ("6 V*x^2/s", "6 V * x^2/s"),
        ("6 V*x^-2*y", "6 V * x^-2*y"),
        ("6 V*x^(1/2)", "6 V * x^(1/2)"),
        ("6 V*x^2^y", "6 V * x^2^y"),
        ("6 V/(m*x)^2*s", "6 V / (m*x)^2*s"),
        ("6 V/(m*(s*x))", "6 V / (m*(s*x))"),
        ("a/6 V*x + 1", "a/6 V * x + 1"),
        ("2^6 s*x", "2^6 s * x"),
        ("-6 V*exp(x)*y", "-6 V * exp(x)*y"),
        ("6 V*x[1].e", "6 V * x[1].e"),
        ("6 V*(x)", "6 V * (x)"),
    ] {
        assert_eq!(read(tight), read(apart), "{tight}");
    }
    // A first factor that is no unit is an error of later.
    assert_eq!(read("6 x*V"), "<6 x^1 V^1>");
}
