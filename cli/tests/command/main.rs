//! The `bond` command from outside: what it prints, writes and answers.

mod bench;
mod build;
mod check;
mod checkpoint;
mod choose;
mod doc;
mod docs;
mod emit;
mod ensemble;
mod fmt;
mod fmu;
mod hostile;
mod library;
mod linearize;
mod new;
mod reduce;
mod run;
mod serve;
mod show;
mod strangers;
mod test;
mod waves;

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::atomic::{AtomicU32, Ordering};

/// A mass on a spring with a damper.
const OSCILLATOR: &str = "\
model Oscillator(k = 100 N/m, m = 1 kg) {
  C:spring { stiffness = k; q0 = 0.1 m }
  I:mass = m
  R:damper = 0.5 N*s/m
  1:w -> spring, mass, damper
  probe x = spring.q
  probe v = mass.f
  simulate { stop = 1 s }
  expect max(abs(spring.q)) < 0.2 m
  expect spring.q at 0 s = 0.1 m within 1e-12 m
  expect passive
}
";

/// A mass that is pushed until its speed is infinite at 1 s.
const BLOWS_UP: &str = "\
model BlowsUp {
  I:mass { inertia = 1 kg; f0 = 1 m/s }
  active R:engine { e = -mass.f^2*(1 N*s^2/m^2) }
  1:w -> mass, engine
  probe v = mass.f
  simulate { stop = 2 s }
}
";

/// Two errors, on lines 3 and 4.
const WRONG: &str = "\
model Wrong {
  I:mass = 1 kg
  C:spring { stiffness = 1 N; q0 = 1 m }
  R:damper = 1 kg
  1:v -> mass, spring, damper
}
";

/// A file of `models/`.
fn model(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../models").join(name)
}

/// Whether a command is there; where it is not, that is said.
fn is_there(name: &str) -> bool {
    let there = Command::new(name).arg("--version").output().is_ok_and(|o| o.status.success());
    if !there {
        println!("there is no {name}: left out");
    }
    there
}

/// Runs a command of the system in a folder: what it prints.
fn ran(here: &Folder, command: &str, args: &[&str]) -> String {
    let out = Command::new(command).args(args).current_dir(&here.0).output().unwrap();
    let text = String::from_utf8_lossy(&out.stdout).into_owned();
    assert!(out.status.success(), "{command} {args:?}: {text}{}", String::from_utf8_lossy(&out.stderr));
    text
}

/// A folder of its own for a test.
struct Folder(PathBuf);

impl Folder {
    fn new() -> Self {
        static COUNT: AtomicU32 = AtomicU32::new(0);
        let n = COUNT.fetch_add(1, Ordering::Relaxed);
        let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("bond-{}-{n}", std::process::id()));
        std::fs::create_dir_all(&path).unwrap();
        Self(path)
    }

    fn with(self, name: &str, text: impl AsRef<[u8]>) -> Self {
        let path = self.0.join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, text).unwrap();
        self
    }

    fn read(&self, name: &str) -> String {
        std::fs::read_to_string(self.0.join(name)).unwrap()
    }

    /// Names of all that is in it.
    fn list(&self) -> Vec<String> {
        let mut list: Vec<String> = std::fs::read_dir(&self.0)
            .unwrap()
            .map(|e| e.unwrap().file_name().to_string_lossy().into_owned())
            .collect();
        list.sort();
        list
    }

    fn bond(&self, args: &[&str]) -> Done {
        self.fed(args, "")
    }

    /// The status of a command whose output nobody reads, and what it says.
    fn unread(&self, args: &[&str]) -> (Option<i32>, String) {
        let mut child = self.spawn(args);
        drop(child.stdin.take());
        drop(child.stdout.take());
        let output = child.wait_with_output().unwrap();
        (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
    }

    /// The command, with pipes to and from it.
    fn spawn(&self, args: &[&str]) -> Child {
        Command::new(env!("CARGO_BIN_EXE_bond"))
            .args(args)
            .current_dir(&self.0)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap()
    }

    fn fed(&self, args: &[&str], input: &str) -> Done {
        let mut child = self.spawn(args);
        // A command that does not read its input may be gone before it is written.
        let _ = child.stdin.take().unwrap().write_all(input.as_bytes());
        let done = Done::of(child.wait_with_output().unwrap());
        assert!(!done.err.contains("panicked"), "{args:?}: {}", done.err);
        assert!(!done.err.contains('\x1b') && !done.out.contains('\x1b'), "colours without a terminal: {args:?}");
        done
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// What a command answered.
#[derive(Debug)]
struct Done {
    status: i32,
    out: String,
    err: String,
}

impl Done {
    fn of(output: Output) -> Self {
        Self {
            status: output.status.code().unwrap_or(-1),
            out: String::from_utf8_lossy(&output.stdout).into_owned(),
            err: String::from_utf8_lossy(&output.stderr).into_owned(),
        }
    }

    /// Asserts the status, and that both streams say what they must.
    #[track_caller]
    fn is(self, status: i32, out: &[&str], err: &[&str]) -> Self {
        assert_eq!(self.status, status, "{self:?}");
        for text in out {
            assert!(self.out.contains(text), "`{text}` is not on standard output: {self:?}");
        }
        for text in err {
            assert!(self.err.contains(text), "`{text}` is not on standard error: {self:?}");
        }
        self
    }

    /// Header and rows of the CSV on standard output.
    fn table(&self) -> (Vec<String>, Vec<Vec<f64>>) {
        table(&self.out)
    }
}

fn table(text: &str) -> (Vec<String>, Vec<Vec<f64>>) {
    let mut lines = text.lines();
    let header = lines.next().unwrap_or("").split(',').map(String::from).collect();
    (header, lines.map(|l| l.split(',').map(|x| x.parse().unwrap()).collect()).collect())
}

#[test]
fn every_command_has_help_with_an_example() {
    let here = Folder::new();
    for command in ["new", "bench", "build", "check", "doc", "fmt", "show", "linearize", "run", "serve", "test"] {
        here.bond(&[command, "--help"]).is(0, &["Examples:", &format!("bond {command}")], &[]);
        here.bond(&["help", command]).is(0, &["Usage:"], &[]);
    }
    here.bond(&["--help"]).is(0, &["Exit status"], &[]);
    here.bond(&["--version"]).is(0, &[env!("CARGO_PKG_VERSION")], &[]);
    here.bond(&[]).is(2, &[], &["Usage:"]);
    here.bond(&["bunch"]).is(2, &[], &["unrecognized"]);
}
