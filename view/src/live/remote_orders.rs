//! Orders from and to another machine: `quadrant remote order`, and what `quadrant remote serve --orders` does with them.

use std::path::Path;

use anyhow::anyhow;
use bus::sample::Order;
use console::exit::{Failure, Kind, Outcome};
use console::output::{self, joined, say};
use operator;
use remote::orders::{Identity, OrderServer, OrdersError, TlsPlace, give as send};

use super::words::failure_words;
use crate::options::{OrderOptions, ServeOptions};

/// What may be ordered from where nobody sees the machine: nothing that needs a place, a program or an axis.
const ORDERS: [Order; 7] = [
    Order::Hold,
    Order::Resume,
    Order::Stop,
    Order::Enable,
    Order::Disable,
    Order::Override,
    Order::EmergencyStop,
];

fn order_of(word: &str) -> Option<Order> {
    ORDERS.into_iter().find(|order| order.word() == word)
}

fn unknown(word: &str) -> String {
    let words = joined(ORDERS.iter().map(|order| order.word()), ", ");
    format!("{word:?}: must be one of {words}")
}

/// Gives an order to the cell of this PC: what came of it, in words.
fn obey(cell: &str, word: &str, value: f64) -> Result<String, String> {
    let order = order_of(word).ok_or_else(|| unknown(word))?;
    let done = operator::order(cell, order, value).map_err(|failure| failure_words(&failure));
    match &done {
        Ok(text) | Err(text) => say(&format!("from another machine: {text}")),
    }
    done
}

/// Takes orders for the cell, if that was asked for.
///
/// # Errors
/// The place, the certificates or the names are not usable.
pub fn serve(options: &ServeOptions, cell: &str) -> Result<Option<OrderServer>, Failure> {
    let (Some(place), Some(folder)) = (&options.orders, &options.tls) else {
        return Ok(None);
    };
    let (place, identity) = (parse(place)?, identity(folder)?);
    // A terminal that takes no more keeps back no order.
    output::never_wait();
    let of = cell.to_string();
    let obey = move |word: &str, value: f64| obey(&of, word, value);
    let server = OrderServer::open(cell, &place, &identity, &options.operator, obey);
    let server = server.map_err(failure)?;
    say(&format!(
        "orders are taken at {place}, of {}",
        options.operator.join(", ")
    ));
    Ok(Some(server))
}

fn failure(error: OrdersError) -> Failure {
    match error {
        OrdersError::NoTicket { .. } | OrdersError::Silent(_) => Failure::Stopped(error.into()),
        OrdersError::NotReached { .. } | OrdersError::Link(_) | OrdersError::Thread(_) => {
            Failure::Environment(error.into())
        }
        error => Failure::Input(error.into()),
    }
}

fn parse(place: &str) -> Result<TlsPlace, Failure> {
    place.parse::<TlsPlace>().input()
}

fn identity(folder: &Path) -> Result<Identity, Failure> {
    Identity::of(folder).input()
}

/// `quadrant remote order`.
pub fn give(options: &OrderOptions) -> Outcome {
    let value = match (order_of(&options.order), options.percent) {
        (None, _) => return Err(Failure::Input(anyhow!(unknown(&options.order)))),
        (Some(Order::Override), Some(percent)) => percent,
        (Some(Order::Override), None) => {
            return Err(Failure::Input(anyhow!("override: must have a percentage")));
        }
        (Some(_), Some(_)) => {
            let why = format!("{}: takes no percentage", options.order);
            return Err(Failure::Input(anyhow!(why)));
        }
        (Some(_), None) => 0.0,
    };
    let (place, identity) = (parse(&options.to)?, identity(&options.tls)?);
    let given = send(&options.cell, &place, &identity, &options.order, value);
    match given {
        Ok(Ok(text)) => {
            say(&text);
            Ok(())
        }
        Ok(Err(refused)) => Err(Failure::Stopped(anyhow!(refused))),
        Err(error) => Err(failure(error)),
    }
}
