//! The process group of a cell: started, supervised, restarted, stopped; and the operator's commands to a running one.

pub mod check;
pub mod doctor;
pub mod events;
pub mod exit;
mod fault_injector;
mod group;
mod hangs;
pub mod hints;
pub mod logs;
pub mod metrics_socket;
pub mod operator;
pub mod options;
pub mod output;
pub mod progress;
pub mod report;
pub mod run;
pub mod run_dir;
mod service_manager;
mod session;
mod settings_difference;
pub mod signals;
mod standby_alarm;
pub mod supervise;
pub mod supervisor;
mod training;
pub mod up;
mod view;
