//! A running cell, entered as a client: it sends orders and waits for their answers.

use std::rc::Rc;
use std::time::{Duration, Instant};

use anyhow::anyhow;
use bus::cell::{CellError, CellPaths};
use bus::observer::{Held, Observer};
use bus::port::OperatorClient;
use bus::sample::{
    Auxiliaries, Cause, Feedback, Mode, OVERRIDE_MAX_PERCENT, OperatorRequest, OperatorResponse,
    Order, Reference, Refused,
};
use bus::service::Bus;
use machine::{KeptTexts, Machine};
use monitor::words::shown;

use super::eyes::Eyes;
use console::exit::{Failure, Kind};
use console::output::{joined, say};
use launcher::origin;

/// A cell that has not answered by then is silent.
pub(super) const ANSWER_LIMIT: Duration = Duration::from_secs(5);
/// Places of clients that were killed are free again by then.
const PLACE_LIMIT: Duration = Duration::from_millis(2500);
/// Time between two tries to get one.
const PLACE_LOOK: Duration = Duration::from_millis(20);
/// The end of a cell shows so long after its services have gone.
const END_SHOWS_WITHIN: Duration = Duration::from_millis(500);
/// Time between two looks for the answer.
pub(super) const LOOK: Duration = Duration::from_millis(2);

/// What a cell with its drives on says.
fn enabled(mode: Option<Mode>, hold: u32) -> &'static str {
    match (mode, hold) {
        (Some(Mode::Ready), _) => "drives on, ready",
        (_, 1) => "drives on, in hold: resume moves",
        _ => "drives on",
    }
}

fn single_block(on: f64) -> &'static str {
    match on {
        1.0 => "single block on: the machine rests behind each block, resume runs the next",
        _ => "single block off",
    }
}

/// Where the axis will stand whose motion by hand an order has cut short, if it has.
fn cut_words(cell: &Observer, order: Order, answer: &OperatorResponse) -> Option<String> {
    if answer.cut == 0 {
        return None;
    }
    let machine = Machine::load(&cell.place.machine_file()).ok()?;
    let axis = machine.axes.get(answer.axis as usize)?;
    let at_mm = axis.shown(answer.rests as f64 * axis.increment_mm());
    let (name, unit) = (&axis.name, axis.kind.unit());
    Some(format!(
        "{}: the jog comes to rest: {name} will stand at {at_mm:.3} {unit}",
        order.word()
    ))
}

fn obeyed(order: Order, answer: &OperatorResponse) -> String {
    let mode = Mode::from_wire(answer.mode);
    match (order, mode) {
        (Order::Hold, Some(Mode::Jogging)) => "hold: the jog comes to rest".into(),
        (Order::Hold, Some(Mode::Disabled | Mode::Ready | Mode::Stopped)) => {
            "hold: latched, nothing moves before resume".into()
        }
        (Order::Hold, _) => "hold: the tool comes to rest on the path".to_string(),
        (Order::Resume, Some(Mode::Ready)) => "hold released".into(),
        (Order::Resume, _) => "resumed".into(),
        (Order::Stop, Some(Mode::Disabled)) => "stopped: the drives are off".into(),
        (Order::Stop, Some(Mode::Stopped)) => "stopped".into(),
        (Order::Stop, Some(Mode::Ready)) => "at rest: no program is under way".into(),
        (Order::Stop, Some(Mode::Tripped)) => {
            "the machine has tripped: it stays where it stands".into()
        }
        (Order::Stop, _) => "stopping: the tool comes to rest".into(),
        (Order::EmergencyStop, Some(Mode::Disabled)) => {
            "emergency stop: the drives are off, and stay so until enable".into()
        }
        (Order::EmergencyStop, _) => {
            "emergency stop: the axes brake at their limits; enable ends it".into()
        }
        (Order::Disable, _) => "drives off: positions follow the axes".into(),
        (Order::Home, _) => "homing".into(),
        (Order::Reset, Some(Mode::Disabled)) => {
            "reset: the rest is given up, `start` begins what is loaded; the drives are off".into()
        }
        (Order::Reset, _) => "reset: the rest is given up, `start` begins what is loaded".into(),
        (Order::Override, _) => format!("override {} %", answer.override_percent),
        _ => format!("{}: done", order.word()),
    }
}

/// A running cell, entered.
pub struct Client {
    /// Its machine file.
    pub machine: Machine,
    /// A foot in its shared memory.
    pub bus: Bus,
    /// The cell. It goes last: then nothing is made there any more.
    pub cell: Rc<Observer>,
}

impl Client {
    /// Enters the cell that was named, or the only one that runs if its machine is one of this folder, to give it orders.
    ///
    /// # Errors
    /// It does not run, none does, several do, or it was started elsewhere and not named.
    pub fn to_order(cell: Option<&str>) -> Result<Client, Failure> {
        let is_named = cell.is_some();
        let cell = running(cell)?;
        if !is_named {
            origin::check(&cell.place)?;
        }
        Client::enter(cell, "operator")
    }

    /// Drives on: answered when they are. In words, behind the name of the cell.
    pub(super) fn enable(&self) -> Result<String, Failure> {
        let mut eyes = Eyes::open(self)?;
        let answer = self.ask(Order::Enable, OperatorRequest::default())?;
        let now = eyes.until_enabled(answer.scan)?;
        let words = enabled(Mode::from_wire(now.mode), now.hold);
        Ok(named(self.cell.place.name(), words))
    }

    /// Prints what came of an order, behind the name of the cell.
    pub(super) fn say(&self, words: &str) {
        say(&named(self.cell.place.name(), words));
    }

    /// An order that came to nothing, behind the name of the cell.
    pub(super) fn fails(&self, words: &str) -> Failure {
        Failure::Stopped(anyhow!(named(self.cell.place.name(), words)))
    }

    /// Enters the cell that was named, or the only one that runs, as `who`.
    ///
    /// # Errors
    /// It does not run, none does, or several do.
    pub fn find(cell: Option<&str>, who: &str) -> Result<Client, Failure> {
        Client::enter(running(cell)?, who)
    }

    fn enter(cell: Observer, who: &str) -> Result<Client, Failure> {
        let cell = Rc::new(cell);
        let place = &cell.place;
        let machine = Machine::load(&place.machine_file()).map_err(|_| not_running(place))?;
        cell.note_entered();
        let entered = Bus::enter(place, &machine.shape(), who, false);
        let bus = entered.map_err(|error| not_entered(&cell, error))?;
        Ok(Client { cell, machine, bus })
    }

    /// So many scans of this cell are as long, rounded up.
    pub fn scans(&self, time: std::time::Duration) -> u32 {
        (time.as_secs_f64() / self.machine.scan_period_s()).ceil() as u32
    }

    /// Name of an axis.
    pub fn axis_name(&self, axis: u32) -> &str {
        let axis = self.machine.axes.get(axis as usize);
        axis.map_or("?", |axis| axis.name.as_str())
    }

    /// Index of the axis that programs name so.
    pub(super) fn axis_index(&self, letter: &str) -> Result<u32, Failure> {
        let index = self.machine.program_axis_index(&letter.to_uppercase());
        index.map_err(|error| Failure::Input(anyhow!(error)))
    }

    /// Unit of an axis's distances.
    pub fn unit(&self, axis: u32) -> &'static str {
        let axis = self.machine.axes.get(axis as usize);
        axis.map_or("mm", |axis| axis.kind.unit())
    }

    /// Sends an order without an axis; what came of it, in words, behind the name of the cell.
    pub(super) fn order(&self, order: Order, value: f64) -> Result<String, Failure> {
        let request = OperatorRequest {
            value,
            ..OperatorRequest::default()
        };
        let answer = self.ask(order, request)?;
        let words = match order {
            Order::SingleBlock => single_block(value).into(),
            Order::RapidOverride => format!("rapid override {} %", value as u32),
            Order::JogOverride => format!("jog override {} %", value as u32),
            _ => obeyed(order, &answer),
        };
        Ok(named(self.cell.place.name(), &words))
    }

    /// Sends an order and waits for its answer; a refusal is a failure with its reason.
    pub(super) fn ask(
        &self,
        order: Order,
        request: OperatorRequest,
    ) -> Result<OperatorResponse, Failure> {
        let answer = self.hear(order, request)?;
        self.accepted(order, answer)
    }

    /// An order that the cell has refused, and why.
    pub(super) fn refused(&self, order: Order, why: &str) -> Failure {
        refused(&self.cell.place, order, why)
    }

    /// A refusal is a failure with its reason.
    pub(super) fn accepted(
        &self,
        order: Order,
        answer: OperatorResponse,
    ) -> Result<OperatorResponse, Failure> {
        match Refused::from_wire(answer.reason) {
            Some(Refused::Not) => Ok(answer),
            reason => Err(self.refused(order, &self.words(reason, order, &answer))),
        }
    }

    /// Sends an order and waits for its answer, which may be a refusal.
    pub(super) fn hear(
        &self,
        order: Order,
        request: OperatorRequest,
    ) -> Result<OperatorResponse, Failure> {
        let place = self.place()?;
        self.hear_by(&place, order, request)
    }

    /// A place among the clients that give orders, for several of them.
    pub(super) fn place(&self) -> Result<Held<OperatorClient>, Failure> {
        soon_held(&self.cell, || self.bus.operator_client())
    }

    /// The same by a place that it has already.
    pub(super) fn hear_by(
        &self,
        operator: &OperatorClient,
        order: Order,
        request: OperatorRequest,
    ) -> Result<OperatorResponse, Failure> {
        let cell = self.cell.place.name();
        let request = OperatorRequest {
            order: order as u32,
            ..request
        };
        let asked = Instant::now();
        loop {
            let pending = operator
                .send(request)
                .ok_or_else(|| Failure::Stopped(anyhow!("cell {cell:?} takes no orders")))?;
            if pending.is_sent() || self.cell.is_gone() || asked.elapsed() > ANSWER_LIMIT {
                let is_closed = || pending.is_closed();
                return wait_for_answer(&self.cell, order, || pending.answer(), is_closed);
            }
            // The master is being replaced: nobody has the order.
            std::thread::sleep(PLACE_LOOK);
        }
    }

    pub(super) fn words(
        &self,
        reason: Option<Refused>,
        order: Order,
        answer: &OperatorResponse,
    ) -> String {
        let Some(reason) = reason else {
            return plain_words(None, answer);
        };
        match reason {
            Refused::NotReferenced => match self.not_homed() {
                Some(axes) => format!("not homed: {axes}: `quadrant home {axes}` first"),
                None => plain_words(Some(reason), answer),
            },
            Refused::OutsideTravel => {
                let now = Eyes::open(self).and_then(|mut eyes| eyes.look()).ok();
                let outside = now.and_then(|now| self.outside(&now));
                outside.unwrap_or_else(|| plain_words(Some(reason), answer))
            }
            Refused::BadValue if matches!(order, Order::Load | Order::Start) => {
                "another program was loaded meanwhile: load it again".into()
            }
            Refused::BadValue if order == Order::Override => {
                match self.machine.path.feed_override_max_percent {
                    100 => "an override is 0 to 100 %; `feed_override_max_percent` in [path] of the machine file allows up to 200 %".into(),
                    most => format!("an override is 0 to {most} %"),
                }
            }
            Refused::BadValue if order == Order::RapidOverride => {
                "an override of rapids is 0 to 100 %".into()
            }
            Refused::BadValue if order == Order::JogOverride => {
                format!("an override of jogs is 0 to {OVERRIDE_MAX_PERCENT} %")
            }
            Refused::SignalOff => {
                let signal = self.machine.signals.get(answer.axis as usize);
                let name = signal.map_or("?", |signal| signal.name.as_str());
                format!("signal {name} is off, and must be on for a program")
            }
            Refused::BadValue if order == Order::Jog => "a jog is any distance but 0".into(),
            Refused::JogSpeed => format!(
                "the speed of a jog of this axis is {} to {} {}/min",
                shown(answer.allowed_min_mm * 60.0, 4),
                shown(answer.allowed_max_mm * 60.0, 4),
                self.unit(answer.axis)
            ),
            Refused::BeyondTravel => format!(
                "{}: from here a jog of {} may be {:+.3} to {:+.3} {}",
                reason.words(),
                self.axis_name(answer.axis),
                answer.allowed_min_mm,
                answer.allowed_max_mm,
                self.unit(answer.axis)
            ),
            _ => plain_words(Some(reason), answer),
        }
    }
}

impl Client {
    /// The machine with all that the next program begins with: offsets, tools, parameters, and what the master shows.
    ///
    /// # Errors
    /// A file of the user or of the cell cannot be read, or is wrong.
    pub(super) fn machine_of_next_program(&self, shown: &Auxiliaries) -> anyhow::Result<Machine> {
        let mut machine = self.machine.clone();
        let kept = KeptTexts::now(&self.cell.place, &machine, shown)?;
        machine.take_kept(kept)?;
        Ok(machine)
    }

    /// The axes that stand outside their travel, as the feedback has them, and the jogs that bring them in; none where none does.
    pub(super) fn outside(&self, now: &Feedback) -> Option<String> {
        let axes = now.axes().iter().zip(&self.machine.axes);
        let outside = axes.filter(|(axis, settings)| {
            let known = axis.reference == Reference::Known as u32;
            known && !settings.may_stand_at(axis.command_position)
        });
        let words = outside.map(|(axis, settings)| {
            let at_mm = axis.command_position as f64 * settings.increment_mm();
            let way_mm = at_mm.clamp(settings.travel_min_mm, settings.travel_max_mm) - at_mm;
            // Rounded away from 0, so that it leads in.
            let way_mm = (way_mm.abs() * 1e3).ceil().copysign(way_mm) * 1e-3;
            let name = &settings.name;
            format!("axis {name} is outside its travel: jog it inwards (`quadrant jog {name} {way_mm:.3}`)")
        });
        let words = joined(words, "; ");
        (!words.is_empty()).then_some(words)
    }

    /// Letters of the axes that are not homed, as the feedback has them; none where it says so of none.
    fn not_homed(&self) -> Option<String> {
        let now = Eyes::open(self).ok()?.look().ok()?;
        let axes = now.axes().iter().zip(&self.machine.axes);
        let missing = axes.filter(|(axis, settings)| {
            settings.homing.is_some() && axis.reference != Reference::Known as u32
        });
        let names = joined(missing.map(|(_, settings)| &settings.name), " ");
        (!names.is_empty()).then_some(names)
    }
}

/// What to say where the probe has stopped a motion by hand that was ordered in an earlier scan.
pub(super) fn probe_words(now: &Feedback, ordered_in: u64) -> Option<&'static str> {
    let stopped = now.cause == Cause::ProbeJogged as u32 && now.cause_scan > ordered_in;
    stopped.then(|| Cause::ProbeJogged.words())
}

/// What a cell answers, behind its name.
fn named(cell: &str, words: &str) -> String {
    format!("{cell}: {words}")
}

fn refused(cell: &CellPaths, order: Order, why: &str) -> Failure {
    let word = match order {
        Order::JogOn | Order::JogRenew => Order::Jog.word(),
        order => order.word(),
    };
    Failure::Stopped(anyhow!("{}: {word} refused: {why}", cell.name()))
}

/// Why an order was refused, where no value of its own is the reason.
fn plain_words(reason: Option<Refused>, answer: &OperatorResponse) -> String {
    let Some(reason) = reason else {
        return "for a reason this program does not know".into();
    };
    let mode = Mode::from_wire(answer.mode).map_or("in an unknown mode", Mode::word);
    format!(
        "{} (the machine is {mode} in scan {})",
        reason.words(),
        answer.scan
    )
}

/// An order that must always come through, given: stop, hold, emergency stop or drives off. It takes no place in the cell, and waits
/// for a master that is being replaced.
pub struct Given {
    cell: Observer,
    order: Order,
    number: u32,
    at: Instant,
}

impl Given {
    /// Gives it; nobody waits. A stop also to a cell that runs alone and was started elsewhere, for at rest it does no harm.
    ///
    /// # Errors
    /// No such cell runs.
    pub fn give(cell: Option<&str>, order: Order) -> Result<Given, Failure> {
        let is_named = cell.is_some();
        let cell = running(cell)?;
        if order == Order::Disable && !is_named {
            origin::check(&cell.place)?;
        }
        Ok(Given {
            number: cell.page.order_urgently(order).unwrap_or_default(),
            cell,
            order,
            at: Instant::now(),
        })
    }

    /// What came of it, in words; none while that is not known.
    ///
    /// # Errors
    /// It is refused, or nobody answers.
    pub fn outcome(&self) -> Option<Result<String, Failure>> {
        let (cell, order) = (&self.cell, self.order);
        let answer = || cell.page.urgent_answer(order, self.number);
        let found = look_for_answer(cell, order, self.at, &answer, &|| false)?;
        Some(
            found.and_then(|answer| match Refused::from_wire(answer.reason) {
                Some(Refused::Not) => {
                    let cut = cut_words(cell, order, &answer);
                    let words = cut.unwrap_or_else(|| obeyed(order, &answer));
                    Ok(named(cell.place.name(), &words))
                }
                reason => Err(refused(&cell.place, order, &plain_words(reason, &answer))),
            }),
        )
    }
}

/// Gives an order that must always come through. What came of it, in words.
///
/// # Errors
/// As [`Given::give`] and [`Given::outcome`].
pub fn order_urgently(cell: Option<&str>, order: Order) -> Result<String, Failure> {
    let given = Given::give(cell, order)?;
    loop {
        if let Some(outcome) = given.outcome() {
            return outcome;
        }
        std::thread::sleep(LOOK);
    }
}

/// Waits for the answer to an order, as long as the cell runs and is not silent, and whoever has the order lives.
fn wait_for_answer(
    cell: &Observer,
    order: Order,
    answer: impl Fn() -> Option<OperatorResponse>,
    is_closed: impl Fn() -> bool,
) -> Result<OperatorResponse, Failure> {
    let asked = Instant::now();
    loop {
        if let Some(found) = look_for_answer(cell, order, asked, &answer, &is_closed) {
            return found;
        }
        std::thread::sleep(LOOK);
    }
}

/// The answer to an order that was given then, or why there will be none.
fn look_for_answer(
    cell: &Observer,
    order: Order,
    asked: Instant,
    answer: &dyn Fn() -> Option<OperatorResponse>,
    is_closed: &dyn Fn() -> bool,
) -> Option<Result<OperatorResponse, Failure>> {
    // Looked at first: what was answered before the end is there after it.
    let (gone, closed) = (cell.is_gone(), is_closed());
    if let Some(answer) = answer() {
        return Some(Ok(answer));
    }
    if !gone && !closed && asked.elapsed() <= ANSWER_LIMIT {
        return None;
    }
    let how = match (gone, closed) {
        (true, _) => "has ended",
        (false, true) => "has lost its master, which had the order",
        (false, false) => "does not answer",
    };
    Some(Err(Failure::Stopped(anyhow!(
        "cell {:?} {how}: {} may or may not have been obeyed",
        cell.place.name(),
        order.word()
    ))))
}

/// Ports of a client, held while its cell runs. Clients that were killed leave their places taken until the launcher cleans up
/// after them, once in a second: so long it is tried again.
///
/// # Errors
/// The cell has ended, or has no place.
pub fn soon_held<T>(
    cell: &Rc<Observer>,
    open: impl Fn() -> Result<T, CellError>,
) -> Result<Held<T>, Failure> {
    let asked = Instant::now();
    loop {
        match open() {
            Err(_) if !cell.is_gone() && asked.elapsed() < PLACE_LIMIT => {
                std::thread::sleep(PLACE_LOOK);
            }
            done => return held(cell, done),
        }
    }
}

/// Ports that were opened in a cell.
///
/// # Errors
/// They cannot be opened, or the cell has just ended.
pub fn held<T>(cell: &Rc<Observer>, ports: Result<T, CellError>) -> Result<Held<T>, Failure> {
    let held = ports.map(|ports| cell.hold(ports));
    held.map_err(|error| not_entered(cell, error))
}

fn not_entered(cell: &Observer, error: CellError) -> Failure {
    // A cell that ends has lost its services a moment before its end shows.
    let asked = Instant::now();
    while !cell.is_gone() && asked.elapsed() < END_SHOWS_WITHIN {
        std::thread::sleep(LOOK);
    }
    match cell.is_gone() {
        true => Failure::Stopped(anyhow!("cell {:?} has just ended", cell.place.name())),
        false => Failure::Environment(error.into()),
    }
}

fn not_running(place: &CellPaths) -> Failure {
    Failure::Stopped(anyhow!("cell {:?} does not run", place.name()))
}

/// The cell that was named, or the only one that runs.
pub(super) fn running(cell: Option<&str>) -> Result<Observer, Failure> {
    if let Some(name) = cell {
        let place = CellPaths::new(name).input()?;
        // Another user's cell may well run.
        if let Err(error) = place.must_be_ours() {
            return Err(Failure::Stopped(error.into()));
        }
        return Observer::of(place.clone()).ok_or_else(|| not_running(&place));
    }
    let mut running = Vec::new();
    let mut of_others = Vec::new();
    for name in CellPaths::names() {
        let place = CellPaths::new(&name).input()?;
        if place.must_be_ours().is_err() {
            of_others.push(name);
        } else {
            running.extend(Observer::of(place));
        }
    }
    let names: Vec<&str> = running.iter().map(|cell| cell.place.name()).collect();
    match names.len() {
        0 if !of_others.is_empty() => Err(Failure::Stopped(anyhow!(
            "no cell of yours runs; {} runs under another user, who alone can give it orders and look at it",
            of_others.join(", ")
        ))),
        0 => Err(Failure::Stopped(anyhow!(
            "no cell runs: `quadrant up MACHINE` starts one that stays, `quadrant run` one for a program"
        ))),
        1 => Ok(running.remove(0)),
        _ => {
            let places: Vec<&CellPaths> = running.iter().map(|cell| &cell.place).collect();
            let of_folder = origin::only_one_of_this_folder(&places);
            let refused = || {
                let names = names.join(", ");
                anyhow!("several cells run: name one with --cell: {names}")
            };
            let index = of_folder.ok_or_else(refused).input()?;
            Ok(running.remove(index))
        }
    }
}
