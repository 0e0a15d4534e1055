//! `wheel`: an axis follows the running count of a wheel, read from standard input.

use std::io::{BufRead, stdin};
use std::sync::mpsc::{Receiver, Sender, TryRecvError, channel};
use std::time::Duration;

use anyhow::anyhow;
use bus::observer::Held;
use bus::port::OperatorClient;
use bus::sample::{Driver, Feedback, OperatorRequest, OperatorResponse, Order, Refused};
use machine::Axis;

use super::Client;
use super::client::probe_words;
use super::eyes::{Eyes, course};
use super::jog::{CLICK_AGE, session};
use crate::options::WheelOptions;
use console::exit::{Failure, Kind, Outcome};
use console::signals::Signals;

/// Time between two looks at what was read.
const LOOK: Duration = Duration::from_millis(5);

/// What a line says: a count, a blank one nothing.
fn count(number: usize, line: &str) -> Result<Option<i32>, String> {
    match line.trim() {
        "" => Ok(None),
        // It goes on behind the largest number with the smallest.
        text => match text.parse::<i64>() {
            Ok(count) => Ok(Some(count as i32)),
            Err(_) => Err(format!(
                "line {number} of standard input: {text:?} is no running count, a whole number such as 42"
            )),
        },
    }
}

/// Reads counts until the end of input, or what is none.
fn read(counts: &Sender<Result<i32, String>>) {
    for (index, line) in stdin().lock().lines().enumerate() {
        let line = line.map_err(|error| format!("standard input cannot be read: {error}"));
        let read = line.and_then(|line| count(index + 1, &line)).transpose();
        let ends = matches!(read, Some(Err(_)));
        if read.is_some_and(|read| counts.send(read).is_err()) || ends {
            return;
        }
    }
}

/// `wheel`.
pub fn wheel(options: &WheelOptions) -> Outcome {
    if options.per_count == 0.0 {
        return Err(Failure::Input(anyhow!(
            "wheel {} {}: a count is a distance other than 0, as in `wheel {0} 0.01`",
            options.axis,
            options.per_count
        )));
    }
    let client = Client::to_order(options.to.cell.as_deref())?;
    let axis = client.axis_index(&options.axis)?;
    let Some(settings) = client.machine.axes.get(axis as usize) else {
        return Ok(());
    };
    let signals = Signals::catch().environment()?;
    let (sender, counts) = channel();
    std::thread::spawn(move || read(&sender));
    let mut eyes = Eyes::open(&client)?;
    let began_in = eyes.look()?.scan;
    let mut follows = Follows {
        client: &client,
        eyes,
        place: client.place()?,
        settings,
        request: OperatorRequest {
            axis,
            value: options.per_count,
            session: session(),
            velocity_mode: options.velocity.into(),
            ..OperatorRequest::default()
        },
        began: false,
        turned: 0,
        taken: 0,
        said: None,
        stopped_in: began_in,
    };
    let way = format!(
        "{} by {} {} a count",
        settings.name,
        options.per_count,
        settings.kind.unit()
    );
    client.say(&format!(
        "a wheel moves {way}, until the end of input or Ctrl-C"
    ));
    let wrong = follows.until_it_ends(&counts, &signals)?;
    follows.rests()?;
    wrong.map_or(Ok(()), |wrong| Err(Failure::Input(anyhow!(wrong))))
}

/// An axis that follows a wheel.
struct Follows<'a> {
    client: &'a Client,
    eyes: Eyes<'a>,
    place: Held<OperatorClient>,
    settings: &'a Axis,
    /// The order, with the count that was judged last.
    request: OperatorRequest,
    /// One was.
    began: bool,
    /// Counts that the wheel has turned, and those of them that the axis has.
    turned: u64,
    taken: u64,
    /// What was said last of counts that are not taken.
    said: Option<Refused>,
    /// Scan in which the probe has stopped an axis last, or in which the command began.
    stopped_in: u64,
}

impl Follows<'_> {
    /// Tells the master the newest count until there are no more; what is wrong with the last line.
    fn until_it_ends(
        &mut self,
        counts: &Receiver<Result<i32, String>>,
        signals: &Signals,
    ) -> Result<Option<String>, Failure> {
        let (mut newest, mut end) = (None, None);
        loop {
            // The first one says where the wheel is; then the newest is what counts.
            while end.is_none() && (newest.is_none() || self.began) {
                match counts.try_recv() {
                    Ok(Ok(count)) => newest = Some(count),
                    Ok(Err(wrong)) => end = Some(Some(wrong)),
                    Err(TryRecvError::Disconnected) => end = Some(None),
                    Err(TryRecvError::Empty) => break,
                }
            }
            if let Some(count) = newest
                && self.tell(count)?
            {
                newest = None;
            }
            if signals.count() > 0 {
                return Ok(None);
            }
            if let (None, Some(end)) = (newest, end.clone()) {
                return Ok(end);
            }
            let now = self.eyes.look()?;
            self.heed(&now);
            std::thread::sleep(LOOK);
        }
    }

    /// Tells the master a count; false where it came too late and is to be told again.
    fn tell(&mut self, count: i32) -> Result<bool, Failure> {
        let seen = self.eyes.look()?.scan;
        let request = OperatorRequest {
            count,
            latest_scan: seen + u64::from(self.client.scans(CLICK_AGE)),
            ..self.request
        };
        let answer = self.client.hear_by(&self.place, Order::Wheel, request)?;
        let reason = Refused::from_wire(answer.reason);
        match reason {
            Some(Refused::TooLate) => return Ok(false),
            None | Some(Refused::BadValue | Refused::UnknownAxis | Refused::JogSpeed) => {
                self.client.accepted(Order::Wheel, answer)?;
            }
            Some(Refused::Not) => self.said = None,
            Some(why) => self.not_taken(why, &answer),
        }
        if self.began {
            let turned = count.wrapping_sub(self.request.count);
            self.turned += u64::from(turned.unsigned_abs());
            self.taken += u64::from(answer.counts.unsigned_abs());
        }
        (self.began, self.request.count) = (true, count);
        Ok(true)
    }

    /// Says once why counts are not taken.
    fn not_taken(&mut self, why: Refused, answer: &OperatorResponse) {
        let too_fast = why == Refused::Backlog;
        if !too_fast && self.said.replace(why) != Some(why) {
            let words = self.client.words(Some(why), Order::Wheel, answer);
            self.client.say(&format!("counts are not taken: {words}"));
        }
    }

    /// Says when the probe has stopped the axis.
    fn heed(&mut self, now: &Feedback) {
        if let Some(words) = probe_words(now, self.stopped_in) {
            self.stopped_in = now.cause_scan;
            self.client.say(words);
        }
    }

    /// Waits until the axis stands; says where, and what was taken.
    fn rests(&mut self) -> Outcome {
        let judged_in = self.eyes.look()?.scan;
        loop {
            let now = self.eyes.look()?;
            self.heed(&now);
            let Some(axis) = now.axes().get(self.request.axis as usize) else {
                return Ok(());
            };
            let course = course(axis);
            // An order that was just judged shows in the scan after it.
            if now.scan > judged_in + 1 && (axis.driver != Driver::Manual as u32 || course.rests())
            {
                let at_mm = axis.command_position as f64 * self.settings.increment_mm();
                let (name, unit) = (&self.settings.name, self.settings.kind.unit());
                self.client.say(&format!(
                    "{} counts taken, {} not; {name} is at rest at {:.3} {unit}",
                    self.taken,
                    self.turned - self.taken.min(self.turned),
                    self.settings.shown(at_mm)
                ));
                return Ok(());
            }
            std::thread::sleep(LOOK);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::count;

    #[test]
    fn a_count_is_a_whole_number_that_goes_on_behind_the_largest_with_the_smallest() {
        assert_eq!(count(1, " -7 "), Ok(Some(-7)));
        assert_eq!(count(1, ""), Ok(None));
        assert_eq!(count(1, "2147483648"), Ok(Some(i32::MIN)));
        for text in ["1.5", "x", "1 2", "99999999999999999999"] {
            let said = count(3, text).expect_err(text);
            assert!(said.contains("line 3"), "{said}");
            assert!(said.contains("whole number such as 42"), "{said}");
        }
    }
}
