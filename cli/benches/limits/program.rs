//! C programs: compiled by `cc`, run by themselves, each telling its own time.

use super::figure::Figure;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// A compiler that takes longer is stopped, s.
const PATIENCE: u64 = 12;

/// What the C by hand is compiled with.
const HAND: [&str; 3] = ["-std=gnu99", "-O3", "-march=native"];

/// A folder of temporary files, gone when this is dropped.
pub struct Folder(PathBuf);

impl Folder {
    /// A new one, with what all programs include.
    ///
    /// # Errors
    /// In words.
    pub fn new() -> Result<Self, String> {
        let folder = Self(std::env::temp_dir().join(format!("bond-limits-{}", std::process::id())));
        fs::create_dir_all(&folder.0).map_err(|e| format!("{}: {e}", folder.0.display()))?;
        for (name, text) in [
            ("bench.h", include_str!("kernels/bench.h")),
            ("bench_main.h", include_str!("kernels/bench_main.h")),
            ("scene_main.c", include_str!("kernels/scene_main.c")),
        ] {
            folder.put(name, text)?;
        }
        Ok(folder)
    }

    /// Where a file of it is.
    pub fn at(&self, name: &str) -> PathBuf {
        self.0.join(name)
    }

    /// Writes a file.
    ///
    /// # Errors
    /// In words.
    pub fn put(&self, name: &str, bytes: impl AsRef<[u8]>) -> Result<(), String> {
        fs::write(self.at(name), bytes).map_err(|e| format!("{name}: {e}"))
    }

    /// The C by hand of this name, compiled.
    ///
    /// # Errors
    /// In words.
    pub fn hand(&self, name: &str) -> Result<PathBuf, String> {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("benches/limits/kernels");
        let text = fs::read_to_string(folder.join(name).with_extension("c")).map_err(|e| format!("{name}.c: {e}"))?;
        let file = format!("hand_{name}.c");
        self.put(&file, text)?;
        self.cc(&[&HAND[..], &[&file]].concat(), &format!("hand_{name}"))
    }

    /// Compiles and links.
    ///
    /// # Errors
    /// In words: what `cc` says, or that it takes too long.
    pub fn cc(&self, arguments: &[&str], name: &str) -> Result<PathBuf, String> {
        let errors = fs::File::create(self.at("errors.txt")).map_err(|e| e.to_string())?;
        let mut child = Command::new("cc")
            .args(arguments)
            .args(["-o", name, "-lm"])
            .current_dir(&self.0)
            .stdout(Stdio::null())
            .stderr(errors)
            .spawn()
            .map_err(|e| format!("cc: {e}"))?;
        let start = Instant::now();
        loop {
            match child.try_wait().map_err(|e| e.to_string())? {
                Some(status) if status.success() => return Ok(self.at(name)),
                Some(_) => {
                    let text = fs::read_to_string(self.at("errors.txt")).unwrap_or_default();
                    return Err(format!("cc: {}", text.lines().take(5).collect::<Vec<_>>().join(" / ")));
                }
                None if start.elapsed() > Duration::from_secs(PATIENCE) => {
                    let _ = child.kill();
                    let _ = child.wait();
                    return Err(format!("cc was stopped after {PATIENCE} s"));
                }
                None => std::thread::sleep(Duration::from_millis(10)),
            }
        }
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

/// Whether there is a C compiler.
pub fn is_there() -> bool {
    Command::new("cc").arg("--version").output().is_ok_and(|o| o.status.success())
}

/// The compiler's own name and version, and the processor's.
pub fn machine() -> String {
    let cc = Command::new("cc").arg("--version").output().ok();
    let cc = cc.and_then(|o| String::from_utf8(o.stdout).ok()).and_then(|t| t.lines().next().map(str::to_string));
    let info = fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let model = info.lines().find(|l| l.starts_with("model name")).and_then(|l| l.split_once(':'));
    let model = model.map_or("an unknown processor", |(_, m)| m.trim());
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    format!("{model}, {cores} cores, {}", cc.unwrap_or_else(|| "no `cc`".into()))
}

/// What a program prints, as numbers.
fn numbers(program: &Path, arguments: &[String]) -> Result<Vec<f64>, String> {
    let out = Command::new(program).args(arguments).output().map_err(|e| format!("{}: {e}", program.display()))?;
    if !out.status.success() {
        return Err(format!("{}: {}", program.display(), String::from_utf8_lossy(&out.stderr)));
    }
    String::from_utf8_lossy(&out.stdout).split_whitespace().map(|x| x.parse().map_err(|_| format!("`{x}`"))).collect()
}

/// What a program comes to after so many steps.
///
/// # Errors
/// In words.
pub fn outcome(program: &Path, figure: &Figure, steps: u64) -> Result<Vec<f64>, String> {
    numbers(program, &["check".into(), steps.to_string(), figure.size.to_string()])
}

/// The median time of so many steps, ns.
///
/// # Errors
/// In words.
pub fn time(program: &Path, size: usize, steps: u64, reps: usize) -> Result<f64, String> {
    let list = numbers(program, &["run".into(), steps.to_string(), reps.to_string(), size.to_string()])?;
    list.first().copied().ok_or_else(|| "it said nothing".to_string())
}
