//! Where the time of a program goes, in words.

use std::f64::consts::PI;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

use crate::time_use::{Cause, Form, Limit, SlowPlace, TimeTable};

use console::output::say;
use launcher::check::Checked;

/// So many of the places that cost most are named.
const NAMED: usize = 8;
/// Shares of the time below this are not worth a line.
const SHARE_MIN: f64 = 0.001;

/// Says what the time is used for, and the places that cost most of it.
pub(super) fn print(checked: &Checked, table: &TimeTable) {
    let time_s: f64 = table.places.iter().map(|place| place.time_s).sum();
    if time_s <= 0.0 {
        return;
    }
    let mut kinds: Vec<(String, f64)> = Vec::new();
    for place in &table.places {
        let kind = kind_words(checked, place);
        match kinds.iter_mut().find(|(of, _)| *of == kind) {
            Some((_, of_kind_s)) => *of_kind_s += place.time_s,
            None => kinds.push((kind, place.time_s)),
        }
    }
    kinds.sort_by(|a, b| b.1.total_cmp(&a.1));
    say("  where the time goes:");
    for (kind, of_kind_s) in &kinds {
        if *of_kind_s > SHARE_MIN * time_s {
            let share = 100.0 * of_kind_s / time_s;
            say(&format!("  {of_kind_s:10.3} s  {share:5.1} %  {kind}"));
        }
    }
    let mut places: Vec<&SlowPlace> = table.places.iter().collect();
    places.retain(|place| place.cause != Cause::Feed && place.lost_s > SHARE_MIN * time_s);
    places.sort_by(|a, b| b.lost_s.total_cmp(&a.lost_s));
    if places.is_empty() {
        return;
    }
    say("  what costs most, against what is asked for:");
    for place in places.iter().take(NAMED) {
        say(&format!("  {}", place_words(checked, place)));
    }
}

fn place_words(checked: &Checked, place: &SlowPlace) -> String {
    let speeds = match place.cause {
        Cause::Rest => String::new(),
        _ => format!(
            ", {:.1} instead of {:.1} mm/s",
            place.speed_mm_s, place.asked_mm_s
        ),
    };
    format!(
        "{:10.3} s  line {}: {}{speeds}",
        place.lost_s,
        place.line,
        cause_words(checked, &place.cause)
    )
}

/// Causes of one kind have the same words.
fn kind_words(checked: &Checked, place: &SlowPlace) -> String {
    let (axis, limit, form) = match place.cause {
        Cause::Axis { axis, limit, form } => (axis, limit, form),
        other => return cause_words(checked, &other),
    };
    let where_at = match form {
        _ if limit == Limit::Velocity => "",
        Form::Straight => "straight: ",
        Form::Curve(_) => "curves: ",
        Form::Corner(_) => "corners: ",
        Form::Bend => "jumps of the curvature: ",
    };
    format!("{where_at}{}", limit_words(checked, axis, limit))
}

fn cause_words(checked: &Checked, cause: &Cause) -> String {
    match cause {
        Cause::Feed => "the programmed feed".into(),
        Cause::Rest => "rest: a dwell, a stop, or the end".into(),
        Cause::Braking => "too short to speed up, or to brake within a window".into(),
        Cause::Axis { axis, limit, form } => {
            let where_at = match form {
                _ if *limit == Limit::Velocity => String::new(),
                Form::Straight => "straight: ".into(),
                Form::Curve(radius_mm) if *radius_mm < 1.0 => {
                    format!("curve of R {radius_mm:.3} mm: ")
                }
                Form::Curve(radius_mm) => format!("curve of R {radius_mm:.1} mm: "),
                Form::Bend => "jump of the curvature: ".into(),
                Form::Corner(angle_rad) => format!("corner of {:.1}°: ", angle_rad * 180.0 / PI),
            };
            format!("{where_at}{}", limit_words(checked, *axis, *limit))
        }
    }
}

fn limit_words(checked: &Checked, axis: usize, limit: Limit) -> String {
    let name = checked.machine.axes.get(axis).map_or("?", |of| &of.name);
    let of = match limit {
        Limit::Velocity => "highest speed",
        Limit::Acceleration => "acceleration",
        Limit::Jerk => "jerk",
    };
    format!("{of} of {name}")
}

/// Writes a row for each block.
pub(super) fn write_blocks(
    checked: &Checked,
    table: &TimeTable,
    file: &Path,
) -> std::io::Result<()> {
    let mut out = BufWriter::new(File::create(file)?);
    writeln!(out, "line,length_mm,time_s,asked_s,held_back_by")?;
    for block in &table.blocks {
        writeln!(
            out,
            "{},{:.6},{:.6},{:.6},{}",
            block.line,
            block.length_mm,
            block.time_s,
            block.asked_s,
            cause_words(checked, &block.cause)
        )?;
    }
    out.flush()
}
