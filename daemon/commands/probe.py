"""The command `probe`: another probe between two samples."""

import asyncio
from collections.abc import Callable
from pathlib import Path

from traverse.daemon.delivery_dispatcher import Measuring
from traverse.daemon.errors import CaptureRefusedError, RequestRefusedError, Result
from traverse.daemon.pose.arm_model import ArmModel, model_with_probe
from traverse.daemon.pose.probe_library import LibraryProbe, read_probes
from traverse.kinematics.arm_file.arm import FileError
from traverse.protocol.messages import ProbeArgs

REFUSED = "capture.probe_refused"


class ProbeCommands:
    """Changes probes.

    Args:
        library: the file of probes; None where the configuration names none.
        measuring: what measures with them.
        changed: called when another one measures.
    """

    def __init__(
        self,
        *,
        library: Path | None,
        measuring: Measuring,
        changed: Callable[[], None],
    ) -> None:
        self._library = library
        self._measuring = measuring
        self._changed = changed
        self._chosen: LibraryProbe | None = None

    def model_of(self, model: ArmModel) -> ArmModel:
        """An arm, as its file says it, with the probe that is in use.

        Raises:
            ValueError: it cannot have that probe.
        """
        return model if self._chosen is None else model_with_probe(model, self._chosen)

    async def change(self, args: ProbeArgs) -> Result:
        """Measure with a probe of the library; gives its name and the new model."""
        path = self._library
        if path is None:
            raise RequestRefusedError(
                "command.not_available",
                "the configuration names no probe library",
                "write one, and name it as `probes` in [arm]",
            )
        try:  # anew each time, so that a probe can be added while the daemon runs
            library = await asyncio.to_thread(read_probes, path)
        except FileError as error:
            raise RequestRefusedError(
                REFUSED, str(error)[:2000], "correct the probe library"
            ) from error
        chosen = library.named(args.name)
        if chosen is None:
            raise RequestRefusedError(
                REFUSED,
                f"{path.name} has no probe {args.name!r}; it has: {library.names}",
                "use one of these names, or add the probe to the library",
            )
        points = self._measuring.points

        def use() -> ArmModel:
            # On the arm as it is when its turn comes; it may have been reloaded.
            try:
                model = model_with_probe(self._measuring.model, chosen)
            except ValueError as error:
                raise CaptureRefusedError(
                    f"the arm cannot measure with {chosen.name!r}: {error}",
                    "correct the probe library",
                    REFUSED,
                ) from error
            self._measuring.use_probe(model)
            self._chosen = chosen
            points.events.probe(chosen.name, model)
            self._changed()
            return model

        self._measuring.asked("probe", probe=chosen.model_dump_json())
        model: ArmModel = await points.in_order(use)
        return {
            "probe": chosen.name,
            "model": model.digest,
            "radius_mm": model.probe_radius_mm,
        }
