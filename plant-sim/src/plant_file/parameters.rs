//! What the simulation takes from the plant file, in its own units.

use machine::SECOND_MOTOR;

use crate::friction::FrictionParameters;
use crate::holding_brake::HoldingBrake;
use crate::lost_motion::LostMotion;
use crate::measurement::Measurement;
use crate::mechanics::{Beyond, MechanicsParameters};
use crate::plant_file::keys::{MotorFriction, PlantAxis, PlantFile, TableFriction};
use crate::sliding_curve::SlidingCurve;
use crate::swinging::Swinging;
use crate::variation::Variation;
use crate::winding::WindingSettings;

impl PlantFile {
    /// The axis of this name.
    pub fn axis(&self, name: &str) -> Option<&PlantAxis> {
        self.axes.iter().find(|axis| axis.name == name)
    }

    /// The axis whose table a bridge joins to this one's.
    pub fn bridged(&self, axis: &PlantAxis) -> Option<&PlantAxis> {
        axis.bridge?;
        self.axis(axis.name.strip_suffix(SECOND_MOTOR)?)
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
    pub fn mechanics(&self, microstep_s: f64) -> MechanicsParameters {
        let radius_m = self.radius_m();
        let (m1, m2) = (self.motor_mass_kg(), self.table.mass_kg);
        let reduced_mass_kg = m1 * m2 / (m1 + m2);
        let motor = &self.motor.friction;
        let table = &self.table.friction;
        let motor_n = motor.coulomb_torque_nm / radius_m;
        let motor_part = motor_n / (motor_n + table.coulomb_n);
        let curve = self.sliding_curve();
        let measured = |contact: FrictionParameters, part: f64| match curve {
            Some(curve) => as_measured(contact, curve.scaled(part)),
            None => contact,
        };
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
            motor_friction: measured(motor_friction(motor, radius_m), motor_part),
            table_friction: measured(table_friction(table), 1.0 - motor_part),
            beyond: self.beyond(microstep_s),
        }
    }

    /// Friction as measured; none where the file says nothing of it, or no curve can be made of what it says.
    fn sliding_curve(&self) -> Option<SlidingCurve> {
        let measured = self.measured_friction.as_ref()?;
        let rows = measured.speed_mm_s.iter().zip(&measured.force_n);
        SlidingCurve::new(rows.map(|(speed_mm_s, force_n)| (speed_mm_s * 1e-3, *force_n)))
    }

    /// What the machine has beside that; none where the file says nothing of it.
    fn beyond(&self, microstep_s: f64) -> Option<Beyond> {
        let slips = self.screw.hysteresis_n.iter().any(|force_n| *force_n > 0.0);
        let says = self.variation.is_some()
            || self.attached_mass.is_some()
            || self.cutting.is_some()
            || self.frame.is_some()
            || self.gravity.is_some()
            || self.brake.is_some()
            || self
                .cross_talk
                .iter()
                .any(|talk| talk.friction_share_per_m != 0.0)
            || slips;
        says.then(|| Beyond {
            variation: Variation {
                of: self.variation,
                lead_m: self.screw.lead_mm * 1e-3,
            },
            lost_motion: LostMotion::new(
                self.screw.hysteresis_n,
                self.screw.hysteresis_um.map(|um| um * 1e-6),
                microstep_s,
            ),
            attached: self.attached_mass.map(|of| {
                Swinging::new(of.mass_kg, of.frequency_hz, of.damping_ratio, microstep_s)
            }),
            cutting: self.cutting,
            weight_n: self.gravity.map_or(0.0, |of| of.force_n),
            brake: self.holding_brake(microstep_s),
            frame: self.frame.map(|of| {
                Swinging::new(of.mass_kg, of.frequency_hz, of.damping_ratio, microstep_s)
            }),
        })
    }

    /// The brake of its motor; none where it has none.
    pub fn holding_brake(&self, microstep_s: f64) -> Option<HoldingBrake> {
        let of = self.brake.as_ref()?;
        let mass_kg = self.motor_mass_kg();
        Some(HoldingBrake::new(of, self.radius_m(), mass_kg, microstep_s))
    }

    /// What the drive measures wrongly; none where nothing.
    pub fn measurement(&self, scan_s: f64) -> Option<Measurement> {
        let lead_m = self.screw.lead_mm * 1e-3;
        let percent_nm = 1e-2 * self.motor.rated_torque_nm;
        self.measurement.map(|of| Measurement {
            period_error_m: of.period_error_nm * 1e-9,
            periods_per_m: f64::from(of.periods_per_turn) / lead_m,
            encoder_noise_m: of.encoder_noise_nm * 1e-9,
            torque_delay_scans: libm::round(of.torque_delay_ms * 1e-3 / scan_s) as usize,
            torque_step_nm: of.torque_step_percent * percent_nm,
            torque_noise_nm: of.torque_noise_percent * percent_nm,
            seed: of.seed,
            slip_m: of.slip_um * 1e-6,
            slip_at_s: of.slip_at_s,
            scan_s,
        })
    }

    /// The winding.
    pub fn winding(&self, scan_s: f64) -> WindingSettings {
        let motor = &self.motor;
        let (rated_nm, rise_k) = (motor.rated_torque_nm, motor.winding_rise_at_rated_k);
        let time_constant_s = motor.winding_time_constant_min * 60.0;
        WindingSettings::new(rated_nm, rise_k, time_constant_s, scan_s)
    }
}

/// Bearings, nut and seals, as forces of travel.
fn motor_friction(of: &MotorFriction, radius_m: f64) -> FrictionParameters {
    FrictionParameters {
        law: of.law,
        coulomb_n: of.coulomb_torque_nm / radius_m,
        static_n: of.static_torque_nm / radius_m,
        viscous_n_s_per_m: of.viscous_nm_s_per_rad / (radius_m * radius_m),
        stribeck_velocity_m_s: of.stribeck_velocity_mm_s * 1e-3,
        share: of.element_share,
        break_distance_m: of.break_distance_um.map(|um| um * 1e-6),
        presliding_damping_n_s_per_m: of.presliding_damping_n_s_per_m,
        attraction_s: of.attraction_ms * 1e-3,
        measured: None,
    }
}

/// Guideways.
fn table_friction(of: &TableFriction) -> FrictionParameters {
    FrictionParameters {
        law: of.law,
        coulomb_n: of.coulomb_n,
        static_n: of.static_n,
        viscous_n_s_per_m: of.viscous_n_s_per_m,
        stribeck_velocity_m_s: of.stribeck_velocity_mm_s * 1e-3,
        share: of.element_share,
        break_distance_m: of.break_distance_um.map(|um| um * 1e-6),
        presliding_damping_n_s_per_m: of.presliding_damping_n_s_per_m,
        attraction_s: of.attraction_ms * 1e-3,
        measured: None,
    }
}

/// The contact with its sliding friction as measured; its elements break at their distances with what is measured at the lowest speeds.
fn as_measured(contact: FrictionParameters, curve: SlidingCurve) -> FrictionParameters {
    FrictionParameters {
        coulomb_n: curve.slow_n(),
        static_n: curve.slow_n(),
        viscous_n_s_per_m: 0.0,
        measured: Some(curve),
        ..contact
    }
}
