//! What `bond build` writes besides executables: C text, object files with a header.

use crate::output;
use crate::report;
use crate::stop::Stop;
use bond::{Compiled, Steps};
use bond_compiler::backend::{c, unit};
use std::ffi::OsStr;
use std::path::{Path, PathBuf};

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
    /// Writes NAME.c and NAME.h.
    ///
    /// # Errors
    /// A scene that has no compiled form, a file that cannot be written.
    pub fn c(&self, compiled: &Compiled) -> Result<(), Stop> {
        let (source, header) = self.places("c", compiled)?;
        let unit = self.unit(compiled)?;
        not_of_another(&header, false)?;
        let options = c::Options { prefix: self.prefix.to_string(), header: last(&header), single: true };
        output::put_both(
            (&header, c::header(&unit, &options).as_bytes()),
            (&source, c::source(&unit, &options).as_bytes()),
        )?;
        tell(&unit, &source, &header);
        Ok(())
    }

    /// Writes NAME.o and NAME.h.
    ///
    /// # Errors
    /// A scene that has no compiled form, a file that cannot be written.
    #[cfg(feature = "native")]
    pub fn object(&self, compiled: &Compiled) -> Result<(), Stop> {
        let (object, header) = self.places("o", compiled)?;
        let unit = self.unit(compiled)?;
        let code = bond_compiler::backend::native::object(&unit, self.prefix).map_err(Stop::Model)?;
        not_of_another(&header, true)?;
        let options = c::Options { prefix: self.prefix.to_string(), header: last(&header), single: false };
        output::put_both((&header, c::header(&unit, &options).as_bytes()), (&object, &code))?;
        tell(&unit, &object, &header);
        Ok(())
    }

    /// The scene as a unit.
    fn unit(&self, compiled: &Compiled) -> Result<unit::Unit, Stop> {
        let settings = &compiled.stages().model.settings;
        let steps = self.step.map_or_else(Steps::new, Steps::fixed);
        let options = steps.resolve(settings, settings.stop.unwrap_or(1.0), settings.every)?;
        unit::unit(compiled.scene(), &options).map_err(Stop::Model)
    }

    /// The file and its header; what comes from standard input has the scene's name.
    fn places(&self, ending: &str, compiled: &Compiled) -> Result<(PathBuf, PathBuf), Stop> {
        if !c::is_prefix(self.prefix) {
            let why = "it must be a name in C: a letter, then letters, digits and `_`";
            return Err(Stop::Usage(format!("--prefix {}: {why}", self.prefix)));
        }
        let stem =
            if self.file == Path::new("-") { Some(OsStr::new(&compiled.scene().name)) } else { self.file.file_stem() };
        let path = match (self.output, stem) {
            (Some(path), _) if path == Path::new("-") => {
                return Err(Stop::Usage("two files are written: give a name with -o".into()));
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
            return Err(Stop::Usage(format!(
                "{shown}: compilers go by endings; name it `.{ending}`, as in {shown}.{ending}"
            )));
        }
        let header = path.with_extension("h");
        // The source names its header between quotes.
        if path.to_str().is_none_or(|name| name.contains(['"', '\\']) || name.contains(char::is_control)) {
            return Err(Stop::Usage(format!("{}: no C compiler finds a header of that name", header.display())));
        }
        for path in [&path, &header] {
            output::no_model(path)?;
            output::not_over(path, &[(self.file, "the model")])?;
            output::not_over_used(Some(path), compiled.used())?;
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

/// Says what was written.
fn tell(unit: &unit::Unit, file: &Path, header: &Path) {
    let count = |n: usize, what: &str| format!("{n} {what}{}", if n == 1 { "" } else { "s" });
    report::say(&format!(
        "built {} and {}: intervals of {:?} s, {}, {}, {}",
        file.display(),
        header.display(),
        unit.interval,
        count(unit.open.len(), "open port"),
        count(unit.inputs.len(), "input"),
        count(unit.probes.len(), "probe"),
    ));
}

/// The last part of a path.
fn last(path: &Path) -> String {
    path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default()
}
