//! The header: what a program that uses a scene sees.

use super::{Options, comment, constants};
use crate::backend::code::Reason;
use crate::backend::standalone::{NAMES, StandaloneModule};
use std::fmt::Write;

/// Of a header for C, and of one for an object.
const MARKS: [&str; 2] = [
    "define BOND_FLOAT for both files to have them single",
    "the numbers of an object file are double; emit C to have them single",
];

/// Whether a text is the header that goes with an object, and not with C; None of others.
pub fn goes_with_object(text: &str) -> Option<bool> {
    MARKS.iter().position(|mark| text.contains(mark)).map(|k| k == 1)
}

/// The text of the `.h`.
pub fn header(unit: &StandaloneModule, options: &Options) -> String {
    let p = &options.prefix;
    let upper = p.to_uppercase();
    let mut out = format!(
        "/* {} as a program of its own, made by bond.\n\n   {p}_init, then for each interval of {:?} s: {p}_output, wait, {p}_commit.\n   \
         Nothing allocates, blocks or prints. All units are SI. */\n#ifndef {upper}_H\n#define {upper}_H\n\n",
        comment(&unit.name),
        unit.interval,
    );
    out.push_str("#ifdef __cplusplus\nextern \"C\" {\n#endif\n\n");
    let numbers = match options.single {
        true => format!(
            "/* What numbers are; {}. */\n#ifdef BOND_FLOAT\n\
             typedef float {p}_real;\n#else\ntypedef double {p}_real;\n#endif\n",
            MARKS[0]
        ),
        false => format!("#ifdef BOND_FLOAT\n#error \"{}\"\n#endif\ntypedef double {p}_real;\n", MARKS[1]),
    };
    let _ = write!(
        out,
        "{numbers}\n/* Length of an interval, s. */\n#define {upper}_INTERVAL {:?}\n\
         /* How many numbers a saved state has. */\n#define {upper}_SAVED {}\n\n",
        unit.interval, unit.kept,
    );
    let list = |out: &mut String, what: &str, doc: &str, names: Vec<&str>| {
        let _ = writeln!(out, "/* {doc} */\n#define {upper}_{what}S {}", names.len());
        for (i, (name, macro_)) in names.iter().zip(constants(names.iter().copied())).enumerate() {
            let _ = writeln!(out, "#define {upper}_{what}_{macro_} {i} /* {} */", comment(name));
        }
        out.push('\n');
    };
    let ports =
        "Open ports. What the scene holds or gives out is read with output, what the outside did is told with commit.";
    list(&mut out, "PORT", ports, unit.open.iter().map(|o| o.name.as_str()).collect());
    list(&mut out, "INPUT", "Signals given from outside.", unit.inputs.iter().map(|i| i.name.as_str()).collect());
    list(&mut out, "PROBE", "Probes.", unit.probes.iter().map(String::as_str).collect());
    list(&mut out, "REGION", "Regions, each with a ledger.", unit.regions.iter().map(|r| r.name.as_str()).collect());
    let mut reasons = String::new();
    for (k, (name, why)) in Reason::ALL.iter().enumerate() {
        let comma = if k + 1 < Reason::ALL.len() { "," } else { "" };
        let _ = writeln!(reasons, "    {upper}_{name} = {}{comma} /* {why} */", k + 1);
    }
    let _ = writeln!(out, "/* What a ledger holds, J; worst and gained are parts of the energy in a step. */");
    for (i, name) in NAMES.iter().enumerate() {
        let _ = writeln!(out, "#define {upper}_LEDGER_{} {i}", name.to_uppercase());
    }
    let _ = write!(
        out,
        "
/* A scene that runs: plain data, to be kept wherever you like. */
typedef struct {p}_state {{
    {p}_real x[{}]; /* the first {upper}_SAVED go from interval to interval */
    {p}_real s[{}]; /* scratch: what an interval finds there it could make anew */
{}}} {p}_state;

/* Why an interval failed. The scene then is as the interval found it. */
enum {{
    {upper}_DONE = 0,
{reasons}}};

/* Puts a scene at its start, with the first samples taken. */
void {p}_init({p}_state *b);

/* What the scene holds at its open ports over the interval that runs, or what it gave out on average over the last one, along the
   half arrow, where a continuous region has the port. One number a port. */
void {p}_output(const {p}_state *b, {p}_real *out);

/* Ends the interval: tells how far the outside moved over it at each port (the integral of the flow where the scene holds an effort,
   of the effort where it holds a flow; a flow runs into the scene, so that what is held times this is what the outside puts in, J), or for a port of a
   continuous region what the outside gives over it, along the half arrow. May be null where there are no ports. 0, or why it failed. */
int {p}_commit({p}_state *b, const {p}_real *moved);

{}/* Looks at the probes, one number each. 0, or why it failed. Looking changes nothing that an interval reads. */
int {p}_probes({p}_state *b, {p}_real *out);

/* Sets a signal given from outside, from the start of the interval that runs; a sampled region meets it at its next sample. */
void {p}_input({p}_state *b, int input, {p}_real value);

/* The time, s. */
{p}_real {p}_time(const {p}_state *b);

/* The energy stored in all regions, J. */
{p}_real {p}_energy(const {p}_state *b);

/* A number of a region's ledger; NaN where there is no such region or number. */
{p}_real {p}_ledger(const {p}_state *b, int region, int what);

/* How many bytes a state takes, for languages that do not read this header. */
unsigned long {p}_size(void);

/* Saves the state, and puts a scene into a saved one: bit for bit. */
void {p}_save(const {p}_state *b, {p}_real *saved);
void {p}_restore({p}_state *b, const {p}_real *saved);
",
        unit.image.len(),
        unit.scratch,
        if unit.whole {
            String::new()
        } else {
            format!("    {p}_real k[{}]; /* what the interval began with, to be put back if it fails */\n", unit.kept)
        },
        if unit.run.is_none() {
            String::new()
        } else {
            format!(
                "/* Goes so many intervals on, faster than one by one. 0, or why one failed; the scene then is as that one found it, and the\n   \
                 time tells which it was. */\nint {p}_run({p}_state *b, unsigned long intervals);\n\n"
            )
        },
    );
    // An object has no lanes.
    if options.single {
        out.push_str(&super::lanes::header(unit, options));
    }
    out.push_str("\n#ifdef __cplusplus\n}\n#endif\n#endif\n");
    out
}
