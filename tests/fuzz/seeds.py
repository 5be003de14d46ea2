#!/usr/bin/env python3
"""seeds.py FOLDER: writes the seed inputs of the fuzz targets into FOLDER/modbus and FOLDER/rtu: one good conversation
for each function, and the faults that servers have stumbled over. Layout of an input: the head of each target's .cpp."""
import struct
import sys
from pathlib import Path


def words(*values):
    return struct.pack(f">{len(values)}H", *values)


def floats(*values):
    return struct.pack(f">{len(values)}f", *values)


def write_many(address, data):
    return bytes([16]) + words(address, len(data) // 2) + bytes([len(data)]) + data


BOOK = floats(15.2, 790.0, 1.0, 0.0) + words(0, 0, 1)  # registers 920…930
PDUS = {
    "coils": bytes([1]) + words(0, 51),
    "inputs": bytes([2]) + words(0, 48),
    "summary": bytes([3]) + words(0, 65),
    "summary-as-input-registers": bytes([4]) + words(0, 65),
    "block-5708": bytes([3]) + words(100, 26),
    "diagnostics": bytes([3]) + words(200, 100),
    "identity": bytes([3]) + words(300, 50),
    "controls": bytes([3]) + words(900, 31),
    "mirrors": bytes([3]) + words(2200, 125),
    "integers": bytes([3]) + words(3000, 60),
    "last-register": bytes([3]) + words(3999, 1),
    "beyond": bytes([3]) + words(3999, 2),
    "quantity-0": bytes([3]) + words(0, 0),
    "quantity-126": bytes([3]) + words(0, 126),
    "address-wraps": bytes([4]) + words(0xFFFF, 125),
    "short": bytes([3, 0]),
    "measure": bytes([5]) + words(48, 0xFF00),
    "inhibit-coil": bytes([5]) + words(50, 0xFF00),
    "coil-neither": bytes([5]) + words(48, 1),
    "byte-order": bytes([6]) + words(900, 1),
    "byte-order-4": bytes([6]) + words(900, 4),
    "invalid-policy": bytes([6]) + words(901, 2),
    "command": bytes([6]) + words(910, 1),
    "command-5": bytes([6]) + words(910, 5),
    "read-only": bytes([6]) + words(10, 1),
    "coils-many": bytes([15]) + words(48, 3) + bytes([1, 0b101]),
    "coils-count-lies": bytes([15]) + words(48, 3) + bytes([9, 1]),
    "book": write_many(920, BOOK),
    "book-half-float": write_many(920, BOOK[:6]),
    "book-nan": write_many(920, floats(float("nan"), 790.0, 1.0, 0.0) + words(0, 0, 1)),
    "book-count-lies": bytes([16]) + words(920, 11) + bytes([200]) + BOOK,
    "commit": bytes([6]) + words(930, 1),
    "server-id": bytes([17]),
    "mask": bytes([22]) + words(900, 0, 2),
    "read-write": bytes([23]) + words(900, 31, 920, 11) + bytes([22]) + BOOK,
    "identification": bytes([43, 14, 1, 0]),
    "identification-all": bytes([43, 14, 3, 0]),
    "identification-one": bytes([43, 14, 4, 0x81]),
    "mei-other": bytes([43, 13, 1, 0]),
    "function-0": bytes([0]),
    "function-255": bytes([255, 1, 2]),
    "longest": bytes([16]) + words(920, 123) + bytes([246]) + bytes(246),
}


def mbap(pdu, unit=3, transaction=0, protocol=0, length=None):
    return words(transaction, protocol, len(pdu) + 1 if length is None else length) + bytes([unit]) + pdu


def crc(data):
    value = 0xFFFF
    for byte in data:
        value ^= byte
        for _ in range(8):
            value = (value >> 1) ^ 0xA001 if value & 1 else value >> 1
    return struct.pack("<H", value)


def heard(frame, pause=20):
    """A frame as reads of at most 32 bytes, the first after so many quarters of a character of silence."""
    chunks = [frame[i : i + 32] for i in range(0, len(frame), 32)]
    return b"".join(bytes([pause if i == 0 else 0, len(c) - 1]) + c for i, c in enumerate(chunks))


def modbus_seeds():
    all_allowed, nothing_allowed = bytes([0b00111]), bytes([0b00010])
    for name, pdu in PDUS.items():
        yield name, all_allowed + mbap(pdu)
    for name in ("book", "measure", "byte-order", "read-write", "coils-many"):
        yield f"{name}-forbidden", nothing_allowed + mbap(PDUS[name])
        yield f"{name}-busy", bytes([0b00101]) + mbap(PDUS[name])
    staged = [write_many(920 + 2 * i, floats(v)) for i, v in enumerate((15.2, 790.0, 1.0, 0.0))]
    yield "staged", all_allowed + b"".join(map(mbap, [*staged, PDUS["controls"], PDUS["commit"], PDUS["controls"]]))
    yield "staged-by-two", all_allowed + mbap(staged[0]) + mbap(staged[1], transaction=1) + mbap(PDUS["commit"])
    yield "staged-too-long-ago", all_allowed + mbap(staged[0]) + mbap(PDUS["commit"], transaction=61 << 8)
    for order in range(4):
        for policy in range(3):
            formats = mbap(write_many(900, words(order, policy)))
            yield f"format-{order}-{policy}", bytes([0b10111]) + formats + mbap(PDUS["summary"]) + mbap(PDUS["mirrors"])
    yield "unmeasured", bytes([0b01000]) + mbap(PDUS["summary"]) + mbap(PDUS["integers"]) + mbap(PDUS["block-5708"])
    yield "injected", bytes([0b11000]) + mbap(PDUS["summary"]) + mbap(PDUS["inputs"])
    yield "other-unit", all_allowed + mbap(PDUS["summary"], unit=9) + mbap(PDUS["summary"], unit=255)
    yield "protocol", all_allowed + mbap(PDUS["summary"], protocol=256)
    for length in (0, 1, 255, 0xFFFF):
        yield f"length-{length}", all_allowed + mbap(PDUS["summary"], length=length)
    yield "half", all_allowed + mbap(PDUS["summary"]) + mbap(PDUS["summary"])[:5]


def rtu_seeds():
    all_allowed = bytes([0b01000111])  # 19200 bit/s
    for name, pdu in PDUS.items():
        frame = bytes([3]) + pdu
        yield name, all_allowed + heard(frame + crc(frame))
    own = bytes([3]) + PDUS["summary"]
    own += crc(own)
    other = bytes([7]) + PDUS["diagnostics"]
    other += crc(other)
    answer = bytes([7, 3, 200]) + bytes(range(200))
    answer += crc(answer)
    broadcast = bytes([0]) + PDUS["command"]
    yield "broadcast", all_allowed + heard(broadcast + crc(broadcast))
    yield "other-slave", all_allowed + heard(other) + heard(answer) + heard(own)
    yield "dead-neighbour", all_allowed + heard(other) + heard(own, 200)
    yield "wrong-checksum", all_allowed + heard(own[:-1] + b"\0") + heard(own)
    yield "half-frame", all_allowed + heard(own[:4]) + heard(own)
    yield "noise-before", all_allowed + heard(b"\xff\x00\xfe") + heard(own, 2)
    yield "pause-inside", all_allowed + heard(own[:4]) + heard(own[4:], 8)
    yield "back-to-back", all_allowed + heard(own) + heard(own, 0)
    yield "with-echo", bytes([0b01001111]) + heard(own) + heard(own, 255)
    yield "repaired", all_allowed + bytes([20, 128 + 7]) + own[:-2] + b"\0\0"
    for speed in range(8):
        yield f"speed-{speed}", bytes([speed << 4]) + heard(own) + heard(own, 15)


def main():
    for target, seeds in (("modbus", modbus_seeds()), ("rtu", rtu_seeds())):
        folder = Path(sys.argv[1]) / target
        folder.mkdir(parents=True, exist_ok=True)
        for name, data in seeds:
            (folder / name).write_bytes(data)


if __name__ == "__main__":
    main()
