//! The procedures: what an operator does to a machine, act by act.

use bus::sample::{Mode, OperatorRequest, Order, ProgramState};
use machine::{HomingMethod, ToolChanger};

use super::interruptions::{Interruption, SESSION, inwards, order};
use super::machines::Stand;
use crate::staying::Cell;

/// One act of an operator, or of fate.
pub enum Act {
    /// An order, once the machine rests as it wants it.
    Ask(fn(&mut Cell) -> OperatorRequest),
    /// Waits until it is so.
    Until(fn(&Cell) -> bool),
    /// The same, while an operator does what the program asks of him.
    Tended(fn(&Cell) -> bool),
    /// Something happens.
    Fate(Interruption),
}

/// What an operator does, from a machine that is ready.
pub struct Procedure {
    /// For people.
    pub name: &'static str,
    /// Its machine.
    pub stand: Stand,
    /// One after the other.
    pub acts: &'static [Act],
    /// The program that it runs ends where it says in every axis, whatever came between.
    pub ends_there: bool,
    /// It homes.
    pub homes: bool,
}

const HOME: Act = Act::Ask(|_| order(Order::Home));
const START: Act = Act::Ask(|_| order(Order::Start));
const RESUME: Act = Act::Ask(|_| order(Order::Resume));
const ENABLE: Act = Act::Ask(|_| order(Order::Enable));
const HOLD: Act = Act::Ask(|_| order(Order::Hold));

/// Ready, and nothing is being read.
const DONE: Act = Act::Until(is_done);
const TENDED: Act = Act::Tended(is_done);

fn is_done(of: &Cell) -> bool {
    let program = ProgramState::from_wire(of.now.program);
    let busy = matches!(program, Some(ProgramState::Loading | ProgramState::Running));
    of.mode() == Mode::Ready && !busy
}
const HOMED: Act = Act::Until(|of| of.mode() == Mode::Ready && of.is_homed());
const LOADED: Act = Act::Until(|of| of.now.program == ProgramState::Loaded as u32);
const MOVING: Act = Act::Until(|of| of.now.axes[0].velocity_mm_s.abs() > 20.0);
const RESTED: Act = Act::Until(|of| of.now.rested == 1);
const TRIPPED: Act = Act::Until(|of| {
    let mut axes = of.now.axes().iter();
    of.mode() == Mode::Tripped && axes.all(|axis| axis.velocity_mm_s.abs() < 0.5)
});
const ON: Act = Act::Until(|of| matches!(of.mode(), Mode::Enabled | Mode::Ready));
const TOOLS: Act = Act::Ask(|of| {
    of.load_of("G21 G90 G61\nT1 M6\nG0 X251\nT2 M6\nG0 X250\nM0\nG0 X252 Y200 Z-50\nM2\n")
});
const CUTS: Act = Act::Ask(|of| {
    of.load_of(
        "G21 G90 G64 P0.05\nG0 X-5 Y0\nG1 X20 F4000\nG2 X30 Y10 I0 J10\nG4 P0.05\nG1 X0 Y3\nM2\n",
    )
});
const FAR: Act = Act::Ask(|of| of.load_of("G21 G90\nG0 X-20\nG1 X20 Y5 F3000\nG1 X0 Y0\nM2\n"));

const fn homing(name: &'static str, stand: Stand) -> Procedure {
    Procedure {
        name,
        stand,
        acts: &[HOME, HOMED],
        ends_there: false,
        homes: true,
    }
}

const fn procedure(name: &'static str, stand: Stand, acts: &'static [Act]) -> Procedure {
    Procedure {
        name,
        stand,
        acts,
        ends_there: false,
        homes: false,
    }
}

/// One whose program ends where it says.
const fn program(name: &'static str, stand: Stand, acts: &'static [Act]) -> Procedure {
    Procedure {
        ends_there: true,
        ..procedure(name, stand, acts)
    }
}

const ALONE: Stand = Stand::Slides { standby: false };
const PAIRS: Stand = Stand::Slides { standby: true };
const MILL: Stand = Stand::Mill(ToolChanger::Changer);

/// All of them.
pub static PROCEDURES: &[Procedure] = &[
    homing(
        "homing by switch and index",
        Stand::Homed(HomingMethod::SwitchIndex),
    ),
    homing("homing by a switch", Stand::Homed(HomingMethod::Switch)),
    homing("homing by an index", Stand::Homed(HomingMethod::Index)),
    homing("homing by the drive", Stand::Homed(HomingMethod::Drive)),
    homing("homing of a gantry", Stand::Gantry { standby: false }),
    homing(
        "homing of a gantry with standbys",
        Stand::Gantry { standby: true },
    ),
    procedure(
        "switching a gantry on that is not homed",
        Stand::Gantry { standby: false },
        &[
            Act::Ask(|_| order(Order::Disable)),
            Act::Until(|of| of.mode() == Mode::Disabled),
            ENABLE,
            ON,
        ],
    ),
    program("a program", ALONE, &[CUTS, LOADED, START, DONE]),
    program(
        "a program with standbys",
        PAIRS,
        &[CUTS, LOADED, START, DONE],
    ),
    program(
        "tool changes and a stop",
        MILL,
        &[TOOLS, LOADED, START, TENDED],
    ),
    program(
        "tool changes by the operator",
        Stand::Mill(ToolChanger::Operator),
        &[TOOLS, LOADED, START, TENDED],
    ),
    program(
        "spindle to its speed and angle",
        MILL,
        &[
            Act::Ask(|of| {
                of.load_of("G21 G90\nS3000 M3 M8\nG1 X253 F3000\nS1500\nG1 X250\nM19 R90\nG1 X251 Y200 Z-50\nM5 M9\nM2\n")
            }),
            LOADED,
            START,
            DONE,
        ],
    ),
    program(
        "a rigid tap",
        MILL,
        &[
            Act::Ask(|of| {
                of.load_of("G21 G90\nG0 Z-49\nS600 M3\nG33.1 Z-54 K1\nM5\nG0 X250 Y200 Z-50\nM2\n")
            }),
            LOADED,
            START,
            DONE,
        ],
    ),
    procedure(
        "probing",
        MILL,
        &[
            Act::Ask(|of| {
                of.load_of("G21 G90 G0 Z-55\nG38.2 Z-70 F600\nG38.4 Z-50 F300\nG0 Z-55\nM66 P3 L0 Q0\nM2\n")
            }),
            LOADED,
            START,
            DONE,
        ],
    ),
    procedure(
        "touch-off",
        MILL,
        &[
            Act::Ask(|of| of.typed_of("G21 G91 G94\nG38.2 Z-12 F600\nG10 L20 P1 Z0\nG0 Z3\n")),
            DONE,
        ],
    ),
    program(
        "start at a line",
        MILL,
        &[
            Act::Ask(|of| {
                of.load_of(
                    "G21 G90 G61\nT1 M6\nS1000 M3\nG0 Z-10\nG0 X245 Y195\nG1 Z-15 F3000\nG1 X250\nM8\n\
                     G2 X255 Y200 J5\nG1 Y203\nG0 X255 Y203 Z-10\nM5\nM2\n",
                )
            }),
            LOADED,
            Act::Ask(|_| OperatorRequest {
                value: 9.0,
                ..order(Order::Start)
            }),
            DONE,
        ],
    ),
    program(
        "return to the path",
        ALONE,
        &[
            FAR,
            LOADED,
            START,
            MOVING,
            HOLD,
            RESTED,
            Act::Ask(|of| OperatorRequest {
                axis: 1,
                value: 2.0 * inwards(of, 1),
                ..order(Order::Jog)
            }),
            Act::Until(|of| of.mode() == Mode::Enabled),
            RESUME,
            DONE,
        ],
    ),
    procedure(
        "jog by a distance",
        ALONE,
        &[
            Act::Ask(|of| OperatorRequest {
                value: 2.0 * inwards(of, 0),
                ..order(Order::Jog)
            }),
            DONE,
        ],
    ),
    procedure(
        "jog in a direction",
        PAIRS,
        &[
            Act::Ask(|of| OperatorRequest {
                value: inwards(of, 0),
                session: SESSION + 1 + of.now.scan as u32,
                deadline_scans: 300,
                ..order(Order::JogOn)
            }),
            DONE,
        ],
    ),
    procedure(
        "jog along a line",
        ALONE,
        &[
            Act::Ask(|of| {
                let mut line = order(Order::Jog);
                (line.line_mm[0], line.line_mm[1]) = (2.0 * inwards(of, 0), inwards(of, 1));
                line
            }),
            DONE,
        ],
    ),
    procedure(
        "jog by a wheel",
        ALONE,
        &[
            Act::Ask(|of| wheel(of, 0)),
            Act::Ask(|of| wheel(of, 40)),
            DONE,
        ],
    ),
    procedure(
        "typed-in blocks",
        PAIRS,
        &[
            Act::Ask(|of| {
                let text = format!(
                    "G21 G91 G94\nG1 X{} Y1 F2000\nG4 P0.05\nG0 Y-1\n",
                    3.0 * inwards(of, 0)
                );
                of.typed_of(&text)
            }),
            DONE,
        ],
    ),
    program(
        "block by block",
        ALONE,
        &[
            FAR,
            LOADED,
            Act::Ask(|_| OperatorRequest {
                value: 1.0,
                ..order(Order::SingleBlock)
            }),
            START,
            TENDED,
        ],
    ),
    program(
        "emergency stop",
        ALONE,
        &[
            FAR,
            LOADED,
            START,
            MOVING,
            Act::Ask(|_| order(Order::EmergencyStop)),
            TRIPPED,
            ENABLE,
            ON,
            RESUME,
            DONE,
        ],
    ),
    program(
        "fault of a drive",
        PAIRS,
        &[
            FAR,
            LOADED,
            START,
            MOVING,
            Act::Fate(Interruption::DriveFault(0)),
            TRIPPED,
            ENABLE,
            ON,
            RESUME,
            DONE,
        ],
    ),
    program(
        "loss of a drive",
        ALONE,
        &[
            FAR,
            LOADED,
            START,
            MOVING,
            Act::Fate(Interruption::DriveLost(1)),
            TRIPPED,
            ENABLE,
            ON,
            RESUME,
            DONE,
        ],
    ),
];

fn wheel(of: &Cell, counts: i32) -> OperatorRequest {
    OperatorRequest {
        value: 0.05 * inwards(of, 0),
        session: SESSION,
        count: counts,
        ..order(Order::Wheel)
    }
}
