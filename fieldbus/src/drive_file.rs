//! Drive files: what the controller must know of a drive before it switches it on.
//!
//! [`from_esi()`] makes one of a vendor's ESI file, [`write()`] gives it its comments, [`load()`] reads and judges it, by itself and against an
//! ESI file.

mod against;
mod from_esi;
mod keys;
mod load;
mod mapping;
mod rules;
mod write;

pub use from_esi::{Made, NotMade, from_esi};
pub use keys::{
    DriveFile, Identity, Limits, Mailbox, ManagerPurpose, Mapping, Mode, OptionCodes, ProcessData,
    Scaling, Sdo, StartUp, SyncManager, SyncMode,
};
pub use load::{Judged, load, parse, reference, schema};
pub use write::write;
