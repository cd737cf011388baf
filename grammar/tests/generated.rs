//! Generated models keep their meaning through the layout; generated rubbish does no harm.

mod common;
use common::{formatted, read};
use proptest::prelude::*;

/// One of these.
fn pick(list: &[&'static str]) -> BoxedStrategy<String> {
    prop::sample::select(list.to_vec()).prop_map(String::from).boxed()
}

/// A text between two tokens.
fn gap() -> BoxedStrategy<String> {
    prop_oneof![6 => Just(" "), 1 => Just("\n"), 1 => Just("  "), 1 => Just(" // why\n"), 1 => Just("\n\n\n /// doc\n"), 1 => Just("\n// a\n// b\n")]
        .prop_map(String::from)
.boxed()
}

fn name() -> BoxedStrategy<String> {
    let names = [
        "a", "b", "mass", "C", "R", "hold", "at", "input", "output", "q1_0", "θ", "in", "state", "x", "budget",
        "passive",
    ];
    pick(&names)
}

/// A name, or one with an index.
fn indexed() -> BoxedStrategy<String> {
    (name(), pick(&["", "", "[i]", "[i, j-1]", "[i][j]"])).prop_map(|(name, index)| format!("{name}{index}")).boxed()
}

fn quantity() -> BoxedStrategy<String> {
    let units = ["", " N", " kg*m^2", " J/(kg*K)", " m^(1/2)", " µm", " °", " %"];
    (pick(&["1", "0.5", ".5", "1e-3", "2.", "10"]), pick(&units))
        .prop_map(|(digits, unit)| format!("{digits}{unit}"))
        .boxed()
}

fn expr() -> BoxedStrategy<String> {
    let leaf = prop_oneof![quantity(), name(), Just("true".to_string()), Just("c[i-1].p.e".to_string())];
    leaf.prop_recursive(4, 24, 3, |inner| {
        let signs = ["+", "-", "*", "/", "^", "and", "or"];
        prop_oneof![
            (inner.clone(), gap(), pick(&signs), gap(), inner.clone())
                .prop_map(|(a, g, sign, h, b)| format!("{a}{g}{sign}{h}{b}")),
            (inner.clone(), inner.clone()).prop_map(|(a, b)| format!("({a} <= {b})")),
            inner.clone().prop_map(|a| format!("-{a}")),
            inner.clone().prop_map(|a| format!("not {a}")),
            (gap(), inner.clone()).prop_map(|(g, a)| format!("({g}{a})")),
            (name(), inner.clone(), gap(), inner.clone()).prop_map(|(f, a, g, b)| format!("{f}({a},{g}{b})")),
            (inner.clone(), inner.clone()).prop_map(|(a, b)| format!("[{a}, {b},]")),
            (inner.clone(), gap(), inner.clone(), inner)
                .prop_map(|(a, g, b, c)| format!("(if {a} then{g}{b} else {c})")),
        ]
    })
    .boxed()
}

fn head() -> BoxedStrategy<String> {
    let kinds = ["1", "0", "I", "C(x, y)", "IC(I p1, C q1)", "Wall"];
    (pick(&kinds), name(), prop::option::of(expr()))
        .prop_map(|(kind, name, index)| match index {
            Some(index) => format!("{kind}:{name}[{index}]"),
            None => format!("{kind}:{name}"),
        })
        .boxed()
}

fn fields() -> BoxedStrategy<String> {
    let field =
        (prop_oneof![name(), Just("a.e".to_string())], expr()).prop_map(|(name, value)| format!("{name} = {value}"));
    (prop::collection::vec((gap(), field, pick(&[";", ",", "\n", ";;"])), 1..4))
        .prop_map(|rows| {
            let rows: Vec<String> = rows.into_iter().map(|(gap, field, end)| format!("{gap}{field}{end}")).collect();
            format!("{{{}}}", rows.concat())
        })
        .boxed()
}

fn function() -> BoxedStrategy<String> {
    (name(), gap(), prop::collection::vec(name(), 0..3), gap(), expr())
        .prop_map(|(name, g, arguments, h, value)| format!("let {name}{g}({}){h}= {value}", arguments.join(", ")))
        .boxed()
}

fn statement() -> BoxedStrategy<String> {
    let arrows = ["->", "||>", "->|", "|->", "-[n]->", "|-[n[i]]->", "-[ n ]->|", "-[n]|->", "-[n]||>"];
    let end = prop_oneof![head(), name(), Just("w[1].tip".to_string())].boxed();
    let words = ["let", "probe", "input", "output"];
    let simple = prop_oneof![
        (head(), gap(), expr()).prop_map(|(head, gap, value)| format!("{head}{gap}= {value}")),
        (head(), gap(), fields()).prop_map(|(head, gap, fields)| format!("{head}{gap}{fields}")),
        (name(), expr()).prop_map(|(name, value)| format!("active Wall:{name}(k = {value})")),
        (end.clone(), gap(), pick(&arrows), gap(), end.clone(), gap(), end)
            .prop_map(|(a, g, arrow, h, b, i, c)| format!("{a}{g}{arrow}{h}{b},{i}{c}")),
        (pick(&words), gap(), indexed(), expr())
            .prop_map(|(word, g, name, value)| format!("{word}{g}{name} = {value}")),
        function(),
        (indexed(), expr(), gap(), fields())
            .prop_map(|(name, value, g, fields)| format!("state {name} = {value}{g}{fields}")),
        (name(), gap(), fields()).prop_map(|(name, g, fields)| format!("port {name}{g}{fields}")),
        (gap(), fields()).prop_map(|(g, fields)| format!("simulate{g}{fields}")),
        (expr(), gap(), expr()).prop_map(|(a, g, b)| format!("expect ({a}){g}at 5 s = ({b}) within 1 m")),
        expr().prop_map(|a| format!("expect {a}")),
    ];
    simple
        .prop_recursive(2, 8, 3, |inner| {
            let block = (gap(), prop::collection::vec((inner, gap()), 0..3))
                .prop_map(|(gap, rows)| {
                    let rows: Vec<String> = rows.into_iter().map(|(row, gap)| format!("{row}{gap}")).collect();
                    format!("{{{gap}{}}}", rows.join("\n"))
                })
                .boxed();
            prop_oneof![
                (name(), expr(), block.clone())
                    .prop_map(|(name, to, block)| format!("for {name} in 1..({to}) {block}")),
                (expr(), block.clone(), gap(), block.clone()).prop_map(|(a, b, g, c)| format!("if {a} {b}{g}else {c}")),
                (expr(), block.clone(), gap(), block.clone())
                    .prop_map(|(a, b, g, c)| format!("if {a} {b} else{g}if d {c}")),
                (block).prop_map(|block| format!("sampled at 25 Hz budget off hold lagged {block}")),
            ]
        })
        .boxed()
}

fn model() -> BoxedStrategy<String> {
    (
        prop::collection::vec((gap(), function()), 0..2),
        prop::collection::vec((name(), prop::option::of(expr()), gap()), 0..4),
        prop::collection::vec((gap(), statement()), 0..5),
    )
        .prop_map(|(functions, params, rows)| {
            let functions: String = functions.into_iter().map(|(gap, f)| format!("{gap}{f}\n")).collect();
            let params: Vec<String> = params
                .into_iter()
                .map(|(name, value, gap)| value.map_or(format!("{gap}{name}"), |value| format!("{name}{gap}= {value}")))
                .collect();
            let rows: Vec<String> = rows.into_iter().map(|(gap, row)| format!("{gap}{row}")).collect();
            format!("{functions}model M({}) {{\n{}\n}}\n", params.join(", "), rows.join("\n"))
        })
        .boxed()
}

const TOKENS: &[&str] = &[
    "model", "M", "{", "}", "(", ")", "[", "]", "let", "x", "=", "5", " N", "*", "/", "-", "->", "||>", "|->", "|",
    ":", "I", "1", "0", ";", ",", ".", "..", "if", "then", "else", "for", "in", "sampled", "at", "hold", "//", "///",
    "\n", "\"", "é", "expect", "within", "state", "port", "^", "not", "and", "true", "use", "simulate", "5N", "|>",
    "=>", "--", "==", "<", "!", "  ",
];

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn layout_keeps_the_meaning(text in model()) {
        formatted(&text);
    }

    #[test]
    fn a_damaged_model_is_refused_or_read(text in model(), at in any::<prop::sample::Index>(), token in pick(TOKENS)) {
        let places: Vec<usize> = text.char_indices().map(|(at, _)| at).collect();
        let at = places[at.index(places.len())];
        let damaged = format!("{}{token}{}", &text[..at], &text[at..]);
        let (sources, _, errors) = read(&damaged);
        for error in errors {
            prop_assert!(error.render(&sources).contains("test.bond:"));
            for label in &error.labels {
                prop_assert!(damaged.get(label.span.start as usize..(label.span.end as usize).min(damaged.len())).is_some());
            }
        }
        let cut = &text[at..];
        read(cut);
    }

    #[test]
    fn rubbish_does_no_harm(tokens in prop::collection::vec(pick(TOKENS), 0..60), spaced in any::<bool>()) {
        let text = tokens.join(if spaced { " " } else { "" });
        let inside = format!("model M {{ {text} }}");
        for text in [text, inside] {
            let (sources, file, errors) = read(&text);
            for error in &errors {
                error.render(&sources);
            }
            if errors.is_empty() {
                bond_grammar::format(&sources, file.span.source, &file);
            }
        }
    }

    #[test]
    fn any_text_is_survived(text in any::<String>()) {
        read(&text);
        let mut sources = bond_grammar::source::Sources::new();
        let id = sources.add("expr", text);
        let _ = bond_grammar::parse_expr(&sources, id);
    }
}
