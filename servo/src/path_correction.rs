//! The correction along the path of a program, as position, speed and torque of one scan.
//!
//! The command is meant to be where the correction has it, so it moves as setpoints do: position at the position loop, speed at the
//! lead of the feed-forward, acceleration as torque at the lead of the model. It is in neither compensation nor torque that the model
//! knows of: adaptation and observer take the axis's own acceleration off what they see, and its torque with it.
use loops::path_correction::PathCorrection;

use crate::setpoints::Setpoints;
use crate::settings::ServoSettings;

/// Most that a correction adds to the velocity command, in mm/s: 10 µm at 120 Hz are 8 mm/s.
const SPEED_MAX_MM_S: f64 = 10.0;

/// What a correction adds in one scan.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct PathAdded {
    /// To the position command, in mm.
    pub position_mm: f64,
    /// To the velocity command, in mm/s.
    pub velocity_mm_s: f64,
    /// To the torque, in N·m.
    pub torque_nm: f64,
}

/// Of the present scan; nothing off the path, on another program's, or at another speed than it was learned at.
pub(crate) fn added(
    settings: &ServoSettings,
    correction: Option<&PathCorrection>,
    setpoints: &Setpoints<'_>,
) -> PathAdded {
    let Some(correction) =
        correction.filter(|correction| correction.is_of(setpoints.program_hash()))
    else {
        return PathAdded::default();
    };
    let at = |ahead: f64| value_mm(settings, correction, setpoints, ahead);
    let model = &settings.model;
    // Setpoints before this scan are not known in the first scan of a window: nothing here looks back.
    let middle = model.speed_lead_scans.max(0.5);
    let step_mm = at(middle + 0.5) - at(middle - 0.5);
    let forward = if settings.feed_forward_enabled {
        settings.feed_forward.coefficient
    } else {
        0.0
    };
    let velocity_mm_s = forward * step_mm / settings.scan_s;
    let torque_nm = model.path_torque_lead_scans().map_or(0.0, |ahead| {
        let wide = model.path_difference_scans(ahead);
        let wide_s = wide * settings.scan_s;
        let change_mm = at(ahead + wide) - 2.0 * at(ahead) + at(ahead - wide);
        model.path_torque_nm(change_mm / (wide_s * wide_s))
    });
    PathAdded {
        position_mm: at(0.0),
        velocity_mm_s: velocity_mm_s.clamp(-SPEED_MAX_MM_S, SPEED_MAX_MM_S),
        torque_nm,
    }
}

/// Correction so many scans ahead, in mm.
fn value_mm(
    settings: &ServoSettings,
    correction: &PathCorrection,
    setpoints: &Setpoints<'_>,
    ahead: f64,
) -> f64 {
    let place_mm = |scans: i64| {
        let tag = setpoints.tag(scans).filter(|tag| !tag.is_off_path())?;
        correction.place_mm(tag.element, tag.distance_mm)
    };
    let at = |scans: i64| match (place_mm(scans), place_mm(scans + 1)) {
        (Some(here_mm), Some(next_mm)) => {
            correction.value_mm(here_mm, (next_mm - here_mm) / settings.scan_s)
        }
        _ => 0.0,
    };
    let low = libm::floor(ahead);
    let part = ahead - low;
    let here_mm = at(low as i64);
    if part == 0.0 {
        return here_mm;
    }
    here_mm + (at(low as i64 + 1) - here_mm) * part
}
