//! What goes wrong on a bus in operation: each trouble stops the machine, is told by what it is, and `enable` brings the drives back
//! without a restart of the cell. Drives run by their own clock here, and their watchdogs with it.

use crate::live::{Up, has_stopped};
use crate::segment::Network;

/// One kind of trouble.
struct Trouble {
    name: &'static str,
    /// Orders to the segment; `link` is of the interface's other end.
    begins: &'static str,
    ends: &'static str,
    /// Of the cause that a status tells.
    words: &'static str,
    /// Enabling is refused first, and says so.
    enable_says: Option<&'static str>,
}

const NONE: Trouble = Trouble {
    name: "",
    begins: "",
    ends: "",
    words: "",
    enable_says: None,
};
const TROUBLES: [Trouble; 9] = [
    Trouble {
        name: "the link goes down",
        begins: "link down",
        ends: "link up",
        words: "(the interface has no link",
        ..NONE
    },
    Trouble {
        name: "nobody answers",
        begins: "drop 0",
        ends: "restore 0",
        words: "(nobody on the bus does, and the interface has a link",
        ..NONE
    },
    Trouble {
        name: "all answers are late",
        begins: "trouble late 400",
        words: "(answers come, all too late",
        ..NONE
    },
    Trouble {
        name: "a cable breaks between two drives",
        begins: "drop 1",
        ends: "restore 1",
        words: "axis Y: drive does not answer (others on the bus do: look at its power, and at the cable in front of it)",
        ..NONE
    },
    Trouble {
        name: "a drive is off and on again",
        begins: "power-cycle 2",
        words: "axis Z: drive does not answer (others on the bus do",
        ..NONE
    },
    Trouble {
        name: "a drive is sent to INIT by a tool",
        begins: "reset 1",
        words: "axis Y: drive does not answer as it should: somebody took it out of operation, it is in INIT",
        ..NONE
    },
    Trouble {
        name: "a drive has a fault",
        begins: "fault 0",
        ends: "clear 0",
        words: "drive fault 1001h",
        ..NONE
    },
    Trouble {
        name: "an axis is turned while its drive is off",
        // 25 mm at 10 mm a radian.
        begins: "away 1 2.5",
        words: "axis Y: drive does not answer (others on the bus do",
        enable_says: Some("axis came back elsewhere than its drive was lost"),
        ..NONE
    },
    Trouble {
        name: "two drives change places",
        begins: "exchange 0 1",
        ends: "exchange 0 1",
        words: "axis X: drive does not answer (others on the bus do",
        enable_says: Some("it was at place 1 before: put the cables back as they were"),
    },
];

impl Up<'_> {
    fn trouble(&self, trouble: &Trouble) {
        let what = trouble.name;
        self.tell(trouble.begins);
        self.await_status(what, has_stopped);
        self.await_words(what, trouble.words);
        match trouble.enable_says {
            None => self.tell(trouble.ends),
            Some(says) => {
                assert!(self.ask(&["enable"]).is_err(), "{what}: {}", self.status());
                self.await_words(what, says);
                self.tell(trouble.ends);
                if trouble.ends.is_empty() {
                    // The rest of its way of braking beside it.
                    self.await_words(what, "(+2");
                    self.order(&["alarms", "acknowledge"]);
                }
            }
        }
        self.enable(what);
        self.await_mode(what, "enabled");
        self.order(&["resume"]);
    }
}

#[test]
fn each_trouble_of_the_bus_stops_the_machine_says_what_it_is_and_enable_brings_the_drives_back() {
    let rounds =
        std::env::var("QUADRANT_TROUBLES").map_or(1, |rounds| rounds.parse().expect("a number"));
    let Some(network) = Network::new() else {
        return;
    };
    // A busy PC is not what is tried here.
    let up = Up::new(&network, &[("watchdog_ms = 10", "watchdog_ms = 30")], &[]);
    for round in 0..rounds {
        for (index, trouble) in (1..).zip(&TROUBLES) {
            up.pause(31 * round + index);
            up.trouble(trouble);
        }
    }
    up.end();
}
