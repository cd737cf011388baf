//! Packets that only somebody with the key can have made: keyed BLAKE3. `docs/reference/serve.md` has the layout,
//! and what it protects against.

use super::packet::LONGEST;
use thiserror::Error;

/// The first bytes of a sealed packet.
pub const SEALED: [u8; 4] = *b"BNDS";
/// The version of the layout of sealed packets.
pub const SEALED_VERSION: u32 = 1;
/// Bytes of a sealed packet before the packet itself.
const HEAD: usize = 24;
/// Bytes of the tag at its end.
const TAG: usize = blake3::OUT_LEN;
/// Bytes of the longest sealed packet.
pub const LONGEST_SEALED: usize = sealed_length(LONGEST);

/// Bytes of a sealed packet around one of `length` bytes.
pub const fn sealed_length(length: usize) -> usize {
    HEAD + length + TAG
}

/// Why something is no key.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum KeyError {
    /// A wrong number of bytes.
    #[error("it holds {0} bytes, and a key is 32 bytes or 64 hexadecimal digits; `openssl rand -hex 32` makes one")]
    Length(usize),
    /// As long as 64 digits.
    #[error("of its 64 characters, number {0} is no hexadecimal digit; `openssl rand -hex 32` makes a key")]
    Digit(usize),
}

/// A secret that the environment and its device share.
#[derive(Clone)]
pub struct Key([u8; blake3::KEY_LEN]);

impl Key {
    /// A key from what a file holds: 32 bytes as they are, or 64 hexadecimal digits, after which blanks and line ends
    /// may follow.
    ///
    /// # Errors
    /// See [`KeyError`].
    pub fn read(bytes: &[u8]) -> Result<Self, KeyError> {
        if let Ok(raw) = bytes.try_into() {
            return Ok(Self(raw));
        }
        let digits: &[u8; 2 * blake3::KEY_LEN] =
            bytes.trim_ascii_end().try_into().map_err(|_| KeyError::Length(bytes.len()))?;
        let mut key = [0; blake3::KEY_LEN];
        for (i, digit) in digits.iter().enumerate() {
            let value = char::from(*digit).to_digit(16).ok_or(KeyError::Digit(i + 1))?;
            key[i / 2] = key[i / 2] << 4 | value as u8;
        }
        Ok(Self(key))
    }

    /// Seals a packet into a buffer of [`LONGEST_SEALED`] bytes; its length. `number` must be higher than all numbers
    /// that this end has used with this key, `answered` is the number of the newest packet from the other end.
    pub fn seal(&self, number: u64, answered: u64, packet: &[u8], to: &mut [u8; LONGEST_SEALED]) -> usize {
        let packet = &packet[..packet.len().min(LONGEST)];
        let body = HEAD + packet.len();
        to[..4].copy_from_slice(&SEALED);
        to[4..8].copy_from_slice(&SEALED_VERSION.to_le_bytes());
        to[8..16].copy_from_slice(&number.to_le_bytes());
        to[16..HEAD].copy_from_slice(&answered.to_le_bytes());
        to[HEAD..body].copy_from_slice(packet);
        let tag = blake3::keyed_hash(&self.0, &to[..body]);
        to[body..body + TAG].copy_from_slice(tag.as_bytes());
        body + TAG
    }

    /// Whether this key sealed it. Takes as long for a wrong tag as for the right one.
    pub fn has_sealed(&self, sealed: &Sealed<'_>) -> bool {
        // Hashes are compared in constant time.
        blake3::keyed_hash(&self.0, sealed.body) == blake3::Hash::from_bytes(*sealed.tag)
    }
}

/// A sealed packet, as it claims to be: [`Key::has_sealed`] tells whether it is.
#[derive(Clone, Copy, Debug)]
pub struct Sealed<'a> {
    /// Its number.
    pub number: u64,
    /// The number of the packet that it answers, 0 for none.
    pub answered: u64,
    /// The packet.
    pub packet: &'a [u8],
    body: &'a [u8],
    tag: &'a [u8; TAG],
}

impl<'a> Sealed<'a> {
    /// Takes it apart; `None` for anything else, and for other versions.
    pub fn split(bytes: &'a [u8]) -> Option<Self> {
        let (body, tag) = bytes.split_last_chunk::<TAG>()?;
        let rest = body.strip_prefix(&SEALED)?.strip_prefix(&SEALED_VERSION.to_le_bytes())?;
        let (number, rest) = rest.split_first_chunk::<8>()?;
        let (answered, packet) = rest.split_first_chunk::<8>()?;
        let [number, answered] = [number, answered].map(|x| u64::from_le_bytes(*x));
        Some(Self { number, answered, packet, body, tag })
    }
}

/// A device's end of a line with a key: it seals measurements, and opens efforts.
///
/// It takes only efforts with a higher number than all before, which answer a packet of its own since it started: what
/// somebody recorded in an earlier life of the device answers none.
#[derive(Clone)]
pub struct DeviceSeal {
    key: Key,
    /// The last number of its earlier lives, and of this one.
    before: u64,
    sent: u64,
    heard: u64,
}

impl DeviceSeal {
    /// A device that starts. `before` must be at least as high as all numbers that it has used with this key, such as
    /// the time since 1970 in ns, or a counter that outlasts the device's power.
    pub fn new(key: Key, before: u64) -> Self {
        Self { key, before, sent: before, heard: 0 }
    }

    /// Seals a packet into a buffer; its length.
    pub fn seal(&mut self, packet: &[u8], to: &mut [u8; LONGEST_SEALED]) -> usize {
        self.sent = self.sent.saturating_add(1);
        self.key.seal(self.sent, self.heard, packet, to)
    }

    /// The packet in a sealed one; `None` where it is a stranger's, was heard before, or answers nothing that this
    /// device has sent.
    pub fn open<'a>(&mut self, bytes: &'a [u8]) -> Option<&'a [u8]> {
        let sealed = Sealed::split(bytes)?;
        let answers = sealed.answered > self.before && sealed.answered <= self.sent;
        let opens = answers && sealed.number > self.heard && self.key.has_sealed(&sealed);
        opens.then(|| {
            self.heard = sealed.number;
            sealed.packet
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn key(byte: u8) -> Key {
        Key([byte; 32])
    }

    #[test]
    fn keys_are_raw_or_hexadecimal() {
        let digits = "000102030405060708090a0b0c0d0e0f101112131415161718191a1b1c1d1e1F";
        let raw: Vec<u8> = (0..32).collect();
        for text in [digits.as_bytes(), format!("{digits}\r\n").as_bytes(), &raw] {
            assert!(Key::read(text).is_ok_and(|k| k.0 == *raw));
        }
        let wrong = |bytes: &[u8]| Key::read(bytes).err();
        assert_eq!(wrong(b""), Some(KeyError::Length(0)));
        assert_eq!(wrong(&raw[1..]), Some(KeyError::Length(31)));
        assert_eq!(wrong(&digits.as_bytes()[1..]), Some(KeyError::Length(63)));
        assert_eq!(wrong(digits.replace('a', "g").as_bytes()), Some(KeyError::Digit(22)));
    }

    #[test]
    fn one_changed_bit_or_another_key_is_refused() {
        let mut buffer = [0; LONGEST_SEALED];
        for length in [0, 1, 64, LONGEST] {
            let packet: Vec<u8> = (0..length).map(|i| i as u8).collect();
            let n = key(1).seal(7, 5, &packet, &mut buffer);
            assert_eq!(n, sealed_length(length));
            let opens = |key: &Key, bytes: &[u8]| Sealed::split(bytes).is_some_and(|s| key.has_sealed(&s));
            let sealed = Sealed::split(&buffer[..n]).unwrap();
            assert_eq!((sealed.number, sealed.answered, sealed.packet), (7, 5, &packet[..]));
            assert!(opens(&key(1), &buffer[..n]) && !opens(&key(2), &buffer[..n]));
            for at in 0..n {
                let mut wrong = buffer;
                wrong[at] ^= 0x10;
                assert!(!opens(&key(1), &wrong[..n]) && !opens(&key(1), &buffer[..at]), "byte {at} of {n}");
            }
        }
    }

    #[test]
    fn a_device_takes_each_answer_once_and_none_from_an_earlier_life() {
        let (mut to, mut from) = ([0; LONGEST_SEALED], [0; LONGEST_SEALED]);
        let mut device = DeviceSeal::new(key(1), 100);
        let n = device.seal(b"here", &mut to);
        let said = Sealed::split(&to[..n]).unwrap().number;
        assert!(said > 100);
        let answer = |number: u64, answered: u64, to: &mut [u8; LONGEST_SEALED]| {
            let n = key(1).seal(number, answered, b"effort", to);
            to[..n].to_vec()
        };
        let [first, second] = [1000, 1001].map(|number| answer(number, said, &mut from));
        assert_eq!(device.open(&first), Some(&b"effort"[..]));
        assert_eq!(device.open(&first), None, "a replay");
        assert_eq!(device.open(&second), Some(&b"effort"[..]));
        assert_eq!(device.open(&first), None, "an older one");
        assert_eq!(device.open(&answer(1002, said + 1, &mut from)), None, "it answers what was never sent");
        // The next life, in which recorded packets are no answers.
        let mut device = DeviceSeal::new(key(1), 200);
        device.seal(b"here", &mut to);
        assert_eq!(device.open(&second), None);
        assert_eq!(device.open(&answer(2000, 201, &mut from)), Some(&b"effort"[..]));
    }
}
