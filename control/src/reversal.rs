//! Backlash acceleration: a short velocity kick, started a fixed time ahead of the reversal (docs/methods/overview.md §2, \[Fanuc\]
//! JP 2875646 / US 5,343,132).
#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing
)]

use bytemuck::{Pod, Zeroable};

use crate::backlash::REVERSAL_TRAVEL_MIN;
use crate::feed_forward::MovementCommands;
use crate::trigger::{Speeds, Trigger};

/// Least difference |R2 − R0| that says something about the acceleration: below it one increment of rounding moves the
/// start by more than a twentieth of the lead (docs/methods/physics.md §4).
pub const DIFFERENCE_MIN_INCREMENTS: i64 = 20;

/// Distance, in multiples of the presliding distance, after which friction counts as turned round (e⁻⁵ = 0.7 % is left).
const TURNED_DISTANCES: f64 = 5.0;
/// Part of its full height below which a decaying kick is over.
const KICK_OVER_PART: f64 = 0.01;
/// Longest decaying kick, in s. Slower friction is no kick any more: the velocity integrator follows it within Ti.
const KICK_S_MAX: f64 = 1.0;

/// Form of the kick; its area `∫kick dt = 2F/Ki` is the same in all of them.
///
/// The velocity loop gives `Kv·(e + ∫e dt/Ti)`. Before the reversal its integrator holds +F, afterwards it must hold −F:
/// whoever wants that without a position error has to hand it the area 2F/Ki (Ki = Kv/Ti) as a velocity error.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum KickShape {
    /// `kick_mm_s` for `kick_scans` scans, then nothing. Source: \[Fanuc\], docs/methods/overview.md §2.
    Constant,
    /// The kick that puts friction itself on the loop, as friction turns round. Our own derivation; that a decaying kick is
    /// better than a constant one was measured before it was derived (docs/methods/physics.md §4).
    ///
    /// A kick that causes no motion of its own satisfies `Kv·(k + ∫k dt/Ti) = ΔF(t)`, ΔF being what friction has turned by,
    /// so `dk/dt + k/Ti = (dΔF/dt)/Kv`: each bit of friction enters with height ΔF/Kv and decays with Ti. Friction
    /// turns round over a distance, `ΔF = 2F·(1 − exp(−d/d0))` (docs/methods/physics.md §1.2; the exponential is the simplest curve of one
    /// parameter: what is left to turn sets how fast it turns), whence per scan
    ///
    /// `k ← k·exp(−Tp/τ) + s·h·[exp(−d/d0) before − after]`, τ = Ti, h = 2F/Kv, d = ∫ max(0, s·speed + A) dt.
    ///
    /// `s·speed + A` is the trigger's own quantity: with `A = lead·a` it is the speed the command has one lead later, so d is
    /// the distance of the command since its reversal, seen one lead ahead. At high acceleration friction has turned before
    /// the kick has decayed, a kick of height h; at low acceleration it takes `sqrt(2·d/a)` and the kick is as much flatter
    /// and longer. Kicks add up, for the equation is linear; and by Masing's rule ΔF is the same function of the distance
    /// wherever a reversal began, so a short way back gets only its part.
    ///
    /// Limits: d0 = 0 is friction that turns at once, a plain decaying kick. It is over, and 0, once d exceeds
    /// 5·d0 and k is below 1 % of h, after 1 s in any case. A command that stops loses nothing: A keeps d growing.
    Decaying {
        /// Decay time τ, in scans.
        decay_scans: f64,
        /// Presliding distance d0, in mm: on it friction turns by 63 %.
        presliding_mm: f64,
    },
}

/// How far a reversal has come.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[repr(u32)]
pub enum Announcement {
    /// No reversal in sight.
    #[default]
    None = 0,
    /// One is ahead and its kick has not started (F1 of the source).
    Ahead = 1,
    /// Its kick has started, the command has not reversed yet.
    Answered = 2,
    /// The command has reversed and the kick has not started yet.
    Overdue = 3,
}

/// Starts a kick at a reversal: by the source's trigger when the speed command comes within `A = K·|R2 − R0|` of its
/// change of sign, or by one of the older ones ([`Trigger`]).
///
/// With `K = lead/(2·Ts²)` the kick starts `lead` before the reversal whatever radius and feed are: `|R2 − R0|` is the
/// command's acceleration over two periods. Start: `speed·s + A ≥ 0`, `s` the new direction; quantised to one scan, so
/// the true lead is in (lead − Tp, lead]. J periods of look-ahead allow leads up to `(J − ½)·Ts`. Source: \[Fanuc\],
/// docs/methods/overview.md §2, docs/methods/physics.md §4.
///
/// The compared speed is the command's alone unless the trigger says otherwise, not `FF + Kp·ε`: at low acceleration A is a
/// few µm/s, and `Kp·ε` of 0.2 µm would move the start by the whole lead.
///
/// Limits: where |R2 − R0| is below [`DIFFERENCE_MIN_INCREMENTS`] the difference is taken over more periods; where that
/// does not help, or a dwell lies between (then it is no acceleration), A is 0 and the kick starts at the change of sign.
/// Units: mm/s, s, increments. First call: nothing announced, no direction; the first motion is no reversal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BacklashAcceleration {
    /// Time ahead of the reversal, in s.
    pub lead_s: f64,
    /// Distribution period Ts, in s.
    pub period_s: f64,
    /// Axis units per increment, in mm.
    pub increment_mm: f64,
    /// Scan period Tp, in s.
    pub scan_s: f64,
    /// What starts the kick.
    pub trigger: Trigger,
    /// Form of the kick.
    pub shape: KickShape,
    /// Height of the kick, in mm/s; 0 switches it off.
    pub kick_mm_s: f64,
    /// Length Tb of a constant kick, in scans.
    pub kick_scans: u32,
}

/// What [`BacklashAcceleration`] remembers.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct ReversalState {
    /// A, in mm/s.
    pub trigger_speed_mm_s: f64,
    /// Kick being output, signed, in mm/s.
    pub kick_mm_s: f64,
    /// A it was started with, in mm/s.
    pub kick_trigger_mm_s: f64,
    /// Distance since its reversal, seen one lead ahead, in mm.
    pub kick_distance_mm: f64,
    /// Scans it still lasts, at most.
    pub kick_remaining_scans: u32,
    /// Direction it was started in: −1, 0 (none yet) or 1.
    pub kick_direction: i32,
    /// Kicks started.
    pub kicks: u32,
    /// [`Announcement`] of the reversal being awaited.
    pub announcement: u32,
}

impl ReversalState {
    /// The reversal being awaited.
    pub fn announcement(&self) -> Announcement {
        match self.announcement {
            1 => Announcement::Ahead,
            2 => Announcement::Answered,
            3 => Announcement::Overdue,
            _ => Announcement::None,
        }
    }

    /// No reversal is awaited any more; what is being output runs out.
    pub fn disarm(&mut self) {
        self.announcement = Announcement::None as u32;
    }

    /// No reversal is awaited any more, and nothing is output.
    pub fn cancel(&mut self) {
        self.disarm();
        self.kick_mm_s = 0.0;
        self.kick_remaining_scans = 0;
    }
}

impl BacklashAcceleration {
    /// K of the source, in 1/s.
    pub fn k_per_s(&self) -> f64 {
        self.lead_s / (2.0 * self.period_s * self.period_s)
    }

    /// At each period boundary: looks for the next reversal in the movement commands of the window in force.
    ///
    /// Everything is found anew, so a reversal that a new window no longer has is forgotten and its armed kick with it.
    pub fn announce(&self, state: &mut ReversalState, direction: i32, movement: &MovementCommands) {
        let ahead = first_reversal(direction.into(), movement);
        let next = match (state.announcement(), ahead) {
            (Announcement::Answered, Some(_)) => return,
            (Announcement::Overdue, None) => return,
            (_, Some(at)) => {
                let acceleration = acceleration(direction.into(), at, movement);
                state.trigger_speed_mm_s = acceleration.map_or(0.0, |(difference, periods)| {
                    // K·|R2 − R0| of the source for two periods; more of them are scaled to two.
                    let per_two = difference as f64 * self.increment_mm * 2.0 / periods as f64;
                    self.k_per_s() * per_two
                });
                Announcement::Ahead
            }
            (_, None) => {
                state.trigger_speed_mm_s = 0.0;
                Announcement::None
            }
        };
        state.announcement = next as u32;
    }

    /// In the scan in which the position command reverses.
    pub fn reversed(&self, state: &mut ReversalState) {
        let next = match state.announcement() {
            Announcement::Answered => Announcement::None,
            Announcement::Ahead => Announcement::Overdue,
            Announcement::None | Announcement::Overdue => {
                state.trigger_speed_mm_s = 0.0;
                Announcement::Overdue
            }
        };
        state.announcement = next as u32;
    }

    /// Each scan, after [`announce`](Self::announce) and [`reversed`](Self::reversed): the kick, in mm/s.
    pub fn update(&self, state: &mut ReversalState, direction: i32, speeds: &Speeds) -> f64 {
        let new_direction = match state.announcement() {
            Announcement::Ahead => -direction,
            Announcement::Overdue => direction,
            Announcement::None | Announcement::Answered => 0,
        };
        let sign = f64::from(new_direction);
        let a = state.trigger_speed_mm_s;
        let has_reversed = state.announcement() == Announcement::Overdue;
        let due = self.trigger.is_due(sign, a, has_reversed, speeds);
        let mut starts = false;
        if new_direction != 0 && due {
            let next = match state.announcement() {
                Announcement::Ahead => Announcement::Answered,
                _ => Announcement::None,
            };
            state.announcement = next as u32;
            let longest_scans = self.longest_scans();
            if self.kick_mm_s != 0.0 && longest_scans > 0 {
                starts = true;
                state.kick_remaining_scans = longest_scans;
                state.kick_direction = new_direction;
                state.kick_trigger_mm_s = self.trigger.started_at_mm_s(sign, a, speeds);
                state.kick_distance_mm = 0.0;
                state.kicks = state.kicks.wrapping_add(1);
            }
        }
        if state.kick_remaining_scans == 0 {
            state.kick_mm_s = 0.0;
            return 0.0;
        }
        state.kick_remaining_scans -= 1;
        match self.shape {
            KickShape::Constant => {
                state.kick_mm_s = f64::from(state.kick_direction) * self.kick_mm_s;
            }
            KickShape::Decaying {
                decay_scans,
                presliding_mm,
            } => self.decay(
                state,
                speeds.command_mm_s,
                decay_scans,
                presliding_mm,
                starts,
            ),
        }
        state.kick_mm_s
    }

    /// Scans after which a kick is over in any case.
    fn longest_scans(&self) -> u32 {
        match self.shape {
            KickShape::Constant => self.kick_scans,
            KickShape::Decaying { .. } => libm::ceil(KICK_S_MAX / self.scan_s) as u32,
        }
    }

    /// One scan of [`KickShape::Decaying`].
    fn decay(
        &self,
        state: &mut ReversalState,
        speed_mm_s: f64,
        decay_scans: f64,
        presliding_mm: f64,
        starts: bool,
    ) {
        let sign = f64::from(state.kick_direction);
        let turned = |distance_mm: f64| {
            if presliding_mm > 0.0 {
                1.0 - libm::exp(-distance_mm / presliding_mm)
            } else {
                1.0
            }
        };
        let before = if starts {
            0.0
        } else {
            turned(state.kick_distance_mm)
        };
        let speed_ahead_mm_s = sign * speed_mm_s + state.kick_trigger_mm_s;
        if speed_ahead_mm_s > 0.0 {
            state.kick_distance_mm += speed_ahead_mm_s * self.scan_s;
        }
        // Mean of the decay over a scan: the output is held for one, and the area is to be h·τ whatever Tp is.
        let decay = libm::exp(-1.0 / decay_scans);
        let held = (1.0 - decay) * decay_scans;
        let step_mm_s = held * self.kick_mm_s * (turned(state.kick_distance_mm) - before);
        state.kick_mm_s = state.kick_mm_s * decay + sign * step_mm_s;
        let all_turned = state.kick_distance_mm >= TURNED_DISTANCES * presliding_mm;
        if all_turned && libm::fabs(state.kick_mm_s) < KICK_OVER_PART * self.kick_mm_s {
            state.kick_mm_s = 0.0;
            state.kick_remaining_scans = 0;
        }
    }
}

/// Index of the first period that moves against `direction`, for good.
fn first_reversal(direction: i64, movement: &MovementCommands) -> Option<usize> {
    if direction == 0 {
        return None;
    }
    let mut candidate = None;
    let mut travel = 0i64;
    for index in 1..movement.count() {
        let back = movement.get(index).saturating_mul(-direction);
        if candidate.is_none() && back > 0 {
            candidate = Some(index);
        }
        if candidate.is_some() {
            travel = travel.saturating_add(back);
            if travel >= REVERSAL_TRAVEL_MIN {
                return candidate;
            }
            if travel <= 0 {
                candidate = None;
                travel = 0;
            }
        }
    }
    None
}

/// Difference of movement commands around the reversal and the periods it spans: |R2 − R0| and 2 where that is large
/// enough; `None` where it is no acceleration.
fn acceleration(direction: i64, at: usize, movement: &MovementCommands) -> Option<(i64, usize)> {
    let onward = |index: usize| movement.get(index).saturating_mul(direction) > 0;
    let back = |index: usize| movement.get(index).saturating_mul(direction) < 0;
    let (mut low, mut high) = if at == 1 {
        // It lies in the period that begins now: what follows takes the place of what is no longer known.
        let goes_on = at + 1 < movement.count() && back(at + 1);
        (0, if goes_on { 2 } else { 1 })
    } else {
        (at.checked_sub(2)?, at)
    };
    // Contiguous: the period between moves on, or turns within itself, or is too slow for its rows to show it turning.
    let slow = movement
        .get(high)
        .saturating_sub(movement.get(low))
        .saturating_abs()
        < DIFFERENCE_MIN_INCREMENTS;
    let between = at == 1
        || onward(at - 1)
        || (movement.get(at - 1) == 0 && (slow || !movement.is_rest(at - 1)));
    if !between || !onward(low) {
        return None;
    }
    loop {
        let difference = movement
            .get(high)
            .saturating_sub(movement.get(low))
            .saturating_abs();
        if difference >= DIFFERENCE_MIN_INCREMENTS {
            return Some((difference, high - low));
        }
        let lower = low.checked_sub(1).filter(|i| onward(*i));
        let higher = Some(high + 1).filter(|i| *i < movement.count() && back(*i));
        if lower.is_none() && higher.is_none() {
            return None;
        }
        low = lower.unwrap_or(low);
        high = higher.unwrap_or(high);
    }
}

#[cfg(test)]
#[allow(clippy::indexing_slicing)]
mod tests {
    use super::*;
    use crate::backlash::{Backlash, BacklashState};
    use crate::feed_forward::FeedForward;
    use crate::trigger::PositionErrorPart;

    /// The command's speed, followed without error.
    fn speeds(speed_mm_s: f64) -> Speeds {
        Speeds {
            command_mm_s: speed_mm_s,
            fed_command_mm_s: speed_mm_s,
            feed_forward_mm_s: speed_mm_s,
            proportional_mm_s: 0.0,
        }
    }

    struct Case {
        scan_s: f64,
        scans_per_period: u32,
        look_ahead_periods: usize,
        lead_s: f64,
    }

    const XY: Case = Case {
        scan_s: 1e-3,
        scans_per_period: 8,
        look_ahead_periods: 2,
        lead_s: 4e-3,
    };

    impl Case {
        fn block(&self) -> BacklashAcceleration {
            BacklashAcceleration {
                lead_s: self.lead_s,
                period_s: self.scan_s * f64::from(self.scans_per_period),
                increment_mm: 1e-6,
                scan_s: self.scan_s,
                trigger: Trigger::CommandAcceleration(PositionErrorPart::None),
                shape: KickShape::Constant,
                kick_mm_s: 1.0,
                kick_scans: 10,
            }
        }

        /// Runs a path given in mm over seconds; the times at which kicks started, in s.
        fn kicks(&self, seconds: f64, path: impl Fn(f64) -> f64) -> Vec<(f64, f64)> {
            let n = self.scans_per_period;
            let block = self.block();
            let backlash = Backlash { step_mm: 0.0 };
            let speed = FeedForward {
                scans_per_period: n,
                coefficient: 1.0,
                advance_scans: 1.0,
            };
            let row = |k: i64| libm::rint(path(k as f64 * self.scan_s) * 1e6) as i64;
            let (mut state, mut sides) = (ReversalState::default(), BacklashState::default());
            let mut kicks = Vec::new();
            for k in 0..(seconds / self.scan_s) as i64 {
                let c = k.rem_euclid(n.into());
                let start = k - c - 1;
                let movement = MovementCommands::gather(
                    row(start - i64::from(n)),
                    row(start),
                    c as u32,
                    n,
                    self.look_ahead_periods,
                    |i| row(k + i),
                );
                let ahead = (1..16).map(|i| row(k + i));
                if backlash.update(&mut sides, row(k - 1), row(k), ahead) {
                    block.reversed(&mut state);
                }
                if c == 0 {
                    block.announce(&mut state, sides.direction, &movement);
                }
                let v = speed.increments_per_scan(&movement, c as u32) * 1e-6 / self.scan_s;
                let before = state.kicks;
                let kick = block.update(&mut state, sides.direction, &speeds(v));
                if state.kicks > before {
                    kicks.push((k as f64 * self.scan_s, kick));
                }
            }
            kicks
        }
    }

    #[test]
    fn the_kick_starts_the_same_time_ahead_whatever_radius_and_feed_are() {
        // docs/methods/overview.md §2: t = −2·K·Ts², K = 31.25 1/s for a lead of 4 ms at Ts = 8 ms; true lead in (lead − Tp, lead].
        // At the highest accelerations (22 m/s² at R5 F20) the chord of the sine shortens it further, by less than a scan.
        assert!((XY.block().k_per_s() - 31.25).abs() < 1e-9);
        let modern = Case {
            scan_s: 0.25e-3,
            scans_per_period: 4,
            look_ahead_periods: 8,
            lead_s: 4e-3,
        };
        for case in [XY, modern] {
            for radius_mm in [5.0, 10.0, 25.0, 50.0, 100.0, 200.0] {
                for feed_m_min in [0.5, 1.0, 3.0, 10.0, 20.0] {
                    let w = feed_m_min * 1000.0 / 60.0 / radius_mm;
                    let acceleration = w * w * radius_mm;
                    // Widest span of the modern timing: 9 periods of 1 ms; below, the difference says nothing.
                    let span_s = if case.scans_per_period == 4 {
                        9e-3 * 1e-3
                    } else {
                        2.0 * 64e-6
                    };
                    if acceleration * span_s < 21e-6 {
                        continue;
                    }
                    for phase in [0.0, 0.13, 0.41, 0.77] {
                        // Turns at w·t = 1 + phase·Ts·w (+ π).
                        let turn_s = 1.0 / w + phase * 8e-3;
                        let kicks = case.kicks(turn_s + 0.5 / w, |t| {
                            radius_mm * libm::cos(w * (t - turn_s))
                        });
                        assert_eq!(
                            kicks.len(),
                            1,
                            "R{radius_mm} F{feed_m_min} {phase}: {kicks:?}"
                        );
                        let (at_s, kick) = kicks[0];
                        assert!(kick < 0.0);
                        let lead_s = turn_s - at_s;
                        // The speed near a turn is a sine, not a line: asin(x) − x of it, later by the chord of |R2 − R0|.
                        let arc_s = 0.2 * w * w * case.lead_s * case.lead_s * case.lead_s + 1e-9;
                        let chord_s = case.lead_s * 0.4 * (w * 12e-3) * (w * 12e-3);
                        // Each of two movement commands is rounded by up to an increment.
                        let period_s = case.scan_s * f64::from(case.scans_per_period);
                        let difference = (acceleration * 2.0 * period_s * period_s * 1e6).max(20.0);
                        let rounding_s = case.lead_s * 2.0 / difference;
                        assert!(
                            lead_s
                                > case.lead_s - case.scan_s - chord_s.min(case.scan_s) - rounding_s
                                && lead_s <= case.lead_s + arc_s + rounding_s,
                            "R{radius_mm} F{feed_m_min} phase {phase} Tp {}: lead {lead_s}",
                            case.scan_s
                        );
                    }
                }
            }
        }
    }

    #[test]
    fn a_lead_as_long_as_the_look_ahead_guarantees_is_reached_at_every_phase() {
        // (J − ½)·Ts less the scan in which a period begins: 11 ms of two periods of 8 ms. One period ahead, as in the
        // source, guarantees half a one. Phase 3 turns in the very middle of a period, whose movement command is 0.
        for look_ahead_periods in [1, 2, 4] {
            let case = Case {
                look_ahead_periods,
                lead_s: (look_ahead_periods as f64 - 0.5) * 8e-3 - 1e-3,
                ..XY
            };
            let (radius_mm, w) = (50.0, 1.0);
            for phase in 0..8 {
                let turn_s = 1.0 + f64::from(phase) * 1e-3;
                let kicks = case.kicks(1.5, |t| radius_mm * libm::cos(w * (t - turn_s)));
                assert_eq!(kicks.len(), 1, "{look_ahead_periods} {phase}: {kicks:?}");
                let lead_s = turn_s - kicks[0].0;
                assert!(
                    lead_s > case.lead_s - 1.1e-3 && lead_s <= case.lead_s + 1e-4,
                    "{look_ahead_periods} periods, phase {phase}: {lead_s}"
                );
            }
        }
    }

    #[test]
    fn a_lead_shorter_than_the_rest_of_the_period_is_kept_at_every_phase() {
        for lead_ms in [1.0, 2.0, 3.0] {
            let case = Case {
                lead_s: lead_ms * 1e-3,
                ..XY
            };
            for phase in 0..16 {
                let turn_s = 1.0 + f64::from(phase) * 0.5e-3;
                let kicks = case.kicks(1.5, |t| 50.0 * libm::cos(t - turn_s));
                assert_eq!(kicks.len(), 1, "{lead_ms} {phase}: {kicks:?}");
                let found_ms = (turn_s - kicks[0].0) * 1e3;
                assert!(
                    found_ms > lead_ms - 1.1 && found_ms <= lead_ms + 0.1,
                    "{lead_ms} ms, phase {phase}: {found_ms} ms"
                );
            }
        }
    }

    #[test]
    fn below_twenty_increments_the_kick_starts_at_the_change_of_sign() {
        let coarse = Case {
            scan_s: 0.25e-3,
            scans_per_period: 4,
            look_ahead_periods: 1,
            lead_s: 0.5e-3,
        };
        // R200 F0.5: 0.35 mm/s², less than one increment per period squared.
        let (w, radius_mm) = (8.333 / 200.0, 200.0);
        let kicks = coarse.kicks(1.2, |t| radius_mm * libm::cos(w * (t - 1.0)));
        // Rounded to one increment the turn is flat for ±2.4 ms, and a reversal counts after ten of them ahead.
        assert_eq!(kicks.len(), 1);
        assert!((kicks[0].0 - 1.0).abs() < 0.010, "{kicks:?}");
    }

    #[test]
    fn after_a_dwell_the_difference_is_no_acceleration() {
        // 10 mm/s forward, 40 ms at rest, 10 mm/s back.
        let path = |t: f64| {
            if t < 0.1 {
                10.0 * t
            } else {
                1.0 - 10.0 * (t - 0.14).max(0.0)
            }
        };
        let kicks = XY.kicks(0.3, path);
        assert_eq!(kicks.len(), 1, "{kicks:?}");
        assert!((0.132..0.150).contains(&kicks[0].0), "{kicks:?}");
        let mut state = ReversalState::default();
        let movement = MovementCommands::gather(-80_000, 0, 7, 8, 3, |i| {
            [0, 0, 0, -80_000][((i / 8) as usize).min(3)]
        });
        XY.block().announce(&mut state, 1, &movement);
        assert_eq!(
            (state.announcement(), state.trigger_speed_mm_s),
            (Announcement::Ahead, 0.0)
        );
    }

    #[test]
    fn a_reversal_that_a_new_window_no_longer_has_is_disarmed() {
        let block = XY.block();
        let mut state = ReversalState::default();
        let turning = MovementCommands::gather(-800, 0, 0, 8, 2, |i| (100 - i) * i);
        let turning_back = MovementCommands::gather(0, 800, 7, 8, 2, |i| 800 - 100 * i);
        block.announce(&mut state, 1, &turning_back);
        assert_eq!(state.announcement(), Announcement::Ahead);
        block.announce(&mut state, 1, &turning);
        assert_eq!(state.announcement(), Announcement::None);
        assert_eq!(block.update(&mut state, 1, &speeds(0.0)), 0.0);
    }

    #[test]
    fn a_running_kick_runs_out_and_ends_at_rest() {
        let block = XY.block();
        let mut state = ReversalState::default();
        block.reversed(&mut state);
        let kicks: Vec<f64> = (0..12)
            .map(|_| block.update(&mut state, -1, &speeds(-0.1)))
            .collect();
        assert_eq!(kicks[..10], [-1.0; 10]);
        assert_eq!(kicks[10..], [0.0; 2]);
        assert_eq!(state.kick_mm_s, 0.0);
    }

    fn decaying(presliding_mm: f64) -> BacklashAcceleration {
        BacklashAcceleration {
            shape: KickShape::Decaying {
                decay_scans: 10.0,
                presliding_mm,
            },
            kick_mm_s: 3.5,
            ..XY.block()
        }
    }

    /// Kicks of a reversal with this acceleration, whose trigger is reached in the first scan.
    fn reversal(block: &BacklashAcceleration, acceleration_mm_s2: f64) -> Vec<f64> {
        let trigger_speed_mm_s = acceleration_mm_s2 * block.lead_s;
        let mut state = ReversalState {
            announcement: Announcement::Ahead as u32,
            trigger_speed_mm_s,
            ..ReversalState::default()
        };
        let mut kicks = Vec::new();
        for k in 0..1500 {
            let direction = if f64::from(k) * block.scan_s < block.lead_s {
                -1
            } else {
                1
            };
            let speed = acceleration_mm_s2 * f64::from(k) * block.scan_s - trigger_speed_mm_s;
            kicks.push(block.update(&mut state, direction, &speeds(speed)));
        }
        assert_eq!(state.kicks, 1);
        assert_eq!((state.kick_mm_s, state.kick_remaining_scans), (0.0, 0));
        kicks
    }

    #[test]
    fn a_decaying_kick_has_the_same_area_at_every_acceleration_and_ends_at_rest() {
        for presliding_mm in [0.0, 0.008] {
            // R150 F0.5 to R10 F10.
            for acceleration_mm_s2 in [0.46, 2.8, 100.0, 2800.0] {
                let kicks = reversal(&decaying(presliding_mm), acceleration_mm_s2);
                let area_um: f64 = kicks.iter().sum();
                assert!(
                    (34.0..=35.0).contains(&area_um),
                    "{presliding_mm} mm, {acceleration_mm_s2} mm/s²: {area_um}"
                );
                assert!(kicks.iter().all(|k| *k >= 0.0));
            }
        }
    }

    #[test]
    fn a_decaying_kick_lasts_as_long_as_friction_takes_to_turn_round() {
        let height = |acceleration: f64| {
            let kicks = reversal(&decaying(0.008), acceleration);
            let peak = kicks.iter().copied().fold(0.0, f64::max);
            (peak, kicks.iter().filter(|k| **k > 0.2 * peak).count())
        };
        let (fast_mm_s, fast_scans) = height(2800.0);
        let (slow_mm_s, slow_scans) = height(2.8);
        // At once, it would be 3.33 mm/s (h, mean over a scan) and 16 scans (ln 5 · τ).
        assert!((2.4..3.33).contains(&fast_mm_s), "{fast_mm_s}");
        assert!((16..22).contains(&fast_scans), "{fast_scans}");
        // sqrt(2·8 µm/a) is 76 ms.
        assert!((0.2..0.5).contains(&slow_mm_s), "{slow_mm_s}");
        assert!((76..152).contains(&slow_scans), "{slow_scans}");
    }

    #[test]
    fn friction_that_turns_at_once_gets_a_plain_exponential() {
        let kicks = reversal(&decaying(0.0), 100.0);
        assert!((kicks[0] - 3.5 * 10.0 * (1.0 - libm::exp(-0.1))).abs() < 1e-12);
        for pair in kicks.windows(2).filter(|pair| pair[1] > 0.0) {
            assert!((pair[1] / pair[0] - libm::exp(-0.1)).abs() < 1e-12);
        }
        assert_eq!(kicks[50..], [0.0; 1450]);
    }

    #[test]
    fn a_decaying_kick_whose_command_stops_or_turns_away_ends_at_rest() {
        let block = decaying(0.008);
        for (acceleration_mm_s2, speed_mm_s) in
            [(100.0, 0.0), (0.0, 0.0), (100.0, -50.0), (100.0, f64::NAN)]
        {
            let mut state = ReversalState {
                announcement: Announcement::Ahead as u32,
                trigger_speed_mm_s: acceleration_mm_s2 * block.lead_s,
                ..ReversalState::default()
            };
            block.update(&mut state, -1, &speeds(1.0));
            assert_eq!((state.kicks, state.kick_direction), (1, 1));
            for _ in 0..1000 {
                let kick = block.update(&mut state, 1, &speeds(speed_mm_s));
                assert!((0.0..3.5).contains(&kick), "{speed_mm_s}: {kick}");
            }
            assert_eq!((state.kick_mm_s, state.kick_remaining_scans), (0.0, 0));
        }
    }

    #[test]
    fn a_second_reversal_adds_its_kick_to_what_is_left_of_the_first() {
        let block = decaying(0.0);
        let mut state = ReversalState::default();
        block.reversed(&mut state);
        let first = block.update(&mut state, 1, &speeds(0.1));
        block.reversed(&mut state);
        let second = block.update(&mut state, -1, &speeds(-0.1));
        assert!((second - first * (libm::exp(-0.1) - 1.0)).abs() < 1e-12);
    }

    #[test]
    fn a_speed_that_is_not_a_number_starts_nothing() {
        let mut state = ReversalState::default();
        XY.block().reversed(&mut state);
        assert_eq!(XY.block().update(&mut state, 1, &speeds(f64::NAN)), 0.0);
        assert_eq!(state.kicks, 0);
    }
}
