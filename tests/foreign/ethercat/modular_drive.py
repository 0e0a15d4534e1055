"""The drive of two axes whose axes are modules in slots (ETG.5001): what it exchanges is there once F030 says which modules are fitted,
as the vendor's configuration would, and only while it says so truly."""

import struct

import dual_drive
from coe import NO_SUBINDEX, READ_ONLY, STATE, Abort
from esc import PREOP

CONFIGURED, DETECTED = 0xF030, 0xF050
FITTED = [0x100, 0x100]
NOT_FITTED = 0x06090030


class ModularDrive(dual_drive.DualDrive):
    def __init__(self, position, cycle_us, options):
        super().__init__(position, cycle_us, options)
        vendor, _, revision, serial = self.identity
        self.identity, self.name = (vendor, dual_drive.PRODUCT + 1, revision, serial), "modules AM M (sim)"
        self.configured = [0, 0]

    @property
    def is_configured(self):
        return self.configured == FITTED

    def default_mapping(self):
        return [], []

    def power_cycle(self):
        super().power_cycle()
        self.configured = [0, 0]

    def process_data_bytes(self):
        return super().process_data_bytes() if self.is_configured else (0, 0)

    def exchange(self, outputs):
        return super().exchange(outputs) if self.is_configured else b""

    def read(self, index, sub):
        if index in (CONFIGURED, DETECTED):
            rows = self.configured if index == CONFIGURED else FITTED
            if sub > len(rows):
                raise Abort(NO_SUBINDEX)
            return struct.pack("<I", rows[sub - 1]) if sub else bytes([len(rows)])
        if index in dual_drive.FIXED and not self.is_configured:
            if sub:
                raise Abort(NO_SUBINDEX)
            return bytes([0])
        return super().read(index, sub)

    def write(self, index, sub, data, state):
        if index != CONFIGURED:
            super().write(index, sub, data, state)
        elif state & 0x0F != PREOP:
            raise Abort(STATE)
        elif not 0 < sub <= len(FITTED):
            raise Abort(READ_ONLY if sub == 0 else NO_SUBINDEX)
        elif int.from_bytes(data, "little") != FITTED[sub - 1]:
            raise Abort(NOT_FITTED)
        else:
            self.configured[sub - 1] = FITTED[sub - 1]
