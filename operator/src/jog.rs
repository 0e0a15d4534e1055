//! `jog`: by a distance, or in a direction as long as somebody renews the order.

use std::time::Duration;

use anyhow::anyhow;
use bus::observer::Held;
use bus::port::OperatorClient;
use bus::realtime;
use bus::sample::{Driver, Feedback, Mode, OperatorRequest, OperatorResponse, Order, Refused};
use path::geometry::AxisVector;
use program::Modal;

use super::Client;
use super::client::probe_words;
use super::eyes::{Eyes, course};
use super::jog_tool;
use crate::options::JogOptions;
use console::exit::{Failure, Kind, Outcome};
use console::output::joined;
use console::signals::Signals;

/// Without a renewal the axis comes to rest after so long, counted in scans.
const DEADLINE: Duration = Duration::from_millis(200);
/// It is renewed so often in that time.
const RENEWALS: u64 = 4;
/// Time between two looks whether it is time to.
const LOOK: Duration = Duration::from_millis(2);
/// An axis that was stopped nearer than this to the end of its travel, in mm, was stopped by it.
const AT_END_MM: f64 = 0.2;

/// What `AXIS`, `AXIS+` or `AXIS-` asks for: the letter, and a direction.
fn letter_and_direction(text: &str) -> (&str, Option<f64>) {
    if let Some(letter) = text.strip_suffix('+') {
        return (letter, Some(1.0));
    }
    match text.strip_suffix('-') {
        Some(letter) => (letter, Some(-1.0)),
        None => (text, None),
    }
}

/// What is to be jogged.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Asked<'a> {
    /// These axes, each in a direction, until Ctrl-C.
    Held(Vec<(&'a str, f64)>),
    /// These axes, by distances or to places.
    By(Vec<(&'a str, f64)>),
}

/// Reads the words of an order; what is wrong with them.
fn asked(words: &[String]) -> Result<Asked<'_>, String> {
    let read = words.iter().map(|word| letter_and_direction(word));
    let held = read.filter_map(|(letter, way)| Some((letter, way?)));
    let held: Vec<_> = held.collect();
    if let Some((letter, _)) = held.first() {
        return match held.len() == words.len() {
            true => Ok(Asked::Held(held)),
            false => Err(format!(
                "jog {}: goes on until Ctrl-C and has no distance; `jog {letter} 10` has one",
                words.join(" ")
            )),
        };
    }
    let mut ways = Vec::new();
    for pair in words.chunks(2) {
        match pair {
            [letter, way] => {
                let number = way.parse::<f64>().ok().filter(|way| way.is_finite());
                let way = number.ok_or_else(|| {
                    format!("jog {letter} {way}: the distance is a number, as in `jog {letter} 10`")
                })?;
                ways.push((letter.as_str(), way));
            }
            _ => {
                let letter = pair.first().map_or("X", String::as_str);
                return Err(format!(
                    "jog {letter}: how far? `jog {letter} 10` by a distance, `jog {letter}+` or `jog {letter}-` until Ctrl-C"
                ));
            }
        }
    }
    Ok(Asked::By(ways))
}

/// `jog`.
pub fn jog(options: &JogOptions) -> Outcome {
    let bad = |wrong: String| Failure::Input(anyhow!(wrong));
    let asked = asked(&options.ways).map_err(bad)?;
    if options.speed.is_some_and(|speed| speed <= 0.0) {
        return Err(bad("--speed: must be above 0 mm/min".into()));
    }
    let client = Client::to_order(options.to.cell.as_deref())?;
    let (Asked::Held(words) | Asked::By(words)) = &asked;
    if jog_tool::is_asked(&client.machine, words, options) {
        return jog_tool::jog(&client, &asked, options);
    }
    let ways = ways_of(words, |letter| client.axis_index(letter))?;
    let speed_mm_s = options.speed.unwrap_or(0.0) / 60.0;
    match asked {
        Asked::Held(_) => until_interrupted(&client, &ways, speed_mm_s),
        Asked::By(_) => by_distances(&client, ways, speed_mm_s, options),
    }
}

/// Ways by axis, each letter once; `index` finds the axis of a letter in capitals.
pub(super) fn ways_of<I: PartialEq>(
    words: &[(&str, f64)],
    index: impl Fn(&str) -> Result<I, Failure>,
) -> Result<Vec<(I, f64)>, Failure> {
    let mut ways = Vec::new();
    for (letter, way) in words {
        let axis = index(&letter.to_uppercase())?;
        if ways.iter().any(|(other, _)| *other == axis) {
            return Err(Failure::Input(anyhow!("jog: {letter} is named twice")));
        }
        ways.push((axis, *way));
    }
    Ok(ways)
}

/// Jogs by distances, or to places, in mm or degrees.
fn by_distances(
    client: &Client,
    mut ways: Vec<(u32, f64)>,
    speed_mm_s: f64,
    options: &JogOptions,
) -> Outcome {
    let mut eyes = Eyes::open(client)?;
    let now = eyes.look()?;
    let places = Places::of(client, &now, options)?;
    let mut request = OperatorRequest {
        speed_mm_s,
        ..OperatorRequest::default()
    };
    if let Some(places) = &places {
        ways = places.ways(&ways);
        if ways.is_empty() {
            client.say("is there already");
            return Ok(());
        }
    }
    match ways.as_slice() {
        [(axis, way)] if places.is_none() => (request.axis, request.value) = (*axis, *way),
        // A place is counted from rest, where a line begins: it adds to nothing.
        ways => {
            for (axis, way) in ways {
                if let Some(line_mm) = request.line_mm.get_mut(*axis as usize) {
                    *line_mm = *way;
                }
            }
        }
    }
    let answer = client.hear(Order::Jog, request)?;
    if let Some(places) = &places
        && answer.reason == Refused::BeyondTravel as u32
    {
        return Err(client.refused(Order::Jog, &places.allowed(&answer)));
    }
    let answer = client.accepted(Order::Jog, answer)?;
    let words = ways.iter().map(|(axis, way)| {
        let (name, unit) = (client.axis_name(*axis), client.unit(*axis));
        format!("{name} by {} {unit}", rounded(*way))
    });
    client.say(&format!("jogging {}", joined(words, ", ")));
    if options.wait {
        let goals = ways.iter();
        let goals = goals.map(|(axis, way)| goal(client, &now, *axis, *way));
        let goals: Vec<(usize, i64)> = goals.collect();
        let rested = eyes.until_jogged(answer.scan, &goals)?;
        is_whole(client, &ways, &goals, &now, &rested)?;
        client.say("jogged");
        if let Some(outside) = client.outside(&eyes.look()?) {
            client.say(&format!("still outside: {outside}"));
        }
    }
    Ok(())
}

/// Whether a jog by distances was made whole, from what the cell showed before it and shows at its end. One that adds to another may
/// be taken back by others.
fn is_whole(
    client: &Client,
    ways: &[(u32, f64)],
    goals: &[(usize, i64)],
    before: &Feedback,
    now: &Feedback,
) -> Outcome {
    if before.mode == Mode::Jogging as u32 {
        return Ok(());
    }
    for ((axis, way), (index, goal)) in ways.iter().zip(goals) {
        let settings = client.machine.axes.get(*index);
        let Some((settings, shown)) = settings.zip(now.axes().get(*index)) else {
            continue;
        };
        let short_mm = (goal - shown.command_position) as f64 * settings.increment_mm();
        if short_mm * way.signum() > 0.0 {
            let (name, unit) = (&settings.name, client.unit(*axis));
            return Err(client.fails(&format!(
                "the jog was cut short, by hold, stop, a door, the end of the cell or another jog: {name} has gone {} of {} {unit}",
                rounded(way - short_mm),
                rounded(*way),
            )));
        }
    }
    Ok(())
}

/// Where an axis is to end that is jogged by a distance now, in increments.
fn goal(client: &Client, now: &Feedback, axis: u32, way: f64) -> (usize, i64) {
    let index = axis as usize;
    let settings = client.machine.axes.get(index);
    let increment_mm = settings.map_or(1.0, machine::Axis::increment_mm);
    let from = match now.axes().get(index) {
        Some(axis) if axis.driver == Driver::Manual as u32 => course(axis).target(),
        axis => axis.map_or(0, |axis| axis.command_position),
    };
    let way = (way / increment_mm).round() as i64;
    (index, from.saturating_add(way))
}

/// The numbers of a jog are places, not distances.
struct Places<'a> {
    client: &'a Client,
    now: Feedback,
    /// State whose work coordinates are meant; none for machine coordinates.
    state: Option<Modal>,
}

impl<'a> Places<'a> {
    fn of(
        client: &'a Client,
        now: &Feedback,
        options: &JogOptions,
    ) -> Result<Option<Places<'a>>, Failure> {
        if !options.to_work && !options.to_machine {
            return Ok(None);
        }
        let state = options.to_work.then(|| client.state_of_readout(now));
        Ok(Some(Places {
            client,
            now: *now,
            state: state.transpose()?,
        }))
    }

    /// Places of all axes as they read now, in mm or degrees.
    fn shown(&self) -> AxisVector {
        let machine = &self.client.machine;
        let work = |state| program::work_place(machine, &self.now, state);
        self.state.as_ref().and_then(work).unwrap_or_else(|| {
            let mut place = program::commanded(machine, &self.now);
            for (value, axis) in place.iter_mut().zip(&machine.axes) {
                *value = axis.shown(*value);
            }
            place
        })
    }

    /// Distances of the axes that have to move.
    fn ways(&self, places: &[(u32, f64)]) -> Vec<(u32, f64)> {
        let machine = &self.client.machine;
        let work = |state| program::ways_to_work(machine, &self.now, state, places);
        let all = self.state.as_ref().and_then(work).unwrap_or_else(|| {
            let (mut ways, shown) = (AxisVector::zeros(), self.shown());
            for (axis, place) in places {
                // The readout of a turning axis goes round; the axis does not.
                let index = *axis as usize;
                if let Some((way, shown)) = ways.get_mut(index).zip(shown.get(index)) {
                    *way = place - shown;
                }
            }
            ways
        });
        let named = (0u32..).zip(all.iter().copied());
        let named = named.take(machine.program_axes().len());
        let others = places.iter().filter_map(|(axis, place)| {
            let at = self.of_machine(*axis as usize)?;
            Some((*axis, place - at))
        });
        let moves = |(axis, way): &(u32, f64)| {
            let of = machine.axes.get(*axis as usize);
            of.is_some_and(|of| (way / of.increment_mm()).round() != 0.0)
        };
        named.chain(others).filter(moves).collect()
    }

    /// Place of an axis without a letter as it reads now: it has no work coordinates.
    fn of_machine(&self, index: usize) -> Option<f64> {
        let axis = self.client.machine.axes.get(index)?;
        let at = self.now.axes().get(index)?.command_position as f64;
        (!axis.has_letter()).then(|| axis.shown(at * axis.increment_mm()))
    }

    /// Where the axis of a refusal may be jogged to, as the places that were given are counted; under a rotation by the axis itself.
    fn allowed(&self, answer: &OperatorResponse) -> String {
        let (client, index) = (self.client, answer.axis as usize);
        let turns = |state: &Modal| {
            let way = |axis, way| {
                program::ways_to_work(&client.machine, &self.now, state, &[(axis, way)])
            };
            let shown = self.shown().get(index).copied().unwrap_or(0.0);
            way(answer.axis, shown + 1.0).is_some_and(|ways| {
                let mut others = ways.iter().enumerate();
                others.any(|(other, way)| other != index && way.abs() > 1e-9)
            })
        };
        let (name, unit) = (client.axis_name(answer.axis), client.unit(answer.axis));
        let (low, high) = (answer.allowed_min_mm, answer.allowed_max_mm);
        let beyond = Refused::BeyondTravel.words();
        if self.state.as_ref().is_some_and(turns) {
            return format!(
                "{beyond}: the work coordinates are turned, and from here axis {name} of the machine may go {low:+.3} to {high:+.3} {unit}"
            );
        }
        let of_machine = self.of_machine(index);
        let at = of_machine.or_else(|| self.shown().get(index).copied());
        let at = at.unwrap_or(0.0);
        let of = match self.state {
            Some(_) if of_machine.is_none() => "in work coordinates",
            _ => "of the machine",
        };
        let (low, high) = (at + low, at + high);
        format!(
            "{beyond}: from here {name} may be jogged to places from {low:.3} to {high:.3} {unit} {of}"
        )
    }
}

/// To a nanometre, without zeros behind it.
fn rounded(way: f64) -> f64 {
    (way * 1e6).round() / 1e6
}

/// An increment that is older than this is not taken.
pub(super) const CLICK_AGE: Duration = Duration::from_millis(200);

/// What came of an increment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Click {
    /// It was taken.
    Taken,
    /// It was cut at the end of the travel: so much of it was taken, in mm or degrees.
    Cut(f64),
    /// It was not: the axis has more to go, or the order came too late.
    NotTaken,
}

impl Click {
    /// What came of an increment of an axis, given as this number of a unit.
    pub fn words(self, client: &Client, axis: u32, shown: f64, unit: &str) -> String {
        let name = client.axis_name(axis);
        match self {
            Click::Taken => format!("{name} by {shown} {unit}"),
            Click::Cut(taken) => {
                let unit = client.unit(axis);
                format!("{name} by {taken:.3} {unit}: to the end of its travel")
            }
            Click::NotTaken => format!("not taken: {name} still moves"),
        }
    }
}

/// Gives an increment of a cell that somebody else has numbered in a session of theirs; `seen` is the newest scan that they knew. What came
/// of it, and in words.
///
/// # Errors
/// As of [`Clicks::click`]; the cell does not run or has no such axis.
pub fn click_numbered(
    cell: &str,
    letter: &str,
    way: f64,
    (session, number, seen): (u32, u32, u64),
) -> Result<(Click, String), Failure> {
    let client = Client::find(Some(cell), "clicks")?;
    let axis = client.axis_index(letter)?;
    let mut clicks = Clicks {
        session,
        number: number.saturating_sub(1),
        ..Clicks::of(&client)?
    };
    let click = clicks.click(axis, way, 0.0, seen)?;
    let words = click.words(&client, axis, way, client.unit(axis));
    Ok((click, words))
}

/// Who gives increments one after another. Each is numbered, so that none counts twice.
pub struct Clicks<'a> {
    client: &'a Client,
    place: Held<OperatorClient>,
    session: u32,
    number: u32,
}

impl<'a> Clicks<'a> {
    /// Takes a place among the clients of the cell.
    ///
    /// # Errors
    /// There is none left, or the cell has ended.
    pub fn of(client: &'a Client) -> Result<Clicks<'a>, Failure> {
        Ok(Clicks {
            client,
            place: client.place()?,
            session: session(),
            number: 0,
        })
    }

    /// Gives an increment, in mm or degrees, at a speed, or 0 for that of the machine file; `seen` is the newest scan that is known.
    ///
    /// # Errors
    /// It is refused for another reason than that there is more to go, or nobody answers.
    pub fn click(
        &mut self,
        axis: u32,
        way: f64,
        speed_mm_s: f64,
        seen: u64,
    ) -> Result<Click, Failure> {
        self.number += 1;
        let request = OperatorRequest {
            axis,
            value: way,
            speed_mm_s,
            latest_scan: seen + u64::from(self.client.scans(CLICK_AGE)),
            session: self.session,
            deadline_scans: self.number,
            ..OperatorRequest::default()
        };
        let answer = self.client.hear_by(&self.place, Order::Jog, request)?;
        let reason = Refused::from_wire(answer.reason);
        if matches!(reason, Some(Refused::Backlog | Refused::TooLate)) {
            return Ok(Click::NotTaken);
        }
        self.client.accepted(Order::Jog, answer)?;
        let of_axis = self.client.machine.axes.get(axis as usize);
        let increment_mm = of_axis.map_or(0.0, machine::Axis::increment_mm);
        let short_mm = way.abs() - answer.jogged_mm.abs();
        Ok(match short_mm > increment_mm {
            true => Click::Cut(answer.jogged_mm),
            false => Click::Taken,
        })
    }

    /// Brings to rest what goes by increments.
    ///
    /// # Errors
    /// Nobody answers.
    pub fn end(&mut self) -> Result<(), Failure> {
        let request = OperatorRequest {
            session: self.session,
            ..OperatorRequest::default()
        };
        // Where none was given it is refused, and nothing moves.
        self.client.hear_by(&self.place, Order::JogRenew, request)?;
        Ok(())
    }
}

fn until_interrupted(client: &Client, ways: &[(u32, f64)], speed_mm_s: f64) -> Outcome {
    let signals = Signals::catch().environment()?;
    let mut eyes = Eyes::open(client)?;
    let now = eyes.look()?;
    let deadline_scans = client.scans(DEADLINE);
    let asked = ways.iter().map(|(axis, direction)| JogAsked {
        axis: *axis,
        direction: *direction,
        speed_mm_s,
        deadline_scans,
    });
    let asked: Vec<JogAsked> = asked.collect();
    let Some((first, others)) = asked.split_first() else {
        return Ok(());
    };
    let mut sender = JogSender::begin(client, first, &now)?;
    let began = sender.began;
    for other in others {
        if let Err(refused) = sender.also(other, &now) {
            sender.end()?;
            return Err(refused);
        }
    }
    let words = ways.iter().map(|(axis, direction)| {
        let sign = if *direction > 0.0 { '+' } else { '-' };
        format!("{}{sign}", client.axis_name(*axis))
    });
    client.say(&format!("jogging {} until Ctrl-C", joined(words, " ")));
    let mut renewed = now.scan;
    let mut ordered_off = false;
    loop {
        let now = eyes.look()?;
        if now.scan > sender.began && !JogSender::moves(&now) {
            let mut ends = ways.iter();
            return ends.try_for_each(|(axis, _)| ended(client, &now, *axis, (began, ordered_off)));
        }
        if signals.count() > 0 && !ordered_off {
            sender.end()?;
            ordered_off = true;
        }
        let due = renewed + u64::from(deadline_scans) / RENEWALS;
        if !ordered_off && now.scan >= due {
            renewed = now.scan;
            // The look that follows tells why, should it be over.
            sender.renew(now.scan, deadline_scans, 0.0)?;
        }
        std::thread::sleep(LOOK);
    }
}

/// The axis is at rest: where, and whether that was meant.
fn ended(client: &Client, now: &Feedback, axis: u32, (began, ordered_off): (u64, bool)) -> Outcome {
    let settings = client.machine.axes.get(axis as usize);
    let feedback = now.axes().get(axis as usize);
    let Some((settings, feedback)) = settings.zip(feedback) else {
        return Ok(());
    };
    let at_mm = feedback.command_position as f64 * settings.increment_mm();
    let left_mm = (settings.travel_max_mm - at_mm).min(at_mm - settings.travel_min_mm);
    let (name, unit) = (&settings.name, client.unit(axis));
    let place = format!("{name} is at rest at {:.3} {unit}", settings.shown(at_mm));
    if now.mode == Mode::Tripped as u32 {
        return Err(client.fails("the machine has tripped"));
    }
    if let Some(words) = probe_words(now, began) {
        return Err(client.fails(&format!("{words}: {place}")));
    }
    if ordered_off {
        client.say(&format!("jogged: {place}"));
        return Ok(());
    }
    if left_mm < AT_END_MM {
        client.say(&format!("jogged to the end of the travel: {place}"));
        return Ok(());
    }
    Err(client.fails(&format!(
        "the jog has ended, by hold or stop, or because its order was not renewed in time: {place}"
    )))
}

/// What a continuous jog is to be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JogAsked {
    /// Index of the axis.
    pub axis: u32,
    /// 1 or -1.
    pub direction: f64,
    /// Speed, in mm/s; 0 for that of the machine file.
    pub speed_mm_s: f64,
    /// Scans without a renewal after which the axis comes to rest.
    pub deadline_scans: u32,
}

impl JogAsked {
    fn request(&self, session: u32, now: &Feedback) -> OperatorRequest {
        OperatorRequest {
            axis: self.axis,
            value: self.direction,
            speed_mm_s: self.speed_mm_s,
            latest_scan: now.scan + u64::from(self.deadline_scans),
            session,
            deadline_scans: self.deadline_scans,
            ..OperatorRequest::default()
        }
    }
}

/// Whoever renews a continuous jog.
pub struct JogSender<'a> {
    client: &'a Client,
    place: Held<OperatorClient>,
    session: u32,
    /// Scan in which it was judged.
    pub began: u64,
}

impl<'a> JogSender<'a> {
    /// Begins one; `now` is what the cell shows.
    ///
    /// # Errors
    /// It is refused, or nobody answers.
    pub fn begin(client: &'a Client, asked: &JogAsked, now: &Feedback) -> Result<Self, Failure> {
        let (sender, answer) = JogSender::ask(client, asked, now)?;
        client.accepted(Order::JogOn, answer)?;
        Ok(sender)
    }

    /// The same where an axis may still be coming to rest: none then.
    ///
    /// # Errors
    /// It is refused for another reason, or nobody answers.
    pub fn begin_soon(
        client: &'a Client,
        asked: &JogAsked,
        now: &Feedback,
    ) -> Result<Option<JogSender<'a>>, Failure> {
        let (sender, answer) = JogSender::ask(client, asked, now)?;
        let reason = Refused::from_wire(answer.reason);
        if matches!(reason, Some(Refused::Jogging | Refused::NotAtRest)) {
            return Ok(None);
        }
        client.accepted(Order::JogOn, answer)?;
        Ok(Some(sender))
    }

    /// Another axis goes along.
    ///
    /// # Errors
    /// It is refused, or nobody answers.
    pub fn also(&mut self, asked: &JogAsked, now: &Feedback) -> Result<(), Failure> {
        let request = asked.request(self.session, now);
        let answer = self.client.hear_by(&self.place, Order::JogOn, request)?;
        self.client.accepted(Order::JogOn, answer)?;
        Ok(())
    }

    fn ask(
        client: &'a Client,
        asked: &JogAsked,
        now: &Feedback,
    ) -> Result<(JogSender<'a>, OperatorResponse), Failure> {
        let session = session();
        let place = client.place()?;
        let answer = client.hear_by(&place, Order::JogOn, asked.request(session, now))?;
        let sender = JogSender {
            client,
            place,
            session,
            began: answer.scan,
        };
        Ok((sender, answer))
    }

    /// Whether axes are jogged, as the cell shows it.
    fn moves(now: &Feedback) -> bool {
        let mode = Mode::from_wire(now.mode);
        matches!(mode, Some(Mode::Jogging | Mode::Stopping))
    }

    /// Renews it, at another speed unless that is 0; false if it is over. The deadline counts from `seen`, the newest scan that is known.
    ///
    /// # Errors
    /// It is refused for another reason, or nobody answers.
    pub fn renew(
        &mut self,
        seen: u64,
        deadline_scans: u32,
        speed_mm_s: f64,
    ) -> Result<bool, Failure> {
        let request = OperatorRequest {
            speed_mm_s,
            latest_scan: match deadline_scans {
                0 => 0,
                scans => seen + u64::from(scans),
            },
            session: self.session,
            deadline_scans,
            ..OperatorRequest::default()
        };
        let answer = self.client.hear_by(&self.place, Order::JogRenew, request)?;
        if [Refused::JogOver as u32, Refused::TooLate as u32].contains(&answer.reason) {
            return Ok(false);
        }
        self.client.accepted(Order::JogRenew, answer)?;
        Ok(true)
    }

    /// Ends it: the axis comes to rest.
    ///
    /// # Errors
    /// Nobody answers.
    pub fn end(&mut self) -> Result<bool, Failure> {
        self.renew(0, 0, 0.0)
    }
}

/// A name that no other continuous jog of the cell has had lately.
pub(super) fn session() -> u32 {
    let nanoseconds = realtime::now_ns();
    let mixed =
        (nanoseconds ^ (u64::from(std::process::id()) << 40)).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    ((mixed >> 32) as u32).max(1)
}

#[cfg(test)]
mod tests {
    use super::{Asked, asked};

    #[test]
    fn an_axis_with_a_sign_is_held_and_axes_with_distances_make_a_line() {
        let words = |text: &str| -> Vec<String> { text.split(' ').map(str::to_owned).collect() };
        assert_eq!(asked(&words("x+")), Ok(Asked::Held(vec![("x", 1.0)])));
        let diagonal = Asked::Held(vec![("X", 1.0), ("B", -1.0)]);
        assert_eq!(asked(&words("X+ B-")), Ok(diagonal));
        let line = Asked::By(vec![("X", 1.0), ("Y", -2.0)]);
        assert_eq!(asked(&words("X 1 Y -2")), Ok(line));
        for (text, why) in [
            ("X", "how far?"),
            ("X 1 Y", "jog Y: how far?"),
            ("X+ 5", "has no distance"),
            ("X one", "is a number"),
        ] {
            let said = asked(&words(text)).expect_err(text);
            assert!(said.contains(why), "{text}: {said}");
        }
    }
}
