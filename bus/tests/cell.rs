//! A cell's place: names that never meet, one owner, nothing left behind.

use std::time::Duration;

use bus::cell::{CellError, CellPaths};
use bus::port::Age;
use bus::sample::{Feedback, PlannerStatus, Setpoint, WindowHeader};
use bus::service::{Bus, SCAN_DEPTH, Shape};
use bus::signal_page::{CellPhase, MACHINE_STATE_BYTES, SignalPage};
use bytemuck::Zeroable;

/// A process that another test starts has this one's locks until it runs its own program.
const BRIEFLY: Duration = Duration::from_millis(200);

fn place(test: &str) -> CellPaths {
    CellPaths::new(&format!("b{}-{test}", std::process::id())).expect("a name")
}

fn shape() -> Shape {
    Shape {
        axes: vec!["X".into(), "Y".into()],
        period_scans: 4,
        has_bus: false,
        has_signals: false,
        has_logic: false,
    }
}

#[test]
fn a_cell_has_one_owner_at_a_time_and_its_folder_goes_with_him() {
    let place = place("own");
    let first = place.own(Duration::ZERO).expect("the cell");
    assert!(matches!(
        place.own(Duration::ZERO),
        Err(CellError::Running { .. })
    ));
    drop(first);
    assert!(!place.folder().exists());
    drop(place.own(BRIEFLY).expect("the cell again"));
}

#[test]
fn a_cell_whose_members_live_is_not_taken_from_them() {
    let place = place("live");
    let owner = place.own(Duration::ZERO).expect("the cell");
    let member = place.join().expect("a member");
    // The owner leaves while a member lives: the cell's files stay, and nobody else gets the cell.
    drop(owner);
    assert!(place.folder().exists());
    assert!(matches!(
        place.own(BRIEFLY),
        Err(CellError::MembersLive { .. })
    ));
    drop(member);
    drop(place.own(BRIEFLY).expect("the cell, now that nobody lives"));
    assert!(!place.folder().exists());
}

#[test]
fn names_that_could_meet_or_escape_are_refused() {
    for name in ["", "a_b", "A", "a/b", "..", "a b", "twenty-one-characters"] {
        assert!(CellPaths::new(name).is_err(), "{name:?}");
    }
    assert!(CellPaths::new("twenty-characters-ok").is_ok());
}

#[test]
fn a_name_of_full_length_fits_the_socket_path_limit() {
    let name = format!("n{:019}", std::process::id());
    let place = CellPaths::new(&name).expect("a name of 20 characters");
    let owner = place.own(Duration::ZERO).expect("the cell");
    let bus = Bus::enter(&place, &shape(), "launcher", true).expect("shared memory");
    bus.create_all().expect("services");
    drop(bus);
    drop(owner);
}

#[test]
fn a_state_is_read_back_whole_also_when_the_writer_died_in_the_middle() {
    let place = place("state");
    let owner = place.own(Duration::ZERO).expect("the cell");
    let page = SignalPage::create(&place).expect("the page");
    let mut read = [0u8; 100];
    assert!(!page.load_machine_state(&mut read), "nothing was saved yet");
    for round in 1..=5u8 {
        page.save_machine_state(&[round; 100]);
        assert!(page.load_machine_state(&mut read));
        assert_eq!(read, [round; 100]);
    }
    assert_eq!(MACHINE_STATE_BYTES % 8, 0);
    page.set_phase(CellPhase::Ending);
    assert_eq!(
        SignalPage::open(&place).expect("the page").phase(),
        CellPhase::Ending
    );
    drop(owner);
}

#[test]
fn a_reader_sets_aside_what_is_visible_only_later_and_keeps_the_order() {
    let place = place("ports");
    let owner = place.own(Duration::ZERO).expect("the cell");
    let bus = Bus::enter(&place, &shape(), "launcher", true).expect("shared memory");
    let _services = bus.create_all().expect("services");
    let mut writer = bus.planner_writer().expect("a writer");
    let mut reader = bus.planner_reader(SCAN_DEPTH).expect("a reader");
    let status = |scan| PlannerStatus {
        scan,
        visible_from: scan + 1,
        ..PlannerStatus::zeroed()
    };
    for scan in [4, 5, 6] {
        writer.send(&status(scan));
    }
    assert!(reader.next(4).is_none(), "made in scan 4, visible from 5");
    assert_eq!(reader.next(5).map(|s| s.scan), Some(4));
    assert_eq!(reader.newest(6).map(|s| s.scan), Some(5));
    assert!(reader.newest(6).is_none());
    assert_eq!(reader.newest(7).map(|s| s.scan), Some(6));
    assert_eq!((writer.failed(), reader.failed()), (0, 0));
    assert_eq!(reader.age(9), Age::Stale { age_scans: 3 });
    drop(owner);
}

#[test]
fn a_sample_that_is_never_visible_keeps_nobody_waiting() {
    let place = place("never");
    let owner = place.own(Duration::ZERO).expect("the cell");
    let bus = Bus::enter(&place, &shape(), "launcher", true).expect("shared memory");
    let _services = bus.create_all().expect("services");
    let mut writer = bus.planner_writer().expect("a writer");
    let reader = bus.planner_reader(SCAN_DEPTH).expect("a reader");
    let mut reader = reader.with_horizon(1);
    let mut windows_out = bus.window_writer().expect("a writer");
    let mut windows = bus.window_reader(SCAN_DEPTH).expect("a reader");
    for (scan, visible_from) in [(4, 5), (5, u64::MAX), (6, 9), (7, 8)] {
        writer.send(&PlannerStatus {
            scan,
            visible_from,
            ..PlannerStatus::zeroed()
        });
        let header = WindowHeader {
            first_scan: scan,
            visible_from,
            ..WindowHeader::zeroed()
        };
        assert!(windows_out.send(&header, &[Setpoint::zeroed()]));
    }
    assert_eq!(reader.next(8).map(|s| s.scan), Some(4));
    assert!(reader.next(8).is_none(), "one scan ahead it waits");
    assert_eq!(reader.failed(), 1);
    assert_eq!(reader.next(9).map(|s| s.scan), Some(6));
    assert_eq!(reader.next(9).map(|s| s.scan), Some(7));
    let mut seen = Vec::new();
    windows.each(9, |header, _| seen.push(header.first_scan));
    assert_eq!(seen, [4, 6, 7]);
    drop(owner);
}

#[test]
fn a_second_writer_of_a_service_is_refused() {
    let place = place("one");
    let owner = place.own(Duration::ZERO).expect("the cell");
    let bus = Bus::enter(&place, &shape(), "launcher", true).expect("shared memory");
    let _services = bus.create_all().expect("services");
    let _writer = bus.feedback_writer().expect("a writer");
    assert!(bus.feedback_writer().is_err());
    drop(owner);
}

#[test]
fn a_slow_reader_loses_the_oldest_and_never_holds_up_the_writer() {
    let place = place("slow");
    let owner = place.own(Duration::ZERO).expect("the cell");
    let bus = Bus::enter(&place, &shape(), "launcher", true).expect("shared memory");
    let _services = bus.create_all().expect("services");
    let mut writer = bus.feedback_writer().expect("a writer");
    let mut reader = bus.feedback_reader(SCAN_DEPTH).expect("a reader");
    let mut feedback = Feedback::zeroed();
    for scan in 0..10_000 {
        (feedback.scan, feedback.visible_from) = (scan, scan);
        writer.send(&feedback);
    }
    assert_eq!(writer.failed(), 0);
    assert_eq!(
        reader.any().map(|f| f.scan),
        Some(10_000 - SCAN_DEPTH as u64)
    );
    drop(owner);
}

#[test]
fn age_is_counted_in_scans() {
    assert_eq!(Age::of(None, 7), Age::Never);
    assert_eq!(Age::of(Some(7), 7), Age::Fresh);
    assert_eq!(Age::of(Some(4), 7), Age::Stale { age_scans: 3 });
}

/// iceoryx2 waits without end for the size of a segment whose maker was killed between making it and giving it a size.
#[test]
fn a_segment_that_was_never_finished_goes_when_the_dead_are_cleaned_up_after() {
    let place = place("size");
    let owned = place.own(Duration::ZERO).expect("the cell");
    let launcher = Bus::enter(&place, &shape(), "launcher", true).expect("shared memory");
    let services = launcher.create_all().expect("services");
    let mut writer = launcher.feedback_writer().expect("a writer");
    let mut reader = launcher.feedback_reader(SCAN_DEPTH).expect("a reader");
    let unfinished = format!("/dev/shm/qd-{}_unfinished.connection", place.name());
    std::fs::write(&unfinished, "").expect("a segment without a size");
    // Whoever lives and was only stopped over it will finish it; whoever is dead will not.
    let of = |pid: u32| {
        format!(
            "/dev/shm/qd-{}_{}.data",
            place.name(),
            u128::from(pid) << 64 | 7
        )
    };
    let mut dead = std::process::Command::new("true")
        .spawn()
        .expect("a process");
    let (living, of_dead) = (of(std::process::id()), of(dead.id()));
    dead.wait().expect("its end");
    for segment in [&living, &of_dead] {
        std::fs::write(segment, "").expect("a segment without a size");
    }
    launcher.clean_dead();
    let is_there = |path: &str| std::path::Path::new(path).exists();
    assert!(!is_there(&unfinished) && !is_there(&of_dead));
    assert!(is_there(&living), "its maker is about to give it its size");
    std::fs::remove_file(&living).expect("removing it");
    writer.send(&Feedback::zeroed());
    assert!(reader.any().is_some(), "the segments of the living stay");
    drop((writer, reader, services));
    drop(launcher);
    drop(owned);
}

/// An owner renames its folder and then removes it: killed between the two, it leaves a folder of no cell's name.
#[test]
fn a_folder_that_its_owner_was_killed_over_removing_goes_with_the_next_start_of_any_cell() {
    let left = format!(
        "/dev/shm/quadrant-other-{}.4194304.gone",
        std::process::id()
    );
    std::fs::create_dir(&left).expect("a folder");
    for lock in ["owner.lock", "members.lock"] {
        std::fs::write(format!("{left}/{lock}"), "").expect("a lock");
    }
    let _owned = place("left").own(Duration::ZERO).expect("the cell");
    assert!(!std::path::Path::new(&left).exists());
}

/// Anybody may put something of a segment's name into /dev/shm.
#[test]
fn a_link_of_a_segments_name_is_refused_and_what_it_leads_to_stays_as_it_is() {
    use std::os::unix::fs::{PermissionsExt, symlink};
    let place = place("link");
    let owned = place.own(Duration::ZERO).expect("the cell");
    let launcher = Bus::enter(&place, &shape(), "launcher", true).expect("shared memory");
    let folder = tempfile::tempdir().expect("a folder");
    let victim = folder.path().join("victim");
    std::fs::write(&victim, "text").expect("a file");
    std::fs::set_permissions(&victim, std::fs::Permissions::from_mode(0o644)).expect("a mode");
    let link = format!("/dev/shm/qd-{}_x", place.name());
    symlink(&victim, &link).expect("a link");
    let refused = launcher.create_all().expect_err("a link is in the way");
    assert!(refused.to_string().contains(&link), "{refused}");
    let mode = std::fs::metadata(&victim).expect("the file").permissions();
    assert_eq!(mode.mode() & 0o777, 0o644);
    drop(launcher);
    drop(owned);
    assert!(victim.exists(), "the link went, not what it led to");
    assert!(std::fs::symlink_metadata(&link).is_err());
}

/// Anybody of this user can remove a cell's files: the cell is still taken, and its owner takes nothing of others away.
#[test]
fn a_cell_whose_files_were_removed_is_still_its_owners() {
    let place = place("gone");
    let mut owned = place.own(Duration::ZERO).expect("the cell");
    let launcher = Bus::enter(&place, &shape(), "launcher", true).expect("shared memory");
    let services = launcher.create_all().expect("services");
    owned.note_made();
    assert_eq!(owned.removed(), None);
    let segment = |entry: &std::fs::DirEntry| {
        let name = entry.file_name().to_string_lossy().into_owned();
        name.starts_with(&format!("qd-{}_", place.name())) && name.ends_with(".dynamic")
    };
    let entries = std::fs::read_dir("/dev/shm").expect("/dev/shm").flatten();
    let segment = entries.into_iter().find(segment).expect("a segment").path();
    std::fs::remove_file(&segment).expect("removing it");
    assert_eq!(owned.removed(), Some(segment.as_path()));
    std::fs::remove_dir_all(place.folder()).expect("removing the folder");
    assert!(matches!(
        place.own(Duration::ZERO),
        Err(CellError::Running { .. })
    ));
    // What somebody else has put there meanwhile is not this owner's.
    std::fs::create_dir(place.folder()).expect("another folder");
    std::fs::write(place.folder().join("file"), "text").expect("a file in it");
    drop((services, launcher, owned));
    assert!(place.folder().join("file").exists());
    let again = place.own(Duration::ZERO).expect("the cell is free");
    assert_eq!(again.leftovers, 1);
    drop(again);
    assert!(!place.folder().exists());
}

/// A page that has no memory yet kills whoever touches it when there is none left.
#[test]
fn every_segment_has_all_its_memory_from_the_start() {
    use std::os::unix::fs::MetadataExt;
    let place = place("memory");
    let owned = place.own(Duration::ZERO).expect("the cell");
    let bus = Bus::enter(&place, &shape(), "launcher", true).expect("shared memory");
    let services = bus.create_all().expect("services");
    let page = SignalPage::create(&place).expect("the page");
    let writers = (
        bus.feedback_writer().expect("a writer"),
        bus.window_writer().expect("a writer"),
        bus.command_writer(0, 0).expect("a writer"),
    );
    let readers = (
        bus.feedback_reader(SCAN_DEPTH).expect("a reader"),
        bus.window_reader(SCAN_DEPTH).expect("a reader"),
        bus.operator_server().expect("a server"),
        bus.operator_client().expect("a client"),
    );
    let entries = std::fs::read_dir("/dev/shm").expect("/dev/shm").flatten();
    let prefix = format!("qd-{}_", place.name());
    let mut files: Vec<_> = entries
        .filter(|entry| entry.file_name().to_string_lossy().starts_with(&prefix))
        .map(|entry| entry.path())
        .collect();
    files.push(place.page());
    assert!(files.len() > 20, "{files:?}");
    for file in files {
        let found = std::fs::metadata(&file).expect("a segment");
        let has = found.blocks() * 512;
        assert!(has >= found.len(), "{file:?} has {has} of {}", found.len());
    }
    drop((readers, writers, page, services));
    drop(bus);
    drop(owned);
}
