//! The ways of compensating that are compared: each a name and what it changes in every `[[axis]]` of the machine file.

use anyhow::{Context, bail};
use toml_edit::{DocumentMut, Item, Table, value};

/// One way of compensating.
#[derive(Debug, Clone, Copy)]
pub struct Method {
    /// Its name in tables, files and on the command line.
    pub name: &'static str,
    /// Whether it needs `[axis.model]`.
    pub needs_model: bool,
    /// Passes of `run --learn` before the grid.
    pub passes: u32,
    edit: fn(&mut Table) -> anyhow::Result<()>,
}

/// Name of the method that none of the others may be worse than.
pub const REFERENCE: &str = "backlash";
/// By how much, in µm.
pub const NEVER_WORSE_UM: f64 = 1.0;
/// Length of the source's constant friction pulse in integral times: the middle of 2 to 3 (docs/methods/physics.md §4).
const CONSTANT_PULSE_INTEGRAL_TIMES: f64 = 2.25;

/// All of them, in the order of the table. A new one is a line here and a function below.
pub const METHODS: &[Method] = &[
    Method {
        name: "none",
        edit: |axis| plain(axis, "none"),
        ..PLAIN
    },
    Method {
        name: REFERENCE,
        edit: |axis| plain(axis, "backlash"),
        ..PLAIN
    },
    Method {
        name: "pulse-position-error",
        edit: |axis| constant_pulse(axis, "position-error"),
        ..PLAIN
    },
    Method {
        name: "pulse-feed-forward",
        edit: |axis| constant_pulse(axis, "feed-forward"),
        ..PLAIN
    },
    Method {
        name: "pulse-velocity-command",
        edit: |axis| constant_pulse(axis, "velocity-command"),
        ..PLAIN
    },
    Method {
        name: "pulse-command-acceleration",
        edit: |axis| constant_pulse(axis, "command-acceleration"),
        ..PLAIN
    },
    Method {
        name: "pulse-decaying",
        edit: decaying_pulse,
        ..PLAIN
    },
    Method {
        name: "pulse-torque",
        edit: |axis| {
            decaying_pulse(axis)?;
            torque(axis, false);
            Ok(())
        },
        ..MODELLED
    },
    Method {
        name: "traversal-observer",
        edit: |axis| {
            traversal(axis, false)?;
            observer(axis);
            Ok(())
        },
        ..MODELLED
    },
    Method {
        name: "learned-torque",
        edit: |axis| traversal(axis, false),
        passes: LEARNING_PASSES,
        ..MODELLED
    },
    Method {
        name: "contact-force",
        edit: |axis| traversal(axis, true),
        ..MODELLED
    },
    Method {
        name: "contact-force-adaptive",
        edit: |axis| {
            traversal(axis, true)?;
            let mut table = Table::new();
            table.insert("mode", value("on"));
            axis.insert("adaptation", Item::Table(table));
            Ok(())
        },
        ..MODELLED
    },
    Method {
        name: "contact-force-observer",
        edit: |axis| {
            traversal(axis, true)?;
            observer(axis);
            Ok(())
        },
        ..MODELLED
    },
    Method {
        name: "contact-force-learned",
        edit: |axis| traversal(axis, true),
        passes: LEARNING_PASSES,
        ..MODELLED
    },
];

/// Passes of learning before the grid: what the last one has taught has been tried by none.
const LEARNING_PASSES: u32 = 4;
/// Bandwidth of the disturbance observer where it is compared, in rad/s: 0.1 rad a scan of 1 ms.
const OBSERVER_RAD_S: f64 = 100.0;

/// What every method has that is not published otherwise.
const PLAIN: Method = Method {
    name: "",
    needs_model: false,
    passes: 0,
    edit: |_| Ok(()),
};
const MODELLED: Method = Method {
    needs_model: true,
    ..PLAIN
};

/// The backlash traversed by predicted contact force, with torque feed-forward.
fn traversal(axis: &mut Table, friction: bool) -> anyhow::Result<()> {
    plain(axis, "contact-force")?;
    torque(axis, friction);
    Ok(())
}

/// Torque feed-forward of acceleration and viscous friction, and of friction over distance where asked for.
fn torque(axis: &mut Table, friction: bool) {
    let mut table = Table::new();
    table.insert("acceleration", value(true));
    table.insert("viscous", value(true));
    table.insert("friction", value(friction));
    axis.insert("torque_feed_forward", Item::Table(table));
}

fn observer(axis: &mut Table) {
    let mut table = Table::new();
    table.insert("bandwidth_rad_s", value(OBSERVER_RAD_S));
    axis.insert("disturbance_observer", Item::Table(table));
}

/// Tables of an axis that do something about reversal errors beside `[axis.reversal]`; a newer one belongs here too, so that
/// the older methods stay what they are called.
const OTHERS: [&str; 4] = [
    "adaptation",
    "torque_feed_forward",
    "disturbance_observer",
    "prediction",
];

/// Compensation by `method` of `[axis.reversal]` alone.
fn plain(axis: &mut Table, method: &str) -> anyhow::Result<()> {
    for table in OTHERS {
        axis.remove(table);
    }
    reversal(axis)?.insert("method", value(method));
    Ok(())
}

/// The source's friction pulse: constant, of the area the machine file's own pulse has.
fn constant_pulse(axis: &mut Table, trigger: &str) -> anyhow::Result<()> {
    plain(axis, "friction-pulse")?;
    let integral_time_ms = number(axis, "velocity_loop", "integral_time_ms")?;
    let area_um = number(axis, "reversal", "pulse_mm_s")? * number(axis, "reversal", "pulse_ms")?;
    let pulse_ms = CONSTANT_PULSE_INTEGRAL_TIMES * integral_time_ms;
    let reversal = reversal(axis)?;
    reversal.insert("trigger", value(trigger));
    reversal.insert("shape", value("constant"));
    reversal.insert("pulse_ms", value(pulse_ms));
    reversal.insert("pulse_mm_s", value(area_um / pulse_ms));
    reversal.remove("presliding_um");
    reversal.remove("position_error_part");
    Ok(())
}

/// The decaying friction pulse with the machine file's own height, decay and distance.
fn decaying_pulse(axis: &mut Table) -> anyhow::Result<()> {
    plain(axis, "friction-pulse")?;
    let reversal = reversal(axis)?;
    reversal.insert("trigger", value("command-acceleration"));
    if reversal.get("shape").and_then(Item::as_str) != Some("decaying") {
        bail!(
            "axis.reversal.shape is not \"decaying\": pulse-decaying needs its pulse_mm_s, pulse_ms and presliding_um"
        );
    }
    Ok(())
}

fn reversal(axis: &mut Table) -> anyhow::Result<&mut Table> {
    axis.get_mut("reversal")
        .and_then(Item::as_table_mut)
        .context("an axis has no table [axis.reversal]")
}

fn number(axis: &Table, table: &str, key: &str) -> anyhow::Result<f64> {
    let item = axis.get(table).and_then(|t| t.get(key));
    let number = item.and_then(|i| i.as_float().or_else(|| i.as_integer().map(|n| n as f64)));
    number.with_context(|| format!("an axis has no number axis.{table}.{key}"))
}

impl Method {
    /// The method of this name.
    pub fn of(name: &str) -> Option<&'static Method> {
        METHODS.iter().find(|method| method.name == name)
    }

    /// The text of a machine file, changed to compensate by this method.
    ///
    /// # Errors
    /// It is no machine file, or lacks what the method starts from.
    pub fn apply(&self, text: &str) -> anyhow::Result<String> {
        let mut document: DocumentMut = text.parse()?;
        let axes = document
            .get_mut("axis")
            .and_then(Item::as_array_of_tables_mut)
            .context("has no [[axis]]")?;
        for axis in axes.iter_mut() {
            (self.edit)(axis)?;
        }
        Ok(document.to_string())
    }
}

/// Names of all methods.
pub fn names() -> Vec<&'static str> {
    METHODS.iter().map(|method| method.name).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use machine::{Machine, PulseShape, ReversalMethod};

    fn shipped(method: &str) -> Machine {
        let text = include_str!("../../../../machines/xy/machine.toml");
        let changed = Method::of(method).unwrap().apply(text).unwrap();
        Machine::parse(method, &changed).unwrap()
    }

    #[test]
    fn every_method_makes_a_good_machine_file_of_every_shipped_machine_with_two_axes() {
        for text in [
            include_str!("../../../../machines/xy/machine.toml"),
            include_str!("../../../../machines/xy-fast/machine.toml"),
            include_str!("../../../../machines/xy-torque/machine.toml"),
        ] {
            let has_model = text.contains("[axis.model.table]");
            for method in METHODS.iter().filter(|m| has_model || !m.needs_model) {
                let changed = method.apply(text).unwrap();
                Machine::parse(method.name, &changed).unwrap();
            }
        }
    }

    #[test]
    fn constant_pulses_have_the_area_of_the_shipped_pulse_and_each_its_own_trigger() {
        let own = shipped("pulse-decaying").axes[0].reversal;
        assert_eq!(own.shape, PulseShape::Decaying);
        for name in [
            "pulse-position-error",
            "pulse-feed-forward",
            "pulse-velocity-command",
            "pulse-command-acceleration",
        ] {
            let reversal = shipped(name).axes[0].reversal;
            assert_eq!(
                (reversal.method, reversal.shape),
                (ReversalMethod::FrictionPulse, PulseShape::Constant)
            );
            assert_eq!(format!("pulse-{}", reversal.trigger.word()), name);
            assert_eq!(reversal.pulse_ms, 22.5);
            let area_um = reversal.pulse_mm_s * reversal.pulse_ms;
            assert!((area_um - own.pulse_mm_s * own.pulse_ms).abs() < 1e-9);
        }
        assert_eq!(
            shipped("none").axes[1].reversal.method,
            ReversalMethod::None
        );
    }

    #[test]
    fn what_else_a_machine_file_switches_on_is_off_in_every_method() {
        // The shipped file feeds torque forward; the others are added.
        let text = include_str!("../../../../machines/xy/machine.toml").replace(
            "[axis.reversal]",
            "[axis.prediction]\nm = 0.4\n\n[axis.disturbance_observer]\nbandwidth_rad_s = 100.0\n\n[axis.reversal]",
        );
        assert!(text.contains("[axis.torque_feed_forward]"));
        for method in METHODS.iter().filter(|method| !method.needs_model) {
            let changed = method.apply(&text).unwrap();
            let machine = Machine::parse(method.name, &changed).unwrap();
            for axis in &machine.axes {
                assert!(axis.prediction.is_none(), "{}", method.name);
                assert_eq!(axis.disturbance_observer.bandwidth_rad_s, 0.0);
                assert!(!axis.torque_feed_forward.any());
            }
        }
    }

    #[test]
    fn names_are_found_once_each() {
        for method in METHODS {
            assert_eq!(METHODS.iter().filter(|m| m.name == method.name).count(), 1);
            assert!(Method::of(method.name).is_some());
        }
        assert!(Method::of("luck").is_none());
    }
}
