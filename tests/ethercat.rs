//! A cell over EtherCAT, against a segment of foreign drives in a network namespace of its own.
//!
//! A binary of its own, because it needs the right to make network namespaces. What else it needs: docs/developers/foreign-drives.md.

// Each test binary uses a part of it.
#[allow(dead_code)]
#[path = "support.rs"]
mod support;

#[path = "ethercat/by_hand.rs"]
mod by_hand;
#[path = "ethercat/causes.rs"]
mod causes;
#[path = "ethercat/cells.rs"]
mod cells;
#[path = "ethercat/clocks.rs"]
mod clocks;
#[path = "ethercat/commands.rs"]
mod commands;
#[path = "ethercat/esi_drives.rs"]
mod esi_drives;
#[path = "ethercat/kickcat.rs"]
mod kickcat;
#[path = "ethercat/kills.rs"]
mod kills;
#[path = "ethercat/live.rs"]
mod live;
#[path = "ethercat/multi_axis.rs"]
mod multi_axis;
#[path = "ethercat/observed.rs"]
mod observed;
#[path = "ethercat/runs.rs"]
mod runs;
#[path = "ethercat/segment.rs"]
mod segment;
#[path = "ethercat/spindle.rs"]
mod spindle;
#[path = "ethercat/start_ups.rs"]
mod start_ups;
#[path = "ethercat/terminals.rs"]
mod terminals;
#[path = "ethercat/touch_probe.rs"]
mod touch_probe;
#[path = "ethercat/troubles.rs"]
mod troubles;
#[path = "ethercat/wrong_configurations.rs"]
mod wrong_configurations;
