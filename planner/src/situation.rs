//! What a feedback says of the machine, in the words that planning goes by.

use bus::sample::{Feedback, Mode, PATH_AXES, PathTag, Reference};

/// What planning goes by: all of one feedback, and nothing of it is remembered.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Situation {
    /// The machine executes windows.
    pub enabled: bool,
    /// Feed hold is latched.
    pub hold: bool,
    /// The command rests.
    pub rests: bool,
    /// The master wants no motion before an event is done or a question answered.
    pub blocked: bool,
    /// Every axis knows its place: before that no program can be read from it.
    pub referenced: bool,
    /// Override of feeds that counts, in percent.
    pub override_percent: u32,
    /// Where the path was left; none before the program begins.
    pub left_at: Option<PathTag>,
    /// Where the tool is on the path, or was when the path was left; none before the program begins.
    pub tool_at: Option<PathTag>,
    /// The line that the program is to be started at, until the master knows where that is.
    pub seeks_line: Option<u32>,
    /// Command positions of the axes of the path, in increments.
    pub positions: [i64; PATH_AXES],
}

impl Situation {
    /// By this feedback.
    pub fn of(feedback: &Feedback) -> Situation {
        let on_path = |tag: PathTag| (!tag.is_off_path()).then_some(tag);
        let auxiliary = &feedback.auxiliary;
        let left_at = on_path(feedback.interrupted_at);
        let seeks = auxiliary.start_line != 0 && left_at.is_none();
        let mut axes = feedback.axes().iter();
        Situation {
            enabled: Mode::from_wire(feedback.mode) == Some(Mode::Enabled),
            hold: feedback.hold == 1,
            rests: feedback.at_rest == 1,
            blocked: auxiliary.blocked == 1,
            referenced: axes.all(|axis| axis.reference == Reference::Known as u32),
            override_percent: match auxiliary.override_disabled {
                1 => 100,
                _ => feedback.override_percent,
            },
            left_at,
            tool_at: on_path(feedback.tag).or(left_at),
            seeks_line: seeks.then_some(auxiliary.start_line),
            positions: feedback.path_positions(),
        }
    }

    /// Whether nothing is to move on the path: by a hold, a wait of the master, or an override of 0.
    pub fn held(&self) -> bool {
        self.hold || self.blocked || self.override_percent == 0
    }

    /// The element that the tool is at, or was when the path was left; the first before the program begins.
    pub fn tool_element(&self) -> u32 {
        self.tool_at.map_or(0, |tag| tag.element)
    }
}
