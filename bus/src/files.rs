//! Opens files that others may have put something else in the place of: without waiting, and only what is a file. All of the product opens
//! files here, or makes new ones (a test of the house holds it).

use std::fs::{File, OpenOptions, Permissions};
use std::io;
use std::os::unix::fs::{MetadataExt, OpenOptionsExt, PermissionsExt};
use std::path::Path;

use rustix::fs::OFlags;
use rustix::process::geteuid;

/// Opens a regular file; nobody waits at a pipe for its other end.
///
/// # Errors
/// It cannot be opened, or it is something else.
pub fn open_regular(path: &Path, options: &mut OpenOptions) -> io::Result<File> {
    open(path, options, OFlags::NONBLOCK)
}

/// The same where nobody has reason to put a link.
///
/// # Errors
/// As [`open_regular`]; or it is a link.
pub fn open_unlinked(path: &Path, options: &mut OpenOptions) -> io::Result<File> {
    open(path, options, OFlags::NONBLOCK | OFlags::NOFOLLOW)
}

fn open(path: &Path, options: &mut OpenOptions, flags: OFlags) -> io::Result<File> {
    let file = options.custom_flags(flags.bits() as i32).open(path)?;
    match file.metadata()?.is_file() {
        true => Ok(file),
        false => Err(io::Error::new(
            io::ErrorKind::InvalidInput,
            "is no regular file",
        )),
    }
}

/// Opens a regular file to read it.
///
/// # Errors
/// As [`open_regular`].
pub fn open_to_read(path: &Path) -> io::Result<File> {
    open_regular(path, File::options().read(true))
}

/// Opens a file to write or to lock, which is made if there is none, for its owner alone: a user who may open it may keep it locked.
///
/// # Errors
/// As [`open_unlinked`].
pub fn open_own(path: &Path) -> io::Result<File> {
    let mut options = File::options();
    options.create(true).truncate(false).read(true).write(true);
    options.mode(0o600);
    let file = open_unlinked(path, &mut options)?;
    let found = file.metadata()?;
    let is_open_to_others = found.permissions().mode() & 0o077 != 0;
    if is_open_to_others && found.uid() == geteuid().as_raw() {
        file.set_permissions(Permissions::from_mode(0o600))?;
    }
    Ok(file)
}

#[cfg(test)]
mod tests {
    use std::fs;

    use rustix::fs::{CWD, FileType, Mode, mknodat};

    use super::*;

    #[test]
    fn a_file_of_ones_own_is_its_owners_alone_and_nothing_but_a_file_is_one() {
        let folder = std::env::temp_dir().join(format!("quadrant-files-{}", std::process::id()));
        fs::create_dir(&folder).expect("a folder");
        let mode = |name: &str| fs::metadata(folder.join(name)).map(|found| found.mode() & 0o777);
        let own = |name: &str| open_own(&folder.join(name));
        own("new").expect("it is made");
        assert_eq!(mode("new").expect("it is there"), 0o600);
        fs::write(folder.join("old"), "").expect("a file");
        fs::set_permissions(folder.join("old"), Permissions::from_mode(0o644)).expect("its mode");
        own("old").expect("it is closed to others");
        assert_eq!(mode("old").expect("it is there"), 0o600);
        mknodat(
            CWD,
            folder.join("pipe"),
            FileType::Fifo,
            Mode::RUSR | Mode::WUSR,
            0,
        )
        .expect("a pipe");
        std::os::unix::fs::symlink("new", folder.join("link")).expect("a link");
        for name in ["pipe", "link", "."] {
            assert!(own(name).is_err(), "{name}");
        }
        let read = open_to_read(&folder.join("pipe"));
        assert!(read.is_err_and(|error| error.to_string().contains("no regular file")));
        let _ = fs::remove_dir_all(&folder);
    }
}
