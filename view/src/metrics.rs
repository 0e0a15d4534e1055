//! Metrics of a running cell for Prometheus and its kind: OpenMetrics text from a process of its own (docs/howto/metrics.md).
//!
//! A reader descends so: the socket is opened before anything starts ([`place`]) and handed to the process that serves ([`serve`])
//! as its standard input. There `watch` puts what it hears of the cell, as every observer does, into `numbers`, atomics alone; a
//! thread of its own answers scrapes (`server`) with what stands there (`exposition`). The cell waits for neither.

mod exposition;
mod interval;
mod numbers;
pub mod place;
mod served;
mod server;
mod watch;

pub use watch::serve;
