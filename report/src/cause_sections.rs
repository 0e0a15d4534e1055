//! The sections of a report about where errors come from.

use super::causes::{BallBarReport, CauseReport, ContourPartReport, OneWayReport};
use super::document::{Block, Columns, Section, section};
use super::json::Report;

/// Circles whose causes are listed, of those travelled both ways and of those travelled one way; all are in report.json.
const DIAGNOSED_MAX: [usize; 2] = [8, 3];

/// Where the contour error comes from.
pub(super) fn contour_parts(report: &Report, path_picture: bool) -> Section {
    let parts = report.contour_parts.iter().flat_map(|all| &all.parts);
    let table = Columns::of("parts of the contour error", parts)
        .words("Source", |part| part.words())
        .number("rms", "µm", 2, |part| Some(part.rms_um))
        .key("part_rms_um")
        .number("Share", "%", 1, |part| Some(part.share_percent))
        .number("Peak", "µm", 2, |part| part.peak_um)
        .written("Step", "", ContourPartReport::step)
        .named("contour_parts", |_, part| {
            let cause = serde_json::to_value(part.cause).unwrap_or_default();
            let id = vec![("cause", cause), ("axis", part.axis.clone().into())];
            (part.words(), id)
        });
    let note = "Across the path, at the end of each scan. Share: of the sum of all mean squares. Reversals: 50 ms and 0.1 mm behind each; lost motion, dynamics and rest are of the time outside them. Step: lost motion, + where the table stays behind.";
    let mut blocks = vec![Block::Note(note.into()), Block::Table(table.done())];
    if path_picture {
        blocks.push(Block::Plot {
            file: "path.svg".into(),
            caption: "Path of the tool, coloured by its contour error".into(),
        });
    }
    section("Where the contour error comes from", blocks)
}

/// Circles that were travelled both ways, and one way.
pub(super) fn ball_bars(report: &Report) -> Vec<Section> {
    let feed = |bar: &BallBarReport| bar.feed_mm_min;
    let of = |way: &Option<OneWayReport>| Some(way.as_ref()?.circular_deviation_um);
    let range = |way: &Option<OneWayReport>| {
        let deviation = way.as_ref().map(|way| way.radial_deviation_um);
        deviation.map_or("–".into(), |deviation| {
            format!("{:+.2} / {:+.2}", deviation.max, deviation.min)
        })
    };
    let all = report.ball_bar.iter().chain(&report.one_way_circles);
    let table = Columns::of("ball_bar", all)
        .words("Plane", |bar| bar.plane.clone())
        .number("Radius", "mm", 3, |bar| Some(bar.radius_mm))
        .number("Feed", "mm/min", 0, feed)
        .number("G ccw", "µm", 2, |bar| of(&bar.counter_clockwise))
        .number("G cw", "µm", 2, |bar| of(&bar.clockwise))
        .number("G(b)", "µm", 2, |b| b.bidirectional_deviation_um)
        .key("bidirectional_deviation_um")
        .number("H", "µm", 2, |bar| bar.hysteresis_um)
        .key("hysteresis_um")
        .number("at", "°", 0, |bar| bar.hysteresis_at_deg)
        .written("F ccw", "µm", |bar| range(&bar.counter_clockwise))
        .written("F cw", "µm", |bar| range(&bar.clockwise))
        .named("ball_bar", |_, bar| {
            let id = vec![
                ("plane", bar.plane.clone().into()),
                ("radius_mm", bar.radius_mm.into()),
                ("feed_mm_min", bar.feed_mm_min.into()),
            ];
            (name(bar), id)
        });
    let note = "Circles, in the terms of ISO 230-4: circular deviation G of each direction, G(b) of both about one centre, hysteresis H between their mean curves, radial deviation F from the programmed radius, highest / lowest.";
    let mut sections = vec![section(
        "Ball-bar test",
        vec![Block::Note(note.into()), Block::Table(table.done())],
    )];
    let lists = [&report.ball_bar, &report.one_way_circles];
    for (list, most) in lists.into_iter().zip(DIAGNOSED_MAX) {
        let told = list.iter().filter(|bar| bar.causes.is_some());
        sections.extend(told.take(most).map(causes));
    }
    sections
}

fn name(bar: &BallBarReport) -> String {
    let feed = bar.feed_mm_min;
    let feed = feed.map_or("rapid".into(), |feed| format!("F{feed:.0}"));
    // Centres of programs are rounded: nobody means the last digits.
    let radius_mm = (bar.radius_mm * 1e3).round() / 1e3;
    format!("{} R{radius_mm} {feed}", bar.plane)
}

fn causes(bar: &BallBarReport) -> Section {
    let all = bar.causes.iter().flatten();
    let none = bar.causes.as_ref().is_some_and(Vec::is_empty);
    let table = Columns::of("causes", all)
        .words("Cause", |cause| cause.words(&bar.plane))
        .number("Effect", "µm", 2, |cause| Some(cause.effect_um))
        .number("Share", "%", 1, |cause| Some(cause.share_percent))
        .written("Size", "", CauseReport::size)
        .done();
    let blocks = if none {
        vec![Block::Text("Nothing above 0.05 µm.".into())]
    } else {
        let fitted = if bar.is_both_ways() {
            "Fitted to both directions together."
        } else {
            "Travelled in one direction only: squareness and servo mismatch leave the same mark there; travel the circle the other way too to tell them apart."
        };
        let note = format!(
            "{fitted} Effect: from the lowest to the highest of what a cause does to the radius, the programmed circle included; share: among the sum of all effects."
        );
        vec![Block::Note(note), Block::Table(table)]
    };
    let heading = format!("What the deviation of {} comes from", name(bar));
    section(heading, blocks)
}
