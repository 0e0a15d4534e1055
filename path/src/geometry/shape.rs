//! The curve of an element: its ends, its length, its bounds.

use super::*;

impl Shape {
    /// Where it starts, to the bit.
    pub fn start(&self) -> AxisVector {
        match self {
            Shape::Line { from, .. } | Shape::Arc { from, .. } => *from,
            Shape::Dwell { at, .. } => *at,
        }
    }

    /// Where it ends, to the bit.
    pub fn end(&self) -> AxisVector {
        match self {
            Shape::Line { to, .. } | Shape::Arc { to, .. } => *to,
            Shape::Dwell { at, .. } => *at,
        }
    }

    /// The point at a share of the way, from 0 to 1; at the ends to the bit.
    pub fn at_share(&self, share: f64) -> AxisVector {
        self.first_at_share(share)
    }

    /// The same of the first axes alone, to the bit.
    pub(super) fn first_at_share<const AXES: usize>(&self, share: f64) -> SVector<f64, AXES> {
        if share <= 0.0 {
            return first_axes(&self.start());
        }
        if share >= 1.0 {
            return first_axes(&self.end());
        }
        match self {
            Shape::Line { from, to } => {
                let [from, to]: [SVector<f64, AXES>; 2] = [from, to].map(first_axes);
                from + (to - from) * share
            }
            Shape::Arc {
                centre,
                radius_mm,
                u,
                v,
                start_angle_rad,
                sweep_rad,
                axial,
                ..
            } => {
                let angle_rad = start_angle_rad + sweep_rad * share;
                let [centre, u, v, axial]: [SVector<f64, AXES>; 4] =
                    [centre, u, v, axial].map(first_axes);
                centre
                    + u * (radius_mm * libm::cos(angle_rad))
                    + v * (radius_mm * libm::sin(angle_rad))
                    + axial * share
            }
            Shape::Dwell { at, .. } => first_axes(at),
        }
    }

    /// Derivative of the point with respect to the distance, for a curve of this length; zero for a dwell.
    pub fn tangent(&self, distance_mm: f64, length_mm: f64) -> AxisVector {
        if length_mm <= 0.0 {
            return AxisVector::zeros();
        }
        match self {
            Shape::Line { from, to } => (to - from) / length_mm,
            Shape::Arc {
                radius_mm,
                u,
                v,
                start_angle_rad,
                sweep_rad,
                axial,
                ..
            } => {
                let share = (distance_mm / length_mm).clamp(0.0, 1.0);
                let angle_rad = start_angle_rad + sweep_rad * share;
                let around_mm = radius_mm * sweep_rad;
                (v * (around_mm * libm::cos(angle_rad)) - u * (around_mm * libm::sin(angle_rad))
                    + axial)
                    / length_mm
            }
            Shape::Dwell { .. } => AxisVector::zeros(),
        }
    }

    /// Second derivative of the point with respect to the distance, in 1/mm.
    pub(crate) fn curvature_per_mm(&self, distance_mm: f64, length_mm: f64) -> AxisVector {
        match self {
            Shape::Arc {
                u,
                v,
                start_angle_rad,
                sweep_rad,
                ..
            } if length_mm > 0.0 => {
                let share = (distance_mm / length_mm).clamp(0.0, 1.0);
                let angle_rad = start_angle_rad + sweep_rad * share;
                (u * libm::cos(angle_rad) + v * libm::sin(angle_rad))
                    * -self.curvature_magnitude_per_mm(length_mm)
            }
            _ => AxisVector::zeros(),
        }
    }

    /// Length of the second derivative, the same all along the curve, in 1/mm.
    pub(crate) fn curvature_magnitude_per_mm(&self, length_mm: f64) -> f64 {
        match self {
            Shape::Arc {
                radius_mm,
                sweep_rad,
                ..
            } if length_mm > 0.0 => {
                let angle_per_mm = sweep_rad / length_mm;
                radius_mm * angle_per_mm * angle_per_mm
            }
            _ => 0.0,
        }
    }

    /// The shape where a rigid motion of its slides puts it: its places by `place`, its directions by `turned`.
    #[must_use]
    pub fn moved(
        &self,
        place: impl Fn(&AxisVector) -> AxisVector,
        turned: impl Fn(&AxisVector) -> AxisVector,
    ) -> Shape {
        let mut moved = self.clone();
        match &mut moved {
            Shape::Line { from, to } => (*from, *to) = (place(from), place(to)),
            Shape::Dwell { at, .. } => *at = place(at),
            Shape::Arc {
                from,
                to,
                centre,
                u,
                v,
                axial,
                ..
            } => {
                (*from, *to, *centre) = (place(from), place(to), place(centre));
                (*u, *v, *axial) = (turned(u), turned(v), turned(axial));
            }
        }
        moved
    }

    /// Both halves of the way; of a dwell, both halves of its time.
    pub fn halves(&self) -> (Shape, Shape) {
        let middle = self.at_share(0.5);
        let (mut first, mut second) = (self.clone(), self.clone());
        match (&mut first, &mut second) {
            (Shape::Line { to, .. }, Shape::Line { from, .. }) => {
                *to = middle;
                *from = middle;
            }
            (
                Shape::Arc {
                    to,
                    sweep_rad: first_rad,
                    axial: first_axial,
                    ..
                },
                Shape::Arc {
                    from,
                    centre,
                    start_angle_rad,
                    sweep_rad,
                    axial,
                    ..
                },
            ) => {
                *to = middle;
                *from = middle;
                *first_rad *= 0.5;
                *sweep_rad *= 0.5;
                *start_angle_rad += *sweep_rad;
                *first_axial *= 0.5;
                *axial *= 0.5;
                *centre += *axial;
            }
            (Shape::Dwell { seconds: first, .. }, Shape::Dwell { seconds, .. }) => {
                *first *= 0.5;
                *seconds *= 0.5;
            }
            _ => {}
        }
        (first, second)
    }

    /// Length along the curve if every axis is a slide, in mm; 0 for a dwell.
    pub fn length_mm(&self) -> f64 {
        self.length_with_rotary_mm(&ALL_LINEAR)
    }

    /// Length along the curve: of its slides, in mm, if any of them moves, else of its rotary axes, in degrees. Rotary
    /// axes that travel together with slides follow in proportion. 0 for a dwell.
    pub fn length_with_rotary_mm(&self, rotary: &RotaryAxes) -> f64 {
        match self {
            Shape::Line { from, to } => displacement_length_mm(&(to - from), rotary),
            Shape::Arc {
                radius_mm,
                sweep_rad,
                axial,
                ..
            } => {
                let mut slides = *axial;
                for (component, is_rotary) in slides.iter_mut().zip(rotary) {
                    if *is_rotary {
                        *component = 0.0;
                    }
                }
                let around_mm = radius_mm * sweep_rad;
                (around_mm * around_mm + slides.norm_squared()).sqrt()
            }
            Shape::Dwell { .. } => 0.0,
        }
    }

    /// Whether every number in it is finite.
    pub fn is_finite(&self) -> bool {
        let all = |vector: &AxisVector| vector.iter().all(|component| component.is_finite());
        match self {
            Shape::Line { from, to } => all(from) && all(to),
            Shape::Arc {
                from,
                to,
                centre,
                radius_mm,
                u,
                v,
                start_angle_rad,
                sweep_rad,
                axial,
            } => {
                [from, to, centre, u, v, axial].into_iter().all(all)
                    && radius_mm.is_finite()
                    && start_angle_rad.is_finite()
                    && sweep_rad.is_finite()
            }
            Shape::Dwell { at, seconds } => all(at) && seconds.is_finite(),
        }
    }

    /// Lowest and highest position of each axis on it, extreme points of arcs included.
    pub fn bounds(&self) -> (AxisVector, AxisVector) {
        let (mut low, mut high) = (self.start(), self.start());
        self.widen(&mut low, &mut high);
        (low, high)
    }

    /// Widens `low` and `high` to hold every point of the curve; an arc's extreme points are found in closed form.
    pub(super) fn widen(&self, low: &mut AxisVector, high: &mut AxisVector) {
        let mut take = |axis: usize, value: f64| {
            if let (Some(low), Some(high)) = (low.get_mut(axis), high.get_mut(axis)) {
                *low = low.min(value);
                *high = high.max(value);
            }
        };
        for end in [self.start(), self.end()] {
            end.iter()
                .enumerate()
                .for_each(|(axis, value)| take(axis, *value));
        }
        let Shape::Arc {
            centre,
            radius_mm,
            u,
            v,
            start_angle_rad,
            sweep_rad,
            axial,
            ..
        } = self
        else {
            return;
        };
        let (from_rad, to_rad) = if *sweep_rad < 0.0 {
            (start_angle_rad + sweep_rad, *start_angle_rad)
        } else {
            (*start_angle_rad, start_angle_rad + sweep_rad)
        };
        let components = centre.iter().zip(u.iter()).zip(v.iter()).zip(axial.iter());
        for (axis, (((centre, u), v), axial)) in components.enumerate() {
            // On this axis the arc is amplitude·cos(φ − phase) + axial·τ; its slope is zero where
            // sin(φ − phase) = axial / (amplitude·sweep).
            let amplitude_mm = radius_mm * libm::hypot(*u, *v);
            let sine = axial / (amplitude_mm * sweep_rad);
            if amplitude_mm == 0.0 || !(-1.0..=1.0).contains(&sine) {
                continue;
            }
            let phase_rad = libm::atan2(*v, *u);
            for relative_rad in [libm::asin(sine), PI - libm::asin(sine)] {
                let angle_rad = phase_rad + relative_rad;
                let first = libm::ceil((from_rad - angle_rad) / TAU);
                let last = libm::floor((to_rad - angle_rad) / TAU);
                if first > last {
                    continue;
                }
                for turn in [first, last] {
                    let share =
                        ((angle_rad + turn * TAU - start_angle_rad) / sweep_rad).clamp(0.0, 1.0);
                    take(
                        axis,
                        centre + amplitude_mm * libm::cos(relative_rad) + axial * share,
                    );
                }
            }
        }
    }
}
