//! Devices as vendors describe them that are put together of parts: modules in slots, several axes, PDOs that are chosen one by one.

use esi::{Esi, Made};
use fieldbus::drive_file::Mapping;
use fieldbus::process_data::{Pdo, find};

use crate::support::{check, filled_in};

const HEAD: &str = r##"<EtherCATInfo><Vendor><Id>#x42</Id><Name>Testor</Name></Vendor><Descriptions><Devices><Device>
<Type ProductCode="#x7" RevisionNo="#x1">TM</Type><Name>Modular drive</Name>"##;
const MAILBOX: &str = r##"<Sm StartAddress="#x1000" ControlByte="#x26" DefaultSize="128">MBoxOut</Sm>
<Sm StartAddress="#x1080" ControlByte="#x22" DefaultSize="128">MBoxIn</Sm>
<Sm StartAddress="#x1100" ControlByte="#x64">Outputs</Sm><Sm StartAddress="#x1400" ControlByte="#x20">Inputs</Sm>"##;
const END: &str = "</Descriptions></EtherCATInfo>";

/// A PDO with these objects of so many bits; ` Sm="2"` and the like are further attributes.
fn pdo(kind: &str, index: u16, attributes: &str, entries: &[(u16, u32)]) -> String {
    let entry = |(index, bits): &(u16, u32)| {
        format!(
            "<Entry><Index>#x{index:04X}</Index><SubIndex>0</SubIndex><BitLen>{bits}</BitLen></Entry>"
        )
    };
    let entries: String = entries.iter().map(entry).collect();
    format!(
        "<{kind} Fixed=\"1\"{attributes}><Index>#x{index:04X}</Index><Name>P</Name>{entries}</{kind}>"
    )
}

/// A drive of two slots, the second of which may be empty; two kinds of module fit: csp, the default one, and csv.
fn modular() -> Esi {
    let module = |ident: &str, target: u16| {
        let receive = [(0x6040, 16), (target, 32), (0x6060, 8)];
        let transmit = [(0x6041, 16), (0x6064, 32), (0x6061, 8)];
        let object = "<Object><Index>#x605A</Index><Name>Quick stop option code</Name><Type>INT</Type><BitSize>16</BitSize>\
            <Info><SubItem><Name>v</Name><Info><DefaultData>0200</DefaultData></Info></SubItem></Info>\
            <Flags><Access>rw</Access></Flags></Object>";
        format!(
            "<Module><Type ModuleIdent=\"{ident}\">M</Type>{}{}<Profile><ProfileNo>402</ProfileNo><Dictionary><Objects>{object}</Objects></Dictionary></Profile></Module>",
            pdo("RxPdo", 0x1600, " Sm=\"2\"", &receive),
            pdo("TxPdo", 0x1A00, " Sm=\"3\"", &transmit)
        )
    };
    let configured = "<Profile><Dictionary><DataTypes><DataType><Name>DTF030</Name><BitSize>72</BitSize>\
        <SubItem><SubIdx>0</SubIdx><Name>n</Name><Type>USINT</Type><BitSize>8</BitSize></SubItem>\
        <SubItem><SubIdx>1</SubIdx><Name>1</Name><Type>UDINT</Type><BitSize>32</BitSize><Flags><Access>rw</Access></Flags></SubItem>\
        <SubItem><SubIdx>2</SubIdx><Name>2</Name><Type>UDINT</Type><BitSize>32</BitSize><Flags><Access>rw</Access></Flags></SubItem>\
        </DataType></DataTypes><Objects><Object><Index>#xF030</Index><Name>Configured modules</Name><Type>DTF030</Type><BitSize>72</BitSize></Object></Objects></Dictionary></Profile>";
    let slot = |must: u32| {
        format!(
            "<Slot MinInstances=\"{must}\" MaxInstances=\"1\"><ModuleIdent>#x200</ModuleIdent><ModuleIdent Default=\"1\">#x100</ModuleIdent></Slot>"
        )
    };
    let text = format!(
        "{HEAD}{configured}{MAILBOX}<Mailbox><CoE SdoInfo=\"1\"/></Mailbox><Slots SlotPdoIncrement=\"16\" SlotIndexIncrement=\"#x800\">{}{}</Slots></Device></Devices><Modules>{}{}</Modules>{END}",
        slot(1),
        slot(0),
        module("#x100", 0x607A),
        module("#x200", 0x60FF)
    );
    Esi::parse("modular.xml", text.as_bytes()).expect("a good ESI file")
}

fn made(esi: &Esi, mode: Option<&str>, axes: Option<u16>) -> Result<Made, String> {
    let mut modes = fieldbus::cia402::OperatingMode::ALL.into_iter();
    let mode = mode.and_then(|word| modes.find(|mode| mode.word() == word));
    let made = esi::from_esi(esi, &esi.devices[0], mode, axes);
    let made = made.map_err(|error| error.to_string())?;
    let text = filled_in(&esi::write(&made.drive, &esi.devices[0]));
    check(&text, Some(esi))?;
    Ok(made)
}

/// What is written of the modules: slot, from 1, and module.
fn modules(made: &Made) -> Vec<(u8, i64)> {
    let sdos = made.drive.start_up.sdos.iter();
    let of_modules = sdos.filter(|sdo| sdo.index == 0xF030);
    of_modules.map(|sdo| (sdo.sub, sdo.value)).collect()
}

fn has(pdos: &[Pdo], objects: &[u16]) -> bool {
    objects
        .iter()
        .all(|object| find(pdos, *object, 0).is_some())
}

#[test]
fn a_drive_of_modules_has_the_process_data_of_the_one_that_its_mode_wants() {
    let esi = modular();
    for (mode, target, module) in [(None, 0x607A, 0x100), (Some("csv"), 0x60FF, 0x200)] {
        let made = made(&esi, mode, None).expect("a drive file");
        let data = &made.drive.process_data;
        assert_eq!((made.axes, data.receive.len()), (1, 1), "{mode:?}");
        assert!(has(&data.receive, &[0x6040, target]), "{mode:?}");
        assert_eq!(modules(&made), [(1, module)], "{mode:?}");
        // The dictionary of the module is the drive's too, and values of a plain object may stand one level down.
        assert_eq!(made.drive.option_codes.quick_stop, Some(2), "{mode:?}");
    }
}

#[test]
fn both_slots_make_two_axes_whose_objects_and_pdos_are_above_one_another() {
    let esi = modular();
    let made = made(&esi, Some("csp"), Some(2)).expect("a drive file");
    let data = &made.drive.process_data;
    let indices: Vec<u16> = data
        .receive
        .iter()
        .chain(&data.transmit)
        .map(|of| of.index)
        .collect();
    assert_eq!(indices, [0x1600, 0x1610, 0x1A00, 0x1A10]);
    assert!(has(&data.receive, &[0x6040, 0x607A, 0x6840, 0x687A]));
    assert!(has(&data.transmit, &[0x6041, 0x6064, 0x6841, 0x6864]));
    assert_eq!(modules(&made), [(1, 0x100), (2, 0x100)]);
    // The second axis brakes at a quick stop as the first one does.
    let writes = |index: u16| {
        made.drive
            .start_up
            .sdos
            .iter()
            .any(|sdo| sdo.index == index)
    };
    assert!(writes(0x605A) && writes(0x685A));
    let refused = self::made(&esi, Some("csp"), Some(3)).expect_err("three");
    assert!(
        refused.contains("2 of its axes can be driven in csp, not 3"),
        "{refused}"
    );
}

#[test]
fn fixed_pdos_that_can_be_chosen_are_put_together_and_empty_entries_are_none() {
    let place = "<Entry><Index>#x0000</Index><SubIndex>0</SubIndex><BitLen>0</BitLen></Entry>";
    let control = pdo("RxPdo", 0x1600, " Sm=\"2\"", &[(0x6040, 16)]);
    let control = control.replace("</RxPdo>", &format!("{place}</RxPdo>"));
    let more = [
        pdo("RxPdo", 0x1601, " Sm=\"2\"", &[(0x60FF, 32)]),
        pdo("RxPdo", 0x1602, "", &[(0x60B2, 16)]),
        pdo("TxPdo", 0x1A00, " Sm=\"3\"", &[(0x6041, 16)]),
        pdo("TxPdo", 0x1A01, " Sm=\"3\"", &[(0x6064, 32)]),
        pdo("TxPdo", 0x1A02, "", &[(0x606C, 32)]),
        pdo("TxPdo", 0x1A03, "", &[(0x606C, 32), (0x6077, 16)]),
    ];
    let text = format!(
        "{HEAD}{control}{}{MAILBOX}<Mailbox><CoE PdoAssign=\"1\"/></Mailbox><Profile><ProfileNo>402</ProfileNo></Profile></Device></Devices>{END}",
        more.concat()
    );
    let esi = Esi::parse("chosen.xml", text.as_bytes()).expect("a good ESI file");
    let made = made(&esi, Some("csv"), None).expect("a drive file");
    let data = &made.drive.process_data;
    assert_eq!(data.receive_mapping, Mapping::Fixed);
    assert!(has(&data.receive, &[0x6040, 0x60FF, 0x60B2]));
    assert!(has(&data.transmit, &[0x6041, 0x6064, 0x606C]));
    assert_eq!(data.receive[0].entries.len(), 1);
}
