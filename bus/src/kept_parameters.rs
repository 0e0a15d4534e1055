//! The parameters that programs of a cell keep from one run to the next: which file of the user holds them, and what each run started with.

use std::ffi::OsString;
use std::fs::{self, OpenOptions};
use std::io::{self, ErrorKind, Write};
use std::os::unix::ffi::OsStringExt;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};

use crate::cell::{CellPaths, if_there};

/// How often this process has asked for what a run begins with.
static ASKED: AtomicU32 = AtomicU32::new(0);

/// Says which file holds them: for the launcher, before anybody else is there.
///
/// # Errors
/// The cell's folder cannot be written.
pub fn name_parameter_file(paths: &CellPaths, file: &Path) -> io::Result<()> {
    fs::write(paths.parameter_file(), file.as_os_str().as_encoded_bytes())
}

/// The file of the user that holds them; none where programs keep nothing.
///
/// # Errors
/// The cell's folder cannot be read.
pub fn parameter_file(paths: &CellPaths) -> io::Result<Option<PathBuf>> {
    let name = if_there(fs::read(paths.parameter_file()))?;
    Ok(name.map(|name| PathBuf::from(OsString::from_vec(name))))
}

/// The text of that file now, empty where it is not there yet; none where programs keep nothing.
///
/// # Errors
/// The file cannot be read.
pub fn parameters_now(paths: &CellPaths) -> io::Result<Option<String>> {
    let Some(file) = parameter_file(paths)? else {
        return Ok(None);
    };
    Ok(Some(
        if_there(fs::read_to_string(file))?.unwrap_or_default(),
    ))
}

/// The text that a run of a program begins with: whoever asks first takes it from the file, and all others get the same.
///
/// # Errors
/// The file cannot be read, or the cell's folder cannot be written.
pub fn parameters_of_run(paths: &CellPaths, load: u32, run: u32) -> io::Result<Option<String>> {
    let of_run = paths.parameters(load, run);
    if let Some(text) = if_there(fs::read_to_string(&of_run))? {
        return Ok(Some(text));
    }
    let Some(text) = parameters_now(paths)? else {
        return Ok(None);
    };
    // A link is made whole, and by one alone: of a file that no other thread or process has.
    let asked = ASKED.fetch_add(1, Ordering::Relaxed);
    let mut mine = of_run.clone().into_os_string();
    mine.push(format!(".{}.{asked}", std::process::id()));
    let mut options = OpenOptions::new();
    let mut file = options
        .write(true)
        .create(true)
        .truncate(true)
        .open(&mine)?;
    file.write_all(text.as_bytes())?;
    let linked = fs::hard_link(&mine, &of_run);
    let _ = fs::remove_file(&mine);
    match linked {
        Err(error) if error.kind() != ErrorKind::AlreadyExists => Err(error),
        _ => Ok(Some(fs::read_to_string(&of_run)?)),
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
        let of_run = |run| parameters_of_run(&paths, 1, run).expect("readable");
        assert_eq!(of_run(1), None, "this cell keeps none");
        name_parameter_file(&paths, &file).expect("written");
        assert_eq!(of_run(1).as_deref(), Some(""), "not there yet");
        fs::write(&file, "100 1\n").expect("written");
        for _ in 0..50 {
            let all = std::thread::scope(|scope| {
                let asked = [(); 8]
                    .map(|()| scope.spawn(|| parameters_of_run(&paths, 1, 2).expect("readable")));
                asked.map(|one| one.join().expect("an answer"))
            });
            assert!(
                all.iter().all(|text| text.as_deref() == Some("100 1\n")),
                "{all:?}"
            );
            fs::remove_file(paths.parameters(1, 2)).expect("removed");
        }
        assert_eq!(of_run(2).as_deref(), Some("100 1\n"));
        fs::write(&file, "100 2\n").expect("written");
        assert_eq!(of_run(1).as_deref(), Some(""));
        assert_eq!(of_run(2).as_deref(), Some("100 1\n"));
        assert_eq!(
            parameters_now(&paths).expect("readable").as_deref(),
            Some("100 2\n")
        );
        assert_eq!(of_run(3).as_deref(), Some("100 2\n"));
        let count = || fs::read_dir(paths.folder()).expect("the folder").count();
        let left = count();
        paths.forget_runs_before(3);
        let then = count();
        fs::remove_dir_all(paths.folder()).expect("removed");
        assert_eq!(left, 1 + 3, "the name of the file, and three runs");
        assert_eq!(then, 1 + 2, "the last two");
    }
}
