//! Every interleaving of the processes that share the words of the signal page, and of their deaths.
//!
//! The words are the product's own file, over the atomics of `loom`. A process that is killed does nothing from then on: its stores are
//! dropped. Built with a flag of its own: `RUSTFLAGS="--cfg page_model" cargo test --release -p page-model --target-dir target/page-model`.

#![cfg(all(test, page_model))]

mod atomic {
    //! Atomics whose thread can be killed.

    use std::cell::Cell;

    pub use loom::sync::atomic::{Ordering, fence};

    loom::thread_local! {
        /// Stores that the thread still does before it is killed.
        static LIFE: Cell<usize> = Cell::new(usize::MAX);
    }

    /// The thread is killed after so many stores.
    pub fn dies_after(stores: usize) {
        LIFE.with(|life| life.set(stores));
    }

    /// Whether the thread lives; one store less is left to it.
    fn lives() -> bool {
        LIFE.with(|life| {
            let left = life.get();
            life.set(left.saturating_sub(usize::from(left != usize::MAX)));
            left > 0
        })
    }

    macro_rules! mortal {
        ($name:ident, $loom:ident, $value:ty) => {
            #[derive(Debug, Default)]
            pub struct $name(loom::sync::atomic::$loom);

            #[allow(dead_code)]
            impl $name {
                pub fn new(value: $value) -> Self {
                    $name(loom::sync::atomic::$loom::new(value))
                }

                pub fn load(&self, order: Ordering) -> $value {
                    self.0.load(order)
                }

                pub fn store(&self, value: $value, order: Ordering) {
                    if lives() {
                        self.0.store(value, order);
                    }
                }

                pub fn fetch_add(&self, value: $value, order: Ordering) -> $value {
                    if lives() {
                        self.0.fetch_add(value, order)
                    } else {
                        0
                    }
                }

                pub fn fetch_sub(&self, value: $value, order: Ordering) -> $value {
                    if lives() {
                        self.0.fetch_sub(value, order)
                    } else {
                        0
                    }
                }

                pub fn fetch_max(&self, value: $value, order: Ordering) -> $value {
                    if lives() {
                        self.0.fetch_max(value, order)
                    } else {
                        0
                    }
                }

                pub fn swap(&self, value: $value, order: Ordering) -> $value {
                    if lives() {
                        self.0.swap(value, order)
                    } else {
                        0
                    }
                }
            }
        };
    }

    mortal!(AtomicU32, AtomicU32, u32);
    mortal!(AtomicU64, AtomicU64, u64);
}

#[path = "../../../bus/src/signal_page/words.rs"]
#[allow(dead_code)]
mod words;

use std::sync::atomic::{AtomicUsize, Ordering as Plain};

use atomic::{AtomicU32, AtomicU64, Ordering, dies_after};
use loom::sync::Arc;
use loom::thread;
use words::{Outstanding, Requests, Rings, Saved, Urgent};

/// Tries every interleaving; how many there were.
fn every(what: &str, run: impl Fn() + Sync + Send + 'static) {
    every_with(3, what, run);
}

/// The same with so many changes from one thread to another that none has asked for.
fn every_with(changes: usize, what: &str, run: impl Fn() + Sync + Send + 'static) {
    let tried = std::sync::Arc::new(AtomicUsize::new(0));
    let count = std::sync::Arc::clone(&tried);
    let mut builder = loom::model::Builder::new();
    builder.preemption_bound = Some(changes);
    builder.check(move || {
        count.fetch_add(1, Plain::Relaxed);
        run();
    });
    println!("{what}: {} interleavings", tried.load(Plain::Relaxed));
}

/// An answer of two words that say the same: the judgement it is of.
fn judged(count: &std::sync::Arc<AtomicUsize>) -> [u64; 2] {
    [count.fetch_add(1, Plain::Relaxed) as u64 + 1; 2]
}

/// Gives an order and looks twice for its answer.
fn client(page: &Urgent<2, 2>) -> (u32, Option<[u64; 2]>) {
    let number = page.ask();
    let first = page.answer(number);
    let answer = first.or_else(|| {
        thread::yield_now();
        page.answer(number)
    });
    (number, answer)
}

/// Two clients and a master: each order is judged once, its answer is whole, and it is the same whenever it is looked for.
#[test]
fn an_urgent_order_is_judged_once_and_has_one_answer() {
    every("two clients", || {
        let page = Arc::new(Urgent::<2, 2>::new());
        let count = std::sync::Arc::new(AtomicUsize::new(0));
        let clients = [0, 1].map(|_| {
            let page = Arc::clone(&page);
            thread::spawn(move || client(&page))
        });
        page.serve(|| judged(&count));
        page.serve(|| judged(&count));
        let answers = clients.map(|client| client.join().expect("a client"));
        // Whoever was late is served now.
        page.serve(|| judged(&count));
        assert!((1..=2).contains(&count.load(Plain::Relaxed)));
        for (number, early) in answers {
            let answer = page.answer(number).expect("an answer");
            assert_eq!(answer[0], answer[1], "torn");
            assert!(
                early.is_none_or(|early| early == answer),
                "{early:?}, then {answer:?}"
            );
        }
        // An order that was answered is not judged again.
        page.serve(|| unreachable!("nobody has asked"));
    });
}

/// A client that looks late while others go on asking finds its own answer or none, never that of another.
#[test]
fn a_late_client_never_takes_the_answer_of_another() {
    every_with(2, "a late client", || {
        let page = Arc::new(Urgent::<2, 2>::new());
        let count = std::sync::Arc::new(AtomicUsize::new(0));
        let number = page.ask();
        page.serve(|| judged(&count));
        let late = {
            let page = Arc::clone(&page);
            thread::spawn(move || page.answer(number))
        };
        // More than are kept.
        for _ in 0..3 {
            page.ask();
            page.serve(|| judged(&count));
        }
        let answer = late.join().expect("a client");
        assert!(answer.is_none_or(|answer| answer == [1, 1]), "{answer:?}");
    });
}

/// A master that is killed at any store of serving: the next one serves the order, and no answer that was read changes.
#[test]
fn a_master_killed_at_any_moment_leaves_no_order_unanswered_and_no_answer_torn() {
    for stores in 0..9 {
        every(&format!("killed after {stores} stores"), move || {
            let page = Arc::new(Urgent::<2, 2>::new());
            let count = std::sync::Arc::new(AtomicUsize::new(0));
            let asking = {
                let page = Arc::clone(&page);
                thread::spawn(move || client(&page))
            };
            let dying = {
                let (page, count) = (Arc::clone(&page), std::sync::Arc::clone(&count));
                thread::spawn(move || {
                    dies_after(stores);
                    page.serve(|| judged(&count));
                })
            };
            // It was reaped before another one starts.
            dying.join().expect("a master");
            page.serve(|| judged(&count));
            let (number, early) = asking.join().expect("a client");
            page.serve(|| judged(&count));
            let answer = page.answer(number).expect("an answer");
            assert_eq!(answer[0], answer[1], "torn");
            assert!(
                early.is_none_or(|early| early == answer),
                "{early:?}, then {answer:?}"
            );
        });
    }
}

/// The signal as the page has it, without the sleeping.
#[derive(Default)]
struct Signal(AtomicU32);

impl Signal {
    fn count(&self) -> u32 {
        self.0.load(Ordering::Acquire)
    }

    fn raise(&self) {
        self.0.fetch_add(1, Ordering::Release);
    }

    /// For ever, if nobody rings: `loom` reports that.
    fn wait(&self, seen: u32) {
        while self.count() == seen {
            thread::yield_now();
        }
    }
}

/// What two servos and a master share.
#[derive(Default)]
struct Scan {
    signal: Signal,
    outstanding: Outstanding,
    answers: [AtomicU64; 2],
}

impl Scan {
    fn answer(&self, servo: usize) {
        self.answers[servo].store(1, Ordering::Release);
        if self.outstanding.answered() {
            self.signal.raise();
        }
    }

    fn answered(&self) -> usize {
        let answers = self.answers.iter();
        answers
            .filter(|word| word.load(Ordering::Acquire) == 1)
            .count()
    }
}

/// The last one to answer rings: a master that waits for it is woken, and finds all answers.
#[test]
fn no_answer_of_a_scan_is_waited_for_in_vain() {
    every("two answers", || {
        let scan = Arc::new(Scan::default());
        let seen = scan.signal.count();
        scan.outstanding.expect(2);
        let servos = [0, 1].map(|servo| {
            let scan = Arc::clone(&scan);
            thread::spawn(move || scan.answer(servo))
        });
        scan.signal.wait(seen);
        assert_eq!(scan.answered(), 2);
        for servo in servos {
            servo.join().expect("a servo");
        }
    });
}

/// One of two that were counted has died: the count comes to nothing, and from then on each answer rings.
#[test]
fn an_answer_after_a_death_is_not_waited_for_in_vain() {
    every("one answer and a death", || {
        let scan = Arc::new(Scan::default());
        scan.outstanding.expect(2);
        let living = {
            let scan = Arc::clone(&scan);
            thread::spawn(move || scan.answer(0))
        };
        // The launcher has rung for the death; the master looks, and looks again once it is told of each.
        scan.outstanding.expect_eagerly();
        loop {
            let seen = scan.signal.count();
            if scan.answered() == 1 {
                break;
            }
            scan.signal.wait(seen);
        }
        living.join().expect("a servo");
    });
}

/// A word that is set before the ring is seen after it: an order to stop, the phase, who is ready.
#[test]
fn who_waits_for_a_stop_or_for_the_end_is_always_woken() {
    every("a stop and the end", || {
        let page = Arc::new((Signal::default(), Urgent::<1, 2>::new(), AtomicU32::new(0)));
        let client = {
            let page = Arc::clone(&page);
            thread::spawn(move || {
                page.1.ask();
                page.0.raise();
            })
        };
        let launcher = {
            let page = Arc::clone(&page);
            thread::spawn(move || {
                page.2.store(2, Ordering::Release);
                page.0.raise();
            })
        };
        let (signal, urgent, phase) = &*page;
        let (mut stopped, mut ended) = (false, false);
        while !(stopped && ended) {
            let seen = signal.count();
            urgent.serve(|| {
                stopped = true;
                [1]
            });
            ended = phase.load(Ordering::Acquire) == 2;
            if !(stopped && ended) {
                signal.wait(seen);
            }
        }
        client.join().expect("a client");
        launcher.join().expect("a launcher");
    });
}

/// A master asks, dies, and the next one asks for something else: the launcher never sees a mixture.
#[test]
fn a_request_to_the_launcher_is_never_torn_by_the_next_one() {
    every("two requests", || {
        let requests = Arc::new(Requests::default());
        let launcher = {
            let requests = Arc::clone(&requests);
            thread::spawn(move || {
                for _ in 0..2 {
                    if let Some((ticket, index, step, scan)) = requests.open() {
                        let number = ticket as u32;
                        assert_eq!((index, step, scan), (number, number + 10, ticket + 20));
                        requests.answer(ticket);
                    }
                }
            })
        };
        for ticket in 1..=2 {
            assert_eq!(
                requests.ask(ticket, ticket + 10, u64::from(ticket) + 20),
                u64::from(ticket)
            );
        }
        launcher.join().expect("a launcher");
        if let Some((ticket, ..)) = requests.open() {
            assert_eq!(ticket, 2);
            requests.answer(2);
        }
        assert!(requests.is_done(2) && requests.open().is_none());
    });
}

/// What is saved is the state before or the one after, whole, wherever the master was killed.
#[test]
fn a_state_is_never_saved_half() {
    for stores in 0..12 {
        every(
            &format!("saving, killed after {stores} stores"),
            move || {
                let saved = Arc::new(Saved::<3>::new());
                let load = |saved: &Saved<3>| saved.load().map(|words| words.collect::<Vec<_>>());
                assert_eq!(load(&saved), None);
                saved.save([1; 3].into_iter());
                let dying = {
                    let saved = Arc::clone(&saved);
                    thread::spawn(move || {
                        dies_after(stores);
                        saved.save([2; 3].into_iter());
                        saved.save([3; 3].into_iter());
                    })
                };
                dying.join().expect("a master");
                let words = load(&saved).expect("a state");
                assert!(words.iter().all(|word| *word == words[0]), "{words:?}");
                // The next one saves on.
                saved.save([4; 3].into_iter());
                assert_eq!(load(&saved), Some(vec![4; 3]));
            },
        );
    }
}

/// One falls asleep while a signal is raised: it is woken, or does not fall asleep.
#[test]
fn nobody_sleeps_through_a_signal() {
    every("one asleep", || {
        let rings = Arc::new(Rings::default());
        let asleep = {
            let rings = Arc::clone(&rings);
            thread::spawn(move || {
                rings.sleep();
                // As the kernel does: nobody falls asleep over a count that has changed.
                rings.count.load(Ordering::Acquire) == 0
            })
        };
        let is_woken = rings.raise();
        assert!(!asleep.join().expect("the sleeper") || is_woken);
        rings.rise();
        assert!(!rings.raise(), "nobody sleeps");
    });
}
