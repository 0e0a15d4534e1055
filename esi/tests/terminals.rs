//! From ESI files of devices with inputs and outputs to terminal files that are good.

use std::path::{Path, PathBuf};

use esi::{Choice, Esi, choose_terminal, judge_terminal, terminal_from_esi, write_terminal};
use fieldbus::process_data;
use fieldbus::terminal_file::{self, ChannelDirection, ChannelKind, TerminalFile};

/// A coupler with a mailbox, and terminals as vendors describe them: two sync managers of outputs, words of switches, numbers.
const MADE_UP: &str = r##"<?xml version="1.0"?>
<EtherCATInfo><Vendor><Id>#x99</Id><Name>Testor</Name></Vendor><Descriptions><Devices>
<Device><Type ProductCode="1" RevisionNo="1">TC-1</Type><Name>Coupler</Name></Device>
<Device><Type ProductCode="2" RevisionNo="1">TD-5</Type><Name>Five outputs, three outputs</Name>
  <Sm StartAddress="#x0F00" ControlByte="#x44" Enable="1">Outputs</Sm>
  <Sm StartAddress="#x0F01" ControlByte="#x44" Enable="1">Outputs</Sm>
  <Sm StartAddress="#x1000" ControlByte="0" Enable="1">Inputs</Sm>
  <RxPdo Fixed="1" Sm="1"><Index>#x1601</Index><Name>Second</Name>
    <Entry><Index>#x7001</Index><SubIndex>1</SubIndex><BitLen>3</BitLen><Name>Range</Name><DataType>BIT3</DataType></Entry>
  </RxPdo>
  <RxPdo Fixed="1" Sm="0"><Index>#x1600</Index><Name>First</Name>
    <Entry><Index>#x7000</Index><SubIndex>1</SubIndex><BitLen>1</BitLen><Name>Output</Name><DataType>BOOL</DataType></Entry>
    <Entry><Index>0</Index><BitLen>3</BitLen></Entry>
    <Entry><Index>#x7000</Index><SubIndex>2</SubIndex><BitLen>1</BitLen><Name>Output</Name><DataType>BOOL</DataType></Entry>
  </RxPdo>
  <RxPdo Fixed="1"><Index>#x1602</Index><Name>Not exchanged</Name>
    <Entry><Index>#x7009</Index><SubIndex>1</SubIndex><BitLen>8</BitLen><Name>Other</Name><DataType>USINT</DataType></Entry>
  </RxPdo>
  <TxPdo Fixed="1" Sm="2"><Index>#x1A00</Index><Name>In</Name>
    <Entry><Index>#x6000</Index><SubIndex>1</SubIndex><BitLen>16</BitLen><Name>Switches</Name><DataType>BITARR16</DataType></Entry>
    <Entry><Index>#x6001</Index><SubIndex>1</SubIndex><BitLen>16</BitLen><Name>Value</Name><DataType>INT</DataType></Entry>
    <Entry><Index>#x6002</Index><SubIndex>1</SubIndex><BitLen>32</BitLen><Name>Counter value</Name><DataType>UDINT</DataType></Entry>
    <Entry><Index>#x6003</Index><SubIndex>1</SubIndex><BitLen>32</BitLen><Name>Weight</Name><DataType>REAL</DataType></Entry>
    <Entry><Index>#x6004</Index><SubIndex>1</SubIndex><BitLen>64</BitLen><Name>Time</Name><DataType>ULINT</DataType></Entry>
  </TxPdo>
</Device>
</Devices></Descriptions></EtherCATInfo>"##;

fn esi() -> Esi {
    Esi::parse("made-up.xml", MADE_UP.as_bytes()).expect("an ESI file")
}

/// The terminal file of a device, as it is read again, and held against the ESI file.
fn again(esi: &Esi, device: &esi::Device) -> TerminalFile {
    let made = terminal_from_esi(esi, device).unwrap_or_else(|error| panic!("{error}"));
    let text = write_terminal(&made, device);
    let read = terminal_file::parse("made.toml", &text, |rules, terminal| {
        judge_terminal(rules, terminal, esi);
    });
    let read = read.unwrap_or_else(|error| panic!("{error}\n{text}"));
    assert_eq!(read, made, "{text}");
    read
}

#[test]
fn channels_are_switches_and_numbers_of_what_is_exchanged_inputs_first() {
    let esi = esi();
    let device = choose_terminal(&esi, Choice::default()).expect("the one terminal");
    assert_eq!(device.type_name, "TD-5");
    let file = again(&esi, device);
    let kinds: Vec<ChannelKind> = file.channels.iter().map(|channel| channel.kind).collect();
    let mut wanted = vec![ChannelKind::Bool; 16];
    wanted.extend([ChannelKind::Int, ChannelKind::Counter, ChannelKind::Real]);
    wanted.extend([ChannelKind::Bool, ChannelKind::Bool, ChannelKind::Int]);
    assert_eq!(kinds, wanted);
    let inputs = file
        .channels
        .iter()
        .take_while(|channel| channel.direction == ChannelDirection::Input);
    assert_eq!(inputs.count(), 19);
    let channel = |number| file.channel(number).expect("a channel");
    let field = |number| {
        let field = file.code(channel(number)).expect("its bits").field;
        (field.at_bits, field.bits)
    };
    assert_eq!(
        (channel(4).name.as_str(), field(4)),
        ("In Switches bit 3", (3, 1))
    );
    assert!(channel(17).signed && !channel(18).signed);
    assert_eq!(field(18), (32, 32));
    // What belongs to the second sync manager begins with a byte.
    assert_eq!((field(20), field(21), field(22)), ((0, 1), (4, 1), (8, 3)));
    let data = &file.process_data;
    assert_eq!(
        (
            process_data::bytes(&data.receive),
            process_data::bytes(&data.transmit)
        ),
        (2, 20)
    );
}

#[test]
fn a_terminal_file_that_its_esi_file_contradicts_is_refused() {
    let esi = esi();
    let device = &esi.devices[1];
    let made = terminal_from_esi(&esi, device).expect("a terminal file");
    let text = write_terminal(&made, device);
    for (what, by, words) in [
        ("vendor = 0x00000099", "vendor = 0x98", "is of vendor"),
        ("revision = 0x00000001", "revision = 2", "revision"),
        (
            "bits = 3 }, # gap",
            "bits = 2 }, # gap",
            "0x1600: is another one",
        ),
    ] {
        assert!(text.contains(what), "{text}");
        let text = text.replace(what, by);
        let judged = terminal_file::parse("t.toml", &text, |rules, terminal| {
            judge_terminal(rules, terminal, &esi);
        });
        let error = judged.expect_err(words).to_string();
        assert!(error.contains(words), "{error}");
    }
}

#[test]
fn what_is_no_terminal_is_refused_and_several_are_listed() {
    let esi = esi();
    let refused = |choice: Choice<'_>| {
        let refused = choose_terminal(&esi, choice);
        refused.expect_err("none").to_string()
    };
    let coupler = Choice {
        device: Some(1),
        ..Choice::default()
    };
    assert!(refused(coupler).contains("no device that was named has inputs or outputs"));
    let none = Choice {
        device: Some(9),
        ..Choice::default()
    };
    let words = refused(none);
    assert!(words.contains("--device 2   Five outputs"), "{words}");
}

/// Vendors' files are not in the repository: a folder that QUADRANT_ESI names has them.
#[test]
fn every_device_of_a_vendors_file_of_inputs_and_outputs_becomes_a_terminal_file() {
    let named = std::env::var_os("QUADRANT_ESI").map(PathBuf::from);
    let beside = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/esi");
    let file = named.unwrap_or(beside).join("iTegva_E7x_Series.xml");
    if !file.exists() {
        eprintln!(
            "SKIPPED: {} is not there: QUADRANT_ESI names a folder that has it",
            file.display()
        );
        return;
    }
    let esi = Esi::load(&file).expect("an ESI file");
    let error = choose_terminal(&esi, Choice::default()).expect_err("several");
    assert!(error.to_string().contains("8 devices fit"), "{error}");
    let mut bytes = Vec::new();
    for number in 1..=esi.devices.len() {
        let choice = Choice {
            device: Some(number),
            ..Choice::default()
        };
        let device = choose_terminal(&esi, choice).expect("a device");
        let file = again(&esi, device);
        assert_eq!(file.channels.len(), 32, "{}", device.name);
        let data = &file.process_data;
        bytes.push((
            process_data::bytes(&data.receive),
            process_data::bytes(&data.transmit),
        ));
    }
    let half = [(2, 2), (2, 2), (0, 4), (4, 0)];
    assert_eq!(bytes, [half, half].concat());
}
