//! The numbered and named parameters of a program (LinuxCNC manual, *G Code Overview*: parameters).

use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::sync::Arc;

/// The highest number of a parameter.
pub const NUMBER_MAX: u32 = 5602;

/// The axis letters in the order of the parameters that hold positions.
pub const POSITION_LETTERS: &str = "XYZABCUVW";

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

/// Parameters and their values: #1 to #5602 and the global names. A copy costs little until one of the two is changed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Parameters {
    #[serde(with = "crate::snapshot::numbered")]
    numbered: Arc<Vec<f64>>,
    #[serde(with = "crate::snapshot::named")]
    global: Arc<BTreeMap<String, f64>>,
}

impl Default for Parameters {
    fn default() -> Self {
        let mut parameters = Self {
            numbered: Arc::new(vec![0.0; NUMBER_MAX as usize + 1]),
            global: Arc::default(),
        };
        parameters.set(base::DEBUG_SHOWN, 1.0);
        parameters
    }
}

impl Parameters {
    /// The value of `#number`; 0 for one that was never set, or that there is not.
    pub fn get(&self, number: u32) -> f64 {
        self.numbered.get(number as usize).copied().unwrap_or(0.0)
    }

    /// Sets `#number`; nothing happens for one that there is not.
    pub fn set(&mut self, number: u32, value: f64) {
        if let Some(slot) = Arc::make_mut(&mut self.numbered).get_mut(number as usize) {
            *slot = value;
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
