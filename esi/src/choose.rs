//! Which of the devices of an ESI file is meant.

use std::fmt::Write as _;

use super::{Device, Esi, EsiError, whole};

/// What the user says of the device.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Choice<'a> {
    /// Product code, or a part of the name.
    pub product: Option<&'a str>,
    /// Revision.
    pub revision: Option<u32>,
    /// Which in the file, from 1.
    pub device: Option<usize>,
}

/// Those that are meant.
fn meant<'a>(esi: &'a Esi, choice: Choice<'_>) -> Vec<&'a Device> {
    let all = (1..).zip(&esi.devices);
    let meant = all.filter(|(number, device)| {
        let of = choice
            .product
            .is_none_or(|product| is_product(device, product));
        let revision = choice
            .revision
            .is_none_or(|revision| device.revision == revision);
        of && revision && choice.device.is_none_or(|device| device == *number)
    });
    meant.map(|(_, device)| device).collect()
}

/// The one terminal that fits: a device with inputs or outputs that is no drive.
///
/// # Errors
/// There is none, or several: with what to write.
pub fn choose_terminal<'a>(esi: &'a Esi, choice: Choice<'_>) -> Result<&'a Device, EsiError> {
    let meant = meant(esi, choice);
    let terminals: Vec<&Device> = meant.iter().copied().filter(|d| d.is_terminal()).collect();
    let what = match (terminals.as_slice(), meant.as_slice()) {
        ([terminal], _) => return Ok(terminal),
        ([], [one]) if one.is_drive() => {
            format!(
                "{} is a drive: `quadrant bus drive-file` makes its file",
                one.name
            )
        }
        ([], _) => "no device that was named has inputs or outputs; there are".into(),
        (several, _) => format!("{} devices fit: say which, by one of", several.len()),
    };
    let mut list = String::new();
    for (number, device) in (1..)
        .zip(&esi.devices)
        .filter(|(_, device)| device.is_terminal())
    {
        let _ = write!(
            list,
            "\n  --device {number}   {} (product 0x{:08X}, revision 0x{:08X})",
            device.name, device.product_code, device.revision
        );
    }
    Err(EsiError::NoDevice {
        file: esi.file.clone(),
        what: what + &list,
    })
}

/// The one CiA 402 drive that fits.
///
/// # Errors
/// There is none, or several: with what to write.
pub fn choose<'a>(esi: &'a Esi, choice: Choice<'_>) -> Result<&'a Device, EsiError> {
    let none = |what: String| EsiError::NoDevice {
        file: esi.file.clone(),
        what,
    };
    let meant = meant(esi, choice);
    let drives: Vec<&Device> = meant.iter().copied().filter(|d| d.is_drive()).collect();
    match (drives.as_slice(), meant.as_slice()) {
        ([drive], _) => Ok(drive),
        ([], []) if esi.devices.is_empty() => Err(none("describes no device".into())),
        ([], []) => {
            let all: Vec<&Device> = esi.devices.iter().collect();
            let list = listed(&all);
            Err(none(format!(
                "no device is the one that was named; there are{list}"
            )))
        }
        ([], [device]) => Err(none(format!(
            "{} is no CiA 402 drive: it has neither profile 402 nor controlword (6040) and statusword (6041); a drive file can be made of drives alone",
            device.name
        ))),
        ([], devices) => Err(none(format!(
            "none of the {} devices is a CiA 402 drive (profile 402, or controlword 6040 and statusword 6041); a drive file can be made of \
             drives alone",
            devices.len()
        ))),
        (several, _) => {
            let list = listed(several);
            let count = several.len();
            Err(none(format!(
                "{count} drives fit: say which, by one of{list}"
            )))
        }
    }
}

/// Whether a product is meant by its code or by a part of its name.
fn is_product(device: &Device, product: &str) -> bool {
    if let Some(code) = whole(product) {
        return i64::from(device.product_code) == code;
    }
    let part = product.to_lowercase();
    let has = |name: &str| name.to_lowercase().contains(&part);
    has(&device.type_name) || has(&device.name)
}

/// What to write for each, one a line.
fn listed(devices: &[&Device]) -> String {
    let mut list = String::new();
    for device in devices {
        let _ = write!(
            list,
            "\n  --product 0x{:08X} --revision 0x{:08X}   {}",
            device.product_code, device.revision, device.name
        );
    }
    list
}
