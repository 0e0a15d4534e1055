use super::*;

#[test]
fn a_test_that_is_over_has_its_name_what_became_of_it_and_its_time() {
    let line = r#"{ "type": "test", "name": "faults::kills", "event": "ok", "exec_time": 1.25 }"#;
    let test = ended(line).expect("a test");
    assert_eq!(
        (test.name.as_str(), test.event.as_str()),
        ("faults::kills", "ok")
    );
    assert_eq!((test.seconds, test.said.as_str()), (1.25, ""));
}

#[test]
fn a_test_that_failed_has_what_it_printed_and_one_that_was_ignored_took_no_time() {
    let line = r#"{ "type": "test", "name": "a", "event": "failed", "exec_time": 0.1, "stdout": "left: 1\nright: 2\n" }"#;
    assert_eq!(ended(line).expect("a test").said, "left: 1\nright: 2\n");
    let ignored = ended(r#"{ "type": "test", "name": "b", "event": "ignored" }"#).expect("a test");
    assert_eq!((ignored.event.as_str(), ignored.seconds), ("ignored", 0.0));
}

#[test]
fn what_is_no_end_of_a_test_is_none() {
    for line in [
        "",
        "scan 12: test a ... ok",
        "17",
        r#"{ "type": "suite", "event": "started", "test_count": 3 }"#,
        r#"{ "type": "suite", "event": "ok", "passed": 3, "failed": 0, "exec_time": 0.1 }"#,
        r#"{ "type": "test", "event": "started", "name": "a" }"#,
        r#"{ "type": "test", "event": "timeout", "name": "a" }"#,
    ] {
        assert_eq!(ended(line), None, "{line}");
    }
}

#[test]
fn a_test_executable_is_found_among_what_cargo_has_built() {
    let line = r#"{"reason":"compiler-artifact","manifest_path":"/w/lab/Cargo.toml","target":{"kind":["test"],"src_path":"/w/lab/tests/main.rs"},"profile":{"test":true},"executable":"/w/target/all-1"}"#;
    let expected = Executable {
        source: "/w/lab/tests/main.rs".into(),
        file: "/w/target/all-1".into(),
        manifest: "/w/lab/Cargo.toml".into(),
    };
    assert_eq!(executable(line), Some(expected));
    for no_test in [
        &line.replace(r#""test":true"#, r#""test":false"#),
        &line.replace(r#""/w/target/all-1""#, "null"),
        r#"{"reason":"build-finished","success":true}"#,
    ] {
        assert_eq!(executable(no_test), None, "{no_test}");
    }
}
