//! Whatever the bytes of an ESI file are, its reader answers.

use esi::Esi;
use proptest::prelude::*;
use rand_xoshiro::Xoshiro256PlusPlus;
use rand_xoshiro::rand_core::{Rng, SeedableRng};

use crate::support::{TESTOR, check, filled_in};
use crate::vendors::{VENDORS_FILES, vendors_file};

/// Files that are damaged.
const FILES: u64 = 3000;
/// Those that are damaged of each vendor's: they are larger.
const FILES_OF_A_VENDOR: u64 = 100;

/// Reads damaged bytes to the end: drive files of all devices, each read back and held against the file.
fn read(bytes: &[u8]) -> bool {
    let Ok(esi) = Esi::parse("damaged.xml", bytes) else {
        return false;
    };
    for device in &esi.devices {
        if let Ok(made) = esi::from_esi(&esi, device, None, None) {
            let text = esi::write(&made.drive, device);
            let _ = check(&text, Some(&esi));
        }
    }
    true
}

/// Bytes that are changed, cut out, doubled or cut off at places that the seed tells.
fn damaged(bytes: &[u8], seed: u64) -> Vec<u8> {
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed);
    let mut bytes = bytes.to_vec();
    for _ in 0..=rng.next_u64() % 6 {
        let at = (rng.next_u64() as usize) % bytes.len();
        let other = (rng.next_u64() as usize) % bytes.len();
        let length = (rng.next_u64() as usize) % 40;
        match rng.next_u64() % 20 {
            0 => bytes[at] = rng.next_u64() as u8,
            1 => bytes.truncate(at.max(1)),
            2 => drop(bytes.drain(at..(at + length).min(bytes.len()))),
            3 => {
                let copy = bytes[other..(other + length).min(bytes.len())].to_vec();
                bytes.splice(at..at, copy);
            }
            // Digits do not break the XML: the numbers of a drive get wrong.
            _ => {
                let digit = bytes.iter().skip(at).position(u8::is_ascii_digit);
                bytes[at + digit.unwrap_or(0)] = b"0123456789ABCDEFx-"[other % 18];
            }
        }
        if bytes.is_empty() {
            bytes.push(b'<');
        }
    }
    bytes
}

/// How many of so many damaged files are still read.
fn still_read(bytes: &[u8], files: u64) -> u64 {
    let mut readable = 0;
    for seed in 0..files {
        let bytes = damaged(bytes, seed);
        let outcome = std::panic::catch_unwind(|| read(&bytes));
        readable += u64::from(outcome.unwrap_or_else(|_| panic!("panics: seed {seed}")));
    }
    readable
}

#[test]
fn damaged_bytes_never_make_the_reader_panic() {
    let readable = still_read(TESTOR, FILES);
    // Damage that leaves no file readable would show nothing.
    assert!(readable > FILES / 4, "{readable} of {FILES} are still read");
}

#[test]
fn damaged_files_of_vendors_never_make_the_reader_panic() {
    for name in VENDORS_FILES {
        if let Some(path) = vendors_file(name) {
            still_read(
                &std::fs::read(path).expect("an ESI file"),
                FILES_OF_A_VENDOR,
            );
        }
    }
}

#[test]
fn numbers_out_of_all_bounds_never_make_the_reader_panic() {
    let text = String::from_utf8_lossy(TESTOR).into_owned();
    for number in [
        "#xFFFFFFFFFFFFFFFF",
        "-1",
        "",
        "99999999999999999999",
        "0",
        "65535",
        "#x",
    ] {
        for key in [
            "BitLen",
            "BitSize",
            "SubIndex",
            "Index",
            "SubIdx",
            "Elements",
            "LBound",
            "DefaultValue",
        ] {
            let parts: Vec<&str> = text.split(&format!("<{key}>")).collect();
            let mut damaged = parts[0].to_string();
            for part in &parts[1..] {
                let (_, rest) = part.split_once("</").expect("an end");
                damaged += &format!("<{key}>{number}</{rest}");
            }
            read(damaged.as_bytes());
        }
    }
}

#[test]
fn xml_that_is_nested_deeply_or_refers_to_itself_is_refused() {
    let depth = 200_000;
    let nested = format!("{}{}", "<a>".repeat(depth), "</a>".repeat(depth));
    let outcome = std::thread::Builder::new()
        .stack_size(1 << 20)
        .spawn(move || Esi::parse("nested.xml", nested.as_bytes()).is_err())
        .expect("a thread")
        .join();
    assert!(outcome.expect("no overflow of the stack"));
    let laughs = "<!DOCTYPE a [<!ENTITY b \"&b;&b;\">]><EtherCATInfo>&b;</EtherCATInfo>";
    let error = Esi::parse("laughs.xml", laughs.as_bytes()).expect_err("a DTD");
    assert!(
        error.to_string().starts_with("laughs.xml:1: is no XML"),
        "{error}"
    );
}

#[test]
fn what_is_wrong_in_an_esi_file_is_named_with_its_line() {
    let text = String::from_utf8_lossy(TESTOR).into_owned();
    for (what, by, expected) in [
        (
            "<BitLen>7</BitLen>",
            "<BitLen>seven</BitLen>",
            "<BitLen> must be a number of bits from 1",
        ),
        (
            "ProductCode=\"4660\"",
            "ProductCode=\"TS-1\"",
            "ProductCode = \"TS-1\": must be a number",
        ),
        (
            "<Index>#x1601</Index><Name>Free",
            "<Index>1601h</Index><Name>Free",
            "a PDO without an index",
        ),
        ("<Id>#x00FFFFFE</Id>", "", "has no vendor"),
        ("</Vendor>", "</Vender>", "is no XML"),
        (
            "EtherCATInfo",
            "Catalogue",
            "is no ESI file: begins with <Catalogue>",
        ),
    ] {
        assert!(text.contains(what), "{what}");
        let damaged = text.replace(what, by);
        let error = Esi::parse("x.xml", damaged.as_bytes())
            .expect_err(expected)
            .to_string();
        let line = text
            .lines()
            .position(|line| line.contains(what))
            .expect("a line")
            + 1;
        assert!(
            error.contains(expected) && error.starts_with("x.xml:"),
            "{error}"
        );
        // What is missing is named with the line of what should hold it.
        if !by.is_empty() {
            let named = error
                .split(':')
                .nth(1)
                .and_then(|n| n.parse::<usize>().ok());
            assert!(
                named.is_some_and(|named| named.abs_diff(line) <= 3),
                "{error}, not line {line}"
            );
        }
    }
}

proptest! {
    #[test]
    fn text_of_any_kind_in_names_is_read_back(name in "[ -~\\t\u{80}-\u{2FFF}]{0,80}") {
        let quoted = name.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;");
        let text = String::from_utf8_lossy(TESTOR).replace("TS-1 servo drive 2.0", &quoted).replace("Abort connection", &quoted);
        let esi = Esi::parse("named.xml", text.as_bytes()).expect("a good ESI file");
        let device = &esi.devices[1];
        let made = esi::from_esi(&esi, device, None, None).expect("a drive file");
        let judged = check(&filled_in(&esi::write(&made.drive, device)), Some(&esi));
        prop_assert_eq!(judged.map(|judged| judged.drive.identity.name), Ok(device.name.clone()));
    }
}
