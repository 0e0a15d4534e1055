//! `quadrant bus sdo`: an object of a slave, read or written.

use fieldbus::cia402;
use fieldbus::start_up::{self, ObjectData};

use crate::bus_scan::open;
use crate::options::BusSdoOptions;
use console::exit::{Kind, Outcome};
use console::output::say;

/// `quadrant bus sdo`.
///
/// # Errors
/// The interface cannot be used, is used by a cell, nobody answers, or the slave refuses.
pub fn sdo(options: &BusSdoOptions) -> Outcome {
    let (index, sub) = options.object;
    let (_claim, socket) = open(&options.interface)?;
    let object = cia402::named(index, sub);
    let Some(value) = options.value else {
        let data = start_up::read_object(&socket, options.slave, index, sub).environment()?;
        say(&format!("{object} = {}", words(&data)));
        return Ok(());
    };
    let written =
        start_up::write_object(&socket, options.slave, options.object, value, options.bits)
            .environment()?;
    let or_unknown =
        |data: Option<ObjectData>| data.map_or("cannot be read".to_string(), |data| words(&data));
    say(&format!("{object} before: {}", or_unknown(written.before)));
    say(&format!(
        "{object} now:    {}",
        or_unknown(written.after.clone())
    ));
    let held = written.after.and_then(|data| data.number());
    if let Some(held) = held
        && held.signed() != value
        && i128::from(held.value) != i128::from(value)
    {
        say("It took another value than it was given: it cuts what is written to what it can do.");
    }
    Ok(())
}

/// Data in words: a number in all ways in which it may be meant, a text, or bytes.
fn words(data: &ObjectData) -> String {
    match (data.number(), data.text()) {
        (Some(number), text) => {
            let digits = number.bits.div_ceil(4) as usize;
            let mut words = format!("{}, 0x{:0digits$X}", number.value, number.value);
            if number.signed() < 0 {
                words += &format!(", signed {}", number.signed());
            }
            words += &format!(", {} bits", number.bits);
            // Eight letters are a number as well.
            if let Some(text) = text.filter(|text| text.len() > 4) {
                words += &format!(", as a text {text:?}");
            }
            words
        }
        (None, Some(text)) => format!("{text:?}"),
        (None, None) if data.bytes.is_empty() => "nothing: no bytes".into(),
        (None, None) => {
            let bytes: Vec<String> = data
                .bytes
                .iter()
                .map(|byte| format!("{byte:02X}"))
                .collect();
            format!("{} bytes: {}", data.bytes.len(), bytes.join(" "))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shown(bytes: &[u8]) -> String {
        let bytes = bytes.to_vec();
        words(&ObjectData { bytes })
    }

    #[test]
    fn a_number_is_shown_in_decimal_in_hexadecimal_and_with_its_sign() {
        assert_eq!(shown(&[0xFE, 0xFF]), "65534, 0xFFFE, signed -2, 16 bits");
        assert_eq!(shown(&[2]), "2, 0x02, 8 bits");
    }

    #[test]
    fn texts_and_other_data_are_shown_as_what_they_are() {
        assert_eq!(shown(b"AM M (sim)"), "\"AM M (sim)\"");
        assert_eq!(shown(&[1; 9]), "9 bytes: 01 01 01 01 01 01 01 01 01");
        assert_eq!(shown(&[]), "nothing: no bytes");
    }
}
