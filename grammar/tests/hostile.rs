//! No text makes the parser panic, overflow its stack or take long.

use bond_grammar::source::Sources;
use std::time::{Duration, Instant};

/// Parses on a small stack, as a model and as an expression; the codes of the errors.
fn codes(text: String) -> Vec<&'static str> {
    let work = move || {
        let mut sources = Sources::new();
        let id = sources.add("hostile.bond", text);
        let start = Instant::now();
        let (file, errors) = bond_grammar::parse(&sources, id);
        if errors.is_empty() {
            bond_grammar::format(&sources, id, &file);
        }
        drop(file.clone());
        drop(file);
        let _ = bond_grammar::parse_expr(&sources, id);
        for error in &errors {
            error.render(&sources);
        }
        assert!(start.elapsed() < Duration::from_secs(30), "took {:?}", start.elapsed());
        errors.iter().map(|error| error.code).collect()
    };
    let thread = std::thread::Builder::new().stack_size(2 << 20).spawn(work);
    thread.expect("a thread starts").join().expect("the parser does not panic")
}

fn model(body: &str) -> String {
    format!("model M {{\n{body}\n}}\n")
}

#[test]
fn deep_nesting_ends_in_an_error() {
    for (open, close) in
        [("(", ")"), ("[", "]"), ("{", "}"), ("sin(", ")"), ("-", ""), ("not ", ""), ("2^", ""), ("- - not", "")]
    {
        for n in [101, 1000, 100_000] {
            let body = format!("let x = {}1{}", open.repeat(n), close.repeat(n));
            let codes = codes(model(&body));
            assert_eq!(codes.len(), 1, "{open} {n} {codes:?}");
            assert!(matches!(codes[0], "syntax::too_deep" | "syntax::too_long"), "{open} {n} {codes:?}");
        }
        codes(open.repeat(100_000));
        codes(close.repeat(100_000));
        codes(model(&format!("let x = {}", open.repeat(90))));
    }
    for row in ["if a then ", "if ", "if a then 1 else ", "a == not ", "2^-", "c[", "(a + ", "2 m*(", "5 a*(b*("] {
        assert!(!codes(model(&format!("let x = {}", row.repeat(50_000)))).is_empty(), "{row}");
    }
    for row in
        ["if a { } else ", "if a { ", "for i in 1..2 { ", "sampled at 1 Hz { ", "C:c { a = ", "model M { ", "a -> "]
    {
        assert!(!codes(model(&row.repeat(50_000))).is_empty(), "{row}");
    }
}

#[test]
fn allowed_nesting_is_read() {
    for (open, close) in
        [("(", ")"), ("[", "]"), ("sin(", ")"), ("-", ""), ("not ", ""), ("2^", ""), ("if a then 1 else ", "")]
    {
        let body = format!("let x = {}1{}", open.repeat(98), close.repeat(98));
        assert_eq!(codes(model(&body)), Vec::<&str>::new(), "{open}");
    }
    for (open, close) in [("for i in 1..2 {\n", "}"), ("if a {", "}"), ("sampled at 1 Hz {", "}")] {
        let body = format!("{}a -> b{}", open.repeat(48), close.repeat(48));
        assert_eq!(codes(model(&body)), Vec::<&str>::new(), "{open}");
        let body = format!("{}a b -> b{}", open.repeat(48), close.repeat(48));
        assert_eq!(codes(model(&body)).len(), 1, "{open}");
    }
    let chain = format!("{}{{ a -> b }}", "if a { } else ".repeat(90));
    assert_eq!(codes(model(&chain)), Vec::<&str>::new());
}

#[test]
fn long_expressions_are_bounded() {
    for operator in ["+", "*", "-", " and ", " or ", "<", "/", "==", "^"] {
        let long = format!("let x = a{}", format!("{operator}a").repeat(100_000));
        let found = codes(model(&long));
        assert!(matches!(found[..], ["syntax::too_long" | "syntax::too_deep"]), "{operator} {found:?}");
    }
    let fits = format!("let x = a{}\n", " + 2 m * b[3]".repeat(490));
    assert_eq!(codes(model(&fits.repeat(3))), Vec::<&str>::new());
    let nested = format!("let x = {}a{}", "(".repeat(90), format!("{})", " + a".repeat(20)).repeat(90));
    assert_eq!(codes(model(&nested)), ["syntax::too_long"]);
    let list = format!("let x = [{}]", "a + b, ".repeat(2000));
    assert_eq!(codes(model(&list)), Vec::<&str>::new());
    let many = "expect x < 3 m\nexpect y + 2 > 3\nif a > b { }\n".repeat(2000);
    assert_eq!(codes(model(&many)), Vec::<&str>::new());
}

#[test]
fn large_files_are_read_in_time() {
    let good = "  C:spring { H = if q > 0 then 0.5*k*q^2 else 0;  q0 = -0.1 m } // a comment\n  a -> 1:b -> c, d\n";
    assert_eq!(codes(model(&good.repeat(5000))), Vec::<&str>::new());
    assert!(codes(model(&format!("{}let = 3\n{}", good.repeat(2500), good.repeat(2500)))).len() == 1);
    assert_eq!(codes(model(&"let a = 2 * * 3\n".repeat(10_000))).len(), 100);
    let deep = format!("{}{}let x = 3 +\n{}", "for i in 1..1 {\n".repeat(60), good.repeat(2500), "}\n".repeat(60));
    assert_eq!(codes(model(&deep)), ["syntax::value"]);
    codes("/// a\n".repeat(100_000));
    codes(model(&"// a comment\n".repeat(50_000)));
    codes(model(&format!("let x = 5 N{}", " // a comment\n".repeat(50_000))));
    codes(model(&format!("let x = (a{}", "\n// a comment\n".repeat(50_000))));
    codes(model(&"5 N*".repeat(100_000)));
    codes("a".repeat(1_000_000));
    codes("é".repeat(300_000));
    codes("\"".repeat(300_000));
    codes(model(&"a, ".repeat(100_000)));
    codes(model(&"1:a ".repeat(100_000)));
    codes(model(&"C(".repeat(90)));
    codes(model(&format!("C({}", "x, ".repeat(100_000))));
    codes("model M {\n".repeat(50_000));
    codes("model M {}\n".repeat(50_000));
}

#[test]
fn every_prefix_of_a_model_is_refused_or_read() {
    let text = include_str!("models/virtual_wall.bond");
    for end in (0..text.len()).filter(|&end| text.is_char_boundary(end)) {
        let codes = codes(text[..end].to_string());
        assert!(codes.len() <= 3, "{end}: {codes:?}");
    }
}
