//! The process group of a cell: started, supervised, restarted, stopped.

pub mod check;
pub mod children;
pub mod desk;
mod disk_room;
mod events;
mod fault_injector;
mod group;
mod hangs;
pub mod hints;
pub mod observers;
pub mod options;
pub mod origin;
pub mod progress;
pub mod retention;
pub mod run;
pub mod run_dir;
mod service_manager;
mod session;
mod signal_watch;
#[cfg(test)]
#[path = "../../tests/spoilt.rs"]
mod spoilt;
mod standby_alarm;
pub mod supervise;
pub mod supervisor;
mod training;
pub mod up;
pub mod user_codes;
