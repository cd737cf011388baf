//! Many scenes side by side: a loop over lanes in which nothing branches, so that a C compiler does several at once;
//! and what the header says of them.
//!
//! Functions of `libm` are none that several lanes take at once: a loop of their own stands between those of the rest,
//! and numbers that go from one loop to a later one are in the lanes' own room.

use super::Options;
use super::print::{LaneWords, Needs, Words, wrapped};
use crate::backend::code::{Cond, Memory, Op, Stmt, Value};
use crate::backend::if_conversion::{LaneForm, Line, is_call};
use crate::backend::standalone::StandaloneModule;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;

/// When lanes go in another way.
struct LaneOptions {
    /// Where more than this part of all lanes are slow, all go one by one for a while,
    alone: u32,
    /// or, where more than this part are and there is such a form, by the form that has fewer slow ones.
    long: u32,
    /// The while, intervals.
    intervals: u32,
}

impl Default for LaneOptions {
    fn default() -> Self {
        Self { alone: 2, long: 8, intervals: 15 }
    }
}

/// What the header says.
pub(super) fn header(unit: &StandaloneModule, options: &Options) -> String {
    let (p, upper) = (&options.prefix, options.prefix.to_uppercase());
    let numbers = match unit.lane_forms.iter().map(|form| Loops::of(form).room).max() {
        Some(room) => {
            let room = if room == 0 {
                String::new()
            } else {
                format!("    {p}_real w[{room}][{upper}_LANES]; /* what an interval computes on its way */\n")
            };
            format!(
                "    {p}_real x[{}][{upper}_LANES]; /* the first {upper}_SAVED go from interval to interval */\n{room}    \
                 {p}_state one; /* a scene that goes by itself for once */\n    \
                 {p}_real slow[{upper}_LANES]; /* which ones that are */\n    int plain; /* for how many intervals all do */\n{}",
                unit.image.len(),
                if unit.lane_forms.len() > 1 {
                    "    int turns; /* for how many intervals iterations go on together */\n"
                } else {
                    ""
                }
            )
        }
        None => format!("    {p}_state one[{upper}_LANES]; /* one after the other: this scene has no other form */\n"),
    };
    let run = if unit.open.is_empty() {
        format!(
            "/* Goes so many intervals on: as many commits. */\nint {p}_lanes_run({p}_lanes *b, unsigned long intervals);\n\n"
        )
    } else {
        String::new()
    };
    format!(
        "
/* Define {upper}_LANES for all files, as by -D{upper}_LANES=64, to have so many scenes side by side in one {p}_lanes: of best a multiple of
   16, and not less than 64. */
#ifdef {upper}_LANES

/* Scenes side by side, each a lane: plain data. A lane has the numbers of a scene that runs alone, to the last bit. */
typedef struct {p}_lanes {{
{numbers}    int failed[{upper}_LANES]; /* 0, or why the lane stands still; set it to 0 to have it try again, to another number to leave it out */
}} {p}_lanes;

/* Puts all lanes at the start; those that you have no scene for go along, and cost no more than the others. */
void {p}_lanes_init({p}_lanes *b);

/* Puts a scene into a lane, and takes one out: bit for bit. A lane that is none is left alone. */
void {p}_lanes_put({p}_lanes *b, int lane, const {p}_state *from);
void {p}_lanes_get(const {p}_lanes *b, int lane, {p}_state *to);

/* As {p}_output, for all lanes: first the first port's numbers, one a lane, then the next one's. */
void {p}_lanes_output(const {p}_lanes *b, {p}_real *out);

/* As {p}_commit, for all lanes; what the outside did is in the order of {p}_lanes_output. A lane whose interval fails stands still as
   that found it, and is left out until you say otherwise; the others go on. Returns how many lanes stand still. */
int {p}_lanes_commit({p}_lanes *b, const {p}_real *moved);

{run}/* As {p}_input, for one lane. */
void {p}_lanes_input({p}_lanes *b, int lane, int input, {p}_real value);

/* How many bytes {p}_lanes takes. */
unsigned long {p}_lanes_size(void);
#endif
"
    )
}

/// The functions.
pub(super) fn source(unit: &StandaloneModule, options: &Options, needs: &mut Needs) -> String {
    let (p, lanes) = (&options.prefix, format!("{}_LANES", options.prefix.to_uppercase()));
    let ports = unit.open.len();
    let (own, place, gather) = match ports {
        0 => (String::new(), "moved", String::new()),
        _ => (
            format!("    bond_real own[{ports}];\n    unsigned long i;\n"),
            "own",
            format!("    for (i = 0; i < {ports}; ++i) own[i] = moved[i * {lanes} + (unsigned long)lane];\n"),
        ),
    };
    let mut out = String::new();
    let each = format!("for (l = 0; l < {lanes}; ++l)");
    let is_lane = format!("lane >= 0 && lane < {lanes}");
    let saved = unit.kept;
    let mut places = BTreeSet::new();
    touched(&unit.commit.body, &mut places);
    let count = places.len();
    match &unit.lane_forms[..] {
        [first, more @ ..] => {
            let list: Vec<u32> = places.iter().copied().collect();
            super::print::table(&mut out, "static const unsigned places[]", &list);
            out.push('\n');
            let data = !unit.commit.data.is_empty();
            out.push_str(&function(first, "lanes", (p, &lanes), data, needs));
            // Which form, and when it is another one.
            let LaneOptions { alone, long: long_part, intervals } = LaneOptions::default();
            let (mut form, mut next) =
                ("lanes(b, moved)".to_string(), format!("if (slow > {lanes} / {alone}) b->plain = {intervals};"));
            if let Some(long) = more.first() {
                out.push_str(&function(long, "turns", (p, &lanes), data, needs));
                form = "b->turns > 0 ? turns(b, moved) : lanes(b, moved)".into();
                next = format!(
                    "if (b->turns > 0) {{\n            --b->turns;\n            if (slow > {lanes} / {alone}) b->plain = {intervals};\n        \
                     }} else if (slow > {lanes} / {long_part}) {{\n            b->turns = {intervals};\n        }}"
                );
            }
            let _ = write!(
                out,
                "static void alone({p}_lanes *b, int lane, const bond_real *moved) {{\n{own}    unsigned long k;\n{gather}    \
                 for (k = 0; k < {count}; ++k) b->one.x[places[k]] = b->x[places[k]][lane];\n    \
                 b->failed[lane] = commit(b->one.x, {place}, 0, b->one.s);\n    if (b->failed[lane]) return;\n    \
                 for (k = 0; k < {count}; ++k) b->x[places[k]][lane] = b->one.x[places[k]];\n}}\n\n\
                 void {p}_lanes_init({p}_lanes *b) {{\n    int k, l;\n    memset(b, 0, sizeof *b);\n    \
                 for (k = 0; k < {saved}; ++k) {each} b->x[k][l] = start[k];\n}}\n\n\
                 void {p}_lanes_put({p}_lanes *b, int lane, const {p}_state *from) {{\n    int k;\n    if (!({is_lane})) return;\n    \
                 b->failed[lane] = 0;\n    for (k = 0; k < {saved}; ++k) b->x[k][lane] = from->x[k];\n}}\n\n\
                 void {p}_lanes_get(const {p}_lanes *b, int lane, {p}_state *to) {{\n    int k;\n    if (!({is_lane})) return;\n    \
                 memset(to, 0, sizeof *to);\n    for (k = 0; k < {saved}; ++k) to->x[k] = b->x[k][lane];\n}}\n\n\
                 int {p}_lanes_commit({p}_lanes *b, const bond_real *moved) {{\n    int l, still = 0;\n\
                 #if BOND_SIMD\n    int slow = 0;\n    \
                 if (b->plain > 0) {{\n        --b->plain;\n        {each} if (!b->failed[l]) alone(b, l, moved);\n    \
                 }} else {{\n        if ({form}) {{\n            {each} {{\n                if (b->slow[l] == 0 || b->failed[l]) continue;\n                \
                 alone(b, l, moved);\n                ++slow;\n            }}\n        }}\n        {next}\n    }}\n\
                 #else\n    {each} if (!b->failed[l]) alone(b, l, moved);\n#endif\n    \
                 {each} still += b->failed[l] != 0;\n    return still;\n}}\n\n"
            );
        }
        [] => {
            let _ = write!(
                out,
                "static void alone({p}_lanes *b, int lane, const bond_real *moved) {{\n{own}{gather}    \
                 b->failed[lane] = {p}_commit(&b->one[lane], {place});\n}}\n\n\
                 void {p}_lanes_init({p}_lanes *b) {{\n    int l;\n    {each} {{\n        {p}_init(&b->one[l]);\n        b->failed[l] = 0;\n    }}\n}}\n\n\
                 void {p}_lanes_put({p}_lanes *b, int lane, const {p}_state *from) {{\n    if (!({is_lane})) return;\n    \
                 b->failed[lane] = 0;\n    b->one[lane] = *from;\n}}\n\n\
                 void {p}_lanes_get(const {p}_lanes *b, int lane, {p}_state *to) {{\n    if ({is_lane}) *to = b->one[lane];\n}}\n\n\
                 int {p}_lanes_commit({p}_lanes *b, const bond_real *moved) {{\n    int l, still = 0;\n    {each} {{\n        \
                 if (!b->failed[l]) alone(b, l, moved);\n        still += b->failed[l] != 0;\n    }}\n    return still;\n}}\n\n"
            );
        }
    }
    let number = |at: String, lane: &str| match unit.lane_forms.is_empty() {
        false => format!("b->x[{at}][{lane}]"),
        true => format!("b->one[{lane}].x[{at}]"),
    };
    if unit.open.is_empty() {
        let _ = write!(
            out,
            "int {p}_lanes_run({p}_lanes *b, unsigned long intervals) {{\n    int l, still = 0;\n    {each} still += b->failed[l] != 0;\n    \
             for (; intervals > 0 && still < {lanes}; --intervals) still = {p}_lanes_commit(b, 0);\n    return still;\n}}\n\n\
             void {p}_lanes_output(const {p}_lanes *b, bond_real *out) {{\n    (void)b;\n    (void)out;\n}}\n\n"
        );
    } else {
        let _ = writeln!(out, "void {p}_lanes_output(const {p}_lanes *b, bond_real *out) {{\n    int l;");
        for (i, o) in unit.open.iter().enumerate() {
            let sign = if o.sign < 0.0 { "-" } else { "" };
            let _ = writeln!(out, "    {each} out[{i} * {lanes} + l] = {sign}{};", number(o.at.to_string(), "l"));
        }
        out.push_str("}\n\n");
    }
    let _ = writeln!(out, "void {p}_lanes_input({p}_lanes *b, int lane, int input, bond_real value) {{");
    match unit.inputs.first() {
        None => out.push_str("    (void)b;\n    (void)lane;\n    (void)input;\n    (void)value;\n"),
        Some(first) => {
            let (n, to) = (unit.inputs.len(), number(format!("{} + input", first.at), "lane"));
            let _ = writeln!(out, "    if ({is_lane} && input >= 0 && input < {n}) {to} = value;");
        }
    }
    let _ = writeln!(
        out,
        "}}\n\nunsigned long {p}_lanes_size(void) {{\n    return (unsigned long)sizeof({p}_lanes);\n}}\n"
    );
    out
}

/// The places of the block that statements look at or change.
fn touched(body: &[Stmt], places: &mut BTreeSet<u32>) {
    for s in body {
        if let Stmt::Let(_, Op::Load(p)) | Stmt::Store(p, _) = s
            && p.memory == Memory::State
        {
            places.insert(p.base);
        }
        s.inner().into_iter().for_each(|body| touched(body, places));
    }
}

/// A lane form as loops over the lanes.
struct Loops<'a> {
    list: Vec<Loop<'a>>,
    /// In which loop a value is computed; none for those that are loaded wherever they are looked at.
    of: BTreeMap<Value, usize>,
    loads: BTreeMap<Value, &'a Op>,
    /// Places of the room that values have which a later loop looks at.
    places: BTreeMap<Value, usize>,
    /// How many places there are.
    room: usize,
}

/// One loop.
struct Loop<'a> {
    lines: Vec<&'a Line>,
    /// Whether it is of functions that take long.
    calls: bool,
}

impl<'a> Loops<'a> {
    fn of(form: &'a LaneForm) -> Self {
        let mut loops =
            Self { list: Vec::new(), of: BTreeMap::new(), loads: BTreeMap::new(), places: BTreeMap::new(), room: 0 };
        // Those with odd numbers are of functions that take long.
        let mut list: Vec<Vec<&Line>> = vec![Vec::new()];
        for line in &form.body {
            if matches!(line.op, Op::Load(_)) {
                loops.loads.insert(line.value, &line.op);
                continue;
            }
            let mut at = 0;
            each(line, &mut |v| at = at.max(loops.of.get(&v).copied().unwrap_or(0)));
            // Each has its own kind: a call comes after what it is given, and before what it is given to.
            at += if is_call(&line.op) { 1 + at % 2 } else { at % 2 };
            loops.of.insert(line.value, at);
            if list.len() <= at {
                list.resize_with(at + 1, Vec::new);
            }
            list[at].push(line);
        }
        // What is written is written at the end, by a loop of the even kind.
        if list.len().is_multiple_of(2) {
            list.push(Vec::new());
        }
        let parts = list.into_iter().enumerate();
        loops.list = parts.map(|(k, lines)| Loop { lines, calls: k % 2 == 1 }).collect();
        loops.place(form);
        loops
    }

    /// What a loop looks at.
    fn uses(&self, k: usize, form: &LaneForm) -> BTreeSet<Value> {
        let mut uses = BTreeSet::new();
        let mut note = |v| {
            uses.insert(v);
        };
        self.list[k].lines.iter().for_each(|line| each(line, &mut note));
        if k + 1 == self.list.len() {
            form.slow.each_value(&mut note);
            form.writes.iter().for_each(|w| note(w.1));
        }
        uses
    }

    /// Gives room to what goes from loop to loop, that of others where they are not looked at any more.
    fn place(&mut self, form: &LaneForm) {
        let mut last: BTreeMap<Value, usize> = BTreeMap::new();
        for k in 0..self.list.len() {
            for v in self.uses(k, form) {
                if self.of.get(&v).is_some_and(|of| *of < k) {
                    last.insert(v, k);
                }
            }
        }
        let mut free: Vec<usize> = Vec::new();
        let mut busy: Vec<(usize, usize)> = Vec::new();
        for k in 0..self.list.len() {
            busy.retain(|(until, place)| {
                let done = *until < k;
                if done {
                    free.push(*place);
                }
                !done
            });
            for line in &self.list[k].lines {
                let Some(until) = last.get(&line.value) else { continue };
                let place = free.pop().unwrap_or_else(|| {
                    self.room += 1;
                    self.room - 1
                });
                busy.push((*until, place));
                self.places.insert(line.value, place);
            }
        }
    }
}

/// The values that a line looks at.
fn each(line: &Line, f: &mut impl FnMut(Value)) {
    line.op.each_value(f);
    line.when.iter().for_each(|v| f(*v));
}

/// The function of this name that takes an interval of all lanes but those that are slow, and tells whether there are
/// any.
fn function(form: &LaneForm, name: &str, (p, lanes): (&str, &str), data: bool, needs: &mut Needs) -> String {
    let loops = Loops::of(form);
    let lane_words = LaneWords { lanes, flags: &form.flags };
    let mut words = Words { numbers: &form.numbers, lane_words: Some(lane_words), late: &[], tables: &[], needs };
    let uses = |m: Memory| loops.loads.values().any(|op| matches!(op, Op::Load(p) if p.memory == m));
    let mut out = format!(
        "#if BOND_SIMD\n/* All lanes at once. Whether one is slow: its numbers stay, and it goes by itself. Here is no branch, so that a compiler finds vectors. */\n\
         static int {name}({p}_lanes *restrict b, const bond_real *restrict u) {{\n    bond_mask any = 0;\n    int l;\n"
    );
    words.needs.insert("bond_pick");
    if uses(Memory::Table) {
        out.push_str("    const bond_real *const c = table;\n");
    }
    if data && uses(Memory::Data) {
        out.push_str("    const bond_real *const d = commit_data;\n");
    }
    if !uses(Memory::Input) {
        out.push_str("    (void)u;\n");
    }
    let flag = |v: &Value| form.flags.contains(v);
    for k in 0..loops.list.len() {
        let _ = writeln!(out, "    for (l = 0; l < {lanes}; ++l) {{");
        for v in loops.uses(k, form) {
            if let Some(op) = loops.loads.get(&v) {
                let _ = writeln!(out, "        const bond_real v{} = {};", v.0, words.op(op));
            } else if let Some(place) = loops.places.get(&v).filter(|_| loops.of.get(&v).is_some_and(|of| *of < k)) {
                let _ = match flag(&v) {
                    true => writeln!(out, "        const bond_mask v{} = BOND_IF(b->w[{place}][l] != 0);", v.0),
                    false => writeln!(out, "        const bond_real v{} = b->w[{place}][l];", v.0),
                };
            }
        }
        let mut when = None;
        for line in &loops.list[k].lines {
            let v = line.value;
            if loops.list[k].calls {
                if when != line.when {
                    out.push_str(if when.is_some() { "        }\n" } else { "" });
                    if let Some(c) = line.when {
                        let _ = writeln!(out, "        if ({}) {{", words.cond(&Cond::True(c)));
                    }
                    when = line.when;
                }
                let indent = if when.is_some() { "            " } else { "        " };
                let (place, e) = (loops.places.get(&v).copied().unwrap_or(0), words.op(&line.op));
                let _ = writeln!(out, "{indent}b->w[{place}][l] = {e};");
                continue;
            }
            let _ = match flag(&v) {
                true => writeln!(out, "        const bond_mask v{} = {};", v.0, words.truth(&line.op)),
                false => writeln!(out, "        const bond_real v{} = {};", v.0, words.op(&line.op)),
            };
            if let Some(place) = loops.places.get(&v) {
                let _ = match flag(&v) {
                    true => writeln!(out, "        b->w[{place}][l] = bond_pick(v{}, BOND_R(1.0), BOND_R(0.0));", v.0),
                    false => writeln!(out, "        b->w[{place}][l] = v{};", v.0),
                };
            }
        }
        out.push_str(if when.is_some() { "        }\n" } else { "" });
        if k + 1 == loops.list.len() {
            let slow = match form.slow.known() {
                Some(_) => String::new(),
                None => format!(" | {}", wrapped(&words.cond(&form.slow))),
            };
            let _ = writeln!(out, "        const bond_mask slow = BOND_IF(b->failed[l] != 0){slow};");
            for (at, v) in &form.writes {
                let _ = writeln!(out, "        b->x[{at}][l] = bond_pick(slow, b->x[{at}][l], {});", words.of(*v));
            }
            out.push_str("        b->slow[l] = bond_pick(slow, BOND_R(1.0), BOND_R(0.0));\n        any |= slow;\n");
        }
        out.push_str("    }\n");
    }
    out.push_str("    return any != 0;\n}\n#endif\n\n");
    out
}
