//! At both ends of the travel of every axis: no motion goes farther out, every motion goes in, and an axis that stands a little beyond
//! the end, as far as one in position may be off, is no reason to refuse anything.

use crate::common::load;
use crate::size;
use bus::sample::{Feedback, Mode, OperatorRequest, OperatorResponse, Order, PATH_AXES, Refused};
use lab::cell::InProcessCell;
use machine::Machine;
use path::kinematics::Kinematics;
use plant_sim::plant_file::PlantFile;

/// Those that have a simulated plant.
const MACHINES: [&str; 6] = [
    "xy",
    "xy-fast",
    "xy-torque",
    "xyz-mill",
    "xz-lathe",
    "xzb-pivot",
];
/// Ways of jogs and blocks, in mm or degrees.
const WAYS: [f64; 3] = [0.001, 0.12, 1.0];
const SCANS_MAX: u64 = 60_000;

/// One end of what an axis may reach.
#[derive(Debug, Clone)]
struct End {
    machine: &'static str,
    axis: usize,
    /// Of its axis in a program.
    letter: char,
    /// In the axis's own unit.
    at: f64,
    /// In a program, in machine coordinates.
    in_program: f64,
    inwards: f64,
    /// It is an end of the travel: the arm of a pivot ends at its range, which no jog knows.
    of_travel: bool,
}

fn ends(name: &'static str) -> Vec<End> {
    let (machine, _) = load(name);
    let kinematics = program::kinematics_of(&machine);
    let mut ends = Vec::new();
    for (axis, settings) in machine.axes.iter().enumerate() {
        let mut range = [settings.travel_min_mm, settings.travel_max_mm];
        let mut in_program = range;
        let mut letter = settings.name.chars().next().expect("a letter");
        let arm = match kinematics {
            Kinematics::PivotY(pivot) if pivot.arm == axis => Some(pivot),
            _ => None,
        };
        if let Some(pivot) = arm {
            range = [pivot.arm_min_deg, pivot.arm_max_deg];
            // In the numbers of a program, within it.
            in_program = <[f64; 2]>::from(pivot.reach_mm()).map(|y_mm| y_mm - 1e-6 * y_mm.signum());
            letter = 'Y';
        }
        for (side, inwards) in [1.0, -1.0].into_iter().enumerate() {
            ends.push(End {
                machine: name,
                axis,
                letter,
                at: range[side],
                in_program: in_program[side],
                inwards,
                of_travel: arm.is_none(),
            });
        }
    }
    ends
}

fn order(order: Order) -> OperatorRequest {
    OperatorRequest::of(order)
}

/// A cell whose axis begins so far inwards from the end, negative outside.
struct Stand {
    cell: InProcessCell,
    machine: Machine,
    end: End,
    now: Feedback,
    what: String,
}

impl Stand {
    fn new(end: &End, inside: f64, blocks: &str) -> Stand {
        let (machine, mut plant): (Machine, PlantFile) = load(end.machine);
        let name = &machine.axes[end.axis].name;
        let of_plant = plant.axes.iter_mut().find(|axis| axis.name == *name);
        of_plant.expect("its plant").start_position_mm = end.at + end.inwards * inside;
        let text = format!("G21 G90 G94\n{blocks}\nM2\n");
        let cell = InProcessCell::new(&machine, &plant, "end.ngc", &text);
        let mut stand = Stand {
            cell: cell.expect("a cell"),
            what: format!("{end:?}, {inside} inside: {blocks:?}"),
            machine,
            end: end.clone(),
            now: bytemuck::Zeroable::zeroed(),
        };
        stand.scan();
        // While the drives come on, its place follows its encoder.
        while stand.now.mode == Mode::Disabled as u32 && stand.scan() {}
        stand
    }

    fn scan(&mut self) -> bool {
        let published = self.cell.scan();
        if let Some(published) = &published {
            self.now = *published.feedback;
        }
        published.is_some()
    }

    /// Scans on until this is seen; nothing trips meanwhile.
    fn until(&mut self, seen: impl Fn(&Feedback) -> bool) {
        let until = self.now.scan + SCANS_MAX;
        while !seen(&self.now) {
            let goes_on = self.scan() && self.now.scan < until;
            let (mode, cause) = (Mode::from_wire(self.now.mode), self.now.cause);
            assert!(
                goes_on && mode != Some(Mode::Tripped),
                "{mode:?}, cause {cause} in scan {}: {}",
                self.now.scan,
                self.what,
            );
        }
    }

    fn scans(&mut self, scans: u64) {
        let until = self.now.scan + scans;
        self.until(|now| now.scan >= until);
    }

    fn order(&mut self, request: &OperatorRequest) -> OperatorResponse {
        self.cell.order(request)
    }

    fn obeyed(&mut self, request: &OperatorRequest) {
        let answer = self.order(request);
        let reason = Refused::from_wire(answer.reason);
        assert_eq!(reason, Some(Refused::Not), "{request:?}: {}", self.what);
    }

    fn refused(&mut self, request: &OperatorRequest, why: Refused) {
        let answer = self.order(request);
        let reason = Refused::from_wire(answer.reason);
        assert_eq!(reason, Some(why), "{request:?}: {}", self.what);
    }

    /// A jog, inwards where the way is above 0.
    fn jog(&self, way: f64) -> OperatorRequest {
        OperatorRequest {
            axis: self.end.axis as u32,
            value: self.end.inwards * way,
            ..order(Order::Jog)
        }
    }

    fn jog_on(&self, inwards: f64) -> OperatorRequest {
        OperatorRequest {
            axis: self.end.axis as u32,
            value: self.end.inwards * inwards,
            session: 7,
            deadline_scans: 1_000_000 / self.machine.scan.period_us,
            ..order(Order::JogOn)
        }
    }

    /// Jogs and comes to rest.
    fn jogged(&mut self, way: f64) {
        self.obeyed(&self.jog(way));
        self.until(|now| now.mode == Mode::Jogging as u32);
        self.until(|now| now.mode != Mode::Jogging as u32);
        self.rest();
    }

    /// As long at rest as an order by hand asks for.
    fn rest(&mut self) {
        self.scans(400);
    }

    /// In hold and at rest, in the wait of its program.
    fn held(&mut self) {
        self.until(|now| now.tag.dwell_remaining_scans > 0);
        self.obeyed(&order(Order::Hold));
        self.rest();
    }

    /// Off and on again, where it stands.
    fn off_and_on(&mut self) {
        self.obeyed(&order(Order::Disable));
        self.rest();
        self.obeyed(&order(Order::Enable));
        self.until(|now| now.mode == Mode::Enabled as u32);
        self.rest();
    }

    fn done(&mut self) {
        self.until(|now| now.mode == Mode::Finished as u32);
    }

    /// Distance inwards from the end at which it is commanded to be.
    fn inside(&self) -> f64 {
        let axis = &self.now.axes[self.end.axis];
        let at = axis.command_position as f64 * self.machine.axes[self.end.axis].increment_mm();
        (at - self.end.at) * self.end.inwards
    }

    fn is_inside_by(&self, expected: f64, within: f64) {
        let inside = self.inside();
        assert!(
            (inside - expected).abs() <= within,
            "{inside} inside, not {expected}: {}",
            self.what
        );
    }

    /// What an axis in position may be off.
    fn window(&self) -> f64 {
        self.machine.axes[self.end.axis].in_position_window_um() * 1e-3
    }
}

/// A block that moves the axis by this, inwards where it is above 0.
fn by(end: &End, way: f64) -> String {
    format!("G91 G1 {}{:.6} F600", end.letter, end.inwards * way)
}

/// Whether the planner takes these blocks from these command positions.
fn reads(machine: &Machine, start: [i64; PATH_AXES], blocks: &str) -> Result<(), String> {
    let text = format!("G21 G90 G94\n{blocks}\nM2\n");
    let text = planner::ProgramText::Here("end.ngc".into(), text.into());
    let survey = planner::survey(machine, &text, start, u64::MAX, |_| {});
    survey.map(|_| ()).map_err(|error| error.to_string())
}

fn all_ends() -> impl Iterator<Item = End> {
    MACHINES.into_iter().flat_map(ends)
}

#[test]
fn from_the_end_of_the_travel_an_axis_is_jogged_in_and_not_out_and_returns_to_its_path() {
    for end in size::one_in(3, all_ends()) {
        let (letter, in_program) = (end.letter, end.in_program);
        let to_end = format!("G53 G1 {letter}{in_program:.6} F3000");
        let blocks = format!("{to_end}\nG4 P2\n{}", by(&end, 1.0));
        let mut stand = Stand::new(&end, 2.0, &blocks);
        stand.held();
        stand.is_inside_by(0.0, 1e-5);
        for way in WAYS {
            if end.of_travel {
                let out = -0.001 - stand.inside().max(0.0);
                stand.refused(&stand.jog(out), Refused::BeyondTravel);
                if stand.inside() <= 0.0 {
                    stand.refused(&stand.jog_on(-1.0), Refused::TravelEnd);
                }
            }
            let began = stand.inside();
            stand.jogged(way);
            stand.is_inside_by(began + way, 1e-9);
            // Out to the end, to the increment.
            let back = stand.inside();
            if back > 0.0 {
                stand.jogged(-back);
                stand.is_inside_by(0.0, 1e-9);
            }
            stand.off_and_on();
        }
        stand.jogged(0.12);
        stand.obeyed(&order(Order::Resume));
        stand.done();
        if end.of_travel {
            stand.is_inside_by(1.0, 1e-9);
        }
    }
}

#[test]
fn an_axis_that_stands_outside_by_its_window_runs_programs_inwards_and_none_outwards() {
    for end in size::one_in(3, all_ends()) {
        let window = Stand::new(&end, 1.0, "").window();
        for (share, way) in [(0.0, 1.0), (0.5, 0.12), (0.99, 0.001)] {
            let mut stand = Stand::new(&end, -share * window, &by(&end, way));
            let began = stand.inside();
            stand.done();
            if end.of_travel {
                stand.is_inside_by(began + way, 1e-9);
            }
            let blocks = format!("G4 P2\n{}", by(&end, 1.0));
            let mut stand = Stand::new(&end, -share * window, &blocks);
            // What the block does not name stays where it stands; a return comes back there, from either side of the end.
            let began = stand.inside();
            stand.held();
            stand.is_inside_by(began, 1e-9);
            stand.off_and_on();
            if end.of_travel {
                stand.refused(&stand.jog(-0.001), Refused::BeyondTravel);
            }
            stand.jogged(0.5);
            stand.obeyed(&order(Order::Resume));
            stand.done();
            if end.of_travel {
                stand.is_inside_by(began + 1.0, 1e-9);
            }
            // Two increments of the program's numbers farther out are refused, from wherever the axis stands.
            let start = stand.now.program_start;
            let read = |blocks: &str| reads(&stand.machine, start, blocks).is_ok();
            assert!(!read(&by(&end, -0.000_002)), "{}", stand.what);
            assert!(!read(&format!(
                "{}\n{}",
                by(&end, 1.0),
                by(&end, -1.000_1 - began.max(0.0))
            )));
            assert!(read(&by(&end, 0.001)), "{}", stand.what);
        }
    }
}

#[test]
fn an_axis_farther_outside_than_its_window_is_moved_by_jogs_inwards_alone() {
    for end in all_ends().filter(|end| end.of_travel) {
        let mut stand = Stand::new(&end, -0.5, &by(&end, 1.0));
        stand.rest();
        stand.is_inside_by(-0.5, stand.window());
        assert_eq!(stand.now.hold, 1, "{}", stand.what);
        stand.refused(&order(Order::Resume), Refused::OutsideTravel);
        stand.refused(&stand.jog(-0.001), Refused::BeyondTravel);
        stand.refused(&stand.jog_on(-1.0), Refused::TravelEnd);
        stand.jogged(0.001);
        stand.jogged(0.12);
        stand.refused(&order(Order::Resume), Refused::OutsideTravel);
        stand.off_and_on();
        stand.obeyed(&stand.jog_on(1.0));
        stand.until(|now| now.mode == Mode::Jogging as u32);
        stand.until(|now| now.mode != Mode::Jogging as u32);
        stand.rest();
        assert!(stand.inside() > 0.0, "{}", stand.what);
        stand.obeyed(&order(Order::Resume));
        let began = stand.inside();
        stand.done();
        stand.is_inside_by(began + 1.0, 1e-9);
    }
}
