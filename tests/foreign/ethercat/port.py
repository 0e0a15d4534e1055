"""The network interface: frames in the order in which they arrived, and the drives' own steps between them."""

import errno
import select
import socket
import struct
import time

ETHERTYPE = 0x88A4
# Linux: what this host itself sends is not shown; the kernel says when a frame came.
SOL_PACKET, PACKET_IGNORE_OUTGOING, SO_TIMESTAMPNS = 263, 23, 35
PACKET_OUTGOING = 4
WATCHDOG_LOOK_NS = 5_000_000
FRAMES_AT_ONCE = 64


def serve(interface, segment):
    port = socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.htons(ETHERTYPE))
    port.bind((interface, ETHERTYPE))
    port.setblocking(False)
    try:
        port.setsockopt(SOL_PACKET, PACKET_IGNORE_OUTGOING, 1)
    except OSError:
        # Before Linux 4.20; they are told apart below.
        pass
    print(f"{', '.join(slave.application.name for slave in segment.slaves)} on {interface}", flush=True)
    try:
        if segment.by_clock:
            port.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
            run_by_clock(port, segment)
        else:
            run_by_frames(port, segment)
    finally:
        port.close()


def send(port, answers):
    for answer in answers:
        try:
            port.send(answer)
        except OSError:
            # A frame that the interface does not take (its other end is down, a truncated one) is lost.
            pass


def nothing_came(error):
    """Whether there is just no frame: none has come, or the cable is out. Another error is raised."""
    return isinstance(error, (BlockingIOError, InterruptedError)) or error.errno == errno.ENETDOWN


def received(port):
    """A frame, or None."""
    try:
        frame, source = port.recvfrom(2048)
    except OSError as error:
        if nothing_came(error):
            return None
        raise
    return None if source[2] == PACKET_OUTGOING else frame


def run_by_frames(port, segment):
    control = segment.control.port
    poll = select.poll()
    for each in (port, control):
        if each:
            poll.register(each, select.POLLIN)
    while True:
        ready = poll.poll(5)
        if control and any(number == control.fileno() for number, _ in ready):
            segment.control.answer()
        now_ns = time.monotonic_ns()
        frame = received(port)
        if not segment.lockstep:
            segment.look_at_watchdogs(now_ns)
            send(port, segment.troubles.released(segment.number, now_ns))
        if frame:
            send(port, segment.take(frame, now_ns))


def received_with_time(port):
    """A frame and when the kernel got it, on the monotonic clock, or None."""
    try:
        frame, ancillary, _, source = port.recvmsg(2048, 64)
    except OSError as error:
        if nothing_came(error):
            return None
        raise
    now_ns = time.monotonic_ns()
    arrived_ns = now_ns
    for level, kind, data in ancillary:
        if level == socket.SOL_SOCKET and kind == SO_TIMESTAMPNS:
            seconds, nanoseconds = struct.unpack_from("<qq", data)
            age_ns = time.time_ns() - (seconds * 1_000_000_000 + nanoseconds)
            arrived_ns = now_ns - max(0, age_ns)
    return (b"" if source[2] == PACKET_OUTGOING else frame), arrived_ns


def run_by_clock(port, segment):
    """Drives step when it is time; a frame that waited while the PC stood still acts at the time at which it came."""
    control = segment.control.port
    sources = [port] + ([control] if control else [])
    while True:
        now_ns = time.monotonic_ns()
        late_ns = segment.troubles.next_ns()
        wake_ns = min(segment.next_due_ns(now_ns), now_ns + WATCHDOG_LOOK_NS, late_ns or now_ns + WATCHDOG_LOOK_NS)
        ready, _, _ = select.select(sources, [], [], max(0, wake_ns - now_ns) * 1e-9)
        if control in ready:
            segment.control.answer()
        now_ns = time.monotonic_ns()
        for _ in range(FRAMES_AT_ONCE):
            came = received_with_time(port)
            if came is None:
                break
            frame, arrived_ns = came
            segment.run_until(arrived_ns, now_ns)
            if frame:
                send(port, segment.take(frame, arrived_ns))
        else:
            # More waits: those come before the steps that are due by now.
            continue
        segment.run_until(now_ns, now_ns)
        send(port, segment.troubles.released(segment.number, now_ns))
