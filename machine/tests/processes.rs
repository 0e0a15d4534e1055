//! `[processes]`: who has which priority and processors in realtime.

use bus::sample::Job;
use machine::Machine;

/// The machine that comes with the product, with this at the end of its file.
fn with(text: &str) -> Result<Machine, String> {
    let file = include_str!("../../machines/xy/machine.toml");
    let text = format!("{file}\n{text}");
    Machine::parse("m.toml", &text).map_err(|error| error.to_string())
}

#[test]
fn without_a_word_the_clock_of_the_cell_goes_before_those_that_answer_it() {
    let machine = with("").unwrap();
    let jobs = machine.processes.jobs();
    let priorities = jobs.map(|(_, _, role, of_job)| of_job.priority.unwrap_or(role.level()));
    assert_eq!(priorities, [65, 60, 55, 50, 0, 0]);
    let (settings, processors) = machine.processes.of(Job::Servo);
    assert_eq!(settings, bus::realtime::Settings::DEFAULT);
    assert!(
        processors.is_empty(),
        "whoever starts it says where it runs"
    );
}

#[test]
fn each_kind_of_process_has_what_the_file_says() {
    let text = "[processes]\nlock_memory = false\nbusy_max_ms = 250\n\
                master.priority = 80\nmonitor.priority = 1\nservo = { processors = [2, 3] }\n";
    let machine = with(text).unwrap();
    let (master, anywhere) = machine.processes.of(Job::Master);
    assert_eq!((master.priority, master.busy_max_ms), (Some(80), 250));
    assert!(!master.lock_memory && anywhere.is_empty());
    assert_eq!(machine.processes.of(Job::Servo).1, [2, 3]);
    assert_eq!(machine.processes.of(Job::Monitor).0.priority, Some(1));
}

#[test]
fn what_cannot_be_meant_is_refused_with_its_line() {
    for (text, refusal) in [
        (
            "[processes]\nservo.priority = 61",
            "processes.master.priority = 60: must be at least the priority of servo = 61",
        ),
        (
            "[processes]\nmaster.priority = 54",
            "processes.master.priority = 54: must be at least the priority of servo = 55",
        ),
        (
            "[processes]\nmaster.priority = 99",
            "processes.master.priority = 99: must be at least 0 and at most 98",
        ),
        (
            "[processes]\nmaster.processors = [1, 2, 1]",
            "processes.master.processors names processor 1 twice",
        ),
        (
            "[processes]\nmaster.processors = [1024]",
            "must be at least 0 and at most 1023",
        ),
        ("[processes]\ntouch_stack_kb = 2000", "at most 1024 KiB"),
        (
            "[processes]\nbusy_max_ms = 1",
            "must be at least 50 and at most 60000 ms",
        ),
        ("[processes]\nrecorder.priority = 1", "recorder"),
    ] {
        let error = with(text).unwrap_err();
        assert!(error.contains(refusal), "{text}: {error}");
    }
}

#[test]
fn a_processor_that_this_pc_does_not_have_is_refused_where_the_cell_is_to_run() {
    let machine = with("[processes]\nplanner.processors = [1023]").unwrap();
    let refusal = machine.processes.check_here().unwrap_err();
    let what = "processes.planner.processors = [1023]: this PC has no processor 1023 for it";
    assert!(refusal.starts_with(what), "{refusal}");
    assert_eq!(with("").unwrap().processes.check_here(), Ok(()));
}
