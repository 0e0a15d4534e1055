//! The plant file: what is true of the simulated machine, and the controller must not know.
//!
//! `plant.toml` beside `machine.toml`; read once and checked whole. Source of the reference values: docs/methods/physics.md §3.

use std::path::Path;

use machine::settings_file::{self, SettingsFileError, read_text};
use serde::Deserialize;

use crate::friction::{ELEMENTS, FrictionParameters};
use crate::mechanics::MechanicsParameters;
use crate::winding::WindingParameters;

mod rules;

/// The whole plant file.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlantFile {
    /// Integration step of the mechanics, in µs; divides every drive period.
    pub microstep_us: f64,
    /// Temperature around the machine, in °C.
    pub ambient_c: f64,
    /// Its axes.
    #[serde(rename = "axis")]
    pub axes: Vec<PlantAxis>,
}

/// One axis.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlantAxis {
    /// Its letter, as in the machine file.
    pub name: String,
    /// Where it stands when the machine is switched on for the first time, in mm.
    pub start_position_mm: f64,
    /// Motor with encoder and current loop.
    pub motor: PlantMotor,
    /// Ball screw.
    pub screw: PlantScrew,
    /// Table.
    pub table: PlantTable,
    /// Linear scale, where there is one.
    pub scale: Option<PlantScale>,
    /// Set after reading, in °C.
    #[serde(skip)]
    ambient_c: f64,
}

/// Motor with encoder and current loop.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlantMotor {
    /// Continuous torque, in N·m.
    pub rated_torque_nm: f64,
    /// Peak torque, in N·m.
    pub peak_torque_nm: f64,
    /// Inertia with coupling and screw, in kg·m².
    pub inertia_kg_m2: f64,
    /// Bandwidth of the current loop, in Hz.
    pub current_loop_hz: f64,
    /// Amplitude of the cogging torque, in N·m.
    pub cogging_torque_nm: f64,
    /// Cogging periods in one turn.
    pub cogging_per_turn: u32,
    /// Encoder counts in one turn.
    pub encoder_counts_per_turn: u32,
    /// Rise of the winding over the ambient at rated torque, in K.
    pub winding_rise_at_rated_k: f64,
    /// Thermal time constant of the winding, in min.
    pub winding_time_constant_min: f64,
    /// Bearings, nut and seals, at the motor.
    pub friction: MotorFriction,
}

/// Friction at the motor, in torques.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MotorFriction {
    /// In steady sliding, without the viscous part, in N·m.
    pub coulomb_torque_nm: f64,
    /// Break-away, in N·m.
    pub static_torque_nm: f64,
    /// Viscous, in N·m·s/rad.
    pub viscous_nm_s_per_rad: f64,
    /// Velocity vs of the Stribeck curve, in mm/s of travel.
    pub stribeck_velocity_mm_s: f64,
    /// Share of each element; the sum is 1.
    pub element_share: [f64; ELEMENTS],
    /// Distance at which each element breaks, in µm of travel.
    pub break_distance_um: [f64; ELEMENTS],
    /// Damping while sticking σ1, in N·s/m of travel.
    pub presliding_damping_n_s_per_m: f64,
    /// Time constant of attraction to the Stribeck curve, in ms.
    pub attraction_ms: f64,
}

/// Ball screw.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlantScrew {
    /// Travel per motor turn, in mm.
    pub lead_mm: f64,
    /// Axial stiffness between motor and table, in N/m.
    pub stiffness_n_per_m: f64,
    /// Damping ratio of motor against table (reduced mass).
    pub damping_ratio: f64,
    /// Backlash gap, in µm.
    pub gap_um: f64,
}

/// Table.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlantTable {
    /// Mass, in kg.
    pub mass_kg: f64,
    /// Guideways.
    pub friction: TableFriction,
}

/// Friction of the guideways, in forces.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TableFriction {
    /// In steady sliding, without the viscous part, in N.
    pub coulomb_n: f64,
    /// Break-away, in N.
    pub static_n: f64,
    /// Viscous, in N·s/m.
    pub viscous_n_s_per_m: f64,
    /// Velocity vs of the Stribeck curve, in mm/s.
    pub stribeck_velocity_mm_s: f64,
    /// Share of each element; the sum is 1.
    pub element_share: [f64; ELEMENTS],
    /// Distance at which each element breaks, in µm.
    pub break_distance_um: [f64; ELEMENTS],
    /// Damping while sticking σ1, in N·s/m.
    pub presliding_damping_n_s_per_m: f64,
    /// Time constant of attraction to the Stribeck curve, in ms.
    pub attraction_ms: f64,
}

/// Linear scale.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlantScale {
    /// Measuring step, in nm.
    pub resolution_nm: f64,
}

impl PlantFile {
    /// Reads and checks a plant file; `path` is the file or its folder.
    ///
    /// # Errors
    /// Unreadable, too large, not UTF-8, not TOML, unknown or missing key, or a value against its rule: each with file,
    /// line, value, unit and what would be right.
    pub fn load(path: &Path) -> Result<PlantFile, SettingsFileError> {
        let file = if path.is_dir() {
            path.join("plant.toml")
        } else {
            path.to_path_buf()
        };
        Self::parse(&file.display().to_string(), &read_text(&file)?)
    }

    /// Checks the text of a plant file; `name` stands in the messages.
    ///
    /// # Errors
    /// As [`PlantFile::load`].
    pub fn parse(name: &str, text: &str) -> Result<PlantFile, SettingsFileError> {
        let mut plant: PlantFile = settings_file::parse(name, text)?;
        for axis in &mut plant.axes {
            axis.ambient_c = plant.ambient_c;
        }
        rules::judge(name, text, &plant)?;
        Ok(plant)
    }

    /// The axis of this name.
    pub fn axis(&self, name: &str) -> Option<&PlantAxis> {
        self.axes.iter().find(|axis| axis.name == name)
    }

    /// The microstep in whole nanoseconds.
    pub fn microstep_ns(&self) -> u64 {
        libm::round(self.microstep_us * 1e3) as u64
    }
}

impl PlantAxis {
    /// p = lead/2π, in m: force = torque/p, mass = inertia/p².
    pub fn radius_m(&self) -> f64 {
        self.screw.lead_mm * 1e-3 / (2.0 * std::f64::consts::PI)
    }

    /// Inertia of motor and screw as a mass, in kg.
    pub fn motor_mass_kg(&self) -> f64 {
        let radius_m = self.radius_m();
        self.motor.inertia_kg_m2 / (radius_m * radius_m)
    }

    /// The mechanics in SI units of linear travel.
    pub fn mechanics(&self) -> MechanicsParameters {
        let radius_m = self.radius_m();
        let (m1, m2) = (self.motor_mass_kg(), self.table.mass_kg);
        let reduced_mass_kg = m1 * m2 / (m1 + m2);
        let motor = &self.motor.friction;
        let table = &self.table.friction;
        MechanicsParameters {
            motor_mass_kg: m1,
            table_mass_kg: m2,
            stiffness_n_per_m: self.screw.stiffness_n_per_m,
            damping_n_s_per_m: 2.0
                * self.screw.damping_ratio
                * (self.screw.stiffness_n_per_m * reduced_mass_kg).sqrt(),
            gap_m: self.screw.gap_um * 1e-6,
            cogging_n: self.motor.cogging_torque_nm / radius_m,
            cogging_per_m: f64::from(self.motor.cogging_per_turn) / (self.screw.lead_mm * 1e-3),
            current_loop_s: 1.0 / (2.0 * std::f64::consts::PI * self.motor.current_loop_hz),
            motor_friction: FrictionParameters {
                coulomb_n: motor.coulomb_torque_nm / radius_m,
                static_n: motor.static_torque_nm / radius_m,
                viscous_n_s_per_m: motor.viscous_nm_s_per_rad / (radius_m * radius_m),
                stribeck_velocity_m_s: motor.stribeck_velocity_mm_s * 1e-3,
                share: motor.element_share,
                break_distance_m: motor.break_distance_um.map(|um| um * 1e-6),
                presliding_damping_n_s_per_m: motor.presliding_damping_n_s_per_m,
                attraction_s: motor.attraction_ms * 1e-3,
            },
            table_friction: FrictionParameters {
                coulomb_n: table.coulomb_n,
                static_n: table.static_n,
                viscous_n_s_per_m: table.viscous_n_s_per_m,
                stribeck_velocity_m_s: table.stribeck_velocity_mm_s * 1e-3,
                share: table.element_share,
                break_distance_m: table.break_distance_um.map(|um| um * 1e-6),
                presliding_damping_n_s_per_m: table.presliding_damping_n_s_per_m,
                attraction_s: table.attraction_ms * 1e-3,
            },
        }
    }

    /// The winding.
    pub fn winding(&self) -> WindingParameters {
        WindingParameters {
            rated_torque_nm: self.motor.rated_torque_nm,
            rise_at_rated_k: self.motor.winding_rise_at_rated_k,
            time_constant_s: self.motor.winding_time_constant_min * 60.0,
            ambient_c: self.ambient_c,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const XY: &str = include_str!("../../machines/xy/plant.toml");

    /// The message for the reference file with one text replaced.
    fn message(old: &str, new: &str) -> String {
        assert!(XY.contains(old), "{old:?} is not in the reference file");
        let text = XY.replacen(old, new, 1);
        PlantFile::parse("plant.toml", &text)
            .unwrap_err()
            .to_string()
    }

    #[test]
    fn every_plant_file_that_comes_with_the_product_loads() {
        let machines = Path::new(env!("CARGO_MANIFEST_DIR")).join("../machines");
        for (folder, axes) in [
            ("xy", "XY"),
            ("xy-fast", "XY"),
            ("xy-torque", "XY"),
            ("xyz-mill", "XYZ"),
        ] {
            let plant = PlantFile::load(&machines.join(folder)).unwrap();
            let names: String = plant.axes.iter().map(|a| a.name.as_str()).collect();
            assert_eq!(names, axes, "{folder}");
        }
    }

    #[test]
    fn the_reference_axes_have_the_masses_and_forces_they_are_documented_with() {
        let plant = PlantFile::parse("plant.toml", XY).unwrap();
        let x = plant.axis("X").unwrap();
        assert!(
            (x.motor_mass_kg() - 758.0).abs() < 0.5,
            "{}",
            x.motor_mass_kg()
        );
        let m = x.mechanics();
        let friction_n = m.motor_friction.coulomb_n + m.table_friction.coulomb_n;
        assert!((friction_n - 451.0).abs() < 1.0, "{friction_n} N");
        assert_eq!(plant.microstep_ns(), 25_000);
    }

    #[test]
    fn a_broken_value_is_named_with_file_line_axis_key_value_unit_and_rule() {
        let text = message("mass_kg = 150.0", "mass_kg = -150.0");
        let line = XY
            .lines()
            .position(|l| l.starts_with("mass_kg = 150"))
            .unwrap()
            + 1;
        assert_eq!(
            text,
            format!(
                "plant.toml:{line}: axis Y table.mass_kg = -150 kg: must be at least 0.1 and at most 100000 kg"
            )
        );
    }

    #[test]
    fn shares_that_do_not_sum_to_one_are_refused() {
        let text = message("[0.35, 0.30, 0.20, 0.15]", "[0.35, 0.30, 0.20, 0.20]");
        assert!(
            text.contains(
                "axis X motor.friction.element_share = [0.35, 0.3, 0.2, 0.2]: the sum must be 1"
            ),
            "{text}"
        );
    }

    #[test]
    fn numbers_that_are_not_finite_are_refused() {
        for bad in ["nan", "inf", "-inf"] {
            let text = message("gap_um = 5.0", &format!("gap_um = {bad}"));
            assert!(text.contains("axis X screw.gap_um"), "{text}");
        }
    }

    #[test]
    fn missing_and_misspelt_keys_are_refused_with_line_and_axis() {
        let text = message("mass_kg = 150.0", "");
        assert!(
            text.starts_with("plant.toml:") && text.contains("axis Y") && text.contains("mass_kg"),
            "{text}"
        );
        let text = message("gap_um = 5.0", "gap_mu = 5.0");
        assert!(text.contains("axis X") && text.contains("gap_mu"), "{text}");
    }

    #[test]
    fn an_axis_named_twice_is_refused() {
        let text = message("name = \"Y\"", "name = \"X\"");
        assert!(text.contains("axis X name"), "{text}");
    }

    #[test]
    fn static_friction_below_coulomb_friction_is_refused() {
        let text = message("static_n = 260.0", "static_n = 160.0");
        assert!(
            text.contains(
                "axis X table.friction.static_n = 160 N: must be at least coulomb_n = 200 N"
            ),
            "{text}"
        );
    }

    #[test]
    fn a_microstep_that_cannot_resolve_the_stiffness_is_refused() {
        let text = message("microstep_us = 25.0", "microstep_us = 250.0");
        assert!(text.contains("microstep_us = 250 µs"), "{text}");
        assert!(text.contains("axis X"), "{text}");
        let text = message("stiffness_n_per_m = 1.2e8", "stiffness_n_per_m = 9e9");
        assert!(
            text.contains("axis X") && text.contains("microstep_us"),
            "{text}"
        );
    }

    #[test]
    fn files_that_are_no_text_or_too_long_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("plant.toml");
        std::fs::write(&file, [b'a', 0xff, 0xfe]).unwrap();
        assert!(
            PlantFile::load(&file)
                .unwrap_err()
                .to_string()
                .contains("not UTF-8")
        );
        std::fs::write(&file, vec![b'#'; (1 << 20) + 1]).unwrap();
        assert!(
            PlantFile::load(&file)
                .unwrap_err()
                .to_string()
                .contains("longer than 1048576 bytes")
        );
        std::fs::write(&file, "").unwrap();
        assert!(PlantFile::load(folder.path()).is_err());
        std::fs::remove_file(&file).unwrap();
        assert!(PlantFile::load(folder.path()).is_err());
    }
}
