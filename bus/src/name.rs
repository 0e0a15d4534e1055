//! A cell's name, kept by the kernel: a socket's abstract address. It is no file, so nobody can remove it while its launcher
//! lives, and it is free again however the launcher ends.

use std::io;
use std::os::fd::OwnedFd;

use rustix::io::Errno;
use rustix::net::sockopt::socket_peercred;
use rustix::net::{
    AddressFamily, SocketAddrUnix, SocketFlags, SocketType, bind, connect, listen, socket_with,
};

/// Questions after the holder that may wait; nobody answers them.
const BACKLOG: i32 = 4096;

/// Hold on a name, for as long as it lives.
#[derive(Debug)]
pub(crate) struct Name {
    _socket: OwnedFd,
}

/// Who holds a name.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Holder {
    pub(crate) pid: u32,
    pub(crate) user: u32,
}

/// Why a name cannot be had.
#[derive(Debug)]
pub(crate) enum Taken {
    /// Somebody holds it; it may not be known who.
    By(Option<Holder>),
    /// The operating system refuses.
    System(io::Error),
}

impl From<Errno> for Taken {
    fn from(error: Errno) -> Taken {
        Taken::System(error.into())
    }
}

fn new_socket() -> Result<OwnedFd, Errno> {
    let flags = SocketFlags::CLOEXEC | SocketFlags::NONBLOCK;
    socket_with(AddressFamily::UNIX, SocketType::SEQPACKET, flags, None)
}

impl Name {
    /// Takes this name.
    pub(crate) fn take(name: &str) -> Result<Name, Taken> {
        let address = SocketAddrUnix::new_abstract_name(name.as_bytes())?;
        let socket = new_socket()?;
        match bind(&socket, &address) {
            Ok(()) => {
                listen(&socket, BACKLOG)?;
                Ok(Name { _socket: socket })
            }
            Err(Errno::ADDRINUSE) => Err(Taken::By(holder(&address))),
            Err(error) => Err(error.into()),
        }
    }
}

fn holder(address: &SocketAddrUnix) -> Option<Holder> {
    let socket = new_socket().ok()?;
    connect(&socket, address).ok()?;
    let found = socket_peercred(&socket).ok()?;
    Some(Holder {
        pid: u32::try_from(found.pid.as_raw_nonzero().get()).ok()?,
        user: found.uid.as_raw(),
    })
}

#[cfg(test)]
mod tests {
    use super::{Name, Taken};

    #[test]
    fn a_name_has_one_holder_who_can_be_found() {
        let name = format!("quadrant-test-{}", std::process::id());
        let held = Name::take(&name).expect("a free name");
        match Name::take(&name) {
            Err(Taken::By(Some(holder))) => {
                assert_eq!(holder.pid, std::process::id());
                assert_eq!(holder.user, rustix::process::geteuid().as_raw());
            }
            other => panic!("{other:?}"),
        }
        drop(held);
        assert!(Name::take(&name).is_ok());
    }
}
