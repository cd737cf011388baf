//! Functional mock-up units: what is in them, and that their functions do what `bond run` does.

use super::{Done, Folder, is_there, model, ran};
use std::io::{Cursor, Read};
use std::process::Command;

/// What is in a unit: names and bytes.
fn unpacked(here: &Folder, name: &str) -> Vec<(String, Vec<u8>)> {
    let bytes = std::fs::read(here.0.join(name)).unwrap();
    let mut archive = zip::ZipArchive::new(Cursor::new(bytes)).unwrap();
    (0..archive.len())
        .map(|i| {
            let mut file = archive.by_index(i).unwrap();
            let mut bytes = Vec::new();
            file.read_to_end(&mut bytes).unwrap();
            (file.name().unwrap().into_owned(), bytes)
        })
        .collect()
}

/// Lays the sources of a unit into the folder; the unit's GUID.
fn sources(here: &Folder, name: &str) -> String {
    let mut guid = String::new();
    for (name, bytes) in unpacked(here, name) {
        if let Some(file) = name.strip_prefix("sources/") {
            std::fs::write(here.0.join(file), bytes).unwrap();
        } else if name == "modelDescription.xml" {
            let text = String::from_utf8(bytes).unwrap();
            guid = text.split("guid=\"").nth(1).unwrap().split('"').next().unwrap().to_string();
        }
    }
    guid
}

/// A tool that takes units, by the standard's functions.
const MASTER: &str = r#"
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
typedef struct { void (*log)(void *, const char *, int, const char *, const char *, ...); void *(*take)(size_t, size_t); void (*drop)(void *); void *ended, *env; } calls;
void *A(fmi2Instantiate)(const char *, int, const char *, const char *, const calls *, int, int);
int A(fmi2SetupExperiment)(void *, int, double, double, int, double), A(fmi2EnterInitializationMode)(void *), A(fmi2ExitInitializationMode)(void *);
int A(fmi2DoStep)(void *, double, double, int), A(fmi2GetReal)(void *, const unsigned *, size_t, double *), A(fmi2SetReal)(void *, const unsigned *, size_t, const double *);
int A(fmi2SerializedFMUstateSize)(void *, void *, size_t *), A(fmi2SerializeFMUstate)(void *, void *, char *, size_t), A(fmi2DeSerializeFMUstate)(void *, const char *, size_t, void **);
int A(fmi2GetFMUstate)(void *, void **), A(fmi2SetFMUstate)(void *, void *), A(fmi2FreeFMUstate)(void *, void **), A(fmi2Reset)(void *);
void A(fmi2FreeInstance)(void *);
static int live = 0;
static void *take(size_t n, size_t size) { ++live; return calloc(n, size); }
static void drop(void *p) { --live; free(p); }
static void say(void *env, const char *name, int status, const char *category, const char *text, ...) {
    va_list list;
    (void)env;
    va_start(list, text);
    printf("%s %d %s: ", name, status, category);
    vprintf(text, list);
    puts("");
    va_end(list);
}
static void *s;
static double get(unsigned v) { double x; if (A(fmi2GetReal)(s, &v, 1, &x)) exit(9); return x; }
static void begin(void) {
    static calls call;
    call.log = say;
    call.take = take;
    call.drop = drop;
    if (A(fmi2Instantiate)("it", 1, "{another}", "", &call, 0, 0)) exit(2);
    s = A(fmi2Instantiate)("it", 1, GUID, "", &call, 0, 0);
    if (!s || A(fmi2SetupExperiment)(s, 0, 0, 0, 0, 0) || A(fmi2EnterInitializationMode)(s) || A(fmi2ExitInitializationMode)(s)) exit(3);
}
static void end(void) {
    A(fmi2FreeInstance)(s);
    if (live) exit(4);
}
"#;

/// Builds and runs a tool around the unit: what it prints.
fn taken(here: &Folder, guid: &str, prefix: Option<&str>, main: &str) -> String {
    let p = prefix.unwrap_or_default();
    std::fs::write(
        here.0.join("master.c"),
        format!("#define A(name) {p}##name\n#define GUID \"{guid}\"\n{MASTER}{main}")
            .replace("#define A(name) ##name", "#define A(name) name"),
    )
    .unwrap();
    let define = format!("-DFMI2_FUNCTION_PREFIX={p}");
    let flags = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-O1", "-ffp-contract=off"];
    let files = ["scene.c", "slave.c", "master.c", "-lm", "-o", "master"];
    let prefix: &[&str] = if prefix.is_some() { &[&define] } else { &[] };
    ran(here, "cc", &[&flags, prefix, &files].concat());
    ran(here, "./master", &[])
}

#[test]
fn a_unit_has_all_that_tools_look_for() {
    let here = Folder::new();
    let file = model("examples/open_port.bond");
    let build = |out: &str| here.bond(&["build", file.to_str().unwrap(), "--emit", "fmu", "-o", out]);
    let said = build("my wall.fmu").is(0, &[], &["built my wall.fmu (FMI 2.0 for co-simulation", "1 open port"]);
    assert_eq!(said.out, "");
    let inside = unpacked(&here, "my wall.fmu");
    let names: Vec<&str> = inside.iter().map(|(name, _)| name.as_str()).collect();
    assert_eq!(names[..4], ["modelDescription.xml", "sources/scene.c", "sources/scene.h", "sources/slave.c"]);
    if is_there("cc") && cfg!(all(target_os = "linux", target_arch = "x86_64")) {
        assert_eq!(names[4..], ["binaries/linux64/my_wall.so"]);
    }
    let text = String::from_utf8(inside[0].1.clone()).unwrap();
    for part in [
        "fmiVersion=\"2.0\" modelName=\"Device\"",
        "modelIdentifier=\"my_wall\"",
        "name=\"tip.f\" valueReference=\"1\"",
        "<Real unit=\"m/s\" start=\"0.0\"/>",
        "<BaseUnit kg=\"1\" m=\"1\" s=\"-2\"/>",
        "stopTime=\"1.0\" stepSize=\"0.001\"",
        "<Unknown index=\"3\"/>",
    ] {
        assert!(text.contains(part), "{part}: {text}");
    }
    // The same bytes again.
    std::fs::create_dir(here.0.join("other")).unwrap();
    build("other/my wall.fmu").is(0, &[], &[]);
    assert!(
        std::fs::read(here.0.join("my wall.fmu")).unwrap() == std::fs::read(here.0.join("other/my wall.fmu")).unwrap()
    );
    build("wall.zip").is(2, &[], &["name it wall.zip.fmu"]);
    build("-").is(2, &[], &["give a name with -o"]);
    here.bond(&["build", file.to_str().unwrap(), "--emit", "fmu", "--prefix", "x"]).is(2, &[], &["--prefix is for"]);
}

/// A closed scene goes as `bond run` does.
#[test]
fn a_unit_goes_as_a_run_does() {
    if !is_there("cc") {
        return;
    }
    let here = Folder::new();
    let file = model("examples/pendulum.bond");
    let file = file.to_str().unwrap();
    here.bond(&["build", file, "--emit", "fmu", "-o", "p.fmu"]).is(0, &[], &[]);
    let guid = sources(&here, "p.fmu");
    let text = taken(
        &here,
        &guid,
        None,
        r#"
int main(void) {
    int k;
    begin();
    for (k = 0; k <= 100; ++k) {
        printf("%.17g,%.17g,%.17g,%.17g\n", get(0), get(1), get(2), get(3));
        if (A(fmi2DoStep)(s, 0.02 * k, 0.02, 1)) return 1;
    }
    end();
    return 0;
}"#,
    );
    let run = here.bond(&["run", file, "--stop", "2", "--every", "20ms", "-o", "-"]).is(0, &[], &[]).out;
    let numbers = |text: &str| -> Vec<Vec<f64>> {
        let rows = text.lines().filter(|l| !l.starts_with("t,") && l.contains(','));
        rows.map(|l| l.split(',').map(|x| x.parse().unwrap()).collect()).collect()
    };
    let (here, there) = (numbers(&text), numbers(&run));
    assert_eq!(here.len(), there.len());
    for (a, b) in here.iter().flatten().zip(there.iter().flatten()) {
        assert!((a - b).abs() <= 1e-9 * b.abs().max(1.0), "{a} {b}");
    }
}

/// Whatever the communication steps, the unit counts the energy that goes through its port: what it holds times what
/// the outside moves. States go back to the bit, and what is wrong is refused.
#[test]
fn a_port_of_a_unit_counts_what_goes_through() {
    if !is_there("cc") {
        return;
    }
    let here = Folder::new();
    let file = model("examples/open_port.bond");
    here.bond(&["build", file.to_str().unwrap(), "--emit", "fmu", "-o", "w.fmu"]).is(0, &[], &[]);
    let guid = sources(&here, "w.fmu");
    let text = taken(
        &here,
        &guid,
        Some("wall_"),
        r#"
static double t, work;
/* Whether a step was taken: a third of an interval, at a speed that goes to and fro. */
static void third(int k) {
    const unsigned tip = 1;
    const double step = 1e-3 / 3, speed = 2 * (k % 40 < 25 ? 1 : -1.5);
    if (A(fmi2SetReal)(s, &tip, 1, &speed)) exit(5);
    work += get(2) * speed * step;
    t = k * step;
    if (A(fmi2DoStep)(s, t, step, 0)) exit(6);
}
int main(void) {
    int k;
    void *before = 0;
    double e, q;
    const unsigned none = 99, tip = 1;
    begin();
    for (k = 0; k < 100; ++k) third(k);
    if (A(fmi2GetFMUstate)(s, &before)) return 7;
    for (; k < 300; ++k) third(k);
    printf("%.17g %.17g %.3f\n", work, get(6), get(0));
    e = get(2), q = get(3);
    if (A(fmi2SetFMUstate)(s, before)) return 8;
    for (k = 100; k < 300; ++k) third(k);
    if (get(2) != e || get(3) != q || A(fmi2FreeFMUstate)(s, &before)) return 10;
    e = 0;
    e = e / e;
    if (A(fmi2GetReal)(s, &none, 1, &q) != 3 || A(fmi2SetReal)(s, &none, 1, &q) != 3 || A(fmi2SetReal)(s, &tip, 1, &e) != 2) return 11;
    if (A(fmi2DoStep)(s, 5, 1e-3, 0) != 3 || A(fmi2SetupExperiment)(s, 0, 0, 0, 0, 0) != 3) return 12;
    if (A(fmi2Reset)(s) || get(0) != 0 || get(6) != 0) return 13;
    if (A(fmi2SetupExperiment)(s, 0, 0, 1, 0, 0) != 3) return 14;
    end();
    return 0;
}"#,
    );
    let line = text.lines().find(|l| l.ends_with("0.100")).unwrap_or_else(|| panic!("{text}"));
    let numbers: Vec<f64> = line.split(' ').map(|x| x.parse().unwrap()).collect();
    assert!(numbers[0].abs() > 1e-3 && (numbers[0] - numbers[1]).abs() < 1e-12, "{text}");
    for part in [
        "GUID is not that of this unit",
        "no variable of this value reference",
        "another communication point",
        "starts at t = 0",
    ] {
        assert!(text.contains(part), "{part}: {text}");
    }
}

/// Bytes of the right length are a state only where this unit wrote them.
#[test]
fn bytes_that_are_no_state_are_refused() {
    if !is_there("cc") {
        return;
    }
    let here = Folder::new();
    let file = model("examples/open_port.bond");
    let main = r#"
int main(int argc, char **argv) {
    void *at = 0, *back = 0;
    char *bytes, *garbage;
    size_t size, i;
    double x;
    FILE *f;
    begin();
    for (i = 0; i < 5; ++i) if (A(fmi2DoStep)(s, 1e-3 * (double)i, 1e-3, 1)) return 5;
    if (A(fmi2GetFMUstate)(s, &at) || A(fmi2SerializedFMUstateSize)(s, at, &size)) return 6;
    bytes = calloc(size, 1), garbage = calloc(size, 1);
    if (A(fmi2SerializeFMUstate)(s, at, bytes, size - 1) != 3 || A(fmi2SerializeFMUstate)(s, at, bytes, size)) return 7;
    x = get(2);
    if (argc > 1) {
        /* The state of another unit, with as many bytes. */
        f = fopen(argv[1], "rb");
        if (!f || fread(garbage, 1, size, f) != size || fclose(f)) return 8;
        if (A(fmi2DeSerializeFMUstate)(s, garbage, size, &back) != 3 || back) return 9;
    }
    for (i = 0; i < size; ++i) garbage[i] = (char)(31 * i + 7);
    if (A(fmi2DeSerializeFMUstate)(s, garbage, size, &back) != 3 || back) return 10;
    memset(garbage, 0, size);
    if (A(fmi2DeSerializeFMUstate)(s, garbage, size, &back) != 3 || back) return 11;
    for (i = 0; i < size; ++i) {
        bytes[i] = (char)(bytes[i] ^ 4);
        if (A(fmi2DeSerializeFMUstate)(s, bytes, size, &back) != 3 || back) return 12;
        bytes[i] = (char)(bytes[i] ^ 4);
    }
    if (A(fmi2DeSerializeFMUstate)(s, bytes, size - 1, &back) != 3 || back) return 13;
    if (A(fmi2Reset)(s) || A(fmi2DeSerializeFMUstate)(s, bytes, size, &back) || A(fmi2SetFMUstate)(s, back)) return 14;
    if (get(2) != x || get(0) < 0.0049) return 15;
    f = fopen("state", "wb");
    if (!f || fwrite(bytes, 1, size, f) != size || fclose(f)) return 16;
    free(bytes), free(garbage);
    if (A(fmi2FreeFMUstate)(s, &at) || A(fmi2FreeFMUstate)(s, &back)) return 17;
    end();
    return 0;
}"#;
    here.bond(&["build", file.to_str().unwrap(), "--emit", "fmu", "-o", "a.fmu"]).is(0, &[], &[]);
    let guid = sources(&here, "a.fmu");
    let said = taken(&here, &guid, None, main);
    assert!(said.contains("these bytes are no state of this unit, or were changed"), "{said}");
    here.bond(&["build", file.to_str().unwrap(), "--emit", "fmu", "--set", "wall.k=900", "-o", "b.fmu"]).is(
        0,
        &[],
        &[],
    );
    let guid = sources(&here, "b.fmu");
    taken(&here, &guid, None, main);
    std::fs::rename(here.0.join("state"), here.0.join("of_b")).unwrap();
    let guid = sources(&here, "a.fmu");
    taken(&here, &guid, None, main);
    ran(&here, "./master", &["of_b"]);
}

/// A unit cuts no step where a law switches. So `exact`, which must, is not its stepper where a source switches, and
/// what it shows differs from a run by the error of `gonzalez`, which at half the step is a quarter of it.
#[test]
fn a_source_that_switches_is_stepped_by_gonzalez() {
    if !is_there("cc") {
        return;
    }
    let here = Folder::new();
    let file = model("examples/quarter_car.bond");
    let file = file.to_str().unwrap();
    let main = "int main(void) {\n    int k;\n    begin();\n    for (k = 0; k <= 50; ++k) {\n        \
                printf(\"%.17g,%.17g\\n\", get(0), get(1));\n        \
                if (A(fmi2DoStep)(s, 0.02 * k, 0.02, 1)) return 1;\n    }\n    end();\n    return 0;\n}";
    let numbers = |text: &str| -> Vec<(f64, f64)> {
        let rows = text.lines().filter(|l| l.starts_with(|c: char| c.is_ascii_digit()) && l.contains(','));
        let row = |l: &str| {
            let mut numbers = l.split(',').map(|x| x.parse().unwrap());
            (numbers.next().unwrap(), numbers.next().unwrap())
        };
        rows.map(row).collect()
    };
    let off = |a: &[(f64, f64)], b: &[(f64, f64)]| {
        assert_eq!((a.len(), b.len()), (51, 51));
        assert!(a.iter().zip(b).all(|(a, b)| (a.0 - b.0).abs() < 1e-12));
        a.iter().zip(b).map(|(a, b)| (a.1 - b.1).abs()).fold(0.0, f64::max)
    };
    let run = ["run", file, "--stop", "1", "--every", "20ms", "-o", "-", "--step"];
    let away = ["1ms", "0.5ms"].map(|step| {
        here.bond(&["build", file, "--emit", "fmu", "--step", step, "-o", "q.fmu"]).is(
            0,
            &[],
            &["stepped by gonzalez"],
        );
        let guid = sources(&here, "q.fmu");
        let unit = numbers(&taken(&here, &guid, None, main));
        let alike = here.bond(&[&run[..], &[step, "--method", "gonzalez"]].concat()).is(0, &[], &[]).out;
        assert!(off(&unit, &numbers(&alike)) < 1e-12, "{step}: {:e}", off(&unit, &numbers(&alike)));
        off(&unit, &numbers(&here.bond(&[&run[..], &[step]].concat()).is(0, &[], &[]).out))
    });
    assert!(away[0] < 1e-4 && (3.9..4.1).contains(&(away[0] / away[1])), "{away:?}");
}

/// What is set before and in the initialization is so at t = 0: samples take it, of slower regions too, and what holds.
#[test]
fn inputs_of_the_start_are_met_by_its_samples() {
    if !is_there("cc") {
        return;
    }
    let here = Folder::new();
    let scene = "model S {
  input u = 1 N
  input w = 0 N
  sampled every 0.1 s { state last = 0 N { next = u }  Se:s = u  C:c = 1 m/N  R:r = 1 N*s/m  s -> 1:x -> r, c }
  sampled every 0.2 s { state slow = 0 N { next = w + m.p/(1 s) } }
  I:m = 1 kg
  R:b = 1 N*s/m
  1:v -> m, b
  v ||> x
  probe speed = v.f
  probe F = s.e
  probe l = last
  probe k = slow
  simulate { step = 10 ms; stop = 0.5 s }
}";
    std::fs::write(here.0.join("s.bond"), scene).unwrap();
    std::fs::write(here.0.join("in.csv"), "t,u,w\n0,5,3\n1,5,3\n").unwrap();
    here.bond(&["build", "s.bond", "--emit", "fmu", "-o", "s.fmu"]).is(0, &[], &[]);
    let guid = sources(&here, "s.fmu");
    let main = r#"
static void row(void) { printf("%.17g,%.17g,%.17g,%.17g,%.17g\n", get(0), get(3), get(4), get(5), get(6)); }
static void run(int k, int end) { for (; k < end; ++k) { row(); if (A(fmi2DoStep)(s, 0.1 * k, 0.1, 1)) exit(5); } }
static void set(unsigned v, double x) { if (A(fmi2SetReal)(s, &v, 1, &x)) exit(6); }
int main(void) {
    void *at = 0;
    begin();
    if (A(fmi2Reset)(s)) return 7;
    set(1, 4), set(1, 5);
    if (A(fmi2EnterInitializationMode)(s)) return 8;
    set(2, 3);
    if (get(4) != 5 || A(fmi2GetFMUstate)(s, &at)) return 9;
    set(1, 7);
    if (get(4) != 7 || A(fmi2SetFMUstate)(s, at) || get(4) != 5) return 10;
    if (A(fmi2ExitInitializationMode)(s)) return 11;
    run(0, 5), row();
    /* Later ones count from the interval that runs. */
    if (A(fmi2SetFMUstate)(s, at)) return 12;
    set(1, 8);
    if (get(4) != 5) return 13;
    if (A(fmi2Reset)(s) || get(1) != 1 || get(4) != 1 || A(fmi2FreeFMUstate)(s, &at)) return 14;
    end();
    return 0;
}"#;
    let text = taken(&here, &guid, None, main);
    let run = here.bond(&["run", "s.bond", "--input", "in.csv", "--every", "0.1s", "-o", "-"]).is(0, &[], &[]).out;
    let numbers = |text: &str| -> Vec<Vec<f64>> {
        let rows = text.lines().filter(|l| !l.starts_with("t,") && l.contains(',') && !l.starts_with("it "));
        rows.map(|l| l.split(',').map(|x| x.parse().unwrap()).collect()).collect()
    };
    let (here, there) = (numbers(&text), numbers(&run));
    assert_eq!((here.len(), there.len()), (6, 6), "{text}{run}");
    for (a, b) in here.iter().flatten().zip(there.iter().flatten()) {
        assert!((a - b).abs() <= 1e-12, "{a} {b}: {text}{run}");
    }
}

/// What is on its way in delays is of a unit's state: one that is put back goes on as it did, as a run does.
#[test]
fn delays_of_a_unit_are_in_its_state() {
    if !is_there("cc") {
        return;
    }
    let here = Folder::new();
    let scene = "model S {
  state x = 1 { dx = -delay(x, 1 s, 1)*1 Hz }
  Se:u = 1 V*x
  R:r = 2 Ohm
  TL(a, b):line { impedance = 4 Ohm; delay = 0.33 s }
  C:end = 0.05 F
  u -> 1:in -> r, line.a
  line.b -> end
  probe y = x
  probe far = line.b.e
  simulate { step = 50 ms; stop = 4 s }
}";
    std::fs::write(here.0.join("s.bond"), scene).unwrap();
    here.bond(&["build", "s.bond", "--emit", "fmu", "-o", "s.fmu"]).is(0, &[], &[]);
    let guid = sources(&here, "s.fmu");
    let main = r#"
static void run(int k, int end) {
    for (; k <= end; ++k) {
        printf("%.17g,%.17g,%.17g\n", get(0), get(1), get(2));
        if (A(fmi2DoStep)(s, 0.1 * k, 0.1, 1)) exit(5);
    }
}
int main(void) {
    void *at = 0;
    begin();
    run(0, 19);
    if (A(fmi2GetFMUstate)(s, &at)) return 6;
    run(20, 40);
    if (A(fmi2SetFMUstate)(s, at)) return 7;
    run(20, 40);
    if (A(fmi2FreeFMUstate)(s, &at)) return 8;
    end();
    return 0;
}"#;
    let text = taken(&here, &guid, None, main);
    let run = here.bond(&["run", "s.bond", "--every", "0.1s", "-o", "-"]).is(0, &[], &[]).out;
    let numbers = |text: &str| -> Vec<Vec<f64>> {
        let rows = text.lines().filter(|l| !l.starts_with("t,") && l.contains(',') && !l.starts_with("it "));
        rows.map(|l| l.split(',').map(|x| x.parse().unwrap()).collect()).collect()
    };
    let (here, there) = (numbers(&text), numbers(&run));
    assert_eq!((here.len(), there.len()), (62, 41), "{text}{run}");
    assert_eq!(here[..41], there);
    assert_eq!(here[20..41], here[41..]);
}

/// Without a C compiler there is the source alone, and that is said; one that fails is told with its words.
#[cfg(unix)]
#[test]
fn units_without_a_compiler_are_source() {
    let here = Folder::new();
    let file = model("examples/open_port.bond");
    let args = ["build", file.to_str().unwrap(), "--emit", "fmu", "-o", "w.fmu"];
    let with = |compiler: &str| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_bond"));
        Done::of(command.args(args).current_dir(&here.0).env("CC", compiler).output().unwrap())
    };
    with("no_such_compiler").is(0, &[], &["as C alone: no C compiler was found"]);
    assert_eq!(unpacked(&here, "w.fmu").len(), 4);
    with("false").is(2, &[], &["false does not make a library"]);
    with("false -O1").is(2, &[], &["false does not make a library"]);
}
