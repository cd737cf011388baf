//! Any text as a `.bond` file: parsed, laid out, compiled.
//!
//! Nothing panics, and every error is at a place of the text. A text that is read is laid out so that it means the same
//! and is laid out already. What compiles is sound, is read back from its bytes, and compiles to the same bytes again.
#![no_main]

use bond_compiler::elaborate::{Limits, NoFiles};
use bond_compiler::{Compiled, Options, compile};
use bond_fuzz::{check_diagnostics, mutate, seeds};
use bond_grammar::ast::File;
use bond_grammar::source::Sources;
use bond_runtime::envelope::digest;
use bond_runtime::scene::Scene;
use libfuzzer_sys::{fuzz_mutator, fuzz_target};
use std::sync::OnceLock;

/// Bytes of the longest text that is a seed.
const LONGEST: usize = 1500;
/// Of so many texts one is compiled a second time.
const COMPILED_TWICE: u64 = 16;

/// What keeps one text within a few milliseconds.
fn limits() -> Limits {
    Limits {
        elements: 40,
        instances: 20,
        values: 200,
        rounds: 100,
        entries: 100,
        calls: 500,
        nesting: 8,
        depth: 500,
        unused: 5000,
        equations: 5000,
        explained: 10,
        suggested: 8,
    }
}

/// A tree without places and comments.
fn shape(file: &File) -> String {
    let text = format!("{:?}", File { comments: Vec::new(), ..file.clone() });
    let mut pieces = text.split("Span { source");
    let first = pieces.next().unwrap_or_default().to_string();
    pieces.fold(first, |shape, piece| shape + piece.split_once('}').map_or("", |p| p.1))
}

/// Reads a text; where nothing is wrong with it, its layout.
fn laid_out(text: &str) -> Option<(String, File)> {
    let mut sources = Sources::new();
    let id = sources.add("text.bond", text);
    let (file, errors) = bond_grammar::parse(&sources, id);
    check_diagnostics(&sources, &errors);
    errors.is_empty().then(|| (bond_grammar::format(&sources, id, &file), file))
}

fn layout(text: &str) {
    let Some((first, before)) = laid_out(text) else { return };
    let Some((second, after)) = laid_out(&first) else { panic!("the layout cannot be read:\n{first}") };
    assert_eq!(shape(&before), shape(&after), "the layout means something else:\n{first}");
    assert_eq!(before.comments.len(), after.comments.len(), "a comment is lost:\n{first}");
    assert_eq!(first, second, "the layout is laid out otherwise");
}

fn compiled(text: &str) -> Option<Compiled> {
    let mut sources = Sources::new();
    let main = sources.add("text.bond", text);
    let options = Options { limits: limits(), ..Options::default() };
    match compile(&mut sources, main, &mut NoFiles, &options) {
        Ok(compiled) => Some(compiled),
        Err(errors) => {
            assert!(errors.iter().any(|e| !e.warning), "it is refused, and nothing is wrong with it");
            check_diagnostics(&sources, &errors);
            None
        }
    }
}

fn bytes(compiled: &Compiled) -> Vec<u8> {
    compiled.scene.to_bytes().unwrap_or_else(|e| panic!("{e}"))
}

fuzz_target!(
    init: {
        let folders = ["classics", "components", "elements", "examples", "hard", "invalid", "library"];
        let list = folders.into_iter().flat_map(|folder| seeds::models(folder, LONGEST));
        seeds::write("text", list.map(|(name, text)| (name, text.into_bytes())));
    },
    |data: &[u8]| {
        let Ok(text) = std::str::from_utf8(data) else { return };
        layout(text);
        let Some(compiled) = self::compiled(text) else { return };
        if let Err(why) = compiled.stages.form.validate(&compiled.stages.model.pool) {
            panic!("the form is not sound: {why:?}");
        }
        let bytes = self::bytes(&compiled);
        let back = Scene::from_bytes(&bytes).unwrap_or_else(|e| panic!("the scene is not sound: {e}"));
        assert!(back.to_bytes().as_ref() == Ok(&bytes), "written again, the scene differs");
        if digest(data).is_multiple_of(COMPILED_TWICE) {
            let again = self::compiled(text).map(|c| self::bytes(&c));
            assert!(again.as_ref() == Some(&bytes), "compiled again, the scene differs");
        }
    }
);

fuzz_mutator!(|data: &mut [u8], size: usize, max_size: usize, seed: u32| {
    static PIECES: OnceLock<Vec<&str>> = OnceLock::new();
    let pieces = PIECES.get_or_init(|| mutate::pieces(include_str!("../bond.dict")));
    mutate::text(data, size, max_size, seed, pieces)
});
