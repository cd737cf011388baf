//! Diagnostics of wrong text: place, code, message, suggested fix.

mod common;
use common::read;

/// `line:column code` of every error of a text.
fn places(text: &str) -> Vec<String> {
    let (sources, _, errors) = read(text);
    let place = |error: &bond_grammar::diagnostic::Diagnostic| {
        let (line, column) = sources.position(error.labels[0].span);
        format!("{line}:{column} {}", error.code)
    };
    errors.iter().map(place).collect()
}

/// The code and the help of the one error of a statement, which has a neighbour on each side.
fn one(statement: &str) -> (String, String) {
    let text = format!("model M {{\n  1:k\n  {statement}\n  k -> z\n}}\n");
    let (sources, file, errors) = read(&text);
    let all: Vec<String> = errors.iter().map(|error| error.render(&sources)).collect();
    assert_eq!(errors.len(), 1, "{statement}: {all:?}");
    let line = sources.position(errors[0].labels[0].span).0;
    assert!(line == 3, "{statement}: {all:?}");
    assert_eq!(file.items.len(), 1, "{statement}");
    assert!(!errors[0].warning && !errors[0].message.contains("_stmt"), "{statement}: {all:?}");
    (errors[0].code.trim_start_matches("syntax::").to_string(), errors[0].help.clone().unwrap_or_default())
}

#[track_caller]
fn check(statement: &str, code: &str, help: &str) {
    let found = one(statement);
    assert!(found.0 == code && found.1.contains(help), "{statement}: {found:?}");
}

#[test]
fn two_errors_of_one_file() {
    let text = include_str!("models/fail_two_errors.bond");
    assert_eq!(places(text), ["14:19 syntax::value", "22:17 syntax::unclosed"]);
    let (_, file, _) = read(text);
    let bond_grammar::ast::Item::Model(model) = &file.items[0] else { panic!("a model") };
    assert_eq!(model.body.len(), 10, "the good statements are kept");
}

#[test]
fn elements_and_bonds() {
    check("I mass = 1 kg", "colon", "`I:mass`");
    check("1 v -> mass", "colon", "`1:v`");
    check("a -> 1 v", "colon", "`1:v`");
    check("I: = 3", "name", "`I:name = ...`");
    check("Se:u 5 V", "equals", "`Se:u = ...`");
    check("a => b", "arrow", "`->`");
    check("a --> b", "arrow", "`->`");
    check("a -- b", "arrow", "`->`");
    check("a |> b", "arrow", "`||>`");
    check("a || > b", "arrow", "`||>`");
    check("a <- b", "arrow", "`b -> a`");
    check("a → b", "character", "`->`");
    check("a |->| b", "two_strokes", "`|->`");
    check("a |-[n]->| b", "two_strokes", "`|->`");
    check("a -[n]|->| b", "two_strokes", "`|->`");
    check("a -> R:r = 5 Ohm", "chain", "write `r` here");
    check("a -> R:r { e = f }", "chain", "write `r` here");
    check("Se:u = x -> R:r", "chain", "line of its own");
    check("Se:u = 5 V -> R:r", "chain", "line of its own");
    check("0:a, 0:b", "chain", "`;`");
    check("Wall:w(500 N/m)", "argument", "parameter = ");
    check("a, b", "unexpected", "");
}

#[test]
fn quantities() {
    check("let x = 5  kg", "unit", "`5 kg`");
    check("let x = 5 kg m", "unit", "`5 kg*m`");
    check("let x = 5 m^(1/0)", "exponent", "fraction");
    check("let x = 5 m^99999999999", "exponent", "fraction");
    check("let x = 5 m^0.5", "exponent", "`m^(1/2)`");
    check("let x = 5 kg*m^1.5/s", "exponent", "`m^(3/2)`");
    check("let x = 5 m^(0.5)", "exponent", "`m^(1/2)`");
    check("let x = 5 m^-1^2", "exponent", "`(5 m^-1)^2`");
    check("let x = 5 m^2^2", "exponent", "`(5 m^2)^2`");
}

#[test]
fn expressions() {
    check("let x = a < b < c", "comparison", "`a < b and b < c`");
    check("let x = a && b", "character", "`and`");
    check("let x = a || b", "operator", "`or`");
    check("let x = a ** 2", "operator", "`^`");
    check("let x = !a", "operator", "`not`");
    check("let x = a +", "value", "");
    check("let x = 2 * * r", "value", "");
    check("let x = a b", "unexpected", "operator");
    check("let x = f(a b)", "unexpected", "operator");
    check("let x = (a + b", "unclosed", "`)`");
    check("let x = c[1", "unclosed", "`]`");
    check("let x = a + )", "stray", "");
    check("let x = if a then b", "if", "else");
    check("let x = if a b else c", "if", "then");
    check("let x = \"abc", "text", "`\"`");
    check("let x = 1 # no comment", "character", "`//`");
}

#[test]
fn statements() {
    check("let x 5", "equals", "`let x = ...`");
    check("let = 5", "name", "`let name = ...`");
    check("let if = 5", "reserved", "another name");
    check("let f(x) x^2", "equals", "`let f(x) = ...`");
    check("let f(2) = 3", "name", "units are checked");
    check("let f(x, = 3", "unclosed", "`)`");
    check("let f(x) =", "value", "");
    check("let x := 3", "operator", "`=`");
    check("prob x = 5", "statement", "`probe`");
    check("x = 5", "statement", "`let x = ...`");
    check("foo", "statement", "declares");
    check("if a = b { a -> b }", "operator", "`==`");
    check("simulate stop = 3", "statement", "{ stop");
    check("simulate { stop 3 }", "equals", "`stop = ...`");
    check("C:c { q0 = }", "value", "");
    check("state z = 0", "statement", "dz = ...");
    check("for i in 1 { a -> b }", "statement", "1..n");
    check("for i in 1..3", "body", "`{`");
    check("for i in 1:n { C:c[i] = 1 F a -> b }", "statement", "1..n");
    check("for i in 1 to n { a -> b }", "statement", "1..n");
    check("probe i: r.f", "equals", "`probe i = ...`");
    check("port p: electrical", "statement", "`port p`");
    check("sampled 25 Hz { a -> b }", "statement", "sampled at");
    check("sampled T {\n    state z = 0 { next = 1 }\n  }", "statement", "sampled at");
    check("sample every 5 ms {\n    state z = 0 { next = 1 }\n  }", "statement", "`sampled`");
    check("sampled at 25 Hz hold a hold b { a -> b }", "twice", "");
    check("expect x at 5 s = 3", "statement", "within");
    check("use \"x.bond\"", "statement", "out of the model");
}

#[test]
fn errors_inside_blocks_are_all_told() {
    let text = "model A {\n for i in 1..3 {\n  let x = * 2\n  a -> b\n  I mass = 1 kg\n }\n if a { b -> c } else {\n  let = 3\n }\n}\n\
        stray words\nmodel B {\n sampled at 5 Hz hold {\n  probe y 3\n }\n}\nmodul C { }\n";
    let wanted = [
        "3:11 syntax::value",
        "5:3 syntax::colon",
        "8:7 syntax::name",
        "11:1 syntax::outside",
        "13:18 syntax::value",
        "14:11 syntax::equals",
        "17:1 syntax::outside",
    ];
    assert_eq!(places(text), wanted);
}

#[test]
fn a_missing_brace_is_told_once() {
    let text = "model A {\n  for i in 1..3 {\n    a -> b\n  let x = 2\n}\n\nmodel B {\n  a -> b\n}\n";
    assert_eq!(places(text), ["2:17 syntax::unclosed"]);
    let text = "model A {\n  I:m { f0 = 1 m/s\n  let x = 2\n  a -> b\n}\n";
    assert_eq!(places(text), ["2:7 syntax::unclosed"]);
    let text = "model A {\n  a -> b\n}\n}\nmodel B { a -> b }";
    assert_eq!(places(text), ["4:1 syntax::stray"]);
}

#[test]
fn a_text_without_a_model_is_told() {
    assert_eq!(places("Se:u = 5 V\n"), ["1:1 syntax::outside"]);
    assert_eq!(places("let x = 5\nmodel M {}\n"), ["1:1 syntax::outside"]);
    assert_eq!(
        places("let f(x) 5\nlet g(y) = * 2\nmodel M { a -> }\n"),
        ["1:10 syntax::equals", "2:12 syntax::value", "3:13 syntax::value"]
    );
    assert_eq!(places("model {\n}\n"), ["1:1 syntax::statement"]);
    assert_eq!(places("model A\n"), ["1:7 syntax::body"]);
    assert_eq!(places("model A\n  port p\n  p -> r\n}\nmodel M { a -> b }\n"), ["1:7 syntax::body"]);
    assert_eq!(places("use std.mechanics\nmodell M {\n  a -> b\n}\n"), ["2:1 syntax::outside"]);
    assert_eq!(places("let f(x) = 2*x\nmodell M {\n  a -> b\n}\n"), ["2:1 syntax::outside"]);
    assert_eq!(places("use std.mechanics\nconst c = 3\nmodel M { a -> b }\n"), ["2:1 syntax::outside"]);
    assert_eq!(places("use\nmodel A {}\n"), ["1:1 syntax::statement"]);
    assert_eq!(places(""), Vec::<String>::new());
}

/// A correct statement is not reported because of a wrong one.
#[test]
fn right_statements_on_one_line_are_kept() {
    for line in [
        "I:m = 1 kg Se:F = 1 N F -> m",
        "let x = a F -> m",
        "Se:F = 1 N a, b[2] -> 0:p",
        "P:p(k = 1 N) p.a -> m",
        "Se:F = x w.tip -[n]-> m",
        "u -> 1:a -> r  a -> c",
        "expect if t > 5 s then r.f < 2 A else r.f < 3 A",
        "1:hold u -> hold hold -> r",
        "probe in = k.f expect in < 3 A",
        "let every = 1 s sampled every every { state z = 0 { next = 1 } }",
        "sampled every if 1 then 1 s else 2 s { Wall:w }",
        "for i in if 1 then 1 else 2..3 { let x = i }",
        "R:for = 1 Ohm u -> for for -> r",
        "let at = 3 let hold = at a -> b, c  d -> a |-> e",
        "let x = 1 )",
    ] {
        let stray = usize::from(line.ends_with(')'));
        let text = format!("model M {{ {line}\nprobe x = }}");
        assert_eq!(places(&text)[stray..], ["2:9 syntax::value"], "{line}");
    }
}

/// What could not be read is known by its name.
#[test]
fn lost_names() {
    let text = "model M { I:m = = 1 kg\n for k in 1.. { R:r[k] = 1 Ohm }\n R drag = 1\n 1 v -> m\n let y = = 2\n 0:p }";
    let (_, file, _) = read(text);
    let bond_grammar::ast::Item::Model(model) = &file.items[0] else { panic!("a model") };
    for name in ["m", "r", "drag", "v", "y"] {
        assert!(model.lost.iter().any(|lost| lost == name), "{name} is not among {:?}", model.lost);
    }
    assert!(!model.lost.iter().any(|lost| lost == "p"));
}

#[test]
fn other_hands() {
    check("C:k = 1_000 N/m", "number", "`1000`");
    check("let x = 12_000_000 N*m", "number", "`12000000`");
    check("R:r { f = 2 A/V^(3/2)*e^1.5 }", "exponent", "if `e` is a variable");
    check("Se:f = 10 N if t > 1 s else 0 N", "if", "then value else value");
    check("connect(r, k)", "statement", "`a -> b`");
    check("C:k { stiffness = 3 [N/m] }", "unexpected", "`3 N/m`");
    check("let k = 3 [1/s]", "unexpected", "`3 s^-1`");
    check("Mass:a(k = 3 N/m; m = 2 kg)", "unexpected", "commas");
    check("for i in 1..10 step 2 { C:d[i] = 1 F }", "statement", "`2*i - 1`");
}
