//! Drive files: what the controller must know of a drive before it switches it on.
//!
//! [`load()`] reads and judges one; the crate `esi` makes them of vendors' ESI files.

mod keys;
mod load;
pub mod rules;

pub use keys::{
    DriveFile, Identity, Limits, Mailbox, ManagerPurpose, Mapping, Mode, OptionCodes, ProcessData,
    Scaling, Sdo, StartUp, SyncManager, SyncMode,
};
pub use load::{Judged, load, parse, schema};
