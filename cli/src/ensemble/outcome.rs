//! The outcome of an instance, and its form as bytes.

/// The outcome of an instance.
#[derive(Clone, Debug, PartialEq)]
pub struct Outcome {
    /// The probes at the end, SI; NaN if it was not reached.
    pub last: Vec<f64>,
    /// Time and probes of each row over time, one after another, where rows are asked for.
    pub rows: Vec<f64>,
    /// Whether its ledger shows it passive; never of an instance that failed.
    pub passive: bool,
    /// The worst balance of a step, relative; NaN without steps.
    pub worst: f64,
    /// Why it failed, if it did.
    pub failure: Option<String>,
}

impl Outcome {
    /// An instance that failed before it began.
    pub fn failed(width: usize, why: String) -> Self {
        Self { last: vec![f64::NAN; width], rows: Vec::new(), passive: false, worst: f64::NAN, failure: Some(why) }
    }

    /// Adds its bytes: passive, worst, last, rows with their count before them, failure with its length plus one before
    /// it, or 0.
    pub fn encode(&self, out: &mut Vec<u8>) {
        out.push(u8::from(self.passive));
        out.extend(self.worst.to_bits().to_le_bytes());
        out.extend(self.last.iter().flat_map(|x| x.to_bits().to_le_bytes()));
        out.extend((self.rows.len() as u64).to_le_bytes());
        out.extend(self.rows.iter().flat_map(|x| x.to_bits().to_le_bytes()));
        match &self.failure {
            None => out.extend(0u64.to_le_bytes()),
            Some(why) => {
                out.extend((why.len() as u64 + 1).to_le_bytes());
                out.extend(why.as_bytes());
            }
        }
    }

    /// Reads one from the front of bytes, with this number of probes; None if the bytes are not one.
    pub fn decode(bytes: &mut &[u8], width: usize) -> Option<Self> {
        let passive = take(bytes, 1)?[0] == 1;
        let worst = numbers(bytes, 1)?[0];
        let last = numbers(bytes, width)?;
        let count = usize::try_from(whole(bytes)?).ok()?;
        let rows = numbers(bytes, count)?;
        let failure = match usize::try_from(whole(bytes)?).ok()? {
            0 => None,
            n => Some(String::from_utf8(take(bytes, n - 1)?.to_vec()).ok()?),
        };
        Some(Self { last, rows, passive, worst, failure })
    }
}

fn take<'a>(bytes: &mut &'a [u8], n: usize) -> Option<&'a [u8]> {
    let (head, rest) = bytes.split_at_checked(n)?;
    *bytes = rest;
    Some(head)
}

fn whole(bytes: &mut &[u8]) -> Option<u64> {
    take(bytes, 8)?.try_into().ok().map(u64::from_le_bytes)
}

fn numbers(bytes: &mut &[u8], n: usize) -> Option<Vec<f64>> {
    let list = take(bytes, n.checked_mul(8)?)?.chunks_exact(8);
    list.map(|b| b.try_into().ok().map(|b| f64::from_bits(u64::from_le_bytes(b)))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_read_back() {
        let done =
            Outcome { last: vec![1.0, -0.0], rows: vec![0.0, 3.5, 4.5], passive: true, worst: 1e-16, failure: None };
        let failed = Outcome { rows: vec![7.0], worst: 2.0, ..Outcome::failed(2, "at 3 s, é".into()) };
        let mut bytes = Vec::new();
        done.encode(&mut bytes);
        failed.encode(&mut bytes);
        let mut left = bytes.as_slice();
        assert_eq!(Outcome::decode(&mut left, 2), Some(done));
        let again = Outcome::decode(&mut left, 2).unwrap();
        assert!(again.last.iter().all(|x| x.is_nan()) && again.failure == failed.failure && again.rows == [7.0]);
        assert!(left.is_empty());
        for n in 0..bytes.len() {
            let mut cut = &bytes[..n];
            let both = Outcome::decode(&mut cut, 2).and_then(|_| Outcome::decode(&mut cut, 2));
            assert!(both.is_none(), "{n}");
        }
        assert!(Outcome::decode(&mut [255u8; 60].as_slice(), 2).is_none());
    }
}
