use std::sync::mpsc;
use std::time::Duration;

use super::*;

/// Whoever takes part waits for a place that is taken for a moment; a foreign process is refused at once.
#[test]
fn a_member_waits_for_a_writers_place() {
    let place = CellPaths::new(&format!("w{}", std::process::id())).expect("a name");
    let owned = place.own(Duration::ZERO).expect("the cell");
    let shape = Shape {
        axes: vec!["X".into()],
        period_scans: 4,
        has_bus: false,
        has_signals: false,
        has_logic: false,
    };
    let enter = |who| Bus::enter(&place, &shape, who, false).expect("shared memory");
    let launcher = Bus::enter(&place, &shape, "launcher", true).expect("shared memory");
    let services = launcher.create_all().expect("services");
    let (taken, is_taken) = mpsc::channel();
    std::thread::scope(|scope| {
        scope.spawn(|| {
            let other = enter("other");
            let writer = other.feedback_writer().expect("the place is free");
            taken.send(()).expect("somebody waits");
            std::thread::sleep(Duration::from_millis(300));
            drop(writer);
        });
        is_taken.recv().expect("it is taken");
        assert!(enter("foreign").feedback_writer().is_err());
        assert!(enter("master").patient().feedback_writer().is_ok());
    });
    drop((services, launcher));
    drop(owned);
}
