//! `path.svg`: where the tool was, coloured by how far it was off the path, with the blocks in which it was farthest off.

use std::path::Path;

use super::evaluation::Evaluation;
use super::json::Report;
use super::peaks::PeakReport;
use super::text::shortened;
use crate::path_plot::{self, Label, Meaning, PathPicture, PathPoint};
use crate::plot::PlotError;

/// Letters of a block beside its peak.
const BLOCK_MAX: usize = 36;

/// Draws the path in the plane of the two coordinates that travel farthest, slides before rotary axes, and says whether there
/// is any.
pub(super) fn draw(folder: &Path, run: &Evaluation, report: &Report) -> Result<bool, PlotError> {
    let places = run.measurements.travelled.places();
    let mut extents: Vec<(usize, f64)> = (0..run.machine.axes.len())
        .map(|axis| {
            let of_axis = places.iter().filter_map(|place| place.tool_mm.get(axis));
            let ends = of_axis.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), at| {
                (low.min(*at), high.max(*at))
            });
            (axis, ends.1 - ends.0)
        })
        .filter(|(_, travel)| *travel > 0.0)
        .collect();
    let is_rotary = |axis: usize| run.coordinate_unit(axis) != "mm";
    extents.sort_by(|a, b| {
        let slides_first = is_rotary(a.0).cmp(&is_rotary(b.0));
        slides_first.then(b.1.total_cmp(&a.1))
    });
    let Some((first, _)) = extents.first() else {
        return Ok(false);
    };
    let mut axes = [*first, extents.get(1).map_or(*first, |(axis, _)| *axis)];
    axes.sort_unstable();
    let points: Vec<PathPoint> = places
        .iter()
        .map(|place| PathPoint {
            place_mm: axes.map(|axis| place.tool_mm.get(axis).copied().unwrap_or(0.0)),
            value: place.error.mm * 1e3,
        })
        .collect();
    let title = format!(
        "{} on {}: contour error",
        run.info.program, run.machine.name
    );
    let names = axes.map(|axis| run.coordinate(axis));
    let [first, second] = axes;
    let picture = PathPicture {
        title: &title,
        axes: [
            (&names[0], run.coordinate_unit(first)),
            (&names[1], run.coordinate_unit(second)),
        ],
        meaning: Meaning::ContourErrorUm,
        points: &points,
        labels: &labels(run, report, axes),
    };
    path_plot::draw(&folder.join("path.svg"), &picture)?;
    Ok(true)
}

/// The greatest contour errors, each with its block.
fn labels(run: &Evaluation, report: &Report, axes: [usize; 2]) -> Vec<Label> {
    let peaks = run.measurements.travelled.peaks(report.contour_peaks.len());
    let peaks = peaks.iter().zip(&report.contour_peaks);
    let text = |peak: &PeakReport| match peak.block {
        Some(line) => format!("line {line}: {}", shortened(&peak.text, BLOCK_MAX)),
        None => String::new(),
    };
    peaks
        .map(|(place, peak)| Label {
            place: axes.map(|axis| place.tool_mm.get(axis).copied().unwrap_or(0.0)),
            title: format!("{:.1} µm", peak.contour_error_um),
            text: text(peak),
        })
        .collect()
}
