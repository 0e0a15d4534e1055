//! Keys and words of the machine file that had other names. `check` names the present one.

use crate::settings_file::Renamed;

const fn renamed(old: &'static str, new: &'static str) -> Renamed {
    Renamed { old, new }
}

/// Old names; a line can go when nobody can have a file with it any more.
pub const RENAMED: &[Renamed] = &[
    renamed(
        "scan.distribution_period_scans",
        "interpolation_period_scans",
    ),
    renamed("interpolation.rows", "within_period"),
    renamed("interpolation.within_period = even", "linear"),
    renamed("restart.machine_side", "master"),
    renamed("axis.reversal.method = kick", "friction-pulse"),
    renamed("axis.reversal.kick_mm_s", "pulse_mm_s"),
    renamed("axis.reversal.kick_ms", "pulse_ms"),
    renamed("axis.model.table.crossing_ms", "traversal_ms"),
];
