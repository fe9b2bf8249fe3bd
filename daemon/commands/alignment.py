"""The command `align`: sets and clears the alignment, in order with the points."""

from traverse.daemon.delivery_dispatcher import Measuring
from traverse.daemon.errors import Result
from traverse.daemon.pose.alignment import (
    ActiveAlignment,
    Alignment,
    requested_alignment,
)
from traverse.protocol.messages import AlignArgs


class AlignmentCommands:
    """Changes the alignment.

    Args:
        part: where it is looked up.
        measuring: which points come before.
    """

    def __init__(self, part: ActiveAlignment, measuring: Measuring) -> None:
        self._part = part
        self._measuring = measuring

    async def change(self, args: AlignArgs) -> Result:
        """Give points part coordinates from now on, or no more; tells which.

        Points that were asked for before the command keep the alignment of then.
        """
        alignment = requested_alignment(args)

        def use() -> bool:
            self._part.alignment = alignment
            self._measuring.points.events.alignment(_told(alignment))
            return True

        self._measuring.asked("align", **args.model_dump())
        await self._measuring.points.in_order(use)
        return {"aligned": alignment is not None, "name": args.name}


def _told(alignment: Alignment | None) -> str:
    if alignment is None:
        return "no alignment: points have no part coordinates"
    return f"alignment {alignment.name or 'without a name'} is in use"
