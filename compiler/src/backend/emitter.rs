//! What a form has in which a scene is written to run without `bond`.

use super::standalone::StandaloneModule;
use bond_runtime::scene::Scene;

/// A form in which a scene is written.
#[derive(Clone, Copy, Debug)]
pub struct Emitter {
    /// Its name, as `--emit` takes it.
    pub name: &'static str,
    /// What is built, in a line of the help.
    pub about: &'static str,
    /// The ending of the file.
    pub extension: &'static str,
    /// Whether a header for C goes beside it. Then public names begin with [`Request::prefix`]; else they are fixed.
    pub has_header: bool,
    /// Writes a scene.
    ///
    /// # Errors
    /// In words: the scene has no such form.
    pub emit: fn(&Request<'_>) -> Result<Emitted, String>,
}

/// What is written.
#[derive(Clone, Copy, Debug)]
pub struct Request<'a> {
    /// The scene.
    pub scene: &'a Scene,
    /// The same at fixed steps.
    pub unit: &'a StandaloneModule,
    /// The name of the file without its ending.
    pub name: &'a str,
    /// What public names begin with.
    pub prefix: &'a str,
    /// The name of the header, where there is one.
    pub header: &'a str,
    /// When a simulation ends that says nothing else, s.
    pub stop: Option<f64>,
}

/// A scene, written.
#[derive(Clone, Debug)]
pub enum Emitted {
    /// A file and what is said of it, such as its size.
    File(Vec<u8>, String),
    /// A file and the header that goes beside it.
    WithHeader(Vec<u8>, String),
    /// An archive.
    Archive(Archive),
}

/// A file of files, some of which are C, and the library that they become.
#[derive(Clone, Debug)]
pub struct Archive {
    /// What it is, in words.
    pub about: &'static str,
    /// Files other than C: path and text.
    pub files: Vec<(&'static str, String)>,
    /// The C, in a folder `sources`: name and text.
    pub sources: Vec<(&'static str, String)>,
    /// The name of the library.
    pub library: String,
}
