//! Plain numbers, read fast: those of few digits, exactly as the standard library reads them.

/// Powers of ten that are exact.
const TENS: [f64; 23] = [
    1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12, 1e13, 1e14, 1e15, 1e16,
    1e17, 1e18, 1e19, 1e20, 1e21, 1e22,
];
/// Whole numbers up to here are exact.
const EXACT_MAX: u64 = 1 << 53;
/// The most digits of one that is read here; more could wrap round.
const DIGITS_MAX: usize = 18;
/// The largest number a word may have, in whatever unit; far beyond any machine, far within exact arithmetic.
pub const NUMBER_MAX: f64 = 1e9;

/// A number of few digits without blanks in it, and where it ends; none for others, and where a blank and a digit follow.
///
/// Its digits and its power of ten are exact, so that their quotient is the nearest number to the text.
pub fn number(text: &[u8], start: usize) -> Option<(f64, usize)> {
    let mut at = start;
    let sign = text.get(at).copied();
    if matches!(sign, Some(b'+' | b'-')) {
        at += 1;
    }
    let (mut digits, mut count, mut behind_point) = (0u64, 0, None);
    loop {
        match text.get(at) {
            Some(digit @ b'0'..=b'9') => {
                digits = digits
                    .wrapping_mul(10)
                    .wrapping_add(u64::from(digit - b'0'));
                count += 1;
            }
            Some(b'.') if behind_point.is_none() => behind_point = Some(count),
            Some(b'.' | b' ' | b'\t') => {
                let mut next = at;
                while matches!(text.get(next), Some(b' ' | b'\t')) {
                    next += 1;
                }
                if matches!(text.get(next), Some(b'0'..=b'9' | b'.')) {
                    return None;
                }
                break;
            }
            _ => break,
        }
        at += 1;
    }
    if count == 0 || count > DIGITS_MAX || digits > EXACT_MAX {
        return None;
    }
    let decimals = behind_point.map_or(0, |before| count - before);
    let value = digits as f64 / TENS.get(decimals)?;
    let value = if sign == Some(b'-') { -value } else { value };
    (value.abs() <= NUMBER_MAX).then_some((value, at))
}
