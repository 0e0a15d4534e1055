//! Orders from another machine to a real cell: over TLS, of the operators that are named; without that, none.

use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Output, Stdio};

use bus::sample::Mode;

use crate::certificates::{self, Authority, Wish, operator};
use crate::proxy::free_port;
use crate::support::{Bench, LiveCell, long_program, quadrant};

/// `quadrant remote serve`, ended with its owner.
struct Served(Child);

impl Drop for Served {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Starts it; with orders, until it says that it takes them.
fn serve(cell: &str, orders: &[&str]) -> Served {
    let listen = format!("tcp/127.0.0.1:{}", free_port());
    let mut command = quadrant();
    command.args(["remote", "serve", "--cell", cell, "--listen", &listen]);
    command.args(orders).stdout(Stdio::piped());
    let mut served = Served(command.spawn().expect("quadrant"));
    let out = served.0.stdout.take().expect("its output");
    let mut lines = BufReader::new(out).lines().map_while(Result::ok);
    assert!(lines.any(|line| line.contains("read only")), "it serves");
    // It prints what it obeys: somebody has to read that.
    std::thread::spawn(move || lines.for_each(|line| eprintln!("{line}")));
    served
}

fn order(words: &[&str], to: &str, tls: &Path, cell: &str) -> Output {
    let mut command = quadrant();
    command.args(["remote", "order"]).args(words);
    command.args(["--to", to, "--cell", cell, "--tls"]).arg(tls);
    command.output().expect("quadrant")
}

fn shown(output: &Output) -> String {
    let [out, err] = [&output.stdout, &output.stderr].map(|b| String::from_utf8_lossy(b));
    format!("{out}{err}")
}

#[test]
fn an_operator_on_another_machine_holds_and_stops_a_cell_and_nobody_else_does() {
    if !certificates::can_be_made() {
        return;
    }
    let _alone = crate::alone();
    let (ours, theirs) = (Authority::new("ours"), Authority::new("theirs"));
    let controller = ours.identity(certificates::server(), &ours);
    let bench = Bench::of("xy", &[]);
    let program = bench.file("long.ngc", &long_program());
    let mut cell = LiveCell::start(bench.path(), &program, "realtime");
    cell.wait_for_scan(200);
    let name = cell.cell.clone();
    let to = format!("tls/127.0.0.1:{}", free_port());
    let alice = ours.identity(operator("alice"), &ours);

    // Off unless it is asked for.
    let served = serve(&name, &[]);
    let refused = order(&["hold"], &to, &alice, &name);
    assert_eq!(refused.status.code(), Some(3), "{}", shown(&refused));
    assert!(
        shown(&refused).contains("Connection refused"),
        "{}",
        shown(&refused)
    );
    drop(served);

    let tls = controller.to_str().expect("a path");
    let _served = serve(
        &name,
        &["--orders", &to, "--tls", tls, "--operator", "alice"],
    );
    let old = Wish {
        days: -1,
        ..operator("alice")
    };
    let nobody = [
        (
            ours.identity(operator("mallory"), &ours),
            1,
            "none of its operators",
        ),
        (
            theirs.identity(operator("alice"), &ours),
            3,
            "does not believe this certificate",
        ),
        (ours.identity(old, &ours), 3, "Expired"),
        (
            ours.identity(operator("alice"), &theirs),
            3,
            "not believed here",
        ),
    ];
    for (identity, status, words) in &nobody {
        let refused = order(&["stop"], &to, identity, &name);
        assert_eq!(refused.status.code(), Some(*status), "{}", shown(&refused));
        assert!(shown(&refused).contains(words), "{}", shown(&refused));
    }
    let missing = bench.path().join("nothing");
    let refused = order(&["stop"], &to, &missing, &name);
    assert_eq!(refused.status.code(), Some(2), "{}", shown(&refused));
    assert!(
        shown(&refused).contains("ca.pem: No such file"),
        "{}",
        shown(&refused)
    );
    for words in [&["jog"][..], &["down"], &["load"], &["start"]] {
        let refused = order(words, &to, &alice, &name);
        assert_eq!(refused.status.code(), Some(2), "{}", shown(&refused));
    }
    let feedback = cell.wait_for_scan(0);
    assert_eq!((feedback.mode, feedback.hold), (Mode::Enabled as u32, 0));
    assert_eq!(feedback.override_percent, 100);

    let obeyed = |words: &[&str], answer: &str| {
        let done = order(words, &to, &alice, &name);
        assert_eq!(done.status.code(), Some(0), "{}", shown(&done));
        assert!(shown(&done).contains(answer), "{}", shown(&done));
    };
    obeyed(&["override", "40"], "override 40 %");
    cell.wait_for(|feedback| feedback.override_percent == 40);
    let refused = order(&["override", "140"], &to, &alice, &name);
    assert_eq!(refused.status.code(), Some(1), "{}", shown(&refused));
    assert!(
        shown(&refused).contains("0 to 100 %"),
        "{}",
        shown(&refused)
    );
    obeyed(&["hold"], "comes to rest on the path");
    cell.wait_for(|feedback| feedback.hold == 1 && feedback.at_rest == 1);
    obeyed(&["resume"], "resumed");
    cell.wait_for(|feedback| feedback.at_rest == 0);
    obeyed(&["stop"], "stopping");
    let run = cell.finish();
    assert_eq!(run.status(), 1, "{}", run.stderr());
    // The cell has ended: the truth, and no order for another.
    let late = order(&["hold"], &to, &alice, &name);
    assert_ne!(late.status.code(), Some(0), "{}", shown(&late));
}
