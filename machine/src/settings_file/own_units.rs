//! Rotary axes in their own units: the keys of a slide with degrees in place of mm.
//!
//! A slide that travels 1 mm per degree stands for the axis, and power and energy are the same: 1 N·m about the axis is (π/180)·1000 =
//! 17.45 N, 1 kg·m² is 17.45² kg (docs/methods/pivot-axis.md). Programs compute with that slide alone.

use serde_json::Value as Json;
use toml::de::{DeTable, DeValue};
use toml::{Spanned, Table, Value};

use crate::settings_file::document::Document;
use crate::settings_file::schema::KeySchema;

/// Force of the slide that stands for 1 N·m about the axis, in N: as many degrees are in a radian, times 1000 mm in a metre.
pub const N_PER_NM: f64 = 1000.0 * std::f64::consts::PI / 180.0;
/// Mass that stands for 1 kg·m², in kg; also 1 N·m/rad in N/m and 1 N·m·s/rad in N·s/m.
const KG_PER_KG_M2: f64 = N_PER_NM * N_PER_NM;

/// How keys of a rotary axis are called, and what they are of the slide that stands for it.
#[derive(Debug, PartialEq)]
pub struct OwnUnit {
    own_ending: &'static str,
    slide_ending: &'static str,
    /// The unit by which a rotary axis is known.
    pub unit: &'static str,
    slide_unit: &'static str,
    /// The slide's value is this times the axis's own.
    pub factor: f64,
}

const fn unit(
    own_ending: &'static str,
    unit: &'static str,
    factor: f64,
    slide_ending: &'static str,
    slide_unit: &'static str,
) -> OwnUnit {
    OwnUnit {
        own_ending,
        slide_ending,
        unit,
        slide_unit,
        factor,
    }
}

/// Longer endings first, so that `_deg_s2` is none of `_deg`.
#[rustfmt::skip] // a table
const OWN_UNITS: [OwnUnit; 12] = [
    unit("_deg_s3", "°/s³", 1.0, "_mm_s3", "mm/s³"),
    unit("_deg_s2", "°/s²", 1.0, "_mm_s2", "mm/s²"),
    unit("_deg_s", "°/s", 1.0, "_mm_s", "mm/s"),
    unit("_mdeg", "mdeg", 1.0, "_um", "µm"),
    unit("_udeg", "µdeg", 1.0, "_nm", "nm"),
    unit("_deg", "°", 1.0, "_mm", "mm"),
    unit("inertia_kg_m2", "kg·m²", KG_PER_KG_M2, "mass_kg", "kg"),
    unit("_nm_s_per_rad", "N·m·s/rad", KG_PER_KG_M2, "_n_s_per_m", "N·s/m"),
    unit("_nm_per_rad", "N·m/rad", KG_PER_KG_M2, "_n_per_m", "N/m"),
    unit("_nm_per_rad", "N·m/rad", KG_PER_KG_M2 * 1e-6, "_n_per_um", "N/µm"),
    unit("torque_nm", "N·m", N_PER_NM, "force_n", "N"),
    unit("_nm", "N·m", N_PER_NM, "_n", "N"),
];

/// The key of the slide that a rotary axis has under the name `own` in a table, and its unit there. None for what the table has itself.
pub fn slide_key<'a>(
    schema: KeySchema<'a>,
    own: &str,
) -> Option<(&'a str, KeySchema<'a>, &'static OwnUnit)> {
    if schema.key(own).is_some() {
        return None;
    }
    OWN_UNITS.iter().find_map(|unit| {
        let name = format!(
            "{}{}",
            own.strip_suffix(unit.own_ending)?,
            unit.slide_ending
        );
        let (name, of_key) = schema.keys().find(|(key, _)| *key == name)?;
        (of_key.number_unit() == unit.slide_unit).then_some((name, of_key, unit))
    })
}

/// The name that a rotary axis has for a key of a slide, and its unit; none for what is the same for both.
pub fn own_key(schema: KeySchema<'_>, key: &str) -> Option<(String, &'static OwnUnit)> {
    let of_key = schema.keys().find(|(name, _)| *name == key)?.1;
    let unit = OWN_UNITS
        .iter()
        .find(|unit| key.ends_with(unit.slide_ending) && of_key.number_unit() == unit.slide_unit)?;
    let own = format!(
        "{}{}",
        key.strip_suffix(unit.slide_ending)?,
        unit.own_ending
    );
    // What a rotary axis would call like another key keeps its name.
    schema.key(&own).is_none().then_some((own, unit))
}

/// Makes of the schema of a slide's key that of a rotary axis.
pub fn of_rotary(schema: &mut Json, unit: &OwnUnit) {
    let Some(object) = schema.as_object_mut() else {
        return;
    };
    if object.contains_key("unit") {
        object.insert("unit".into(), unit.unit.into());
    }
    for word in ["minimum", "exclusiveMinimum", "maximum", "default"] {
        let number = object.get(word).and_then(Json::as_f64);
        if let Some(number) = number.filter(|_| unit.factor != 1.0) {
            object.insert(word.into(), divided(number, unit.factor).into());
        }
    }
    if let Some(items) = object.get_mut("items") {
        of_rotary(items, unit);
    }
}

/// A limit in another unit, rounded to what people write.
pub fn divided(limit: f64, by: f64) -> f64 {
    match by {
        1.0 => limit,
        by => format!("{:.2e}", limit / by).parse().unwrap_or(limit / by),
    }
}

/// Names under which a key of a slide may stand in a file, whatever its table.
pub fn names(key: &str) -> impl Iterator<Item = (String, &'static OwnUnit)> {
    OWN_UNITS.iter().filter_map(move |unit| {
        let stem = key.strip_suffix(unit.slide_ending)?;
        Some((format!("{stem}{}", unit.own_ending), unit))
    })
}

/// Whether the axis of a table is rotary.
pub fn is_rotary(axis: &DeTable<'_>) -> bool {
    let kind = axis.get("kind").map(Spanned::get_ref);
    matches!(kind, Some(DeValue::String(kind)) if kind == "rotary")
}

/// Which axes of a document are rotary, in its order.
pub fn rotary_axes(document: &Document<'_>) -> Vec<bool> {
    let axes = document.root().get("axis").map(Spanned::get_ref);
    let axes = axes.and_then(DeValue::as_array).into_iter().flatten();
    axes.map(|axis| axis.get_ref().as_table().is_some_and(is_rotary))
        .collect()
}

/// Gives the rotary axes of a file the keys of the slides that stand for them.
pub fn into_slides(schema: KeySchema<'_>, file: &mut Table) {
    let of_axis = schema.key("axis").and_then(KeySchema::items);
    let axes = file.get_mut("axis").and_then(Value::as_array_mut);
    let (Some(of_axis), Some(axes)) = (of_axis, axes) else {
        return;
    };
    for axis in axes.iter_mut().filter_map(Value::as_table_mut) {
        if axis.get("kind").and_then(Value::as_str) == Some("rotary") {
            into_slide(of_axis, axis);
        }
    }
}

fn into_slide(schema: KeySchema<'_>, table: &mut Table) {
    let keys: Vec<String> = table.keys().cloned().collect();
    for own in keys {
        if let Some((key, _, unit)) = slide_key(schema, &own) {
            if let Some(value) = table.remove(&own) {
                table.insert(key.to_string(), scaled(value, unit.factor));
            }
        } else if let (Some(Value::Table(inner)), Some(of_key)) =
            (table.get_mut(&own), schema.key(&own))
        {
            into_slide(of_key, inner);
        }
    }
}

/// A value of another unit; of the same digits where one is one.
fn scaled(value: Value, factor: f64) -> Value {
    match value {
        value if factor == 1.0 => value,
        Value::Integer(number) => Value::Float(number as f64 * factor),
        Value::Float(number) => Value::Float(number * factor),
        Value::Array(list) => Value::Array(
            list.into_iter()
                .map(|value| scaled(value, factor))
                .collect(),
        ),
        other => other,
    }
}
