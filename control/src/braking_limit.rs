//! The path speed from which a window's braking setpoints bring the tool to rest.

use crate::segment::Segment;

/// Steps of speed in which the time to brake is added up.
const BRAKING_STEPS: usize = 64;

/// The speed from which braking to rest takes `braking_time_s`, at worst, on the segments that can be passed meanwhile; none if no
/// segment that is to be limited allows more than that: `fastest_mm_s` is the highest cap of those.
///
/// While braking, the speed `w` is passed on a segment whose cap is at least `w`; so with `A(w)` the least acceleration of
/// all those, braking from `v` takes at most ∫₀ᵛ dw/A(w).
pub(crate) fn braking_limit_mm_s<'a>(
    segments: impl Iterator<Item = &'a Segment>,
    fastest_mm_s: f64,
    override_max: f64,
    braking_time_s: f64,
) -> Option<f64> {
    if fastest_mm_s <= 0.0 {
        return None;
    }
    let step_mm_s = fastest_mm_s / BRAKING_STEPS as f64;
    let mut least_mm_s2 = [f64::INFINITY; BRAKING_STEPS];
    for segment in segments.filter(|segment| !segment.is_dwell) {
        let top_step = libm::floor(segment.cap_mm_s(override_max) / step_mm_s) as usize;
        if let Some(least) = least_mm_s2.get_mut(top_step.min(BRAKING_STEPS - 1)) {
            *least = least.min(segment.acceleration_mm_s2);
        }
    }
    let mut least_above = f64::INFINITY;
    for least in least_mm_s2.iter_mut().rev() {
        least_above = least_above.min(*least);
        *least = least_above;
    }
    let (mut time_s, mut speed_mm_s) = (0.0, 0.0);
    for least in least_mm_s2 {
        let step_time_s = step_mm_s / least;
        if time_s + step_time_s > braking_time_s {
            return Some(speed_mm_s + (braking_time_s - time_s) * least);
        }
        time_s += step_time_s;
        speed_mm_s += step_mm_s;
    }
    None
}
