//! CiA 402 drives over EtherCAT: what their vendors say of them (ESI, ETG.2000), and the drive file that is made of it.
//!
//! Files alone so far: no thread, no socket, nothing that runs in a scan.

pub mod cia402;
pub mod drive_file;
pub mod esi;
pub mod process_data;
