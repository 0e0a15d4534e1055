//! What comes between clicks beside other clicks: blocks, programs, orders, deaths.

use bus::sample::{Job, MAX_AXES, Mode, Order, ProgramState, Refused};
use machine::{Machine, PositionFeedback};
use plant_sim::script::rng::Rng;

use super::common::staying::Cell;
use super::{Bench, jogged};

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Meanwhile {
    /// Typed-in blocks, to their end.
    Typed,
    /// A program is loaded and runs to its end.
    Program,
    /// The planner dies while it reads typed-in blocks or a program, or while they run.
    DeadPlanner,
    /// A program is held, and what is left of it given up.
    Reset,
    /// Drives off and on.
    Disable,
    /// An axis trips, at rest or in a program.
    Trip,
    /// A servo dies, at rest or in a program: a trip as well, unless it has a standby.
    DeadServo,
    /// The master dies, at rest or in a program.
    DeadMaster,
    /// Homed again.
    Home,
}

pub const ALL: [Meanwhile; 9] = [
    Meanwhile::Typed,
    Meanwhile::Program,
    Meanwhile::DeadPlanner,
    Meanwhile::Reset,
    Meanwhile::Disable,
    Meanwhile::Trip,
    Meanwhile::DeadServo,
    Meanwhile::DeadMaster,
    Meanwhile::Home,
];

/// Who dies, and in how many scans.
type Death = Option<(u64, Job, usize)>;

impl Bench {
    /// It comes, and the machine is ready again. After what is carried out the command is exactly where it is to be; after what takes the
    /// drives' power it is what the encoder says, and stays.
    pub fn meanwhile(&mut self, what: Meanwhile) {
        let said = self.what.clone();
        self.what += &format!(", {what:?} in scan {}", self.cell.now.scan);
        self.until_rest();
        let axes = jogged(&self.cell.machine);
        let axis = *self.random.pick(&axes).expect("an axis");
        let standby = self.cell.machine.axes[axis].standby;
        match what {
            Meanwhile::Typed => self.runs(true, None),
            Meanwhile::Program => self.runs(false, None),
            Meanwhile::DeadPlanner => {
                let (typed, scans) = (self.random.one_in(2), self.random.below(600));
                self.runs(typed, Some((scans, Job::Planner, 0)));
            }
            Meanwhile::DeadServo if standby => {
                let (typed, scans) = (self.random.one_in(2), self.random.below(600));
                self.runs(typed, Some((scans, Job::Servo, axis)));
            }
            Meanwhile::Reset => self.resets(),
            Meanwhile::Home => self.homes(),
            Meanwhile::Disable => {
                self.obeys(Order::Disable);
                self.comes_back();
            }
            Meanwhile::Trip | Meanwhile::DeadServo | Meanwhile::DeadMaster => {
                self.perhaps_in_a_program();
                match what {
                    Meanwhile::Trip => self.cell.trips = Some(axis),
                    Meanwhile::DeadServo => self.cell.dies(Job::Servo, axis),
                    _ => self.cell.replace_master(),
                }
                self.comes_back();
            }
        }
        self.what = said;
    }

    /// An order is taken, once all is at rest and a program that has ended is left.
    fn obeys(&mut self, order: Order) {
        let mut refused = self.cell.order(order);
        for _ in 0..2_000 {
            if !matches!(refused, Refused::NotAtRest | Refused::Finished) {
                break;
            }
            self.cell.scan();
            refused = self.cell.order(order);
        }
        assert_eq!(refused, Refused::Not, "{}: {order:?}", self.what);
    }

    /// Blocks of moves in the directions of the middles of the travels, and what they move each motor, in increments.
    fn blocks(&mut self) -> (String, [i64; MAX_AXES]) {
        let mut ways = [0; MAX_AXES];
        let mut text = "G21 G91 G94\n".to_string();
        for code in ["G1 F3000", "G0", "G1"] {
            text += code;
            for axis in programmed(&self.cell.machine) {
                let settings = &self.cell.machine.axes[axis];
                let (increment_mm, name) = (settings.increment_mm(), settings.name.clone());
                let middle_mm = f64::midpoint(settings.travel_min_mm, settings.travel_max_mm);
                let from_mm = (self.at[axis] + ways[axis]) as f64 * increment_mm;
                let way_mm = size_mm(&mut self.random).copysign(middle_mm - from_mm);
                let way = (way_mm / increment_mm).round() as i64;
                text += &format!(" {name}{:.9}", way as f64 * increment_mm);
                for motor in self.motors(axis) {
                    ways[motor] += way;
                }
            }
            text += "\n";
        }
        (text, ways)
    }

    /// Has the cell take blocks, typed in or as a program.
    fn loads(&mut self, typed: bool) -> [i64; MAX_AXES] {
        let (text, ways) = self.blocks();
        let request = match typed {
            true => self.cell.typed_of(&text),
            false => self.cell.load_of(&(text + "M2\n")),
        };
        let refused = Refused::from_wire(self.cell.ask(&request).reason);
        assert_eq!(refused, Some(Refused::Not), "{}: load", self.what);
        ways
    }

    /// One scan in which somebody may die; an operator goes on where the machine then holds.
    fn scan_with(&mut self, death: &mut Death) {
        if let Some((scans, job, axis)) = death {
            if *scans == 0 {
                self.cell.dies(*job, *axis);
                *death = None;
            } else {
                *scans -= 1;
            }
        }
        self.scan();
        if self.cell.now.hold == 1 && self.cell.now.at_rest == 1 {
            self.cell.order(Order::Resume);
        }
    }

    /// Starts the program that is loading.
    fn starts(&mut self, death: &mut Death) {
        self.scan_with(death);
        while self.cell.now.program == ProgramState::Loading as u32 {
            self.scan_with(death);
        }
        self.obeys(Order::Start);
    }

    /// Blocks run to their end and move exactly what they say, a death meanwhile included.
    fn runs(&mut self, typed: bool, mut death: Death) {
        let ways = self.loads(typed);
        let run = self.cell.now.run + 1;
        if !typed {
            self.starts(&mut death);
        }
        while self.cell.now.run < run {
            self.scan_with(&mut death);
            let known = self.cell.now.scan < 10_000_000;
            assert!(known, "{}: it never begins", self.what);
        }
        self.at
            .iter_mut()
            .zip(ways)
            .for_each(|(at, way)| *at += way);
        while self.cell.mode() != Mode::Ready {
            self.scan_with(&mut death);
            assert!(
                self.cell.now.scan < 10_000_000,
                "{}: it never ends",
                self.what
            );
        }
        // In the scan that ends typed-in blocks the program from before is read again.
        self.scans(1);
        while self.cell.now.program == ProgramState::Loading as u32 {
            self.scans(1);
        }
    }

    /// A program runs for a while, as likely as not.
    fn perhaps_in_a_program(&mut self) {
        if self.random.one_in(2) {
            return;
        }
        self.loads(false);
        self.starts(&mut None);
        for _ in 0..self.random.below(300) {
            self.cell.scan();
        }
    }

    /// A program is held and given up: the axes stay where they came to rest.
    fn resets(&mut self) {
        self.loads(false);
        self.starts(&mut None);
        for _ in 0..=self.random.below(300) {
            self.cell.scan();
        }
        if self.cell.mode() == Mode::Enabled {
            self.obeys(Order::Hold);
        }
        self.obeys(Order::Reset);
        // In that scan, and from then on.
        self.at = self
            .cell
            .master
            .feedback()
            .axes
            .map(|axis| axis.command_position);
        self.scans(100);
    }

    fn homes(&mut self) {
        if self
            .cell
            .machine
            .axes
            .iter()
            .all(|axis| axis.homing.is_none())
        {
            return;
        }
        self.obeys(Order::Home);
        self.cell.scans(2);
        let homed = self.cell.until(60_000, |of| of.mode() == Mode::Ready);
        assert!(homed && self.cell.is_homed(), "{}", self.what);
        self.look();
        for (index, axis) in self.cell.machine.axes.iter().enumerate() {
            if let Some(rest_mm) = axis.rest_mm() {
                let rests = (rest_mm / axis.increment_mm()).round() as i64;
                assert_eq!(self.at[index], rests, "{}, axis {index}", self.what);
            }
        }
    }

    /// While the loops are open the command follows the encoder: after a trip at it, with the drives off as far from it as it was. Then the
    /// machine is made ready, and the command is what it was.
    fn comes_back(&mut self) {
        let powered = |of: &Cell| !matches!(of.mode(), Mode::Disabled | Mode::Tripped);
        self.cell.until(100, |of| !powered(of));
        assert!(!powered(&self.cell), "{}: it goes on", self.what);
        self.cell.scans(2);
        // The second motor of a gantry is commanded to be where the first is.
        let deviations = |of: &Cell| {
            let axes = jogged(&of.machine).into_iter().map(|axis| {
                let shown = &of.now.axes[axis];
                match of.machine.axes[axis].feedback {
                    PositionFeedback::Motor => shown.command_position - shown.motor_position,
                    PositionFeedback::Scale => shown.command_position - shown.scale_position,
                }
            });
            axes.collect::<Vec<i64>>()
        };
        let open = match self.cell.mode() {
            Mode::Tripped => vec![0; jogged(&self.cell.machine).len()],
            _ => deviations(&self.cell),
        };
        for _ in 0..1_000 {
            self.cell.scan();
            assert_eq!(deviations(&self.cell), open, "{}", self.what);
        }
        let running = self.cell.now.program == ProgramState::Running as u32;
        if running && self.cell.mode() == Mode::Tripped {
            self.obeys(Order::Reset);
        } else {
            self.obeys(Order::Enable);
        }
        let is_on = |of: &Cell| matches!(of.mode(), Mode::Ready | Mode::Enabled);
        assert!(
            self.cell.until(2_000, is_on),
            "{}: it does not come on",
            self.what
        );
        self.look();
        self.cell.scans(200);
        if self.cell.mode() == Mode::Enabled {
            self.obeys(Order::Reset);
        }
        self.cell.scans(1);
        let now = self.cell.now.axes.map(|axis| axis.command_position);
        assert_eq!(now, self.at, "{}", self.what);
        assert_eq!(self.cell.mode(), Mode::Ready, "{}", self.what);
    }
}

/// Axes that a block may name: not an arm, which is programmed by where its tool is.
fn programmed(machine: &Machine) -> Vec<usize> {
    let arm = machine.kinematics.as_ref().map(|of| of.arm_axis.clone());
    let named = |axis: &usize| arm.as_ref() != Some(&machine.axes[*axis].name);
    jogged(machine).into_iter().filter(named).collect()
}

/// A way of a block.
fn size_mm(random: &mut Rng) -> f64 {
    10f64.powf(random.between(-3.0, 0.6))
}
