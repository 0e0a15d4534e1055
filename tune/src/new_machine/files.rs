//! The files of a new machine, with a word on every value.

use anyhow::Context;
use machine::{DriveMode, Machine, SECOND_MOTOR};

use super::axis::{Drive, NewAxis, rounded, rounded_down};
use crate::laws::Timing;
use crate::write::digits;

/// The program that comes with it, below its folder.
pub const PROGRAM: &str = "programs/first.ngc";
/// Largest radius of the circle in that program, in mm.
const RADIUS_MM_MAX: f64 = 20.0;
/// Longest stroke of an axis in that program, in mm or degrees.
const STROKE_MAX: f64 = 100.0;
/// Skew of a new gantry at which it trips, in mm.
const SKEW_MAX_MM: f64 = 0.2;
/// Fastest search for a home switch, in mm/s or degrees per second.
const SEARCH_MAX: f64 = 20.0;
/// A home switch without an index is so much of the travel from its end.
const SWITCH_SHARE: f64 = 0.25;
/// A search brakes with so much of the acceleration (docs/methods/two-controllers.md).
const JOG_ACCELERATION_SHARE: f64 = 0.2;
/// What joins the two ends of a gantry (docs/methods/physics.md, "A bridge between two motors").
const PLANT_BRIDGE: &str = "\n[axis.bridge]          # joins it to the axis of its letter\nstiffness_n_per_um = 20.0  # estimated\n";
/// Feed of that program, in mm/min.
const FEED_MM_MIN_MAX: f64 = 2000.0;

/// What the files are made of.
#[derive(Debug, Clone, Copy)]
pub struct Files<'a> {
    /// The machine's name.
    pub name: &'a str,
    /// Scan period, in µs.
    pub scan_us: u32,
    /// Step of the simulation, in µs.
    pub microstep_us: f64,
    /// Its axes.
    pub axes: &'a [NewAxis],
}

impl Files<'_> {
    /// Every file with its text.
    ///
    /// # Errors
    /// The machine cannot be one, with the reason.
    pub fn all(&self) -> anyhow::Result<[(&'static str, String); 3]> {
        Ok([
            ("machine.toml", self.machine()?),
            ("plant.toml", self.plant()),
            (PROGRAM, self.program()),
        ])
    }

    fn machine(&self) -> anyhow::Result<String> {
        let head = format!(
            "# Machine {name}: what the controller knows. Every key: `quadrant reference machine`, and the book.\n\
             # \"estimated\" are values that nobody gave; loops are by law from the mass. `quadrant tune` measures and sets them.\n\
             # Rotary axes are in degrees, kg·m² and N·m about the axis.\n\
             name = \"{name}\"\n\n\
             [scan]\n\
             period_us = {scan_us}\n\
             interpolation_period_scans = 8\n\
             look_ahead_periods = 2\n\
             watchdog_scans = {watchdog}          # an ordinary PC may stall 50 ms; 4 on a hard real-time one\n",
            name = self.name,
            scan_us = self.scan_us,
            watchdog = 50_000 / self.scan_us,
        );
        let drive_period_us = if self.scan_us.is_multiple_of(250) {
            250
        } else {
            self.scan_us
        };
        let timing = Timing {
            scan_s: f64::from(self.scan_us) * 1e-6,
            dead_time_scans: 1.0,
            drive_mode: DriveMode::Velocity,
            drive_period_s: f64::from(drive_period_us) * 1e-6,
        };
        let axes = self.axes.iter().enumerate();
        let text = axes.fold(head, |text, (index, axis)| {
            let text = text + &machine_axis(axis, &axis.letter, &timing, drive_period_us);
            text + &homing(axis, index, self.lifts(axis))
        });
        let text = self.second_motors().fold(text, |text, (input, axis)| {
            let name = format!("{}{SECOND_MOTOR}", axis.letter);
            let text = text + &machine_axis(axis, &name, &timing, drive_period_us);
            text + &gantry(axis) + &homing(axis, input, self.lifts(axis))
        });
        Machine::parse("machine.toml", &text).context("a machine of these axes cannot be")?;
        Ok(text)
    }

    fn plant(&self) -> String {
        let head = format!(
            "# What is true of the simulated machine {}; the controller does not read it. Every key: `quadrant reference plant`.\n\
             # In place of [axis.simple] an axis can have [axis.motor], [axis.screw] and [axis.table] with all that is known of it.\n\
             microstep_us = {:?}       # resolves the stiffest spring\n\
             ambient_c = 20.0\n",
            self.name, self.microstep_us
        );
        let axes = self.axes.iter().enumerate();
        let text = axes.fold(head, |text, (index, axis)| {
            let plant = plant_axis(&axis.one_end(), &axis.letter);
            text + &plant + &plant_homing(axis, index, self.lifts(axis))
        });
        self.second_motors().fold(text, |text, (input, axis)| {
            let name = format!("{}{SECOND_MOTOR}", axis.letter);
            let plant = plant_axis(&axis.other_end(), &name);
            text + &plant + PLANT_BRIDGE + &plant_homing(axis, input, self.lifts(axis))
        })
    }

    /// Whether an axis takes the tool off the work towards higher positions: Z and W do (ISO 841), and X and U of a lathe, which has
    /// no Y; or what was said of it. It is homed that way, and before the others.
    fn lifts(&self, axis: &NewAxis) -> bool {
        let has = |letter: &str| self.axes.iter().any(|axis| axis.letter == letter);
        axis.lifts.unwrap_or_else(|| match axis.letter.as_str() {
            "Z" | "W" => true,
            "X" | "U" => has("Z") && !has("Y"),
            _ => false,
        })
    }

    /// The axes that have one, each with the digital input of its switch.
    fn second_motors(&self) -> impl Iterator<Item = (usize, &NewAxis)> {
        let axes = self.axes.iter().filter(|axis| axis.two_motors);
        axes.enumerate()
            .map(|(index, axis)| (self.axes.len() + index, axis))
    }

    /// A circle where two slides span a plane; else there and back with every axis.
    fn program(&self) -> String {
        let mut text = format!(
            "(A first program for {}: each axis, then a circle where there are two slides.)\nG21 G90 G40\n",
            self.name
        );
        let slide = |letters: [&str; 2]| {
            let axis = |letter| self.axes.iter().find(|axis| axis.letter == letter);
            Some((axis(letters[0])?, axis(letters[1])?))
        };
        let planes = [
            ("G17", ["X", "Y"], "I"),
            ("G18", ["Z", "X"], "K"),
            ("G19", ["Y", "Z"], "J"),
        ];
        for axis in self.axes {
            let (low, high) = axis.travel;
            let stroke = (0.1 * (high - low)).min(STROKE_MAX);
            let away = axis.start
                + if axis.start + stroke > high {
                    -stroke
                } else {
                    stroke
                };
            text += &format!(
                "G0 {0}{1:.3}\nG0 {0}{2:.3}\n",
                axis.letter, away, axis.start
            );
        }
        let plane = planes
            .iter()
            .find_map(|(code, letters, offset)| Some((code, slide(*letters)?, offset)));
        if let Some((code, (first, second), offset)) = plane {
            let room =
                |axis: &NewAxis| (axis.start - axis.travel.0).max(axis.travel.1 - axis.start);
            let half = |axis: &NewAxis| 0.5 * (axis.travel.1 - axis.travel.0);
            let radius = RADIUS_MM_MAX.min(0.4 * half(first)).min(0.4 * half(second));
            let radius = rounded_down(radius.min(room(first)));
            let centre = |axis: &NewAxis| {
                axis.start
                    .clamp(axis.travel.0 + radius, axis.travel.1 - radius)
            };
            let (a, b) = (centre(first), centre(second));
            let feed = FEED_MM_MIN_MAX
                .min(30.0 * first.speed)
                .min(30.0 * second.speed);
            let begin = a - radius;
            text += &format!(
                "{code}\nG0 {0}{begin:.3} {1}{b:.3}\nG2 {0}{begin:.3} {1}{b:.3} {offset}{radius:.3} F{feed:.0}\nG0 {0}{2:.3} {1}{3:.3}\n",
                first.letter, second.letter, first.start, second.start
            );
        }
        text + "M2\n"
    }
}

/// What stands behind a value: nothing where it was given.
fn why(axis: &NewAxis, key: &str, otherwise: &str) -> String {
    if axis.was_given(key) {
        String::new()
    } else {
        format!("  # estimated{otherwise}")
    }
}

/// The transmission of an axis, with what follows from it.
fn transmission(axis: &NewAxis, table: &str) -> (String, String) {
    let ratio = axis.ratio;
    let lead = digits(axis.lead(), 5);
    let (unit, keys) = match axis.drive {
        Drive::Screw(lead) if ratio == 1.0 => {
            let why = why(axis, "lead", "").replace("  #", ",");
            let key =
                format!("lead_mm = {lead:?}          # travel in one turn of the motor{why}\n");
            return (key, String::new());
        }
        Drive::Screw(lead_mm) => (" mm", format!("screw_lead_mm = {lead_mm:?}\n")),
        Drive::Rack(module_mm, teeth) => (
            " mm",
            format!("rack_module_mm = {module_mm:?}\npinion_teeth = {teeth}\n"),
        ),
        Drive::Belt(pitch_mm, teeth) => (
            " mm",
            format!("belt_pitch_mm = {pitch_mm:?}\npulley_teeth = {teeth}\n"),
        ),
        Drive::Table => ("°", String::new()),
    };
    let ratio = match axis.drive {
        Drive::Table => format!("{:?}{}", 360.0 / axis.lead(), why(axis, "gear", "")),
        _ => format!("{ratio:?}"),
    };
    let table = format!(
        "\n[{table}]     # {lead}{unit} in one turn of the motor\n{keys}gear_ratio = {ratio}\n"
    );
    (String::new(), table)
}

/// Names and units of an axis's keys.
struct Words {
    kind: &'static str,
    length: &'static str,
    speed: &'static str,
    acceleration: &'static str,
    gain: &'static str,
}

impl Words {
    fn of(axis: &NewAxis) -> Words {
        if axis.is_rotary() {
            Words {
                kind: "kind = \"rotary\"         # in degrees\n",
                length: "deg",
                speed: "deg_s",
                acceleration: "deg_s2",
                gain: "gain_nm_s_per_rad",
            }
        } else {
            Words {
                kind: "",
                length: "mm",
                speed: "mm_s",
                acceleration: "mm_s2",
                gain: "gain_n_s_per_m",
            }
        }
    }
}

/// Increment of positions, in millionths of the unit, where the usual one is too coarse: a return to the path has a tenth of the
/// acceleration, and rounding of places may look like half of that, which is nine increments in a scan squared.
fn increment(axis: &NewAxis, scan_s: f64) -> Option<f64> {
    let most = axis.acceleration * scan_s * scan_s * 1e6 / 90.0;
    let finer = [1.0, 0.1, 0.01].into_iter().find(|of| *of <= most);
    finer.or(Some(0.01)).filter(|of| *of < 1.0)
}

fn machine_axis(axis: &NewAxis, name: &str, timing: &Timing, drive_period_us: u32) -> String {
    let words = Words::of(axis);
    let (lead, table) = transmission(axis, "axis.transmission");
    let gain = digits(
        timing.velocity_gain_n_s_per_m(axis.all_mass_kg()) / axis.per_slide(),
        4,
    );
    let limit = if axis.is_rotary() { 1.0 } else { 2.0 };
    let travel = match (axis.endless, axis.travel) {
        (true, _) => "modulo = true           # it turns without end\n".into(),
        (false, (low, high)) => format!(
            "travel_min_{0} = {low:?}\ntravel_max_{0} = {high:?}\n",
            words.length
        ),
    };
    let increment = increment(axis, timing.scan_s).map_or(String::new(), |finer| {
        let key = if axis.is_rotary() { "udeg" } else { "nm" };
        format!("increment_{key} = {finer:?}  # finer than usual, for so low an acceleration\n")
    });
    let peak = 3.0 * axis.torque_nm;
    let torque = why(axis, "torque", ": the acceleration with a reserve");
    format!(
        "\n[[axis]]\nname = \"{name}\"\n{kind}\
         {travel}{increment}rapid_{speed} = {rapid:?}{rapid_why}\n\
         acceleration_{acceleration} = {most:?}{most_why}\n\
         quick_stop_{acceleration} = {quick:?}  # braking, with the peak torque\n\
         following_error_limit_{length} = {limit:?}\n\
         {lead}drive_mode = \"velocity\"\n\
         {table}\n\
         [axis.motor]\nrated_torque_nm = {rated:?}{torque}\npeak_torque_nm = {peak:?}  # estimated: three times that\n\n\
         [axis.position_loop]\ngain_per_s = {position_gain:?}  # by law\n\n\
         [axis.velocity_loop]\n{gain_key} = {gain:?}  # by law, from the mass with the motor's\n\
         integral_time_ms = {integral:?}  # by law\nperiod_us = {drive_period_us}\n\n\
         [axis.feed_forward]\nadvance_ms = {advance:?}  # by law: the way of a command\n\n\
         [axis.reversal]\nmethod = \"none\"  # `quadrant tune` finds what the axis needs\n",
        kind = words.kind,
        length = words.length,
        speed = words.speed,
        acceleration = words.acceleration,
        rapid = axis.speed,
        rapid_why = why(axis, "speed", ""),
        most = axis.acceleration,
        most_why = why(axis, "acceleration", ""),
        quick = 2.0 * axis.acceleration,
        rated = axis.torque_nm,
        peak = digits(peak, 4),
        position_gain = digits(timing.position_gain_per_s(), 4),
        gain_key = words.gain,
        integral = digits(timing.integral_time_ms(), 4),
        advance = digits(timing.advance_ms(), 4),
    )
}

/// What a second motor is to its axis.
fn gantry(axis: &NewAxis) -> String {
    format!(
        "\n[axis.gantry]          # the second motor of {letter}: programs and operators name {letter} alone\n\
         leader = \"{letter}\"\nskew_max_mm = {SKEW_MAX_MM:?}      # estimated: what the bridge bears\n",
        letter = axis.letter,
    )
}

/// Where an axis with an incremental encoder has the switch that it is homed by and the reference point behind it, from the end of the
/// travel that it is homed at: a turn of the motor, and half a turn for the index; on a travel of few turns the switch alone, at a
/// quarter of it.
struct HomeEnd {
    switch_at: f64,
    reference_at: f64,
    /// Way from the switch to the end.
    room: f64,
}

impl HomeEnd {
    fn of(axis: &NewAxis, lifts: bool) -> HomeEnd {
        let (low, high) = axis.travel;
        let from_end = |way: f64| digits(if lifts { high - way } else { low + way }, 9);
        let room = SWITCH_SHARE * (high - low);
        let (room, reference) = match axis.has_index() {
            true => (axis.lead(), 0.5 * axis.lead()),
            false => (room, room),
        };
        HomeEnd {
            switch_at: from_end(room),
            reference_at: from_end(reference),
            room,
        }
    }

    /// Speed of a search that rests before the end, which is at least a fifth of a second away.
    fn search_speed(&self, axis: &NewAxis) -> f64 {
        let rests = (JOG_ACCELERATION_SHARE * axis.acceleration * self.room).sqrt();
        let most = SEARCH_MAX.min(5.0 * self.room).min(rests);
        rounded((0.1 * axis.speed).min(most))
    }
}

fn homing(axis: &NewAxis, input: usize, lifts: bool) -> String {
    if !axis.incremental {
        return String::new();
    }
    let words = Words::of(axis);
    let end = HomeEnd::of(axis, lifts);
    let search = end.search_speed(axis);
    let (method, reference) = match axis.has_index() {
        true => ("switch-index", "of the index behind the edge of the switch"),
        false => (
            "switch",
            "of the edge of the switch: the travel has few turns of the motor",
        ),
    };
    let (direction, order, why) = if lifts {
        ("positive", 1, "  # off the work, and before the others")
    } else {
        ("negative", 2, "")
    };
    format!(
        "\n[axis.homing]          # the encoder is incremental: `quadrant home` before anything else\n\
         method = \"{method}\"\nswitch_input = {input}\ndirection = \"{direction}\"{why}\n\
         search_{speed} = {search:?}  # estimated\nlatch_{speed} = {latch:?}  # estimated\n\
         position_{length} = {position:?}  # {reference}\norder = {order}\n",
        speed = words.speed,
        length = words.length,
        latch = rounded(0.1 * search),
        position = end.reference_at,
    )
}

fn plant_homing(axis: &NewAxis, input: usize, lifts: bool) -> String {
    if !axis.incremental {
        return String::new();
    }
    let length = Words::of(axis).length;
    let end = HomeEnd::of(axis, lifts);
    let (switch_at, index_at) = (end.switch_at, end.reference_at);
    let shows = digits(axis.travel.1 - axis.travel.0, 4);
    let actuated = if lifts { "actuated = \"above\"\n" } else { "" };
    format!(
        "\n[axis.encoder]         # incremental: it begins anywhere\nshows_{length} = {shows:?}\nindex_at_{length} = {index_at:?}\n\n\
         [axis.home_switch]\ndigital = {input}\nat_{length} = {switch_at:?}\n{actuated}"
    )
}

fn plant_axis(axis: &NewAxis, name: &str) -> String {
    let (lead, table) = transmission(axis, "axis.simple.transmission");
    let rotary = axis.is_rotary();
    let kind = Words::of(axis).kind;
    let (length, mass, force, gap) = if rotary {
        ("deg", "inertia_kg_m2", "coulomb_nm", "gap_mdeg")
    } else {
        ("mm", "mass_kg", "coulomb_n", "gap_um")
    };
    let stiffness = match axis.drive {
        Drive::Screw(_) => "stiffness_n_per_um = 120.0  # estimated\n",
        Drive::Rack(..) => "stiffness_n_per_um = 60.0  # estimated\n",
        Drive::Belt(..) => "stiffness_n_per_um = 20.0  # estimated\n",
        Drive::Table => "stiffness_nm_per_rad = 200_000.0  # estimated\n",
    };
    format!(
        "\n[[axis]]\nname = \"{name}\"\n{kind}start_position_{length} = {start:?}\n\n\
         [axis.simple]\n{mass} = {moved:?}{mass_why}\n\
         rotor_inertia_kg_m2 = {rotor:?}{rotor_why}\n\
         rated_torque_nm = {rated:?}\npeak_torque_nm = {peak:?}\n\
         {force} = {friction:?}{friction_why}\n{stiffness}\
         {gap} = {backlash:?}{gap_why}\n{lead}{table}",
        start = axis.start,
        moved = axis.moved,
        mass_why = match (axis.two_motors, axis.was_given("mass")) {
            (false, _) => why(axis, if rotary { "inertia" } else { "mass" }, ""),
            (true, true) => "  # half of what moves: each motor has one end of the bridge".into(),
            (true, false) => "  # estimated: half of what moves".into(),
        },
        rotor = axis.rotor_kg_m2,
        rotor_why = why(axis, "rotor", ": motor, coupling, screw or gear"),
        rated = axis.torque_nm,
        peak = digits(3.0 * axis.torque_nm, 4),
        friction = axis.friction,
        friction_why = if axis.two_motors {
            "  # at this end of the bridge: no two guideways are alike".into()
        } else {
            why(axis, "friction", ": in steady sliding, all of it")
        },
        backlash = axis.gap,
        gap_why = why(axis, "gap", ": backlash"),
    )
}

#[cfg(test)]
#[allow(clippy::expect_used)]
mod tests {
    use machine::HomingDirection;

    use super::*;

    fn machine_of(described: &[&str]) -> Machine {
        let axes = described.iter().map(|text| NewAxis::read(text));
        let axes: Vec<NewAxis> = axes.collect::<anyhow::Result<_>>().expect("axes");
        let files = Files {
            name: "homed",
            scan_us: 1000,
            microstep_us: 5.0,
            axes: &axes,
        };
        let text = files.machine().expect("a machine file");
        Machine::parse("machine.toml", &text).expect("a machine")
    }

    /// Letters of the axes of a machine in the order in which they are homed, those that are homed upwards with a `+`.
    fn homed(described: &[&str]) -> String {
        let machine = machine_of(described);
        let axes = machine.axes.iter().filter(|axis| !axis.is_follower());
        let mut homed: Vec<_> = axes.filter_map(|axis| Some((axis.homing?, axis))).collect();
        homed.sort_by_key(|(homing, _)| homing.order);
        let words = homed.iter().map(|(homing, axis)| {
            let up = homing.direction == HomingDirection::Positive;
            let name = format!("{}{}", axis.name, if up { "+" } else { "-" });
            // The reference point is near the end that it is looked for at.
            let middle_mm = 0.5 * (axis.travel_min_mm + axis.travel_max_mm);
            assert_eq!(homing.position_mm > middle_mm, up, "{name}");
            name
        });
        words.collect::<Vec<_>>().join(" ")
    }

    const X: &str = "X:travel=-200..200,encoder=incremental";
    const Y: &str = "Y:travel=-150..150,belt=5x24,ratio=5,encoder=incremental";
    const Z: &str = "Z:travel=-300..0,encoder=incremental";

    #[test]
    fn axes_that_lift_the_tool_are_homed_upwards_and_before_the_others() {
        assert_eq!(homed(&[X, Y, Z]), "Z+ X- Y-");
        assert_eq!(homed(&[Z, Y, X]), "Z+ Y- X-");
        assert_eq!(homed(&[X, "Y:travel=-150..150", Z]), "Z+ X-");
        let gantry = "X:travel=0..1200,rack=2x20,ratio=10,motors=2,encoder=incremental";
        let table = "A:travel=-90..90,encoder=incremental";
        assert_eq!(homed(&[table, gantry, Y, Z]), "Z+ A- X- Y-");
        let bridge = "Z:travel=0..400,motors=2,encoder=incremental";
        assert_eq!(homed(&[X, Y, bridge]), "Z+ X- Y-");
        let quill = "W:travel=-80..0,encoder=incremental";
        assert_eq!(homed(&[X, Y, "Z:travel=-300..0", quill]), "W+ X- Y-");
        // A lathe: X goes away from the axis of the spindle.
        assert_eq!(homed(&[Z, X]), "Z+ X+");
        assert_eq!(homed(&[X, Y]), "X- Y-");
    }

    #[test]
    fn what_is_said_of_an_axis_counts_more_than_its_letter() {
        let lifts = format!("{Y},lifts=yes");
        assert_eq!(homed(&[X, &lifts, Z]), "Y+ Z+ X-");
        let lies = format!("{Z},lifts=no");
        assert_eq!(homed(&[X, &lifts, &lies]), "Y+ X- Z-");
        let wrong = NewAxis::read("Z:travel=-300..0,lifts=up").expect_err("no word");
        let said = format!("{wrong:#}");
        assert!(said.contains("lifts=up: must be yes or no"), "{said}");
    }

    #[test]
    fn both_motors_of_a_bridge_that_lifts_are_homed_alike() {
        let machine = machine_of(&["Z:travel=0..400,motors=2,encoder=incremental"]);
        let ways: Vec<_> = machine.axes.iter().filter_map(|axis| axis.homing).collect();
        assert_eq!(ways.len(), 2);
        assert!(
            ways.iter()
                .all(|of| of.direction == HomingDirection::Positive)
        );
    }
}
