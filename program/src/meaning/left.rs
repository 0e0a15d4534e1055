//! What a run leaves to the next one.

use machine::MODES_OF_END;
use machine::offsets_file::WORK_OFFSETS;

use super::State;
use crate::state::{FeedMode, Motion};

impl State {
    /// The modes that the run leaves to the next one, as the words of a block; M2 and M30 leave [`MODES_OF_END`] and what they do not
    /// change. Spindle, coolant, compensation and override end with each run, and so does a motion that is more than a line or an arc.
    pub fn modes_left(&self, ends_by_word: bool) -> String {
        let modes = &self.in_force;
        let mut words = vec![if modes.inches { "G20" } else { "G21" }.to_owned()];
        let mut when = |is: bool, word: &str| {
            if is {
                words.push(word.to_owned());
            }
        };
        when(modes.diameters, "G7");
        when(modes.arc_absolute, "G90.1");
        when(modes.returns_to_r, "G99");
        words.push(format!("G{}", f64::from(modes.path_control) / 10.0));
        let tolerances = ['P', 'Q'].into_iter().zip(modes.path_words);
        words.extend(tolerances.filter_map(|(letter, value)| Some(format!("{letter}{}", value?))));
        if modes.surface.is_none() && modes.spindle.speed != 0.0 {
            words.push(format!("S{}", modes.spindle.speed));
        }
        if ends_by_word {
            words.push(MODES_OF_END.to_owned());
            return words.join(" ");
        }
        let motion = match modes.motion() {
            Motion::Rapid | Motion::Line | Motion::Arc { .. } => modes.motion_code() / 10.0,
            _ => 80.0,
        };
        words.push(format!("G{motion} G{}", modes.plane.0));
        words.push(if modes.incremental { "G91" } else { "G90" }.to_owned());
        words.extend(
            WORK_OFFSETS
                .get(self.work_offset())
                .map(|name| (*name).to_owned()),
        );
        words.push(modes.feed_mode.to_string());
        let is_kept = modes.feed_mode != FeedMode::InverseTime;
        if let Some(feed) = modes.feed.filter(|_| is_kept) {
            words.push(format!("F{}", feed.value * feed.unit_mm / modes.unit_mm()));
        }
        words.join(" ")
    }
}
