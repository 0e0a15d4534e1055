//! The places of a program that are kept for planners to come: small files in the cell's folder, which end with the cell.

use std::fs;
use std::path::PathBuf;

use bus::cell::CellPaths;
use path::speed_map::first_mapped;

use crate::place::Place;

/// The files of a cell.
#[derive(Debug)]
pub(crate) struct KeptPlaces {
    folder: PathBuf,
}

impl KeptPlaces {
    pub fn of_cell(paths: &CellPaths) -> KeptPlaces {
        KeptPlaces {
            folder: paths.places(),
        }
    }

    /// The last place of a program from which a planner can map the element.
    pub fn before(&self, program_hash: u64, element: u32) -> Option<Place> {
        let mut kept = self.kept(program_hash);
        kept.retain(|of| first_mapped(*of) <= element);
        // The newest one may be half written by a planner that was killed over it.
        kept.iter().rev().find_map(|of| {
            let bytes = fs::read(self.file(program_hash, *of)).ok()?;
            Place::from_bytes(&bytes)
                .filter(|place| place.program_hash == program_hash && place.element == *of)
        })
    }

    /// Keeps a place, and lets go of those that no planner needs with the tool at the element `tool`, and of those of other programs.
    pub fn keep(&self, place: &Place, tool: u32) {
        let file = self.file(place.program_hash, place.element);
        let _ = fs::create_dir_all(&self.folder);
        if let Err(error) = fs::write(&file, place.to_bytes()) {
            tracing::warn!(
                "{}: {error}: a planner after this one reads the program again from its beginning",
                file.display()
            );
        }
        let mut kept = self.kept(place.program_hash);
        kept.retain(|of| first_mapped(*of) <= tool);
        // One more than is needed: a window may be taken back.
        for behind in kept.iter().rev().skip(2) {
            let _ = fs::remove_file(self.file(place.program_hash, *behind));
        }
        let of_others = self.files().filter(|of| of.1 != place.program_hash);
        for (file, ..) in of_others {
            let _ = fs::remove_file(file);
        }
    }

    fn file(&self, program_hash: u64, element: u32) -> PathBuf {
        self.folder.join(format!("{program_hash:016x}-{element}"))
    }

    /// All that there are: file, program, element.
    fn files(&self) -> impl Iterator<Item = (PathBuf, u64, u32)> {
        let entries = fs::read_dir(&self.folder).ok();
        let entries = entries.into_iter().flatten().flatten();
        entries.filter_map(|entry| {
            let name = entry.file_name();
            let (program_hash, element) = name.to_str()?.split_once('-')?;
            let program_hash = u64::from_str_radix(program_hash, 16).ok()?;
            Some((entry.path(), program_hash, element.parse().ok()?))
        })
    }

    /// The elements of those of a program, in order.
    fn kept(&self, program_hash: u64) -> Vec<u32> {
        let files = self.files().filter(|of| of.1 == program_hash);
        let mut kept: Vec<u32> = files.map(|of| of.2).collect();
        kept.sort_unstable();
        kept
    }
}
