//! What the report says of each axis. Of a rotary axis angles stand where a slide has lengths, under keys that say so.

use std::collections::BTreeMap;

use machine::{Axis, AxisKind, DriveMode};
use serde::ser::{Serialize, SerializeMap, Serializer};

use super::evaluation::Evaluation;
use super::rounded::r3;
use crate::measure::axis::blocks::BlockPeaks;
use crate::measure::axis::{AMBIENT_C, AxisMeter};
use crate::measure::prediction::PredictionMeter;

/// Peak, root mean square and percentiles of the magnitude.
///
/// A percentile is too high by at most 0.8 %, never too low: see [`crate::measure::axis::percentiles`].
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct PeakRmsPercentiles {
    /// Largest absolute value.
    pub peak: f64,
    /// Root mean square.
    pub rms: f64,
    /// Half of the scans do not exceed it.
    pub p50: f64,
    /// 95 % do not.
    pub p95: f64,
    /// 99 % do not.
    pub p99: f64,
}

/// One axis.
#[derive(Debug, Clone, serde::Serialize)]
pub struct AxisReport {
    /// Its letter.
    pub axis: String,
    /// `velocity` or `torque`.
    pub drive_mode: &'static str,
    /// Command minus feedback, compensation not counted, while the drives were on, of a slide in µm.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub following_error_um: Option<PeakRmsPercentiles>,
    /// The same of a rotary axis, in thousandths of a degree.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub following_error_mdeg: Option<PeakRmsPercentiles>,
    /// Scans without a command in time.
    pub missed_scans: u32,
    /// Motor torque, root mean square, while the drives were on.
    pub torque_rms_nm: f64,
    /// Highest motor torque.
    pub torque_peak_nm: f64,
    /// Torque rms in percent of the continuous torque.
    pub torque_rms_percent: f64,
    /// Scans in which the axis's model asked for more torque than is fed forward.
    pub torque_cut_scans: u64,
    /// What was cut off at most.
    pub torque_cut_nm_peak: f64,
    /// Friction that the servo went by at the end, in percent of the tuned one; none without a model.
    pub friction_level_percent: Option<f64>,
    /// What a way between two reversals left unexplained in the mean, in percent of Coulomb friction; none where nothing is followed.
    pub friction_unexplained_percent: Option<f64>,
    /// Highest winding temperature in °C, at an assumed room temperature of `ambient_c`.
    pub winding_c_peak: f64,
    /// Room temperature assumed, in °C: the machine reports the rise only.
    pub ambient_c: f64,
    /// What the prediction of the feedback does; null where it is off.
    pub prediction: Option<PredictionReport>,
    /// Of the second motor of a gantry; left out of all others.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gantry: Option<GantryReport>,
    /// Of an axis that weight pulls; left out of all others.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub weight: Option<WeightReport>,
    /// Largest magnitudes of the numbers that are shown as the feedback has them, by key and `_peak`.
    #[serde(flatten)]
    pub quantities: BTreeMap<String, f64>,
}

/// How far an axis dropped while its drive was off or the machine had tripped, from where it had been brought to rest or lost its power.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct WeightReport {
    /// Largest drop of the table.
    pub drop_um_peak: f64,
    /// What the closing time of the brake allows, where it has one and its mass is known.
    pub closing_allows_um: Option<f64>,
}

/// The skew of a gantry: position of its second motor less that of its first, while the drives were on.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct GantryReport {
    /// The axis whose second motor it is.
    pub leader: String,
    /// Largest magnitude.
    pub skew_um_peak: f64,
    /// Root mean square.
    pub skew_um_rms: f64,
    /// The limit of the machine file.
    pub skew_um_max: f64,
}

/// Prediction of the feedback position of one axis (docs/methods/prediction.md), all rms while the drives were on. Of a rotary
/// axis in thousandths of a degree and degrees/s, where a slide has µm and mm/s.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PredictionReport {
    /// Slide or rotary axis.
    pub kind: AxisKind,
    /// Divisor of the first difference.
    pub m: f64,
    /// Delay that is made up for, in ms.
    pub horizon_ms: f64,
    /// Error of the sample as it is, after that delay.
    pub unpredicted_error_um: f64,
    /// Error of the prediction.
    pub predicted_error_um: f64,
    /// Noise that the prediction adds to the position.
    pub added_noise_um: f64,
    /// The same at the velocity command.
    pub added_noise_mm_s: f64,
}

impl Serialize for PredictionReport {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let (deviation, speed) = match self.kind {
            AxisKind::Linear => ("um", "mm_s"),
            AxisKind::Rotary => ("mdeg", "deg_s"),
        };
        let mut map = serializer.serialize_map(Some(6))?;
        map.serialize_entry("m", &self.m)?;
        map.serialize_entry("horizon_ms", &self.horizon_ms)?;
        for (key, value) in [
            ("unpredicted_error", self.unpredicted_error_um),
            ("predicted_error", self.predicted_error_um),
            ("added_noise", self.added_noise_um),
        ] {
            map.serialize_entry(&format!("{key}_{deviation}"), &value)?;
        }
        map.serialize_entry(&format!("added_noise_{speed}"), &self.added_noise_mm_s)?;
        map.end()
    }
}

impl PredictionReport {
    fn of(meter: &PredictionMeter, kind: AxisKind, scan_period_s: f64) -> PredictionReport {
        // Noise of an encoder is a few nm: finer than other errors.
        let fine = |value: f64| libm::round(value * 1e6) / 1e6;
        PredictionReport {
            kind,
            m: meter.m(),
            horizon_ms: r3(scan_period_s * 1e3 / meter.m()),
            unpredicted_error_um: r3(meter.unpredicted_um.rms()),
            predicted_error_um: r3(meter.predicted_um.rms()),
            added_noise_um: fine(meter.added_noise_um()),
            added_noise_mm_s: fine(meter.added_noise_mm_s()),
        }
    }

    /// What it does for this axis, in words.
    pub(super) fn words(&self, axis: &str) -> String {
        let deviation = self.kind.deviation_unit();
        format!(
            "{axis} feedback {:.2} ms ahead (m = {}): error {:.2} instead of {:.2} {deviation} rms, noise added {:.4} {deviation} = {:.4} {}/s",
            self.horizon_ms,
            self.m,
            self.predicted_error_um,
            self.unpredicted_error_um,
            self.added_noise_um,
            self.added_noise_mm_s,
            self.kind.unit()
        )
    }
}

impl AxisReport {
    /// Of one axis that was measured.
    fn of(axis: &Axis, meter: &AxisMeter, scan_period_s: f64) -> AxisReport {
        let following_error = following_error(meter);
        let of_kind = |kind| (axis.kind == kind).then_some(following_error);
        let prediction = meter.prediction.as_ref();
        let quantities = meter.quantities.by_key(r3);
        let rise_k = quantities.get("winding_k_peak").copied();
        AxisReport {
            axis: axis.name.clone(),
            drive_mode: match axis.drive_mode {
                DriveMode::Velocity => "velocity",
                DriveMode::Torque => "torque",
                DriveMode::Position => "position",
            },
            following_error_um: of_kind(AxisKind::Linear),
            following_error_mdeg: of_kind(AxisKind::Rotary),
            missed_scans: meter.missed_scans,
            torque_rms_nm: r3(meter.torque_nm.rms()),
            torque_peak_nm: r3(meter.torque_nm.peak),
            torque_rms_percent: r3(meter.torque_nm.rms() / axis.motor.rated_torque_nm * 100.0),
            torque_cut_scans: meter.torque_cut_scans,
            torque_cut_nm_peak: r3(meter.torque_cut_nm_peak),
            friction_level_percent: meter.friction.level.map(|part| r3(100.0 * part)),
            friction_unexplained_percent: meter.friction.unexplained_percent().map(r3),
            winding_c_peak: r3(AMBIENT_C + rise_k.unwrap_or(0.0)),
            ambient_c: AMBIENT_C,
            prediction: prediction.map(|p| PredictionReport::of(p, axis.kind, scan_period_s)),
            gantry: axis.gantry.as_ref().map(|gantry| GantryReport {
                leader: gantry.leader.clone(),
                skew_um_peak: r3(meter.skew_mm.peak * 1e3),
                skew_um_rms: r3(meter.skew_mm.rms() * 1e3),
                skew_um_max: r3(gantry.skew_max_mm * 1e3),
            }),
            weight: meter.drop.map(|of| WeightReport {
                drop_um_peak: r3(of.most_mm * 1e3),
                closing_allows_um: of.allowed_mm.map(|mm| r3(mm * 1e3)),
            }),
            quantities,
        }
    }

    /// Whether it is a rotary axis.
    pub(super) fn is_rotary(&self) -> bool {
        self.following_error_mdeg.is_some()
    }

    /// Unit of its deviations.
    pub(super) fn deviation_unit(&self) -> &'static str {
        match self.is_rotary() {
            true => AxisKind::Rotary.deviation_unit(),
            false => AxisKind::Linear.deviation_unit(),
        }
    }
}

/// The axes, in order.
pub(super) fn axes(evaluation: &Evaluation) -> Vec<AxisReport> {
    let measurements = &evaluation.measurements;
    let measured = measurements.axes.iter().zip(&evaluation.machine.axes);
    measured
        .map(|(meter, axis)| AxisReport::of(axis, meter, measurements.scan_period_s))
        .collect()
}

fn following_error(meter: &AxisMeter) -> PeakRmsPercentiles {
    let percentile = |percent| r3(meter.following_error_um_percentiles.at(percent));
    PeakRmsPercentiles {
        peak: r3(meter.following_error_mm.peak * 1e3),
        rms: r3(meter.following_error_mm.rms() * 1e3),
        p50: percentile(50.0),
        p95: percentile(95.0),
        p99: percentile(99.0),
    }
}

/// One block: a line of the program, all passes through it together.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct BlockReport {
    /// Line of the program.
    pub block: u32,
    /// Scans that the command stood in it, holds included.
    pub scans: u64,
    /// Largest distance of the table from the programmed path.
    pub contour_error_um_peak: f64,
    /// Largest following error, by axis: slides.
    pub following_error_um_peak: BTreeMap<String, f64>,
    /// The same of rotary axes, in thousandths of a degree; left out where there is none.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub following_error_mdeg_peak: BTreeMap<String, f64>,
}

impl BlockReport {
    /// Of a line that was travelled.
    pub(super) fn of(line: u32, peaks: &BlockPeaks, axes: &[Axis]) -> BlockReport {
        let of_kind = |kind| {
            let all = axes.iter().zip(peaks.following_error_mm);
            let all = all.filter(|(axis, _)| axis.kind == kind);
            all.map(|(axis, mm)| (axis.name.clone(), r3(mm * 1e3)))
                .collect()
        };
        BlockReport {
            block: line,
            scans: peaks.scans,
            contour_error_um_peak: r3(peaks.contour_error_mm * 1e3),
            following_error_um_peak: of_kind(AxisKind::Linear),
            following_error_mdeg_peak: of_kind(AxisKind::Rotary),
        }
    }

    /// Largest following error of an axis, in its unit.
    pub(super) fn following_error_peak(&self, axis: &str) -> Option<f64> {
        let slide = self.following_error_um_peak.get(axis);
        let rotary = self.following_error_mdeg_peak.get(axis);
        slide.or(rotary).copied()
    }
}
