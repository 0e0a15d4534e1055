//! Backlash acceleration: a short velocity pulse, started a fixed time ahead of the reversal (docs/methods/overview.md §2, \[Fanuc\]
//! JP 2875646 / US 5,343,132).
use bytemuck::{Pod, Zeroable};

use crate::backlash::REVERSAL_TRAVEL_MIN;
use crate::feed_forward::MovementCommands;
use crate::trigger::{Speeds, Trigger};

/// Least difference |R2 − R0| that says something about the acceleration: below it one increment of rounding moves the
/// start by more than a twentieth of the lead (docs/methods/physics.md §4).
pub const DIFFERENCE_MIN_INCREMENTS: i64 = 20;

/// Distance, in multiples of the presliding distance, after which friction counts as turned round (e⁻⁵ = 0.7 % is left).
const TURNED_DISTANCES: f64 = 5.0;
/// Part of its full height below which a decaying pulse is over.
const PULSE_OVER_PART: f64 = 0.01;
/// Longest decaying pulse, in s. Slower friction is no pulse any more: the velocity integrator follows it within Ti.
const PULSE_S_MAX: f64 = 1.0;

/// Form of the pulse; its area `∫pulse dt = 2F/Ki` is the same in all of them.
///
/// The velocity loop gives `Kv·(e + ∫e dt/Ti)`. Before the reversal its integrator holds +F, afterwards it must hold −F:
/// whoever wants that without a position error has to hand it the area 2F/Ki (Ki = Kv/Ti) as a velocity error.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PulseShape {
    /// `pulse_mm_s` for `pulse_scans` scans, then nothing. Source: \[Fanuc\], docs/methods/overview.md §2.
    Constant,
    /// The pulse that puts friction itself on the loop, as friction turns round. Our own derivation; that a decaying pulse is
    /// better than a constant one was measured before it was derived (docs/methods/physics.md §4).
    ///
    /// A pulse that causes no motion of its own satisfies `Kv·(k + ∫k dt/Ti) = ΔF(t)`, ΔF being what friction has turned by,
    /// so `dk/dt + k/Ti = (dΔF/dt)/Kv`: each bit of friction enters with height ΔF/Kv and decays with Ti. Friction
    /// turns round over a distance, `ΔF = 2F·(1 − exp(−d/d0))` (docs/methods/physics.md §1.2; the exponential is the simplest curve of one
    /// parameter: what is left to turn sets how fast it turns), whence per scan
    ///
    /// `k ← k·exp(−Tp/τ) + s·h·[exp(−d/d0) before − after]`, τ = Ti, h = 2F/Kv, d = ∫ max(0, s·speed + A) dt.
    ///
    /// `s·speed + A` is the trigger's own quantity: with `A = lead·a` it is the speed the command has one lead later, so d is
    /// the distance of the command since its reversal, seen one lead ahead. At high acceleration friction has turned before
    /// the pulse has decayed, a pulse of height h; at low acceleration it takes `sqrt(2·d/a)` and the pulse is as much flatter
    /// and longer. Pulses add up, for the equation is linear; and by Masing's rule ΔF is the same function of the distance
    /// wherever a reversal began, so a short way back gets only its part.
    ///
    /// Limits: d0 = 0 is friction that turns at once, a plain decaying pulse. It is over, and 0, once d exceeds
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
    /// One is ahead and its pulse has not started (F1 of the source).
    Ahead = 1,
    /// Its pulse has started, the command has not reversed yet.
    Answered = 2,
    /// The command has reversed and the pulse has not started yet.
    Overdue = 3,
}

/// Starts a pulse at a reversal: by the source's trigger when the speed command comes within `A = K·|R2 − R0|` of its
/// change of sign, or by one of the older ones ([`Trigger`]).
///
/// With `K = lead/(2·Ts²)` the pulse starts `lead` before the reversal whatever radius and feed are: `|R2 − R0|` is the
/// command's acceleration over two periods. Start: `speed·s + A ≥ 0`, `s` the new direction; quantised to one scan, so
/// the true lead is in (lead − Tp, lead]. J periods of look-ahead allow leads up to `(J − ½)·Ts`. Source: \[Fanuc\],
/// docs/methods/overview.md §2, docs/methods/physics.md §4.
///
/// The compared speed is the command's alone unless the trigger says otherwise, not `FF + Kp·ε`: at low acceleration A is a
/// few µm/s, and `Kp·ε` of 0.2 µm would move the start by the whole lead.
///
/// Limits: where |R2 − R0| is below [`DIFFERENCE_MIN_INCREMENTS`] the difference is taken over more periods; where that
/// does not help, or a dwell lies between (then it is no acceleration), A is 0 and the pulse starts at the change of sign.
/// Units: mm/s, s, increments. First call: nothing announced, no direction; the first motion is no reversal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BacklashAcceleration {
    /// Time ahead of the reversal, in s.
    pub lead_s: f64,
    /// Interpolation period Ts, in s.
    pub period_s: f64,
    /// Axis units per increment, in mm.
    pub increment_mm: f64,
    /// Scan period Tp, in s.
    pub scan_s: f64,
    /// What starts the pulse.
    pub trigger: Trigger,
    /// Form of the pulse.
    pub shape: PulseShape,
    /// Height of the pulse, in mm/s; 0 switches it off.
    pub pulse_mm_s: f64,
    /// Length Tb of a constant pulse, in scans.
    pub pulse_scans: u32,
}

/// What [`BacklashAcceleration`] remembers.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct ReversalState {
    /// A, in mm/s.
    pub trigger_speed_mm_s: f64,
    /// Pulse being output, signed, in mm/s.
    pub pulse_mm_s: f64,
    /// A it was started with, in mm/s.
    pub pulse_trigger_mm_s: f64,
    /// Distance since its reversal, seen one lead ahead, in mm.
    pub pulse_distance_mm: f64,
    /// Scans it still lasts, at most.
    pub pulse_remaining_scans: u32,
    /// Direction it was started in: −1, 0 (none yet) or 1.
    pub pulse_direction: i32,
    /// Pulses started.
    pub pulses: u32,
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
        self.pulse_mm_s = 0.0;
        self.pulse_remaining_scans = 0;
    }
}

impl BacklashAcceleration {
    /// K of the source, in 1/s.
    pub fn k_per_s(&self) -> f64 {
        self.lead_s / (2.0 * self.period_s * self.period_s)
    }

    /// At each period boundary: looks for the next reversal in the movement commands of the window in force.
    ///
    /// Everything is found again, so a reversal that a new window no longer has is forgotten and its armed pulse with it.
    pub fn announce(&self, state: &mut ReversalState, direction: i32, movement: &MovementCommands) {
        let ahead = first_reversal(direction.into(), movement);
        let next = match (state.announcement(), ahead) {
            (Announcement::Answered, Some(_)) | (Announcement::Overdue, None) => return,
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

    /// Each scan, after [`announce`](Self::announce) and [`reversed`](Self::reversed): the pulse, in mm/s.
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
            if self.pulse_mm_s != 0.0 && longest_scans > 0 {
                starts = true;
                state.pulse_remaining_scans = longest_scans;
                state.pulse_direction = new_direction;
                state.pulse_trigger_mm_s = self.trigger.started_at_mm_s(sign, a, speeds);
                state.pulse_distance_mm = 0.0;
                state.pulses = state.pulses.wrapping_add(1);
            }
        }
        if state.pulse_remaining_scans == 0 {
            state.pulse_mm_s = 0.0;
            return 0.0;
        }
        state.pulse_remaining_scans -= 1;
        match self.shape {
            PulseShape::Constant => {
                state.pulse_mm_s = f64::from(state.pulse_direction) * self.pulse_mm_s;
            }
            PulseShape::Decaying {
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
        state.pulse_mm_s
    }

    /// Scans after which a pulse is over in any case.
    fn longest_scans(&self) -> u32 {
        match self.shape {
            PulseShape::Constant => self.pulse_scans,
            PulseShape::Decaying { .. } => libm::ceil(PULSE_S_MAX / self.scan_s) as u32,
        }
    }

    /// One scan of [`PulseShape::Decaying`].
    fn decay(
        &self,
        state: &mut ReversalState,
        speed_mm_s: f64,
        decay_scans: f64,
        presliding_mm: f64,
        starts: bool,
    ) {
        let sign = f64::from(state.pulse_direction);
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
            turned(state.pulse_distance_mm)
        };
        let speed_ahead_mm_s = sign * speed_mm_s + state.pulse_trigger_mm_s;
        if speed_ahead_mm_s > 0.0 {
            state.pulse_distance_mm += speed_ahead_mm_s * self.scan_s;
        }
        // Mean of the decay over a scan: the output is held for one, and the area is to be h·τ whatever Tp is.
        let decay = libm::exp(-1.0 / decay_scans);
        let held = (1.0 - decay) * decay_scans;
        let step_mm_s = held * self.pulse_mm_s * (turned(state.pulse_distance_mm) - before);
        state.pulse_mm_s = state.pulse_mm_s * decay + sign * step_mm_s;
        let all_turned = state.pulse_distance_mm >= TURNED_DISTANCES * presliding_mm;
        if all_turned && libm::fabs(state.pulse_mm_s) < PULSE_OVER_PART * self.pulse_mm_s {
            state.pulse_mm_s = 0.0;
            state.pulse_remaining_scans = 0;
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
    for index in 1..movement.count {
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
        let goes_on = at + 1 < movement.count && back(at + 1);
        (0, if goes_on { 2 } else { 1 })
    } else {
        (at.checked_sub(2)?, at)
    };
    // Contiguous: the period between moves on, or turns within itself, or is too slow for its setpoints to show it turning.
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
        let higher = Some(high + 1).filter(|i| *i < movement.count && back(*i));
        if lower.is_none() && higher.is_none() {
            return None;
        }
        low = lower.unwrap_or(low);
        high = higher.unwrap_or(high);
    }
}

#[cfg(test)]
mod tests;
