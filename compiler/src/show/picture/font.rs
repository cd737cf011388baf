//! How wide a text is in Helvetica, whose widths Arial and Liberation Sans share.

/// Advance widths of the characters from the space to `~`, in thousandths of the size (Adobe's metrics of the font).
const WIDTHS: [u16; 95] = [
    278, 278, 355, 556, 556, 889, 667, 191, 333, 333, 389, 584, 278, 333, 278, 278, 556, 556, 556, 556, 556, 556, 556,
    556, 556, 556, 278, 278, 584, 584, 584, 556, 1015, 667, 667, 722, 722, 667, 611, 778, 722, 278, 500, 667, 556, 833,
    722, 778, 667, 778, 722, 667, 611, 722, 667, 944, 667, 667, 611, 278, 278, 278, 469, 556, 333, 556, 556, 500, 556,
    556, 278, 556, 556, 222, 222, 500, 222, 833, 556, 556, 556, 556, 333, 500, 278, 556, 500, 722, 500, 500, 500, 334,
    260, 334, 584,
];

/// The width of a letter that the table lacks; of the letters of other scripts that are as wide as high, the size.
fn other(c: char) -> u16 {
    match c {
        '\u{0300}'..='\u{036f}' => 0,
        '\u{1100}'..='\u{11ff}' | '\u{2e80}'..='\u{9fff}' | '\u{ac00}'..='\u{d7af}' | '\u{f900}'..='\u{ffff}' => 1000,
        _ if u32::from(c) > 0xffff => 1000,
        _ => 640,
    }
}

/// The width of a text in pixels, at a size of the font in pixels.
pub(crate) fn width(text: &str, size: f64) -> f64 {
    let of = |c: char| {
        let known = (c as usize).checked_sub(32).and_then(|i| WIDTHS.get(i).copied());
        u64::from(known.unwrap_or_else(|| other(c)))
    };
    text.chars().map(of).sum::<u64>() as f64 * size / 1000.0
}
