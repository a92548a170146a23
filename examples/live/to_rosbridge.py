#!/usr/bin/env python3
"""Passes the lines of `kurs live` (profile ros2) on to rosbridge, one message each; again and again if a side is gone.

    python3 to_rosbridge.py HOST:PORT ws://HOST:PORT        needs: pip install websockets
"""

import asyncio
import sys

import websockets


async def pass_on(host, port, bridge):
    reader, writer = await asyncio.open_connection(host, port)
    try:
        async with websockets.connect(bridge) as socket:
            async for line in reader:
                await socket.send(line.decode())
    finally:
        writer.close()


async def main(address, bridge):
    host, port = address.rsplit(":", 1)
    while True:
        try:
            await pass_on(host, int(port), bridge)
        except (OSError, websockets.WebSocketException) as error:
            print(f"again in a second: {error}", file=sys.stderr)
        await asyncio.sleep(1)


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    asyncio.run(main(*sys.argv[1:]))
