//! One axis of a new machine: what was given of it, and what follows.

use std::f64::consts::{PI, TAU};

use anyhow::{Context, anyhow, bail};
use machine::settings_file::N_PER_NM;

/// Letters that an axis can have.
pub const LETTERS: &str = "X Y Z A B C U V W";
/// Inertia of a rotor with coupling for each N·m of its continuous torque, in kg·m²/(N·m): that of the machines that come with Quadrant.
const ROTOR_KG_M2_PER_NM: f64 = 2.4e-4;
/// Estimated motors have so much more continuous torque than the acceleration takes.
const TORQUE_RESERVE: f64 = 1.3;
/// At most so much of a motor's torque turns its own rotor.
const ROTOR_PART_MAX: f64 = 0.6;
/// Speed of an estimated motor at rapids, in turns per second: 3000 rev/min.
const MOTOR_TURNS_S: f64 = 50.0;
/// Friction at the two ends of a simulated bridge is that much less and more than half of it: as a carriage out of the middle makes it.
const OTHER_END_SHARE: f64 = 0.2;
/// Turns of the motor that the travel of an axis has at least that is homed by switch and index.
const HOMING_TURNS_MIN: f64 = 4.0;
/// Keys of an axis.
const KEYS: &str = "travel, lead, rack, belt, gear, ratio, speed, acceleration, mass, inertia, torque, rotor, friction, gap, start, motors, encoder, lifts";

/// What moves the axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Drive {
    /// A screw of this lead, in mm.
    Screw(f64),
    /// A rack: module in mm and teeth of the pinion.
    Rack(f64, u32),
    /// A belt: pitch in mm and teeth of the pulley.
    Belt(f64, u32),
    /// A rotary table.
    Table,
}

/// One axis. A rotary one is in degrees, kg·m² and N·m where a slide is in mm, kg and N.
#[derive(Debug, Clone, PartialEq)]
pub struct NewAxis {
    /// Its letter.
    pub letter: String,
    /// Ends of its travel.
    pub travel: (f64, f64),
    /// It has none, and turns without end: half a turn to either side is there for the program to begin with.
    pub endless: bool,
    /// What moves it.
    pub drive: Drive,
    /// Turns of the motor for one of screw, pinion, pulley or table.
    pub ratio: f64,
    /// Highest speed, per second.
    pub speed: f64,
    /// Highest acceleration, per second².
    pub acceleration: f64,
    /// Mass or inertia that moves.
    pub moved: f64,
    /// Continuous torque of the motor, in N·m.
    pub torque_nm: f64,
    /// Inertia of what turns with the motor, in kg·m².
    pub rotor_kg_m2: f64,
    /// Friction, as felt at the axis.
    pub friction: f64,
    /// Backlash, in thousandths of the unit.
    pub gap: f64,
    /// Where it stands at first.
    pub start: f64,
    /// Two motors drive it, one at each end of a bridge; what moves, its friction and the motor are of one of them.
    pub two_motors: bool,
    /// It has incremental encoders, and a switch to be homed by.
    pub incremental: bool,
    /// Whether it takes the tool off the work towards higher positions, if that was said.
    pub lifts: Option<bool>,
    /// Keys that were given.
    given: Vec<String>,
}

/// Whether an axis of this letter turns.
pub fn is_rotary(letter: &str) -> bool {
    matches!(letter, "A" | "B" | "C")
}

/// Keys and values as they were given.
struct Given<'t>(Vec<(&'t str, &'t str)>);

impl Given<'_> {
    fn text(&self, key: &str) -> Option<&str> {
        self.0
            .iter()
            .find(|(name, _)| *name == key)
            .map(|(_, value)| *value)
    }

    /// A number above `low`, or at least it where it may be `low` itself.
    fn number(&self, key: &str, low: f64, may_be_low: bool) -> anyhow::Result<Option<f64>> {
        let Some(text) = self.text(key) else {
            return Ok(None);
        };
        let number: f64 = text
            .parse()
            .map_err(|_| anyhow!("{key}={text}: must be a number"))?;
        if !number.is_finite() || number < low || (number == low && !may_be_low) {
            let rule = if may_be_low { "at least" } else { "above" };
            bail!("{key}={text}: must be {rule} {low}");
        }
        Ok(Some(number))
    }

    fn above_zero(&self, key: &str) -> anyhow::Result<Option<f64>> {
        self.number(key, 0.0, false)
    }

    /// A size and teeth: `2x20`.
    fn teeth(&self, key: &str) -> anyhow::Result<Option<(f64, u32)>> {
        let Some(text) = self.text(key) else {
            return Ok(None);
        };
        let pair = text.split_once('x').and_then(|(size, teeth)| {
            let (size, teeth) = (size.parse::<f64>().ok()?, teeth.parse::<u32>().ok()?);
            (size > 0.0 && size.is_finite() && teeth >= 5).then_some((size, teeth))
        });
        match pair {
            Some(pair) => Ok(Some(pair)),
            None => bail!("{key}={text}: must be SIZExTEETH with 5 teeth or more, such as 2x20"),
        }
    }
}

impl NewAxis {
    /// Reads `X:travel=-200..200,lead=10,mass=100`.
    ///
    /// # Errors
    /// What cannot be read or does not fit together, with what would be right.
    pub fn read(text: &str) -> anyhow::Result<NewAxis> {
        let (letter, rest) = text.split_once(':').unwrap_or((text, ""));
        let letter = letter.to_uppercase();
        if !LETTERS.split(' ').any(|known| known == letter) {
            bail!("--axis {text}: {letter:?} is no axis: begin with one of {LETTERS}");
        }
        let given = given(rest).and_then(|given| Self::of(&letter, &given));
        given.with_context(|| format!("--axis {text}"))
    }

    fn of(letter: &str, given: &Given<'_>) -> anyhow::Result<NewAxis> {
        let rotary = is_rotary(letter);
        let (endless, travel) = travel_or_turn(given, rotary)?;
        let (drive, ratio) = drive(given, rotary)?;
        let lead = turn(drive) / ratio;
        let (other, key) = if rotary {
            ("mass", "inertia")
        } else {
            ("inertia", "mass")
        };
        if given.text(other).is_some() {
            bail!("{other}: axis {letter} has `{key}`");
        }
        let moved = given
            .above_zero(key)?
            .unwrap_or(if rotary { 0.5 } else { 100.0 });
        let speed = given.above_zero("speed")?;
        let speed = speed.unwrap_or(rounded((MOTOR_TURNS_S * lead).min(if rotary {
            120.0
        } else {
            250.0
        })));
        let acceleration = given.above_zero("acceleration")?;
        let acceleration = acceleration.unwrap_or(if rotary { 500.0 } else { 2000.0 });
        let friction = given.above_zero("friction")?;
        // Seals and bearings, and 1 % of the weight on the guideways.
        let friction = friction.unwrap_or(if rotary {
            5.0
        } else {
            rounded(100.0 + 0.1 * moved)
        });
        let gap = given
            .number("gap", 0.0, true)?
            .unwrap_or(if rotary { 1.0 } else { 3.0 });
        let two_motors = two_motors(given, rotary)?;
        let incremental = incremental(given)?;
        let half = if two_motors { 0.5 } else { 1.0 };
        let middle = 0.0_f64.clamp(travel.0, travel.1);
        let mut axis = NewAxis {
            letter: letter.to_string(),
            travel,
            endless,
            drive,
            ratio,
            speed,
            acceleration,
            moved: half * moved,
            torque_nm: 0.0,
            rotor_kg_m2: 0.0,
            friction: half * friction,
            gap,
            start: given.number("start", f64::MIN, true)?.unwrap_or(middle),
            two_motors,
            incremental,
            lifts: lifts(given)?,
            given: given.0.iter().map(|(key, _)| (*key).to_string()).collect(),
        };
        axis.motor(given)?;
        axis.fits()?;
        Ok(axis)
    }

    /// Its numbers go together.
    fn fits(&self) -> anyhow::Result<()> {
        let (low, high) = self.travel;
        if self.incremental && self.endless {
            bail!(
                "encoder=incremental: is for axes with a travel; give an endless one [axis.homing] by hand"
            );
        }
        let turns = (high - low) / self.lead();
        if self.incremental && turns < HOMING_TURNS_MIN {
            bail!(
                "encoder=incremental: the travel must be at least {HOMING_TURNS_MIN} turns of the motor, so that switch and index \
                 have their place: {} here",
                rounded(turns)
            );
        }
        if !(low..=high).contains(&self.start) {
            bail!(
                "start={}: must be within the travel, {low} to {high}",
                self.start
            );
        }
        Ok(())
    }

    /// A motor that can do it, where none is given.
    fn motor(&mut self, given: &Given<'_>) -> anyhow::Result<()> {
        let radius_m = self.lead() * 1e-3 / TAU;
        let needed_nm = radius_m * (self.mass_kg() * self.acceleration_m_s2() + self.friction_n());
        // The rotor takes a part of the torque for itself, and is larger the larger the motor is.
        let rotor_part = TORQUE_RESERVE * ROTOR_KG_M2_PER_NM * self.acceleration_m_s2() / radius_m;
        let torque_nm = given.above_zero("torque")?;
        let estimated = || {
            if rotor_part > ROTOR_PART_MAX {
                let most = self.acceleration * ROTOR_PART_MAX / rotor_part;
                bail!(
                    "acceleration={}: the motor would turn little but itself: at most {} with this lead or gear, \
                     or give torque and rotor",
                    self.acceleration,
                    rounded(most)
                );
            }
            Ok(rounded_up(TORQUE_RESERVE * needed_nm / (1.0 - rotor_part)).max(0.1))
        };
        self.torque_nm = torque_nm.map_or_else(estimated, Ok)?;
        let rotor = given.above_zero("rotor")?;
        self.rotor_kg_m2 = rotor.unwrap_or(rounded(ROTOR_KG_M2_PER_NM * self.torque_nm));
        Ok(())
    }

    /// Whether it turns.
    pub fn is_rotary(&self) -> bool {
        is_rotary(&self.letter)
    }

    /// Whether a key was given, and not estimated.
    pub fn was_given(&self, key: &str) -> bool {
        self.given.iter().any(|given| given == key)
    }

    /// Its way in one turn of the motor, in mm or degrees.
    pub fn lead(&self) -> f64 {
        turn(self.drive) / self.ratio
    }

    /// What moves with it, motor included, in kg of the slide that it is or that stands for it.
    pub fn all_mass_kg(&self) -> f64 {
        let radius_m = self.lead() * 1e-3 / TAU;
        self.mass_kg() + self.rotor_kg_m2 / (radius_m * radius_m)
    }

    /// Kilograms of the slide for each unit of its own: 1 of a slide.
    pub fn per_slide(&self) -> f64 {
        if self.is_rotary() {
            N_PER_NM * N_PER_NM
        } else {
            1.0
        }
    }

    fn mass_kg(&self) -> f64 {
        self.moved * self.per_slide()
    }

    fn friction_n(&self) -> f64 {
        self.friction * if self.is_rotary() { N_PER_NM } else { 1.0 }
    }

    fn acceleration_m_s2(&self) -> f64 {
        self.acceleration * 1e-3
    }

    /// It as the first motor has it: of a gantry, the end of the bridge that rubs less.
    pub fn one_end(&self) -> NewAxis {
        self.rubbing(1.0 - OTHER_END_SHARE)
    }

    /// The other end of the bridge, which rubs more by as much.
    pub fn other_end(&self) -> NewAxis {
        self.rubbing(1.0 + OTHER_END_SHARE)
    }

    fn rubbing(&self, share: f64) -> NewAxis {
        if !self.two_motors {
            return self.clone();
        }
        NewAxis {
            friction: rounded(share * self.friction),
            ..self.clone()
        }
    }

    /// It in a few words.
    pub fn summary(&self) -> String {
        let unit = if self.is_rotary() { "°" } else { " mm" };
        let (low, high) = self.travel;
        if self.endless {
            return format!("{} without end, motor {} N·m", self.letter, self.torque_nm);
        }
        let motors = if self.two_motors {
            "two motors of"
        } else {
            "motor"
        };
        format!(
            "{} {low} to {high}{unit}, {motors} {} N·m",
            self.letter, self.torque_nm
        )
    }
}

/// Splits `travel=-200..200,lead=10`.
fn given(text: &str) -> anyhow::Result<Given<'_>> {
    let mut all: Vec<(&str, &str)> = Vec::new();
    for pair in text.split(',').filter(|pair| !pair.is_empty()) {
        let Some((key, value)) = pair.split_once('=') else {
            bail!("{pair:?}: must be KEY=VALUE; keys are {KEYS}");
        };
        if !KEYS.split(", ").any(|known| known == key) {
            bail!("{key:?} is no key: {KEYS}");
        }
        if all.iter().any(|(other, _)| *other == key) {
            bail!("{key} is there twice");
        }
        all.push((key, value));
    }
    Ok(Given(all))
}

/// Whether it turns without end, and its travel; of one that does, a turn.
fn travel_or_turn(given: &Given<'_>, rotary: bool) -> anyhow::Result<(bool, (f64, f64))> {
    match given.text("travel") {
        Some("endless") if !rotary => bail!("travel=endless: is for rotary axes (A, B, C)"),
        Some("endless") => Ok((true, (-180.0, 180.0))),
        _ => Ok((false, travel(given)?)),
    }
}

fn travel(given: &Given<'_>) -> anyhow::Result<(f64, f64)> {
    let text = given
        .text("travel")
        .context("travel=LOW..HIGH is missing, such as travel=-200..200")?;
    let ends = text.split_once("..").and_then(|(low, high)| {
        let (low, high) = (low.parse::<f64>().ok()?, high.parse::<f64>().ok()?);
        (low < high && low.is_finite() && high.is_finite()).then_some((low, high))
    });
    ends.with_context(|| format!("travel={text}: must be LOW..HIGH, such as travel=-200..200"))
}

fn drive(given: &Given<'_>, rotary: bool) -> anyhow::Result<(Drive, f64)> {
    let ratio = given.above_zero("ratio")?;
    let (lead, rack, belt) = (
        given.above_zero("lead")?,
        given.teeth("rack")?,
        given.teeth("belt")?,
    );
    let gear = given.above_zero("gear")?;
    if rotary {
        if lead.is_some() || rack.is_some() || belt.is_some() || ratio.is_some() {
            bail!("a rotary axis has gear=TURNS: turns of the motor for one of the axis");
        }
        return Ok((Drive::Table, gear.unwrap_or(90.0)));
    }
    if gear.is_some() {
        bail!("gear is for rotary axes (A, B, C): give ratio with lead, rack or belt");
    }
    let drive = match (lead, rack, belt) {
        (None, None, None) => Drive::Screw(10.0),
        (Some(lead), None, None) => Drive::Screw(lead),
        (None, Some((module, teeth)), None) => Drive::Rack(module, teeth),
        (None, None, Some((pitch, teeth))) => Drive::Belt(pitch, teeth),
        _ => bail!("one of lead, rack and belt"),
    };
    Ok((drive, ratio.unwrap_or(1.0)))
}

/// Whether two motors drive it.
fn two_motors(given: &Given<'_>, rotary: bool) -> anyhow::Result<bool> {
    match given.text("motors") {
        None | Some("1") => Ok(false),
        Some("2") if rotary => bail!("motors=2: is for slides (X, Y, Z, U, V, W)"),
        Some("2") => Ok(true),
        Some(other) => bail!("motors={other}: must be 1 or 2"),
    }
}

/// Whether its encoder is incremental.
fn incremental(given: &Given<'_>) -> anyhow::Result<bool> {
    match given.text("encoder") {
        None | Some("absolute") => Ok(false),
        Some("incremental") => Ok(true),
        Some(other) => bail!("encoder={other}: must be absolute or incremental"),
    }
}

/// Whether it is said to lift.
fn lifts(given: &Given<'_>) -> anyhow::Result<Option<bool>> {
    match given.text("lifts") {
        None => Ok(None),
        Some("yes") => Ok(Some(true)),
        Some("no") => Ok(Some(false)),
        Some(other) => bail!("lifts={other}: must be yes or no"),
    }
}

/// Way of the axis in one turn of screw, pinion, pulley or table.
fn turn(drive: Drive) -> f64 {
    match drive {
        Drive::Screw(lead) => lead,
        Drive::Rack(module, teeth) => PI * module * f64::from(teeth),
        Drive::Belt(pitch, teeth) => pitch * f64::from(teeth),
        Drive::Table => 360.0,
    }
}

/// Two significant digits, as people write an estimate.
pub fn rounded(number: f64) -> f64 {
    format!("{number:.1e}").parse().unwrap_or(number)
}

fn rounded_up(number: f64) -> f64 {
    let down = rounded(number);
    if down >= number {
        down
    } else {
        rounded(number * 1.05)
    }
}
