//! Drives of several axes: objects of the second axis are 0x800 above those of the first, in the same frame.

use std::fs;

use tempfile::TempDir;

use crate::runs::Run;
use crate::segment::{Network, machine, program, set_drive_keys};

/// A drive file of two axes, of one of a single axis: the PDOs of the second behind those of the first.
fn of_two_axes(text: &str) -> String {
    let pdos = [(0x1600, "receive"), (0x1A00, "transmit")];
    pdos.into_iter().fold(text.to_string(), |text, (pdo, way)| {
        let head = format!("[[process_data.{way}]]\nindex = {pdo:#06X}");
        let from = text.find(&head).unwrap_or_else(|| panic!("no {head}"));
        let end = text[from..].find("\n\n").map_or(text.len(), |at| from + at);
        let own = format!("{pdo:#06X}");
        let second = text[from..end].replace(&own, &format!("{:#06X}", pdo + 0x10));
        let second: Vec<String> = second.lines().map(of_second_axis).collect();
        format!("{}\n\n{}{}", &text[..end], second.join("\n"), &text[end..])
    })
}

/// A line that names an object of the first axis, with that of the second. The vendor's own are where he has them.
fn of_second_axis(line: &str) -> String {
    let Some((before, rest)) = line.split_once("{ index = 0x") else {
        return line.into();
    };
    let (digits, after) = rest.split_at(4);
    let object = u32::from_str_radix(digits, 16).expect("hex");
    let object = object + if object >= 0x6000 { 0x800 } else { 0x100 };
    format!("{before}{{ index = {object:#06X}{after}")
}

/// The shipped machine, its first two axes at one drive.
fn machine_of_two_axes(second: &str) -> TempDir {
    let folder = machine(&[], &[("product_code = 3", "product_code = 0x2A")]);
    let drives = folder.path().join("drives");
    let text = fs::read_to_string(drives.join("am-m.toml")).expect("a drive file");
    fs::write(drives.join("two.toml"), of_two_axes(&text)).expect("writing");
    let alone = text.replace("product_code = 0x2A", "product_code = 3");
    fs::write(drives.join("am-m.toml"), alone).expect("writing");
    let keys = [
        "file = \"drives/two.toml\"\nslave = 0",
        second,
        "file = \"drives/am-m.toml\"\nslave = 1",
    ];
    set_drive_keys(folder.path(), keys);
    folder
}

const SECOND: &str = "file = \"drives/two.toml\"\nslave = 0\naxis = 2";

#[test]
fn two_axes_of_one_drive_move_as_two_drives_do_to_the_bit() {
    let Some(network) = Network::new() else {
        return;
    };
    let alone = Run::default().run(&network);
    let dual = Run {
        segment: &["--dual"],
        ..Run::default()
    };
    let both = dual.run_on(&network, &machine_of_two_axes(SECOND));
    both.is_completed();
    assert_eq!(both.text("/motion_digest"), alone.text("/motion_digest"));
    // A fault of the second axis is one of its axis alone.
    let fault = Run {
        segment: &["--dual", "--at", "enabled+900 fault 0"],
        ..Run::default()
    };
    let tripped = fault.run_on(&network, &machine_of_two_axes(SECOND));
    let printed = tripped.printed();
    assert!(printed.contains("drive fault 1001h"), "{printed}");
    assert!(printed.contains("axis Y"), "{printed}");
}

#[test]
fn an_axis_that_its_drive_has_not_and_one_that_is_there_twice_are_refused() {
    let Some(network) = Network::new() else {
        return;
    };
    for (second, words) in [
        (
            "file = \"drives/two.toml\"\nslave = 0\naxis = 3",
            "axis Y: drive.axis = 3: needs 7040, 70FF, 7041, 7064",
        ),
        (
            "file = \"drives/two.toml\"\nslave = 0",
            "axis Y drive.slave = 0: is the place of axis X: where one drive has several axes, [axis.drive] axis = 2 is its second one",
        ),
        (
            "file = \"drives/am-m.toml\"\nslave = 0\naxis = 2",
            "axis Y drive.file must be the one of axis X, which is of the same drive",
        ),
    ] {
        let folder = machine_of_two_axes(second);
        let refused = network.quadrant(&["check", &folder.path().to_string_lossy()]);
        let printed = String::from_utf8_lossy(&refused.stderr).into_owned();
        assert_eq!(refused.status.code(), Some(2), "{printed}");
        assert!(printed.contains(words), "{second}: {printed}");
    }
}

/// The drive file of two axes, as modules in the first two slots.
fn in_slots(folder: &TempDir) {
    let file = folder.path().join("drives/two.toml");
    let text = fs::read_to_string(&file).expect("a drive file");
    let modules = [1, 2].map(|slot| {
        format!("[[start_up.sdo]]\nindex = 0xF030\nsub = {slot}\nbits = 32\nvalue = 0x100\n")
    });
    let start_up = "interpolation_time = false\n";
    assert!(text.contains(start_up));
    let text = text.replace("product_code = 0x2A", "product_code = 0x2B");
    let text = text.replace(start_up, &format!("{start_up}{}", modules.concat()));
    fs::write(&file, text).expect("writing");
}

#[test]
fn axes_in_the_slots_of_a_modular_drive_move_as_two_drives_do_once_their_modules_are_told() {
    let Some(network) = Network::new() else {
        return;
    };
    let alone = Run::default().run(&network);
    let modular = Run {
        segment: &["--modular"],
        ..Run::default()
    };
    let folder = machine_of_two_axes(SECOND);
    in_slots(&folder);
    let both = modular.run_on(&network, &folder);
    both.is_completed();
    assert_eq!(both.text("/motion_digest"), alone.text("/motion_digest"));
    // A module that is not the one in the slot.
    let file = folder.path().join("drives/two.toml");
    let text = fs::read_to_string(&file).expect("a drive file");
    fs::write(&file, text.replacen("value = 0x100", "value = 0x101", 1)).expect("writing");
    let _segment = network.segment(&["--drives", "3", "--modular"]);
    let refused = network.run(folder.path(), &program(folder.path()));
    let printed = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert_eq!(refused.status.code(), Some(3), "{printed}");
    assert!(printed.contains("writing F030:1 = 257"), "{printed}");
}
