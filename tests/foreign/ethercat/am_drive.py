"""A drive of Artificial Motion's SDK (PyPI `am-sdk`, Apache-2.0) as the application of a slave.

The drive, its motor, its friction, its states and its objects are the vendor's model; here are only the objects that
belong to the bus: what is mapped, and the sync managers.
"""

import struct

import am_sdk
from am_sdk import codec
from am_sdk.backends.sim import SimOptions, TruthPlant
from am_sdk.backends.simwire import SimNode
from am_sdk.backends.transport import SdoAbort

import sii
import sync_objects
from coe import NO_OBJECT, NO_SUBINDEX, READ_ONLY, STATE, Abort
from esc import PREOP

GAP = (0, 0)
RX_1600 = [((0x6040, 0), 16), ((0x6060, 0), 8), (GAP, 8), ((0x607A, 0), 32), ((0x60FF, 0), 32), ((0x6071, 0), 16),
           ((0x60B2, 0), 16), ((0x60B1, 0), 32)]
RX_1601 = [((0x6040, 0), 16), ((0x6060, 0), 8), (GAP, 8), ((0x607A, 0), 32), ((0x60FF, 0), 32), ((0x2A10, 1), 32),
           ((0x2A10, 2), 32), ((0x2A10, 3), 32), ((0x2A10, 4), 32)]
TX_1A00 = [((0x6041, 0), 16), ((0x6061, 0), 8), (GAP, 8), ((0x6064, 0), 32), ((0x606C, 0), 32), ((0x6077, 0), 16),
           ((0x603F, 0), 16), ((0x2600, 1), 32), ((0x2620, 1), 8), ((0x2A20, 1), 8), ((0x2401, 1), 16)]
TX_1A01 = [((0x2A21, sub + 1), bits) for sub, bits in enumerate(
    [64, 16, 16, 32, 32, 16, 16, 32] + [16] * 12 + [32, 16, 16])]
PDOS = {0x1600: RX_1600, 0x1601: RX_1601, 0x1A00: TX_1A00, 0x1A01: TX_1A01}
MANAGERS = [(0x1000, 128, 0x26), (0x1080, 128, 0x22), (0x1100, 0, 0x64), (0x1400, 0, 0x20)]
ASSIGNMENTS = {0x1C12: (0x1600, 0x1601), 0x1C13: (0x1A00, 0x1A01)}


CSP = 8


class AmDrive:
    """`options`: the vendor's SimOptions (load inertia, friction, first position, a richer plant …)."""

    def __init__(self, position, cycle_us, unit="M", options=None):
        session = am_sdk.AmSessionConfig(bus=am_sdk.AmBus.ETHERCAT, cycle_us=cycle_us)
        self.node = SimNode(unit, position, session, options)
        self.joint = self.node.joint
        identity = self.joint.identity()
        self.identity = identity.vendor_id, int(identity.sku), identity.revision, identity.serial
        self.name = str(identity.device_name)
        self.pdos, self.lacking, self.esc = dict(PDOS), set(), None
        self.assign_default()

    def assign_default(self):
        self.assigned = {0x1C12: [0x1600], 0x1C13: [0x1A00]}
        self.counts = {index: len(pdos) for index, pdos in self.assigned.items()}

    managers = MANAGERS
    coe = sii.SDO | sii.ASSIGN | sii.COMPLETE

    def entries(self, pdo):
        return [(index, sub, bits) for (index, sub), bits in self.pdos[pdo]]

    def default_mapping(self):
        return [(0x1600, self.entries(0x1600))], [(0x1A00, self.entries(0x1A00))]

    # ---------------------------------------------------------------- what a tester may do to it
    @property
    def statusword(self):
        return self.joint._statusword()

    @property
    def position(self):
        """As 6064 shows it, in millionths of a radian of the output."""
        return round(self.joint.q_meas * 1e6)

    def fault(self, code):
        self.joint.inject_fault(code)

    def clear(self):
        """The cause is gone; the fault stays until it is acknowledged."""
        self.joint.clear_fault_cause()

    def sto(self, on):
        self.joint.set_sto(on)

    def power_cycle(self):
        self.joint.power_cycle()
        self.assign_default()

    def move(self, radians):
        """Somebody turns it by hand."""
        self.joint.q += radians
        self.joint._sample_init()

    def lack(self, index):
        """It never had this object; a gap stands where it was mapped. Without 6060 it is in CSP."""
        self.lacking.add(index)
        for pdo, rows in self.pdos.items():
            self.pdos[pdo] = [(GAP, bits) if entry[0] == index else (entry, bits) for entry, bits in rows]

    def shorten_map(self):
        """Its RxPDO 1600 ends before the last entry."""
        self.pdos[0x1600] = self.pdos[0x1600][:-1]

    # ---------------------------------------------------------------- process data
    def active(self, assignment):
        return self.assigned[assignment][:self.counts[assignment]]

    def process_data_bytes(self):
        return tuple(sum(bits for pdo in self.active(index) for _, bits in self.pdos[pdo]) // 8 for index in (0x1C12, 0x1C13))

    def exchange(self, outputs):
        """A cycle of the drive: it moves on by its cycle time, however long the frames took."""
        control, command = 0, am_sdk.AmCommand()
        rx = self.active(0x1C12)
        if rx == [0x1600]:
            control, command = codec.drive_unpack_rx1600(self.node.codec, self.whole(outputs))
        elif rx == [0x1601]:
            control, command = codec.drive_unpack_rx1601(outputs)
        shown = self.joint.exchange(control, command.mode, command, True)
        inputs = b""
        for pdo in self.active(0x1C13):
            inputs += codec.drive_pack_tx1a00(self.node.codec, shown) if pdo == 0x1A00 else codec.drive_pack_tx1a01(shown)
        return inputs

    def whole(self, outputs):
        """The vendor's RxPDO 1600 of outputs that may lack something."""
        outputs = outputs.ljust(codec.AM_PDO_RX_1600_LEN, b"\0")
        if 0x6060 in self.lacking:
            outputs = outputs[:2] + bytes([CSP]) + outputs[3:]
        return outputs

    def comms_lost(self):
        self.joint.comms_lost()

    # ---------------------------------------------------------------- objects
    def read(self, index, sub):
        if index in self.lacking:
            raise Abort(NO_OBJECT)
        if index in sync_objects.INDICES:
            return sync_objects.read(self.esc, index, sub)
        if index in PDOS or index in ASSIGNMENTS or index in (0x1000, 0x1018, 0x1C00):
            values, form = self.bus_object(index)
            if sub == 0:
                return struct.pack("<I", values[0]) if index == 0x1000 else bytes([len(values)])
            if sub > len(values):
                raise Abort(NO_SUBINDEX)
            return struct.pack(form, values[sub - 1])
        try:
            return self.node.sdo_read(index, sub)
        except SdoAbort as abort:
            raise Abort(abort.code) from abort

    def bus_object(self, index):
        if index in PDOS:
            return [entry << 16 | sub << 8 | bits for entry, sub, bits in self.entries(index)], "<I"
        if index in ASSIGNMENTS:
            return self.active(index), "<H"
        if index == 0x1000:
            return [402 | 2 << 16], "<I"
        if index == 0x1018:
            return list(self.identity), "<I"
        return [1, 2, 3, 4], "<B"

    def read_complete(self, index):
        values, form = self.bus_object(index) if index in PDOS or index in ASSIGNMENTS or index in (0x1018, 0x1C00) else (None, "")
        if values is None:
            raise Abort(0x06010000)
        return struct.pack("<H", len(values)) + b"".join(struct.pack(form, value) for value in values)

    def write(self, index, sub, data, state):
        if index in ASSIGNMENTS:
            self.assign(index, sub, int.from_bytes(data, "little"), state)
            return
        if index in self.lacking:
            raise Abort(NO_OBJECT)
        if index in sync_objects.INDICES:
            sync_objects.write(self.esc, index, sub, data)
            return
        if index in PDOS or index in (0x1000, 0x1018, 0x1C00):
            raise Abort(READ_ONLY)
        try:
            self.node.sdo_write(index, sub, data)
        except SdoAbort as abort:
            raise Abort(abort.code) from abort

    def assign(self, index, sub, value, state):
        if state & 0x0F != PREOP:
            raise Abort(STATE)
        pdos = self.assigned[index]
        if sub == 0:
            if value > len(pdos):
                raise Abort(0x06040042)
            self.counts[index] = value
        elif self.counts[index]:
            raise Abort(READ_ONLY)
        elif value not in ASSIGNMENTS[index]:
            raise Abort(0x06040041)
        elif sub > len(pdos) + 1:
            raise Abort(NO_SUBINDEX)
        else:
            pdos[sub - 1:sub] = [value]

    def write_complete(self, index, data, state):
        if index not in ASSIGNMENTS:
            raise Abort(NO_OBJECT if index not in PDOS else READ_ONLY)
        self.assign(index, 0, 0, state)
        self.assigned[index] = []
        for place in range(data[0]):
            self.assign(index, place + 1, struct.unpack_from("<H", data, 1 + 2 * place)[0], state)
        self.assign(index, 0, data[0], state)


def sim_options(position, sim, truth):
    """The vendor's SimOptions of `[DRIVE:]KEY=VALUE`; any of `truth` brings its richer plant."""
    options, plant = own(position, sim), own(position, truth)
    return SimOptions(**options, truth_plant=TruthPlant(**plant) if plant else None)


def own(position, rows):
    found = {}
    for row in rows:
        drive, _, setting = row.rpartition(":")
        if not drive or int(drive) == position:
            key, value = setting.split("=")
            found[key] = int(value) if key == "seed" else float(value)
    return found
