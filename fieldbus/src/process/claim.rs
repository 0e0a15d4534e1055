//! One master on a segment: whoever drives an interface holds a name in its network namespace, which the kernel frees when it dies.

use std::io::ErrorKind;
use std::os::linux::net::SocketAddrExt;
use std::os::unix::net::{SocketAddr, UnixDatagram};

use crate::link::LinkError;

/// The claim on an interface.
#[derive(Debug)]
pub struct Claim {
    _name: UnixDatagram,
}

impl Claim {
    /// Claims an interface.
    ///
    /// # Errors
    /// [`LinkError::Taken`].
    pub fn of(interface: &str) -> Result<Claim, LinkError> {
        let system = |source| LinkError::System {
            interface: interface.into(),
            what: "claiming it",
            source,
        };
        let name = format!("quadrant-ethercat-{interface}");
        let address = SocketAddr::from_abstract_name(name).map_err(system)?;
        match UnixDatagram::bind_addr(&address) {
            Ok(name) => Ok(Claim { _name: name }),
            Err(error) if error.kind() == ErrorKind::AddrInUse => {
                Err(LinkError::Taken(interface.into()))
            }
            Err(error) => Err(system(error)),
        }
    }
}
