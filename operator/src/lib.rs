//! Orders to a running cell: each asks the master, waits for its answer and says what happened.

use bus::sample::{OperatorRequest, Order};

mod client;
mod eyes;
mod jog;
mod jog_tool;
mod kept;
mod mdi;
mod offsets;
pub mod options;
mod program;
mod signals;
mod tools;
mod wheel;
mod work;

pub use client::{Client, Given, held};
pub use eyes::{Eyes, course};
pub use jog::{Click, Clicks, JogAsked, JogSender, click_numbered, jog};
pub use mdi::{mdi, mdi_in};
pub use offsets::{offsets, zero};
pub use program::{down, load, start};
pub use signals::{
    alarm_words, alarms as shown_alarms, alarms_of, shown as shown_signals, signal, value_words,
};
pub use tools::tool;
pub use wheel::wheel;
pub use work::{machine_of_run, modes_behind, next_start, program_behind};

use client::{order_urgently, running};

use crate::options::{HomeOptions, OperatorOptions, OptionalStopOptions, SingleBlockOptions};
use console::exit::{Failure, Outcome};
use console::output::say;

/// `hold`, `resume`, `stop`, `enable`, `disable`, `estop`.
pub fn simple(order: Order, options: &OperatorOptions) -> Outcome {
    say(&given(options.cell.as_deref(), order, 0.0)?);
    Ok(())
}

fn given(cell: Option<&str>, order: Order, value: f64) -> Result<String, Failure> {
    match order {
        Order::Stop | Order::Hold | Order::EmergencyStop | Order::Disable => {
            order_urgently(cell, order)
        }
        Order::Enable => Client::to_order(cell)?.enable(),
        _ => Client::to_order(cell)?.order(order, value),
    }
}

/// An order without an axis to the cell of this name; what came of it, in words.
///
/// # Errors
/// It is refused, or nobody answers.
pub fn order(cell: &str, order: Order, value: f64) -> Result<String, Failure> {
    given(Some(cell), order, value)
}

/// `override`, `rapid-override`, `jog-override`.
pub fn set_override(order: Order, percent: f64, to: &OperatorOptions) -> Outcome {
    let client = Client::to_order(to.cell.as_deref())?;
    say(&client.order(order, percent)?);
    Ok(())
}

/// `optional-stop`.
pub fn optional_stop(options: &OptionalStopOptions) -> Outcome {
    let client = Client::to_order(options.to.cell.as_deref())?;
    let on = options.state == "on";
    client.order(Order::OptionalStop, f64::from(u8::from(on)))?;
    client.say(&format!("optional stop {}", options.state));
    Ok(())
}

/// `single-block`.
pub fn single_block(options: &SingleBlockOptions) -> Outcome {
    let client = Client::to_order(options.to.cell.as_deref())?;
    let on = f64::from(u8::from(options.state == "on"));
    say(&client.order(Order::SingleBlock, on)?);
    Ok(())
}

/// `home`.
pub fn home(options: &HomeOptions) -> Outcome {
    let client = Client::to_order(options.to.cell.as_deref())?;
    let mut axes = 0u32;
    for letter in &options.axes {
        axes |= 1 << client.axis_index(letter)?;
    }
    let machine = client.machine.axes.iter().enumerate();
    let homed = machine.filter(|(index, axis)| match axes {
        0 => axis.homing.is_some(),
        axes => axes >> index & 1 == 1,
    });
    let (indices, names): (Vec<usize>, Vec<&str>) = homed
        .map(|(index, axis)| (index, axis.name.as_str()))
        .unzip();
    let request = OperatorRequest {
        value: f64::from(axes),
        ..OperatorRequest::default()
    };
    let mut eyes = Eyes::open(&client)?;
    let answer = client.ask(Order::Home, request)?;
    client.say(&format!("homing {}", names.join(" ")));
    if options.wait {
        return eyes.until_homed(answer.scan, &indices);
    }
    Ok(())
}

/// `iceoryx-config`.
pub fn iceoryx_config(options: &OperatorOptions) -> Outcome {
    // Whoever enters a cell that does not run leaves files behind.
    let cell = running(options.cell.as_deref())?;
    say(cell.place.iceoryx2_toml().trim_end());
    Ok(())
}
