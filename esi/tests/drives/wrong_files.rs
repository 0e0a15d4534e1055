//! Drive files that are wrong: each thing in one line that says what to do.

use crate::support::{check, drive_file, filled_in, testor};

const FIXED: u32 = 0x0001_0000;
const WRITABLE: u32 = 0x0002_0000;

/// A good drive file of a revision, changed in one place, is refused in one line with these words.
fn refused(revision: u32, what: &str, by: &str, with_esi: bool, expected: &[&str]) {
    let esi = testor();
    let good = filled_in(&drive_file(&esi, revision));
    assert!(good.contains(what), "no {what} in {good}");
    let changed = good.replacen(what, by, 1);
    let error = check(&changed, with_esi.then_some(&esi)).expect_err(what);
    assert_eq!(error.lines().count(), 1, "{error}");
    let line: usize = error
        .split(':')
        .nth(1)
        .and_then(|number| number.parse().ok())
        .unwrap_or_else(|| panic!("no line in {error}"));
    assert!((1..=changed.lines().count()).contains(&line), "{error}");
    for words in expected {
        assert!(error.contains(words), "no {words:?} in: {error}");
    }
}

#[test]
#[expect(clippy::too_many_lines, reason = "a table")]
fn a_drive_file_is_judged_by_itself() {
    let alone =
        |what: &str, by: &str, expected: &[&str]| refused(WRITABLE, what, by, false, expected);
    alone(
        "    { index = 0x6040, bits = 16 }, # Controlword\n",
        "    { bits = 16 },\n",
        &[
            "process_data.receive has no 6040 (controlword)",
            "mode csv needs it",
        ],
    );
    alone(
        "    { index = 0x6041, bits = 16 }, # Statusword\n",
        "    { bits = 16 },\n",
        &["process_data.transmit has no 6041 (statusword)"],
    );
    alone(
        "operate = \"csv\"",
        "operate = \"cst\"",
        &[
            "process_data.receive has no 6071 (target torque)",
            "mode cst needs it",
        ],
    );
    alone(
        "supported = [\"homing\", \"csp\", \"csv\", \"cst\"]",
        "supported = [\"csp\", \"cst\"]",
        &["mode.operate = \"csv\": the drive supports csp, cst"],
    );
    alone(
        "{ index = 0x60FF, bits = 32 }",
        "{ index = 0x60FF, bits = 16 }",
        &["process_data.receive.1.entries.2 is 60FF (target velocity) with 16 bits: it has 32"],
    );
    alone(
        "{ index = 0x6060, bits = 8 }, # Mode of operation\n",
        "{ index = 0x6060, bits = 8 }, { bits = 7 },\n",
        &["process_data.receive is 79 bits", "add a gap, { bits = 1 }"],
    );
    alone(
        "receive_bytes = 64",
        "receive_bytes = 8",
        &["process_data.receive is 9 bytes: the drive takes 8"],
    );
    alone(
        "receive_entries = 6",
        "receive_entries = 3",
        &["process_data.receive.1.entries has 4 entries: the drive takes 3"],
    );
    alone(
        "position_increments = 8388608",
        "position_increments = 0",
        &["scaling.position_increments is not filled in: write the increments"],
    );
    alone(
        "value = 6 #",
        "value = 0 #",
        &[
            "option_codes.quick_stop = 0: 605A (quick stop option code): switches off: the axis coasts; set it to 6",
        ],
    );
    alone(
        "value = 3 #",
        "value = 2 #",
        &[
            "option_codes.abort_connection = 2",
            "the axis coasts; set it to 3",
        ],
    );
    alone(
        "value = 4660",
        "value = 466000",
        &["start_up.sdo.4.value = 466000: does not fit into 16 bits"],
    );
    alone(
        "bits = 16\nvalue = 4660",
        "bits = 12\nvalue = 4660",
        &["sdo.4.bits = 12 bits: must be 8, 16 or 32"],
    );
    alone(
        "index = 0x1601",
        "index = 0x1A01",
        &["process_data.receive.1.index = 0x1A01", "0x1600 to 0x17FF"],
    );
    alone(
        "purpose = \"mailbox-in\"",
        "purpose = \"inputs\"",
        &["sync_manager.2.purpose", "must be \"mailbox-in\""],
    );
    alone(
        "size_bytes = 128",
        "size_bytes = 0",
        &["sync_manager.1.size_bytes = 0 bytes"],
    );
    alone(
        "direction = -1",
        "direction = 2",
        &["scaling.direction = 2: must be at least -1 and at most 1"],
    );
    alone(
        "revision = 0x00020000",
        "revision = -1",
        &["identity.revision = -1: must be at least 0"],
    );
    alone(
        "operate = \"csv\"",
        "operate = \"pp\"",
        &["mode.operate: unknown variant `pp`"],
    );
    alone(
        "direction = -1",
        "direction = -1\nsign = -1",
        &["scaling: unknown field `sign`"],
    );
}

#[test]
fn process_data_that_hold_the_drive_back_are_refused() {
    let alone = |what: &str, by: &str, expected: &[&str]| refused(FIXED, what, by, false, expected);
    alone(
        ", value = 3500 }",
        " }",
        &["is 6072 (highest torque) with value 0: the drive would be held back to 0"],
    );
    alone(
        "{ index = 0x2601, bits = 1 }",
        "{ index = 0x60FF, bits = 32 }, { bits = 1 }",
        &["process_data.receive.1.entries.3 is 60FF once more"],
    );
}

#[test]
#[expect(clippy::too_many_lines, reason = "a table")]
fn a_drive_file_is_held_against_the_esi_file() {
    let against =
        |what: &str, by: &str, expected: &[&str]| refused(WRITABLE, what, by, true, expected);
    against(
        "vendor = 0x00FFFFFE",
        "vendor = 0x0000009A",
        &[
            "identity.vendor = 0x0000009A",
            "is of vendor 0x00FFFFFE (Testor & Sons)",
        ],
    );
    against(
        "product_code = 0x00001234",
        "product_code = 0x00001235",
        &[
            "identity.product_code = 0x00001235",
            "has 0x00001234, 0x00002000",
        ],
    );
    against(
        "revision = 0x00020000",
        "revision = 0x00020001",
        &[
            "identity.revision = 0x00020001",
            "has 0x00010000, 0x00020000",
            "--revision",
        ],
    );
    against(
        "{ index = 0x60B2, bits = 16 }",
        "{ index = 0x60B0, bits = 32 }, { bits = 16 }",
        &["process_data.receive.1.entries.3 is 60B0: the drive has no such object"],
    );
    against(
        "{ index = 0x60B2, bits = 16 }",
        "{ index = 0x2010, sub = 3, bits = 16 }",
        &["is 2010:3: the drive does not let it be mapped into what it receives"],
    );
    against(
        "receive_pdos = 1",
        "receive_pdos = 8",
        &["process_data.limits.receive_pdos = 8: the drive takes 1"],
    );
    against(
        "receive_entries = 6\n",
        "",
        &["process_data.limits.receive_entries is left out: the drive takes 6"],
    );
    against(
        "index = 0x1601",
        "index = 0x1602",
        &[
            "process_data.receive.1.index = 0x1602: the drive has no such PDO: it has 0x1600, 0x1601",
        ],
    );
    against(
        "index = 0x1601",
        "index = 0x1600",
        &["process_data.receive_mapping = \"written\": the entries of PDO 0x1600 are fixed"],
    );
    against(
        "index = 0x2010\nsub = 3",
        "index = 0x2010\nsub = 4",
        &["start_up.sdo.4 writes 2010:4: the drive has no such object"],
    );
    against(
        "bits = 16\nvalue = 4660",
        "bits = 32\nvalue = 4660",
        &["start_up.sdo.4.bits = 32 bits: 2010:3 has 16"],
    );
    against(
        "index = 0x2010\nsub = 3",
        "index = 0x6077",
        &["start_up.sdo.4 writes 6077 (actual torque): the drive lets it be read only"],
    );
    against(
        "value = 1 #",
        "value = 2 #",
        &["start_up.sdo.2.value = 2: 605C (disable operation option code) takes -3 to 1"],
    );
    against(
        "complete_access = true",
        "complete_access = false",
        &["mailbox.complete_access = false: the drive has true; write true"],
    );
    against(
        "start = 0x1100",
        "start = 0x1800",
        &["sync_manager.3.start = 0x1800: the drive has 0x1100"],
    );
    against(
        "assign_activate = 0x0300",
        "assign_activate = 0x0700",
        &["sync_mode.1.assign_activate = 0x0700: the drive has 0x0300, 0x0000"],
    );
}

#[test]
fn a_fixed_mapping_must_be_the_one_of_the_drive() {
    let against =
        |what: &str, by: &str, expected: &[&str]| refused(FIXED, what, by, true, expected);
    against(
        "{ bits = 7 }, # gap",
        "{ bits = 15 }, # gap",
        &[
            "process_data.receive.1.entries.4 is a gap of 15 bits: the fixed PDO has a gap of 7 bits there",
        ],
    );
    against(
        "    { index = 0x6072, bits = 16, value = 3500 }, # Max torque\n",
        "",
        &["process_data.receive.1.entries ends before 6072 of 16 bits, which the fixed PDO has"],
    );
    against(
        "receive_mapping = \"fixed\"",
        "receive_mapping = \"written\"",
        &[
            "process_data.receive_mapping = \"written\": mailbox.pdo_config = false: the drive's entries are fixed",
        ],
    );
    against(
        "interpolation_time = false",
        "interpolation_time = true",
        &["the drive has no 60C2:1 that can be written; write false"],
    );
}

#[test]
fn what_is_wrong_in_a_list_is_named_with_its_own_line() {
    let esi = testor();
    let good = filled_in(&drive_file(&esi, WRITABLE));
    for (what, by) in [
        ("index = 0x60B2, bits = 16", "index = 0x60B2, bits = 8"),
        ("index = 0x603F, bits = 16", "index = 0x603F, bits = 24"),
        ("value = 4660", "value = -40000"),
        ("start = 0x1080", "start = 0x1081"),
    ] {
        let at = good.lines().position(|line| line.contains(what));
        let line = at.expect("a line") + 1;
        let error = check(&good.replacen(what, by, 1), Some(&esi)).expect_err(what);
        for wrong in error.lines() {
            assert!(
                wrong.starts_with(&format!("drive.toml:{line}: ")),
                "{wrong}, not line {line}"
            );
        }
    }
}
