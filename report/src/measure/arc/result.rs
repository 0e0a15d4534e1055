//! What was measured on a circle.

use super::runs::Circle;
use crate::measure::fit::Fit;

/// What remained at one quadrant whose whole window lies on the arc.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Quadrant {
    /// Axis that reverses there.
    pub axis: usize,
    /// Where, unwrapped along the run as in [`ArcResult::angle_of`], in rad.
    pub angle_rad: f64,
    /// Largest residual, in µm.
    pub protrusion_um: f64,
    /// Angle of the largest residual, in rad.
    pub protrusion_angle_rad: f64,
    /// Smallest residual, in µm.
    pub undercut_um: f64,
    /// Width of the protrusion at half its height, in ms; none if it is no bump.
    pub width_half_height_ms: Option<f64>,
    /// Whether the whole window lies in steady motion.
    pub steady: bool,
}

/// One point of the curve for plots.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CurvePoint {
    /// Angle about the programmed centre, in rad.
    pub angle_rad: f64,
    /// Residual of the table, in µm.
    pub table_um: f64,
    /// Residual of the motor side, backlash compensation removed, in µm.
    pub motor_um: f64,
}

/// Deviations of one series (table or motor side).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Deviations {
    /// Fit to samples outside the windows.
    pub fit: Fit,
    /// Highest minus lowest residual about the fitted centre, in µm (ISO 230-4 circular deviation G).
    pub circular_um: f64,
    /// Highest and lowest distance from the programmed radius about the fitted centre, in µm (F of ISO 230-4).
    pub radial_um: (f64, f64),
    /// The same about the programmed centre.
    pub programmed_um: (f64, f64),
}

/// One run on one circle, measured.
#[derive(Debug, Clone)]
pub struct ArcResult {
    /// The circle.
    pub circle: Circle,
    /// Line of the program.
    pub line: u32,
    /// Elements, first to last.
    pub elements: (usize, usize),
    /// Scans, first to last.
    pub scans: (f64, f64),
    /// Turns programmed.
    pub turns: f64,
    /// Part of the run that was measured, in degrees of the table.
    pub measured_deg: f64,
    /// Scans missing between its first and its last sample, or before its first.
    pub missing_scans: u64,
    /// Highest path speed, in mm/s.
    pub speed_mm_s: f64,
    /// The table.
    pub table: Deviations,
    /// The motor side, backlash compensation removed.
    pub motor: Deviations,
    /// Quadrants that were crossed, window and all.
    pub quadrants: Vec<Quadrant>,
    /// The residuals, thinned; empty where no plot shows them ([`super::plots`]).
    pub curve: Vec<CurvePoint>,
    pub(super) start_angle_rad: f64,
}

impl ArcResult {
    /// Signed unwrapped angle of a place on the programmed circle, `along_rad` travelled from the start.
    pub fn angle_of(&self, along_rad: f64) -> f64 {
        let sign = if self.circle.clockwise { -1.0 } else { 1.0 };
        self.start_angle_rad + sign * along_rad
    }
}
