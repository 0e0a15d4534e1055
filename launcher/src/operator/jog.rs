//! `jog`: by a distance, or in a direction as long as somebody renews the order.

use std::time::Duration;

use anyhow::anyhow;
use bus::observer::Held;
use bus::port::OperatorClient;
use bus::realtime;
use bus::sample::{Driver, Feedback, Mode, OperatorRequest, OperatorResponse, Order, Refused};

use super::Client;
use super::eyes::Eyes;
use crate::exit::{Failure, Kind, Outcome};
use crate::options::JogOptions;
use crate::signals::Signals;

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

/// `jog`.
pub fn jog(options: &JogOptions) -> Outcome {
    let (letter, direction) = letter_and_direction(&options.axis);
    let wrong = match (direction, options.distance) {
        (None, None) => Some(format!(
            "jog {letter}: how far? `jog {letter} 10` by a distance, `jog {letter}+` or `jog {letter}-` until Ctrl-C"
        )),
        (Some(_), Some(_)) => Some(format!(
            "jog {}: goes on until Ctrl-C and has no distance; `jog {letter} 10` has one",
            options.axis
        )),
        _ if options.speed.is_some_and(|speed| speed <= 0.0) => {
            Some("--speed: must be above 0 mm/min".into())
        }
        _ => None,
    };
    if let Some(wrong) = wrong {
        return Err(Failure::Input(anyhow!(wrong)));
    }
    let client = Client::to_order(options.to.cell.as_deref())?;
    let axis = client
        .machine
        .program_axis_index(&letter.to_uppercase())
        .map_err(|e| Failure::Input(anyhow!(e)))?;
    let speed_mm_s = options.speed.unwrap_or(0.0) / 60.0;
    match (direction, options.distance) {
        (Some(direction), _) => until_interrupted(&client, axis, direction, speed_mm_s),
        (None, distance) => by_distance(
            &client,
            axis,
            distance.unwrap_or(0.0),
            speed_mm_s,
            options.wait,
        ),
    }
}

/// A jog by a distance, in mm or degrees, at a speed, or 0 for that of the machine file: in which scan it was judged, and what came
/// of it, in words.
///
/// # Errors
/// It is refused, or nobody answers.
pub fn jog_by(
    client: &Client,
    axis: u32,
    way: f64,
    speed_mm_s: f64,
) -> Result<(u64, String), Failure> {
    let request = OperatorRequest {
        order: Order::Jog as u32,
        axis,
        value: way,
        speed_mm_s,
        ..OperatorRequest::default()
    };
    let answer = client.ask(Order::Jog, request)?;
    let (name, unit) = (name(client, axis), client.unit(axis));
    Ok((answer.scan, format!("jogging {name} by {way} {unit}")))
}

/// What the cell of a client shows now.
///
/// # Errors
/// It is silent.
pub fn look(client: &Client) -> Result<Feedback, Failure> {
    Eyes::open(client)?.look()
}

fn by_distance(client: &Client, axis: u32, way: f64, speed_mm_s: f64, waits: bool) -> Outcome {
    let mut eyes = Eyes::open(client)?;
    let (scan, words) = jog_by(client, axis, way, speed_mm_s)?;
    client.say(&words);
    if waits {
        eyes.until_jogged(scan, axis as usize)?;
        if let Some(outside) = client.outside(&eyes.look()?) {
            client.say(&format!("still outside: {outside}"));
        }
    }
    Ok(())
}

fn name(client: &Client, axis: u32) -> &str {
    let axis = client.machine.axes.get(axis as usize);
    axis.map_or("?", |axis| axis.name.as_str())
}

fn until_interrupted(client: &Client, axis: u32, direction: f64, speed_mm_s: f64) -> Outcome {
    let signals = Signals::catch().environment()?;
    let mut eyes = Eyes::open(client)?;
    let now = eyes.look()?;
    let deadline_scans = client.scans(DEADLINE);
    let asked = JogAsked {
        axis,
        direction,
        speed_mm_s,
        deadline_scans,
    };
    let mut sender = JogSender::begin(client, &asked, &now)?;
    let sign = if direction > 0.0 { '+' } else { '-' };
    client.say(&format!(
        "jogging {}{sign} until Ctrl-C",
        name(client, axis)
    ));
    let mut renewed = now.scan;
    let mut ordered_off = false;
    loop {
        let now = eyes.look()?;
        if now.scan > sender.began && !sender.moves(&now) {
            return ended(client, &now, axis, ordered_off);
        }
        if signals.count() > 0 && !ordered_off {
            sender.end()?;
            ordered_off = true;
        }
        let due = renewed + u64::from(deadline_scans) / RENEWALS;
        if !ordered_off && now.scan >= due {
            renewed = now.scan;
            // The look that follows tells why, should it be over.
            sender.renew(deadline_scans, 0.0)?;
        }
        std::thread::sleep(LOOK);
    }
}

/// The axis is at rest: where, and whether that was meant.
fn ended(client: &Client, now: &Feedback, axis: u32, ordered_off: bool) -> Outcome {
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

/// Whoever renews a continuous jog.
pub struct JogSender<'a> {
    client: &'a Client,
    place: Held<OperatorClient>,
    session: u32,
    axis: u32,
    /// Scan in which it was judged.
    pub began: u64,
}

impl<'a> JogSender<'a> {
    /// Begins one; `now` is what the cell shows.
    ///
    /// # Errors
    /// It is refused, or nobody answers.
    pub fn begin(
        client: &'a Client,
        asked: &JogAsked,
        now: &Feedback,
    ) -> Result<JogSender<'a>, Failure> {
        let (sender, request, answer) = JogSender::ask(client, asked, now)?;
        client.accepted(Order::JogOn, &request, answer)?;
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
        let (sender, request, answer) = JogSender::ask(client, asked, now)?;
        let reason = Refused::from_wire(answer.reason);
        if matches!(reason, Some(Refused::Jogging | Refused::NotAtRest)) {
            return Ok(None);
        }
        client.accepted(Order::JogOn, &request, answer)?;
        Ok(Some(sender))
    }

    fn ask(
        client: &'a Client,
        asked: &JogAsked,
        now: &Feedback,
    ) -> Result<(JogSender<'a>, OperatorRequest, OperatorResponse), Failure> {
        let session = session();
        let request = OperatorRequest {
            order: Order::JogOn as u32,
            axis: asked.axis,
            value: asked.direction,
            speed_mm_s: asked.speed_mm_s,
            latest_scan: now.scan + u64::from(asked.deadline_scans),
            session,
            deadline_scans: asked.deadline_scans,
        };
        let place = client.place()?;
        let answer = client.hear_by(&place, Order::JogOn, request)?;
        let sender = JogSender {
            client,
            place,
            session,
            axis: asked.axis,
            began: answer.scan,
        };
        Ok((sender, request, answer))
    }

    /// Whether the axis is jogged, as the cell shows it.
    pub fn moves(&self, now: &Feedback) -> bool {
        let axis = now.axes().get(self.axis as usize);
        axis.is_some_and(|axis| axis.driver != Driver::Program as u32)
    }

    /// Renews it, at another speed unless that is 0; false if it is over.
    ///
    /// # Errors
    /// It is refused for another reason, or nobody answers.
    pub fn renew(&mut self, deadline_scans: u32, speed_mm_s: f64) -> Result<bool, Failure> {
        let request = OperatorRequest {
            order: Order::JogRenew as u32,
            axis: self.axis,
            speed_mm_s,
            session: self.session,
            deadline_scans,
            ..OperatorRequest::default()
        };
        let answer = self.client.hear_by(&self.place, Order::JogRenew, request)?;
        if answer.reason == Refused::JogOver as u32 {
            return Ok(false);
        }
        self.client.accepted(Order::JogRenew, &request, answer)?;
        Ok(true)
    }

    /// Ends it: the axis comes to rest.
    ///
    /// # Errors
    /// Nobody answers.
    pub fn end(&mut self) -> Result<bool, Failure> {
        self.renew(0, 0.0)
    }
}

/// A name that no other continuous jog of the cell has had lately.
fn session() -> u32 {
    let nanoseconds = realtime::now_ns();
    let mixed =
        (nanoseconds ^ (u64::from(std::process::id()) << 40)).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    ((mixed >> 32) as u32).max(1)
}

#[cfg(test)]
mod tests {
    use super::letter_and_direction;

    #[test]
    fn a_sign_behind_the_letter_is_a_direction() {
        assert_eq!(letter_and_direction("X"), ("X", None));
        assert_eq!(letter_and_direction("x+"), ("x", Some(1.0)));
        assert_eq!(letter_and_direction("B-"), ("B", Some(-1.0)));
    }
}
