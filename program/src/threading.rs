//! Threads cut in step with the spindle: the passes of G76, and the moves of G33 and G33.1 (LinuxCNC 2.9, "G-Codes").

use path::geometry::AxisVector;

use crate::codes::g_codes;
use crate::refusal::Refusal;

#[cfg(test)]
mod tests;

/// The most passes of one thread.
pub const PASSES_MAX: f64 = 10_000.0;

/// One move of a thread.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Move {
    /// In rapid to a place.
    Rapid(AxisVector),
    /// To a place in step with the spindle, so far along the path for each of its turns; no override counts.
    Synchronised {
        /// Where to.
        to: AxisVector,
        /// Along the path, in mm for each turn.
        mm_per_rev: f64,
    },
}

g_codes! {
    /// A motion in step with the spindle.
    pub enum InStep {
        /// G33.
        Line = 330,
        /// G33.1.
        RigidTap = 331,
        /// G76.
        Thread = 760,
    }
}

impl InStep {
    /// The letters it makes use of, beside those of the axes.
    pub fn letters(self) -> &'static str {
        match self {
            InStep::Line => "K$",
            InStep::RigidTap => "KI$",
            InStep::Thread => "PIJKRQHEL$",
        }
    }
}

/// A G76 block, its words understood; lengths are radii, also in G7.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Threading {
    /// Where the tool is: the line along which it goes back, and where the passes begin.
    pub from: AxisVector,
    /// Where the thread ends along Z; its other components are where the tool goes at last.
    pub end: AxisVector,
    /// Index of X.
    pub x_axis: usize,
    /// Index of Z.
    pub z_axis: usize,
    /// P: along Z for each turn of the spindle.
    pub pitch_mm: f64,
    /// Length of the program's unit, in which I, J and K are: whether cuts add up to the depth shows in it only.
    pub unit_mm: f64,
    /// I: from the tool to the crest of the thread along X; above 0 inside a bore.
    pub crest: f64,
    /// J: depth of the first cut below the crest.
    pub first_cut: f64,
    /// K: full depth of the thread below the crest.
    pub depth: f64,
    /// R: the depth grows with the R-th root of the number of the pass; 1 for equal cuts.
    pub degression: f64,
    /// Q: by how much the passes slide along the flank of the thread, from X.
    pub slide_deg: f64,
    /// H: passes at full depth after the first of these.
    pub spring_passes: u32,
    /// E: how far along Z the tool comes in and goes out where the thread tapers.
    pub taper_mm: f64,
    /// L1, L3: it tapers where it begins.
    pub tapers_in: bool,
    /// L2, L3: it tapers where it ends.
    pub tapers_out: bool,
}

impl Threading {
    /// The passes, and the way to the end.
    pub fn moves(&self) -> Result<Vec<Move>, (char, Refusal)> {
        self.check()?;
        let crest = self.crest.abs();
        let full = self.depth + crest;
        let mut moves = Vec::new();
        let mut pass = 1.0;
        let mut depth = crest + self.first_cut;
        while depth < full {
            self.pass(depth, &mut moves);
            pass += 1.0;
            depth = crest + self.first_cut * libm::pow(pass, 1.0 / self.degression);
        }
        for _ in 0..=self.spring_passes {
            self.pass(full, &mut moves);
        }
        moves.push(Move::Rapid(self.end));
        Ok(moves)
    }

    /// Passes until the full depth.
    fn cuts(&self) -> f64 {
        libm::pow(self.depth / self.first_cut, self.degression)
    }

    /// What LinuxCNC's documentation calls an error of G76, and what no lathe could cut.
    fn check(&self) -> Result<(), (char, Refusal)> {
        let refuse =
            |letter: char, found: String, right: &str| Err((letter, Refusal::new(0, found, right)));
        let length_mm = self.length_mm().abs();
        if self.pitch_mm <= 0.0 {
            let found = format!("a thread of pitch {} mm", self.pitch_mm);
            return refuse('P', found, "P, the pitch, is above 0");
        }
        if self.crest == 0.0 {
            let right = "I leads from the tool to the crest: below 0 outside, above 0 in a bore";
            return refuse('I', "a thread whose crest is at the tool".into(), right);
        }
        let (first_cut, depth) = (self.first_cut, self.depth);
        if first_cut <= 0.0 || depth <= first_cut {
            let found = format!("a thread {depth} deep whose first cut is {first_cut}");
            let right = "J, the first cut, is above 0 and less than K, the full depth";
            return refuse('J', found, right);
        }
        if self.slide_deg.is_nan() || self.slide_deg.abs() >= 90.0 {
            let found = format!("passes that slide along a flank at {}°", self.slide_deg);
            return refuse('Q', found, "Q is less than 90°, such as 29.5");
        }
        if self.taper_mm < 0.0 || 2.0 * self.taper_mm > length_mm {
            let found = format!("tapers of {} mm on {length_mm} mm of thread", self.taper_mm);
            let right = "E is 0 or more and at most half the way along Z";
            return refuse('E', found, right);
        }
        if self.degression < 1.0 {
            let found = format!("a degression of {}", self.degression);
            let right = "R is 1 for equal cuts, above 1 for shallower ones";
            return refuse('R', found, right);
        }
        if length_mm == 0.0 {
            let right = "Z is where the thread ends: away from where the tool is";
            return refuse('Z', "a thread without length".into(), right);
        }
        let passes = self.cuts() + f64::from(self.spring_passes);
        if passes.is_nan() || passes > PASSES_MAX {
            let right = format!("at most {PASSES_MAX} passes: raise J, lower R or H");
            return refuse('J', "a thread of too many passes".into(), &right);
        }
        Ok(())
    }

    /// Along Z, from where the passes begin to where they end.
    fn length_mm(&self) -> f64 {
        let along = |place: &AxisVector| place.get(self.z_axis).copied().unwrap_or(0.0);
        along(&self.end) - along(&self.from)
    }

    /// One pass, at a depth from the line along which the tool goes back.
    fn pass(&self, depth: f64, moves: &mut Vec<Move>) {
        let [depth_mm, thread_mm, crest_mm] =
            [depth, self.depth, self.crest.abs()].map(|length| length * self.unit_mm);
        let backwards = self.length_mm() > 0.0;
        let turned = |value: f64| if backwards { -value } else { value };
        let slope = libm::tan(turned(self.slide_deg.to_radians()));
        let taper_mm = turned(self.taper_mm);
        // The passes slide along the flank; the last one ends where the thread does.
        let slid_mm = (depth_mm - crest_mm) * slope;
        let begin_mm = -slid_mm;
        let end_mm = self.length_mm() + thread_mm * slope - slid_mm;
        let clear_mm = depth_mm - (thread_mm + crest_mm);
        let outward = if self.crest > 0.0 { 1.0 } else { -1.0 };
        let at = |depth_mm: f64, along_mm: f64| {
            let mut place = self.from;
            if let Some(x) = place.get_mut(self.x_axis) {
                *x += outward * depth_mm;
            }
            if let Some(z) = place.get_mut(self.z_axis) {
                *z += along_mm;
            }
            place
        };
        let tapers = self.taper_mm > 0.0;
        // Along a taper, the tool goes further for each turn: Z keeps the pitch.
        let taper_mm_per_rev = if tapers {
            self.pitch_mm * libm::hypot(self.taper_mm, thread_mm) / self.taper_mm
        } else {
            self.pitch_mm
        };
        let cut = |to: AxisVector, mm_per_rev: f64| Move::Synchronised { to, mm_per_rev };
        moves.push(Move::Rapid(at(clear_mm, begin_mm)));
        if tapers && self.tapers_in {
            let outside_mm = depth_mm - thread_mm;
            moves.push(cut(at(outside_mm, begin_mm), taper_mm_per_rev));
            moves.push(cut(at(depth_mm, begin_mm - taper_mm), taper_mm_per_rev));
        } else {
            moves.push(Move::Rapid(at(depth_mm, begin_mm)));
        }
        if tapers && self.tapers_out {
            moves.push(cut(at(depth_mm, end_mm + taper_mm), self.pitch_mm));
            moves.push(cut(at(depth_mm - thread_mm, end_mm), taper_mm_per_rev));
        } else {
            moves.push(cut(at(depth_mm, end_mm), self.pitch_mm));
        }
        moves.push(Move::Rapid(at(clear_mm, end_mm)));
    }
}
