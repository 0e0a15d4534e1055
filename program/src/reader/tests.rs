use proptest::prelude::*;

use super::*;
use crate::refusal::column;

/// #1 is 2, #<depth> is 7, the rest 0.
struct Few;

impl Lookup for Few {
    fn numbered(&self, number: u32) -> Result<f64, Refusal> {
        Ok(if number == 1 { 2.0 } else { 0.0 })
    }

    fn named(&self, name: &str) -> Option<f64> {
        (name == "depth").then_some(7.0)
    }
}

fn read(text: &str) -> Result<Line, Refusal> {
    let mut line = Line::default();
    read_line(text, &Few, &mut line).map(|()| line)
}

fn words(text: &str) -> Vec<(char, f64)> {
    read(text)
        .unwrap()
        .words
        .iter()
        .map(|word| (word.letter, word.value))
        .collect()
}

fn value(text: &str) -> f64 {
    words(&format!("X[{text}]"))[0].1
}

#[test]
fn words_need_no_spaces_and_no_upper_case() {
    assert_eq!(
        words("g1x5.Y-3z+.5"),
        [('G', 1.0), ('X', 5.0), ('Y', -3.0), ('Z', 0.5)]
    );
    assert_eq!(words("\tG 01  X 1.25 ; rest G2"), [('G', 1.0), ('X', 1.25)]);
}

#[test]
fn blanks_inside_a_number_mean_nothing_and_are_told() {
    let line = read("X1 2 . 5 Y- 3").unwrap();
    assert_eq!((line.words[0].value, line.words[1].value), (12.5, -3.0));
    assert!(line.blanks_in_number);
    assert!(!read("X12.5 Y3").unwrap().blanks_in_number);
}

#[test]
fn comments_are_skipped_wherever_they_stand() {
    assert_eq!(words("(a) G1 (b; ü) X2 ( c )"), [('G', 1.0), ('X', 2.0)]);
}

#[test]
fn comments_that_say_something_are_kept() {
    let line = read("(MSG, change the jaws) G0 X1 (debug, #1)").unwrap();
    assert_eq!(
        line.comments,
        [
            (CommentKind::Message, "change the jaws".to_owned()),
            (CommentKind::Debug, "#1".to_owned())
        ]
    );
}

#[test]
fn numbers_keep_their_full_precision() {
    assert_eq!(words("X219.123456789")[0].1, 219.123_456_789);
}

#[test]
fn percent_and_block_delete_are_recognised() {
    assert!(read("  % (start)").unwrap().percent);
    assert!(read("/G1X1").unwrap().block_delete);
}

#[test]
fn parameters_are_used_and_set() {
    assert_eq!(
        words("X#1 Y-#1 Z##1 A#<De pth>"),
        [('X', 2.0), ('Y', -2.0), ('Z', 0.0), ('A', 7.0)]
    );
    let line = read("#5=[#1*3] #<new>=1").unwrap();
    assert_eq!(
        line.assignments,
        [
            (Target::Numbered(5), 6.0),
            (Target::Named("new".into()), 1.0)
        ]
    );
}

/// Values from LinuxCNC 2.9's interpreter.
#[test]
fn expressions_bind_as_linuxcnc_reads_them() {
    for (text, expected) in [
        ("2**3**2", 64.0),
        ("2+3*4 EQ 14", 1.0),
        ("1 XOR 1 AND 0", 0.0),
        ("1 OR 0 AND 0", 0.0),
        ("-5 MOD 3", 1.0),
        ("5 MOD -3", 2.0),
        ("10 - 4 + 3", 9.0),
        ("-2**2", 4.0),
        ("2*3**2", 18.0),
        ("-7 / 2 * 3", -10.5),
        ("1 EQ 1.0000999", 1.0),
        ("1 EQ 1.00011", 0.0),
        ("1 GE 1.00005", 0.0),
        ("1 EQ 2 GT 1", 0.0),
        ("3 LT 2 + 2", 1.0),
        ("ROUND[-2.5]", -3.0),
        ("ROUND[0.5]", 1.0),
        ("FIX[-1.5]", -2.0),
        ("FUP[-1.5]", -1.0),
        ("ATAN[-1]/[-1]", -135.0),
        ("EXISTS[#<depth>] + EXISTS[#<none>]", 1.0),
        ("SIN[30] * 2", 1.0),
        ("SQRT[ABS[-16]]", 4.0),
    ] {
        assert!(
            (value(text) - expected).abs() < 1e-12,
            "{text}: {}",
            value(text)
        );
    }
}

#[test]
fn each_malformed_line_is_refused_at_its_place() {
    for (text, offset) in [
        ("G1 X", 4),
        ("G1 X-", 5),
        ("G1 X.", 4),
        ("G1 X1.2.3", 7),
        ("G1 X--1", 5),
        ("G1 (open", 3),
        ("G1 (a(b)", 5),
        ("G1 X[1+2", 4),
        ("G1 X[1 2 FOO]", 9),
        ("G1 X[1/0]", 6),
        ("G1 X#<none>", 4),
        ("G1 XSQRT[-1]", 4),
        ("#1 5", 0),
        ("#9999=1", 0),
        ("G1 X1 )", 6),
        ("G1 X5*33", 5),
        ("% G1", 2),
        ("G1 / X1", 3),
        ("5 X1", 0),
        ("; ok\rG1 X5", 4),
        ("G1 \u{e4}", 3),
    ] {
        assert_eq!(read(text).unwrap_err().offset, offset, "{text}");
    }
}

#[test]
fn a_number_too_large_is_refused() {
    assert!(read(&format!("X{}", "9".repeat(400))).is_err());
}

#[test]
fn brackets_without_end_are_refused() {
    assert!(read(&format!("X{}", "[".repeat(100_000))).is_err());
    assert!(read(&format!("X{}1", "-#".repeat(100_000))).is_err());
}

#[test]
fn a_line_of_endless_words_is_refused() {
    assert_eq!(read(&"G1".repeat(1000)).unwrap_err().offset, 128);
}

#[test]
fn columns_count_characters_not_bytes() {
    assert_eq!(column("(äö) Q", "(äö) ".len()), 6);
}

proptest! {
    #[test]
    fn any_line_is_read_or_refused_inside_itself(text in "\\PC{0,60}") {
        match read(&text) {
            Ok(line) => prop_assert!(line.words.iter().all(|word| word.offset < text.len())),
            Err(unreadable) => prop_assert!(unreadable.offset <= text.len()),
        }
    }

    #[test]
    fn any_expression_is_read_or_refused_inside_itself(text in "[\\[\\]#<>a-e0-9+*/. -]{0,60}") {
        let text = format!("X[{text}");
        match read(&text) {
            Ok(line) => prop_assert!(line.words.iter().all(|word| word.value.is_finite())),
            Err(unreadable) => prop_assert!(unreadable.offset <= text.len()),
        }
    }
}
