//! The ranked causes of a circle's deviation, beside its ball-bar plot.

use plotters::prelude::*;
use plotters::style::text_anchor::HPos;

use super::causes::{BallBarReport, CauseReport};
use super::text::shortened;
use crate::plot::{self, Area, Drawn, INK, SOFT, at, words};

/// Width of the panel, in pixels.
pub(super) const PANEL: i32 = 430;
/// Causes that are shown; the others are smaller.
const SHOWN_MAX: usize = 12;
/// Height of a cause, in pixels.
const ROW_PX: f64 = 50.0;
/// Top of the first cause.
const FIRST_Y: f64 = 158.0;
/// Free space at the right.
const MARGIN_PX: f64 = 40.0;

const BAR: RGBColor = RGBColor(0x6f, 0x9b, 0xc8);
const TRACK: RGBColor = RGBColor(0xe9, 0xec, 0xf0);

/// Draws the panel from a place to the right.
pub(super) fn draw(area: &Area, left: f64, bar: &BallBarReport) -> Drawn {
    let title = "What the deviation comes from";
    plot::text(area, title, at(left, 68.0), 18, &INK, HPos::Left)?;
    let causes = bar.causes.as_deref().unwrap_or_default();
    let fitted = if bar.is_both_ways() {
        ["fitted to both directions together", ""]
    } else {
        [
            "fitted to one direction: squareness and servo mismatch",
            "cannot be told apart",
        ]
    };
    for (y, line) in [92.0, 110.0].into_iter().zip(fitted) {
        plot::text(area, line, at(left, y), 13, &SOFT, HPos::Left)?;
    }
    if causes.is_empty() {
        let none = "nothing above 0.05 µm";
        return plot::text(area, none, at(left, FIRST_Y), 15, &INK, HPos::Left);
    }
    let right = left + f64::from(PANEL) - MARGIN_PX;
    plot::text(area, "share", at(right, 134.0), 12, &SOFT, HPos::Right)?;
    for (index, cause) in causes.iter().take(SHOWN_MAX).enumerate() {
        let y = FIRST_Y + ROW_PX * index as f64;
        row(area, (left, right, y), index + 1, (cause, &bar.plane))?;
    }
    let more = causes.len().saturating_sub(SHOWN_MAX);
    if more > 0 {
        let line = format!("and {more} smaller, in report.json");
        let y = FIRST_Y + ROW_PX * SHOWN_MAX as f64;
        plot::text(area, &line, at(left, y), 13, &SOFT, HPos::Left)?;
    }
    Ok(())
}

/// One cause: its rank, its name, its share as a number and a bar, its size.
fn row(
    area: &Area,
    (left, right, y): (f64, f64, f64),
    rank: usize,
    (cause, plane): (&CauseReport, &str),
) -> Drawn {
    let name = format!("{rank}  {}", shortened(&cause.words(plane), 46));
    plot::text(area, &name, at(left, y), 14, &INK, HPos::Left)?;
    let share = format!("{:.1} %", cause.share_percent);
    plot::text(area, &share, at(right, y), 14, &INK, HPos::Right)?;
    let (start, y) = (left + 18.0, y + 20.0);
    let whole = right - start - 130.0;
    let share_px = whole * (cause.share_percent / 100.0).clamp(0.0, 1.0);
    for (length, colour) in [(whole, TRACK), (share_px, BAR)] {
        let corners = [at(start, y - 4.0), at(start + length, y + 4.0)];
        area.draw(&Rectangle::new(corners, colour.filled()))
            .map_err(words)?;
    }
    plot::text(area, &cause.size(), at(right, y), 13, &SOFT, HPos::Right)
}
