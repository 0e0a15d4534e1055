//! Numbers as ESI files write them: `#x1A00` (ETG.2000, type HexDecValue), `0x1A00`, decimal, and little-endian bytes (`DefaultData`).

/// A whole number: `#x…` and `0x…` hexadecimal, else decimal; a sign may stand before it.
pub fn whole(text: &str) -> Option<i64> {
    let text = text.trim();
    let (negative, digits) = match text.strip_prefix('-') {
        Some(digits) => (true, digits),
        None => (false, text.strip_prefix('+').unwrap_or(text)),
    };
    let hexadecimal = ["#x", "#X", "0x", "0X"];
    let hexadecimal = hexadecimal.iter().find_map(|x| digits.strip_prefix(x));
    let (digits, radix) = hexadecimal.map_or((digits, 10), |digits| (digits, 16));
    // A second sign would be taken by the library.
    if !digits.starts_with(|c: char| c.is_digit(radix)) {
        return None;
    }
    let value = i64::from_str_radix(digits, radix).ok()?;
    Some(if negative { -value } else { value })
}

/// A number that fits into a narrower type.
pub fn narrow<T: TryFrom<i64>>(text: &str) -> Option<T> {
    T::try_from(whole(text)?).ok()
}

/// `true`, `false`, `1` or `0`.
pub fn flag(text: &str) -> Option<bool> {
    match text.trim() {
        "1" | "true" | "True" | "TRUE" => Some(true),
        "0" | "false" | "False" | "FALSE" => Some(false),
        _ => None,
    }
}

/// Bytes in hexadecimal digits, the lowest first, at most eight of them.
pub fn little_endian(text: &str) -> Option<u64> {
    let digits: Vec<u32> = text
        .chars()
        .filter(|c| !c.is_whitespace())
        .map(|c| c.to_digit(16))
        .collect::<Option<_>>()?;
    if digits.is_empty() || !digits.len().is_multiple_of(2) || digits.len() > 16 {
        return None;
    }
    let bytes = digits.chunks_exact(2).rev();
    Some(bytes.fold(0, |value, pair| {
        pair.iter()
            .fold(value, |value, digit| (value << 4) | u64::from(*digit))
    }))
}

/// What a field of so many bits means, where it is signed.
pub fn sign_extended(value: i64, bits: u32) -> i64 {
    match 64_u32.checked_sub(bits) {
        Some(unused) if unused < 64 => (value << unused) >> unused,
        _ => value,
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn hexadecimal_of_both_kinds_and_decimal_numbers_are_read() {
        for (text, value) in [
            ("#x1A00", 0x1A00),
            ("#X1a00", 0x1A00),
            ("0x1A00", 0x1A00),
            (" 0X1a00\n", 0x1A00),
            ("46338049", 46_338_049),
            ("0010", 10),
            ("-3", -3),
            ("-#x10", -16),
            ("+7", 7),
        ] {
            assert_eq!(whole(text), Some(value), "{text:?}");
        }
    }

    #[test]
    fn what_is_no_number_is_none() {
        for text in [
            "",
            "#x",
            "0x",
            "x10",
            "1A",
            "#xZZ",
            "--3",
            "#x-3",
            "1 2",
            "#xFFFFFFFFFFFFFFFFF",
        ] {
            assert_eq!(whole(text), None, "{text:?}");
        }
        assert_eq!(narrow::<u16>("#x10000"), None);
        assert_eq!(narrow::<u8>("-1"), None);
    }

    #[test]
    fn bytes_are_read_lowest_first() {
        assert_eq!(little_endian("e5030f00"), Some(0x000F_03E5));
        assert_eq!(little_endian("ff ff"), Some(0xFFFF));
        assert_eq!(little_endian("fff"), None);
        assert_eq!(sign_extended(0xFFFF, 16), -1);
        assert_eq!(sign_extended(0x7FFF, 16), 0x7FFF);
        assert_eq!(sign_extended(-5, 64), -5);
    }

    proptest! {
        #[test]
        fn every_number_is_the_same_in_every_form(value: u32) {
            let value = i64::from(value);
            prop_assert_eq!(whole(&format!("#x{value:08X}")), Some(value));
            prop_assert_eq!(whole(&format!("0x{value:x}")), Some(value));
            prop_assert_eq!(whole(&value.to_string()), Some(value));
            prop_assert_eq!(whole(&format!("-{value}")), Some(-value));
        }

        #[test]
        fn no_text_makes_it_panic(text: String, bits: u32) {
            let value = whole(&text);
            let _ = (little_endian(&text), flag(&text));
            let _ = sign_extended(value.unwrap_or(-1), bits);
        }
    }
}
