//! One frame of the page: everything that changes, whole, so that a browser that has missed some needs none of them.

use axum::body::Bytes;
use serde_json::{Value, json};

use super::pictures::{Drawn, shown as shown_point};
use crate::live::json::{self, joined};
use crate::live::model::Model;
use crate::live::trail::TrailPoint;

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
        let shown = &model.shown;
        let trail = model.trail.as_ref();
        let frame = json!({
            "frame": self.number,
            "session": self.session,
            "ended": self.has_ended,
            // As `status --json` has it.
            "status": json::state(&shown.state),
            "drawn": self.drawn,
            "points": self.new.iter().map(shown_point).collect::<Vec<_>>(),
            "tool": trail.and_then(|trail| trail.now()).map(|now| shown_point(&now)),
            "reversals": reversals(model),
            "reversals_seen": model.reversals.count,
            "events": events(model),
            "period_us": shown.timing.as_ref().map(|of| [of.p50_us, of.p99_us, of.max_us]),
            "scans_seen": model.seen_scans.0,
            "scans_not_seen": model.seen_scans.1,
        });
        match shown.circle.as_ref().filter(|_| self.with_circle) {
            Some(circle) => joined(frame, json!({ "circle": circle })),
            None => frame,
        }
    }
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::live::test_support::{look, machine, take_spoilt, with_program};
    use crate::live::trail::Trail;
    use crate::spoilt::{self, Spoiler};
    use crate::web::pictures::Pictures;

    fn json_of(text: &[u8]) -> Value {
        serde_json::from_slice(text).expect("JSON")
    }

    /// SPOILT_SAMPLES=1000000 takes some 15 s.
    #[test]
    fn no_number_of_any_sample_keeps_the_page_from_its_next_frame() {
        let mut model = Model::new("mill-3", machine());
        model.trail = Some(Trail::default());
        let (mut pictures, mut spoiler) = (Pictures::new(&model), Spoiler::new());
        for number in 0..spoilt::count(20_000) {
            if number % 10_000 == 5_000 {
                with_program(&mut model);
            }
            take_spoilt(&mut model, number, &mut spoiler);
            if number % 50 == 0 {
                model.end_of_look();
                look(&mut model);
                let new = pictures.follow(&mut model);
                let frame = Frame {
                    number,
                    session: 1,
                    has_ended: model.ended,
                    with_circle: true,
                    drawn: pictures.state(),
                    new: &new,
                };
                let event = frame.as_event(&model);
                let data = event.split(|byte| *byte == b'\n').nth(1).expect("data");
                let shown = json_of(data.strip_prefix(b"data: ").expect("data"));
                assert_eq!(shown["frame"], number, "{shown}");
                json_of(&pictures.trail());
                json_of(&pictures.path());
            }
        }
    }
}
