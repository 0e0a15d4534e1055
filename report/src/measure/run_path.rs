//! The path that a run is measured along.

use bus::sample::PathTag;
use path::geometry::{AxisVector, Path};
use program::Along;

use crate::contour::{self, Nearest};

/// The path of the program that ran.
#[derive(Debug)]
pub enum RunPath {
    /// All of it.
    Whole(Path),
    /// What is near the tool of a long one. Its arcs and reversals are not measured one by one, and its blocks not listed.
    Near(Box<Along>),
}

impl From<Path> for RunPath {
    fn from(path: Path) -> Self {
        RunPath::Whole(path)
    }
}

/// Of a long path, which nobody has as a whole.
const NOTHING: &Path = &Path {
    elements: Vec::new(),
};

impl RunPath {
    /// The path, for what needs all of it; nothing of a long one.
    pub fn whole(&self) -> &Path {
        match self {
            RunPath::Whole(path) => path,
            RunPath::Near(_) => NOTHING,
        }
    }

    /// Line of an element whose block is listed; none of a long path.
    pub fn line_to_list(&self, element: u32) -> Option<u32> {
        self.whole().line_of(element as usize)
    }

    /// Line of the program that a tag is in; none if it names no element.
    pub fn line(&mut self, tag: &PathTag) -> Option<u32> {
        self.look(tag, |path, tag| path.line_of(tag.element as usize))
    }

    /// Distance of a point from the path near a tag, in mm; none if the tag names no element.
    pub fn error_mm(&mut self, tag: &PathTag, point: &AxisVector) -> Option<f64> {
        self.look(tag, |path, tag| contour::error_mm(path, tag, point))
    }

    /// The place of the path nearest to a point, near a tag; none if the tag names no element.
    pub fn nearest(&mut self, tag: &PathTag, point: &AxisVector) -> Option<Nearest> {
        self.look(tag, |path, tag| contour::nearest(path, tag, point))
    }

    fn look<T>(
        &mut self,
        tag: &PathTag,
        look: impl FnOnce(&Path, &PathTag) -> Option<T>,
    ) -> Option<T> {
        match self {
            RunPath::Whole(path) => look(path, tag),
            RunPath::Near(along) if !tag.is_off_path() => {
                let (path, first) = along.near(tag.element);
                let near = PathTag {
                    element: tag.element.checked_sub(first)?,
                    ..*tag
                };
                look(path, &near)
            }
            RunPath::Near(_) => None,
        }
    }
}
