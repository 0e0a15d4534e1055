//! Rotary axes in their own units: the keys of a slide with degrees in place of mm.
//!
//! A slide that travels 1 mm per degree stands for the axis, and power and energy are the same: 1 N·m about the axis is (π/180)·1000 =
//! 17.45 N, 1 kg·m² is 17.45² kg (docs/methods/pivot-axis.md). Programs compute with that slide alone.

use serde_json::Value as Json;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// Force of the slide that stands for 1 N·m about the axis, in N: as many degrees are in a radian, times 1000 mm in a metre.
pub const N_PER_NM: f64 = 1000.0 * std::f64::consts::PI / 180.0;
/// Mass that stands for 1 kg·m², in kg; also 1 N·m/rad in N/m and 1 N·m·s/rad in N·s/m.
const KG_PER_KG_M2: f64 = N_PER_NM * N_PER_NM;

/// How keys of a rotary axis are called, and what they are of the slide that stands for it.
#[derive(Debug, PartialEq)]
pub struct OwnUnit {
    /// How its name ends.
    pub own_ending: &'static str,
    /// How the name of the slide's key ends.
    pub slide_ending: &'static str,
    /// The unit by which a rotary axis is known.
    pub unit: &'static str,
    /// The unit of the slide's key.
    pub slide_unit: &'static str,
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
pub const OWN_UNITS: [OwnUnit; 12] = [
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
