//! Words to the service manager, if one started this process and asked for them (`Type=notify` of systemd): that the cell is up,
//! that it is being stopped, and what it does. One datagram each, as in sd_notify(3); without `NOTIFY_SOCKET` nothing is reported,
//! and a word that does not get through stops nobody.

use std::env;
use std::os::linux::net::SocketAddrExt;
use std::os::unix::ffi::OsStrExt;
use std::os::unix::net::{SocketAddr, UnixDatagram};

/// Variable in which the service manager says where it listens.
const VARIABLE: &str = "NOTIFY_SOCKET";

/// The cell is up: whoever waits for it may go on.
pub fn ready() {
    say("READY=1\n");
}

/// The cell is being stopped in order.
pub fn stopping() {
    say("STOPPING=1\n");
}

/// What is being done, in a line for `systemctl status`.
pub fn status(text: &str) {
    say(&format!("STATUS={}\n", text.replace('\n', " ")));
}

fn say(words: &str) {
    if let Some(address) = env::var_os(VARIABLE).and_then(|name| address(name.as_bytes()))
        && let Ok(socket) = UnixDatagram::unbound()
    {
        let _ = socket.set_nonblocking(true);
        let _ = socket.send_to_addr(words.as_bytes(), &address);
    }
}

/// A path, or after `@` a name without a file; anything else (`vsock:`) is none of ours.
fn address(name: &[u8]) -> Option<SocketAddr> {
    match name.split_first()? {
        (b'@', rest) => SocketAddr::from_abstract_name(rest).ok(),
        (b'/', _) => SocketAddr::from_pathname(std::ffi::OsStr::from_bytes(name)).ok(),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_service_manager_listens_at_a_path_or_at_a_name_without_a_file() {
        let path = address(b"/run/notify").expect("a path");
        assert_eq!(
            path.as_pathname(),
            Some(std::path::Path::new("/run/notify"))
        );
        let name = address(b"@notify").expect("a name");
        assert_eq!(name.as_abstract_name(), Some(&b"notify"[..]));
        assert!(address(b"").is_none());
        assert!(address(b"vsock:2:1").is_none());
    }
}
