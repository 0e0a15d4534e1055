//! ESI files of real drives. They are their vendors', and not here: where they are not found, these tests say how to get them.

use std::path::{Path, PathBuf};

use esi::{Choice, Esi, Made, choose};
use fieldbus::drive_file::Mapping;
use fieldbus::process_data::bytes;

use crate::support::{check, filled_in};

/// Six drives, and a module of inputs and outputs.
pub const VENDORS_FILES: [&str; 7] = [
    "Elmo_ECAT_00010420_V11.xml",
    "IS620N_v2.6.7.xml",
    "SV660_EOE_1Axis_V9.12.xml",
    "SOMANET_CiA_402.xml",
    "eve-xcr-e_esi.xml",
    "Ingenia_EVS-NET-01.xml",
    "iTegva_E7x_Series.xml",
];

/// A file of a vendor; `None` where it is not there.
pub fn vendors_file(name: &str) -> Option<PathBuf> {
    let beside = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/esi");
    let folder = std::env::var_os("QUADRANT_ESI").map_or(beside, PathBuf::from);
    let path = folder.join(name);
    if !path.exists() {
        eprintln!(
            "skipped: {} is not there. ESI files are given out by the vendors of drives for use with masters: download this one, and name \
             its folder with QUADRANT_ESI",
            path.display()
        );
        return None;
    }
    Some(path)
}

/// A drive file by one command, and after what is not known is filled in, by the check against the ESI file.
fn becomes_a_good_drive_file(name: &str, choice: Choice<'_>) -> Option<Made> {
    let esi = Esi::load(&vendors_file(name)?).unwrap_or_else(|error| panic!("{error}"));
    let device = choose(&esi, choice).unwrap_or_else(|error| panic!("{error}"));
    let made = esi::from_esi(&esi, device, None, None).unwrap_or_else(|error| panic!("{error}"));
    let text = esi::write(&made.drive, device);
    let refused = check(&text, Some(&esi)).expect_err("not filled in");
    assert_eq!(refused.lines().count(), 5, "{refused}");
    let judged =
        check(&filled_in(&text), Some(&esi)).unwrap_or_else(|wrong| panic!("{wrong}\n{text}"));
    let mut expected = made.drive.clone();
    expected.scaling = judged.drive.scaling;
    assert_eq!(judged.drive, expected, "what is written is what is read");
    Some(made)
}

fn sizes(made: &Made) -> (u32, u32) {
    let data = &made.drive.process_data;
    (bytes(&data.receive), bytes(&data.transmit))
}

#[test]
fn elmo_gold_becomes_a_drive_file_once_product_and_revision_are_named() {
    let name = "Elmo_ECAT_00010420_V11.xml";
    let Some(path) = vendors_file(name) else {
        return;
    };
    let esi = Esi::load(&path).expect("an ESI file");
    let asked = choose(&esi, Choice::default())
        .expect_err("four drives")
        .to_string();
    let lines: Vec<&str> = asked
        .lines()
        .filter(|line| line.contains("--product"))
        .collect();
    assert_eq!(lines.len(), 4, "{asked}");
    for product in ["0x00030924", "0x00030925"] {
        let choice = Choice {
            device: None,
            product: Some(product),
            revision: Some(0x0001_0420),
        };
        let made = becomes_a_good_drive_file(name, choice).expect("a drive file");
        let data = &made.drive.process_data;
        assert_eq!(data.receive_mapping, Mapping::Written);
        assert_eq!(data.receive[0].index, 0x1607);
        // This vendor's own PDOs are of whole words.
        assert_eq!(sizes(&made), (10, 16));
    }
    // The boot loader has nothing that a mode could be set by.
    let boot = &esi.devices[0];
    let refused = esi::from_esi(&esi, boot, None, None)
        .expect_err("no drive")
        .to_string();
    assert!(
        refused.contains("cannot be told its mode of operation (6060)"),
        "{refused}"
    );
}

#[test]
fn inovance_is620n_becomes_a_drive_file() {
    let Some(made) = becomes_a_good_drive_file("IS620N_v2.6.7.xml", Choice::default()) else {
        return;
    };
    assert!(
        made.drive.mode.supported.is_empty(),
        "6502 is 0 in this file"
    );
    assert!(!made.drive.start_up.interpolation_time);
    assert_eq!(made.drive.option_codes.quick_stop, Some(2));
}

#[test]
fn inovance_sv660n_becomes_a_drive_file() {
    let Some(made) = becomes_a_good_drive_file("SV660_EOE_1Axis_V9.12.xml", Choice::default())
    else {
        return;
    };
    let supported: Vec<&str> = made
        .drive
        .mode
        .supported
        .iter()
        .map(|mode| mode.word())
        .collect();
    assert!(supported.ends_with(&["csp", "csv", "cst"]), "{supported:?}");
    let coasting = made.drive.start_up.sdos.iter();
    let set: Vec<(u16, i64)> = coasting.map(|sdo| (sdo.index, sdo.value)).collect();
    assert!(set.contains(&(0x605C, 1)), "605C = 0 coasts: {set:?}");
}

#[test]
fn synapticon_somanet_becomes_a_drive_file_with_its_gaps() {
    let Some(made) = becomes_a_good_drive_file("SOMANET_CiA_402.xml", Choice::default()) else {
        return;
    };
    assert_eq!(sizes(&made), (29, 45));
    let data = &made.drive.process_data;
    assert_eq!(
        (data.receive_mapping, data.transmit_mapping),
        (Mapping::Fixed, Mapping::Fixed)
    );
    let gaps = data.receive[0]
        .entries
        .iter()
        .filter(|entry| entry.is_gap());
    assert!(gaps.clone().count() == 4 && gaps.clone().all(|gap| gap.bits == 7));
    let warnings = made.warnings.join("\n");
    assert!(
        warnings.contains("605A (quick stop option code): not known"),
        "{warnings}"
    );
}

#[test]
fn ingenia_eve_and_evs_become_drive_files() {
    for (name, quick_stop) in [("eve-xcr-e_esi.xml", 5), ("Ingenia_EVS-NET-01.xml", -1)] {
        let Some(made) = becomes_a_good_drive_file(name, Choice::default()) else {
            return;
        };
        let drive = &made.drive;
        assert_eq!(drive.option_codes.quick_stop, Some(quick_stop));
        assert_eq!(drive.option_codes.abort_connection, Some(1));
        let sdos = drive.start_up.sdos.iter();
        let set: Vec<(u16, i64)> = sdos.map(|sdo| (sdo.index, sdo.value)).collect();
        assert!(
            set.contains(&(0x605A, 6)) && set.contains(&(0x6007, 3)),
            "{set:?}"
        );
        assert!(drive.start_up.interpolation_time && drive.mailbox.complete_access);
        assert_eq!(drive.process_data.receive_mapping, Mapping::Written);
    }
}

#[test]
fn a_module_of_digital_inputs_and_outputs_is_refused() {
    let Some(path) = vendors_file("iTegva_E7x_Series.xml") else {
        return;
    };
    let esi = Esi::load(&path).expect("an ESI file");
    let refused = choose(&esi, Choice::default())
        .expect_err("no drive")
        .to_string();
    assert!(
        refused.contains("none of the 8 devices is a CiA 402 drive"),
        "{refused}"
    );
    assert!(esi.devices.iter().all(|device| !device.is_drive()));
    assert!(esi.devices.windows(2).all(|two| two[0].line < two[1].line));
}
