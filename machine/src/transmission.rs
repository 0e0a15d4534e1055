//! `[axis.transmission]`: what stands between a motor and its axis, in place of the lead.

use std::f64::consts::PI;

use schemars::JsonSchema;
use serde::Deserialize;
use toml::{Table, Value};

use crate::axis_kind::AxisKind;
use crate::settings_file::{At, Rules};

/// What stands between a motor and its axis.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema)]
pub struct Transmission {
    /// Turns of the motor for one of the screw, the pinion, the pulley or the rotary table.
    #[schemars(extend("minimum" = 0.01, "maximum" = 10_000, "default" = 1.0))]
    pub gear_ratio: f64,
    /// A screw: travel in one turn of it.
    #[schemars(extend("unit" = "mm", "exclusiveMinimum" = 0, "maximum" = 1000))]
    pub screw_lead_mm: Option<f64>,
    /// A rack: module of its teeth and of the pinion's, pitch over π.
    #[schemars(extend("unit" = "mm", "exclusiveMinimum" = 0, "maximum" = 100))]
    pub rack_module_mm: Option<f64>,
    /// With a rack: teeth of the pinion.
    #[schemars(extend("minimum" = 5, "maximum" = 1000))]
    pub pinion_teeth: Option<u32>,
    /// A toothed belt: its pitch.
    #[schemars(extend("unit" = "mm", "exclusiveMinimum" = 0, "maximum" = 100))]
    pub belt_pitch_mm: Option<f64>,
    /// With a belt: teeth of the pulley.
    #[schemars(extend("minimum" = 5, "maximum" = 1000))]
    pub pulley_teeth: Option<u32>,
}

/// What a transmission is made of, by the keys that say it; none where they say nothing or two things.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Kind {
    Screw(f64),
    Rack { module_mm: f64, teeth: f64 },
    Belt { pitch_mm: f64, teeth: f64 },
    Table,
}

impl Kind {
    fn of(number: impl Fn(&str) -> Option<f64>) -> Option<Kind> {
        let rack = (number("rack_module_mm"), number("pinion_teeth"));
        let belt = (number("belt_pitch_mm"), number("pulley_teeth"));
        match (number("screw_lead_mm"), rack, belt) {
            (Some(lead_mm), (None, None), (None, None)) => Some(Kind::Screw(lead_mm)),
            (None, (Some(module_mm), Some(teeth)), (None, None)) => {
                Some(Kind::Rack { module_mm, teeth })
            }
            (None, (None, None), (Some(pitch_mm), Some(teeth))) => {
                Some(Kind::Belt { pitch_mm, teeth })
            }
            (None, (None, None), (None, None)) => Some(Kind::Table),
            _ => None,
        }
    }

    /// Travel of the axis in one turn of screw, pinion, pulley or table, in mm or degrees.
    fn turn_mm(self) -> f64 {
        match self {
            Kind::Screw(lead_mm) => lead_mm,
            Kind::Rack { module_mm, teeth } => PI * module_mm * teeth,
            Kind::Belt { pitch_mm, teeth } => pitch_mm * teeth,
            Kind::Table => 360.0,
        }
    }
}

/// Gives a table with a transmission, and without a lead, the lead that follows: travel of the axis in one turn of the motor.
pub fn complete(table: &mut Table) {
    let Some(of) = table.get("transmission").and_then(Value::as_table) else {
        return;
    };
    let number = |key: &str| of.get(key).and_then(number);
    let ratio = number("gear_ratio").unwrap_or(1.0);
    let lead_mm = Kind::of(number).map(|kind| kind.turn_mm() / ratio);
    if let (Some(lead_mm), false) = (lead_mm, table.contains_key("lead_mm")) {
        table.insert("lead_mm".into(), Value::Float(lead_mm));
    }
}

/// A number of a TOML file, with or without a point.
pub fn number(value: &Value) -> Option<f64> {
    value
        .as_float()
        .or(value.as_integer().map(|whole| whole as f64))
}

/// The transmission of an axis says one thing, and what fits its kind. `within` is the table that it stands in.
pub fn judge(
    rules: &mut Rules<'_>,
    at: At<'_>,
    within: &[&str],
    of: &Transmission,
    kind: AxisKind,
) {
    let path = [within, &["transmission"]].concat();
    if rules.has(at, &[within, &["lead_mm"]].concat()) {
        rules.say(
            &path,
            at,
            "goes without `lead_mm`, which is reckoned from this table",
        );
    }
    let given = |key: &str| match key {
        "screw_lead_mm" => of.screw_lead_mm,
        "rack_module_mm" => of.rack_module_mm,
        "pinion_teeth" => of.pinion_teeth.map(f64::from),
        "belt_pitch_mm" => of.belt_pitch_mm,
        _ => of.pulley_teeth.map(f64::from),
    };
    let what = match (Kind::of(given), kind == AxisKind::Rotary) {
        (Some(Kind::Table), false) => {
            "says what it is: screw_lead_mm, or rack_module_mm and pinion_teeth, or belt_pitch_mm and pulley_teeth"
        }
        (None, false) => {
            "is one thing: screw_lead_mm, or rack_module_mm and pinion_teeth, or belt_pitch_mm and pulley_teeth"
        }
        (Some(Kind::Table), true) | (Some(_), false) => return,
        (_, true) => {
            "of a rotary axis has gear_ratio alone: turns of the motor for one of the axis"
        }
    };
    rules.say(&path, at, what);
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lead_mm(text: &str) -> Option<f64> {
        let mut table: Table = text.parse().expect("TOML");
        complete(&mut table);
        table.get("lead_mm").and_then(number)
    }

    #[test]
    fn a_lead_follows_from_screw_rack_belt_and_gear() {
        let of = |keys: &str| lead_mm(&format!("[transmission]\n{keys}"));
        assert_eq!(of("screw_lead_mm = 10\ngear_ratio = 2"), Some(5.0));
        let rack = of("rack_module_mm = 2\npinion_teeth = 20\ngear_ratio = 10.0");
        assert!((rack.expect("a lead") - 4.0 * PI).abs() < 1e-12);
        assert_eq!(of("belt_pitch_mm = 5.0\npulley_teeth = 20"), Some(100.0));
        assert_eq!(of("gear_ratio = 90"), Some(4.0));
        assert_eq!(of("screw_lead_mm = 10\nbelt_pitch_mm = 5.0"), None);
        assert_eq!(lead_mm("lead_mm = 3.0"), Some(3.0));
    }
}
