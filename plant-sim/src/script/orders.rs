//! Scripted orders: what an operator would ask, each at its scan, so that a run with orders repeats to the bit.
//!
//! ```toml
//! [[order]]
//! scan = 2000
//! order = "hold"
//!
//! [[order]]
//! scan = 2400
//! order = "jog"
//! axis = "X"
//! value = 3.0       # mm; of an override: percent
//! ```

use std::path::Path;

use serde::Deserialize;

use bus::sample::{OperatorRequest, Order};
use machine::Machine;
use machine::settings_file::{self, Rules, SettingsFileError, read_text};

/// An order and the scan in which it is judged; it shows in the feedback of the next.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ScriptedOrder {
    /// The scan.
    pub scan: u64,
    /// What is asked.
    pub request: OperatorRequest,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    #[serde(default)]
    order: Vec<Entry>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Entry {
    scan: u64,
    order: String,
    axis: Option<String>,
    /// Name of the signal that is set, forced or released.
    signal: Option<String>,
    value: Option<f64>,
    /// Of jogs.
    speed_mm_s: Option<f64>,
    /// Of continuous jogs.
    session: Option<u32>,
    deadline_scans: Option<u32>,
}

/// Reads and checks a file of orders for a machine; they come in the order of their scans, those of one scan in the
/// order of the file.
///
/// # Errors
/// Unreadable, not TOML, unknown key, order or axis, or a value too many or missing: with file, line and what would be
/// right. Whether an order is obeyed is judged when its scan comes.
pub fn load(path: &Path, machine: &Machine) -> Result<Vec<ScriptedOrder>, SettingsFileError> {
    parse(&path.display().to_string(), &read_text(path)?, machine)
}

/// Checks the text of such a file; `name` is in the messages.
///
/// # Errors
/// As [`load`].
pub fn parse(
    name: &str,
    text: &str,
    machine: &Machine,
) -> Result<Vec<ScriptedOrder>, SettingsFileError> {
    let file: File = settings_file::parse(name, text)?;
    let mut rules = Rules::of(name, text);
    let mut orders = Vec::with_capacity(file.order.len());
    for (index, entry) in file.order.iter().enumerate() {
        match request(entry, machine) {
            Ok(request) => orders.push(ScriptedOrder {
                scan: entry.scan,
                request,
            }),
            Err(what) => rules.say(&["order"], None, &format!("number {}: {what}", index + 1)),
        }
    }
    rules.judge()?;
    orders.sort_by_key(|order| order.scan);
    Ok(orders)
}

fn request(entry: &Entry, machine: &Machine) -> Result<OperatorRequest, String> {
    let order = Order::from_word(&entry.order).ok_or_else(|| {
        let known = Order::ALL.map(Order::word).join(", ");
        format!("order = {:?}: must be one of {known}", entry.order)
    })?;
    if order == Order::Load {
        return Err("load: a script has no program to load".into());
    }
    let (wants_axis, wants_value) = match order {
        Order::Jog | Order::JogOn => (true, true),
        Order::Override
        | Order::RapidOverride
        | Order::JogOverride
        | Order::OptionalStop
        | Order::SingleBlock
        | Order::Signal
        | Order::SignalForce => (false, true),
        _ => (false, false),
    };
    let of_signal = matches!(
        order,
        Order::Signal | Order::SignalForce | Order::SignalRelease
    );
    // It homes one axis, or all.
    let has_axis = entry.axis.is_some() && order != Order::Home;
    let jogs = matches!(order, Order::Jog | Order::JogOn | Order::JogRenew);
    let goes_on = matches!(order, Order::JogOn | Order::JogRenew);
    let has_speed = entry.speed_mm_s.is_some();
    for (key, given, wanted) in [
        ("axis", has_axis, wants_axis),
        ("value", entry.value.is_some(), wants_value),
        ("speed_mm_s", has_speed, has_speed && jogs),
        ("signal", entry.signal.is_some(), of_signal),
        ("session", entry.session.is_some(), goes_on),
        ("deadline_scans", entry.deadline_scans.is_some(), goes_on),
    ] {
        if given != wanted {
            let how = if wanted { "needs" } else { "has no" };
            return Err(format!("{} {how} {key}", entry.order));
        }
    }
    let axis = match (&entry.axis, &entry.signal) {
        (Some(letter), _) => machine.program_axis_index(letter)?,
        (None, Some(name)) => {
            let index = machine.signal(name);
            index.ok_or_else(|| format!("signal = {name:?}: the machine has none of this name"))?
                as u32
        }
        (None, None) => 0,
    };
    Ok(OperatorRequest {
        order: order as u32,
        axis,
        value: match (order, &entry.axis) {
            (Order::Home, Some(_)) => f64::from(1u32 << axis),
            _ => entry.value.unwrap_or(0.0),
        },
        speed_mm_s: entry.speed_mm_s.unwrap_or(0.0),
        session: entry.session.unwrap_or(0),
        deadline_scans: entry.deadline_scans.unwrap_or(0),
        ..OperatorRequest::default()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Vec<ScriptedOrder>, String> {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../machines/xy");
        let machine = Machine::load(&folder).expect("the machine");
        parse("orders.toml", text, &machine).map_err(|e| e.to_string())
    }

    #[test]
    fn orders_come_in_the_order_of_their_scans() {
        let orders = read(
            "[[order]]\nscan = 9\norder = \"jog\"\naxis = \"Y\"\nvalue = -2.5\n\
             [[order]]\nscan = 4\norder = \"hold\"\n",
        )
        .expect("orders");
        let found: Vec<_> = orders
            .iter()
            .map(|o| (o.scan, o.request.order, o.request.axis, o.request.value))
            .collect();
        assert_eq!(
            found,
            [
                (4, Order::Hold as u32, 0, 0.0),
                (9, Order::Jog as u32, 1, -2.5)
            ]
        );
        let homes = "[[order]]\nscan = 1\norder = \"home\"\n\
             [[order]]\nscan = 2\norder = \"home\"\naxis = \"Y\"\n";
        let values = |o: &ScriptedOrder| o.request.value;
        let homes: Vec<f64> = read(homes).expect("orders").iter().map(values).collect();
        assert_eq!(homes, [0.0, 2.0]);
        assert_eq!(read(""), Ok(Vec::new()));
    }

    #[test]
    fn what_is_no_order_is_refused_with_what_would_be_right() {
        for (text, word) in [
            ("scan = 1\norder = \"halt\"", "must be one of stop, hold"),
            ("scan = 1\norder = \"jog\"\nvalue = 1.0", "jog needs axis"),
            ("scan = 1\norder = \"jog\"\naxis = \"X\"", "jog needs value"),
            (
                "scan = 1\norder = \"jog\"\naxis = \"Q\"\nvalue = 1.0",
                "it has X Y",
            ),
            (
                "scan = 1\norder = \"hold\"\nvalue = 1.0",
                "hold has no value",
            ),
            (
                "scan = 1\norder = \"jog-on\"\naxis = \"X\"\nvalue = 1.0\nsession = 1",
                "jog-on needs deadline_scans",
            ),
            (
                "scan = 1\norder = \"hold\"\nspeed_mm_s = 1.0",
                "hold has no speed_mm_s",
            ),
            ("scan = -1\norder = \"hold\"", "orders.toml:2"),
            ("scan = 1\norder = \"hold\"\nwhen = 2", "unknown field"),
        ] {
            let error = read(&format!("[[order]]\n{text}\n")).expect_err(text);
            assert!(error.contains(word), "{text}: {error}");
        }
    }
}
