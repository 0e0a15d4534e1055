use std::io::Write;

use proptest::prelude::*;

use super::*;

fn file_of(bytes: &[u8]) -> (tempfile::NamedTempFile, Text) {
    let mut file = tempfile::NamedTempFile::new().unwrap();
    file.write_all(bytes).unwrap();
    let text = Text::of_file(file.reopen().unwrap()).unwrap();
    (file, text)
}

fn lines(text: &mut Text) -> Vec<(String, u64)> {
    let (mut lines, mut byte) = (vec![], 0);
    while let Some((line, behind)) = text.line(byte).unwrap() {
        lines.push((line.to_owned(), behind));
        byte = behind;
    }
    lines
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 60, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn a_file_has_the_lines_of_its_text(long in prop::collection::vec(0..70_000usize, 0..6), text in "[a-zß\r\n]{0,60}", jumps in prop::collection::vec(any::<prop::sample::Index>(), 20)) {
        let mut whole = text;
        for length in long {
            whole += &"x".repeat(length);
            whole += "ä\n";
        }
        let (_kept, mut file) = file_of(whole.as_bytes());
        let expected = lines(&mut Text::of(&whole));
        prop_assert_eq!(&lines(&mut file), &expected);
        prop_assert_eq!(file.hash().unwrap(), hash_of(whole.as_bytes()));
        let begins: Vec<u64> = [0].into_iter().chain(expected.iter().map(|line| line.1)).collect();
        for jump in jumps {
            let at = jump.index(expected.len());
            let (line, behind) = file.line(begins[at]).unwrap().unwrap();
            prop_assert_eq!((line, behind), (expected[at].0.as_str(), expected[at].1));
        }
        let Text::File(file) = file else { unreachable!() };
        prop_assert!(file.windows.len() <= WINDOWS_MAX);
        prop_assert!(file.windows.iter().all(|window| window.bytes.capacity() <= 4 * PIECE_BYTES));
    }
}

#[test]
fn a_byte_order_mark_is_no_text() {
    let (_kept, mut text) = file_of(b"\xEF\xBB\xBFG0 X1\r\nM2");
    assert_eq!(lines(&mut text), [("G0 X1".into(), 7), ("M2".into(), 10)]);
    assert_eq!(text.hash().unwrap(), hash_of(b"G0 X1\r\nM2"));
}

#[test]
fn what_is_no_text_is_refused_at_its_place() {
    for (bytes, offset, part) in [
        (&b"G0\n(gr\xFC\xDF)\n"[..], 3, "byte 0xFC is not UTF-8 text"),
        (&b"G0\nX\x001\n"[..], 1, "a byte that is zero"),
    ] {
        let (_kept, mut text) = file_of(bytes);
        assert!(text.line(0).is_ok());
        let error = text.line(3).unwrap_err();
        assert_eq!(error.offset, offset);
        assert!(error.found.contains(part), "{error:?}");
    }
    let (_kept, mut text) = file_of(&vec![b'x'; 3 << 20]);
    let error = text.line(0).unwrap_err();
    assert!(error.found.contains("a line of more than"), "{error:?}");
}

#[test]
fn a_file_that_shrinks_or_changes_is_refused() {
    let whole = "G0 X1\n".repeat(50_000);
    for (length, part) in [(100_000, "the file ends after"), (300_001, "was changed")] {
        let (kept, mut text) = file_of(whole.as_bytes());
        assert!(text.line(0).unwrap().is_some());
        kept.as_file().set_len(length).unwrap();
        let error = text.line(120_000).unwrap_err();
        assert!(error.found.contains(part), "{error:?}");
    }
}
