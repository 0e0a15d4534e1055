"""The drives of a vendor's ESI file (ETG.2000) as applications of slaves: their identity, sync managers, mapping and objects.

What the objects mean, an ESI file does not say: values are kept, the states of CiA 402 are walked, and while operation is
enabled the position follows: at once in CSP, by an integrator in CSV (60FF taken for increments a second). No motor, no
friction, no delay.
"""

import struct
import xml.etree.ElementTree as ElementTree

import sii
from coe import NO_OBJECT, NO_SUBINDEX, READ_ONLY, STATE, Abort
from esc import PREOP

# Statuswords that follow a controlword, from the state that is shown (CiA 402, IEC 61800-7-201).
STATES = {0x40: {0x06: 0x21}, 0x21: {0x07: 0x23, 0x00: 0x40}, 0x23: {0x0F: 0x27, 0x06: 0x21, 0x00: 0x40},
          0x27: {0x07: 0x23, 0x06: 0x21, 0x00: 0x40, 0x02: 0x40}, 0x08: {}}
ENABLED, FAULT, FAULT_RESET = 0x27, 0x08, 0x80
CSP, CSV = 8, 9


def number(text):
    text = (text or "0").strip()
    return int(text[2:], 16) if text[:2] in ("#x", "0x") else int(text)


def true(text):
    return (text or "").strip().lower() in ("1", "true")


def devices(files, cycle_us):
    found = []
    for file in files:
        root = ElementTree.parse(file).getroot()
        for device in root.iter("Device"):
            kinds = [manager.text for manager in device.findall("Sm")]
            if device.find("Mailbox/CoE") is not None and kinds == ["MBoxOut", "MBoxIn", "Outputs", "Inputs"]:
                found.append(EsiDevice(number(root.findtext("Vendor/Id")), device, cycle_us))
    return found


class EsiDevice:
    def __init__(self, vendor, device, cycle_us):
        self.cycle_s, self.esc = cycle_us * 1e-6, None
        kind = device.find("Type")
        self.identity = vendor, number(kind.get("ProductCode")), number(kind.get("RevisionNo")), 0
        self.name = (kind.text or device.findtext("Name") or "drive").strip()[:60]
        self.managers = [
            (number(manager.get("StartAddress")), number(manager.get("DefaultSize")), number(manager.get("ControlByte")))
            for manager in device.findall("Sm")]
        coe = device.find("Mailbox/CoE").attrib
        self.assignable, self.configurable = true(coe.get("PdoAssign")), true(coe.get("PdoConfig"))
        self.complete = true(coe.get("CompleteAccess"))
        self.coe = (sii.SDO | (sii.ASSIGN if self.assignable else 0) | (sii.CONFIGURE if self.configurable else 0)
                    | (sii.COMPLETE if self.complete else 0))
        self.pdos, self.fixed, self.assigned = {}, set(), {0x1C12: [], 0x1C13: []}
        for tag, assignment, manager in (("RxPdo", 0x1C12, "2"), ("TxPdo", 0x1C13, "3")):
            for pdo in device.findall(tag):
                index = number(pdo.findtext("Index"))
                self.pdos[index] = [
                    (number(entry.findtext("Index")), number(entry.findtext("SubIndex")), number(entry.findtext("BitLen")))
                    for entry in pdo.findall("Entry")]
                if true(pdo.get("Fixed")) or not self.configurable:
                    self.fixed.add(index)
                if pdo.get("Sm") == manager:
                    self.assigned[assignment].append(index)
        self.counts = {index: len(pdos) for index, pdos in self.assigned.items()}
        self.entry_counts = {index: len(entries) for index, entries in self.pdos.items()}
        self.values = objects(device)
        self.status, self.cause, self.reset = 0x40, 0, False
        self.exact_position = float(self.signed(0x6064))

    def default_mapping(self):
        return tuple([(pdo, self.pdos[pdo]) for pdo in self.assigned[index]] for index in (0x1C12, 0x1C13))

    # ---------------------------------------------------------------- process data
    def mapped(self, assignment):
        return [entry for pdo in self.assigned[assignment][:self.counts[assignment]]
                for entry in self.pdos[pdo][:self.entry_counts[pdo]]]

    def process_data_bytes(self):
        return tuple((sum(bits for _, _, bits in self.mapped(index)) + 7) // 8 for index in (0x1C12, 0x1C13))

    def exchange(self, outputs):
        at, word, told = 0, int.from_bytes(outputs, "little"), {}
        for index, sub, bits in self.mapped(0x1C12):
            if index:
                told[index, sub] = word >> at & (1 << bits) - 1
                self.values[index, sub] = told[index, sub].to_bytes((bits + 7) // 8, "little")
            at += bits
        self.walk(told.get((0x6040, 0), 0))
        self.move()
        shown, at = 0, 0
        for index, sub, bits in self.mapped(0x1C13):
            value = self.statusword if index == 0x6041 else int.from_bytes(self.values.get((index, sub), b""), "little")
            shown |= (value & (1 << bits) - 1) << at
            at += bits
        return shown.to_bytes((at + 7) // 8, "little")

    def walk(self, control):
        """One transition a cycle; a fault is acknowledged by the rising edge, when its cause is gone."""
        rises = control & FAULT_RESET and not self.reset
        self.reset = bool(control & FAULT_RESET)
        if self.cause:
            self.status = FAULT
        elif self.status == FAULT:
            if rises:
                self.status = 0x40
                self.keep(0x603F, 0)
        else:
            self.status = STATES[self.status].get(control & 0x0F, self.status)

    def move(self):
        mode = self.values.get((0x6060, 0), b"\0")[0] or CSP
        speed = 0
        if self.status == ENABLED and mode == CSP and (0x607A, 0) in self.values:
            wanted = self.signed(0x607A)
            speed, self.exact_position = round((wanted - self.exact_position) / self.cycle_s), float(wanted)
        elif self.status == ENABLED and mode == CSV:
            speed = self.signed(0x60FF)
            self.exact_position += speed * self.cycle_s
        self.keep(0x6064, round(self.exact_position))
        self.keep(0x606C, speed)
        self.keep(0x6061, mode)

    def signed(self, index):
        return int.from_bytes(self.values.get((index, 0), b""), "little", signed=True)

    def keep(self, index, value):
        size = len(self.values.get((index, 0), bytes(1 if index == 0x6061 else 4)))
        self.values[index, 0] = (value & (1 << 8 * size) - 1).to_bytes(size, "little")

    def comms_lost(self):
        if self.status != FAULT:
            self.status = 0x40

    # ---------------------------------------------------------------- what a tester may do to it
    @property
    def statusword(self):
        return 0x0200 | self.status

    @property
    def position(self):
        return self.signed(0x6064)

    def fault(self, code):
        self.cause, self.status = code, FAULT
        self.keep(0x603F, code)

    def clear(self):
        self.cause = 0

    def sto(self, on):
        raise ValueError("a drive of an ESI file has no STO")

    def power_cycle(self):
        self.status, self.cause = 0x40, 0

    def lack(self, index):
        self.values = {key: value for key, value in self.values.items() if key[0] != index}
        for pdo, rows in self.pdos.items():
            self.pdos[pdo] = [(0, 0, bits) if entry == index else (entry, sub, bits) for entry, sub, bits in rows]

    def shorten_map(self):
        index = self.assigned[0x1C12][0]
        self.pdos[index] = self.pdos[index][:-1]
        self.entry_counts[index] = len(self.pdos[index])

    # ---------------------------------------------------------------- objects
    def read(self, index, sub):
        listed = self.listed(index)
        if listed is not None:
            values, form = listed
            if sub == 0:
                return bytes([len(values)])
            if sub > len(values):
                raise Abort(NO_SUBINDEX)
            return struct.pack(form, values[sub - 1])
        if (index, sub) not in self.values:
            raise Abort(NO_SUBINDEX if any(of == index for of, _ in self.values) else NO_OBJECT)
        return self.values[index, sub]

    def listed(self, index):
        if index in self.pdos:
            return [entry << 16 | sub << 8 | bits for entry, sub, bits in self.pdos[index][:self.entry_counts[index]]], "<I"
        if index in self.assigned:
            return self.assigned[index][:self.counts[index]], "<H"
        return {0x1018: (list(self.identity), "<I"), 0x1C00: ([1, 2, 3, 4], "<B")}.get(index)

    def read_complete(self, index):
        listed = self.listed(index)
        if not self.complete or listed is None:
            raise Abort(0x06010000)
        values, form = listed
        return struct.pack("<H", len(values)) + b"".join(struct.pack(form, value) for value in values)

    def write(self, index, sub, data, state):
        value = int.from_bytes(data, "little")
        if index in self.assigned or index in self.pdos:
            self.change_mapping(index, sub, value, state)
        elif (index, sub) not in self.values:
            raise Abort(NO_OBJECT)
        elif len(data) != len(self.values[index, sub]):
            raise Abort(0x06070010)
        else:
            self.values[index, sub] = bytes(data)

    def change_mapping(self, index, sub, value, state):
        assigning = index in self.assigned
        if state & 0x0F != PREOP:
            raise Abort(STATE)
        if assigning and not self.assignable or index in self.fixed:
            raise Abort(READ_ONLY)
        rows = self.assigned[index] if assigning else self.pdos[index]
        counts = self.counts if assigning else self.entry_counts
        if sub == 0:
            if value > len(rows):
                raise Abort(0x06040042)
            counts[index] = value
        elif counts[index] or sub > len(rows) + 1 or assigning and value not in self.pdos:
            raise Abort(READ_ONLY if counts[index] else 0x06040041)
        else:
            rows[sub - 1:sub] = [value if assigning else (value >> 16, value >> 8 & 0xFF, value & 0xFF)]

    def write_complete(self, index, data, state):
        raise Abort(0x06010000)


def objects(device):
    """Values of the dictionary by index and sub-index, as far as the file gives their sizes."""
    types = {kind.findtext("Name"): kind for kind in device.findall("Profile/Dictionary/DataTypes/DataType")}
    values = {}
    for entry in device.findall("Profile/Dictionary/Objects/Object"):
        index = number(entry.findtext("Index"))
        kind = types.get(entry.findtext("Type"))
        parts = kind.findall("SubItem") if kind is not None else []
        if not parts:
            values[index, 0] = default(entry.find("Info"), number(entry.findtext("BitSize")))
            continue
        infos = entry.findall("Info/SubItem")
        sub = 0
        for place, part in enumerate(parts):
            array = types.get(part.findtext("Type"))
            bounds = array.find("ArrayInfo") if array is not None else None
            count = number(bounds.findtext("Elements")) if bounds is not None else 1
            sub = number(part.findtext("SubIdx")) if part.findtext("SubIdx") else (1 if bounds is not None else place)
            for offset in range(count):
                info = infos[sub + offset].find("Info") if sub + offset < len(infos) else None
                values[index, sub + offset] = default(info, number(part.findtext("BitSize")) // count)
    return values


def default(info, bits):
    size = max(1, (bits + 7) // 8)
    text = info.findtext("DefaultData") if info is not None else None
    if text:
        try:
            return bytes.fromhex(text.strip())[:size].ljust(size, b"\0")
        except ValueError:
            pass
    value = number(info.findtext("DefaultValue")) if info is not None and (info.findtext("DefaultValue") or "").strip() else 0
    return (value & (1 << 8 * size) - 1).to_bytes(size, "little")
