//! `path.svg`: where the tool was, coloured by how far it was off the path.

use std::path::Path;

use super::evaluation::Evaluation;
use crate::path_plot::{self, Meaning, PathPoint};
use crate::plot::PlotError;

/// Draws the path in the plane of the two axes that travel farthest, and says whether there is any.
pub(super) fn draw(folder: &Path, run: &Evaluation) -> Result<bool, PlotError> {
    let places = run.measurements.travelled.places();
    let mut extents: Vec<(usize, f64)> = (0..run.machine.axes.len())
        .map(|axis| {
            let of_axis = places.iter().filter_map(|place| place.tool_mm.get(axis));
            let ends = of_axis.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), at| {
                (low.min(*at), high.max(*at))
            });
            (axis, ends.1 - ends.0)
        })
        .collect();
    extents.sort_by(|a, b| b.1.total_cmp(&a.1));
    let Some((first, _)) = extents.first().filter(|(_, travel)| *travel > 0.0) else {
        return Ok(false);
    };
    let mut axes = [*first, extents.get(1).map_or(*first, |(axis, _)| *axis)];
    axes.sort_unstable();
    let points: Vec<PathPoint> = places
        .iter()
        .map(|place| PathPoint {
            place_mm: axes.map(|axis| place.tool_mm.get(axis).copied().unwrap_or(0.0)),
            value: place.error_mm * 1e3,
        })
        .collect();
    let title = format!(
        "{} on {}: contour error",
        run.info.program, run.machine.name
    );
    let names = axes.map(|axis| run.machine.axis_name(axis));
    let file = folder.join("path.svg");
    path_plot::draw(&file, &title, names, Meaning::ContourErrorUm, &points)?;
    Ok(true)
}
