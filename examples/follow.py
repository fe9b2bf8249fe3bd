"""Every point of an arm, none lost and none twice, also over restarts of this program.

The place where to go on is kept in a file.
"""

import asyncio
import sys

from traverse import Arm, Lost


async def main(arm_name: str, broker: str, place: str) -> None:
    async with Arm(arm_name, broker, cursor_file=place) as arm:
        async for item in arm.points_and_losses():
            if isinstance(item, Lost):
                print(f"lost: {item.from_seq} to {item.to_seq}: {item.reason}")
            elif item.retracts is not None:
                print(f"{item.seq} takes {item.retracts} back")
            else:
                print(item.seq, *item.xyz_mm, flush=True)


asyncio.run(main(*sys.argv[1:4]))
