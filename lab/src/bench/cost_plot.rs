//! What a scan of a cell costs by its number of axes, as one picture: time, processor time, memory and log.

use std::path::Path;

use ::report::plot::{self, Area, CURVES, Drawn, FINE, Frame, INK, PlotError, SOFT, words};
use plotters::prelude::*;

/// A cell of so many axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Cost {
    pub axes: usize,
    /// Wall time of a scan, and of its floor: physics and hand-overs, in µs.
    pub wall_us: f64,
    pub floor_us: f64,
    /// Processor time of all processes, in µs a scan.
    pub processor_us: f64,
    /// Memory of all processes, shared pages shared out (Pss), in MB.
    pub memory_mb: f64,
    /// Bytes of the log, a scan.
    pub log_bytes: f64,
}

/// What one panel shows.
struct Panel {
    title: &'static str,
    take: fn(&Cost) -> f64,
    /// A second curve, behind the first.
    floor: Option<fn(&Cost) -> f64>,
}

const PANELS: [Panel; 4] = [
    Panel {
        title: "wall time of a scan, µs (grey: its floor, physics and hand-overs)",
        take: |cost| cost.wall_us,
        floor: Some(|cost| cost.floor_us),
    },
    Panel {
        title: "processor time of all processes, µs a scan",
        take: |cost| cost.processor_us,
        floor: None,
    },
    Panel {
        title: "memory of all processes (Pss), MB",
        take: |cost| cost.memory_mb,
        floor: None,
    },
    Panel {
        title: "log, bytes a scan",
        take: |cost| cost.log_bytes,
        floor: None,
    },
];

/// Draws them.
///
/// # Errors
/// The file cannot be written.
pub(super) fn draw(path: &Path, costs: &[Cost]) -> Result<(), PlotError> {
    plot::write(path, (1000, 720), |area| {
        let places = area.split_evenly((2, 2));
        let mut all = places.iter().zip(&PANELS);
        all.try_for_each(|(place, panel)| panel.draw(place, costs))
    })
}

impl Panel {
    fn draw(&self, area: &Area, costs: &[Cost]) -> Drawn {
        let curve = CURVES.first().copied().unwrap_or(INK);
        let floor = self.floor.map(|take| (take, SOFT));
        let curves = || floor.into_iter().chain([(self.take, curve)]);
        let values = curves().flat_map(|(take, _)| costs.iter().map(take));
        let most = values.fold(1e-9, f64::max);
        let axes_most = costs.iter().map(|of| of.axes).max().unwrap_or(1) as f64;
        let frame = Frame {
            caption: Some((self.title, INK)),
            top: 8,
            below: 44,
            x: 0.0..1.05 * axes_most,
            y: 0.0..1.1 * most,
            titles: ("axes", ""),
            labels: (None, 6),
            label_pixels: 12,
            x_label: Some(&|axes| format!("{axes:.0}")),
            y_label: &|value| format!("{value}"),
        };
        let mut chart = plot::chart(area, frame)?;
        for (take, colour) in curves() {
            let points: Vec<_> = costs.iter().map(|of| (of.axes as f64, take(of))).collect();
            let line = LineSeries::new(points.clone(), plot::stroke(colour, 2.0));
            chart.draw_series(line).map_err(words)?;
            let dot = |point| Circle::new(point, 4 * FINE, colour.filled());
            let dots = points.into_iter().map(dot);
            chart.draw_series(dots).map_err(words)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_number_of_axes_stands_in_every_panel() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("cost.svg");
        let costs = [1_usize, 2, 32].map(|axes| Cost {
            axes,
            wall_us: 10.0 * axes as f64,
            floor_us: 7.0 * axes as f64,
            processor_us: 20.0 * axes as f64,
            memory_mb: 60.0 + 5.0 * axes as f64,
            log_bytes: 100.0 * axes as f64,
        });
        draw(&file, &costs).expect("a picture");
        let text = std::fs::read_to_string(&file).expect("the picture");
        assert_eq!(text.matches("<circle").count(), 3 * 5);
        for panel in &PANELS {
            let words: Vec<&str> = panel.title.split(',').collect();
            assert!(text.contains(words[0]), "{}", panel.title);
        }
    }
}
