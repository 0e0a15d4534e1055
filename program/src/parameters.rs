//! The numbered and named parameters of a program (LinuxCNC manual, *G Code Overview*: parameters).

use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::sync::Arc;

use crate::refusal::{Refusal, wrong};

/// The highest number of a parameter.
pub const NUMBER_MAX: u32 = 5602;

/// The first number of each group of nine that hold a position.
pub mod base {
    /// Where the probe tripped; 5070 tells whether it did.
    pub const PROBED: u32 = 5061;
    /// The offset of the tool that is applied.
    pub const APPLIED: u32 = 5081;
    /// Where G28 leads.
    pub const HOME_28: u32 = 5161;
    /// Where G30 leads.
    pub const HOME_30: u32 = 5181;
    /// 1 while the offsets of G92 apply; they follow.
    pub const G92_APPLIES: u32 = 5210;
    /// Which work offset applies, 1 to 9.
    pub const WORK_OFFSET: u32 = 5220;
    /// The first work offset (G54); the others follow every 20, each with its rotation behind it.
    pub const G54: u32 = 5221;
    /// What M66 read.
    pub const INPUT: u32 = 5399;
    /// The tool in the spindle, as the table has it: number, nine offsets, diameter, front and back angle, orientation.
    pub const TOOL: u32 = 5400;
    /// Where the tool is, in the coordinates of the program.
    pub const POSITION: u32 = 5420;
    /// Above 0 while (DEBUG, …) is shown.
    pub const DEBUG_SHOWN: u32 = 5599;
}

/// The last number of those that a program may use as it likes.
const OWN_MAX: u32 = 5000;

/// Whether a program may use it as it likes: not those with which Fanuc's ends or stops, though LinuxCNC would let it.
fn is_free(number: u32) -> bool {
    number <= OWN_MAX && !(3000..=3012).contains(&number)
}

/// Whether a number above [`OWN_MAX`] is a parameter that there is (LinuxCNC manual, *Numbered Parameters*).
fn is_known(number: u32) -> bool {
    match number {
        5061..=5070 | 5081..=5089 | 5161..=5169 | 5181..=5189 | 5210..=5220 => true,
        5221..=5390 => (number - base::G54) % 20 < 10,
        base::INPUT | 5400..=5413 | 5420..=5428 | base::DEBUG_SHOWN => true,
        _ => false,
    }
}

/// What a number is in Fanuc's language, and what a program says here instead; none of a number that is no system variable there.
/// (Fanuc, B-63534EN/02, 15.2.)
fn in_fanuc(number: u32) -> Option<(&'static str, &'static str)> {
    Some(match number {
        1000..=1035 => ("an input", "M66 P0 L0 reads input 0 into #5399"),
        1100..=1135 => (
            "an output",
            "M64 P0 and M65 P0 switch output 0, M68 sets an analogue one",
        ),
        2001..=2999 => (
            "a tool or work offset",
            "#5401 to #5413 are the tool's, #5221 to #5230 those of G54; G10 sets both",
        ),
        3000 => (
            "the alarm that ends a program",
            "(ABORT, text) gives the program up",
        ),
        3001 | 3002 | 3011 | 3012 => ("a clock", "there is no clock; G4 waits"),
        3003..=3005 => (
            "a lock of the operator's switches",
            "M49 locks the override, nothing locks the others",
        ),
        3006 => (
            "the stop with a message",
            "(MSG, text), and M0 in the block behind it",
        ),
        3007 => ("the mirror image", "nothing is mirrored"),
        3901 | 3902 => (
            "a counter of parts",
            "a parameter of your own that the parameter file names is kept",
        ),
        4001..=4130 | 4201..=4330 => (
            "a mode in force",
            "#<_motion_mode>, #<_plane>, #<_feed>, #<_rpm>, #<_current_tool> and other names tell the modes",
        ),
        5001..=5060 => (
            "a place of the axes",
            "#5420 to #5428 are the place in the program's coordinates, #<_abs_x> and its kind in the machine's",
        ),
        _ => return None,
    })
}

/// Refuses a number that is no parameter here, or means something else in Fanuc's language.
fn not_foreign(number: u32) -> Result<(), Refusal> {
    if is_known(number) {
        return Ok(());
    }
    if let Some((what, right)) = in_fanuc(number) {
        let found = format!("#{number}, which is {what} in Fanuc's language and no parameter here");
        let set_first = match is_free(number) {
            true => "; one of your own is set before it is read",
            false => "",
        };
        return wrong(found, format!("{right}{set_first}"));
    }
    if number <= OWN_MAX {
        return Ok(());
    }
    let right = "#1 to #5000 are the program's own, and above them there are #5061 to #5070, #5081 to #5089, #5161 to #5189, #5210 to #5390, #5399, #5400 to #5428 and #5599";
    wrong(format!("#{number}, which is no parameter"), right)
}

/// Refuses a parameter that a program cannot set.
///
/// # Errors
/// What was found, and what would be right.
pub fn check_settable(number: u32) -> Result<(), Refusal> {
    let right = match number {
        5081..=5089 => "G43, G43.1, G43.2 and G49 set it",
        5400..=5413 => "M6 and M61 set it, G10 L1 the tool table",
        5420..=5428 => "motions set it",
        _ if is_free(number) => return Ok(()),
        _ => return not_foreign(number),
    };
    wrong(format!("#{number}, which is read-only"), right)
}

/// Whether setting it switches or corrects something in Fanuc's language, and nothing here.
pub fn acts_in_fanuc(number: u32) -> bool {
    matches!(number, 1100..=1135 | 2001..=2999 | 3901 | 3902)
}

/// Parameters and their values: #1 to #5602 and the global names. A copy costs little until one of the two is changed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Parameters {
    /// None of those that were never set.
    #[serde(with = "numbered")]
    numbered: Arc<Vec<Option<f64>>>,
    global: Arc<BTreeMap<String, f64>>,
    /// Numbers above [`NUMBER_MAX`].
    beyond: Arc<BTreeMap<u32, f64>>,
}

impl Default for Parameters {
    fn default() -> Self {
        let mut parameters = Self {
            numbered: Arc::new(vec![None; NUMBER_MAX as usize + 1]),
            global: Arc::default(),
            beyond: Arc::default(),
        };
        parameters.set(base::DEBUG_SHOWN, 1.0);
        parameters
    }
}

impl Parameters {
    /// The value of `#number`; 0 for one that was never set, or that there is not.
    pub fn get(&self, number: u32) -> f64 {
        self.if_set(number).unwrap_or(0.0)
    }

    /// The value of `#number`, if it was ever set.
    pub fn if_set(&self, number: u32) -> Option<f64> {
        match self.numbered.get(number as usize) {
            Some(value) => *value,
            None => self.beyond.get(&number).copied(),
        }
    }

    /// Takes the value of `#number` away: it is as if it was never set.
    pub fn clear(&mut self, number: u32) {
        if let Some(slot) = Arc::make_mut(&mut self.numbered).get_mut(number as usize) {
            *slot = None;
        }
    }

    /// Sets `#number`, or takes its value away.
    pub fn put(&mut self, number: u32, value: Option<f64>) {
        match value {
            Some(value) => self.set(number, value),
            None => self.clear(number),
        }
    }

    /// The value of `#number` where a program names it.
    ///
    /// # Errors
    /// There is no such parameter, or it was never set and means something else in Fanuc's language: what was found, and what would
    /// be right.
    pub fn read(&self, number: u32) -> Result<f64, Refusal> {
        match self.if_set(number) {
            Some(value) => Ok(value),
            None => not_foreign(number).map(|()| 0.0),
        }
    }

    /// Sets `#number`.
    pub fn set(&mut self, number: u32, value: f64) {
        match Arc::make_mut(&mut self.numbered).get_mut(number as usize) {
            Some(slot) => *slot = Some(value),
            None => {
                Arc::make_mut(&mut self.beyond).insert(number, value);
            }
        }
    }

    /// The value of a global name (`#<_name>`), if it is set.
    pub fn named(&self, name: &str) -> Option<f64> {
        self.global.get(name).copied()
    }

    /// How many global names are set.
    pub fn names(&self) -> usize {
        self.global.len()
    }

    /// Sets a global name.
    pub fn set_named(&mut self, name: String, value: f64) {
        Arc::make_mut(&mut self.global).insert(name, value);
    }
}

/// Numbered parameters, of which most were never set.
mod numbered {
    use std::sync::Arc;

    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    /// Writes those that were set.
    pub fn serialize<S: Serializer>(
        values: &Arc<Vec<Option<f64>>>,
        to: S,
    ) -> Result<S::Ok, S::Error> {
        let set: Vec<(u32, f64)> = (0..)
            .zip(values.iter().copied())
            .filter_map(|(number, value)| Some((number, value?)))
            .collect();
        set.serialize(to)
    }

    /// Reads them.
    pub fn deserialize<'de, D: Deserializer<'de>>(
        from: D,
    ) -> Result<Arc<Vec<Option<f64>>>, D::Error> {
        let mut values = vec![None; super::NUMBER_MAX as usize + 1];
        for (number, value) in Vec::<(u32, f64)>::deserialize(from)? {
            if let Some(slot) = values.get_mut(number as usize) {
                *slot = Some(value);
            }
        }
        Ok(Arc::new(values))
    }
}
