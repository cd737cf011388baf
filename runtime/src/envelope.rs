//! Values as bytes, wrapped so that what is not whole is seen: scenes in files, and saved states.
//!
//! | bytes | what |
//! | --- | --- |
//! | 8 | which kind of value, [`Kind`] |
//! | 4 | [`FORMAT`] |
//! | 8 | length of the value |
//! | 8 | [`digest`] of the value |
//! | | the value, in the postcard format; numbers keep their bits |
//!
//! All numbers of the head are little-endian.

use serde::Serialize;
use serde::de::DeserializeOwned;
use thiserror::Error;

/// Version of what is inside; it changes with every change of the types that are written.
pub const FORMAT: u32 = 29;
/// Length of the head, bytes.
pub const HEAD: usize = 28;

/// What an envelope holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// A compiled scene.
    Scene,
    /// The state of a run.
    State,
    /// What a built environment carries.
    Built,
}

impl Kind {
    /// All kinds.
    pub const ALL: [Kind; 3] = [Kind::Scene, Kind::State, Kind::Built];

    /// The first bytes of its envelope.
    pub fn magic(self) -> [u8; 8] {
        match self {
            Kind::Scene => *b"bond-scn",
            Kind::State => *b"bond-sta",
            Kind::Built => *b"bond-env",
        }
    }

    /// In words.
    pub fn name(self) -> &'static str {
        match self {
            Kind::Scene => "a compiled scene",
            Kind::State => "the state of a run",
            Kind::Built => "a built environment",
        }
    }
}

/// Why bytes are no value.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum Damaged {
    /// They begin otherwise.
    #[error("it is not {}{}", .0.name(), .1.map(|k| format!(", but {}", k.name())).unwrap_or_default())]
    Kind(Kind, Option<Kind>),
    /// Another version made them.
    #[error("it has format {0}, and this version reads format {FORMAT}; create it again")]
    Format(u32),
    /// Bytes are missing, or there are more than there should be.
    #[error("it has {found} bytes and should have {wanted}; it was cut off, or something was added")]
    Length {
        /// How many there should be.
        wanted: u64,
        /// How many there are.
        found: u64,
    },
    /// A byte was changed.
    #[error("its bytes are not those that were written")]
    Digest,
    /// They are whole and mean nothing.
    #[error("it cannot be read: {0}")]
    Meaning(String),
}

/// A number that tells bytes apart: FNV-1a, 64 bits.
pub fn digest(bytes: &[u8]) -> u64 {
    bytes.iter().fold(0xcbf2_9ce4_8422_2325, |h, b| (h ^ u64::from(*b)).wrapping_mul(0x0100_0000_01b3))
}

/// Writes a value.
///
/// # Errors
/// In words; none of the types of this crate gives one.
pub fn seal<T: Serialize>(kind: Kind, value: &T) -> Result<Vec<u8>, String> {
    let mut bytes = postcard::to_extend(value, vec![0; HEAD]).map_err(|e| e.to_string())?;
    let body = &bytes[HEAD..];
    let (length, digest) = (body.len() as u64, digest(body));
    bytes[..8].copy_from_slice(&kind.magic());
    bytes[8..12].copy_from_slice(&FORMAT.to_le_bytes());
    bytes[12..20].copy_from_slice(&length.to_le_bytes());
    bytes[20..28].copy_from_slice(&digest.to_le_bytes());
    Ok(bytes)
}

/// Reads a value that [`seal`] wrote.
///
/// # Errors
/// See [`Damaged`].
pub fn open<T: DeserializeOwned>(kind: Kind, bytes: &[u8]) -> Result<T, Damaged> {
    let short = || Damaged::Length { wanted: HEAD as u64, found: bytes.len() as u64 };
    let (magic, rest) = bytes.split_first_chunk::<8>().ok_or_else(short)?;
    if *magic != kind.magic() {
        return Err(Damaged::Kind(kind, Kind::ALL.into_iter().find(|k| k.magic() == *magic)));
    }
    let (format, rest) = rest.split_first_chunk::<4>().ok_or_else(short)?;
    let format = u32::from_le_bytes(*format);
    if format != FORMAT {
        return Err(Damaged::Format(format));
    }
    let (length, rest) = rest.split_first_chunk::<8>().ok_or_else(short)?;
    let (wanted, body) = rest.split_first_chunk::<8>().ok_or_else(short)?;
    let length = u64::from_le_bytes(*length);
    if length != body.len() as u64 {
        let wanted = length.saturating_add(HEAD as u64);
        return Err(Damaged::Length { wanted, found: bytes.len() as u64 });
    }
    if digest(body) != u64::from_le_bytes(*wanted) {
        return Err(Damaged::Digest);
    }
    match postcard::take_from_bytes(body) {
        Ok((value, [])) => Ok(value),
        Ok((_, rest)) => Err(Damaged::Meaning(format!("{} bytes are left over", rest.len()))),
        Err(e) => Err(Damaged::Meaning(e.to_string())),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_keep_their_bits() -> Result<(), Box<dyn std::error::Error>> {
        let odd = f64::from_bits(0x7ff8_0000_dead_beef);
        let list = vec![0.0, -0.0, 1.0 / 3.0, 5e-324, f64::INFINITY, f64::NEG_INFINITY, odd];
        let bytes = seal(Kind::State, &list)?;
        let back: Vec<f64> = open(Kind::State, &bytes)?;
        assert_eq!(
            back.iter().map(|x| x.to_bits()).collect::<Vec<_>>(),
            list.iter().map(|x| x.to_bits()).collect::<Vec<_>>()
        );
        Ok(())
    }

    #[test]
    fn whatever_is_changed_is_seen() -> Result<(), Box<dyn std::error::Error>> {
        let bytes = seal(Kind::Scene, &vec![1.0, 2.0])?;
        let read = |b: &[u8]| open::<Vec<f64>>(Kind::Scene, b);
        for at in 0..bytes.len() {
            for bit in 0..8 {
                let mut other = bytes.clone();
                other[at] ^= 1 << bit;
                assert!(read(&other).is_err(), "byte {at}");
            }
            assert!(read(&bytes[..at]).is_err());
        }
        let mut longer = bytes.clone();
        longer.push(0);
        assert!(matches!(read(&longer), Err(Damaged::Length { .. })));
        assert_eq!(open::<Vec<f64>>(Kind::State, &bytes), Err(Damaged::Kind(Kind::State, Some(Kind::Scene))));
        Ok(())
    }
}
