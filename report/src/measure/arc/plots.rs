//! Which arcs are drawn. Only their curves are kept: a curve has up to half a megabyte, and a long run thousands of arcs.

use super::result::ArcResult;
use super::runs::Circle;

/// Plots of circles at most.
pub const PLOTS_MAX: usize = 24;
/// Runs shown in one plot at most: the first of each circle and feed.
pub const RUNS_MAX: usize = 4;
/// Further curves that are kept, of the first arcs whatever their circle: two runs are compared arc by arc.
const FIRST_MAX: usize = 32;
/// Shortest run that is a circle to the eye, in degrees.
const SHOWN_DEG_MIN: f64 = 150.0;

/// Whether a run is a circle to the eye.
pub fn shown(arc: &ArcResult) -> bool {
    arc.table.fit.is_whole() && arc.measured_deg >= SHOWN_DEG_MIN
}

/// Whether two runs belong into one plot, whatever their direction.
pub fn in_one_plot(a: &Circle, b: &Circle) -> bool {
    let near = |a: f64, b: f64| (a - b).abs() < 1e-4;
    a.plane == b.plane
        && a.feed_mm_s == b.feed_mm_s
        && near(a.radius_mm, b.radius_mm)
        && near(a.centre_mm[0], b.centre_mm[0])
        && near(a.centre_mm[1], b.centre_mm[1])
}

/// Decides whose curve is kept, arc by arc in order of travel.
#[derive(Debug, Default)]
pub(super) struct CurvesKept {
    /// The first circle of each plot, and its runs.
    plots: Vec<(Circle, usize)>,
    first: usize,
}

impl CurvesKept {
    /// Takes the next arc; whether its curve is kept.
    pub(super) fn keep(&mut self, arc: &ArcResult) -> bool {
        if !shown(arc) {
            return false;
        }
        self.first += 1;
        let room = self.plots.len() < PLOTS_MAX;
        let mut plots = self.plots.iter_mut();
        let drawn = match plots.find(|(circle, _)| in_one_plot(circle, &arc.circle)) {
            Some((_, runs)) => {
                *runs += 1;
                *runs <= RUNS_MAX
            }
            None if room => {
                self.plots.push((arc.circle.clone(), 1));
                true
            }
            None => false,
        };
        drawn || self.first <= FIRST_MAX
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::measure::arc::result::Deviations;
    use crate::measure::fit::{Fit, FitKind};

    /// A run on a circle without deviations.
    pub(crate) fn arc(radius_mm: f64, measured_deg: f64) -> ArcResult {
        let fit = Fit {
            kind: FitKind::LeastSquares,
            centre_mm: [0.0; 2],
            radius_error_mm: 0.0,
            residual_rms_mm: 0.0,
        };
        let deviations = Deviations {
            fit,
            circular_um: 0.0,
            radial_um: (0.0, 0.0),
            programmed_um: (0.0, 0.0),
        };
        ArcResult {
            circle: Circle {
                plane: [0, 1],
                centre_mm: [0.0; 2],
                radius_mm,
                clockwise: false,
                feed_mm_s: Some(50.0),
            },
            line: 1,
            elements: (0, 0),
            scans: (0.0, 1.0),
            turns: 1.0,
            measured_deg,
            missing_scans: 0,
            speed_mm_s: 50.0,
            table: deviations,
            motor: deviations,
            quadrants: Vec::new(),
            curve: Vec::new(),
            start_angle_rad: 0.0,
        }
    }

    #[test]
    fn curves_are_kept_of_the_first_runs_of_each_plot_and_of_no_more_however_long_the_program() {
        let mut curves = CurvesKept::default();
        assert!(!curves.keep(&arc(7.0, 149.0)), "no circle to the eye");
        let same = (0..10_000).filter(|_| curves.keep(&arc(10.0, 360.0)));
        assert_eq!(same.count(), FIRST_MAX);
        let others = (0..10_000).filter(|n| curves.keep(&arc(20.0 + f64::from(n % 100), 360.0)));
        assert_eq!(others.count(), (PLOTS_MAX - 1) * RUNS_MAX);
    }
}
