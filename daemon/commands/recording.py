"""What the command `record` does, and the recorder of a configuration."""

import logging
from importlib.metadata import version
from pathlib import Path

from traverse.daemon.config.schema import Configuration
from traverse.daemon.errors import RequestRefusedError, Result
from traverse.daemon.frozen_clock import FrozenClock
from traverse.daemon.inputs import REFUSED, StartupError
from traverse.daemon.monitoring.events import EventLog
from traverse.daemon.recorder.recorded_inputs import recorded_files
from traverse.daemon.recorder.recorder import Recorder
from traverse.daemon.state_dir import RECORDINGS, state_path
from traverse.kinematics.kernel.choice import KERNEL
from traverse.protocol.messages import RecordArgs

log = logging.getLogger(__name__)


def recorder_of(
    configuration: Configuration,
    path: Path,
    *,
    arm: str,
    clock: FrozenClock,
    events: EventLog,
) -> Recorder:
    """Make the configured recorder.

    Raises:
        StartupError: a file has disappeared since it was read.
    """
    try:
        files = recorded_files(path, configuration)
    except OSError as error:
        raise StartupError([f"{error}; was it moved just now?"], REFUSED) from error
    about = {"arm": arm, "version": version("traverse-cmm"), "kernel": KERNEL}
    recorder = Recorder(
        configuration.recording,
        folder=(state_path(path) / RECORDINGS).absolute(),
        clock=clock,
        about=about,
        files=files,
        events=events,
    )
    clock.related = recorder.related
    return recorder


def tell_reloaded(recorder: Recorder, path: Path, configuration: Configuration) -> None:
    """Have what is in force now recorded."""
    try:
        files = recorded_files(path, configuration)
    except OSError as error:  # it was there a moment ago, when it was read
        log.warning("recordings will lack the new files: %s", error)
        files = {}
    recorder.reloaded(files)


class RecordingCommands:
    """Carries out the command.

    Args:
        recorder: what records.
    """

    def __init__(self, recorder: Recorder) -> None:
        self._recorder = recorder

    async def carry_out(self, args: RecordArgs) -> Result:
        """Start or stop a recording; gives its file, and at the end how long it is."""
        try:
            if args.action == "stop":
                return await self._stop()
            return await self._start(args.name or "", args.note or "")
        except OSError as error:
            raise RequestRefusedError(
                "recording.failed",
                f"the recording cannot be written: {error.strerror or error}",
                "make room on the daemon's disk, or use another name",
            ) from error

    async def _start(self, name: str, note: str) -> Result:
        running = self._recorder.running
        if running is not None:
            raise RequestRefusedError(
                "recording.busy",
                f"{running!r} is being recorded",
                "stop it first; there is one recording at a time",
            )
        path = await self._recorder.begin(name, note)
        return {"name": name, "file": str(path)}

    async def _stop(self) -> Result:
        if self._recorder.running is None:
            raise RequestRefusedError(
                "recording.none",
                "nothing is being recorded",
                "it may have ended by itself: see the events recording.stopped",
            )
        recorded = await self._recorder.finish()
        return {
            "name": recorded.name,
            "file": str(recorded.path),
            "bytes": recorded.n_bytes,
            "messages": recorded.messages,
            "seconds": recorded.seconds,
            "gaps": recorded.gaps,
        }
