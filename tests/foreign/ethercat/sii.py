"""The slave information interface: what a slave says of itself before anything is configured (ETG.2010)."""

import struct

STRINGS, GENERAL, FMMUS, SYNC_MANAGERS, TX_PDO, RX_PDO, END = 10, 30, 40, 41, 50, 51, 0xFFFF
# CoE: SDO; with it PDO assignment, PDO configuration, complete access.
SDO, ASSIGN, CONFIGURE, COMPLETE = 0x01, 0x04, 0x08, 0x20


def crc8(data):
    """Of the first seven words: x⁸ + x² + x + 1, beginning with 0xFF."""
    crc = 0xFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = (crc << 1 ^ 0x07 if crc & 0x80 else crc << 1) & 0xFF
    return crc


def category(kind, data):
    data += bytes(len(data) % 2)
    return struct.pack("<HH", kind, len(data) // 2) + data


def strings(texts):
    return bytes([len(texts)]) + b"".join(bytes([len(text)]) + text.encode("latin-1") for text in texts)


def pdos(mapping, sync_manager):
    """`mapping`: index of the PDO and its entries (index, sub-index, bits)."""
    data = b""
    for index, entries in mapping:
        data += struct.pack("<HBBBBH", index, len(entries), sync_manager, 0, 0, 0)
        for entry, sub, bits in entries:
            data += struct.pack("<HBBBBH", entry, sub, 0, 0, bits, 0)
    return data


def image(identity, name, managers, outputs, inputs, coe):
    """`identity`: vendor, product, revision, serial number; `managers`: start, length, control, two of them where there is no
    mailbox; `coe`: what the mailbox can."""
    mailbox = len(managers) == 4
    (out, out_bytes, _), (answer, answer_bytes, _) = managers[:2] if mailbox else ((0, 0, 0), (0, 0, 0))
    head = bytearray(128)
    # PDI control: no ESC configuration that a master would have to know.
    struct.pack_into("<HH", head, 0, 0x0005, 0)
    struct.pack_into("<H", head, 14, crc8(head[:14]))
    struct.pack_into("<IIII", head, 16, *identity)
    struct.pack_into("<HHHHH", head, 0x18 * 2, out, out_bytes, answer, answer_bytes, 0x0004 if mailbox else 0)
    struct.pack_into("<HH", head, 0x3E * 2, 0x0F, 1)
    size = lambda mapping: (sum(bits for _, entries in mapping for _, _, bits in entries) + 7) // 8
    listed = b""
    for (start, length, control), kind in zip(managers, (1, 2, 3, 4) if mailbox else (3, 4)):
        length = {3: size(outputs), 4: size(inputs)}.get(kind, length)
        listed += struct.pack("<HHBBBB", start, length, control, 0, 1, kind)
    general = struct.pack("<BBBBBBBBBBBBhBBHHHB", 0, 0, 1, 1, 0, coe, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0x0011, 0, 0, 0)
    return bytes(head) + b"".join((
        category(STRINGS, strings([name])),
        category(GENERAL, general),
        category(FMMUS, bytes([1, 2, 3, 0] if mailbox else [1, 2])),
        category(SYNC_MANAGERS, listed),
        category(TX_PDO, pdos(inputs, 3 if mailbox else 1)),
        category(RX_PDO, pdos(outputs, 2 if mailbox else 0)),
        struct.pack("<HH", END, 0),
    ))
