//! The canonical layout keeps meaning and comments, and is its own layout.

mod common;
use common::{formatted, models, read};

fn body(text: &str) -> String {
    let all = formatted(&format!("model M {{\n{text}\n}}"));
    let inside = all.strip_prefix("model M {\n").and_then(|all| all.strip_suffix("}\n")).expect("a model");
    inside.lines().map(|line| line.strip_prefix("  ").unwrap_or(line).to_string() + "\n").collect()
}

#[test]
fn models_keep_their_meaning() {
    let mut all = models("models");
    all.extend(models("grammar/tests/models"));
    assert!(!all.is_empty());
    for (_, text) in all.iter().filter(|(_, text)| read(text).2.is_empty()) {
        formatted(text);
    }
}

#[test]
fn canonical_text_stays() {
    let text = "//! A wall.\n\nuse std.mechanics\n\n/// Pushes.\nmodel Wall(k = 1000 N/m, gap) {\n  port tip\n\n  \
        C:spring { H = if q > 0 then 0.5*k*q^2 else 0; q0 = -gap }\n  R:c[i] = 4.5 V * sin(x)/(a + b) // why\n  \
        for i in 1..n-1 { c[i-1] -> c[i] }\n  if n > 2 {\n    a -[b[1]]->| c // trailing\n    // last\n  } else {\n    \
        a |-> b\n  }\n  v ||> w.tip\n  expect x at 5 s = 0.005 m within 1e-6 m\n  expect passive\n}\n";
    assert_eq!(formatted(text), text);
}

#[test]
fn spaces_are_canonical() {
    assert_eq!(body("let   x=a+b*c -d/ e ^- 2"), "let x = a + b*c - d/e^-2\n");
    assert_eq!(body("let x = 10 N / g*2 kg*s * y ^ 2"), "let x = 10 N / g*2 kg*s * y^2\n");
    assert_eq!(body("let x = 5 m ^ 2 - (5 m)^2 * 5 m^2"), "let x = 5 m ^ 2 - (5 m)^2*5 m^2\n");
    assert_eq!(body("let x = 3 N/(m*s)^2*y^2"), "let x = 3 N/(m*s)^2*y^2\n");
    assert_eq!(body("let x = 3 N/(m*s) ^ 2"), "let x = 3 N/(m*s) ^ 2\n");
    assert_eq!(body("a,b->1 : v||>c ; c|-[ n ]->d"), "a, b -> 1:v ||> c\nc |-[n]-> d\n");
    assert_eq!(body("let x = a[ i + 1 , j - 1 ] . e"), "let x = a[i+1, j-1].e\n");
}

#[test]
fn fields_stay_on_their_line() {
    assert_eq!(body("C:c {q0=1 m;;H=q,}"), "C:c { q0 = 1 m; H = q }\n");
    assert_eq!(body("C:c {\nq0=1 m H=q}"), "C:c {\n  q0 = 1 m\n  H = q\n}\n");
    assert_eq!(
        body("simulate {}\nport p {}\nport q { inertia=1 kg }"),
        "simulate {}\nport p\nport q { inertia = 1 kg }\n"
    );
    let long = format!("C:c {{ a = {}; b = 1 }}", ["x"; 40].join("+"));
    assert!(body(&long).starts_with("C:c {\n  a = x + x"));
}

#[test]
fn comments_survive() {
    assert_eq!(
        body("// a\n\n\n// b\nlet x = // c\n 1 // d\n// e\n\n\nlet y = 2"),
        "// a\n\n// b\n// c\nlet x = 1 // d\n// e\n\nlet y = 2\n"
    );
    assert_eq!(body("a -> // first\n b, /// second\n c"), "// first\n// second\na -> b, c\n");
    assert_eq!(body("C:c { // open\n q0 = 1 m // one\n // end\n }"), "C:c { // open\n  q0 = 1 m // one\n  // end\n}\n");
    assert_eq!(body("if a { // x\n} // y\n else { // z\n }"), "// y\nif a { // x\n} else { // z\n}\n");
    assert_eq!(
        body("/// doc\nlet x = 1 /// no doc\n/// doc too\nlet y = 2"),
        "/// doc\nlet x = 1 /// no doc\n/// doc too\nlet y = 2\n"
    );
    formatted("model M(k = 1, // the k\n // own\n m = 2 // the m\n) { // open\n} // close\n// end");
    assert_eq!(
        formatted("/// doc\nlet f(x ,y,) = x*y // why\nmodel M { let  g( ) = [ 1,2 ] }"),
        "/// doc\nlet f(x, y) = x*y // why\nmodel M {\n  let g() = [1, 2]\n}\n"
    );
    formatted("// only a comment");
    formatted("// a\n//! b\n;\n//! c\nuse /// d\n std.a /// e\n;/// f\nmodel M {/// g\n}");
    formatted("/// a\n;/// b\nmodel M { /// c\n; /// d\nlet x = 1;/// e\n; let y = 2 }");
}

#[test]
fn long_lines_break_outside_first() {
    let sum = ["f(alpha, beta)"; 9].join("+");
    let text = body(&format!("let x = {sum}"));
    assert!(text.lines().all(|line| line.len() <= 98), "{text}");
    assert!(text.lines().count() == 2 && text.contains(" +\n    f("), "{text}");
    let chain = format!("a -> {}", ["element"; 30].join(", "));
    assert!(body(&chain).lines().all(|line| line.len() <= 98));
    assert_eq!(body("a ->\n b,\n c"), "a -> b, c\n");
}

#[test]
fn blocks_of_one_statement_stay_on_their_line() {
    assert_eq!(body("for i in 1..2{a->b}"), "for i in 1..2 { a -> b }\n");
    assert_eq!(body("for i in 1..2{\na->b}"), "for i in 1..2 {\n  a -> b\n}\n");
    assert_eq!(body("for i in 1..2{a->b;b->c}"), "for i in 1..2 {\n  a -> b\n  b -> c\n}\n");
    assert_eq!(body("if a {b->c} else {c->d}"), "if a { b -> c } else { c -> d }\n");
    assert_eq!(body("if a {b->c} else if d {c->d} else{}"), "if a {\n  b -> c\n} else if d {\n  c -> d\n} else {}\n");
    assert_eq!(body("if a {b->c} else { if d {c->d} }"), "if a {\n  b -> c\n} else {\n  if d { c -> d }\n}\n");
}
