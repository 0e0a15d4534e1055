#!/usr/bin/env python3
"""Foreign masters on the segment of segment.py: each must find it, configure it and drive its drives.

    pip install pysoem kickcat am-sdk==0.2.0
    masters.py ec0 soem | kickcat | vendor | boot        # segment.py serves the other end

Prints what it found, one line for each fact, and ends with 1 where something is wrong.
"""

import hashlib
import math
import struct
import sys
import time

RX_1600, TX_1A00 = struct.Struct("<HbxiihhI"), struct.Struct("<HbxiihHIBBh")
NEXT = {0x40: 0x06, 0x21: 0x07, 0x23: 0x0F, 0x27: 0x0F}
CSV = 9


def walked(status):
    """The controlword that leads on from a statusword, one transition a cycle (CiA 402)."""
    return NEXT.get(status & 0x6F if status & 0x0F not in (0x00, 0x08) else status & 0x4F, 0)


def say(fact, good=True):
    print(f"{'' if good else 'WRONG: '}{fact}", flush=True)
    if not good:
        sys.exit(1)


def into_operation(pysoem, master, mapped=False):
    """Maps all slaves as they are, and brings them to OP with outputs of zero."""
    if not mapped:
        master.config_map()
    say("SOEM: SAFE-OP", master.state_check(pysoem.SAFEOP_STATE, 500_000) == pysoem.SAFEOP_STATE)
    master.send_processdata()
    master.receive_processdata(100_000)
    master.state = pysoem.OP_STATE
    master.write_state()
    for _ in range(50):
        master.send_processdata()
        master.receive_processdata(100_000)
        if master.state_check(pysoem.OP_STATE, 2000) == pysoem.OP_STATE:
            break
    say("SOEM: OP", master.state_check(pysoem.OP_STATE, 2000) == pysoem.OP_STATE)


def soem(interface):
    import pysoem

    master = pysoem.Master()
    master.open(interface)
    say(f"SOEM: {master.config_init()} slaves", len(master.slaves) > 0)
    first = master.slaves[0]
    say(f"SOEM: {first.name}, SDO 1008 says {first.sdo_read(0x1008, 0).decode()}")
    try:
        first.sdo_write(0x1600, 0, b"\0")
        say("SOEM: a mapping that is fixed could be written", False)
    except pysoem.SdoError as error:
        say(f"SOEM: SDO abort 0x{error.abort_code:08X}, {error.desc}", error.abort_code == 0x06010002)
    into_operation(pysoem, master)
    seen, digest, short, begun, cycles = [], hashlib.sha256(), 0, time.monotonic(), 3000
    for cycle in range(cycles):
        for slave in master.slaves:
            status, _, position, speed, *_ = TX_1A00.unpack_from(slave.input)
            if slave is first and status & 0x6F not in seen:
                seen.append(status & 0x6F)
            wanted = round(500 * math.sin(2 * math.pi * cycle / 1000))
            slave.output = RX_1600.pack(walked(status), CSV, 0, wanted, 0, 0, 0)
        master.send_processdata()
        short += master.receive_processdata(100_000) != master.expected_wkc
        for slave in master.slaves:
            digest.update(bytes(slave.input))
    rate = cycles / (time.monotonic() - begun)
    say(f"SOEM: states {', '.join(f'0x{state:02X}' for state in seen)}, {rate:.0f} cycles a second", seen[-1] == 0x27)
    say(f"SOEM: working counter short in {short} of {cycles} cycles", short == 0)
    _, _, position, speed, *_ = TX_1A00.unpack_from(first.input)
    say(f"SOEM: digest of all inputs {digest.hexdigest()[:16]}")
    master.state = pysoem.INIT_STATE
    master.write_state()
    master.close()


def offset_of(slave, assignment, wanted):
    """Where the object lies in the process data, in bits, by the mapping that the slave shows."""
    at = 0
    for pdo in range(slave.sdo_read(assignment, 0)[0]):
        index = int.from_bytes(slave.sdo_read(assignment, pdo + 1), "little")
        for entry in range(slave.sdo_read(index, 0)[0]):
            row = int.from_bytes(slave.sdo_read(index, entry + 1), "little")
            if row >> 16 == wanted:
                return at
            at += row & 0xFF
    return None


def boot(interface):
    """Whatever drives there are: found, mapped as they are, in OP, walked to operation enabled."""
    import pysoem

    master = pysoem.Master()
    master.open(interface)
    say(f"SOEM: {master.config_init()} slaves", len(master.slaves) > 0)
    places = [(offset_of(slave, 0x1C12, 0x6040), offset_of(slave, 0x1C13, 0x6041)) for slave in master.slaves]
    into_operation(pysoem, master)
    for _ in range(20):
        for slave, (control, status) in zip(master.slaves, places):
            shown = int.from_bytes(slave.input, "little") >> status & 0xFFFF
            slave.output = (walked(shown) << control).to_bytes(len(slave.output), "little")
        master.send_processdata()
        count = master.receive_processdata(100_000)
    say(f"SOEM: working counter {count} of {master.expected_wkc}", count == master.expected_wkc)
    master.read_state()
    for slave, (_, status) in zip(master.slaves, places):
        shown = int.from_bytes(slave.input, "little") >> status & 0xFFFF
        say(f"SOEM: {slave.name}, product 0x{slave.id:X}, revision 0x{slave.rev:X}: {len(slave.output)} bytes out, "
            f"{len(slave.input)} in, OP, statusword 0x{shown:04X}", slave.state & 0x0F == 8 and shown & 0x6F == 0x27)
    master.state = pysoem.INIT_STATE
    master.write_state()
    master.close()


def kickcat(interface):
    import kickcat as kc

    link = kc.create_link(interface, "")
    link.set_timeout(0.2)
    bus = kc.Bus(link)
    for attempt in range(5):
        # It gives up where a frame takes longer than it likes, as on a busy PC.
        try:
            bus.init(0.5)
            break
        except RuntimeError as error:
            print(f"KickCAT: {error}, once more")
    slaves = bus.slaves()
    say(f"KickCAT: {len(slaves)} slaves", len(slaves) > 0)
    name = bus.read_sdo(slaves[0], 0x1008, 0, kc.Access.PARTIAL, 64, 1.0)
    say(f"KickCAT: SDO 1008 says {bytes(name).decode(errors='replace').rstrip(chr(0))}")
    bus.create_mapping()
    bus.request_state(kc.State.SAFE_OP)
    bus.wait_for_state(kc.State.SAFE_OP, 1.0)
    say("KickCAT: SAFE-OP")
    for slave in slaves:
        slave.set_output_bytes(bytes(slave.output_size))
    bus.process_data_no_check()
    bus.request_state(kc.State.OPERATIONAL)
    for _ in range(100):
        bus.process_data_no_check()
        if all(bus.get_state(slave) == kc.State.OPERATIONAL for slave in slaves):
            break
    say("KickCAT: OP", all(bus.get_state(slave) == kc.State.OPERATIONAL for slave in slaves))
    reached = 0
    for _ in range(500):
        for slave in slaves:
            reached = TX_1A00.unpack_from(slave.input_data)[0]
            slave.set_output_bytes(RX_1600.pack(walked(reached), CSV, 0, 200, 0, 0, 0))
        bus.process_data()
    say(f"KickCAT: statusword 0x{reached:04X}", reached & 0x6F == 0x27)


def vendor(interface):
    import am_sdk as am

    session = am.am_init(am.AmSessionConfig(bus=am.AmBus.ETHERCAT, interface=f"ecat:{interface}"))
    joints = [am.am_open_joint(session, device.address) for device in am.am_scan(session)]
    say(f"am-sdk: {len(joints)} units", len(joints) > 0)
    for joint in joints:
        am.am_set_mode(joint, am.AmMode.CSV)
    am.am_start(session)
    for joint in joints:
        am.am_enable(joint, 2000)
    say("am-sdk: enabled", all(joint.state == am.AmDriveState.OPERATION_ENABLED for joint in joints))
    speeds = []
    for _ in range(1000):
        for joint in joints:
            am.am_set_velocity(joint, 0.5)
        am.am_cycle(session)
        speeds.append(am.am_read_telemetry(joints[0]).qd_rad_s)
    # A cycle whose frame came late has none.
    speed = sorted(speeds[-201:])[100]
    say(f"am-sdk: {speed:.3f} rad/s of 0.5", abs(speed - 0.5) < 0.02)
    am.am_stop(session)
    am.am_deinit(session)


if __name__ == "__main__":
    masters = {"soem": soem, "kickcat": kickcat, "vendor": vendor, "boot": boot}
    if len(sys.argv) != 3 or sys.argv[2] not in masters:
        print(__doc__, file=sys.stderr)
        sys.exit(2)
    masters[sys.argv[2]](sys.argv[1])
