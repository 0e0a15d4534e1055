//! Axes that brake together.
/// Deceleration that brings one axis to rest together with all others, each within its quick stop, in mm/s².
///
/// `T = max |v_i|/q_i`, deceleration `|v|/T`; the axis's own quick stop at rest. Each axis comes as its speed, in mm/s, and its
/// quick stop, in mm/s²; `own` is the axis's place among them. Source: docs/developers/architecture.md, "A silent servo". No state.
pub fn deceleration_mm_s2(axes: impl Iterator<Item = (f64, f64)>, own: usize) -> f64 {
    let mut longest_s = 0.0f64;
    let (mut own_mm_s, mut own_quick_stop) = (0.0, 0.0);
    for (index, (speed_mm_s, quick_stop_mm_s2)) in axes.enumerate() {
        longest_s = longest_s.max(speed_mm_s.abs() / quick_stop_mm_s2);
        if index == own {
            (own_mm_s, own_quick_stop) = (speed_mm_s.abs(), quick_stop_mm_s2);
        }
    }
    if own_mm_s > 0.0 && longest_s > 0.0 {
        own_mm_s / longest_s
    } else {
        own_quick_stop
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_axes_need_the_time_of_the_one_that_needs_longest() {
        let axes = [(100.0, 1000.0), (-40.0, 500.0), (0.0, 800.0)];
        let of = |own| deceleration_mm_s2(axes.into_iter(), own);
        assert_eq!((of(0), of(1)), (1000.0, 400.0));
        assert_eq!(of(2), 800.0, "one that rests has its own");
    }
}
