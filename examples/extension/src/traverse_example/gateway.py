"""Points on standard output, a line of JSON each."""

import json

from traverse import Arm


async def json_lines(
    arm: Arm, *, unit: float = 1.0, with_doubtful: bool = False
) -> None:
    """Print points as lines of JSON, until it is stopped.

    Args:
        arm: Connected, and disconnected afterwards, by Traverse.
        unit: Length of the unit [mm], such as 25.4.
        with_doubtful: Print points in doubt, too.
    """
    async for point in arm.points():
        if point.quality.ok or with_doubtful:
            place = [mm / unit for mm in point.xyz_mm]
            line = {"seq": point.seq, "xyz": place, "ok": point.quality.ok}
            print(json.dumps(line), flush=True)
