//! Files of a cell that its processes map: pages of atomic words.

use std::fmt;
use std::fs::File;
use std::ops::Deref;
use std::os::fd::AsFd;
use std::os::unix::fs::OpenOptionsExt;
use std::path::Path;
use std::ptr::NonNull;

use rustix::mm::{MapFlags, ProtFlags};

use crate::cell::{CellError, CellPaths};
use crate::files::open_unlinked;
use crate::room;

/// What a page is mapped as.
///
/// # Safety
/// Several processes may touch everything in it at once, and any bytes are valid.
pub(crate) unsafe trait Layout {}

/// A file of a cell, mapped until this is dropped.
pub(crate) struct MappedPage<L: Layout> {
    layout: NonNull<L>,
}

impl<L: Layout> fmt::Debug for MappedPage<L> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "a page at {:p}", self.layout)
    }
}

// SAFETY: as `Layout` promises.
unsafe impl<L: Layout> Send for MappedPage<L> {}
// SAFETY: as above.
unsafe impl<L: Layout> Sync for MappedPage<L> {}

impl<L: Layout> Drop for MappedPage<L> {
    fn drop(&mut self) {
        // SAFETY: mapped by `map` with this length, and no reference outlives `self`.
        let _ = unsafe { rustix::mm::munmap(self.layout.as_ptr().cast(), size_of::<L>()) };
    }
}

impl<L: Layout> Deref for MappedPage<L> {
    type Target = L;

    fn deref(&self) -> &L {
        // SAFETY: mapped for the life of `self`, aligned to a page, any bytes are valid.
        unsafe { self.layout.as_ref() }
    }
}

impl<L: Layout> MappedPage<L> {
    /// Maps a file of a cell; makes the file, all of it 0, if `create`.
    ///
    /// # Errors
    /// [`CellError::System`], [`CellError::NoRoom`]; a file of another size is of another version of quadrant.
    pub fn map(place: &CellPaths, path: &Path, create: bool) -> Result<MappedPage<L>, CellError> {
        let system = |what: &str, source| CellError::System {
            cell: place.name().into(),
            what: what.into(),
            source,
        };
        let mut options = File::options();
        options
            .read(true)
            .write(true)
            .create_new(create)
            .mode(0o600);
        let file = open_unlinked(path, &mut options)
            .map_err(|e| system("opening its page (does it run?)", e))?;
        let length = size_of::<L>();
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
        let layout = NonNull::new(address.cast()).ok_or_else(|| CellError::Transport {
            cell: place.name().into(),
            what: "its page was mapped nowhere".into(),
        })?;
        Ok(MappedPage { layout })
    }
}
