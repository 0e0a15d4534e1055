//! The two motors of a gantry: both have the same command position wherever nothing else gives them one, they are moved by hand
//! together, and the skew between them and the torques with which they pull against each other are guarded (docs/howto/gantry.md).

use bus::sample::{Cause, Driver, Mode, Reference};
use machine::{GantryPair, Machine};

use super::axes::Axes;
use super::axis_unit::AxisUnit;
use crate::drives::DriveCommand;

/// Time constant of what counts as a lasting difference of torques, in s.
const LASTING_S: f64 = 0.5;
/// A motor with less than this share of its rated torque pulls at nothing: what drives that are off show.
const SLACK_SHARE: f64 = 0.1;

/// A gantry as the master sees it.
#[derive(Debug, Clone)]
struct Gantry {
    pair: GantryPair,
    /// Torque of the second motor less that of the first, in percent of the rated ones, through a low-pass.
    difference_percent: f64,
    /// Neither motor is driven: the bridge relaxes.
    let_go: bool,
}

impl Gantry {
    fn new(pair: GantryPair) -> Gantry {
        Gantry {
            pair,
            difference_percent: 0.0,
            let_go: false,
        }
    }

    fn motors(&self) -> [usize; 2] {
        [self.pair.leader, self.pair.follower]
    }

    /// `d += (d_now − d)·T/τ`.
    fn take_torques(&mut self, axes: &[AxisUnit], scan_s: f64) {
        let [leader, follower] = self.motors().map(|motor| {
            let axis = axes.get(motor);
            axis.map_or(0.0, AxisUnit::torque_share)
        });
        let now_percent = 100.0 * (follower - leader);
        self.difference_percent += (now_percent - self.difference_percent) * scan_s / LASTING_S;
    }

    /// Whether the motors pull against each other; no number is too much.
    fn is_strained(&self) -> bool {
        let most_percent = self.pair.torque_difference_max_percent;
        !(-most_percent..=most_percent).contains(&self.difference_percent)
    }

    /// Whether its motors are to be homed: until then both count from one place.
    fn is_not_homed(&self, axes: &[AxisUnit]) -> bool {
        let mut motors = self.motors().into_iter();
        motors.any(|motor| axes.get(motor).is_some_and(|axis| !axis.is_homed()))
    }

    /// A fault of the two, shown as one of the second motor: what they know of their places is not believed any more.
    fn fault(&self, axes: &mut [AxisUnit], cause: Cause, code: f64) {
        let second = axes.get_mut(self.pair.follower);
        let code = (libm::round(code) as i32) as u32;
        if second.is_some_and(|axis| axis.fail_with(cause, code)) {
            self.forget_places(axes);
        }
    }

    fn forget_places(&self, axes: &mut [AxisUnit]) {
        for motor in self.motors() {
            let axis = axes.get_mut(motor);
            if let Some(axis) = axis.filter(|axis| axis.settings.homing.is_some()) {
                axis.set_reference(Reference::Missing);
            }
        }
    }
}

impl AxisUnit {
    fn torque_share(&self) -> f64 {
        self.drive().torque_nm / self.settings.motor.rated_torque_nm
    }
}

/// All gantries of the machine.
#[derive(Debug, Clone)]
pub(super) struct Gantries(Vec<Gantry>);

impl Gantries {
    pub fn new(machine: &Machine) -> Gantries {
        Gantries(machine.gantries().map(Gantry::new).collect())
    }

    /// The gantry whose first motor is that of this axis.
    pub fn led_by(&self, leader: usize) -> Option<GantryPair> {
        let mut gantries = self.0.iter();
        let gantry = gantries.find(|of| of.pair.leader == leader);
        gantry.map(|of| of.pair)
    }

    /// The motors of an axis: its own, and the second one of a gantry.
    pub fn motors_of(&self, axis: usize) -> impl Iterator<Item = usize> + use<> {
        let second = self.led_by(axis).map(|pair| pair.follower);
        [Some(axis), second].into_iter().flatten()
    }

    /// A bit for each second motor.
    pub fn followers(&self) -> u64 {
        let followers = self.0.iter().map(|of| of.pair.follower.min(63));
        followers.fold(0, |bits, follower| bits | 1 << follower)
    }

    /// Whether this is the second motor of an axis: no order names it.
    pub fn is_follower(&self, axis: usize) -> bool {
        self.0.iter().any(|of| of.pair.follower == axis)
    }

    /// Encoders that begin anywhere, or have lost their place: both motors count from where the first one does, so that skew is what
    /// it has become since. Only where neither motor pulls: what strains the bridge would count as square.
    pub fn align(&self, axes: &mut Axes) {
        for gantry in &self.0 {
            if !gantry.is_not_homed(axes) {
                continue;
            }
            let leader = axes.get(gantry.pair.leader);
            let place = leader.map(AxisUnit::feedback_position);
            let follower = axes.get_mut(gantry.pair.follower);
            if let (Some(place), Some(axis)) = (place, follower) {
                let apart = place.saturating_sub(axis.feedback_position());
                axis.count_from(axis.offset().saturating_add(apart));
            }
        }
    }

    /// Whether a gantry is to be let go before it is driven, so that its bridge relaxes and its motors are aligned.
    pub fn must_align(&self, axes: &Axes) -> bool {
        let mut gantries = self.0.iter();
        gantries.any(|of| of.is_not_homed(axes))
    }

    /// The first motor of those that are let go which still moves or pulls.
    pub fn not_slack(&self, axes: &Axes) -> Option<usize> {
        let let_go = self.0.iter().filter(|of| of.let_go);
        let_go.flat_map(Gantry::motors).find(|motor| {
            let slack = |axis: &AxisUnit| axis.stands() && axis.torque_share().abs() < SLACK_SHARE;
            !axes.get(*motor).is_none_or(slack)
        })
    }

    /// Gantries whose motors drive nothing in the next scan: those that are to be aligned, and in a trip, at rest, those that hold a
    /// bridge askew.
    pub fn let_go(&mut self, axes: &Axes, mode: Mode, relaxes: bool) {
        let lost = axes.has_lost_drive();
        for gantry in &mut self.0 {
            gantry.let_go = match mode {
                // A lost drive is started again first, and shows where it is then.
                Mode::Disabled => relaxes && !lost && gantry.is_not_homed(axes),
                Mode::Tripped => {
                    let mut motors = gantry.motors().into_iter();
                    let stand = motors.all(|motor| axes.get(motor).is_none_or(AxisUnit::stands));
                    let second = axes.get(gantry.pair.follower);
                    let askew = second.is_some_and(|axis| {
                        matches!(axis.cause(), Cause::Skew | Cause::GantryTorque)
                    });
                    gantry.let_go || stand && (askew || gantry.is_strained())
                }
                _ => false,
            };
        }
    }

    /// What the motors that are let go are commanded.
    pub fn command(&self, commands: &mut [DriveCommand]) {
        let let_go = self.0.iter().filter(|of| of.let_go);
        for motor in let_go.flat_map(Gantry::motors) {
            if let Some(command) = commands.get_mut(motor) {
                *command = DriveCommand::Disabled;
            }
        }
    }

    /// Out of the hand the second motor is commanded to be where the first is: a difference that a jog,
    /// switched-off drives or a trip have left is made up for as soon as the loops are closed.
    pub fn couple(&self, axes: &mut Axes) {
        for Gantry { pair, .. } in &self.0 {
            let by_program = |axis: &&AxisUnit| axis.hand.driver() == Driver::Program;
            let leader = axes.get(pair.leader).filter(by_program);
            let Some(place) = leader.map(AxisUnit::command_position) else {
                continue;
            };
            let follower = axes.get_mut(pair.follower);
            if let Some(axis) = follower.filter(|axis| axis.hand.driver() == Driver::Program) {
                axis.command_to(place);
            }
        }
    }

    /// The two motors of a gantry are homed together: what one has lost, the other does not know either.
    pub fn lose_references_together(&self, axes: &mut Axes) {
        for gantry in &self.0 {
            let [leader, follower] = gantry.motors().map(|motor| {
                let axis = axes.get(motor);
                axis.is_some_and(|axis| axis.reference() == Reference::Known)
            });
            if leader != follower {
                gantry.forget_places(axes);
            }
        }
    }

    /// One scan of what is guarded between two motors.
    pub fn judge(&mut self, axes: &mut Axes, mode: Mode, scan_s: f64) {
        let driven = mode.is_driven();
        if driven {
            self.judge_skew(axes);
        }
        self.judge_torques(axes, driven, scan_s);
    }

    /// A driven gantry whose skew is beyond its limit has a fault: of its second motor, with the skew in whole µm as its code.
    fn judge_skew(&self, axes: &mut Axes) {
        for gantry in &self.0 {
            let (Some(leader), Some(follower)) =
                (axes.get(gantry.pair.leader), axes.get(gantry.pair.follower))
            else {
                continue;
            };
            // Before both are homed, positions count from how they were when they were aligned.
            if leader.reference() != follower.reference() {
                continue;
            }
            let skew = follower
                .feedback_position()
                .saturating_sub(leader.feedback_position());
            let skew_mm = skew as f64 * follower.settings.increment_mm();
            if skew_mm.abs() > gantry.pair.skew_max_mm {
                gantry.fault(axes, Cause::Skew, skew_mm * 1e3);
            }
        }
    }

    /// A driven gantry whose motors pull against each other for too long has a fault: of its second motor, with the difference of their
    /// torques in whole percent of the rated ones as its code.
    fn judge_torques(&mut self, axes: &mut Axes, driven: bool, scan_s: f64) {
        for gantry in &mut self.0 {
            gantry.take_torques(axes, scan_s);
            if driven && gantry.is_strained() {
                let code = gantry.difference_percent;
                gantry.fault(axes, Cause::GantryTorque, code);
            }
        }
    }

    /// What the motors pulled with before counts no more.
    pub fn forget_torques(&mut self) {
        for gantry in &mut self.0 {
            gantry.difference_percent = 0.0;
        }
    }
}
