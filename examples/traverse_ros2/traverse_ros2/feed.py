"""What an arm publishes, as contents of ROS 2 messages; needs no ROS."""

from collections.abc import Callable, Sequence

from traverse import Arm, Lost
from traverse.client.cancel_tasks import run_together
from traverse.client.exports.point_table import block_table
from traverse.client.exports.ros_messages import (
    RosMessage,
    ball_transform,
    joint_states,
    point_messages,
    scan_messages,
)

Publish = Callable[[RosMessage], None]


async def feed(
    arm: Arm,
    publish: Publish,
    warn: Callable[[str], None],
    *,
    joints: Sequence[str] = (),
    frame: str,
) -> None:
    """Publish poses, points and scans until it is cancelled.

    Args:
        arm: Connected.
        publish: Called with each message.
        warn: Called with what a subscriber cannot see.
        joints: Their names, from the base outwards.
        frame: Name of the arm's system.
    """

    async def points() -> None:
        async for item in arm.points_and_losses():
            if isinstance(item, Lost):
                warn(str(item))
            elif item.retracts is not None:
                warn(f"point {item.seq} takes back {item.retracts}, published before")
            else:
                for message in point_messages(item, frame=frame):
                    publish(message)

    async def poses() -> None:
        async for live in arm.live():
            publish(joint_states(live, joints, frame))
            publish(ball_transform(live, frame))

    async def scans() -> None:
        async for block in await arm.scans():
            table = block_table(block)
            for message in scan_messages(table, frame) if table else ():
                publish(message)

    await run_together(points(), poses(), scans())
