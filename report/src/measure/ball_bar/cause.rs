//! What can be wrong with a circle, and the mark that each leaves on the radius.
//!
//! θ is the angle from the first axis, d the direction (+1 counter-clockwise), R the radius, ω the angular speed. Small
//! errors δx, δy of the axes change the radius by `δx·cos θ + δy·sin θ`; with `x = R·cos θ`, `vx = −d·R·ω·sin θ` and the
//! like for y this gives:
//!
//! | cause | error of the axis | on the radius |
//! |---|---|---|
//! | radius | of both, in proportion | r |
//! | scaling | δx = s·x/2, δy = −s·y/2 | R·s/2·cos 2θ |
//! | squareness | δx = α·y | R·α/2·sin 2θ |
//! | servo mismatch | δx = −τ·vx/2, δy = τ·vy/2 | d·R·ω·τ/2·sin 2θ |
//! | lost motion b of X | δx = −b/2·sgn vx, from the way b behind a reversal on | d·b/2·sgn(sin θ)·cos θ, either side of the axis for itself |
//! | reversal spike of X | late after its reversal | h·(φ/p)·exp(1 − φ/p), φ the angle since the reversal |
//! | cyclic error of X | δx = a·sin(2π·n·x/lead) + b·cos(…) | δx·cos θ |
//!
//! On the way b behind a reversal, δx goes from one side to the other with the travel R·(1 − cos φ): a step as the plot of a
//! ball-bar shows it is what it looks like from afar. A negative b, of too much compensation, is a step.
//!
//! With one direction d is the same everywhere: squareness and servo mismatch leave the same mark, and are one unknown.
//!
//! Sources: ISO 230-4:2022 (terms); Kakino, Ihara, Shinohara, "Accuracy Inspection of NC Machine Tools by Double Ball Bar
//! Method", Hanser 1993 (the marks). The shape of a spike is a sum of such bumps with peaks p at 1/32 to 1/4 of the
//! window of a reversal, and one before it: friction takes a distance, not a time, so no single width fits all radii and
//! feeds.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use serde::Serialize;

/// Peaks of the bumps that a spike is made of, as parts of the window behind the reversal.
const BUMPS: [f64; 4] = [1.0 / 32.0, 1.0 / 16.0, 1.0 / 8.0, 1.0 / 4.0];
/// Peak of the bump before a reversal, as part of the window before it: what a compensation does that comes early.
const EARLY_BUMP: f64 = 1.0 / 3.0;
/// Harmonics of the lead.
const HARMONICS: [f64; 2] = [1.0, 2.0];

/// What is wrong.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum CauseKind {
    /// Step between the directions at the reversal of an axis (backlash, wind-up), on one side of its travel.
    LostMotion,
    /// Quadrant protrusion: an axis is late, or early, behind its reversal.
    ReversalSpike,
    /// The axes do not stand square.
    Squareness,
    /// One axis travels farther than the other, whichever way round.
    Scaling,
    /// One axis follows later than the other.
    ServoMismatch,
    /// One of the two, or both: a circle that was travelled one way does not tell them apart.
    SquarenessOrServoMismatch,
    /// Both travel too far or not far enough, in both directions alike: dynamics at this feed, or scale.
    Radius,
    /// An error that repeats with the turns of a screw.
    Cyclic,
    /// What swings faster than 25 Hz outside the reversals.
    Vibration,
    /// What no mark explains.
    Unexplained,
}

/// One cause: of which axis of the plane (0 or 1), and with which new direction (−1 or 1), where it has them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Cause {
    /// What.
    pub kind: CauseKind,
    /// Axis of the plane.
    pub axis: Option<usize>,
    /// Direction in which the axis travels behind the reversal.
    pub new_direction: Option<i32>,
}

impl Cause {
    /// One that is of no axis.
    pub(super) fn of(kind: CauseKind) -> Cause {
        Cause {
            kind,
            axis: None,
            new_direction: None,
        }
    }

    fn of_axis(kind: CauseKind, axis: usize, new_direction: Option<i32>) -> Cause {
        Cause {
            kind,
            axis: Some(axis),
            new_direction,
        }
    }
}

/// What is known of a circle before it is measured.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Setting {
    /// Programmed radius, in mm.
    pub radius_mm: f64,
    /// Programmed centre, in mm.
    pub centre_mm: [f64; 2],
    /// Angular speed, in rad/s.
    pub angular_speed_rad_s: f64,
    /// Window before and behind a reversal, in rad.
    pub window_rad: (f64, f64),
    /// Leads of the screws of both axes, in mm.
    pub lead_mm: [f64; 2],
}

/// The mark of one unknown of a cause.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Mark {
    Centre(usize),
    Radius,
    Scaling,
    Squareness,
    ServoMismatch,
    /// `wide_mm` is about how large it is: on that way behind the reversal the table stays where it is.
    LostMotion {
        axis: usize,
        side: f64,
        wide_mm: f64,
    },
    Bump {
        side_rad: f64,
        peak_rad: f64,
    },
    Cyclic {
        axis: usize,
        wave: f64,
        sine: bool,
    },
}

/// Angle in −π … π.
fn wrapped(angle_rad: f64) -> f64 {
    angle_rad - TAU * libm::round(angle_rad / TAU)
}

impl Mark {
    /// Its mark at an angle in a direction (+1 counter-clockwise), for one µm of its unknown.
    pub(super) fn at(&self, setting: &Setting, angle_rad: f64, direction: f64) -> f64 {
        let along = |axis: usize| match axis {
            0 => libm::cos(angle_rad),
            _ => libm::sin(angle_rad),
        };
        match *self {
            Mark::Centre(axis) => along(axis),
            Mark::Radius => 1.0,
            Mark::Scaling => libm::cos(2.0 * angle_rad),
            Mark::Squareness => libm::sin(2.0 * angle_rad),
            Mark::ServoMismatch => direction * libm::sin(2.0 * angle_rad),
            Mark::LostMotion {
                axis,
                side,
                wide_mm,
            } => {
                // The speed of the first axis has the sign of −d·sin θ, that of the second of d·cos θ.
                let speed = match axis {
                    0 => -direction * libm::sin(angle_rad),
                    _ => direction * libm::cos(angle_rad),
                };
                let on_side = along(axis) * side > 0.0;
                let late = if speed < 0.0 { 0.5 } else { -0.5 };
                let behind = speed * side < 0.0;
                // From the reversal on the axis has travelled R·(1 − cos φ); only then the table follows.
                let way_mm = setting.radius_mm * (1.0 - along(axis).abs());
                if !on_side {
                    return 0.0;
                }
                let taken_up = match behind && way_mm < wide_mm {
                    true => 2.0 * way_mm / wide_mm - 1.0,
                    false => 1.0,
                };
                late * taken_up * along(axis)
            }
            Mark::Bump { side_rad, peak_rad } => {
                let behind_rad = direction * wrapped(angle_rad - side_rad);
                let part = behind_rad / peak_rad;
                if part <= 0.0 || behind_rad.abs() >= FRAC_PI_2 {
                    return 0.0;
                }
                part * libm::exp(1.0 - part) * libm::cos(behind_rad)
            }
            Mark::Cyclic { axis, wave, sine } => {
                let centre_mm = setting.centre_mm.get(axis).copied().unwrap_or(0.0);
                let place_mm = centre_mm + setting.radius_mm * along(axis);
                let phase = wave * place_mm;
                along(axis)
                    * if sine {
                        libm::sin(phase)
                    } else {
                        libm::cos(phase)
                    }
            }
        }
    }
}

/// All unknowns of a circle that was travelled both ways or one way, each with its cause; those of the centre, which is set
/// up and no error of the machine, have none.
pub(super) fn marks(setting: &Setting, both_ways: bool) -> Vec<(Option<Cause>, Mark)> {
    let plain = |kind, mark| (Some(Cause::of(kind)), mark);
    let mut marks = vec![
        (None, Mark::Centre(0)),
        (None, Mark::Centre(1)),
        plain(CauseKind::Radius, Mark::Radius),
        plain(CauseKind::Scaling, Mark::Scaling),
    ];
    if both_ways {
        marks.push(plain(CauseKind::Squareness, Mark::Squareness));
        marks.push(plain(CauseKind::ServoMismatch, Mark::ServoMismatch));
    } else {
        let either = CauseKind::SquarenessOrServoMismatch;
        marks.push(plain(either, Mark::Squareness));
    }
    let (before_rad, behind_rad) = setting.window_rad;
    for axis in 0..2 {
        for side in [1.0, -1.0] {
            // At the positive end of its travel an axis turns to the negative.
            let new_direction = Some(if side > 0.0 { -1 } else { 1 });
            let cause = |kind| Some(Cause::of_axis(kind, axis, new_direction));
            let lost = Mark::LostMotion {
                axis,
                side,
                wide_mm: 0.0,
            };
            marks.push((cause(CauseKind::LostMotion), lost));
            let turned_rad = if side > 0.0 { 0.0 } else { PI };
            let side_rad = axis as f64 * FRAC_PI_2 + turned_rad;
            let behind = BUMPS.map(|part| part * behind_rad);
            for peak_rad in behind.into_iter().chain([-EARLY_BUMP * before_rad]) {
                let bump = Mark::Bump { side_rad, peak_rad };
                marks.push((cause(CauseKind::ReversalSpike), bump));
            }
        }
        let lead_mm = setting.lead_mm.get(axis).copied().unwrap_or(0.0);
        // A circle that is no two turns of the screw wide does not show that something repeats.
        if lead_mm > 0.0 && setting.radius_mm >= lead_mm {
            for (harmonic, sine) in HARMONICS.iter().flat_map(|h| [(h, true), (h, false)]) {
                let wave = TAU * harmonic / lead_mm;
                let cyclic = Mark::Cyclic { axis, wave, sine };
                let cause = Cause::of_axis(CauseKind::Cyclic, axis, None);
                marks.push((Some(cause), cyclic));
            }
        }
    }
    marks
}
