//! What a bad link is.

use std::time::Duration;

/// Each way.
pub const DELAY: Duration = Duration::from_millis(50);
/// Share of what is sent that is lost, in percent.
pub const LOSS_PERCENT: u64 = 5;

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

/// Which packets are lost: xorshift64*, the same ones each time for the same traffic.
pub struct Dice(u64);

impl Dice {
    pub fn new(seed: u64) -> Dice {
        Dice(seed)
    }

    /// True in so many of a hundred cases.
    pub fn falls(&mut self, percent: u64) -> bool {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        (self.0.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 33) % 100 < percent
    }
}
