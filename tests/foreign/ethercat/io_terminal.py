"""A terminal without a mailbox: eight switches and a lamp for each of eight outputs, one analogue input and one output, a counter.

What it takes goes from it: its analogue input shows its analogue output, its counter counts the rising edges of its first output, and
inputs are as a tester sets them (`order input`).
"""

import struct


class IoTerminal:
    name, identity, coe = "DIO8 AIO1 CNT1", (0x0, 0x106, 2, 0), 0
    # Outputs, then inputs, as fixed maps begin with the switches of a byte.
    managers = [(0x1000, 3, 0x44), (0x1400, 5, 0x00)]
    statusword = None

    def __init__(self):
        self.esc, self.switches, self.count, self.outputs = None, 0, 0xFFFE, bytes(3)
        self.history = []

    @staticmethod
    def default_mapping():
        bits = lambda index: [(index, bit + 1, 1) for bit in range(8)]
        return ([(0x1600, bits(0x7000)), (0x1601, [(0x7010, 1, 16)])],
                [(0x1A00, bits(0x6000)), (0x1A01, [(0x6010, 1, 16)]), (0x1A02, [(0x6020, 1, 16)])])

    @staticmethod
    def process_data_bytes():
        return 3, 5

    @property
    def position(self):
        return self.switches

    def exchange(self, outputs):
        if outputs[0] & ~self.outputs[0] & 1:
            self.count = self.count + 1 & 0xFFFF
        if outputs != self.outputs:
            self.history.append(outputs.hex())
        self.outputs = outputs
        return struct.pack("<B", self.switches) + outputs[1:3] + struct.pack("<H", self.count)

    def set_input(self, bit, on):
        self.switches = self.switches | 1 << bit if on else self.switches & ~(1 << bit)

    def comms_lost(self):
        pass

    def power_cycle(self):
        self.count = 0
