"""A Modbus server based on pymodbus (Debian's 3.0): pymodbus_server.py tcp PORT | rtu TTY | ascii TTY [UNITS].

Unit 1: holding and input registers 0 to 99 hold 1000 and 2000 + their number; every third coil and every fifth
discrete input is on. Each further unit has 100 more in each register than the one before. Prints "ready" when it
serves.
"""

import asyncio
import sys

from pymodbus.datastore import ModbusSequentialDataBlock, ModbusServerContext, ModbusSlaveContext
from pymodbus.server.async_io import ModbusSerialServer, ModbusTcpServer
from pymodbus.transaction import ModbusAsciiFramer, ModbusRtuFramer, ModbusSocketFramer


def unit(number):
    block = ModbusSequentialDataBlock
    more = 100 * (number - 1)
    return ModbusSlaveContext(
        co=block(0, [n % 3 == 0 for n in range(100)]),
        di=block(0, [n % 5 == 0 for n in range(100)]),
        hr=block(0, [1000 + more + n for n in range(100)]),
        ir=block(0, [2000 + more + n for n in range(100)]), zero_mode=True)


def context(units):
    return ModbusServerContext(slaves={n: unit(n) for n in range(1, units + 1)}, single=False)


async def main():
    kind, where = sys.argv[1:3]
    served = context(int(sys.argv[3]) if len(sys.argv) > 3 else 1)
    if kind == "tcp":
        server = ModbusTcpServer(served, framer=ModbusSocketFramer,
                                 address=("127.0.0.1", int(where)), allow_reuse_address=True)
    else:
        framer = ModbusRtuFramer if kind == "rtu" else ModbusAsciiFramer
        server = ModbusSerialServer(served, framer=framer, port=where, baudrate=115200,
                                    bytesize=8, parity="N", stopbits=1, timeout=0.05)
        await server.start()
    print("ready", flush=True)
    await server.serve_forever()


asyncio.run(main())
