//! Orders of many clients while the master and the planner are killed: there is one order of them that explains every answer.
//!
//! Each order takes effect at most once, none is lost without that being said, and what was answered is still true after a restart.
//! `stateright` looks for such an order among all that the times of the answers allow: an order without an answer may have been
//! obeyed once, or not at all.

use std::collections::BTreeMap;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use bus::cell::CellPaths;
use bus::port::OperatorClient;
use bus::sample::{Feedback, OperatorRequest, OperatorResponse, Order};
use bus::service::{Bus, Shape};
use bus::signal_page::SignalPage;
use machine::Machine;
use stateright::{Checker, Model, Property};

use crate::size;
use crate::support::{Bench, LiveCell, quadrant, send};

const CLIENTS: usize = 6;
/// Orders of each client in a round.
const ORDERS: usize = 5;
/// An order that has no answer by then may have been obeyed or not; the master that it was sent to is gone.
const ANSWER_LIMIT: Duration = Duration::from_secs(3);
/// An order in the page waits for the master that replaces a dead one.
const URGENT_LIMIT: Duration = Duration::from_secs(20);

/// What a client asks.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Ask {
    Give(Order, u32),
    Status,
}

/// What it is told: when it was judged (a feedback shows what was judged before its scan), and the state after it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
struct Told {
    when: u64,
    accepted: bool,
    hold: bool,
    override_percent: u32,
    run: u32,
}

impl Told {
    fn answer(answer: &OperatorResponse) -> Told {
        Told {
            when: 2 * answer.scan + 1,
            accepted: answer.accepted == 1,
            hold: answer.hold == 1,
            override_percent: answer.override_percent,
            run: answer.run,
        }
    }

    fn status(feedback: &Feedback) -> Told {
        Told {
            when: 2 * feedback.scan,
            accepted: true,
            hold: feedback.hold == 1,
            override_percent: feedback.override_percent,
            run: feedback.run,
        }
    }
}

/// What an order latches, where one is obeyed after the other.
fn obey(state: &mut Told, order: Order, value: u32) {
    match order {
        Order::Hold => state.hold = true,
        Order::Resume => state.hold = false,
        Order::Override => state.override_percent = value,
        Order::Start => state.run += 1,
        // Drives on: in hold, where a program was started.
        Order::Enable => state.hold = true,
        _ => {}
    }
}

/// The state after an order that was answered so; none where that is not true.
fn after(mut state: Told, ask: Ask, told: Told) -> Option<Told> {
    if told.when < state.when {
        return None;
    }
    state.when = told.when;
    if let (Ask::Give(order, value), true) = (ask, told.accepted) {
        // What these two do to the hold depends on the mode; they never release it.
        match order {
            Order::Enable | Order::Stop => state.hold |= told.hold,
            _ => obey(&mut state, order, value),
        }
    }
    let shown = |t: Told| (t.hold, t.override_percent, t.run);
    (shown(state) == shown(told)).then_some(state)
}

/// One order or look of a history, and when it was asked and told.
#[derive(Debug)]
struct Asked {
    ask: Ask,
    asked: usize,
    told: Option<(usize, Told)>,
}

/// The search for an order of them all that explains each answer.
struct Explanation {
    began: Told,
    asked: Vec<Asked>,
}

impl Model for Explanation {
    /// Those that have been obeyed, by bits, and what they have latched.
    type State = (u64, Told);
    type Action = usize;

    fn init_states(&self) -> Vec<(u64, Told)> {
        vec![(0, self.began)]
    }

    /// Whoever asked before each of the others was told.
    fn actions(&self, (done, _): &(u64, Told), next: &mut Vec<usize>) {
        let open = |index: &usize| done & (1 << index) == 0;
        let all = || (0..self.asked.len()).filter(open);
        let until = all()
            .filter_map(|index| Some(self.asked[index].told?.0))
            .min();
        next.extend(
            all().filter(|index| until.is_none_or(|until| self.asked[*index].asked < until)),
        );
    }

    fn next_state(&self, (done, state): &(u64, Told), index: usize) -> Option<(u64, Told)> {
        let one = &self.asked[index];
        let state = match (one.told, one.ask) {
            (Some((_, told)), ask) => after(*state, ask, told)?,
            (None, Ask::Give(order, value)) => {
                let mut state = *state;
                obey(&mut state, order, value);
                state
            }
            (None, Ask::Status) => return None,
        };
        Some((done | 1 << index, state))
    }

    fn properties(&self) -> Vec<Property<Self>> {
        vec![Property::<Self>::sometimes(
            "explained",
            |model, (done, _)| {
                let asked = model.asked.iter().enumerate();
                let mut answered = asked.filter(|(_, one)| one.told.is_some());
                answered.all(|(index, _)| done & (1 << index) != 0)
            },
        )]
    }
}

/// Who asked and what, or was told what, in the order of these events.
#[derive(Debug, Clone, Copy)]
enum Event {
    Asked(Ask),
    Told(Told),
}

/// The cell, as all clients see it.
struct Shared {
    place: CellPaths,
    shape: Shape,
    page: SignalPage,
    newest: Mutex<Option<Feedback>>,
    history: Mutex<Vec<(usize, Event)>>,
    ends: AtomicBool,
}

impl Shared {
    fn note(&self, client: usize, event: Event) {
        self.history
            .lock()
            .expect("the history")
            .push((client, event));
    }

    fn newest(&self) -> Option<Feedback> {
        *self.newest.lock().expect("the feedback")
    }

    /// Keeps the newest feedback.
    fn watch(&self) {
        let bus = Bus::enter(&self.place, &self.shape, "test", false).expect("the cell");
        let mut reader = bus.feedback_reader(1).expect("a reader");
        while !self.ends.load(Ordering::Relaxed) {
            if let Some(feedback) = reader.newest(u64::MAX) {
                *self.newest.lock().expect("the feedback") = Some(feedback);
            }
            std::thread::sleep(Duration::from_millis(1));
        }
    }
}

/// Nobody watches any more once this is dropped, however the test ends.
struct Watched<'a>(&'a AtomicBool);

impl Drop for Watched<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

/// Waits for something, at most `limit`.
fn wait<T>(limit: Duration, mut look: impl FnMut() -> Option<T>) -> Option<T> {
    let since = Instant::now();
    while since.elapsed() < limit {
        let found = look();
        if found.is_some() {
            return found;
        }
        std::thread::sleep(Duration::from_millis(1));
    }
    None
}

/// A feedback that shows all that had been answered when it was asked for.
fn status(cell: &Shared) -> Option<Told> {
    let before = cell.newest()?.scan;
    let shown = || cell.newest().filter(|feedback| feedback.scan >= before + 2);
    wait(ANSWER_LIMIT, shown).map(|feedback| Told::status(&feedback))
}

/// All continuous jogs are the same one: anybody's renewal is one of the last.
fn jog_session(order: Order) -> u32 {
    u32::from(matches!(order, Order::JogOn | Order::JogRenew))
}

/// Stop, hold and emergency stop go through the page, as `quadrant stop` sends them; the others through the service.
fn give(cell: &Shared, operator: &OperatorClient, order: Order, value: u32) -> Option<Told> {
    if let Some(number) = cell.page.order_urgently(order) {
        let answer = wait(URGENT_LIMIT, || cell.page.urgent_answer(order, number));
        let answer = answer.unwrap_or_else(|| panic!("{order:?} was lost"));
        return Some(Told::answer(&answer));
    }
    let pending = operator.send(OperatorRequest {
        order: order as u32,
        value: value.into(),
        session: jog_session(order),
        deadline_scans: 100,
        ..OperatorRequest::default()
    })?;
    let answer = wait(ANSWER_LIMIT, || pending.answer());
    answer.map(|answer| Told::answer(&answer))
}

/// Small numbers that look random, from a seed.
struct Dice(u64);

impl Dice {
    fn below(&mut self, most: u64) -> u64 {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) % most
    }

    fn ask(&mut self) -> Ask {
        let value = self.below(100) as u32;
        match self.below(15) {
            0 | 1 => Ask::Give(Order::Hold, 0),
            2 | 3 => Ask::Give(Order::Resume, 0),
            4 | 5 => Ask::Give(Order::Override, value),
            6 => Ask::Give(Order::Stop, 0),
            7 | 8 => Ask::Give(Order::Enable, 0),
            9 => Ask::Give(Order::Start, 0),
            10 => Ask::Give(Order::EmergencyStop, 0),
            11 => Ask::Give(Order::JogOn, 1),
            12 => Ask::Give(Order::JogRenew, 0),
            _ => Ask::Status,
        }
    }
}

/// One client of a round. One that got no answer goes on as another client.
fn client(cell: &Shared, number: usize, mut dice: Dice) {
    let bus = Bus::enter(&cell.place, &cell.shape, "test", false).expect("the cell");
    let operator = wait(ANSWER_LIMIT, || bus.operator_client().ok()).expect("a place");
    let mut name = number;
    for _ in 0..ORDERS {
        std::thread::sleep(Duration::from_millis(dice.below(40)));
        let ask = dice.ask();
        cell.note(name, Event::Asked(ask));
        let told = match ask {
            Ask::Status => status(cell),
            Ask::Give(order, value) => give(cell, &operator, order, value),
        };
        match told {
            Some(told) => cell.note(name, Event::Told(told)),
            None => name += CLIENTS,
        }
    }
}

/// Judges whether one order of these explains all answers, from this state on.
fn judge(began: Told, history: &[(usize, Event)]) {
    let mut asked: Vec<Asked> = Vec::new();
    let mut open = BTreeMap::new();
    for (at, (client, event)) in history.iter().enumerate() {
        match *event {
            Event::Asked(ask) => {
                open.insert(*client, asked.len());
                asked.push(Asked {
                    ask,
                    asked: at,
                    told: None,
                });
            }
            Event::Told(told) => asked[open[client]].told = Some((at, told)),
        }
    }
    assert!(asked.len() <= 64, "bits");
    let checker = Explanation { began, asked }.checker().spawn_dfs().join();
    assert!(
        checker.discovery("explained").is_some(),
        "from {began:?} no order of these explains all answers:\n{}",
        history
            .iter()
            .map(|event| format!("{event:?}\n"))
            .collect::<String>()
    );
}

fn obeyed(cell: &LiveCell, words: &[&str]) {
    let done = quadrant()
        .args(words)
        .args(["--cell", &cell.cell])
        .output()
        .expect("quadrant");
    let why = String::from_utf8_lossy(&done.stderr);
    assert!(done.status.success(), "{words:?}: {why}");
}

/// Kills a process and waits until another one has its place.
fn kill(live: &LiveCell, cell: &Shared, role: &str) {
    let pid = live.pid_of(role);
    let before = cell.newest().map_or(0, |feedback| feedback.incarnation);
    send(pid, libc::SIGKILL);
    let replaced = wait(URGENT_LIMIT, || {
        let children = live.children();
        let another = children
            .iter()
            .any(|(other, line)| line.contains(role) && *other != pid);
        let master = role == "quadrant plant-sim";
        let runs = !master || cell.newest().is_some_and(|f| f.incarnation > before);
        (another && runs).then_some(())
    });
    assert!(replaced.is_some(), "no other {role}");
}

#[test]
fn orders_of_many_clients_are_linearizable_while_master_and_planner_are_killed() {
    let rounds = size::number("ROUNDS", 4, 6);
    let restarts = ("[scan]\n", "[restart]\nrestarts_max = 100000\n\n[scan]\n");
    let bench = Bench::patient("xy", &[restarts]);
    let program = bench.file("line.ngc", "G21 G17 G90 G94\nG1 X2 F3000\nX0\nM2\n");
    let mut live = LiveCell::up(bench.path(), "realtime");
    live.wait_for(|_| true);
    obeyed(&live, &["enable"]);
    obeyed(&live, &["load", &program.display().to_string()]);
    let place = CellPaths::new(&live.cell).expect("a name");
    let cell = Shared {
        shape: Machine::load(bench.path()).expect("the machine").shape(),
        page: SignalPage::open(&place).expect("the page"),
        place,
        newest: Mutex::new(None),
        history: Mutex::new(Vec::new()),
        ends: AtomicBool::new(false),
    };
    let mut unanswered = 0;
    let mut asked = 0;
    std::thread::scope(|scope| {
        scope.spawn(|| cell.watch());
        let _watched = Watched(&cell.ends);
        for round in 0..rounds {
            let began = wait(URGENT_LIMIT, || status(&cell)).expect("a status");
            cell.history.lock().expect("the history").clear();
            let mut dice = Dice(round * 7919 + 1);
            std::thread::scope(|clients| {
                for number in 0..CLIENTS {
                    let dice = Dice(dice.below(u64::MAX) << 16 | round);
                    let cell = &cell;
                    clients.spawn(move || client(cell, number, dice));
                }
                std::thread::sleep(Duration::from_millis(dice.below(120)));
                let who = if round % 4 == 3 {
                    "quadrant planner"
                } else {
                    "quadrant plant-sim"
                };
                kill(&live, &cell, who);
            });
            // What it has come to.
            cell.note(usize::MAX, Event::Asked(Ask::Status));
            let told = wait(URGENT_LIMIT, || status(&cell)).expect("a status");
            cell.note(usize::MAX, Event::Told(told));
            let history = cell.history.lock().expect("the history").clone();
            let count = |of: fn(&Event) -> bool| history.iter().filter(|(_, e)| of(e)).count();
            let (questions, answers) = (
                count(|e| matches!(e, Event::Asked(_))),
                count(|e| matches!(e, Event::Told(_))),
            );
            asked += questions;
            unanswered += questions - answers;
            judge(began, &history);
        }
    });
    println!("{rounds} rounds, {asked} orders and looks, {unanswered} without an answer");
    obeyed(&live, &["down"]);
}
