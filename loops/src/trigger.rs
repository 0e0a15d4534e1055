//! What starts a pulse: the four triggers of docs/methods/backlash-acceleration.md.
/// Part of A beyond which a clamped Kp·ε counts no further: the start then moves by at most half the lead.
const CLAMPED_PART: f64 = 0.5;

/// How much of Kp·ε the source's trigger is judged by.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum PositionErrorPart {
    /// None: the start depends on the command alone.
    #[default]
    None,
    /// Kp·ε within ±A/2.
    Clamped,
    /// All of it, as the source has it.
    Full,
}

/// What starts a pulse.
///
/// With s the new direction, ±1, and A = K·|R2 − R0| (0 where that is no acceleration):
///
/// - `PositionError`: s·Kp·ε > 0, once the command has reversed;
/// - `FeedForward`: s·FF > 0;
/// - `VelocityCommand`: s·(Kp·ε + FF) > 0;
/// - `CommandAcceleration`: s·(α·v + part of Kp·ε) + A ≥ 0, v the speed of the command; s·v + A ≥ 0 without such a part;
///   the change of sign, not ≥, where A is 0: standing still is none.
///
/// ε is what the position loop works with: position backlash compensation included, as in the source's error counter. It is
/// judged only after the command's reversal, because a fed-forward axis has an ε of either sign all the time; that the
/// others wait for an announced reversal keeps their sign changes anywhere else from starting anything. FF is what is
/// fed forward, its advance included, so `FeedForward` starts that much ahead of the command's reversal whatever the lead is.
/// Source: \[Fanuc\] JP 2875646, the first three as its prior art. Units: mm/s. No state; NaN starts nothing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Trigger {
    /// Change of sign of the position error.
    PositionError,
    /// Change of sign of the feed-forward.
    FeedForward,
    /// Change of sign of the velocity command without the pulse.
    VelocityCommand,
    /// Within A of the change of sign of the command's speed.
    CommandAcceleration(PositionErrorPart),
}

/// What the triggers are judged by in one scan, in mm/s.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Speeds {
    /// Speed of the command itself; Kp·ε where nothing is fed forward.
    pub command_mm_s: f64,
    /// Speed of the command times α: 0 where nothing is fed forward.
    pub fed_command_mm_s: f64,
    /// FF as it is output, advanced.
    pub feed_forward_mm_s: f64,
    /// Kp·ε.
    pub proportional_mm_s: f64,
}

impl Trigger {
    /// Whether an announced reversal into direction `sign` is due; `reversed` once the command itself has turned.
    pub fn is_due(&self, sign: f64, a_mm_s: f64, reversed: bool, speeds: &Speeds) -> bool {
        let proportional = speeds.proportional_mm_s;
        match self {
            Trigger::PositionError => reversed && sign * proportional > 0.0,
            Trigger::FeedForward => sign * speeds.feed_forward_mm_s > 0.0,
            Trigger::VelocityCommand => sign * (speeds.feed_forward_mm_s + proportional) > 0.0,
            Trigger::CommandAcceleration(part) => {
                let most = CLAMPED_PART * a_mm_s;
                let judged = match part {
                    PositionErrorPart::None => speeds.command_mm_s,
                    // max and min would take the limit for a NaN.
                    PositionErrorPart::Clamped if proportional.is_nan() => proportional,
                    PositionErrorPart::Clamped => {
                        speeds.fed_command_mm_s + proportional.min(most).max(-most)
                    }
                    PositionErrorPart::Full => speeds.fed_command_mm_s + proportional,
                };
                if a_mm_s > 0.0 {
                    sign * judged + a_mm_s >= 0.0
                } else {
                    sign * judged > 0.0
                }
            }
        }
    }

    /// Speed in the new direction, negated, at which a pulse that starts now began: distances are counted from there.
    pub(crate) fn started_at_mm_s(&self, sign: f64, a_mm_s: f64, speeds: &Speeds) -> f64 {
        match self {
            Trigger::CommandAcceleration(_) => a_mm_s,
            _ => (-sign * speeds.command_mm_s).max(0.0),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A reversal from − to + at t = 0 with acceleration `a`, the position error and the advance of FF as given; the
    /// time at which a trigger with this lead first is due, looked at every 0.1 ms from 20 ms before.
    fn starts_at_s(
        trigger: Trigger,
        acceleration_mm_s2: f64,
        error_mm: f64,
        advance_s: f64,
    ) -> Option<f64> {
        let lead_s = 4e-3;
        (-200..200).map(|i| f64::from(i) * 1e-4).find(|t| {
            let speed = acceleration_mm_s2 * t;
            let speeds = Speeds {
                command_mm_s: speed,
                fed_command_mm_s: speed,
                feed_forward_mm_s: acceleration_mm_s2 * (t + advance_s),
                proportional_mm_s: 50.0 * error_mm,
            };
            trigger.is_due(1.0, acceleration_mm_s2 * lead_s, *t >= 0.0, &speeds)
        })
    }

    fn near(found: Option<f64>, expected_s: f64) {
        assert!(
            found.is_some_and(|t| (t - expected_s).abs() < 1.5e-4),
            "{found:?}, expected {expected_s} s"
        );
    }

    #[test]
    fn each_trigger_starts_where_its_own_quantity_changes_its_sign() {
        let a = 100.0;
        // Kp·ε of 1 µm is 0.05 mm/s: half a millisecond at 100 mm/s².
        near(starts_at_s(Trigger::PositionError, a, 1e-3, 2.7e-3), 0.0);
        near(starts_at_s(Trigger::FeedForward, a, 1e-3, 2.7e-3), -2.7e-3);
        near(
            starts_at_s(Trigger::VelocityCommand, a, 1e-3, 2.7e-3),
            -3.2e-3,
        );
        near(
            starts_at_s(Trigger::VelocityCommand, a, -1e-3, 2.7e-3),
            -2.2e-3,
        );
        let own = Trigger::CommandAcceleration(PositionErrorPart::None);
        near(starts_at_s(own, a, 1e-3, 2.7e-3), -4e-3);
        // An axis that is still ahead of its command has no error into the new direction.
        assert_eq!(starts_at_s(Trigger::PositionError, a, -1e-3, 0.0), None);
    }

    #[test]
    fn at_low_acceleration_a_fifth_of_a_micrometre_moves_the_full_start_by_the_whole_lead() {
        // R100 F1000: 2.8 mm/s²; 50 1/s · 0.2 µm = 10 µm/s is 3.6 ms of it (docs/methods/physics.md §4).
        let a = 2.78;
        for (part, shift_s) in [
            (PositionErrorPart::None, 0.0),
            (PositionErrorPart::Clamped, 2e-3),
            (PositionErrorPart::Full, 3.6e-3),
        ] {
            let trigger = Trigger::CommandAcceleration(part);
            near(starts_at_s(trigger, a, 0.2e-3, 0.0), -4e-3 - shift_s);
            near(starts_at_s(trigger, a, -0.2e-3, 0.0), -4e-3 + shift_s);
        }
        // Ten times that: the clamp holds, the full one starts 36 ms ahead, as soon as it is looked at.
        let clamped = Trigger::CommandAcceleration(PositionErrorPart::Clamped);
        near(starts_at_s(clamped, a, 2e-3, 0.0), -6e-3);
        let full = Trigger::CommandAcceleration(PositionErrorPart::Full);
        near(starts_at_s(full, a, 2e-3, 0.0), -20e-3);
    }

    #[test]
    fn nothing_starts_on_a_value_that_is_not_a_number_or_without_motion() {
        let nan = Speeds {
            command_mm_s: f64::NAN,
            fed_command_mm_s: f64::NAN,
            feed_forward_mm_s: f64::NAN,
            proportional_mm_s: f64::NAN,
        };
        for trigger in [
            Trigger::PositionError,
            Trigger::FeedForward,
            Trigger::VelocityCommand,
            Trigger::CommandAcceleration(PositionErrorPart::None),
            Trigger::CommandAcceleration(PositionErrorPart::Clamped),
            Trigger::CommandAcceleration(PositionErrorPart::Full),
        ] {
            for a in [0.0, 1.0] {
                assert!(!trigger.is_due(1.0, a, true, &nan), "{trigger:?}");
            }
            assert!(!trigger.is_due(1.0, 0.0, true, &Speeds::default()));
        }
        let half = Speeds {
            proportional_mm_s: f64::NAN,
            ..Speeds::default()
        };
        let clamped = Trigger::CommandAcceleration(PositionErrorPart::Clamped);
        assert!(!clamped.is_due(1.0, 1.0, true, &half));
    }
}
