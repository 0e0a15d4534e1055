//! One frame of the page: everything that changes, whole, so that a browser that has missed some needs none of them.

use axum::body::Bytes;
use serde::Serialize;

use super::pictures::{Drawn, shown};
use crate::live::circle::CircleView;
use crate::live::events::Weight;
use crate::live::json::{self, ErrorPeak, State, rounded};
use crate::live::model::Model;
use crate::live::trail::TrailPoint;
use crate::live::words::Tone;

/// Events in a frame: those that fit a page.
const EVENTS: usize = 40;
/// Reversals in a frame.
const REVERSALS: usize = 16;

/// What a frame is made of, beside the model.
pub struct Frame<'a> {
    /// Number of the frame.
    pub number: u64,
    /// Counts the cells that were shown.
    pub session: u32,
    /// The run is over.
    pub has_ended: bool,
    /// The picture of the circle is in it.
    pub with_circle: bool,
    /// Where the pictures have got to.
    pub drawn: Drawn,
    /// The new points of the trail.
    pub new: &'a [TrailPoint],
}

#[derive(Serialize)]
struct Written<'a> {
    frame: u64,
    session: u32,
    ended: bool,
    /// As `status --json` has it.
    status: State<'a>,
    says: Says<'a>,
    drawn: Drawn,
    points: Vec<(f64, f64, f64, Option<f64>)>,
    tool: Option<(f64, f64, f64, Option<f64>)>,
    #[serde(skip_serializing_if = "Option::is_none")]
    circle: Option<Circle<'a>>,
    reversals: Vec<Reversal<'a>>,
    reversals_seen: u64,
    events: Vec<Event<'a>>,
    period_us: Option<[f64; 3]>,
    scans_seen: u64,
    scans_not_seen: u64,
}

#[derive(Serialize)]
struct Says<'a> {
    symbol: &'a str,
    state: &'a str,
    detail: String,
    next: String,
    /// good, waits, bad.
    tone: &'static str,
}

#[derive(Serialize)]
struct Circle<'a> {
    plane: &'a str,
    line: u32,
    radius_mm: f64,
    feed_mm_min: Option<f64>,
    running: bool,
    angle_rad: Option<f64>,
    /// Per degree: lowest, mean and highest, in µm; null where nothing was seen.
    deviation_um: Vec<Option<[f64; 3]>>,
}

#[derive(Serialize)]
struct Reversal<'a> {
    axis: &'a str,
    new_direction: i32,
    scan: u64,
    height_um: Option<f64>,
    undercut_um: Option<f64>,
    #[serde(flatten)]
    error: ErrorPeak,
}

#[derive(Serialize)]
struct Event<'a> {
    number: u64,
    scan: u64,
    event: &'a str,
    warning: bool,
}

impl Frame<'_> {
    /// As a server-sent event.
    pub fn as_event(&self, model: &Model) -> Bytes {
        let mut text = format!("id: {}\ndata: ", self.number).into_bytes();
        if serde_json::to_writer(&mut text, &self.of(model)).is_err() {
            return Bytes::from_static(b": nothing\n\n");
        }
        text.extend_from_slice(b"\n\n");
        text.into()
    }

    fn of<'a>(&self, model: &'a Model) -> Written<'a> {
        let says = model.says();
        Written {
            frame: self.number,
            session: self.session,
            ended: self.has_ended,
            status: json::state(model),
            says: Says {
                symbol: says.symbol,
                state: says.state,
                detail: says.detail,
                next: says.next,
                tone: match says.tone {
                    Tone::Good => "good",
                    Tone::Waits => "waits",
                    Tone::Bad => "bad",
                },
            },
            drawn: self.drawn,
            points: self.new.iter().map(shown).collect(),
            tool: model
                .trail
                .as_ref()
                .and_then(|trail| trail.now())
                .map(|now| shown(&now)),
            circle: self.with_circle.then(|| circle(&model.circle)).flatten(),
            reversals: reversals(model),
            reversals_seen: model.reversals.count,
            events: events(model),
            period_us: model.timing.summary().map(|summary| {
                [summary.p50_us, summary.p99_us, summary.max_us].map(|us| rounded(us, 1))
            }),
            scans_seen: model.seen_scans.0,
            scans_not_seen: model.seen_scans.1,
        }
    }
}

fn circle(view: &CircleView) -> Option<Circle<'_>> {
    let circle = view.circle.as_ref()?;
    let shown = |um: f64| rounded(um, 2);
    Some(Circle {
        plane: &circle.plane,
        line: circle.line,
        radius_mm: rounded(circle.radius_mm, 4),
        feed_mm_min: circle.feed_mm_s.map(|mm_s| rounded(mm_s * 60.0, 1)),
        running: view.running,
        angle_rad: view.angle_rad.map(|rad| rounded(rad, 4)),
        deviation_um: view
            .deviation
            .iter()
            .map(|bin| bin.map(|bin| [bin.low_um, bin.mean_um, bin.high_um].map(shown)))
            .collect(),
    })
}

fn reversals(model: &Model) -> Vec<Reversal<'_>> {
    let newest_first = model.reversals.last.iter().rev().take(REVERSALS);
    newest_first
        .map(|reversal| Reversal {
            axis: model.machine.axis_name(reversal.axis as usize),
            new_direction: reversal.direction,
            scan: reversal.scan,
            height_um: reversal.height_um.map(|um| rounded(um, 2)),
            undercut_um: reversal.undercut_um.map(|um| rounded(um, 2)),
            error: ErrorPeak::of(model, reversal.axis, reversal.error_peak_um, 2),
        })
        .collect()
}

fn events(model: &Model) -> Vec<Event<'_>> {
    let newest_first = model.events.last.iter().rev().take(EVENTS);
    newest_first
        .map(|event| Event {
            number: event.number,
            scan: event.scan,
            event: &event.text,
            warning: event.weight == Weight::Warning,
        })
        .collect()
}
