//! What happened beside the axes: each change of spindle, coolant, outputs, tool and stops, with its scan.

use bus::sample::{Auxiliaries, Feedback, Inputs};
use serde::Serialize;

use crate::auxiliary::{changes, switched};

/// Events that are kept.
const EVENTS_MAX: usize = 1000;

/// Something that happened beside the axes.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct AuxiliaryEvent {
    /// The scan.
    pub scan: u64,
    /// What.
    #[serde(rename = "event")]
    pub words: String,
}

/// Collects them, scan by scan.
#[derive(Debug, Clone, Default)]
pub struct AuxiliaryMeter {
    before: Option<(Auxiliaries, Inputs)>,
    events: Vec<AuxiliaryEvent>,
}

impl AuxiliaryMeter {
    /// Takes the next scan.
    pub fn take(&mut self, feedback: &Feedback) {
        let now = (feedback.auxiliary, feedback.inputs);
        let before = self.before.replace(now).unwrap_or(now);
        if before == now || self.events.len() >= EVENTS_MAX {
            return;
        }
        let switched = switched(&before.1, &now.1).into_iter();
        let changes = switched.chain(changes(&before.0, &now.0));
        self.events.extend(changes.map(|words| AuxiliaryEvent {
            scan: feedback.scan,
            words,
        }));
    }

    /// All that were seen, in order.
    pub fn finish(self) -> Vec<AuxiliaryEvent> {
        self.events
    }
}
