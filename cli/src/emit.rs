//! What `bond build` writes besides executables: C text, object files with a header.

use crate::input;
use crate::output;
use crate::stop::Stop;
use bond::{Compiled, Steps};
use bond_compiler::backend::{c, unit};
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
        let (source, header) = self.places("c")?;
        let unit = self.unit(compiled)?;
        let options = c::Options { prefix: self.prefix.to_string(), header: last(&header) };
        output::put(Some(&header), &c::header(&unit, &options))?;
        output::put(Some(&source), &c::source(&unit, &options))
    }

    /// The scene as a unit.
    fn unit(&self, compiled: &Compiled) -> Result<unit::Unit, Stop> {
        let settings = &compiled.stages().model.settings;
        let steps = self.step.map_or_else(Steps::new, Steps::fixed);
        let options = steps.resolve(settings, settings.stop.unwrap_or(1.0), settings.every)?;
        unit::unit(compiled.scene(), &options).map_err(Stop::Model)
    }

    /// The file and its header.
    fn places(&self, ending: &str) -> Result<(PathBuf, PathBuf), Stop> {
        if !c::is_prefix(self.prefix) {
            return Err(Stop::Usage(format!("--prefix {}: it must be a name in C", self.prefix)));
        }
        let path = match self.output {
            Some(path) if path == Path::new("-") => {
                return Err(Stop::Usage("two files are written: give a name with -o".into()));
            }
            Some(path) => path.to_path_buf(),
            None => match self.file.file_stem().filter(|_| self.file != Path::new("-")) {
                Some(stem) => PathBuf::from(stem).with_extension(ending),
                None => return Err(Stop::Usage("name the file to write with -o".into())),
            },
        };
        if path.extension().is_some_and(|e| e == "h") {
            return Err(Stop::Usage(format!("{}: that is the header's name", input::name(&path))));
        }
        Ok((path.clone(), path.with_extension("h")))
    }
}

/// The last part of a path.
fn last(path: &Path) -> String {
    path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default()
}
