//! From recordings to the model of an axis: linear least squares, a search over three shape parameters around it.
//! Method, equations and bounds: docs/methods/tuning.md.

pub mod dead_time;
pub mod delay;
mod equations;
mod noise;
mod screw;
mod shape;
pub mod signals;
#[cfg(test)]
mod tests;
mod wind_up;

pub use loops::maxwell_slip::ELEMENTS;

use crate::least_squares::{Fit, NormalEquations};
use crate::recording::Recording;
use equations::{BEFORE, Carried, MotorEquation, TABLE_BOUND, table_rows};
use screw::Screw;
use signals::{SMOOTHING_S, Shape, Signals, share_travel};

/// Break distances of the slip elements, in µm: fixed, so that the shares are linear unknowns.
pub const BREAK_UM: [f64; ELEMENTS] = [0.5, 1.5, 4.0, 10.0, 25.0, 60.0];

/// Part of Coulomb friction above which a constant force is more than the table's own friction, so that the gap is not crossed where an
/// axis reverses slowly.
const HANGS_PART: f64 = 0.5;

/// How torque becomes force at the table, and how signals are smoothed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lever {
    /// Force at the table by torque, in N per N·m; 1 where the force itself was recorded.
    pub newtons_per_nm: f64,
    /// Travel in a turn of the motor, in mm; without it nothing can be said of what repeats with each turn.
    pub lead_mm: Option<f64>,
    /// Length of each of the two running means, in s.
    pub smoothing_s: f64,
}

impl Lever {
    /// Of a screw.
    pub fn of_lead(lead_mm: f64) -> Lever {
        Lever {
            newtons_per_nm: crate::newtons_per_nm(lead_mm),
            lead_mm: Some(lead_mm),
            smoothing_s: SMOOTHING_S,
        }
    }
}

/// A curve of friction: Coulomb friction by element, and what speed does to it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Friction {
    /// Coulomb friction of each element, in N.
    pub element_n: [f64; ELEMENTS],
    /// Break-away over Coulomb friction.
    pub static_ratio: f64,
    /// Stribeck velocity, in mm/s.
    pub stribeck_mm_s: f64,
    /// Viscous friction, in N·s/m.
    pub viscous_n_s_per_m: f64,
}

impl Friction {
    /// Coulomb friction, in N.
    pub fn coulomb_n(&self) -> f64 {
        self.element_n.iter().sum()
    }
}

/// What is not the same everywhere and both ways. The model of a machine file has none of it.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Structure {
    /// Constant force, in N: weight, or half the difference of Coulomb friction forward and back.
    pub constant_n: f64,
    /// Half the difference of viscous friction forward and back, in N·s/m.
    pub viscous_n_s_per_m: f64,
    /// Amplitude of Coulomb friction over a turn of the motor: sine and cosine, in N.
    pub turn_n: [f64; 2],
    /// Coulomb friction over half the travel of the recordings: rise, and curvature, in N.
    pub travel_n: [f64; 2],
}

impl Structure {
    /// From the coefficients of a constant, of |v|, and of [`Signals::by_place`].
    fn of(constant_n: f64, viscous_n_s_per_m: f64, place: &[f64]) -> Structure {
        let at = |i: usize| place.get(i).copied().unwrap_or_default();
        Structure {
            constant_n,
            viscous_n_s_per_m,
            turn_n: [at(0), at(1)],
            travel_n: [at(2), at(3)],
        }
    }

    /// Of two bodies together.
    pub fn and(&self, other: &Structure) -> Structure {
        let sum = |a: [f64; 2], b: [f64; 2]| [a[0] + b[0], a[1] + b[1]];
        Structure {
            constant_n: self.constant_n + other.constant_n,
            viscous_n_s_per_m: self.viscous_n_s_per_m + other.viscous_n_s_per_m,
            turn_n: sum(self.turn_n, other.turn_n),
            travel_n: sum(self.travel_n, other.travel_n),
        }
    }

    /// By how much friction changes with the turn of the motor, in N to either side.
    pub fn by_turn_n(&self) -> f64 {
        self.turn_n[0].hypot(self.turn_n[1])
    }

    /// By how much friction changes over the travel of the recordings, in N to either side at most.
    pub fn by_travel_n(&self) -> f64 {
        self.travel_n[0].abs() + self.travel_n[1].abs() * (2.0 / 3.0)
    }
}

/// The table, where a scale shows it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Table {
    /// Mass, in kg.
    pub mass_kg: f64,
    /// Friction.
    pub friction: Friction,
    /// What is not the same everywhere and both ways.
    pub structure: Structure,
    /// Stiffness, in N/µm.
    pub stiffness_n_per_um: f64,
    /// Gap, in µm.
    pub gap_um: f64,
    /// What the fit of its equation leaves, in N.
    pub residual_n: f64,
    /// What of it is noise of the encoders, in N.
    pub noise_n: f64,
}

/// How much of the force a fit explains, over all of a recording.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ForceError {
    /// Norm of what is left over the norm of the force.
    pub relative: f64,
    /// The same with Coulomb and viscous friction, each by direction, in place of friction over distance.
    pub relative_by_direction: f64,
    /// The same with one Coulomb and one viscous friction and a constant force.
    pub relative_simple: f64,
    /// What is left within 0.3 mm after reversals, root mean square, in N.
    pub reversal_n: f64,
    /// The same with Coulomb and viscous friction by direction.
    pub reversal_by_direction_n: f64,
}

/// What was found of an axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Found {
    /// Mass that the motor feels besides the table, in kg at the table; all of it where there is no table.
    pub motor_mass_kg: f64,
    /// Friction of the same.
    pub motor: Friction,
    /// What is not the same everywhere and both ways.
    pub structure: Structure,
    /// The table.
    pub table: Option<Table>,
    /// Why there is no table although there is a scale.
    pub no_table: Option<&'static str>,
    /// Cogging: amplitude in N·m and periods per motor turn.
    pub cogging_nm: f64,
    /// Periods per motor turn.
    pub cogging_per_turn: u32,
    /// Time by which the torque is shown late, in s.
    pub torque_late_s: f64,
    /// What the fit of the torque leaves, in N at the table.
    pub residual_n: f64,
    /// What of it is noise of encoder and torque, in N.
    pub noise_n: f64,
    /// Norm of what the fit of the torque leaves over the norm of the torque.
    pub unexplained: f64,
    coefficients: [f64; equations::COLUMNS],
    shape: Shape,
}

impl Found {
    /// Mass in all, in kg.
    pub fn mass_kg(&self) -> f64 {
        self.motor_mass_kg + self.table.map_or(0.0, |t| t.mass_kg)
    }

    /// Coulomb friction in all, in N.
    pub fn coulomb_n(&self) -> f64 {
        self.motor.coulomb_n() + self.table.map_or(0.0, |t| t.friction.coulomb_n())
    }

    /// Viscous friction in all, in N·s/m.
    pub fn viscous_n_s_per_m(&self) -> f64 {
        self.motor.viscous_n_s_per_m + self.table.map_or(0.0, |t| t.friction.viscous_n_s_per_m)
    }

    /// Lost motion: gap and wind-up by friction both ways, in µm.
    pub fn lost_motion_um(&self) -> f64 {
        self.table.map_or(0.0, |t| {
            t.gap_um + 2.0 * t.friction.coulomb_n() / t.stiffness_n_per_um
        })
    }

    /// What is not the same everywhere and both ways, of motor and table.
    pub fn whole_structure(&self) -> Structure {
        let table = self.table.map(|t| t.structure).unwrap_or_default();
        self.structure.and(&table)
    }

    /// Why a table that hangs shows neither gap nor wind-up: slow motions never lift it off.
    fn hangs(&self) -> Option<&'static str> {
        let hangs = self.whole_structure().constant_n.abs() > HANGS_PART * self.coulomb_n();
        hangs.then_some("a weight holds the table against one side of the gap")
    }

    /// What is left unexplained beyond noise, in N.
    pub fn beyond_noise_n(&self) -> f64 {
        (self.residual_n.powi(2) - self.noise_n.powi(2))
            .max(0.0)
            .sqrt()
    }
}

/// The mass that torque and acceleration tell, in kg: `T/p = M·a + F·sgn(v) + B·v`.
pub fn mass_kg(recording: &Recording, lever: &Lever) -> f64 {
    let late = delay::scans(std::slice::from_ref(recording), lever);
    let signals = Signals::new(&recording.with_torque_late(late), lever);
    let mut equations = NormalEquations::new(4);
    for i in signals.equations() {
        let speed_m_s = signals.motor_m_s[i];
        // Near standstill friction is no step but follows the distance: such samples would bend the mass.
        if speed_m_s.abs() > 1e-3 {
            let row = [signals.motor_m_s2[i], speed_m_s.signum(), speed_m_s, 1.0];
            equations.add(&row, signals.force_n[i], 1.0);
        }
    }
    equations.solve(3).coefficients[0]
}

/// Models of one axis from its recordings, the one to prefer first; another where the screw can be taken in another way. `steady` is the recording
/// at constant speeds, among the others.
pub fn models(recordings: &[Recording], steady: &Recording, lever: &Lever) -> Vec<Found> {
    // Torque that is shown late mixes inertia with friction: it is brought into step before anything is fitted.
    let late = if recordings.is_empty() {
        delay::scans(std::slice::from_ref(steady), lever)
    } else {
        delay::scans(recordings, lever)
    };
    let mut all: Vec<Recording> = recordings
        .iter()
        .chain([steady])
        .map(|recording| recording.with_torque_late(late))
        .collect();
    let torque_late_s = late as f64 * steady.scan_s;
    let found = aligned(&all, lever);
    let why = found
        .first()
        .and_then(|first| no_table(first.table.as_ref()?).or(first.hangs()));
    let (mut found, no_table) = if why.is_some() {
        // A scale that shows no table is left alone.
        for recording in &mut all {
            recording.scale_mm.clone_from(&recording.motor_mm);
        }
        (aligned(&all, lever), why)
    } else {
        let tells = |found: &Found| found.table.as_ref().is_none_or(|t| no_table(t).is_none());
        (found.into_iter().filter(tells).collect(), None)
    };
    for found in &mut found {
        found.torque_late_s = torque_late_s;
        found.no_table = no_table;
    }
    found
}

/// Why what a scale shows is no table.
fn no_table(table: &Table) -> Option<&'static str> {
    if !(table.stiffness_n_per_um > 0.0 && table.stiffness_n_per_um.is_finite()) {
        return Some("wind-up does not follow force");
    }
    if !(table.mass_kg > 0.0 && table.friction.coulomb_n() > 0.0) {
        return Some("wind-up follows neither acceleration nor friction");
    }
    None
}

/// The models from recordings whose torque is in step; the last one is that at constant speeds.
fn aligned(recordings: &[Recording], lever: &Lever) -> Vec<Found> {
    let mut all: Vec<Signals> = recordings
        .iter()
        .map(|recording| Signals::new(recording, lever))
        .collect();
    share_travel(&mut all);
    // Inertia is absent at constant speeds: the curve of friction over speed and the cogging show there alone, so their shape comes
    // first; the fits after it are linear.
    let Some(calm) = all.last() else {
        return Vec::new();
    };
    let cogging_per_turn = shape::cogging_period(calm, lever.lead_mm);
    let shape = shape::stribeck(calm, cogging_per_turn, lever.lead_mm);
    let slips: Vec<Vec<Vec<f64>>> = all
        .iter()
        .map(|signals| signals.slips(&signals.motor_mm, &signals.motor_m_s, &shape))
        .collect();
    let equation = MotorEquation {
        all: &all,
        slips: &slips,
        carried: None,
        shape: &shape,
        cogging_per_turn,
        lever,
    };
    let noise_n = |fit: &Fit| noise::of_motor_n(recordings, lever, fit.coefficients[0]);
    if !recordings.iter().any(Recording::has_scale) {
        let fit = equation.fit();
        return vec![found(&equation, &fit, shape, noise_n(&fit), None)];
    }
    let rows: Vec<_> = all
        .iter()
        .map(|signals| table_rows(signals, &shape, lever))
        .collect();
    let fit = |carried: &[Carried]| {
        let equation = MotorEquation {
            carried: Some(carried),
            ..equation
        };
        equation.fit()
    };
    // Gap and stiffness follow from the torque where that is read well, and from the wind-up where the scale is: both are given.
    let screws = [
        Some(screw::by_torque(fit, &all, &rows)),
        screw::by_wind_up(fit, &all, &rows),
    ];
    let of_screw = |screw: Screw| {
        let stiffness = screw.motor.coefficients[2];
        let noise_of_table_n = noise::of_table_n(recordings, lever, stiffness);
        let table = table(
            &screw.table,
            stiffness,
            screw.gap_um,
            &shape,
            noise_of_table_n,
        );
        let equation = MotorEquation {
            carried: Some(&screw.carried),
            ..equation
        };
        let noise_n = noise_n(&screw.motor);
        found(&equation, &screw.motor, shape, noise_n, Some(table))
    };
    screws.into_iter().flatten().map(of_screw).collect()
}

fn elements(coefficients: &[f64]) -> [f64; ELEMENTS] {
    let mut element_n = [0.0; ELEMENTS];
    element_n.copy_from_slice(&coefficients[..ELEMENTS]);
    element_n
}

/// What the fit of the motor equation says.
fn found(
    equation: &MotorEquation,
    fit: &Fit,
    shape: Shape,
    noise_n: f64,
    table: Option<Table>,
) -> Found {
    let c = &fit.coefficients;
    let behind = &c[BEFORE + ELEMENTS..];
    let (mut left, mut whole) = (0.0, 0.0);
    equation.rows(|signals, i, row| {
        let force_n = signals.force_n[i];
        let fitted_n: f64 = row.iter().zip(c).map(|(a, b)| a * b).sum();
        left += signals.weight[i] * (force_n - fitted_n).powi(2);
        whole += signals.weight[i] * force_n.powi(2);
    });
    let mut coefficients = [0.0; equations::COLUMNS];
    coefficients.copy_from_slice(c);
    Found {
        motor_mass_kg: c[0],
        motor: Friction {
            element_n: elements(&c[BEFORE..]),
            static_ratio: shape.static_ratio,
            stribeck_mm_s: shape.stribeck_mm_s,
            viscous_n_s_per_m: c[1],
        },
        structure: Structure::of(behind[0], behind[1], &behind[4..8]),
        table,
        no_table: None,
        cogging_nm: behind[2].hypot(behind[3]) / equation.lever.newtons_per_nm,
        cogging_per_turn: equation.cogging_per_turn,
        torque_late_s: 0.0,
        residual_n: fit.residual,
        noise_n,
        unexplained: if whole > 0.0 {
            (left / whole).sqrt()
        } else {
            f64::NAN
        },
        coefficients,
        shape,
    }
}

/// What the fit of the table equation says.
fn table(fit: &Fit, stiffness_n_per_um: f64, gap_um: f64, shape: &Shape, noise_n: f64) -> Table {
    let c = &fit.coefficients;
    let behind = &c[TABLE_BOUND..];
    Table {
        mass_kg: c[0],
        friction: Friction {
            element_n: elements(&c[2..]),
            static_ratio: shape.static_ratio,
            stribeck_mm_s: shape.stribeck_mm_s,
            viscous_n_s_per_m: c[1],
        },
        structure: Structure::of(behind[0], behind[1], &behind[2..6]),
        stiffness_n_per_um,
        gap_um,
        residual_n: fit.residual,
        noise_n,
    }
}

/// How much of the force of a recording the model explains; the simpler models to compare it with are fitted to `taught`.
pub fn force_error(
    found: &Found,
    taught: &Recording,
    seen: &Recording,
    lever: &Lever,
) -> ForceError {
    let late = (found.torque_late_s / seen.scan_s).round() as usize;
    let taught = Signals::new(&taught.with_torque_late(late), lever);
    let mut seen = Signals::new(&seen.with_torque_late(late), lever);
    seen.travel_mm = taught.travel_mm;
    let slips = vec![seen.slips(&seen.motor_mm, &seen.motor_m_s, &found.shape)];
    let all = [seen];
    let equation = MotorEquation {
        all: &all,
        slips: &slips,
        carried: None,
        shape: &found.shape,
        cogging_per_turn: found.cogging_per_turn,
        lever,
    };
    let simple = |by_direction: bool| simple_fit(&taught, by_direction);
    let (one, two) = (simple(false), simple(true));
    let mut sums = [0.0; 4];
    let mut near = [0.0; 3];
    equation.rows(|signals, i, row| {
        let force_n = signals.force_n[i];
        let of = |row: &[f64], c: &[f64]| -> f64 { row.iter().zip(c).map(|(a, b)| a * b).sum() };
        let simple_row = simple_row(signals, i);
        let left = [
            force_n - of(row, &found.coefficients),
            force_n - of(&simple_row, &two),
            force_n - of(&simple_row, &one),
            force_n,
        ];
        for (sum, left) in sums.iter_mut().zip(left) {
            *sum += left * left;
        }
        // Samples close behind a reversal have full weight, all others less.
        if signals.weight[i] >= 1.0 {
            near[0] += left[0] * left[0];
            near[1] += left[1] * left[1];
            near[2] += 1.0;
        }
    });
    let part = |index: usize| (sums[index] / sums[3].max(f64::MIN_POSITIVE)).sqrt();
    let rms = |index: usize| (near[index] / near[2].max(1.0)).sqrt();
    ForceError {
        relative: part(0),
        relative_by_direction: part(1),
        relative_simple: part(2),
        reversal_n: rms(0),
        reversal_by_direction_n: rms(1),
    }
}

/// Acceleration, speed, direction, a constant, the amount of the speed.
fn simple_row(signals: &Signals, i: usize) -> [f64; 5] {
    let v = signals.motor_m_s[i];
    [signals.motor_m_s2[i], v, signals.direction[i], 1.0, v.abs()]
}

/// Coefficients of mass, viscous friction, Coulomb friction, constant force, and by direction what viscous friction differs by.
fn simple_fit(signals: &Signals, by_direction: bool) -> Vec<f64> {
    let mut equations = NormalEquations::new(5);
    for i in signals.equations() {
        let mut row = simple_row(signals, i);
        if !by_direction {
            row[4] = 0.0;
        }
        equations.add(&row, signals.force_n[i], 1.0);
    }
    equations.solve(3).coefficients
}
