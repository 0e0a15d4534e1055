//! What the report says of where errors come from: the ball-bar test of circles, and the parts of the contour error.

use machine::AxisKind;
use serde::Serialize;

use super::evaluation::Evaluation;
use super::rounded::{MaxMin, max_min, r3};
use crate::measure::ball_bar::{BallBar, CauseKind, OneWay, Part};
use crate::measure::contour_parts::ContourCause;

/// A circle that was travelled both ways, or one way, in the terms of ISO 230-4.
#[derive(Debug, Clone, Serialize)]
pub struct BallBarReport {
    /// Axes of its plane.
    pub plane: String,
    /// Programmed centre in machine coordinates.
    pub centre_mm: [f64; 2],
    /// Programmed radius.
    pub radius_mm: f64,
    /// Programmed feed; null at rapid.
    pub feed_mm_min: Option<f64>,
    /// Counter-clockwise; null where it was not travelled so.
    pub counter_clockwise: Option<OneWayReport>,
    /// Clockwise; null where it was not travelled so.
    pub clockwise: Option<OneWayReport>,
    /// Common centre minus programmed centre: the mean of the least-squares centres of both directions.
    pub centre_offset_um: [f64; 2],
    /// Highest minus lowest deviation of both directions about that centre: G(b); null of one direction.
    pub bidirectional_deviation_um: Option<f64>,
    /// Largest distance between the mean curves of both directions at one angle: H.
    pub hysteresis_um: Option<f64>,
    /// Where that is, from the first axis of the plane towards the second.
    pub hysteresis_at_deg: Option<f64>,
    /// Root mean square of the deviation about the fitted centre; null where causes cannot be told.
    pub deviation_rms_um: Option<f64>,
    /// Root mean square of what no cause explains, vibration included.
    pub rest_rms_um: Option<f64>,
    /// The causes, the largest effect first; null where they cannot be told.
    pub causes: Option<Vec<CauseReport>>,
}

/// One direction of a circle, all its runs together.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct OneWayReport {
    /// Line of the program of its first run.
    pub block: u32,
    /// How many runs.
    pub runs: u32,
    /// Part of a turn that was measured.
    pub measured_deg: f64,
    /// Circular deviation G, the largest of the runs.
    pub circular_deviation_um: f64,
    /// Radial deviation F about the least-squares centre, over the runs.
    pub radial_deviation_um: MaxMin,
}

/// One cause of a circle's deviation.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CauseReport {
    /// What.
    pub cause: CauseKind,
    /// Of which axis; null where it is of both or none.
    pub axis: Option<String>,
    /// Direction of the axis behind the reversal; null where there is none.
    pub new_direction: Option<i32>,
    /// Its size, in `unit`.
    pub value: f64,
    /// Unit of the size.
    pub unit: &'static str,
    /// Travel after which a cyclic error repeats; left out of other causes.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pitch_mm: Option<f64>,
    /// From the lowest to the highest of what it does to the radius, the programmed circle included.
    pub effect_um: f64,
    /// Its effect among the sum of all effects.
    pub share_percent: f64,
}

impl CauseReport {
    /// In words.
    pub(super) fn words(&self, plane: &str) -> String {
        let axis = self.axis.as_deref().unwrap_or_default();
        let turned = match self.new_direction {
            Some(1) => "at its negative end",
            Some(_) => "at its positive end",
            None => "",
        };
        let mut letters = plane.chars();
        let (first, second) = (letters.next(), letters.next());
        let (first, second) = (first.unwrap_or('?'), second.unwrap_or('?'));
        match self.cause {
            CauseKind::LostMotion => format!("backlash of {axis} {turned}"),
            CauseKind::ReversalSpike => format!("reversal spike of {axis} {turned}"),
            CauseKind::Squareness => format!("squareness of {first} and {second}"),
            CauseKind::Scaling => format!("scaling mismatch, {first} longer than {second}"),
            CauseKind::ServoMismatch => format!("servo mismatch, {first} later than {second}"),
            CauseKind::SquarenessOrServoMismatch => {
                format!("squareness or servo mismatch of {first} and {second}")
            }
            CauseKind::Radius => "radius".into(),
            CauseKind::Cyclic => match self.pitch_mm {
                Some(pitch_mm) => format!("cyclic error of {axis}, every {pitch_mm} mm"),
                None => format!("cyclic error of {axis}"),
            },
            CauseKind::Vibration => "vibration".into(),
            CauseKind::Unexplained => "not explained".into(),
        }
    }
}

impl BallBarReport {
    /// Whether it was travelled in both directions.
    pub(super) fn is_both_ways(&self) -> bool {
        self.counter_clockwise.is_some() && self.clockwise.is_some()
    }
}

impl CauseReport {
    /// Its size with its unit.
    pub(super) fn size(&self) -> String {
        let decimals = if self.unit == "ms" { 3 } else { 2 };
        format!("{:.decimals$} {}", self.value, self.unit)
    }
}

/// Where the contour error comes from.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ContourPartsReport {
    /// Scans that were read, at the end of each.
    pub readings: u64,
    /// Root mean square of the contour error in them.
    pub rms_um: f64,
    /// The parts, the largest first.
    pub parts: Vec<ContourPartReport>,
}

/// One part of the contour error.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ContourPartReport {
    /// Where it comes from.
    pub cause: ContourCause,
    /// Of which axis; null where it is of all.
    pub axis: Option<String>,
    /// Root mean square over the run.
    pub rms_um: f64,
    /// Largest; null where it is known only for the whole run.
    pub peak_um: Option<f64>,
    /// Step between the directions of lost motion, + where the table stays behind; null for the others.
    pub step_um: Option<f64>,
    /// The same of a rotary axis, in thousandths of a degree; left out of all others.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub step_mdeg: Option<f64>,
    /// Its mean square among the sum of those of all parts.
    pub share_percent: f64,
}

impl ContourPartReport {
    /// Its step with its unit; a dash where it has none.
    pub(super) fn step(&self) -> String {
        match (self.step_um, self.step_mdeg) {
            (Some(um), _) => format!("{um:.2} µm"),
            (None, Some(mdeg)) => format!("{mdeg:.2} mdeg"),
            (None, None) => "–".into(),
        }
    }

    /// In words.
    pub(super) fn words(&self) -> String {
        let axis = self.axis.as_deref().unwrap_or_default();
        match self.cause {
            ContourCause::Command => "command beside the programmed path".into(),
            ContourCause::Reversal => format!("reversals of {axis} (friction)"),
            ContourCause::LostMotion => format!("lost motion of {axis}"),
            ContourCause::Following => "motor beside the command (dynamics)".into(),
            ContourCause::Rest => "rest (wind-up, load, unknown)".into(),
        }
    }
}

/// The circles that were travelled both ways, and those that were travelled one way.
pub(super) fn ball_bars(evaluation: &Evaluation) -> (Vec<BallBarReport>, Vec<BallBarReport>) {
    let measured = evaluation.measurements.ball_bars.iter();
    let all = measured.map(|one| ball_bar(one, evaluation));
    all.partition(BallBarReport::is_both_ways)
}

/// One circle.
pub(super) fn ball_bar(measured: &BallBar, evaluation: &Evaluation) -> BallBarReport {
    let circle = &measured.circle;
    let letters = circle.plane.map(|axis| evaluation.coordinate(axis));
    let cause = |part: &Part| CauseReport {
        cause: part.cause.kind,
        axis: part.cause.axis.and_then(|axis| letters.get(axis).cloned()),
        new_direction: part.cause.new_direction,
        value: r3(part.value),
        unit: part.unit,
        pitch_mm: part.pitch_mm.map(r3),
        effect_um: r3(part.effect_um),
        share_percent: r3(part.share_percent),
    };
    let diagnosis = measured.diagnosis.as_ref();
    BallBarReport {
        plane: letters.concat(),
        centre_mm: circle.centre_mm.map(|mm| libm::round(mm * 1e6) / 1e6 + 0.0),
        radius_mm: libm::round(circle.radius_mm * 1e6) / 1e6,
        feed_mm_min: circle.feed_mm_s.map(|feed| r3(feed * 60.0)),
        counter_clockwise: measured.counter_clockwise.as_ref().map(one_way),
        clockwise: measured.clockwise.as_ref().map(one_way),
        centre_offset_um: measured.centre_um.map(r3),
        bidirectional_deviation_um: measured.bidirectional_um.map(r3),
        hysteresis_um: measured.hysteresis.map(|(um, _)| r3(um)),
        hysteresis_at_deg: measured.hysteresis.map(|(_, deg)| r3(deg)),
        deviation_rms_um: diagnosis.map(|found| r3(found.deviation_rms_um)),
        rest_rms_um: diagnosis.map(|found| r3(found.rest_rms_um)),
        causes: diagnosis.map(|found| found.parts.iter().map(cause).collect()),
    }
}

fn one_way(way: &OneWay) -> OneWayReport {
    OneWayReport {
        block: way.line,
        runs: way.runs,
        measured_deg: r3(way.measured_deg),
        circular_deviation_um: r3(way.circular_um),
        radial_deviation_um: max_min(way.radial_um),
    }
}

/// The parts of the contour error; none where nothing was read.
pub(super) fn contour_parts(evaluation: &Evaluation) -> Option<ContourPartsReport> {
    let measured = &evaluation.measurements.contour_parts;
    let name = |axis: usize| {
        let axis = evaluation.machine.axes.get(axis)?;
        Some(axis.name.clone())
    };
    let um = |mm: f64| r3(mm * 1e3);
    let is_rotary = |axis: Option<usize>| {
        let axis = axis.and_then(|axis| evaluation.machine.axes.get(axis));
        axis.is_some_and(|axis| axis.kind == AxisKind::Rotary)
    };
    let parts = measured.parts.iter().map(|part| ContourPartReport {
        cause: part.cause,
        axis: part.axis.and_then(name),
        rms_um: um(part.rms_mm),
        peak_um: part.peak_mm.map(um),
        step_um: part.step_mm.map(um).filter(|_| !is_rotary(part.axis)),
        step_mdeg: part.step_mm.map(um).filter(|_| is_rotary(part.axis)),
        share_percent: r3(part.share_percent),
    });
    (measured.readings > 0).then(|| ContourPartsReport {
        readings: measured.readings,
        rms_um: um(measured.rms_mm),
        parts: parts.filter(|part| part.rms_um > 0.0).collect(),
    })
}
