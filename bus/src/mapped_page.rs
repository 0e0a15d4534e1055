//! Files of a cell that its processes map: pages of atomic words.

#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing
)]

use std::fs::OpenOptions;
use std::os::fd::AsFd;
use std::os::unix::fs::OpenOptionsExt;
use std::path::Path;
use std::ptr::NonNull;

use rustix::mm::{MapFlags, ProtFlags};

use crate::cell::{CellError, CellPaths};
use crate::room;

/// Maps a file of a cell as a layout of atomics that is valid for any bytes; makes the file, all of it 0, if `create`. Whoever has it
/// unmaps it.
///
/// # Errors
/// [`CellError::System`], [`CellError::NoRoom`]; a file of another size is of another version of quadrant.
pub(crate) fn map_page<Layout>(
    place: &CellPaths,
    path: &Path,
    create: bool,
) -> Result<NonNull<Layout>, CellError> {
    let system = |what: &str, source| CellError::System {
        cell: place.name().into(),
        what: what.into(),
        source,
    };
    let file = OpenOptions::new()
        .read(true)
        .write(true)
        .create_new(create)
        .mode(0o600)
        .open(path)
        .map_err(|e| system("opening its page (does it run?)", e))?;
    let length = size_of::<Layout>();
    if create {
        room::resize(file.as_fd(), length as u64).map_err(|e| {
            room::shortage(place.name()).unwrap_or_else(|| system("sizing its page", e.into()))
        })?;
    }
    let found = file
        .metadata()
        .map_err(|e| system("reading its page", e))?
        .len();
    if found != length as u64 {
        return Err(CellError::Transport {
            cell: place.name().into(),
            what: format!(
                "its page has {found} bytes, not {length}: another version of quadrant made it"
            ),
        });
    }
    // SAFETY: a fresh shared mapping of a file of exactly this length; the layout is valid for any bytes.
    let address = unsafe {
        rustix::mm::mmap(
            std::ptr::null_mut(),
            length,
            ProtFlags::READ | ProtFlags::WRITE,
            MapFlags::SHARED,
            &file,
            0,
        )
    }
    .map_err(|e| system("mapping its page", e.into()))?;
    NonNull::new(address.cast()).ok_or_else(|| CellError::Transport {
        cell: place.name().into(),
        what: "its page was mapped nowhere".into(),
    })
}
