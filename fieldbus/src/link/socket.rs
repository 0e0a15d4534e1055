//! A raw socket (AF_PACKET) that sees the EtherCAT frames of an interface.

use std::ffi::CString;
use std::io;
use std::os::fd::{AsFd, AsRawFd, FromRawFd, OwnedFd};

use super::interface::interfaces;
use rustix::event::{PollFd, PollFlags, Timespec, poll};

/// Ethertype of EtherCAT.
pub(super) const ETHERTYPE: u16 = 0x88A4;
/// The longest Ethernet frame, without its checksum.
pub const FRAME_BYTES_MAX: usize = 1514;
/// `PACKET_IGNORE_OUTGOING` of linux/if_packet.h.
const IGNORE_OUTGOING: libc::c_int = 23;

/// Why an interface cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum LinkError {
    /// There is none of this name.
    /// It is not there, switched off, without a link or not for this process: its name, and what to do.
    #[error("{0}: {1}")]
    Unusable(String, String),
    /// Somebody else is the master of this segment.
    #[error(
        "{0}: another quadrant process drives this segment: end it first, two masters would fight"
    )]
    Taken(String),
    /// The operating system refuses something else.
    #[error("{interface}: {what}: {source}")]
    System {
        /// Its name.
        interface: String,
        /// What was refused.
        what: &'static str,
        /// Why.
        source: io::Error,
    },
}

/// Where a frame came from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Origin {
    /// This PC has sent it.
    Here,
    /// It came over the cable.
    Cable,
}

/// A raw socket.
#[derive(Debug)]
pub struct Socket {
    socket: OwnedFd,
    /// The interface's name.
    pub interface: String,
}

/// Looks whether there is such an interface, and whether it can carry frames.
fn look_at(interface: &str) -> Result<(), LinkError> {
    let all = interfaces();
    let what = match all.iter().find(|one| one.name == interface) {
        Some(found) if !found.up => {
            format!("the interface is switched off: `ip link set {interface} up`")
        }
        Some(found) if !found.link => {
            "the interface has no link: is the cable plugged in, and the first drive powered?"
                .into()
        }
        Some(_) => return Ok(()),
        None => {
            let names: Vec<&str> = all.iter().map(|one| one.name.as_str()).collect();
            let there = if names.is_empty() {
                "none".into()
            } else {
                names.join(", ")
            };
            format!(
                "there is no such network interface; there are {there}: name one of them ([bus] interface of a machine file)"
            )
        }
    };
    Err(LinkError::Unusable(interface.into(), what))
}

impl Socket {
    /// Opens a socket on an interface that is up. Frames that this PC sends are seen too until [`Socket::ignore_own`].
    ///
    /// # Errors
    /// [`LinkError`].
    pub fn open(interface: &str) -> Result<Socket, LinkError> {
        let system = |what: &'static str, source: io::Error| LinkError::System {
            interface: interface.into(),
            what,
            source,
        };
        look_at(interface)?;
        let name = CString::new(interface).unwrap_or_default();
        // SAFETY: a C string that lives over the call.
        let index = unsafe { libc::if_nametoindex(name.as_ptr()) };
        if index == 0 {
            return Err(system("looking for it", io::Error::last_os_error()));
        }
        let kind = libc::SOCK_RAW | libc::SOCK_NONBLOCK | libc::SOCK_CLOEXEC;
        // SAFETY: a plain system call; protocol 0 receives nothing before the socket is bound.
        let raw = unsafe { libc::socket(libc::AF_PACKET, kind, 0) };
        if raw < 0 {
            let error = io::Error::last_os_error();
            return Err(match error.raw_os_error() {
                Some(libc::EPERM | libc::EACCES) => {
                    let what = "raw Ethernet frames are a privilege: run as root, or `setcap cap_net_raw,cap_ipc_lock,cap_sys_nice+ep` the program once";
                    LinkError::Unusable(interface.into(), what.into())
                }
                _ => system("opening a raw socket", error),
            });
        }
        // SAFETY: the descriptor was made just now and belongs to nobody else.
        let socket = unsafe { OwnedFd::from_raw_fd(raw) };
        attach_filter(&socket).map_err(|error| system("filtering its frames", error))?;
        // SAFETY: an all-zero address is a valid one.
        let mut address: libc::sockaddr_ll = unsafe { std::mem::zeroed() };
        address.sll_family = libc::AF_PACKET as u16;
        address.sll_protocol = (libc::ETH_P_ALL as u16).to_be();
        address.sll_ifindex = index as i32;
        // SAFETY: the address lives over the call and has the length that is given.
        let bound = unsafe {
            libc::bind(
                socket.as_raw_fd(),
                (&raw const address).cast(),
                size_of::<libc::sockaddr_ll>() as u32,
            )
        };
        if bound != 0 {
            return Err(system("binding to it", io::Error::last_os_error()));
        }
        Ok(Socket {
            socket,
            interface: interface.into(),
        })
    }

    /// Sees frames of the cable alone from now on.
    pub fn ignore_own(&self) {
        let on: libc::c_int = 1;
        // SAFETY: the option's value lives over the call. Where it is refused, own frames are seen and passed over.
        unsafe {
            libc::setsockopt(
                self.socket.as_raw_fd(),
                libc::SOL_PACKET,
                IGNORE_OUTGOING,
                (&raw const on).cast(),
                size_of::<libc::c_int>() as u32,
            );
        }
    }

    /// Whether the interface is up and has a link; a system call.
    pub fn has_link(&self) -> bool {
        // SAFETY: an all-zero request is a valid one.
        let mut request: libc::ifreq = unsafe { std::mem::zeroed() };
        let name = self.interface.bytes().take(libc::IFNAMSIZ - 1);
        for (to, byte) in request.ifr_name.iter_mut().zip(name) {
            *to = byte as libc::c_char;
        }
        // SAFETY: the request lives over the call and names an interface; the kernel fills the flags in.
        let flags = unsafe {
            match libc::ioctl(
                self.socket.as_raw_fd(),
                libc::SIOCGIFFLAGS,
                &raw mut request,
            ) {
                0 => i32::from(request.ifr_ifru.ifru_flags),
                _ => 0,
            }
        };
        let both = libc::IFF_UP | libc::IFF_RUNNING;
        flags & both == both
    }

    /// Sends a frame.
    ///
    /// # Errors
    /// The operating system refuses: the interface went down, or its queue is full.
    pub fn send(&self, frame: &[u8]) -> io::Result<usize> {
        Ok(rustix::net::send(
            &self.socket,
            frame,
            rustix::net::SendFlags::empty(),
        )?)
    }

    /// Takes a frame that has come; none if there is none, or the interface has gone.
    pub fn receive(&self, buffer: &mut [u8]) -> Option<(usize, Origin)> {
        // SAFETY: an all-zero address is a valid one.
        let mut from: libc::sockaddr_ll = unsafe { std::mem::zeroed() };
        let mut length = size_of::<libc::sockaddr_ll>() as u32;
        // SAFETY: buffer and address live over the call and have the lengths that are given.
        let taken = unsafe {
            libc::recvfrom(
                self.socket.as_raw_fd(),
                buffer.as_mut_ptr().cast(),
                buffer.len(),
                libc::MSG_DONTWAIT,
                (&raw mut from).cast(),
                &raw mut length,
            )
        };
        let origin = if from.sll_pkttype == libc::PACKET_OUTGOING {
            Origin::Here
        } else {
            Origin::Cable
        };
        usize::try_from(taken).ok().map(|taken| (taken, origin))
    }

    /// Waits until a frame has come, at most so long.
    pub fn wait(&self, limit_ns: u64) {
        let mut fds = [PollFd::from_borrowed_fd(self.socket.as_fd(), PollFlags::IN)];
        let limit = Timespec {
            tv_sec: (limit_ns / 1_000_000_000) as i64,
            tv_nsec: (limit_ns % 1_000_000_000) as i64,
        };
        let _ = poll(&mut fds, Some(&limit));
    }
}

/// Lets frames of EtherCAT pass alone.
fn attach_filter(socket: &OwnedFd) -> io::Result<()> {
    let statement = |code: u32, jt: u8, jf: u8, k: u32| libc::sock_filter {
        code: code as u16,
        jt,
        jf,
        k,
    };
    let mut filter = [
        statement(libc::BPF_LD | libc::BPF_H | libc::BPF_ABS, 0, 0, 12),
        statement(
            libc::BPF_JMP | libc::BPF_JEQ | libc::BPF_K,
            0,
            1,
            ETHERTYPE.into(),
        ),
        statement(libc::BPF_RET | libc::BPF_K, 0, 0, u32::from(u16::MAX)),
        statement(libc::BPF_RET | libc::BPF_K, 0, 0, 0),
    ];
    let program = libc::sock_fprog {
        len: filter.len() as u16,
        filter: filter.as_mut_ptr(),
    };
    // SAFETY: the program and its statements live over the call.
    let set = unsafe {
        libc::setsockopt(
            socket.as_raw_fd(),
            libc::SOL_SOCKET,
            libc::SO_ATTACH_FILTER,
            (&raw const program).cast(),
            size_of::<libc::sock_fprog>() as u32,
        )
    };
    if set != 0 {
        return Err(io::Error::last_os_error());
    }
    Ok(())
}
