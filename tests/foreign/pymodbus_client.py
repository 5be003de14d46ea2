#!/usr/bin/env python3
"""What tests/foreign/run.sh does with pymodbus, 3.0 (Debian 12) or newer. The first argument is the port.

read             volume and error rate, ABCD at 10 and 36 and from the mirror in CDAB at 2200
order            the same at 10 and 36, after the client has switched register 900 to each byte order
refused          writes from 127.0.0.2, which is not in write_allow: exception 01, and nothing has changed
book             commits book data by one FC16 of registers 920 to 930 and awaits the new error rate
command          "measure now" by FC6 of register 910, until its result is done
held UTC         waits until the measurement of that time is served as held; prints how long it took
"""
import inspect
import struct
import sys
import time

import pymodbus
from pymodbus.client import ModbusTcpClient

ORDERS = ("ABCD", "CDAB", "DCBA", "BADC")
VOLUME, ERROR_RATE, MASS, WRITES_REFUSED = 10, 36, 30, 254
port = int(sys.argv[1])


def connect(source="127.0.0.1"):
    client = ModbusTcpClient("127.0.0.1", port=port, timeout=5, source_address=(source, 0))
    if not client.connect():
        raise ConnectionError(f"cannot connect to port {port}")
    return client


def unit_of(method):
    """The unit id's keyword was renamed twice between 3.0 and 3.10."""
    names = inspect.signature(method).parameters
    return {next((n for n in ("device_id", "slave", "unit") if n in names), "slave"): 1}


def registers(client, address, count):
    reply = client.read_holding_registers(address, count=count, **unit_of(client.read_holding_registers))
    if reply.isError():
        raise RuntimeError(f"{count} registers from {address}: {reply}")
    return reply.registers


def write(client, address, values):
    if isinstance(values, int):
        return client.write_register(address, values, **unit_of(client.write_register))
    return client.write_registers(address, values, **unit_of(client.write_registers))


def number(words, order="ABCD"):
    """pymodbus' own decoders came and went between its releases; this is what they all do."""
    data = struct.pack(">2H", *words)
    a, b, c, d = data
    by_order = {"ABCD": (a, b, c, d), "CDAB": (c, d, a, b), "DCBA": (d, c, b, a), "BADC": (b, a, d, c)}
    return struct.unpack(">f", bytes(by_order[order]))[0]


def floats(*values):
    return [word for value in values for word in struct.unpack(">2H", struct.pack(">f", value))]


def report(order, volume, rate):
    print(f"{order} {volume:.6g} {rate:.6g}")


def await_that(holds, seconds=120, step=0.05):
    end = time.monotonic() + seconds
    while not holds():
        if time.monotonic() > end:
            raise TimeoutError(f"not so after {seconds} s")
        time.sleep(step)


def read():
    client = connect()
    block = registers(client, 0, 65)
    report("ABCD", number(block[VOLUME : VOLUME + 2]), number(block[ERROR_RATE : ERROR_RATE + 2]))
    mirror = registers(client, 2200, 125)
    report("CDAB", number(mirror[VOLUME : VOLUME + 2], "CDAB"), number(mirror[ERROR_RATE : ERROR_RATE + 2], "CDAB"))


def order():
    client = connect()
    for code, name in enumerate(ORDERS):
        reply = write(client, 900, code)
        if reply.isError():
            raise RuntimeError(f"register 900 = {code}: {reply}")
        report(name, *(number(registers(client, address, 2), name) for address in (VOLUME, ERROR_RATE)))
    write(client, 900, 0)


def refused():
    client = connect("127.0.0.2")
    before = registers(client, 900, 31)
    counted = registers(client, WRITES_REFUSED, 2)[1]
    book = floats(0.02, 800.0, 1.0, 0.0) + [0, 0, 1]
    for address, values in ((900, 1), (910, 3), (920, book)):
        reply = write(client, address, values)
        code = getattr(reply, "exception_code", None)
        print(f"write to {address} from 127.0.0.2: exception {code}")
        if code != 1:
            raise RuntimeError(f"wanted exception 1, got {reply}")
    if registers(client, 900, 31) != before:
        raise RuntimeError("registers 900 to 930 have changed")
    counted = registers(client, WRITES_REFUSED, 2)[1] - counted
    print(f"registers 900 to 930 unchanged; writes_refused has grown by {counted}")
    if counted != 3:
        raise RuntimeError("wanted 3")


def book():
    client = connect()
    sequence, before = registers(client, 5, 1)[0], number(registers(client, ERROR_RATE, 2))
    reply = write(client, 920, floats(0.0155, 800.0, 1.0, 0.0) + [0, 0, 1])
    if reply.isError():
        raise RuntimeError(f"commit: {reply}")
    await_that(lambda: registers(client, 930, 1)[0] == 2)
    print("committed 0.0155 t at 800 kg/m³; register 930 reads 2")
    command(client)
    await_that(lambda: registers(client, 5, 1)[0] != sequence)
    after = [number(registers(client, address, 2)) for address in (34, 28, MASS, ERROR_RATE)]
    print("book %.6g t, density %.6g kg/m³, mass %.6g t, error rate %.6g %% (before %.6g %%)" % (*after, before))
    if abs(after[0] - 0.0155) > 1e-8 or abs(after[1] - 800.0) > 1e-3:
        raise RuntimeError("the measurement was not compared with the committed book data")


def command(client=None):
    client = client or connect()
    reply = write(client, 910, 1)
    if reply.isError():
        raise RuntimeError(f"command: {reply}")
    start = time.monotonic()
    seen = []

    def done():
        result = registers(client, 910, 3)
        if not seen or seen[-1] != result:
            seen.append(result)
        return result[2] in (2, 3)

    await_that(done, step=0.02)
    print(f"measure now: registers 910 to 912 read {seen}, {time.monotonic() - start:.1f} s")
    if seen[-1][1:] != [1, 2]:
        raise RuntimeError("the command was not done")
    write(client, 910, 0)


def held(utc):
    start = time.monotonic()
    while True:
        try:
            client = connect()
            block = registers(client, 0, 65)
            if (block[6] << 16) + block[7] == utc and block[0] & 2:
                break
        except (ConnectionError, RuntimeError, pymodbus.exceptions.ModbusException):
            pass  # not yet up
        if time.monotonic() - start > 60:
            raise TimeoutError("the held figure is not served within a minute")
        time.sleep(0.01)
    age = (block[8] << 16) + block[9]
    print(
        f"held figure of UTC {utc} served {time.monotonic() - start:.2f} s after the start: "
        f"status 0x{block[0]:04x}, age {age} s, volume {number(block[10:12]):.6g} m³; "
        f"book data in force {number(registers(client, 920, 2)):.6g} t"
    )


if __name__ == "__main__":
    name = sys.argv[2]
    print(f"# pymodbus {pymodbus.__version__}", file=sys.stderr)
    {"read": read, "order": order, "refused": refused, "book": book, "command": command}.get(
        name, lambda: held(int(sys.argv[3]))
    )()
