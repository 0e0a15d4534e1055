//! Two control devices on one motor: the switch between them, and the position of the one that does not drive.
use bytemuck::{Pod, Zeroable};

/// What is done about the motor's drift after the switch to the second device.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Variant {
    /// \[Fanuc-P2\]: the second device makes the error good that the first one left.
    #[default]
    SettledDeviation,
    /// \[Fanuc-P3\]: an offset to the speed command first brings the motor back to where it stood before the switch.
    ReturnToStand,
}

/// Where a changeover stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[repr(u32)]
pub enum Phase {
    /// The first device drives.
    #[default]
    FirstDrives = 0,
    /// The second drives and settles.
    Settling = 1,
    /// The motor has settled and is brought back ([`Variant::ReturnToStand`]).
    Returning = 2,
    /// The second drives as it likes.
    Following = 3,
}

/// Switches a motor from a first control device to a second and back, without a step in the speed command.
///
/// ```text
/// at a switch:   fade ← speed command before − own speed command      (each scan: fade ← fade·f)
/// settling:      the command stands; the second device takes the motor there
/// returning:     offset ← offset + g·(E2 − E2 at the switch)          until that is within the tolerance
/// then:          the second's command is the first's too:  E1 = command − encoder
/// ```
///
/// The second device's speed command is `Kp·E2 + fade + offset`; [`Changeover::update`] gives the last two. Every phase ends after
/// `patience_scans` at the latest.
///
/// Source: \[Fanuc-P2\] and \[Fanuc-P3\], docs/methods/two-controllers.md, which says what is interpretation (how
/// "settled" is judged, that the offset is summed up, whose command counts, and the fading share, which is ours). Units: increments
/// for positions, mm/s for speeds. First call: [`Changeover::to_second`]. Speeds that are not numbers stay so in the speed command,
/// which its guard refuses.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Changeover {
    /// Which variant.
    pub variant: Variant,
    /// The motor stands if it moved by at most this much in a scan, in increments.
    pub standing_increments: i64,
    /// Scans in a row it must stand to count as settled.
    pub settle_scans: u32,
    /// Scans after which a phase ends whatever the motor does.
    pub patience_scans: u32,
    /// Gain g of the return, in mm/s per increment and scan.
    pub return_gain_mm_s: f64,
    /// The motor is back where it stood within this, in increments.
    pub return_tolerance: i64,
    /// Factor f by which the fading share shrinks each scan, from 0 up to below 1.
    pub fade_factor: f64,
}

/// Below this the fading share is none, in mm/s: an increment of 1 nm in a quarter of an hour.
const FADED_MM_S: f64 = 1e-9;

/// What [`Changeover`] remembers.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct ChangeoverState {
    /// The second device's error just before the switch, in increments.
    pub second_stored_error: i64,
    /// Share of the speed command that takes over what was commanded before the switch, in mm/s.
    pub fade_mm_s: f64,
    /// Share that brought the motor back, in mm/s.
    pub return_mm_s: f64,
    /// [`Phase`] of the changeover.
    pub phase: u32,
    /// Scans the motor has stood in a row.
    pub settled_scans: u32,
    /// Scans spent in this phase.
    pub waited_scans: u32,
    /// Kept zero.
    pub reserved: u32,
}

impl ChangeoverState {
    /// Where the changeover stands.
    pub fn phase(&self) -> Phase {
        match self.phase {
            1 => Phase::Settling,
            2 => Phase::Returning,
            3 => Phase::Following,
            _ => Phase::FirstDrives,
        }
    }

    fn enter(&mut self, phase: Phase) {
        self.phase = phase as u32;
        self.settled_scans = 0;
        self.waited_scans = 0;
    }
}

impl Changeover {
    /// Switches to the second device, whose error counter and own speed command are now these.
    pub fn to_second(
        &self,
        state: &mut ChangeoverState,
        second_error: i64,
        before_mm_s: f64,
        own_mm_s: f64,
    ) {
        *state = ChangeoverState {
            phase: Phase::Settling as u32,
            second_stored_error: second_error,
            fade_mm_s: before_mm_s - own_mm_s,
            ..ChangeoverState::default()
        };
    }

    /// Switches back to the first device, whose own speed command is now this.
    pub fn to_first(&self, state: &mut ChangeoverState, before_mm_s: f64, own_mm_s: f64) {
        *state = ChangeoverState {
            fade_mm_s: before_mm_s - own_mm_s,
            ..ChangeoverState::default()
        };
    }

    /// One scan while the second device drives, in which the encoder has moved by `moved`; what is added to its speed command, in
    /// mm/s.
    pub fn update(&self, state: &mut ChangeoverState, moved: i64, second_error: i64) -> f64 {
        let stands = moved.saturating_abs() <= self.standing_increments;
        state.settled_scans = if stands {
            state.settled_scans.saturating_add(1)
        } else {
            0
        };
        state.waited_scans = state.waited_scans.saturating_add(1);
        let impatient = state.waited_scans > self.patience_scans;
        match state.phase() {
            Phase::FirstDrives | Phase::Following => {}
            Phase::Settling => {
                if state.settled_scans >= self.settle_scans || impatient {
                    match self.variant {
                        Variant::SettledDeviation => state.enter(Phase::Following),
                        Variant::ReturnToStand => state.enter(Phase::Returning),
                    }
                }
            }
            Phase::Returning => {
                let off = second_error.saturating_sub(state.second_stored_error);
                state.return_mm_s += self.return_gain_mm_s * off as f64;
                let back = off.saturating_abs() <= self.return_tolerance;
                if !back {
                    state.settled_scans = 0;
                }
                if state.settled_scans >= self.settle_scans || impatient {
                    state.enter(Phase::Following);
                }
            }
        }
        self.fade(&mut state.fade_mm_s) + state.return_mm_s
    }

    /// The fading share of this scan; of the first device, too.
    pub fn fade(&self, fade_mm_s: &mut f64) -> f64 {
        let now = *fade_mm_s;
        let next = now * self.fade_factor;
        *fade_mm_s = if next.abs() < FADED_MM_S { 0.0 } else { next };
        now
    }

    /// Whether the motor has settled in this phase, or never will.
    pub fn is_settled(&self, state: &ChangeoverState) -> bool {
        state.settled_scans >= self.settle_scans || state.waited_scans > self.patience_scans
    }

    /// The second device moves: whether the motor has settled is judged again from its next rest on.
    pub fn moves(&self, state: &mut ChangeoverState) {
        state.settled_scans = 0;
        state.waited_scans = 0;
    }
}

#[cfg(test)]
#[allow(clippy::panic, clippy::indexing_slicing)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const INCREMENT_MM: f64 = 1e-6;
    const SCAN_S: f64 = 1e-3;

    fn changeover(variant: Variant) -> Changeover {
        Changeover {
            variant,
            standing_increments: 1,
            settle_scans: 20,
            patience_scans: 2000,
            return_gain_mm_s: 50.0 * INCREMENT_MM * 0.01,
            return_tolerance: 20,
            fade_factor: 0.98,
        }
    }

    /// A motor that does what the speed command says, and drifts besides, as an amplifier with an offset makes it.
    struct Motor {
        drift_mm_s: f64,
        position: f64,
    }

    impl Motor {
        fn scan(&mut self, command_mm_s: f64) {
            self.position += (command_mm_s + self.drift_mm_s) * SCAN_S / INCREMENT_MM;
        }

        fn encoder(&self) -> i64 {
            libm::round(self.position) as i64
        }
    }

    /// Two devices with position loops of their own.
    struct Bench {
        block: Changeover,
        state: ChangeoverState,
        motor: Motor,
        encoder_before: i64,
        gains_per_s: [f64; 2],
        /// Of whichever device drives, and so of both.
        command: i64,
        speed_mm_s: f64,
        /// Largest step of the speed command in a scan with a switch, in mm/s.
        switch_step_mm_s: f64,
    }

    impl Bench {
        fn new(variant: Variant, drift_mm_s: f64, gains_per_s: [f64; 2]) -> Bench {
            Bench {
                block: changeover(variant),
                state: ChangeoverState::default(),
                motor: Motor {
                    drift_mm_s,
                    position: 0.0,
                },
                encoder_before: 0,
                gains_per_s,
                command: 0,
                speed_mm_s: 0.0,
                switch_step_mm_s: 0.0,
            }
        }

        fn error(&self) -> i64 {
            self.command - self.motor.encoder()
        }

        fn own_mm_s(&self, device: usize) -> f64 {
            self.gains_per_s[device] * self.error() as f64 * INCREMENT_MM
        }

        fn first_scan(&mut self, switch: bool) {
            let own_mm_s = self.own_mm_s(0);
            if switch {
                self.block
                    .to_first(&mut self.state, self.speed_mm_s, own_mm_s);
            }
            let speed_mm_s = own_mm_s + self.block.fade(&mut self.state.fade_mm_s);
            self.took(speed_mm_s, switch);
        }

        fn second_scan(&mut self, switch: bool, step: i64) {
            self.command += step;
            let (error, own_mm_s) = (self.error(), self.own_mm_s(1));
            if switch {
                self.block
                    .to_second(&mut self.state, error, self.speed_mm_s, own_mm_s);
            }
            let moved = self.motor.encoder() - self.encoder_before;
            let added = self.block.update(&mut self.state, moved, error);
            self.took(own_mm_s + added, switch);
        }

        fn took(&mut self, speed_mm_s: f64, switch: bool) {
            if switch {
                let step = (speed_mm_s - self.speed_mm_s).abs();
                self.switch_step_mm_s = self.switch_step_mm_s.max(step);
            }
            self.speed_mm_s = speed_mm_s;
            self.encoder_before = self.motor.encoder();
            self.motor.scan(speed_mm_s);
        }

        /// Rest under the first device.
        fn rest(&mut self, scans: usize) {
            for _ in 0..scans {
                self.first_scan(false);
            }
        }

        /// To the second until it may move.
        fn change_over(&mut self) {
            self.second_scan(true, 0);
            for _ in 0..5000 {
                if self.state.phase() == Phase::Following {
                    return;
                }
                self.second_scan(false, 0);
            }
            panic!("{:?} never ends", self.state.phase());
        }
    }

    #[test]
    fn a_drifting_motor_is_brought_back_in_the_one_variant_and_not_in_the_other() {
        for (variant, back) in [
            (Variant::SettledDeviation, false),
            (Variant::ReturnToStand, true),
        ] {
            let mut bench = Bench::new(variant, 0.05, [50.0, 20.0]);
            bench.rest(1000);
            // It stands with the error that holds the drift: 0.05 mm/s / 50 1/s = 1 µm.
            assert_eq!(bench.error(), -1000);
            let stood = bench.motor.encoder();
            bench.change_over();
            let drifted = bench.motor.encoder() - stood;
            // The second needs 2.5 µm to hold the drift.
            assert_eq!(
                drifted.abs() <= 20,
                back,
                "{variant:?}: {drifted} increments"
            );
            assert_eq!(bench.command, 0, "the command has not moved");
            // Back at the first, the motor stands where it stood.
            bench.first_scan(true);
            bench.rest(1000);
            assert!((bench.motor.encoder() - stood).abs() <= 1);
        }
    }

    #[test]
    fn a_motor_that_never_settles_is_not_waited_for_for_ever() {
        for variant in [Variant::SettledDeviation, Variant::ReturnToStand] {
            let block = changeover(variant);
            let mut state = ChangeoverState::default();
            block.to_second(&mut state, 0, 0.0, 0.0);
            let mut scans = 0;
            while state.phase() != Phase::Following {
                scans += 1;
                block.update(&mut state, 1000, -scans * 1000);
                assert!(scans <= 4010);
            }
        }
    }

    proptest! {
        #[test]
        fn through_any_sequence_of_switches_the_command_is_what_was_asked_for_and_the_speed_command_does_not_step(
            returns in any::<bool>(),
            drift_mm_s in -0.1f64..0.1,
            first_gain in 10.0f64..100.0,
            second_gain in 10.0f64..100.0,
            turns in prop::collection::vec((0usize..300, prop::collection::vec(-5_000i64..5_000, 0..100), 0usize..400), 1..6),
        ) {
            let variant = if returns { Variant::ReturnToStand } else { Variant::SettledDeviation };
            let mut bench = Bench::new(variant, drift_mm_s, [first_gain, second_gain]);
            for (rest, jog, wait) in turns {
                bench.rest(rest);
                let before = bench.command;
                bench.change_over();
                prop_assert_eq!(bench.command, before);
                for step in &jog {
                    bench.second_scan(false, *step);
                }
                for _ in 0..wait {
                    bench.second_scan(false, 0);
                }
                prop_assert_eq!(bench.command, before + jog.iter().sum::<i64>());
                bench.first_scan(true);
            }
            prop_assert!(bench.switch_step_mm_s <= 1e-12, "{} mm/s", bench.switch_step_mm_s);
        }
    }
}
