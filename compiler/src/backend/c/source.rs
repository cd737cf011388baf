//! The source: the routines, and what the header promises.

use super::double_buffer::double_buffered;
use super::print::{Needs, body, letter, memories, number, table};
use super::{Options, comment, solve};
use crate::backend::code::{Memory, Number, Reason, Routine};
use crate::backend::standalone::{Late, NAMES, StandaloneModule};
use std::fmt::Write;
use std::ops::Range;

/// Helpers, each after a line that names it.
const HELPERS: &str = include_str!("helpers.c");

/// The text of the `.c`.
pub fn source(unit: &StandaloneModule, options: &Options) -> String {
    let p = &options.prefix;
    let mut needs = Needs::default();
    let (after, double_buffered) = (unit.commit.systems.len(), double_buffered(unit));
    let commit = function(&unit.commit, "commit", 0, double_buffered, &mut needs);
    let observe = function(&unit.observe, "observe", after, double_buffered, &mut needs);
    let many = unit.run.as_ref().map(|r| function(r, "many", 0, &[], &mut needs)).unwrap_or_default();
    let begin = unit.begin.as_ref().filter(|_| options.begin);
    let last = after + unit.observe.systems.len();
    let again = begin.map(|r| function(r, "begin", last, double_buffered, &mut needs)).unwrap_or_default();
    let lanes = super::lanes::source(unit, options, &mut needs);
    let mut solvers = solve::functions(&unit.commit, 0, &mut needs);
    solvers += &solve::functions(&unit.observe, after, &mut needs);
    solvers += &begin.map(|r| solve::functions(r, last, &mut needs)).unwrap_or_default();
    let mut out = format!(
        "/* {} as a program of its own, made by bond; see {}. C99 and libm. For the same bits on every machine: -ffp-contract=off. */\n\
         #include \"{}\"\n#include <math.h>\n#include <string.h>\n\n\
         #if defined(__FAST_MATH__) || defined(__ASSOCIATIVE_MATH__) || (defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__)\n\
         #error \"not with -ffast-math or parts of it: numbers that are not finite go unseen, and what rounding takes is lost\"\n\
         #endif\n\
         #if defined(__clang__) || !defined(__GNUC__)\n\
         #pragma STDC FP_CONTRACT OFF\n\
         #endif\n\n",
        comment(&unit.name),
        options.header,
        options.header,
    );
    out.push_str(
        "#ifdef BOND_FLOAT\ntypedef float bond_real;\n#define BOND_M(g) g##f\n#define BOND_SMALL(a, b) ((bond_real)(b))\n\
         #define BOND_EXPONENT 126\n#else\n",
    );
    out.push_str(
        "typedef double bond_real;\n#define BOND_M(g) g\n#define BOND_SMALL(a, b) ((bond_real)(a))\n\
         #define BOND_EXPONENT 1022\n#endif\n#define BOND_R(x) ((bond_real)(x))\n#define BOND_INFINITY ((bond_real)INFINITY)\n\
         #define BOND_NAN ((bond_real)NAN)\n",
    );
    if options.prefix == "bond" {
        out = out.replace("typedef float bond_real;\n", "").replace("typedef double bond_real;\n", "");
    } else {
        for (k, (name, _)) in Reason::ALL.iter().enumerate() {
            let _ = writeln!(out, "#define BOND_{name} {}", k + 1);
        }
    }
    out.push('\n');
    for helper in HELPERS.split("/* -- ").skip(1) {
        if let Some((name, text)) = helper.split_once(" */\n")
            && needs.contains(name)
        {
            out.push_str(text);
        }
    }
    numbers(&mut out, "start", &unit.image[..unit.kept]);
    if !unit.table.is_empty() {
        numbers(&mut out, "table", &unit.table);
    }
    out.push_str(&solvers);
    out.push_str(&commit);
    out.push_str(&many);
    out.push_str(&observe);
    out.push_str(&again);
    out.push_str(&interface(unit, double_buffered, p));
    if begin.is_some() {
        let _ = write!(
            out,
            "\n/* Takes the first samples anew, after {p}_init and {p}_input. 0, or why it failed. */\n\
             int {p}_begin({p}_state *b);\nint {p}_begin({p}_state *b) {{\n    \
             const int failed = begin(b->x, 0, 0, b->s{});\n    memset(b->s, 0, sizeof b->s);\n    return failed;\n}}\n",
            places(unit, double_buffered)
        );
    }
    // An object's header, which may stand in the place of the own one, has no lanes.
    let _ = write!(out, "\n#ifdef {}_LANES\n{lanes}#endif\n", p.to_uppercase());
    out
}

/// A table of numbers.
fn numbers(out: &mut String, name: &str, list: &[f64]) {
    let _ = write!(out, "static const bond_real {name}[{}] = {{", list.len().max(1));
    if list.is_empty() {
        out.push_str(" 0");
    }
    for (i, x) in list.iter().enumerate() {
        out.push_str(if i % 6 == 0 { "\n    " } else { " " });
        let _ = write!(out, "{},", number(Number::Plain(*x)));
    }
    out.push_str("\n};\n\n");
}

/// A routine as a function; its systems are numbered from `first` on.
fn function(routine: &Routine, name: &str, first: usize, late: &[Late], needs: &mut Needs) -> String {
    let used = memories(routine);
    let text = body(routine, first, late, needs);
    let mut out = String::new();
    if !routine.data.is_empty() {
        numbers(&mut out, &format!("{name}_data"), &routine.data);
    }
    if !routine.tables.is_empty() {
        table(&mut out, &format!("static const unsigned {name}_places[]"), &routine.tables);
    }
    let _ = writeln!(
        out,
        "static int {name}(bond_real *restrict x, const bond_real *restrict u, bond_real *restrict y, bond_real *restrict s{}) {{",
        each(late, |k, _| format!(", bond_real *restrict p{k}, bond_real *restrict q{k}"))
    );
    if used.contains(&Memory::Table) {
        let _ = writeln!(out, "    const bond_real *const c = table;");
    }
    if !routine.data.is_empty() {
        let _ = writeln!(out, "    const bond_real *const d = {name}_data;");
    }
    if !routine.tables.is_empty() {
        let _ = writeln!(out, "    const unsigned *const g = {name}_places;");
    }
    out.push_str(&text.split_inclusive('\n').take_while(|l| is_declaration(l)).collect::<String>());
    out.push_str(&each(late, |k, _| format!("    (void)p{k};\n    (void)q{k};\n")));
    for m in [Memory::State, Memory::Input, Memory::Output, Memory::Scratch] {
        if !used.contains(&m) {
            let _ = writeln!(out, "    (void){};", letter(m));
        }
    }
    out.push_str(&text.split_inclusive('\n').skip_while(|l| is_declaration(l)).collect::<String>());
    out.push_str("}\n\n");
    out
}

/// Whether a line declares a variable of the whole function.
fn is_declaration(line: &str) -> bool {
    line.starts_with("    bond_real m") || line.starts_with("    unsigned long i")
}

/// The numbers that go from interval to interval and are written while an interval may still fail.
pub fn early(unit: &StandaloneModule) -> impl Iterator<Item = Range<usize>> {
    let starts = std::iter::once(0).chain(unit.late.iter().map(|l| l.state.end));
    let ends = unit.late.iter().map(|l| l.state.start).chain([unit.kept]);
    starts.zip(ends).map(|(from, to)| from..to).filter(|r| !r.is_empty())
}

/// Something for each of these states, by its number.
fn each(late: &[Late], f: impl Fn(usize, &Late) -> String) -> String {
    late.iter().enumerate().map(|(k, l)| f(k, l)).collect()
}

/// Arguments: every second interval finds states where the one before put them, and puts the new ones where these were.
fn places(unit: &StandaloneModule, double_buffered: &[Late]) -> String {
    each(double_buffered, |_, l| {
        let (turned, state, next) = (unit.turned, l.state.start, l.next);
        format!(", b->x + (b->x[{turned}] == 0 ? {state} : {next}), b->x + (b->x[{turned}] == 0 ? {next} : {state})")
    })
}

/// The public functions.
fn interface(unit: &StandaloneModule, double_buffered: &[Late], p: &str) -> String {
    let mut out = String::new();
    let states = places(unit, double_buffered);
    let saved = each(double_buffered, |_, l| {
        let (turned, state, next, n) = (unit.turned, l.state.start, l.next, l.state.len());
        format!("    if (b->x[{turned}] != 0) memcpy(saved + {state}, b->x + {next}, {n} * sizeof *saved);\n")
    });
    let probes = match unit.observe_scratch {
        0 => String::new(),
        at => format!(" + {at}"),
    };
    let _ = writeln!(
        out,
        "void {p}_init({p}_state *b) {{\n    /* GCC 12 with AVX-512 stores a constant of eight numbers as eight times its first one, where it may look into it. */\n    \
         const {p}_real *const volatile from = start;\n    memset(b, 0, sizeof *b);\n    memcpy(b->x, from, sizeof start);\n}}\n"
    );
    let _ = writeln!(out, "void {p}_output(const {p}_state *b, {p}_real *out) {{");
    for (i, o) in unit.open.iter().enumerate() {
        let sign = if o.sign < 0.0 { "-" } else { "" };
        let _ = writeln!(out, "    out[{i}] = {sign}b->x[{}];", o.at);
    }
    if unit.open.is_empty() {
        out.push_str("    (void)b;\n    (void)out;\n");
    }
    let _ = writeln!(out, "}}\n\nint {p}_commit({p}_state *b, const {p}_real *moved) {{");
    if unit.whole {
        out.push_str("    return commit(b->x, moved, 0, b->s);\n}\n\n");
    } else {
        let (mut keep, mut back, mut to) = (String::new(), String::new(), 0);
        for r in early(unit) {
            let n = r.len();
            let _ = writeln!(keep, "    memcpy(b->k + {to}, b->x + {}, {n} * sizeof *b->k);", r.start);
            let _ = writeln!(back, "        memcpy(b->x + {}, b->k + {to}, {n} * sizeof *b->k);", r.start);
            to += n;
        }
        let good = if double_buffered.is_empty() {
            each(&unit.late, |_, l| {
                let (state, next, n) = (l.state.start, l.next, l.state.len());
                format!("        memcpy(b->x + {state}, b->x + {next}, {n} * sizeof *b->x);\n")
            })
        } else {
            format!("        b->x[{0}] = b->x[{0}] == 0;\n", unit.turned)
        };
        let good = if good.is_empty() { good } else { format!(" else {{\n{good}    }}") };
        let _ = writeln!(
            out,
            "    int failed;\n{keep}    failed = commit(b->x, moved, 0, b->s{states});\n    if (failed) {{\n{back}    }}{good}\n    \
             return failed;\n}}\n"
        );
    }
    if unit.run.is_some() {
        // Counters are numbers, of which single ones count not far.
        let _ = writeln!(
            out,
            "int {p}_run({p}_state *b, unsigned long intervals) {{\n    while (intervals > 0) {{\n        \
             const unsigned long part = intervals < 1000000 ? intervals : 1000000;\n        bond_real most = (bond_real)part, gone = 0;\n        \
             const int failed = many(b->x, &most, &gone, b->s);\n        if (failed) {{\n            most = gone;\n            \
             (void)many(b->x, &most, &gone, b->s);\n            return failed;\n        }}\n        intervals -= part;\n    }}\n    \
             return 0;\n}}\n"
        );
    }
    let _ = writeln!(
        out,
        "int {p}_probes({p}_state *b, {p}_real *out) {{\n    return observe(b->x, 0, out, b->s{probes}{states});\n}}\n"
    );
    let _ = writeln!(out, "void {p}_input({p}_state *b, int input, {p}_real value) {{");
    match unit.inputs.first() {
        None => out.push_str("    (void)b;\n    (void)input;\n    (void)value;\n"),
        Some(first) => {
            let (n, at) = (unit.inputs.len(), first.at);
            let _ = writeln!(out, "    if (input >= 0 && input < {n}) b->x[{at} + input] = value;");
        }
    }
    let _ = writeln!(out, "}}\n\n{p}_real {p}_time(const {p}_state *b) {{\n    return b->x[{}];\n}}\n", unit.time);
    let sum: Vec<String> = unit.regions.iter().map(|r| format!("b->x[{}]", r.at)).collect();
    let sum =
        if sum.is_empty() { "(void)b;\n    return 0;".to_string() } else { format!("return {};", sum.join(" + ")) };
    let _ = writeln!(out, "{p}_real {p}_energy(const {p}_state *b) {{\n    {sum}\n}}\n");
    let places: Vec<String> = unit.regions.iter().map(|r| r.at.to_string()).collect();
    let _ = writeln!(out, "{p}_real {p}_ledger(const {p}_state *b, int region, int what) {{");
    if places.is_empty() {
        out.push_str("    (void)b;\n    (void)region;\n    (void)what;\n    return BOND_NAN;\n}\n\n");
    } else {
        let (n, m) = (places.len(), NAMES.len());
        let _ = writeln!(
            out,
            "    static const unsigned long at[] = {{ {} }};\n    \
             if (region < 0 || region >= {n} || what < 0 || what >= {m}) return BOND_NAN;\n    \
             return b->x[at[region] + (unsigned long)what];\n}}\n",
            places.join(", ")
        );
    }
    let _ = writeln!(
        out,
        "unsigned long {p}_size(void) {{\n    return (unsigned long)sizeof({p}_state);\n}}\n\nvoid {p}_save(const {p}_state *b, {p}_real *saved) {{\n    memcpy(saved, b->x, sizeof start);\n{saved}}}\n\n\
         void {p}_restore({p}_state *b, const {p}_real *saved) {{\n    memset(b, 0, sizeof *b);\n    memcpy(b->x, saved, sizeof start);\n}}"
    );
    out
}
