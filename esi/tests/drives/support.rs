//! An ESI file of a vendor that does not exist, and what a user does with a drive file.

use esi::{Choice, Esi, choose};
use fieldbus::drive_file::{self, DriveFile, Judged};
use machine::settings_file::Rules;

/// Devices of a vendor that does not exist: a drive in two revisions, and a module of digital inputs and outputs.
pub const TESTOR: &[u8] = include_bytes!("testor.xml");

pub fn testor() -> Esi {
    Esi::parse("testor.xml", TESTOR).expect("a good ESI file")
}

/// The drive file of a revision, as the command writes it.
pub fn drive_file(esi: &Esi, revision: u32) -> String {
    let choice = Choice {
        revision: Some(revision),
        product: Some("ts-1"),
        device: None,
    };
    let device = choose(esi, choice).expect("one drive");
    let made = esi::from_esi(esi, device, None, None).expect("a drive file");
    esi::write(&made.drive, device)
}

/// What a user fills in.
pub fn filled_in(text: &str) -> String {
    let mut filled = text.to_string();
    for (key, value) in [
        ("position_increments = 0 ", "position_increments = 8388608 "),
        ("velocity_units = 0 ", "velocity_units = 8388608 "),
        ("rated_torque_nm = 0.0 ", "rated_torque_nm = 2.39 "),
        ("direction = 0 ", "direction = -1 "),
        ("dead_time_scans = 0 ", "dead_time_scans = 2 "),
    ] {
        assert_eq!(filled.matches(key).count(), 1, "{key} in {text}");
        filled = filled.replace(key, value);
    }
    filled
}

/// What `bus check` says: all that is wrong, or the drive file.
pub fn check(text: &str, esi: Option<&Esi>) -> Result<Judged, String> {
    let against = |rules: &mut Rules<'_>, drive: &DriveFile| {
        if let Some(esi) = esi {
            esi::judge(rules, drive, esi);
        }
    };
    drive_file::parse("drive.toml", text, against).map_err(|error| error.to_string())
}
