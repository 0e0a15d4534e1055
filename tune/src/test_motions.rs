//! The test motions one after the other, and the models that they tell.

use std::path::Path;

use anyhow::anyhow;
use machine::Machine;
use toml_edit::DocumentMut;

use super::bench::Bench;
use super::identify::{self, Found, Lever};
use super::motions::{self, Limit};
use super::recording::{self, Recording};
use super::ringing::{self, Ringing};
use super::write;
use console::exit::{Failure, Kind};

/// Part of the gain by law at which the strokes are repeated: what depends on the gain shows itself so.
const SOFT_PART: f64 = 0.4;

/// Runs the test motions of a machine.
pub struct TestMotions<'a> {
    /// The machine.
    pub machine: &'a Machine,
    /// What its motions are allowed.
    pub limits: &'a [Limit],
    /// Folder for recordings.
    pub recordings: Option<&'a Path>,
    /// Where they run.
    pub bench: &'a mut Bench,
}

/// What strokes at full acceleration showed.
pub struct Strokes {
    /// The machine file as the test motions want it, with the gains that they are made with.
    bare: DocumentMut,
    /// Strokes with the gains by law and with a part of them, each of all axes.
    pub all: Vec<Vec<Recording>>,
    /// What rings, axis by axis.
    pub rings: Vec<Vec<Ringing>>,
}

impl TestMotions<'_> {
    /// Strokes with the gains as they are: a first look at mass and dead time.
    pub fn first_strokes(&mut self, document: &DocumentMut) -> Result<Vec<Recording>, Failure> {
        tracing::info!("strokes with the gains as they are: a first look at mass and dead time");
        let strokes = motions::strokes(self.machine, self.limits);
        self.record(&self.bare(document), &strokes, "strokes")
    }

    /// The document as the test motions want it.
    fn bare(&self, document: &DocumentMut) -> DocumentMut {
        let mut bare = document.clone();
        write::bare(&mut bare, self.machine);
        write::allow(&mut bare, self.machine, self.limits);
        bare
    }

    /// Strokes with gains by law for the masses that the first ones tell, and with a part of them.
    pub fn strokes(
        &mut self,
        document: &DocumentMut,
        first: Vec<Recording>,
    ) -> Result<Strokes, Failure> {
        let (machine, limits) = (self.machine, self.limits);
        let as_they_were = self.bare(document);
        let mut bare = as_they_were.clone();
        self.gains(&mut bare, &first)?;
        tracing::info!("strokes with gains by law, and with part of them: mass and dead time");
        let strokes = motions::strokes(machine, limits);
        let by_law = match self.or_skip(&bare, &strokes, "strokes-by-law")? {
            Some(by_law) => by_law,
            None => {
                tracing::warn!(
                    "the machine stops with gains by law: those of the machine file are used for the test motions"
                );
                bare = as_they_were;
                first
            }
        };
        let rings = by_law.iter().map(ringing::ringing).collect();
        let mut all = vec![by_law];
        let mut soft = bare.clone();
        for index in 0..machine.axes.len() {
            write::scale_gain(&mut soft, index, SOFT_PART);
        }
        all.extend(self.or_skip(&soft, &strokes, "strokes-soft")?);
        Ok(Strokes { bare, all, rings })
    }

    /// Moves every axis in the other ways and finds its models, the one to prefer first.
    pub fn models(&mut self, strokes: Strokes) -> Result<Vec<Vec<Found>>, Failure> {
        let (machine, limits) = (self.machine, self.limits);
        let Strokes { bare, mut all, .. } = strokes;
        for (acceleration_mm_s2, length_mm, count) in motions::REVERSALS {
            tracing::info!("reversals at {acceleration_mm_s2} mm/s², {length_mm} mm apart");
            let mut slow = bare.clone();
            write::acceleration(&mut slow, machine, limits, acceleration_mm_s2);
            let program = motions::reversals(machine, limits, length_mm, count);
            let name = format!("reversals-{acceleration_mm_s2}-{length_mm}");
            all.extend(self.or_skip(&slow, &program, &name)?);
        }
        tracing::info!("steady speeds: friction against speed");
        let steady = self.record(&bare, &motions::steady(machine, limits), "steady")?;
        let axes = machine.axes.iter().enumerate().zip(&steady);
        let models = axes.map(|((index, axis), steady)| {
            let of_axis: Vec<Recording> =
                all.iter().filter_map(|of| of.get(index).cloned()).collect();
            identify::models(&of_axis, steady, &Lever::of_lead(axis.lead_mm))
        });
        Ok(models.collect())
    }

    /// Gains by law for the masses that these strokes tell.
    fn gains(&self, bare: &mut DocumentMut, fast: &[Recording]) -> Result<(), Failure> {
        for (index, (axis, recording)) in self.machine.axes.iter().zip(fast).enumerate() {
            let mass_kg = identify::mass_kg(recording, &Lever::of_lead(axis.lead_mm));
            if !(mass_kg > 0.0 && mass_kg.is_finite()) {
                return Err(Failure::Stopped(anyhow!(
                    "axis {}: its torque does not follow its acceleration: no mass can be found; look at lead_mm",
                    axis.name
                )));
            }
            write::gains(bare, self.machine, index, mass_kg);
        }
        Ok(())
    }

    fn record(
        &mut self,
        document: &DocumentMut,
        program: &str,
        name: &str,
    ) -> Result<Vec<Recording>, Failure> {
        let all = self.bench.record(document, program)?;
        if let Some(folder) = self.recordings {
            recording::write(folder, name, self.machine, &all).environment()?;
        }
        Ok(all)
    }

    /// The same; nothing if the machine stops in it.
    fn or_skip(
        &mut self,
        document: &DocumentMut,
        program: &str,
        name: &str,
    ) -> Result<Option<Vec<Recording>>, Failure> {
        match self.record(document, program, name) {
            Ok(all) => Ok(Some(all)),
            Err(Failure::Stopped(why)) => {
                tracing::warn!("{why:#}: left out");
                Ok(None)
            }
            Err(other) => Err(other),
        }
    }
}
