//! One axis of a new machine: what was given of it, and what follows.

use std::f64::consts::{PI, TAU};

use anyhow::{Context, anyhow, bail};
use machine::settings_file::N_PER_NM;
use monitor::words::shown;

/// Letters that an axis can have.
pub const LETTERS: &str = "X Y Z A B C U V W";
/// Inertia of a rotor with coupling for each N·m of its continuous torque, in kg·m²/(N·m): that of the machines that come with Quadrant.
const ROTOR_KG_M2_PER_NM: f64 = 2.4e-4;
/// The same of the lightest rotors: servo motors of low inertia have 1e-5 to 8e-5, and a coupling comes to it.
const ROTOR_KG_M2_PER_NM_MIN: f64 = 3e-5;
/// An estimated rotor is at least as heavy as this at the axis, in kg, with pinion or pulley.
const ROTOR_KG_MIN: f64 = 0.15;
/// What moves is at most so many times as heavy as an estimated rotor at the axis: with more, the loops by law are too fast for a
/// motor that is in its backlash.
const MASS_PER_ROTOR_MAX: f64 = 5.0;
/// Estimated motors have so much more continuous torque than the acceleration takes.
const TORQUE_RESERVE: f64 = 1.3;
/// Largest continuous torque of an estimated motor, in N·m: below what a machine file takes.
const TORQUE_NM_MAX: f64 = 8_000.0;
/// So much of the continuous torque of a motor that was given speeds the axis up, for a moment: its quick stop takes twice that.
const OVERLOAD: f64 = 1.5;
/// At most so much of an estimated motor's torque turns its own rotor.
const ROTOR_PART_MAX: f64 = 0.6;
/// At most so much of the torque of a motor is estimated to be friction, and told to be right where it was given.
const FRICTION_PART_MAX: f64 = 0.2;
const FRICTION_PART_GIVEN_MAX: f64 = 0.8;
/// An estimated mass is at least this, in kg, and an estimated rotor leaves it half of what the motor can speed up.
const MASS_KG_MIN: f64 = 1.0;
const MASS_PART_MIN: f64 = 0.5;
/// Screws and gears that are taken where none is given: the first that suits speed and acceleration.
const LEADS_MM: [f64; 7] = [10.0, 16.0, 20.0, 25.0, 32.0, 40.0, 50.0];
const GEARS: [f64; 6] = [90.0, 60.0, 40.0, 20.0, 10.0, 5.0];
/// Speed of an estimated motor at rapids, in turns per second: 3000 rev/min.
const MOTOR_TURNS_S: f64 = 50.0;
/// An estimated speed is reached in this time, in s.
const SPEEDS_UP_S_MAX: f64 = 1.0;
/// Friction at the two ends of a simulated bridge is that much less and more than half of it: as a carriage out of the middle makes it.
const OTHER_END_SHARE: f64 = 0.2;
/// Turns of the motor that the travel of an axis has at least that is homed by switch and index, so that both have their place.
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

/// What a motor has to speed an axis up with.
struct Motor {
    /// Continuous torque of the one that was given, or of the largest.
    torque_nm: f64,
    torque_given: bool,
    /// Inertia, if that was given.
    rotor: Option<f64>,
    /// Way of the axis for a radian of the motor.
    radius_m: f64,
}

impl Motor {
    /// Its continuous torque as a force at the axis.
    fn force_n(&self) -> f64 {
        self.torque_nm / self.radius_m
    }

    /// Its rotor at the axis that moves a mass, with so much inertia for each N·m where none was given.
    fn rotor_kg(&self, per_nm: f64, mass_kg: f64) -> f64 {
        let at_axis = |inertia_kg_m2: f64| inertia_kg_m2 / self.radius_m.powi(2);
        let estimated = || at_axis(per_nm * self.torque_nm).max(lightest_rotor_kg(mass_kg));
        self.rotor.map_or_else(estimated, at_axis)
    }

    /// Highest acceleration of a mass by a force. A larger motor does not help beyond where it turns little but itself.
    fn acceleration_m_s2(&self, force_n: f64, mass_kg: f64, per_nm: f64) -> f64 {
        let most = force_n / (mass_kg + self.rotor_kg(per_nm, mass_kg));
        match (self.torque_given, self.rotor) {
            (false, None) => most.min(ROTOR_PART_MAX * self.radius_m / (TORQUE_RESERVE * per_nm)),
            _ => most,
        }
    }

    /// Inertia for each N·m of the heaviest rotor that leaves the acceleration possible, where the force has so much to spare for it.
    fn rotor_per_nm(&self, spare_kg: f64, acceleration_m_s2: f64) -> f64 {
        let most = spare_kg * self.radius_m.powi(2) / self.torque_nm;
        if self.torque_given {
            return most;
        }
        most.min(ROTOR_PART_MAX * self.radius_m / (TORQUE_RESERVE * acceleration_m_s2))
    }
}

/// The lightest rotor that is estimated for a mass, in kg at the axis.
fn lightest_rotor_kg(mass_kg: f64) -> f64 {
    ROTOR_KG_MIN.max(mass_kg / MASS_PER_ROTOR_MAX)
}

/// Part of the torque of an estimated motor that its rotor takes for itself, with the usual rotor.
fn rotor_part(acceleration: f64, lead: f64) -> f64 {
    TORQUE_RESERVE * ROTOR_KG_M2_PER_NM * acceleration * TAU / lead
}

/// Whether an axis of this letter turns.
pub fn is_rotary(letter: &str) -> bool {
    matches!(letter, "A" | "B" | "C")
}

/// Keys and values as they were given.
struct Given<'t>(Vec<(&'t str, &'t str)>);

impl Given<'_> {
    fn text(&self, key: &str) -> Option<&str> {
        let mut given = self.0.iter();
        given
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
        let right = "must be SIZExTEETH with 5 teeth or more, such as 2x20";
        pair.with_context(|| format!("{key}={text}: {right}"))
            .map(Some)
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
        let speed = given.above_zero("speed")?;
        let acceleration = given.above_zero("acceleration")?;
        let (drive, ratio) = drive(given, rotary, |lead| {
            let rotor_part = acceleration.map_or(0.0, |of| rotor_part(of, lead));
            speed.unwrap_or(0.0) <= MOTOR_TURNS_S * lead && rotor_part <= ROTOR_PART_MAX
        })?;
        let lead = turn(drive) / ratio;
        let (other, key, moved) = match rotary {
            true => ("mass", "inertia", 0.5),
            false => ("inertia", "mass", 100.0),
        };
        if given.text(other).is_some() {
            bail!("{other}: axis {letter} has `{key}`");
        }
        let moved = given.above_zero(key)?.unwrap_or(moved);
        // Friction: seals and bearings, and 1 % of the weight on the guideways.
        let (fastest, usual, friction, gap) = match rotary {
            true => (120.0, 500.0, 5.0, 1.0),
            false => (250.0, 2000.0, rounded(100.0 + 0.1 * moved), 3.0),
        };
        let speed = speed.unwrap_or(rounded((MOTOR_TURNS_S * lead).min(fastest)));
        let acceleration = acceleration.unwrap_or(usual);
        let friction = given.above_zero("friction")?.unwrap_or(friction);
        let gap = given.number("gap", 0.0, true)?.unwrap_or(gap);
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
        if !axis.was_given("speed") {
            let reached = rounded(SPEEDS_UP_S_MAX * axis.acceleration);
            axis.speed = axis.speed.min(reached);
        }
        axis.fits()?;
        Ok(axis)
    }

    /// Its numbers go together.
    fn fits(&self) -> anyhow::Result<()> {
        let (low, high) = self.travel;
        if self.incremental && self.endless {
            bail!(
                "encoder=incremental: an axis that turns without end has no end for a switch to find: leave it out, for an absolute encoder, or give it a travel, as in travel=-180..180"
            );
        }
        let start = self.start;
        if !(low..=high).contains(&start) {
            bail!("start={start}: must be within the travel, {low} to {high}");
        }
        Ok(())
    }

    /// A motor that can do it. Of what was not given, friction, acceleration, rotor and mass give way to what was.
    fn motor(&mut self, given: &Given<'_>) -> anyhow::Result<()> {
        let (torque_nm, rotor) = (given.above_zero("torque")?, given.above_zero("rotor")?);
        let most = Motor {
            torque_nm: torque_nm.unwrap_or(TORQUE_NM_MAX),
            torque_given: torque_nm.is_some(),
            rotor,
            radius_m: self.radius_m(),
        };
        if self.was_given("friction") {
            let felt = self.other_end().friction_n() / most.force_n();
            if felt >= 1.0 {
                let right = FRICTION_PART_GIVEN_MAX * self.whole(self.friction) / felt;
                bail!(
                    "friction={}: is all that the motor can do: at most {} with {}",
                    self.whole(self.friction),
                    rounded_down(right),
                    self.motor_words(given)
                );
            }
        } else {
            let friction = FRICTION_PART_MAX * most.force_n() / self.newtons();
            self.friction = self.friction.min(rounded_down(friction));
        }
        let per_nm = self.speeds_up(given, &most)?;
        let radius_m = self.radius_m();
        let moves_nm = radius_m * (self.mass_kg() * self.acceleration_m_s2() + self.friction_n());
        // The rotor takes a part of the torque for itself, and is larger the larger the motor is.
        let rotor_m_s2 = TORQUE_RESERVE * self.acceleration_m_s2() / radius_m;
        let with_rotor_nm = |rotor: f64| TORQUE_RESERVE * moves_nm + rotor * rotor_m_s2;
        let lightest = lightest_rotor_kg(self.mass_kg()) * radius_m * radius_m;
        let estimated_nm = TORQUE_RESERVE * moves_nm / (1.0 - per_nm * rotor_m_s2);
        let needed_nm = match rotor {
            Some(rotor) => with_rotor_nm(rotor),
            None => estimated_nm.max(with_rotor_nm(lightest)),
        };
        self.torque_nm = torque_nm.unwrap_or(rounded_up(needed_nm).max(0.1));
        let estimated = rounded(per_nm * self.torque_nm).max(rounded_up(lightest));
        self.rotor_kg_m2 = rotor.unwrap_or(estimated);
        Ok(())
    }

    /// Acceleration and mass that the largest motor can do, as far as they were not given; what a rotor has for each N·m.
    fn speeds_up(&mut self, given: &Given<'_>, most: &Motor) -> anyhow::Result<f64> {
        let free_n = (most.force_n() - self.other_end().friction_n()) / TORQUE_RESERVE;
        if !self.was_given("acceleration") {
            let can = 1e3 * most.acceleration_m_s2(free_n, self.mass_kg(), ROTOR_KG_M2_PER_NM);
            self.acceleration = self.acceleration.min(rounded_down(can));
            return Ok(ROTOR_KG_M2_PER_NM);
        }
        let mass_given = self.was_given("mass") || self.was_given("inertia");
        let force_n = if mass_given && most.torque_given {
            OVERLOAD * most.force_n() - self.other_end().friction_n()
        } else {
            free_n
        };
        let mass_kg = if mass_given {
            self.mass_kg()
        } else {
            MASS_KG_MIN
        };
        let can = 1e3 * most.acceleration_m_s2(force_n, mass_kg, ROTOR_KG_M2_PER_NM_MIN);
        if self.acceleration > can {
            bail!(
                "acceleration={}: is more than the motor can do that turns itself too: at most {} with {}",
                self.acceleration,
                rounded_down(can),
                self.motor_words(given)
            );
        }
        let acceleration_m_s2 = self.acceleration_m_s2();
        let all_kg = force_n / acceleration_m_s2;
        if mass_given {
            let per_nm = most.rotor_per_nm(all_kg - mass_kg, acceleration_m_s2);
            return Ok(per_nm.min(ROTOR_KG_M2_PER_NM));
        }
        let per_nm = most.rotor_per_nm((1.0 - MASS_PART_MIN) * all_kg, acceleration_m_s2);
        let per_nm = per_nm.min(ROTOR_KG_M2_PER_NM);
        let beside_rotor_kg = (all_kg - most.rotor_kg(per_nm, 0.0))
            .min(all_kg / (1.0 + 1.0 / MASS_PER_ROTOR_MAX))
            .max(MASS_KG_MIN);
        let moved = rounded_down(beside_rotor_kg / self.per_slide());
        self.moved = self.moved.min(moved);
        Ok(per_nm)
    }

    /// What bounds the motor, as it was given, in words.
    fn motor_words(&self, given: &Given<'_>) -> String {
        const KEYS: [&str; 5] = ["mass", "inertia", "friction", "torque", "rotor"];
        let unit = if self.is_rotary() { "°" } else { " mm" };
        let way = format!("{}{unit} in one turn of the motor", shown(self.lead(), 4));
        let pairs = KEYS.iter().filter_map(|key| Some((key, given.text(key)?)));
        pairs.fold(way, |words, (key, value)| format!("{words}, {key}={value}"))
    }

    /// Of both motors where there are two.
    fn whole(&self, of_a_motor: f64) -> f64 {
        of_a_motor * if self.two_motors { 2.0 } else { 1.0 }
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
        self.mass_kg() + self.rotor_kg_m2 / self.radius_m().powi(2)
    }

    fn radius_m(&self) -> f64 {
        self.lead() * 1e-3 / TAU
    }

    /// Whether the switch that it is homed by has an index of the encoder behind it.
    pub fn has_index(&self) -> bool {
        (self.travel.1 - self.travel.0) / self.lead() >= HOMING_TURNS_MIN
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
        self.friction * self.newtons()
    }

    /// Newtons of the slide for each unit of force of its own: 1 of a slide.
    fn newtons(&self) -> f64 {
        if self.is_rotary() { N_PER_NM } else { 1.0 }
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
        let (letter, torque_nm) = (&self.letter, self.torque_nm);
        format!("{letter} {low} to {high}{unit}, {motors} {torque_nm} N·m")
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

/// What moves it, and the turns of the motor for one of that. A screw or gear that was not given `suits` by its way in a turn of the motor.
fn drive(
    given: &Given<'_>,
    rotary: bool,
    suits: impl Fn(f64) -> bool,
) -> anyhow::Result<(Drive, f64)> {
    let ratio = given.above_zero("ratio")?;
    let lead = given.above_zero("lead")?;
    let (rack, belt) = (given.teeth("rack")?, given.teeth("belt")?);
    let gear = given.above_zero("gear")?;
    if rotary {
        if lead.is_some() || rack.is_some() || belt.is_some() || ratio.is_some() {
            bail!("a rotary axis has gear=TURNS: turns of the motor for one of the axis");
        }
        let gear = gear.unwrap_or_else(|| first(&GEARS, |gear| suits(360.0 / gear)));
        return Ok((Drive::Table, gear));
    }
    if gear.is_some() {
        bail!("gear is for rotary axes (A, B, C): give ratio with lead, rack or belt");
    }
    let turns = ratio.unwrap_or(1.0);
    let drive = match (lead, rack, belt) {
        (None, None, None) => Drive::Screw(first(&LEADS_MM, |lead| suits(lead / turns))),
        (Some(lead), None, None) => Drive::Screw(lead),
        (None, Some((module, teeth)), None) => Drive::Rack(module, teeth),
        (None, None, Some((pitch, teeth))) => Drive::Belt(pitch, teeth),
        _ => bail!("one of lead, rack and belt"),
    };
    Ok((drive, turns))
}

/// The first that suits, or the last.
fn first(all: &[f64], suits: impl Fn(f64) -> bool) -> f64 {
    let fits = all.iter().find(|value| suits(**value));
    fits.or(all.last()).copied().unwrap_or_default()
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

/// The same, not above the number.
pub fn rounded_down(number: f64) -> f64 {
    let up = rounded(number);
    if up <= number {
        up
    } else {
        rounded(number / 1.05)
    }
}

fn rounded_up(number: f64) -> f64 {
    let down = rounded(number);
    if down >= number {
        down
    } else {
        rounded(number * 1.05)
    }
}
