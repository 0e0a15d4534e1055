//! The parameters that programs of a cell keep from one run to the next: which file of the user holds them, and what each run started with.

use std::ffi::OsString;
use std::fs::{self, File};
use std::io::{self, ErrorKind, Write};
use std::os::unix::ffi::OsStringExt;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};

use crate::files::open_unlinked;
pub use crate::paths::KeptFile;
use crate::paths::{CellPaths, if_there};

/// How often this process has asked for what a run begins with.
static ASKED: AtomicU32 = AtomicU32::new(0);

/// Says which file holds them: for the launcher, before anybody else is there.
///
/// # Errors
/// The cell's folder cannot be written.
pub fn name_kept_file(paths: &CellPaths, which: KeptFile, file: &Path) -> io::Result<()> {
    fs::write(paths.kept_file(which), file.as_os_str().as_encoded_bytes())
}

/// The file of the user that holds them; none where a cell has none.
///
/// # Errors
/// The cell's folder cannot be read.
pub fn kept_file(paths: &CellPaths, which: KeptFile) -> io::Result<Option<PathBuf>> {
    let name = if_there(fs::read(paths.kept_file(which)))?;
    Ok(name.map(|name| PathBuf::from(OsString::from_vec(name))))
}

/// The text that a run of a program begins with, kept in a file of this run: whoever asks first makes it, and all others get the same.
///
/// # Errors
/// It cannot be made, or the cell's folder cannot be written.
pub fn text_of_run<E: From<io::Error>>(
    of_run: &Path,
    now: impl FnOnce() -> Result<String, E>,
) -> Result<String, E> {
    if let Some(text) = if_there(fs::read_to_string(of_run))? {
        return Ok(text);
    }
    let text = now()?;
    // A link is made whole, and by one alone: of a file that no other thread or process has.
    let asked = ASKED.fetch_add(1, Ordering::Relaxed);
    let mut mine = of_run.to_path_buf().into_os_string();
    mine.push(format!(".{}.{asked}", std::process::id()));
    let mut options = File::options();
    options.write(true).create(true).truncate(true);
    let mut file = open_unlinked(Path::new(&mine), &mut options)?;
    file.write_all(text.as_bytes())?;
    let linked = fs::hard_link(&mine, of_run);
    let _ = fs::remove_file(&mine);
    match linked {
        Err(error) if error.kind() != ErrorKind::AlreadyExists => Err(error.into()),
        _ => Ok(fs::read_to_string(of_run)?),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_run_has_the_parameters_that_it_began_with_whoever_asks_and_whatever_is_written_since() {
        let paths = CellPaths::new(&format!("kept-{}", std::process::id())).expect("a name");
        fs::create_dir(paths.folder()).expect("the folder");
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("mill.var");
        let named = || kept_file(&paths, KeptFile::Parameters).expect("readable");
        assert_eq!(named(), None, "this cell keeps none");
        name_kept_file(&paths, KeptFile::Parameters, &file).expect("written");
        assert_eq!(named().as_ref(), Some(&file));
        let of_run = |run| {
            let now =
                || Ok::<_, io::Error>(if_there(fs::read_to_string(&file))?.unwrap_or_default());
            text_of_run(&paths.parameters(1, run), now).expect("readable")
        };
        assert_eq!(of_run(1), "", "not there yet");
        fs::write(&file, "100 1\n").expect("written");
        for _ in 0..50 {
            let all = std::thread::scope(|scope| {
                let asked = [(); 8].map(|()| scope.spawn(|| of_run(2)));
                asked.map(|one| one.join().expect("an answer"))
            });
            assert!(all.iter().all(|text| text == "100 1\n"), "{all:?}");
            fs::remove_file(paths.parameters(1, 2)).expect("removed");
        }
        assert_eq!(of_run(2), "100 1\n");
        fs::write(&file, "100 2\n").expect("written");
        assert_eq!((of_run(1).as_str(), of_run(2).as_str()), ("", "100 1\n"));
        assert_eq!(of_run(3), "100 2\n");
        let count = || fs::read_dir(paths.folder()).expect("the folder").count();
        let left = count();
        paths.forget_runs_before(3);
        let then = count();
        fs::remove_dir_all(paths.folder()).expect("removed");
        assert_eq!(left, 1 + 3, "the name of the file, and three runs");
        assert_eq!(then, 1 + 2, "the last two");
    }
}
