"""A slave without a mailbox: eight inputs that show its eight outputs, as simple terminals are built."""


class IoDevice:
    name, identity, coe = "Inputs and outputs", (0x0, 0x105, 1, 0), 0
    managers = [(0x1000, 1, 0x44), (0x1400, 1, 0x00)]
    statusword = None

    def __init__(self):
        self.position, self.esc = 0, None

    @staticmethod
    def default_mapping():
        return [(0x1600, [(0x7000, bit + 1, 1) for bit in range(8)])], [(0x1A00, [(0x6000, bit + 1, 1) for bit in range(8)])]

    @staticmethod
    def process_data_bytes():
        return 1, 1

    def exchange(self, outputs):
        self.position = outputs[0]
        return outputs

    def comms_lost(self):
        pass

    def power_cycle(self):
        self.position = 0
