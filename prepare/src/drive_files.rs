//! `quadrant bus`, and of it `drive-file`, `io-file` and `check`: drive and terminal files, made of a vendor's ESI file and checked
//! against it.

use std::fs::{self, OpenOptions};
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, anyhow};
use esi::{Device, Esi, choose, choose_terminal};
use fieldbus::cia402::OperatingMode;
use fieldbus::drive_file::{self, DriveFile, Identity};
use fieldbus::process_data::{self, Pdo};
use fieldbus::terminal_file::{self, TerminalFile};

use crate::options::{
    BusCheckOptions, BusCommand, BusOptions, DriveFileOptions, EsiOptions, IoFileOptions,
};
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
        BusCommand::IoFile(options) => make_terminal(options),
        BusCommand::Check(options) => check(options),
        BusCommand::Scan(options) => bus_scan::scan(options),
        BusCommand::Sdo(options) => bus_sdo::sdo(options),
    }
}

fn make(options: &DriveFileOptions) -> Outcome {
    let esi = Esi::load(&options.of.esi).input()?;
    let device = choose(&esi, options.of.choice(None)).input()?;
    let mut modes = OperatingMode::ALL.into_iter();
    let mode = options
        .mode
        .as_deref()
        .and_then(|word| modes.find(|mode| mode.word() == word));
    let made = esi::from_esi(&esi, device, mode, options.axes).input()?;
    let path = written(&options.of, "drives", device);
    write_new(&path, &esi::write(&made.drive, device))?;
    let shown = path.display();
    let drive = &made.drive;
    let words = made.mapping_words();
    say(&format!("{shown}: {}, {words}", drive_words(drive)));
    for warning in &made.warnings {
        say(&format!("  warning: {warning}"));
    }
    say(&format!(
        "Fill in [scaling], then: quadrant bus check {shown} --esi {}",
        options.of.esi.display()
    ));
    Ok(())
}

fn make_terminal(options: &IoFileOptions) -> Outcome {
    let esi = Esi::load(&options.of.esi).input()?;
    let device = choose_terminal(&esi, options.of.choice(options.device)).input()?;
    let made = esi::terminal_from_esi(&esi, device).input()?;
    let path = written(&options.of, "terminals", device);
    let text = esi::write_terminal(&made, device);
    let shown = path.display();
    write_new(&path, &text)?;
    say(&format!("{shown}: {}", terminal_words(&made)));
    for channel in &made.channels {
        let (number, name) = (channel.number, &channel.name);
        let (way, kind) = (channel.direction.word(), channel.kind.word());
        say(&format!("  channel {number:3}  {way:6}  {kind:7}  {name}"));
    }
    say(&format!(
        "In machine.toml: [[bus.terminal]] with slave = its place on the cable and file = \"{shown}\""
    ));
    Ok(())
}

fn check(options: &BusCheckOptions) -> Outcome {
    let esi = options.esi.as_deref().map(Esi::load).transpose().input()?;
    let text = machine::settings_file::read_text(&options.file).input()?;
    let mut lines = text.lines();
    let (words, warnings) = if lines.any(|line| line.trim_start().starts_with("[[channel]]")) {
        let judged = terminal_file::load(&options.file, |all, terminal| {
            if let Some(esi) = &esi {
                esi::judge_terminal(all, terminal, esi);
            }
        });
        (terminal_words(&judged.input()?), Vec::new())
    } else {
        let judged = drive_file::load(&options.file, |all, drive| {
            if let Some(esi) = &esi {
                esi::judge(all, drive, esi);
            }
        });
        let judged = judged.input()?;
        (drive_words(&judged.drive), judged.warnings)
    };
    let shown = options.file.display();
    let fits = esi.map_or(String::new(), |esi| format!(", fits {}", esi.file));
    say(&format!("{shown}: {words}{fits}: good"));
    for warning in &warnings {
        say(&format!("  warning: {warning}"));
    }
    Ok(())
}

/// A device in one line.
fn in_words(of: &Identity, more: &str, receive: &[Pdo], transmit: &[Pdo]) -> String {
    let (name, product, revision) = (&of.name, of.product_code, of.revision);
    let (to, from) = (process_data::bytes(receive), process_data::bytes(transmit));
    format!(
        "{name} (product 0x{product:08X}, revision 0x{revision:08X}), {more}, {to} bytes to it and {from} from it"
    )
}

fn drive_words(drive: &DriveFile) -> String {
    let (mode, data) = (drive.mode.operate.word(), &drive.process_data);
    in_words(
        &drive.identity,
        &format!("mode {mode}"),
        &data.receive,
        &data.transmit,
    )
}

fn terminal_words(terminal: &TerminalFile) -> String {
    let (count, data) = (terminal.channels.len(), &terminal.process_data);
    in_words(
        &terminal.identity,
        &format!("{count} channels"),
        &data.receive,
        &data.transmit,
    )
}

/// The file that is written.
fn written(of: &EsiOptions, folder: &str, device: &Device) -> PathBuf {
    let named = of.out.clone();
    named.unwrap_or_else(|| default_path(folder, device))
}

/// `drives/NAME.toml` or `terminals/NAME.toml`, of the device's short name.
fn default_path(folder: &str, device: &Device) -> PathBuf {
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
    let name = match name {
        "" => folder.trim_end_matches('s'),
        name => name,
    };
    Path::new(folder).join(format!("{name}.toml"))
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
            default_path("drives", &device).display().to_string()
        };
        assert_eq!(of("EVS-NET-01"), "drives/evs-net-01.toml");
        assert_eq!(of("CiA402 Motor (Drive)"), "drives/cia402-motor-drive.toml");
        assert_eq!(of("../../etc"), "drives/etc.toml");
        assert_eq!(of("驱动"), "drives/drive.toml");
    }
}
