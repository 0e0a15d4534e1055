//! What was found, for people; the new file, and the old one beside it.

use std::fs::{self, File};
use std::io::Write;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};

use anyhow::{Context, anyhow};
use machine::Machine;
use toml_edit::DocumentMut;

use super::identify::Found;
use crate::options::TuneOptions;
use launcher::exit::{Kind, Outcome};
use launcher::output::say;

/// The table of what was identified.
pub fn findings(machine: &Machine, all: &[Found]) -> String {
    let mut text = String::from(
        "axis     mass friction  static  Stribeck  viscous | table friction stiffness    gap  lost motion | unexplained\n           kg        N   ratio      mm/s    N·s/m |    kg        N      N/µm     µm           µm | torque N",
    );
    for (axis, found) in machine.axes.iter().zip(all) {
        text += &format!(
            "\n{:4} {:8.1} {:8.1} {:7.3} {:9.2} {:8.0} |",
            axis.name,
            found.mass_kg(),
            found.coulomb_n(),
            found.motor.static_ratio,
            found.motor.stribeck_mm_s,
            found.viscous_n_s_per_m(),
        );
        text += &found
            .table
            .map_or(format!(" {:49} |", "no scale: not known"), |table| {
                format!(
                    " {:5.1} {:8.1} {:9.1} {:6.2} {:12.2} |",
                    table.mass_kg,
                    table.friction.coulomb_n(),
                    table.stiffness_n_per_um,
                    table.gap_um,
                    found.lost_motion_um(),
                )
            });
        text += &format!(
            " {:.1}; cogging {:.3} N·m, {} a turn",
            found.residual_n, found.cogging_nm, found.cogging_per_turn
        );
    }
    text
}

/// A file that the product itself would not read is not written.
///
/// # Errors
/// Why not.
pub fn check(document: &DocumentMut) -> anyhow::Result<()> {
    Machine::parse("the settings found", &document.to_string())
        .map(|_| ())
        .map_err(|error| anyhow!("the model does not fit, nothing is written: {error}"))
}

/// Writes the file that was asked for, or shows it.
pub fn write(options: &TuneOptions, path: &Path, document: &DocumentMut) -> Outcome {
    let text = document.to_string();
    if options.dry_run {
        say(&text);
        return Ok(());
    }
    if let Some(out) = &options.out {
        replace(out, &text).environment()?;
        say(&format!("written: {}", out.display()));
        return Ok(());
    }
    let kept = free_name(path);
    fs::copy(path, &kept)
        .with_context(|| kept.display().to_string())
        .environment()?;
    replace(path, &text).environment()?;
    say(&format!(
        "written: {}; the old one is {}",
        path.display(),
        kept.display()
    ));
    Ok(())
}

/// The whole file or none of it, also where the PC loses its power.
pub(crate) fn replace(path: &Path, text: &str) -> anyhow::Result<()> {
    let folder = match path.parent() {
        Some(folder) if folder != Path::new("") => folder,
        _ => Path::new("."),
    };
    let mode = fs::metadata(path).map_or(0o644, |found| found.permissions().mode() & 0o777);
    let written = || -> std::io::Result<()> {
        let mut new = tempfile::Builder::new()
            .prefix(".quadrant-")
            .permissions(fs::Permissions::from_mode(mode))
            .tempfile_in(folder)?;
        new.write_all(text.as_bytes())?;
        new.as_file().sync_all()?;
        new.persist(path)?;
        File::open(folder)?.sync_all()
    };
    written().with_context(|| path.display().to_string())
}

/// `machine.toml.before-tune`, numbered from 2 where that is taken.
fn free_name(path: &Path) -> PathBuf {
    let named = |suffix: &str| {
        let mut name = path.as_os_str().to_owned();
        name.push(suffix);
        PathBuf::from(name)
    };
    let first = named(".before-tune");
    if !first.exists() {
        return first;
    }
    (2_u32..)
        .map(|number| named(&format!(".before-tune-{number}")))
        .find(|name| !name.exists())
        .unwrap_or(first)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_replaced_whole_keeps_its_mode_and_leaves_nothing_beside_it() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("machine.toml");
        for (mode, text) in [(0o640, "first"), (0o600, "second, longer")] {
            fs::write(&file, "before").expect("a file");
            fs::set_permissions(&file, fs::Permissions::from_mode(mode)).expect("a mode");
            replace(&file, text).expect("replaced");
            assert_eq!(fs::read_to_string(&file).expect("the file"), text);
            let found = fs::metadata(&file).expect("the file").permissions();
            assert_eq!(found.mode() & 0o777, mode);
        }
        assert_eq!(fs::read_dir(folder.path()).expect("the folder").count(), 1);
        let missing = folder.path().join("nowhere").join("machine.toml");
        assert!(replace(&missing, "").is_err());
    }
}
