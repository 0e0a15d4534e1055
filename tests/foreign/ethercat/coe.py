"""The mailbox: CANopen over EtherCAT (ETG.1000.6), SDO upload and download, expedited, normal and in segments."""

import struct

COE, ERROR_MAIL = 3, 0
REQUEST, RESPONSE = 2, 3
TOGGLE, NO_OBJECT, NO_SUBINDEX, READ_ONLY, LENGTH, STATE, SERVICE, OUT_OF_MEMORY = (
    0x05030000, 0x06020000, 0x06090011, 0x06010002, 0x06070010, 0x08000022, 0x05040001, 0x05040005)


class Abort(Exception):
    def __init__(self, code):
        super().__init__(hex(code))
        self.code = code


class Mailbox:
    """One slave's mailbox; `objects` has `read(index, sub)`, `read_complete(index)` and `write(index, sub, data, state)`."""

    def __init__(self, objects, size):
        self.objects, self.size = objects, size
        self.answers, self.count = [], 0
        self.clear()

    def clear(self):
        self.answers, self.upload, self.download = [], None, None

    def next_answer(self):
        return self.answers.pop(0) if self.answers else None

    def take(self, mail, esc):
        length, address, _, kind = struct.unpack_from("<HHBB", mail)
        body = mail[6:6 + length]
        if kind & 0x0F != COE or len(body) < 10 or struct.unpack_from("<H", body)[0] >> 12 != REQUEST:
            # Mailbox error: protocol not supported.
            self.send(ERROR_MAIL, struct.pack("<HH", 1, 2), address)
            return
        command, index, sub = struct.unpack_from("<BHB", body, 2)
        try:
            answer = self.sdo(command, index, sub, body[6:], esc)
        except Abort as abort:
            self.upload = self.download = None
            self.send(COE, struct.pack("<HBHBI", REQUEST << 12, 0x80, index, sub, abort.code), address)
            return
        self.send(COE, struct.pack("<H", RESPONSE << 12) + answer, address)

    def send(self, kind, body, address):
        self.count = self.count % 7 + 1
        self.answers.append(struct.pack("<HHBB", len(body), address, 0, kind | self.count << 4) + body)

    def sdo(self, command, index, sub, data, esc):
        specifier = command >> 5
        if specifier == 2:
            return self.begin_upload(command, index, sub)
        if specifier == 3:
            return self.go_on_uploading(command)
        if specifier == 1:
            return self.begin_download(command, index, sub, data, esc)
        if specifier == 0:
            return self.go_on_downloading(command, struct.pack("<HB", index, sub) + data, esc)
        raise Abort(SERVICE)

    def begin_upload(self, command, index, sub):
        value = self.objects.read_complete(index) if command & 0x10 else self.objects.read(index, sub)
        if command & 0x10 and sub == 1:
            value = value[2:]
        head = struct.pack("<HB", index, sub)
        if len(value) <= 4:
            return bytes([0x43 | 4 - len(value) << 2 | command & 0x10]) + head + value.ljust(4, b"\0")
        room = self.size - 6 - 2 - 8
        self.upload = value[room:] if len(value) > room else None
        return bytes([0x41 | command & 0x10]) + head + struct.pack("<I", len(value)) + value[:room]

    def go_on_uploading(self, command):
        if self.upload is None:
            raise Abort(SERVICE)
        room = self.size - 6 - 2 - 1
        part, rest = self.upload[:room], self.upload[room:]
        self.upload = rest or None
        missing = max(0, 7 - len(part))
        return bytes([command & 0x10 | missing << 1 | (0 if rest else 1)]) + part.ljust(7, b"\0")

    def begin_download(self, command, index, sub, data, esc):
        head = struct.pack("<HB", index, sub) + bytes(4)
        if command & 2:
            size = 4 - (command >> 2 & 3) if command & 1 else 4
            self.store(command, index, sub, data[:size], esc)
        else:
            size = struct.unpack_from("<I", data)[0]
            if size > 0x1000:
                raise Abort(OUT_OF_MEMORY)
            if size > len(data) - 4:
                self.download = (command, index, sub, size, data[4:])
            else:
                self.store(command, index, sub, data[4:4 + size], esc)
        return bytes([0x60 | command & 0x10]) + head

    def go_on_downloading(self, command, data, esc):
        if self.download is None:
            raise Abort(SERVICE)
        first, index, sub, size, begun = self.download
        begun += data[:len(data) - (command >> 1 & 7)] if len(data) == 7 else data
        self.download = (first, index, sub, size, begun)
        if command & 1:
            self.download = None
            self.store(first, index, sub, begun[:size], esc)
        return bytes([0x20 | command & 0x10]) + bytes(7)

    def store(self, command, index, sub, value, esc):
        if not command & 0x10:
            self.objects.write(index, sub, value, esc.state)
            return
        # Complete access: sub-index 0 in two bytes, then the others.
        if sub == 0:
            value = value[:1] + value[2:]
        self.objects.write_complete(index, value, esc.state)
