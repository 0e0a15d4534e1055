//! What is printed of it.

use super::game::Played;
use crate::bench::figures::Figures;
use crate::options::Ball;
use console::output::say;

pub(super) fn head(placement: &str) {
    say(&format!(
        "  {placement:<20}{:>28}   µs a scan    processor    of them",
        ""
    ));
    say(
        "    axes  what                        p50      p99       max    µs a scan    the master's",
    );
}

fn name(ball: Ball) -> &'static str {
    match ball {
        Ball::Ring => "futex ring",
        Ball::Pipe => "pipe",
        Ball::Bare => "bare iceoryx2",
        Ball::Sample => "samples",
    }
}

/// The same in a column of the cell's own figures.
fn shown(ball: Ball) -> String {
    match ball {
        Ball::Sample => name(ball).into(),
        floor => format!("floor: {}", name(floor)),
    }
}

/// One line for each, the figures of the cell's samples beside each floor.
pub(super) fn rows(axes: usize, placement: &str, rows: &[(Ball, &Played)], figures: &mut Figures) {
    for (ball, played) in rows {
        say(&format!(
            "    {axes:4}  {:<20} {:10.2} {:8.2} {:9.1} {:12.2} {:12.2}",
            shown(*ball),
            played.us_at(0.5),
            played.us_at(0.99),
            played.us_max(),
            played.processor_us(),
            played.master_us(),
        ));
    }
    let of = |ball: Ball| rows.iter().find(|(of, _)| *of == ball).map(|(_, of)| *of);
    let Some(samples) = of(Ball::Sample) else {
        return;
    };
    let floors: Vec<_> = rows
        .iter()
        .filter(|(ball, _)| *ball != Ball::Sample)
        .collect();
    for (ball, floor) in &floors {
        let what = format!("scan, axes: {axes}, {placement}, p50");
        figures.add("ipc", what, samples.us_at(0.5), "µs");
        figures.beside(name(*ball), floor.us_at(0.5));
    }
    if let Some((ball, floor)) = floors.last() {
        for (share, words) in [(0.99, "p99"), (1.0, "max")] {
            let what = format!("scan, axes: {axes}, {placement}, {words}");
            figures.add("ipc", what, samples.us_at(share), "µs");
            figures.beside(name(*ball), floor.us_at(share));
        }
        let what = format!("processor time of a scan, axes: {axes}, {placement}");
        figures.add("ipc", what, samples.processor_us(), "µs");
        figures.beside(name(*ball), floor.processor_us());
    }
    if axes == 1 {
        hand_over(placement, rows, figures);
    }
}

/// Half of a scan of one axis.
fn hand_over(placement: &str, rows: &[(Ball, &Played)], figures: &mut Figures) {
    let half = |played: &Played| 0.5 * played.us_at(0.5);
    let words: Vec<String> = rows
        .iter()
        .map(|(ball, played)| format!("{} {:.2}", name(*ball), half(played)))
        .collect();
    say(&format!(
        "          one hand-over, half of it, p50 in µs: {}",
        words.join(", ")
    ));
    let of = |ball: Ball| rows.iter().find(|(of, _)| *of == ball).map(|(_, of)| *of);
    if let (Some(samples), Some(ring)) = (of(Ball::Sample), of(Ball::Ring)) {
        figures.add(
            "ipc",
            format!("hand-over, {placement}, p50"),
            half(samples),
            "µs",
        );
        figures.beside(name(Ball::Ring), half(ring));
    }
}
