//! The path, coloured by speed.

use std::path::Path;

use ::report::path_plot::{self, Meaning, PathPicture, PathPoint};
use anyhow::Context;
use audit::Totals;
use machine::AxisKind;
use path::window::PlannedSetpoint;

use launcher::check::Checked;

/// The two slides that are drawn, and the points so far.
pub(super) struct Picture {
    axes: [usize; 2],
    increments_mm: [f64; 2],
    points: Vec<PathPoint>,
}

impl Picture {
    /// Of the two slides that a program moves furthest.
    pub fn of(checked: &Checked) -> Self {
        let axes = checked.machine.program_axes();
        let mut extents: Vec<(usize, f64)> = Vec::new();
        for (index, axis) in axes.iter().enumerate() {
            if axis.kind != AxisKind::Linear {
                continue;
            }
            let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
            let elements = checked.program.iter().flat_map(|of| &of.path.elements);
            for element in elements {
                let (from, to) = element.bounds();
                low = low.min(from.get(index).copied().unwrap_or(0.0));
                high = high.max(to.get(index).copied().unwrap_or(0.0));
            }
            extents.push((index, high - low));
        }
        extents.sort_by(|a, b| b.1.total_cmp(&a.1));
        let mut chosen = extents.iter().map(|(index, _)| *index);
        let mut axes_of = [chosen.next().unwrap_or(0), chosen.next().unwrap_or(0)];
        axes_of.sort_unstable();
        let increment_mm = |axis: usize| axes.get(axis).map_or(1.0, |of| of.increment_mm());
        Self {
            axes: axes_of,
            increments_mm: axes_of.map(increment_mm),
            points: Vec::new(),
        }
    }

    /// Adds a setpoint.
    pub fn setpoint(&mut self, setpoint: &PlannedSetpoint) {
        let mut place_mm = [0.0; 2];
        let of_axes = self.axes.iter().zip(&self.increments_mm);
        for (place_mm, (axis, increment_mm)) in place_mm.iter_mut().zip(of_axes) {
            let increments = setpoint.position_increments.get(*axis);
            *place_mm = increments.copied().unwrap_or(0) as f64 * increment_mm;
        }
        self.points.push(PathPoint {
            place_mm,
            value: setpoint.state.speed_mm_s,
        });
    }

    /// Draws what came.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn draw(&self, checked: &Checked, totals: &Totals, file: &Path) -> anyhow::Result<()> {
        let name = checked.program.as_ref().map_or("", |of| of.name.as_str());
        let name = Path::new(name).file_name().unwrap_or_default().display();
        let title = format!(
            "{name} on {}: {:.3} s, {:.1} mm",
            checked.machine.name, totals.time_s, totals.distance_mm
        );
        let axes = self.axes.map(|axis| {
            let axis = checked.machine.axes.get(axis);
            axis.map_or(("", ""), |of| (of.name.as_str(), of.kind.unit()))
        });
        let picture = PathPicture {
            title: &title,
            axes,
            meaning: Meaning::SpeedMmS,
            points: &self.points,
            labels: &[],
        };
        path_plot::draw(file, &picture)
            .with_context(|| format!("{}: cannot be drawn", file.display()))
    }
}
