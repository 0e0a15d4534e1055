//! Files that are written as a whole or not at all.

use std::fs::{self, File, OpenOptions};
use std::io::{self, Write};
use std::os::unix::fs::{OpenOptionsExt, PermissionsExt};
use std::path::Path;

/// Writes a text in place of what a file held, as [`replace_with`] does.
///
/// # Errors
/// The folder or the file cannot be written.
pub fn replace_file(path: &Path, text: &str) -> io::Result<()> {
    replace_with(path, |file| file.write_all(text.as_bytes()))
}

/// Has something written in place of what a file held: all of it or nothing, also where the PC loses its power or the writer its life. What is
/// new lies beside it, as `.NAME.new`, until it is complete. A link keeps leading to its file; a device stays one.
///
/// # Errors
/// The folder or the file cannot be written, or what `write` fails with.
pub fn replace_with<E: From<io::Error>>(
    path: &Path,
    write: impl FnOnce(&mut File) -> Result<(), E>,
) -> Result<(), E> {
    let path = &match fs::canonicalize(path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => path.to_path_buf(),
        leads_to => leads_to?,
    };
    let folder = match path.parent() {
        Some(folder) if folder != Path::new("") => folder,
        _ => Path::new("."),
    };
    let mode = match fs::metadata(path) {
        Ok(found) if !found.is_file() => return Err(io::Error::other("is not a file").into()),
        found => found.map_or(0o644, |found| found.permissions().mode() & 0o777),
    };
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let new = folder.join(format!(".{name}.new"));
    // Whoever began to write it before has died over it.
    let _ = fs::remove_file(&new);
    let mut options = OpenOptions::new();
    let mut file = options.write(true).create_new(true).mode(mode).open(&new)?;
    let written = write(&mut file).and_then(|()| {
        file.sync_all()?;
        Ok(fs::rename(&new, path)?)
    });
    written.inspect_err(|_| {
        let _ = fs::remove_file(&new);
    })?;
    Ok(File::open(folder)?.sync_all()?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_replaced_with_its_mode_and_what_a_dead_writer_left_goes_with_it() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("mill.var");
        replace_file(&file, "one").expect("a new file");
        fs::set_permissions(&file, fs::Permissions::from_mode(0o600)).expect("a mode");
        fs::write(folder.path().join(".mill.var.new"), "ha").expect("half a file");
        let link = folder.path().join("link");
        std::os::unix::fs::symlink(&file, &link).expect("a link");
        replace_file(&link, "two").expect("the same file");
        assert_eq!(fs::read_to_string(&file).expect("the file"), "two");
        let mode = fs::metadata(&file).expect("the file").permissions().mode();
        assert_eq!(mode & 0o777, 0o600);
        assert_eq!(fs::read_dir(folder.path()).expect("the folder").count(), 2);
        assert!(fs::symlink_metadata(&link).expect("the link").is_symlink());
    }

    #[test]
    fn what_cannot_be_written_or_is_given_up_is_an_error_and_nothing_is_left() {
        let folder = tempfile::tempdir().expect("a folder");
        assert!(replace_file(&folder.path().join("no/mill.var"), "x").is_err());
        assert!(replace_file(folder.path(), "x").is_err());
        let half = |file: &mut File| {
            file.write_all(b"half")?;
            Err(io::Error::other("interrupted"))
        };
        assert!(replace_with(&folder.path().join("mill.var"), half).is_err());
        let device = folder.path().join("null");
        std::os::unix::fs::symlink("/dev/null", &device).expect("a link");
        let refused = replace_file(&device, "x").expect_err("a device");
        assert_eq!(refused.to_string(), "is not a file");
        fs::remove_file(&device).expect("the link");
        assert_eq!(fs::read_dir(folder.path()).expect("the folder").count(), 0);
    }
}
