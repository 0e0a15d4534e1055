//! The drive of our own, in both revisions.

use esi::{Choice, Esi, choose};
use fieldbus::cia402::{DriveMode, OperatingMode};
use fieldbus::drive_file::Mapping;
use fieldbus::process_data::{Entry, find};

use crate::support::{TESTOR, check, drive_file, filled_in, testor};

const FIXED: u32 = 0x0001_0000;
const WRITABLE: u32 = 0x0002_0000;

#[test]
fn the_same_product_code_is_read_from_hexadecimal_and_decimal() {
    let esi = testor();
    assert_eq!(
        (esi.vendor, esi.vendor_name.as_str()),
        (0x00FF_FFFE, "Testor & Sons")
    );
    let codes: Vec<u32> = esi
        .devices
        .iter()
        .map(|device| device.product_code)
        .collect();
    assert_eq!(codes, [0x1234, 0x1234, 0x2000]);
    let second = &esi.devices[1];
    assert_eq!(second.name, "TS-1 servo drive 2.0");
    assert!(second.receive_pdo(0x1601).is_some_and(|pdo| !pdo.fixed));
    assert!(second.transmit_pdo(0x1A00).is_some_and(|pdo| pdo.fixed));
    assert_eq!(
        second.transmit_pdo(0x1A00).map(|pdo| pdo.entries[0].index),
        Some(0x6041)
    );
}

#[test]
fn defaults_are_read_from_values_and_from_bytes_with_their_sign() {
    let esi = testor();
    let dictionary = &esi.devices[1].dictionary;
    assert_eq!(dictionary.default_of(0x605A, 0), Some(-1));
    assert_eq!(dictionary.default_of(0x605C, 0), Some(-2));
    assert_eq!(
        dictionary.get(0x605C, 0).and_then(|object| object.min),
        Some(-3)
    );
    assert_eq!(dictionary.default_of(0x60C2, 2), Some(-3));
    assert_eq!(dictionary.default_of(0x6502, 0), Some(0x3A0));
    assert_eq!(dictionary.highest_sub(0x1601), Some(6));
    let of_first = &esi.devices[0].dictionary;
    assert_eq!(of_first.default_of(0x6502, 0), Some(0x3A0));
}

#[test]
fn a_fixed_mapping_is_taken_with_its_gaps_of_bits() {
    let esi = testor();
    let judged =
        check(&filled_in(&drive_file(&esi, FIXED)), Some(&esi)).expect("a good drive file");
    let data = &judged.drive.process_data;
    assert_eq!(
        (data.receive_mapping, data.transmit_mapping),
        (Mapping::Fixed, Mapping::Fixed)
    );
    let gap = data.receive[0].entries[3];
    assert!(gap.is_gap() && gap.bits == 7, "{gap:?}");
    assert_eq!(
        find(&data.receive, 0x6060, 0),
        Some((56, Entry::of(0x6060, 0, 8)))
    );
    let limit = find(&data.receive, 0x6072, 0).map(|(_, entry)| entry.value);
    assert_eq!(
        limit,
        Some(3500),
        "a limit is sent as it comes from the factory"
    );
    let warnings = judged.warnings.join("\n");
    for words in [
        "605E (fault reaction option code) = 0",
        "60B2 (torque offset)",
        "60C2",
    ] {
        assert!(warnings.contains(words), "no {words} in {warnings}");
    }
}

#[test]
fn a_writable_mapping_holds_what_the_mode_wants() {
    let esi = testor();
    let judged =
        check(&filled_in(&drive_file(&esi, WRITABLE)), Some(&esi)).expect("a good drive file");
    let drive = &judged.drive;
    let data = &drive.process_data;
    assert_eq!(
        (data.receive_mapping, data.transmit_mapping),
        (Mapping::Written, Mapping::Written)
    );
    let objects = |pdos: &[fieldbus::process_data::Pdo]| -> Vec<u16> {
        pdos[0].entries.iter().map(|entry| entry.index).collect()
    };
    assert_eq!(
        (data.receive[0].index, data.transmit[0].index),
        (0x1601, 0x1A01)
    );
    assert_eq!(objects(&data.receive), [0x6040, 0x60FF, 0x60B2, 0x6060]);
    assert_eq!(
        objects(&data.transmit),
        [0x6041, 0x6064, 0x606C, 0x6077, 0x603F, 0x6061]
    );
    assert_eq!(data.limits.receive_entries, Some(6));
    assert_eq!(
        (data.limits.receive_pdos, data.limits.receive_bytes),
        (Some(1), Some(64))
    );
    assert_eq!(drive.mode.operate, OperatingMode::Csv);
    let cyclic = [
        DriveMode::Homing,
        DriveMode::Csp,
        DriveMode::Csv,
        DriveMode::Cst,
    ];
    assert_eq!(drive.mode.supported, cyclic);
    let sync: Vec<u16> = drive
        .sync_modes
        .iter()
        .map(|mode| mode.assign_activate)
        .collect();
    assert_eq!(sync, [0x300, 0]);
    assert_eq!(drive.sync_modes[0].sync0_shift_ns, 250_000);
    let mailbox = drive.mailbox;
    assert!(mailbox.complete_access && mailbox.pdo_assign && mailbox.pdo_config);
    assert_eq!(
        (mailbox.request_timeout_ms, mailbox.response_timeout_ms),
        (150, 3000)
    );
    assert_eq!(judged.warnings, Vec::<String>::new());
}

#[test]
fn reactions_that_may_coast_are_set_to_brake_where_the_drive_lets() {
    let esi = testor();
    let judged =
        check(&filled_in(&drive_file(&esi, WRITABLE)), Some(&esi)).expect("a good drive file");
    let drive = &judged.drive;
    assert!(drive.start_up.interpolation_time);
    let written: Vec<(u16, u8, i64)> = drive
        .start_up
        .sdos
        .iter()
        .map(|sdo| (sdo.index, sdo.sub, sdo.value))
        .collect();
    // 605D and 605E brake from the factory; 2010:3 is the vendor's own, 6060 and 2011 are not taken from it.
    let expected = [
        (0x605A, 0, 6),
        (0x605C, 0, 1),
        (0x6007, 0, 3),
        (0x2010, 3, 0x1234),
    ];
    assert_eq!(written, expected);
    assert_eq!(
        drive.option_codes.quick_stop,
        Some(-1),
        "as it comes from the factory"
    );
    let text = drive_file(&esi, WRITABLE);
    assert!(
        text.contains("quick_stop = -1 # 605A: WARNING: the vendor's own meaning"),
        "{text}"
    );
}

#[test]
fn another_mode_takes_other_process_data_and_is_set_at_start_up_where_it_is_not_in_them() {
    let esi = testor();
    for (mode, target) in [(OperatingMode::Csp, 0x607A), (OperatingMode::Cst, 0x6071)] {
        let device = &esi.devices[1];
        let made = esi::from_esi(&esi, device, Some(mode), None).expect("a drive file");
        assert!(
            find(&made.drive.process_data.receive, target, 0).is_some(),
            "{mode:?}"
        );
        let text = filled_in(&esi::write(&made.drive, device));
        check(&text, Some(&esi)).expect("a good drive file");
    }
    let text = String::from_utf8_lossy(TESTOR);
    let without = text.replace(
        "<Access>rw</Access><PdoMapping>r</PdoMapping>",
        "<Access>rw</Access>",
    );
    let esi = Esi::parse("testor.xml", without.as_bytes()).expect("a good ESI file");
    let made = esi::from_esi(&esi, &esi.devices[1], None, None).expect("a drive file");
    assert_eq!(find(&made.drive.process_data.receive, 0x6060, 0), None);
    let first = &made.drive.start_up.sdos[0];
    assert_eq!((first.index, first.bits, first.value), (0x6060, 8, 9));
}

#[test]
fn several_revisions_are_listed_with_what_to_write() {
    let esi = testor();
    let error = choose(&esi, Choice::default()).expect_err("two drives");
    let expected = "testor.xml: 2 drives fit: say which, by one of\
        \n  --product 0x00001234 --revision 0x00010000   TS-1 servo drive 1.0\
        \n  --product 0x00001234 --revision 0x00020000   TS-1 servo drive 2.0";
    assert_eq!(error.to_string(), expected);
    for product in ["0x1234", "#x1234", "4660", "TS-1", "servo DRIVE"] {
        let choice = Choice {
            device: None,
            product: Some(product),
            revision: Some(WRITABLE),
        };
        assert_eq!(
            choose(&esi, choice).map(|device| device.revision),
            Ok(WRITABLE),
            "{product}"
        );
    }
    let choice = Choice {
        device: None,
        product: None,
        revision: Some(7),
    };
    let error = choose(&esi, choice)
        .expect_err("no such revision")
        .to_string();
    assert!(
        error.contains("no device is the one that was named")
            && error.contains("--revision 0x00020000"),
        "{error}"
    );
}

#[test]
fn inputs_and_outputs_that_are_no_drive_are_refused() {
    let esi = testor();
    let choice = Choice {
        device: None,
        product: Some("TI-8"),
        revision: None,
    };
    let error = choose(&esi, choice).expect_err("no drive").to_string();
    assert!(
        error.contains("TI-8 digital inputs and outputs is no CiA 402 drive"),
        "{error}"
    );
    assert!(esi::from_esi(&esi, &esi.devices[2], None, None).is_err());
}

#[test]
fn what_is_not_filled_in_is_refused_with_what_to_write() {
    let esi = testor();
    let error = check(&drive_file(&esi, WRITABLE), Some(&esi)).expect_err("not filled in");
    let lines: Vec<&str> = error.lines().collect();
    assert_eq!(lines.len(), 5, "{error}");
    for (line, key) in lines.iter().zip([
        "scaling.position_increments",
        "scaling.velocity_units",
        "scaling.rated_torque_nm",
        "scaling.direction",
        "scaling.dead_time_scans",
    ]) {
        assert!(
            line.contains(&format!("{key} is not filled in: write ")),
            "{line}"
        );
    }
}

#[test]
fn a_watchdog_that_is_off_is_warned_of_and_may_be_switched_on() {
    let text = String::from_utf8_lossy(TESTOR);
    let without = text.replace("ControlByte=\"#x64\"", "ControlByte=\"#x24\"");
    let esi = Esi::parse("testor.xml", without.as_bytes()).expect("a good ESI file");
    let file = filled_in(&drive_file(&esi, WRITABLE));
    let judged = check(&file, Some(&esi)).expect("a good drive file");
    assert!(
        judged.warnings.join("\n").contains("write control = 0x64"),
        "{:?}",
        judged.warnings
    );
    let judged = check(
        &file.replace("control = 0x24", "control = 0x64"),
        Some(&esi),
    );
    assert_eq!(judged.map(|judged| judged.warnings), Ok(Vec::new()));
}

#[test]
fn a_device_of_two_axes_is_warned_of() {
    let text = String::from_utf8_lossy(TESTOR);
    let channels = "<ChannelInfo><ProfileNo>402</ProfileNo></ChannelInfo>".repeat(2);
    let two = text.replace("<ProfileNo>402</ProfileNo>", &channels);
    let esi = Esi::parse("testor.xml", two.as_bytes()).expect("a good ESI file");
    let made = esi::from_esi(&esi, &esi.devices[1], None, None).expect("a drive file");
    assert!(
        made.warnings.join("\n").contains("2 axes on one device"),
        "{:?}",
        made.warnings
    );
}
