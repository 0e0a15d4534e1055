//! A servo's side: it answers each scan and computes nothing.

use std::time::{Duration, Instant};

use bus::cell::CellPaths;
use bus::port::{Reader, Writer};
use bus::realtime;
use bus::sample::{AxisCommand, Feedback};
use bus::service::{Bus, SCAN_DEPTH};
use bus::signal_page::SignalPage;
use bytemuck::Zeroable;

use super::bare::BareServo;
use super::game::{LOOK_EVERY, patience, shape};
use super::pipes;
use crate::options::{Ball, BenchPongOptions};
use console::exit::{Kind, Outcome};
use console::signals::Signals;

/// Longest wait for the cell.
const PATIENCE: Duration = Duration::from_secs(10);
/// Longest wait for the others to leave it.
const LEAVE_LIMIT: Duration = Duration::from_secs(10);
/// How often it is looked for.
const LOOK: Duration = Duration::from_millis(2);

/// Plays until it is told to end, or its parent has ended. The first of them owns the cell, so that nothing of it stays where the bench
/// is killed.
pub fn pong(options: &BenchPongOptions) -> Outcome {
    let signals = Signals::catch().environment()?;
    let is_over = || signals.count() > 0;
    if options.ball == Ball::Pipe {
        realtime::stay_on_all(&[options.core]);
        return pipes::answer(is_over).environment();
    }
    play(options, &is_over).environment()
}

/// What is handed over beside the ring.
enum Ports {
    None,
    Samples(Reader<Feedback>, Writer<AxisCommand>),
    Bare(Box<BareServo>),
}

impl Ports {
    /// Of this servo, in a cell whose services are there.
    fn open(bus: &Bus, place: &CellPaths, options: &BenchPongOptions) -> anyhow::Result<Ports> {
        Ok(match options.ball {
            Ball::Ring | Ball::Pipe => Ports::None,
            Ball::Sample => {
                let feedback = bus.feedback_reader(SCAN_DEPTH)?;
                Ports::Samples(feedback, bus.command_writer(options.axis, 0)?)
            }
            Ball::Bare => {
                let servo = BareServo::open(place, options.axes, options.axis)?;
                Ports::Bare(Box::new(servo))
            }
        })
    }

    fn answer(&mut self) {
        match self {
            Ports::None => {}
            Ports::Samples(feedback, commands) => {
                if let Some(feedback) = feedback.any() {
                    commands.send(&AxisCommand {
                        scan: feedback.scan,
                        ..AxisCommand::zeroed()
                    });
                }
            }
            Ports::Bare(servo) => servo.answer(),
        }
    }
}

fn play(options: &BenchPongOptions, is_over: &dyn Fn() -> bool) -> anyhow::Result<()> {
    let place = CellPaths::new(&options.cell)?;
    if options.axis > 0 {
        let Some(page) = page_of(&place, is_over)? else {
            return Ok(());
        };
        let _member = place.join()?;
        let bus = Bus::enter(&place, &shape(options.axes), "pong", false)?;
        let ports = Ports::open(&bus, &place, options)?;
        return answer_all(&page, ports, options, is_over);
    }
    let cell = place.own(Duration::ZERO)?;
    let bus = Bus::enter(cell.place(), &shape(options.axes), "pong", true)?;
    let services = bus.create_all()?;
    let page = SignalPage::create(cell.place())?;
    let ports = Ports::open(&bus, cell.place(), options)?;
    answer_all(&page, ports, options, is_over)?;
    let since = Instant::now();
    // Who is still in the cell would keep its files from going.
    let is_empty = || (0..options.axes).all(|axis| page.ready_incarnation(axis) == 0);
    while !is_empty() && since.elapsed() < LEAVE_LIMIT {
        std::thread::sleep(LOOK);
    }
    drop((services, bus, page, cell));
    // A bench that is being killed may have kept some of it a moment longer.
    place.own(LEAVE_LIMIT)?;
    Ok(())
}

/// The page of the cell, once it is there with all its services; none if it is over before.
fn page_of(place: &CellPaths, is_over: &dyn Fn() -> bool) -> anyhow::Result<Option<SignalPage>> {
    let since = Instant::now();
    loop {
        match SignalPage::open(place) {
            // The owner has its ports.
            Ok(page) if page.ready_incarnation(0) == 1 => return Ok(Some(page)),
            _ if is_over() => return Ok(None),
            Err(error) if since.elapsed() > PATIENCE => return Err(error.into()),
            _ => std::thread::sleep(LOOK),
        }
    }
}

fn answer_all(
    page: &SignalPage,
    mut ports: Ports,
    options: &BenchPongOptions,
    is_over: &dyn Fn() -> bool,
) -> anyhow::Result<()> {
    realtime::stay_on_all(&[options.core]);
    let mut seen = page.scan_signal().count();
    page.set_ready(options.axis, 1);
    let patience = patience(options.awake);
    loop {
        let is_there = || page.scan_signal().count() != seen;
        if !patience.try_for(is_there) && !is_there() {
            page.scan_signal().wait(seen, LOOK_EVERY);
            if page.scan_signal().count() == seen && is_over() {
                break;
            }
            continue;
        }
        seen = page.scan_signal().count();
        ports.answer();
        page.answered();
    }
    drop(ports);
    page.set_ready(options.axis, 0);
    Ok(())
}
