//! What a bad link is.

use std::time::Duration;

use plant_sim::script::rng::Rng;

/// Each way.
pub const DELAY: Duration = Duration::from_millis(50);
/// Share of what is sent that is lost, in percent.
const LOSS_PERCENT: u64 = 5;

/// A link between a server and those who look on.
pub trait Link {
    /// For messages.
    fn name(&self) -> &'static str;
    /// Where the server is to listen.
    fn listen(&self) -> String;
    /// Where it is reached.
    fn endpoint(&self) -> String;
    /// Cuts it.
    fn cut(&self);
    /// Mends it.
    fn mend(&self);
}

/// Whether a packet is lost: the same ones each time for the same traffic.
pub fn loses(rng: &mut Rng) -> bool {
    rng.below(100) < LOSS_PERCENT
}
