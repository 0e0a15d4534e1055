//! One frame of the page: everything that changes, whole, so that a browser that has missed some needs none of them.

use axum::body::Bytes;
use serde_json::{Value, json};

use super::pictures::{Drawn, shown};
use crate::live::circle::{Circle, CircleView};
use crate::live::json::{self, joined, round, rounded, without_missing};
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

    fn of(&self, model: &Model) -> Value {
        let says = model.says();
        let trail = model.trail.as_ref();
        let circle = model.circle.circle.as_ref().filter(|_| self.with_circle);
        let frame = json!({
            "frame": self.number,
            "session": self.session,
            "ended": self.has_ended,
            // As `status --json` has it.
            "status": json::state(model),
            "says": {
                "symbol": says.symbol,
                "state": says.state,
                "detail": says.detail,
                "next": says.next,
                "tone": match says.tone {
                    Tone::Good => "good",
                    Tone::Waits => "waits",
                    Tone::Bad => "bad",
                },
            },
            "drawn": self.drawn,
            "points": self.new.iter().map(shown).collect::<Vec<_>>(),
            "tool": trail.and_then(|trail| trail.now()).map(|now| shown(&now)),
            "circle": circle.map(|shape| of_circle(&model.circle, shape)),
            "reversals": reversals(model),
            "reversals_seen": model.reversals.count,
            "events": events(model),
            "period_us": model.timing.summary().map(|summary| {
                [summary.p50_us, summary.p99_us, summary.max_us].map(|us| rounded(us, 1))
            }),
            "scans_seen": model.seen_scans.0,
            "scans_not_seen": model.seen_scans.1,
        });
        without_missing(frame, &["circle"])
    }
}

fn of_circle(view: &CircleView, shape: &Circle) -> Value {
    // Per degree: lowest, mean and highest; null where nothing was seen.
    let deviation = view.deviation.iter().map(|bin| {
        let um = bin.map(|bin| [bin.low_um, bin.mean_um, bin.high_um]);
        um.map(|um| um.map(|um| rounded(um, 2)))
    });
    json!({
        "plane": shape.plane,
        "line": shape.line,
        "radius_mm": rounded(shape.radius_mm, 4),
        "feed_mm_min": round(shape.feed_mm_s.map(|mm_s| mm_s * 60.0), 1),
        "running": view.running,
        "angle_rad": round(view.angle_rad, 4),
        "deviation_um": deviation.collect::<Vec<_>>(),
    })
}

fn reversals(model: &Model) -> Vec<Value> {
    let newest_first = model.reversals.last.iter().rev().take(REVERSALS);
    newest_first
        .map(|of| json::reversal(model, of, 2))
        .collect()
}

fn events(model: &Model) -> Vec<Value> {
    let newest_first = model.events.last.iter().rev().take(EVENTS);
    let each = newest_first.map(|of| joined(json!({ "number": of.number }), json::event(of)));
    each.collect()
}
