//! Without the feature `ethercat` there is nothing to start a segment up with.
#![expect(clippy::missing_errors_doc, reason = "they always fail")]

use std::rc::Rc;

use bus::drive_page::Wiring;

use super::found::{FoundSlave, ObjectData, Written};
use super::{SegmentPlan, StartUpError};
use crate::link::Socket;

/// Would start a segment up.
pub fn start_up(_socket: &Rc<Socket>, _plan: &SegmentPlan) -> Result<Wiring, StartUpError> {
    Err(StartUpError::not_built())
}

/// Would list the slaves of a segment.
pub fn scan(_socket: &Rc<Socket>) -> Result<Vec<FoundSlave>, StartUpError> {
    Err(StartUpError::not_built())
}

/// Would read an object.
pub fn read_object(
    _socket: &Rc<Socket>,
    _place: usize,
    _index: u16,
    _sub: u8,
) -> Result<ObjectData, StartUpError> {
    Err(StartUpError::not_built())
}

/// Would write an object.
pub fn write_object(
    _socket: &Rc<Socket>,
    _place: usize,
    _object: (u16, u8),
    _value: i64,
    _bits: Option<u32>,
) -> Result<Written, StartUpError> {
    Err(StartUpError::not_built())
}
