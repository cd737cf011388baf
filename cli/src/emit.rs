//! What `bond build` writes besides executables: the forms of [`bond_compiler::backend::EMITTERS`].

use crate::output;
use crate::report;
use crate::stop::Stop;
use crate::summary::MAX_LISTED;
use bond::internal::{CompiledInternals, StepsInternals};
use bond::{Compiled, Steps};
use bond_compiler::backend::emitter::{Archive, Emitted, Emitter, Request};
use bond_compiler::backend::{c, standalone};
use bond_compiler::discretise::{is_uncut, switching};
use std::ffi::{OsStr, OsString};
use std::io::{Cursor, Write};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// How it is written.
pub struct Emission<'a> {
    /// The model's file.
    pub file: &'a Path,
    /// The file to write; the header goes beside it.
    pub output: Option<&'a Path>,
    /// The step of continuous regions, s.
    pub step: Option<f64>,
    /// What public names begin with.
    pub prefix: &'a str,
}

impl Emission<'_> {
    /// Writes a scene in a form.
    ///
    /// # Errors
    /// A scene that has no such form, a C compiler that refuses it, a file that cannot be written.
    pub fn write(&self, emitter: &Emitter, compiled: &Compiled) -> Result<(), Stop> {
        let (path, beside) = self.places(emitter, compiled)?;
        let unit = self.unit(compiled)?;
        let request = Request {
            scene: compiled.scene(),
            unit: &unit,
            name: &path.file_stem().map(OsStr::to_string_lossy).unwrap_or_default(),
            prefix: self.prefix,
            header: &last(&beside),
            stop: compiled.stages().model.settings.stop,
        };
        let built = match (emitter.emit)(&request).map_err(Stop::Model)? {
            Emitted::File(bytes, about) => {
                output::put_bytes(&path, &bytes)?;
                format!("{} ({about})", path.display())
            }
            Emitted::WithHeader(bytes, header) => {
                not_of_another(&beside, c::goes_with_object(&header) == Some(true))?;
                output::put_both((&beside, header.as_bytes()), (&path, &bytes))?;
                format!("{} and {}", path.display(), beside.display())
            }
            Emitted::Archive(archive) => {
                let (bytes, with) = packed(&archive)?;
                output::put_bytes(&path, &bytes)?;
                format!("{} ({}, {with})", path.display(), archive.about)
            }
        };
        self.tell(compiled, &unit, &built)
    }

    /// Says what was written, and what a run of it does besides.
    fn tell(&self, compiled: &Compiled, unit: &standalone::StandaloneModule, built: &str) -> Result<(), Stop> {
        let count = |n: usize, what: &str| format!("{n} {what}{}", if n == 1 { "" } else { "s" });
        report::say(&format!(
            "built {built}: intervals of {:?} s, {}, {}, {}",
            unit.interval,
            count(unit.open.len(), "open port"),
            count(unit.inputs.len(), "input"),
            count(unit.probes.len(), "probe"),
        ));
        let settings = &compiled.stages().model.settings;
        let stop = settings.stop.unwrap_or(1.0);
        let options = self.options(compiled)?;
        let wanted = options.step.unwrap_or(options.default_step);
        let h = unit.interval / (unit.interval / wanted - 1e-9).ceil().max(1.0);
        let fitted = Steps::new().resolve(settings, stop, settings.every)?.tolerance.is_some();
        for c in compiled.scene().clusters.iter().filter(|c| is_uncut(c)) {
            report::say(&format!(
                "note: `{}` is stepped by gonzalez here, and by exact in bond run: a source of it switches, where exact steps end; give --method gonzalez there to compare, and take a step that is short beside what moves",
                c.name
            ));
        }
        let clusters = compiled.scene().clusters.iter();
        let list: Vec<_> = clusters.flat_map(|c| switching(compiled.stages(), c, (h, stop), fitted)).collect();
        let named =
            |timed: bool| list.iter().filter(|s| s.timed == timed).map(|s| format!("`{}`", s.name)).collect::<Vec<_>>();
        switches(named(true), "", "take a step that divides them");
        switches(named(false), "may ", "keep steps short");
        Ok(())
    }

    /// How it steps.
    fn options(&self, compiled: &Compiled) -> Result<bond_runtime::simulate::Options, Stop> {
        let settings = &compiled.stages().model.settings;
        let steps = self.step.map_or_else(Steps::new, Steps::fixed);
        Ok(steps.resolve(settings, settings.stop.unwrap_or(1.0), settings.every)?)
    }

    /// The scene as a unit.
    fn unit(&self, compiled: &Compiled) -> Result<standalone::StandaloneModule, Stop> {
        standalone::module(compiled.scene(), &self.options(compiled)?).map_err(Stop::Model)
    }

    /// The file; what comes from standard input has the scene's name.
    fn place(&self, ending: &str, compiled: &Compiled) -> Result<PathBuf, Stop> {
        let stem =
            if self.file == Path::new("-") { Some(OsStr::new(&compiled.scene().name)) } else { self.file.file_stem() };
        let path = match (self.output, stem) {
            (Some(path), _) if path == Path::new("-") => {
                return Err(Stop::Usage("what is built does not go to standard output: give a name with -o".into()));
            }
            (Some(path), _) => path.to_path_buf(),
            (None, Some(stem)) => {
                let mut name = stem.to_os_string();
                name.push(format!(".{ending}"));
                PathBuf::from(name)
            }
            (None, None) => return Err(Stop::Usage(format!("name the file to write: -o NAME.{ending}"))),
        };
        if path.extension().is_none_or(|e| e != ending) {
            let shown = path.display();
            return Err(Stop::Usage(format!("{shown}: tools recognize it by its ending; name it {shown}.{ending}")));
        }
        self.free(&path, compiled)?;
        Ok(path)
    }

    /// Refuses to write over a model.
    fn free(&self, path: &Path, compiled: &Compiled) -> Result<(), Stop> {
        output::no_model(path)?;
        output::not_over(path, &[(self.file, "the model")])?;
        output::not_over_used(Some(path), compiled.used())
    }

    /// The file and its header, if it has one.
    fn places(&self, emitter: &Emitter, compiled: &Compiled) -> Result<(PathBuf, PathBuf), Stop> {
        if emitter.has_header && !c::is_prefix(self.prefix) {
            let why = "it must be a name in C: a letter, then letters, digits and `_`";
            return Err(Stop::Usage(format!("--prefix {}: {why}", self.prefix)));
        }
        let path = self.place(emitter.extension, compiled)?;
        let header = path.with_extension("h");
        if emitter.has_header {
            // The source names its header between quotes.
            if path.to_str().is_none_or(|name| name.contains(['"', '\\']) || name.contains(char::is_control)) {
                return Err(Stop::Usage(format!("{}: no C compiler finds a header of that name", header.display())));
            }
            self.free(&header, compiled)?;
        }
        Ok((path, header))
    }
}

/// Refuses to put a header over one that goes with C where this one goes with an object, or the other way about: the
/// numbers of an object are double and it has no lanes, and who compiled against the other one would not be told.
fn not_of_another(header: &Path, object: bool) -> Result<(), Stop> {
    let Ok(text) = std::fs::read_to_string(header) else { return Ok(()) };
    match c::goes_with_object(&text) {
        Some(other) if other != object => {
            let (this, that) = if object { ("an object", "C") } else { ("C", "an object") };
            let shown = header.display();
            Err(Stop::Usage(format!("{shown} goes with {that}: name {this} otherwise with -o, or take {shown} away")))
        }
        Some(_) | None => Ok(()),
    }
}

/// Says of some names that they switch, and what to do about it.
fn switches(mut names: Vec<String>, may: &str, fix: &str) {
    if names.is_empty() {
        return;
    }
    let verb = if names.len() > 1 || !may.is_empty() { "switch" } else { "switches" };
    if names.len() > MAX_LISTED {
        names.truncate(MAX_LISTED);
        names.push("others".into());
    }
    let names = names.join(", ");
    report::say(&format!(
        "note: {names} {may}{verb} within steps: bond run meets these instants, where its step is not given; what is \
        built does not; {fix}"
    ));
}

/// The last part of a path.
fn last(path: &Path) -> String {
    path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default()
}

/// What systems call themselves in units, and their libraries.
const SYSTEM: Option<(&str, &str)> = match (std::env::consts::OS.as_bytes(), std::env::consts::ARCH.as_bytes()) {
    (b"linux", b"x86_64") => Some(("linux64", "so")),
    (b"macos", _) => Some(("darwin64", "dylib")),
    (b"windows", b"x86_64") => Some(("win64", "dll")),
    _ => None,
};

/// A shared library: the system's folder, the ending, the code.
type Library = (&'static str, &'static str, Vec<u8>);

/// The C compiler that CC names, and its flags, at blanks as make has it; a program whose path has blanks is one.
fn compiler() -> (OsString, Vec<OsString>) {
    let Some(named) = std::env::var_os("CC").filter(|c| !c.is_empty()) else { return ("cc".into(), Vec::new()) };
    let words: Vec<OsString> = match named.to_str() {
        Some(text) if !Path::new(&named).exists() => text.split_whitespace().map(OsString::from).collect(),
        _ => vec![named],
    };
    let mut words = words.into_iter();
    (words.next().unwrap_or_else(|| "cc".into()), words.collect())
}

/// The sources as a shared library. None where this system has no name in
/// units, or no C compiler.
fn library(sources: &[(&str, String)]) -> Result<Option<Library>, Stop> {
    let Some((folder, ending)) = SYSTEM else { return Ok(None) };
    let (compiler, flags) = compiler();
    let place = tempfile::tempdir()?;
    for (name, text) in sources {
        std::fs::write(place.path().join(name), text)?;
    }
    let mut command = Command::new(&compiler);
    command.args(flags);
    command.args(["-std=c99", "-O2", "-ffp-contract=off", "-fvisibility=hidden", "-shared"]);
    if ending != "dll" {
        command.arg("-fPIC");
    }
    command.args(sources.iter().map(|(name, _)| name).filter(|name| name.ends_with(".c")));
    command.args(["-lm", "-o", "library"]).current_dir(place.path()).stdin(Stdio::null());
    let done = match command.output() {
        Ok(done) => done,
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(None),
        Err(e) => return Err(Stop::Usage(format!("{}: {e}", compiler.display()))),
    };
    if !done.status.success() {
        let words = String::from_utf8_lossy(&done.stderr);
        let words: Vec<&str> = words.lines().take(4).collect();
        return Err(Stop::Usage(format!(
            "{} does not make a library of the unit's C; name another compiler by CC:\n{}",
            compiler.display(),
            words.join("\n")
        )));
    }
    Ok(Some((folder, ending, std::fs::read(place.path().join("library"))?)))
}

/// The bytes of an archive, with a library if there is a C compiler, and the system of that library.
fn packed(archive: &Archive) -> Result<(Vec<u8>, String), Stop> {
    let library = library(&archive.sources)?;
    let files = archive.files.iter().map(|(name, text)| (name.to_string(), text.as_bytes()));
    let sources = archive.sources.iter().map(|(name, text)| (format!("sources/{name}"), text.as_bytes()));
    let mut entries: Vec<(String, &[u8])> = files.chain(sources).collect();
    let mut with =
        "as C alone: no C compiler was found (`cc`, or what CC names), so only tools that compile can take it"
            .to_string();
    if let Some((folder, ending, code)) = &library {
        entries.push((format!("binaries/{folder}/{}.{ending}", archive.library), code));
        with = format!("for {folder} and as C");
    }
    let bytes = pack(&entries).map_err(|e| Stop::Usage(format!("the archive cannot be packed: {e}")))?;
    Ok((bytes, with))
}

/// An archive of these files, with the same bytes each time.
fn pack(entries: &[(String, &[u8])]) -> zip::result::ZipResult<Vec<u8>> {
    let mut archive = zip::ZipWriter::new(Cursor::new(Vec::new()));
    let options = zip::write::SimpleFileOptions::default().last_modified_time(zip::DateTime::default());
    for (name, bytes) in entries {
        archive.start_file(name.as_str(), options)?;
        archive.write_all(bytes)?;
    }
    Ok(archive.finish()?.into_inner())
}
