//! What the axes bear on one element.

#![expect(
    clippy::indexing_slicing,
    reason = "each index counts the axes of arrays that have PATH_AXES"
)]

use crate::axis_rates::AxisRates;
use crate::geometry::{AxisVector, CubicPiece, Element, PATH_AXES, Shape};
use crate::kinematics::Kinematics;
use crate::limits::MotionLimits;

/// Share of an axis' acceleration that a curve may use across the path: a little remains along it at that speed, more at every lower one.
const CENTRIPETAL_SHARE: f64 = 0.95;
/// The same in the zone of a junction.
const CENTRIPETAL_SHARE_BESIDE_JUNCTIONS: f64 = 0.8;
/// Share of an axis' jerk that a curve may use at its highest speed; what remains is for changing speed.
const CURVE_JERK_SHARE: f64 = 0.6;
/// The same in the zone of a junction, which takes half of it.
const CURVE_JERK_SHARE_BESIDE_JUNCTIONS: f64 = 0.3;

/// How the axes share the motion along one element, as bounds over its whole length.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Sharing {
    /// Part of the tangent that turns in the plane of an arc.
    pub swing: [f64; PATH_AXES],
    /// Part of the tangent that is constant, or a bound of it all where the axes are not the program's.
    pub straight: [f64; PATH_AXES],
    /// Curvature, in 1/mm.
    pub curvature_per_mm: [f64; PATH_AXES],
    /// Its derivative along the path, in 1/mm².
    pub turn_per_mm2: [f64; PATH_AXES],
}

impl Sharing {
    pub fn of(element: &Element, kinematics: &Kinematics) -> Self {
        if let Some(AxisRates { first, second }) = kinematics.axes_rates(element) {
            return Self {
                straight: first,
                curvature_per_mm: second,
                ..Self::default()
            };
        }
        let mut sharing = Self::default();
        let constant = match &element.shape {
            Shape::Arc {
                radius_mm,
                u,
                v,
                sweep_rad,
                axial,
                ..
            } => {
                let around = (radius_mm * sweep_rad / element.length_mm).abs();
                let turn_per_mm = element.curvature_magnitude_per_mm();
                let in_plane = u.iter().zip(v.iter());
                let of_axes = sharing.swing.iter_mut().zip(&mut sharing.curvature_per_mm);
                let of_axes = of_axes.zip(&mut sharing.turn_per_mm2);
                let by_angle = (sweep_rad / element.length_mm).abs();
                for (((swing, curvature), turn), (u, v)) in of_axes.zip(in_plane) {
                    let amplitude = libm::hypot(*u, *v);
                    *swing = amplitude * around;
                    *curvature = amplitude * turn_per_mm;
                    *turn = *curvature * by_angle;
                }
                axial / element.length_mm
            }
            _ => element.tangent(0.0),
        };
        for (straight, component) in sharing.straight.iter_mut().zip(&constant) {
            *straight = component.abs();
        }
        sharing
    }

    /// Of a piece of a rounded element: what its derivatives are at both ends, and at most between them. A function is at most `l²/8` times its
    /// highest second derivative above the chord between its ends, `l` apart.
    fn of_rounded(
        element: &Element,
        programmed: &Sharing,
        cubic: &CubicPiece,
        from_mm: f64,
        to_mm: f64,
    ) -> Self {
        let mut sharing = Self::default();
        let turn_per_mm = match &element.shape {
            Shape::Arc { sweep_rad, .. } => (sweep_rad / element.length_mm).abs(),
            _ => 0.0,
        };
        let at = |distance_mm: f64| {
            let [first, second] = cubic.slopes_at(distance_mm);
            let shape = &element.shape;
            (
                shape.tangent(distance_mm, element.length_mm) + first,
                shape.curvature_per_mm(distance_mm, element.length_mm) + second,
            )
        };
        let (from, to) = (at(from_mm), at(to_mm));
        let eighth = (to_mm - from_mm) * (to_mm - from_mm) / 8.0;
        let [.., third] = &cubic.derivatives;
        for axis in 0..PATH_AXES {
            let of = |vector: &AxisVector| vector.get(axis).copied().unwrap_or(0.0).abs();
            let amplitude = programmed.curvature_per_mm[axis];
            let more = of(third) + amplitude * turn_per_mm;
            sharing.straight[axis] = of(&from.0).max(of(&to.0)) + eighth * more;
            sharing.turn_per_mm2[axis] = more;
            let more = amplitude * turn_per_mm * turn_per_mm;
            sharing.curvature_per_mm[axis] = of(&from.1).max(of(&to.1)) + eighth * more;
        }
        sharing
    }

    pub fn is_curved(&self) -> bool {
        self.curvature_per_mm.iter().any(|per_mm| *per_mm > 0.0)
    }

    /// Highest path speed within the axes' speeds and the share of their accelerations that a curve may use.
    pub fn speed_mm_s(&self, limits: &PlanLimits) -> f64 {
        self.speed_with_mm_s(limits, CENTRIPETAL_SHARE, CURVE_JERK_SHARE)
    }

    /// The same in the zone of a junction.
    pub fn speed_beside_junctions_mm_s(&self, limits: &PlanLimits) -> f64 {
        let (across, jerk) = (
            CENTRIPETAL_SHARE_BESIDE_JUNCTIONS,
            CURVE_JERK_SHARE_BESIDE_JUNCTIONS,
        );
        self.speed_with_mm_s(limits, across, jerk)
    }

    fn speed_with_mm_s(&self, limits: &PlanLimits, share_across: f64, of_jerk: f64) -> f64 {
        let mut speed_mm_s = f64::INFINITY;
        for axis in 0..PATH_AXES {
            let (along, across) = (
                self.swing[axis] + self.straight[axis],
                self.curvature_per_mm[axis],
            );
            if along > 0.0 {
                speed_mm_s = speed_mm_s.min(limits.velocity_mm_s[axis] / along);
            }
            if across > 0.0 {
                let across_mm_s2 = share_across * limits.acceleration_mm_s2[axis];
                speed_mm_s = speed_mm_s.min((across_mm_s2 / across).sqrt());
            }
            let (turn, jerk_mm_s3) = (self.turn_per_mm2[axis], limits.jerk_mm_s3[axis]);
            if turn > 0.0 && jerk_mm_s3.is_finite() {
                speed_mm_s = speed_mm_s.min(libm::cbrt(of_jerk * jerk_mm_s3 / turn));
            }
        }
        speed_mm_s
    }

    /// What keeps every axis within this share of its jerk.
    pub fn by_jerk(&self, limits: &PlanLimits, share: f64) -> ByJerk {
        let mut by_jerk = ByJerk {
            swing_per_s: limits.swing_per_s,
            ..ByJerk::default()
        };
        for (axis, limit) in limits.jerk_mm_s3.iter().enumerate() {
            let along = self.swing[axis] + self.straight[axis];
            let across = self.curvature_per_mm[axis];
            if !limit.is_finite() || along + across <= 0.0 {
                continue;
            }
            by_jerk.of_axes[by_jerk.count] = JerkTaken {
                left_mm_s3: share * limit,
                turn_per_mm2: self.turn_per_mm2[axis],
                along_per_s: along * limits.swing_per_s,
                across_per_mm: 3.0 * across,
            };
            by_jerk.count += 1;
        }
        by_jerk
    }

    /// Acceleration along the path that keeps every axis within what is left of its acceleration.
    pub fn acceleration_mm_s2(&self, left_mm_s2: &[f64; PATH_AXES], speed_mm_s: f64) -> f64 {
        let mut acceleration_mm_s2 = f64::INFINITY;
        for (axis, left) in left_mm_s2.iter().enumerate() {
            let (swing, straight) = (self.swing[axis], self.straight[axis]);
            let across = self.curvature_per_mm[axis] * speed_mm_s * speed_mm_s;
            let along = if swing > 0.0 && straight > 0.0 {
                (left - across) / (swing + straight)
            } else if swing > 0.0 {
                // |across·cos φ| + |a·swing·sin φ| is at most the length of the vector, at every angle.
                (left * left - across * across).max(0.0).sqrt() / swing
            } else if straight > 0.0 {
                // Lines of axes that are the program's have nothing across.
                (left - across) / straight
            } else {
                continue;
            };
            acceleration_mm_s2 = acceleration_mm_s2.min(along);
        }
        acceleration_mm_s2
    }
}

/// What an axis has of its jerk, and what takes of it.
#[derive(Debug, Clone, Copy, Default)]
struct JerkTaken {
    left_mm_s3: f64,
    turn_per_mm2: f64,
    along_per_s: f64,
    across_per_mm: f64,
}

/// The axes whose jerk limits the acceleration along the path.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct ByJerk {
    of_axes: [JerkTaken; PATH_AXES],
    count: usize,
    swing_per_s: f64,
}

/// Rounds in which the tool's speed and the lead's acceleration are found from each other; an odd number ends below both.
const ROUNDS: u32 = 3;

impl ByJerk {
    /// Acceleration along the path that they leave a lead at each speed, where the tool's is its average (`smoothing`) and nowhere above the
    /// highest, in mm/s; infinite where no jerk is limited.
    ///
    /// The jerk along the path is at most `2·a/τ`. Meanwhile the tool may be faster than the lead, which has braked for up to `τ`: at most as if it
    /// had braked at `a` for as long as it takes from the highest speed, `V`, but for no more than `τ`. With `u` the difference of their
    /// speeds, `V − u²/(2·a·τ)` is the average over `τ` then, or `a·τ/2` more than the lead's speed.
    ///
    /// All speeds are reckoned side by side, without a branch, which is several times as fast as one after the other.
    pub fn of_lead_mm_s2<const SPEEDS: usize>(
        &self,
        speeds_mm_s: &[f64; SPEEDS],
        highest_mm_s: f64,
    ) -> [f64; SPEEDS] {
        let half_s = 1.0 / self.swing_per_s;
        let of_lead_mm_s2 = self.acceleration_mm_s2(speeds_mm_s);
        let mut acceleration_mm_s2 = of_lead_mm_s2;
        for _ in 0..ROUNDS {
            let mut of_tool_mm_s = [0.0; SPEEDS];
            let of_lead = speeds_mm_s.iter().zip(&acceleration_mm_s2);
            for (of_tool_mm_s, (speed_mm_s, acceleration_mm_s2)) in
                of_tool_mm_s.iter_mut().zip(of_lead)
            {
                let below_mm_s = highest_mm_s - speed_mm_s;
                let lost_mm_s = acceleration_mm_s2 * half_s;
                let near = highest_mm_s - below_mm_s * below_mm_s / (4.0 * lost_mm_s);
                let far = speed_mm_s + lost_mm_s;
                *of_tool_mm_s = if below_mm_s < 2.0 * lost_mm_s {
                    near
                } else {
                    far
                };
            }
            acceleration_mm_s2 = self.acceleration_mm_s2(&of_tool_mm_s);
        }
        for (found, of_lead) in acceleration_mm_s2.iter_mut().zip(&of_lead_mm_s2) {
            if !of_lead.is_finite() {
                *found = *of_lead;
            }
        }
        acceleration_mm_s2
    }

    /// Acceleration that they leave where tool and lead are at each of these speeds; it falls with the speed.
    fn acceleration_mm_s2<const SPEEDS: usize>(
        &self,
        speeds_mm_s: &[f64; SPEEDS],
    ) -> [f64; SPEEDS] {
        let mut acceleration_mm_s2 = [f64::INFINITY; SPEEDS];
        for of in self.of_axes.iter().take(self.count) {
            for (least, speed_mm_s) in acceleration_mm_s2.iter_mut().zip(speeds_mm_s) {
                let cubed = speed_mm_s * speed_mm_s * speed_mm_s;
                let left = of.left_mm_s3 - of.turn_per_mm2 * cubed;
                let left = if left > 0.0 { left } else { 0.0 };
                let of_axis = left / (of.along_per_s + of.across_per_mm * speed_mm_s);
                *least = if of_axis < *least { of_axis } else { *least };
            }
        }
        acceleration_mm_s2
    }
}

/// A piece of a rounded element.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct LaidPiece {
    /// Where it begins on its element, in mm.
    pub from_mm: f64,
    /// Where it ends, in mm.
    pub to_mm: f64,
    pub sharing: Sharing,
    /// What the axes bear, in mm/s.
    pub speed_mm_s: f64,
}

/// A piece of a correction whose curvature changes by more than this share of its highest is cut further.
const CURVATURE_STEP: f64 = 0.25;
/// So far at most.
const CUTS_MAX: usize = 4;

impl LaidPiece {
    /// The pieces of a rounded element, of which `programmed` is the sharing without rounding.
    pub fn of_rounded(
        element: &Element,
        programmed: &Sharing,
        limits: &PlanLimits,
    ) -> Vec<LaidPiece> {
        let Some(correction) = &element.rounding else {
            return Vec::new();
        };
        let cubics = correction.pieces();
        let mut pieces = Vec::with_capacity(cubics.len());
        let ends = cubics.iter().skip(1).map(|next| next.from_mm);
        for (cubic, end_mm) in cubics.iter().zip(ends.chain([element.length_mm])) {
            if end_mm <= cubic.from_mm {
                continue;
            }
            let length_mm = end_mm - cubic.from_mm;
            let is_changed = cubic.derivatives.iter().any(|of| of.amax() > 0.0);
            let cuts = if is_changed {
                let [_, begin] = cubic.slopes_at(cubic.from_mm);
                let [_, end] = cubic.slopes_at(end_mm);
                let highest = begin.amax().max(end.amax());
                let change = (end - begin).amax();
                (libm::ceil(change / (CURVATURE_STEP * highest)) as usize).clamp(1, CUTS_MAX)
            } else {
                1
            };
            for cut in 0..cuts {
                let place = |cut: usize| cubic.from_mm + length_mm * (cut as f64 / cuts as f64);
                let (from_mm, to_mm) = (
                    place(cut),
                    if cut + 1 == cuts {
                        end_mm
                    } else {
                        place(cut + 1)
                    },
                );
                let sharing = if is_changed {
                    Sharing::of_rounded(element, programmed, cubic, from_mm, to_mm)
                } else {
                    *programmed
                };
                pieces.push(LaidPiece {
                    from_mm,
                    to_mm,
                    speed_mm_s: sharing.speed_mm_s(limits),
                    sharing,
                });
            }
        }
        pieces
    }
}

/// The limits less the rounding of setpoints.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct PlanLimits {
    pub velocity_mm_s: [f64; PATH_AXES],
    pub acceleration_mm_s2: [f64; PATH_AXES],
    pub jerk_mm_s3: [f64; PATH_AXES],
    /// How fast the acceleration along the path changes at most, relative to its limit (`smoothing`), in 1/s.
    pub swing_per_s: f64,
}

impl PlanLimits {
    /// Those of a machine.
    pub fn of(limits: &MotionLimits) -> Self {
        let smoothing_s = f64::from(limits.smoothing_scans()) * limits.scan_period_s();
        Self {
            jerk_mm_s3: limits.plan_jerk_mm_s3(),
            swing_per_s: 2.0 / smoothing_s,
            velocity_mm_s: limits.plan_velocity_mm_s(),
            acceleration_mm_s2: limits.plan_acceleration_mm_s2(),
        }
    }

    /// The highest speed along any path, in mm/s: that of the diagonal.
    pub fn fastest_mm_s(&self) -> f64 {
        let used = self.velocity_mm_s.iter().filter(|of| of.is_finite());
        used.map(|of| of * of).sum::<f64>().sqrt()
    }

    /// Whether the jerk of any axis is limited.
    pub fn limits_jerk(&self) -> bool {
        self.jerk_mm_s3.iter().any(|jerk| jerk.is_finite())
    }
}
