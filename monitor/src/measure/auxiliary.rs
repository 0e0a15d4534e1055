//! What happened beside the axes: each change of spindle, coolant, outputs, tool and stops, with its scan.

use bus::sample::{Auxiliaries, Feedback};

use crate::auxiliary::changes;

/// Events that are kept.
const EVENTS_MAX: usize = 1000;

/// Something that happened beside the axes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct AuxiliaryEvent {
    /// The scan.
    pub scan: u64,
    /// What.
    pub words: String,
}

/// Collects them, scan by scan.
#[derive(Debug, Clone, Default)]
pub struct AuxiliaryMeter {
    before: Option<Auxiliaries>,
    events: Vec<AuxiliaryEvent>,
}

impl AuxiliaryMeter {
    /// Takes the next scan.
    pub fn take(&mut self, feedback: &Feedback) {
        let now = feedback.auxiliary;
        let before = self.before.replace(now).unwrap_or(now);
        if before == now || self.events.len() >= EVENTS_MAX {
            return;
        }
        let changes = changes(&before, &now).into_iter();
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
