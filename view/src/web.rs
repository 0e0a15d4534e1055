//! A cell as a page in the browser: `quadrant web`, and what `--web` starts (docs/howto/web.md).
//!
//! A reader descends so: this loop looks at the cell twenty times a second as the terminal's view does, through the same [`Feed`]
//! into the same model, and lays down what there is to show: a `frame` of JSON, and the `pictures` that are too large for each
//! frame. A thread of its own (`server`) hands both to browsers, behind its `guard`, and takes `orders`. The cell waits for none
//! of them: to it this process is a monitor, and whoever gives an order from the page gives it as the command line would.

mod frame;
mod guard;
mod orders;
mod pictures;
pub mod place;
mod server;
mod token;

use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use axum::body::Bytes;
use bus::cell::CellPaths;
use console::exit::{Kind, Outcome};
use console::signals::Signals;
use console::{logs, output};
use tokio::sync::watch;

use crate::live::feed::Feed;
use crate::live::source::Source;
use crate::live::trail::Trail;
use crate::options::WebOptions;
use frame::Frame;
use pictures::Pictures;
use place::Place;
use server::Served;

/// Time between two frames.
const FRAME: Duration = Duration::from_millis(50);
/// Share of it that is spent at the signal of the scan, for the timing.
const LISTEN: Duration = Duration::from_millis(10);
/// Time between two pictures of the circle.
const CIRCLE_EVERY: Duration = Duration::from_millis(250);
/// Time between two looks for the next cell.
const NEXT_CELL_EVERY: Duration = Duration::from_millis(250);
/// So long the last frame has for its way to the browsers.
const LAST_FRAME: Duration = Duration::from_millis(150);
/// The page of a launcher whose cell is gone leaves after so long.
const ALONE: Duration = Duration::from_secs(2);
/// Behind whatever controls the machine, where priorities are ordinary.
const NICE: i32 = 10;

/// `quadrant web`.
pub fn web(options: &WebOptions) -> Outcome {
    logs::init_launcher();
    output::never_wait();
    let signals = Signals::catch().environment()?;
    let feed = Feed::attach(options.cell.as_deref())?;
    let place = if options.inherited {
        Place::inherited(options.token_to_look).input()?
    } else {
        let token = options.token.as_deref();
        let place = Place::open(options.address, token, options.token_to_look)?;
        output::say(&place.words());
        place
    };
    // Whoever may not be nice is served all the same.
    let _ = rustix::process::nice(NICE);
    let Place {
        listener,
        token,
        shown_to_all,
        ..
    } = place;
    let (frames, newest) = watch::channel(Bytes::new());
    let pictures = Arc::new(Mutex::new(Pictures::new(&feed.model)));
    let served = Served {
        frames: newest,
        pictures: Arc::clone(&pictures),
        token,
        shown_to_all,
        cell: CellPaths::new(&feed.model.cell).input()?.name().into(),
    };
    server::start(listener, served).environment()?;
    let page = Page {
        feed,
        frames,
        pictures,
        of_launcher: options.inherited,
        number: 0,
        session: 1,
    };
    page.run(&signals)
}

struct Page {
    feed: Feed,
    frames: watch::Sender<Bytes>,
    pictures: Arc<Mutex<Pictures>>,
    /// It ends with the launcher that has started it.
    of_launcher: bool,
    /// Of the last frame.
    number: u64,
    /// Counts the cells that were shown.
    session: u32,
}

impl Page {
    fn run(mut self, signals: &Signals) -> Outcome {
        self.feed.model.trail = Some(Trail::default());
        let mut due = Instant::now();
        let mut circle_due = due;
        let mut next_cell_due = due;
        let mut gone = None;
        while signals.count() == 0 {
            self.look(&mut circle_due);
            if self.feed.is_gone() {
                let since = *gone.get_or_insert_with(Instant::now);
                if self.of_launcher && since.elapsed() > ALONE {
                    break;
                }
                if !self.of_launcher && Instant::now() >= next_cell_due {
                    next_cell_due = Instant::now() + NEXT_CELL_EVERY;
                    self.next_cell();
                }
            } else {
                gone = None;
            }
            self.feed.watch_periods(LISTEN);
            due = (due + FRAME).max(Instant::now());
            std::thread::sleep(due.saturating_duration_since(Instant::now()));
        }
        self.look(&mut circle_due);
        std::thread::sleep(LAST_FRAME);
        Ok(())
    }

    /// One look at the cell, and one frame of it.
    fn look(&mut self, circle_due: &mut Instant) {
        self.feed.look();
        let with_circle = Instant::now() >= *circle_due;
        if with_circle {
            *circle_due = Instant::now() + CIRCLE_EVERY;
        }
        let mut pictures = pictures::locked(&self.pictures);
        let new = pictures.follow(&mut self.feed.model);
        let drawn = pictures.state();
        drop(pictures);
        // Nobody looks but the server, who passes them on.
        if self.frames.receiver_count() <= 1 {
            return;
        }
        self.number += 1;
        let frame = Frame {
            number: self.number,
            session: self.session,
            has_ended: self.feed.has_ended(),
            with_circle,
            drawn,
            new: &new,
        };
        self.frames.send_replace(frame.as_event(&self.feed.model));
    }

    /// The run is over: the next cell of that name is shown as soon as there is one.
    fn next_cell(&mut self) {
        self.feed.follow();
        if self.feed.is_gone() {
            return;
        }
        self.session += 1;
        self.feed.model.trail = Some(Trail::default());
        *pictures::locked(&self.pictures) = Pictures::new(&self.feed.model);
    }
}
