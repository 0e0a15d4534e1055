use super::*;

fn message(number: u32, text: &str) -> ProgramMessage {
    ProgramMessage {
        number,
        line: number + 10,
        log_only: number.is_multiple_of(2),
        text: text.into(),
    }
}

fn feedback(run: u32, messages: u32) -> Feedback {
    let mut feedback = Feedback::zeroed();
    feedback.run = run;
    feedback.messages = messages;
    feedback.program = ProgramState::Running as u32;
    feedback
}

#[test]
fn a_text_is_heard_once_and_not_before_the_path_is_there() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("messages");
    let mut writer = MessageWriter::new(path.clone());
    let mut reader = MessageReader::new(path);
    assert!(reader.hear(&feedback(1, 0)).is_empty());
    let all = [message(1, "one"), message(2, "two"), message(3, "three")];
    writer.write(0, 1, &all).expect("room");
    assert!(reader.hear(&feedback(1, 0)).is_empty());
    assert_eq!(reader.hear(&feedback(1, 2)).messages, all[..2]);
    assert!(reader.hear(&feedback(1, 2)).is_empty());
    // A planner after the first one writes the same again.
    writer.write(0, 1, &all).expect("room");
    assert!(reader.hear(&feedback(1, 2)).is_empty());
    let mut done = feedback(1, 2);
    done.program = ProgramState::Done as u32;
    assert_eq!(reader.hear(&done).messages, all[2..]);
    assert!(reader.hear(&done).is_empty());
}

#[test]
fn who_reads_late_finds_what_a_run_said_though_the_next_one_speaks() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("messages");
    let mut writer = MessageWriter::new(path.clone());
    let mut reader = MessageReader::new(path);
    for run in [7, 8] {
        let said = [message(1, "begins"), message(2, &format!("why {run} ends"))];
        writer.write(0, run, &said).expect("room");
    }
    for run in [7, 8] {
        let heard = reader.hear(&feedback(run, 2));
        assert_eq!(heard.messages.len(), 2, "{heard:?}");
        assert_eq!(&*heard.messages[1].text, format!("why {run} ends"));
    }
}

#[test]
fn texts_of_another_run_and_broken_ones_are_counted_and_not_shown() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("messages");
    let mut writer = MessageWriter::new(path.clone());
    writer.write(0, 1, &[message(1, "of run 1")]).expect("room");
    let mut reader = MessageReader::new(path.clone());
    assert_eq!(reader.hear(&feedback(2, 1)).dropped, 1);
    let two = message(2, "of run 2");
    writer
        .write(0, 2, std::slice::from_ref(&two))
        .expect("room");
    let bytes = std::fs::read(&path).expect("the file");
    for at in 0..SLOT_BYTES {
        let mut damaged = bytes.clone();
        damaged[2 * SLOT_BYTES + at] ^= 1;
        std::fs::write(&path, damaged).expect("the file");
        let mut reader = MessageReader::new(path.clone());
        reader.skip_to(&feedback(2, 2), 1);
        let heard = reader.hear(&feedback(2, 2));
        assert_eq!((heard.messages.len(), heard.dropped), (0, 1), "byte {at}");
    }
    std::fs::write(&path, &bytes).expect("the file");
    assert_eq!(reader.hear(&feedback(2, 2)).messages, [two]);
}

#[test]
fn a_flood_costs_no_more_room_and_its_drops_are_counted() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("messages");
    let mut writer = MessageWriter::new(path.clone());
    let count = 5 * MESSAGES_KEPT;
    for number in 1..=count {
        let text = format!("number {number}");
        writer.write(7, 1, &[message(number, &text)]).expect("room");
    }
    let bytes = std::fs::metadata(&path).expect("the file").len();
    assert!(bytes <= u64::from(RUNS_KEPT * (MESSAGES_KEPT + 1)) * SLOT_BYTES as u64);
    let mut of_load = feedback(1, count);
    of_load.load = 7;
    let heard = MessageReader::new(path).hear(&of_load);
    assert_eq!(heard.messages.len() as u32 + heard.dropped, count);
    assert_eq!(heard.messages.len() as u32, MESSAGES_KEPT);
    assert_eq!(heard.messages.last().map(|m| m.number), Some(count));
}

#[test]
fn a_long_text_is_cut_between_two_characters() {
    let long = "ä".repeat(TEXT_BYTES);
    let slot = Slot::of(0, 1, &message(1, &long));
    let read = slot.message(1, 1).expect("it is whole");
    assert!(read.text.ends_with("ä…") && read.text.len() <= TEXT_BYTES);
}

/// As the feedback of a faulty master may have it.
#[test]
fn a_number_of_texts_that_no_program_has_keeps_nobody_from_the_next_feedback() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("messages");
    let one = message(1, "one");
    let mut writer = MessageWriter::new(path.clone());
    writer
        .write(0, 1, std::slice::from_ref(&one))
        .expect("room");
    for state in ProgramState::ALL {
        for messages in [u32::MAX, u32::MAX - 1, 1 << 31] {
            let (path, heard) = (path.clone(), std::sync::mpsc::channel());
            let one = one.clone();
            // A reader that does not come back is left alone.
            std::thread::spawn(move || {
                let mut reader = MessageReader::new(path);
                let mut wrong = feedback(1, messages);
                wrong.program = state as u32;
                reader.hear(&wrong);
                reader.skip_to(&feedback(1, 0), 0);
                let _ = heard.0.send(reader.hear(&feedback(1, 1)).messages == [one]);
            });
            let limit = std::time::Duration::from_secs(20);
            let came = heard.1.recv_timeout(limit);
            assert_eq!(came, Ok(true), "{messages} in {state:?}");
        }
    }
}
