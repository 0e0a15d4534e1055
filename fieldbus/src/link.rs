//! The wire: a raw socket on a network interface, and the frame of a cycle. A cycle allocates nothing and ends whatever arrives.

mod cycle;
mod frame;
mod interface;
mod socket;

pub use cycle::{Cycle, Found};
pub(crate) use frame::AL_STATUS;
pub use frame::{CycleFrame, Received, Tag, request_state};
pub(crate) use frame::{INIT, OPERATIONAL};
pub use interface::{Interface, interfaces};
pub use socket::{FRAME_BYTES_MAX, LinkError, Origin, Socket};
