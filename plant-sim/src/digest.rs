//! The motion digest: what the machine was told and did, scan by scan.
//!
//! It covers scan, applied command, window, row, encoder and table position of every axis; not roles, misses, roster or
//! standbys. Two runs with the same motion have the same digest, whoever computed it.

use bus::sample::WindowId;
use xxhash_rust::xxh3::Xxh3;

use crate::drive::DriveCommand;

/// A running XXH3-128.
pub struct MotionDigest {
    hash: Box<Xxh3>,
}

impl std::fmt::Debug for MotionDigest {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("MotionDigest").finish_non_exhaustive()
    }
}

impl Default for MotionDigest {
    fn default() -> Self {
        Self::new()
    }
}

impl MotionDigest {
    /// Of nothing yet.
    pub fn new() -> MotionDigest {
        MotionDigest {
            hash: Box::new(Xxh3::new()),
        }
    }

    /// Begins a scan.
    pub fn begin(&mut self, scan: u64, window: WindowId, row: u32) {
        let words = [scan, window.checksum, u64::from(row)];
        self.hash.update(bytemuck::bytes_of(&words));
    }

    /// Takes in one axis after its motion.
    pub fn axis(&mut self, command: &DriveCommand, encoder: i64, table_mm: f64) {
        let (kind, a, b) = match *command {
            DriveCommand::Disabled => (0u64, 0.0, 0.0),
            DriveCommand::Velocity {
                velocity_mm_s,
                torque_offset_nm,
            } => (1, velocity_mm_s, torque_offset_nm),
            DriveCommand::Torque { torque_nm } => (2, torque_nm, 0.0),
            DriveCommand::Brake { deceleration_mm_s2 } => (3, deceleration_mm_s2, 0.0),
        };
        let words = [
            kind,
            f64::to_bits(a),
            f64::to_bits(b),
            encoder as u64,
            table_mm.to_bits(),
        ];
        self.hash.update(bytemuck::bytes_of(&words));
    }

    /// Its value so far, high and low half.
    pub fn value(&self) -> (u64, u64) {
        let value = self.hash.digest128();
        ((value >> 64) as u64, value as u64)
    }
}
