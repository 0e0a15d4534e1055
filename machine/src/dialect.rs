//! The language that programs are written in.

use std::fmt;
use std::str::FromStr;

use schemars::JsonSchema;
use serde::Deserialize;

/// The language that a program is written in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Dialect {
    /// RS274/NGC with the extensions of LinuxCNC.
    #[default]
    LinuxCnc,
    /// The words of Fanuc's and Haas' controls for mills and lathes.
    Fanuc,
}

impl Dialect {
    /// All of them, with their names.
    pub const ALL: [(Dialect, &str); 2] =
        [(Dialect::LinuxCnc, "linuxcnc"), (Dialect::Fanuc, "fanuc")];
}

impl fmt::Display for Dialect {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let named = Dialect::ALL.iter().find(|(dialect, _)| dialect == self);
        out.write_str(named.map_or("", |(_, name)| name))
    }
}

impl FromStr for Dialect {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let named = Dialect::ALL.iter().find(|(_, name)| *name == text);
        named
            .map(|(dialect, _)| *dialect)
            .ok_or_else(|| format!("{text:?} is no dialect: linuxcnc or fanuc"))
    }
}

/// What a word without a decimal point counts in programs of [`Dialect::Fanuc`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum DecimalPoint {
    /// X10 is 10 mm, as on a pocket calculator.
    #[default]
    Calculator,
    /// X10 is 10 times the least input increment: 0.010 mm, 0.0010 inch or 0.010 degrees.
    Standard,
}
