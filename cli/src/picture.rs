//! Where pictures go.

use crate::output;
use crate::stop::Stop;
use bond::internal::{Drawing, PictureFormat};
use std::path::Path;

/// The format that a file's name asks for.
///
/// # Errors
/// Another ending, or a program without pictures.
pub fn format(path: &Path) -> Result<PictureFormat, Stop> {
    let ending = path.extension().map(|e| e.to_string_lossy().to_lowercase());
    let format = match ending.as_deref() {
        Some("svg") => PictureFormat::Svg,
        Some("png") => PictureFormat::Png,
        _ => {
            return Err(Stop::Usage(format!(
                "{} is no picture that can be drawn; let its name end in .svg or .png",
                path.display()
            )));
        }
    };
    if !cfg!(feature = "plot") {
        return Err(Stop::Usage("this program was built without pictures; build it with the feature `plot`".into()));
    }
    output::whole(path)?;
    Ok(format)
}

/// Writes a picture to a file.
///
/// # Errors
/// A file that cannot be written.
pub fn put(drawing: &Drawing, path: &Path) -> Result<(), Stop> {
    let bytes =
        drawing.bytes(format(path)?).map_err(|e| Stop::Usage(format!("cannot draw {}: {e}", path.display())))?;
    output::put_bytes(path, &bytes)
}
