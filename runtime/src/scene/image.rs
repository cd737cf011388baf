//! A scene as bytes, to be stored and read again.

use super::{Made, Scene, Stepper};
use crate::envelope::{self, Damaged, Kind};
use serde::de::Error;
use serde::{Deserialize, Deserializer};

impl Scene {
    /// The scene as bytes. The same scene gives the same bytes.
    ///
    /// # Errors
    /// In words; no scene is known that gives one.
    pub fn to_bytes(&self) -> Result<Vec<u8>, String> {
        envelope::seal(Kind::Scene, self)
    }

    /// A scene from the bytes that [`Self::to_bytes`] gave, checked: its programs, and that whatever is referred to is
    /// there.
    ///
    /// # Errors
    /// Bytes that are damaged, or a scene that is not sound.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, Damaged> {
        let scene: Self = envelope::open(Kind::Scene, bytes)?;
        scene.validate().map_err(|e| Damaged::Meaning(e.to_string()))?;
        Ok(scene)
    }

    /// A number that tells scenes apart: other elements, parameters, methods, probes or expectations give another one.
    /// What they were made for does not count, where it made no other programs.
    ///
    /// # Errors
    /// As [`Self::to_bytes`].
    pub fn fingerprint(&self) -> Result<u64, String> {
        Ok(envelope::digest(&Self { made: Made::default(), ..self.clone() }.to_bytes()?))
    }
}

/// Reads the stepper within a stepper, which has none itself: no file can nest them.
pub(super) fn inner<'de, D: Deserializer<'de>>(reader: D) -> Result<Option<Box<Stepper>>, D::Error> {
    thread_local! {
        static INSIDE: std::cell::Cell<bool> = const { std::cell::Cell::new(false) };
    }
    if INSIDE.replace(true) {
        return match Option::<()>::deserialize(reader)? {
            None => Ok(None),
            Some(()) => Err(D::Error::custom("a stepper within a stepper has one of its own")),
        };
    }
    let found = Option::deserialize(reader);
    INSIDE.set(false);
    found
}
