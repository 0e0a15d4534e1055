//! `quadrant bus`, and of it `drive-file` and `check`: drive files, made of a vendor's ESI file and checked against it.

use std::fs::{self, OpenOptions};
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, anyhow};
use esi::{Choice, Device, Esi, choose};
use fieldbus::cia402::OperatingMode;
use fieldbus::drive_file::{self, DriveFile};
use fieldbus::process_data;

use crate::options::{BusCheckOptions, BusCommand, BusOptions, DriveFileOptions};
use crate::{bus_scan, bus_sdo};
use console::exit::{Kind, Outcome};
use console::output::say;

/// Longest name of a file that is made of a drive's name, in letters.
const NAME_LETTERS_MAX: usize = 40;

/// `quadrant bus`.
///
/// # Errors
/// A file that cannot be used, or written; a segment that cannot be talked to.
pub fn bus(options: &BusOptions) -> Outcome {
    match &options.command {
        BusCommand::DriveFile(options) => make(options),
        BusCommand::Check(options) => check(options),
        BusCommand::Scan(options) => bus_scan::scan(options),
        BusCommand::Sdo(options) => bus_sdo::sdo(options),
    }
}

fn make(options: &DriveFileOptions) -> Outcome {
    let esi = Esi::load(&options.esi).input()?;
    let choice = Choice {
        product: options.product.as_deref(),
        revision: options.revision,
    };
    let device = choose(&esi, choice).input()?;
    let mut modes = OperatingMode::ALL.into_iter();
    let mode = options
        .mode
        .as_deref()
        .and_then(|word| modes.find(|mode| mode.word() == word));
    let made = esi::from_esi(&esi, device, mode).input()?;
    let path = options.out.clone().unwrap_or_else(|| default_path(device));
    write_new(&path, &esi::write(&made.drive, device))?;
    let shown = path.display();
    let drive = &made.drive;
    let words = made.mapping_words();
    say(&format!("{shown}: {}, {words}", in_words(drive)));
    for warning in &made.warnings {
        say(&format!("  warning: {warning}"));
    }
    say(&format!(
        "Fill in [scaling], then: quadrant bus check {shown} --esi {}",
        options.esi.display()
    ));
    Ok(())
}

fn check(options: &BusCheckOptions) -> Outcome {
    let esi = options.esi.as_deref().map(Esi::load).transpose().input()?;
    let judged = drive_file::load(&options.drive, |all, drive| {
        if let Some(esi) = &esi {
            esi::judge(all, drive, esi);
        }
    });
    let judged = judged.input()?;
    let shown = options.drive.display();
    let fits = esi.map_or(String::new(), |esi| format!(", fits {}", esi.file));
    say(&format!("{shown}: {}{fits}: good", in_words(&judged.drive)));
    for warning in &judged.warnings {
        say(&format!("  warning: {warning}"));
    }
    Ok(())
}

/// A drive in one line.
fn in_words(drive: &DriveFile) -> String {
    let identity = &drive.identity;
    let data = &drive.process_data;
    format!(
        "{} (product 0x{:08X}, revision 0x{:08X}), mode {}, {} bytes to it and {} from it",
        identity.name,
        identity.product_code,
        identity.revision,
        drive.mode.operate.word(),
        process_data::bytes(&data.receive),
        process_data::bytes(&data.transmit)
    )
}

/// `drives/NAME.toml`, of the drive's short name.
fn default_path(device: &Device) -> PathBuf {
    let mut name = String::new();
    for letter in device.type_name.chars() {
        if letter.is_ascii_alphanumeric() {
            name.push(letter.to_ascii_lowercase());
        } else if !name.is_empty() && !name.ends_with('-') {
            name.push('-');
        }
    }
    name.truncate(NAME_LETTERS_MAX);
    let name = name.trim_end_matches('-');
    let name = if name.is_empty() { "drive" } else { name };
    Path::new("drives").join(format!("{name}.toml"))
}

/// Writes a file that is not there yet: one that is may have been filled in.
fn write_new(path: &Path, text: &str) -> Outcome {
    let shown = path.display();
    if let Some(folder) = path
        .parent()
        .filter(|folder| !folder.as_os_str().is_empty())
    {
        let folder_shown = folder.display();
        fs::create_dir_all(folder)
            .with_context(|| format!("{folder_shown}: cannot be made"))
            .environment()?;
    }
    let file = OpenOptions::new().write(true).create_new(true).open(path);
    let mut file = match file {
        Ok(file) => file,
        Err(error) if error.kind() == ErrorKind::AlreadyExists => {
            let what = "is there already, and may have been filled in: remove it, or name another file with --out";
            return Err(anyhow!("{shown}: {what}")).input();
        }
        Err(error) => {
            return Err(error)
                .with_context(|| format!("{shown}: cannot be written"))
                .environment();
        }
    };
    file.write_all(text.as_bytes())
        .with_context(|| format!("{shown}: cannot be written"))
        .environment()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_drive_file_is_named_after_the_drive() {
        let of = |type_name: &str| {
            let device = Device {
                type_name: type_name.to_string(),
                ..Device::default()
            };
            default_path(&device).display().to_string()
        };
        assert_eq!(of("EVS-NET-01"), "drives/evs-net-01.toml");
        assert_eq!(of("CiA402 Motor (Drive)"), "drives/cia402-motor-drive.toml");
        assert_eq!(of("../../etc"), "drives/etc.toml");
        assert_eq!(of("驱动"), "drives/drive.toml");
    }
}
