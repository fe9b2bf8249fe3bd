"""The command `record`: start or stop a recording with a name."""

from traverse.daemon.errors import RequestRefusedError, Result
from traverse.daemon.recorder.recorder import Recorder
from traverse.protocol.messages import RecordArgs


async def record(recorder: Recorder, args: RecordArgs) -> Result:
    """Start or stop a recording; gives its file, and at the end how long it is.

    Raises:
        RequestRefusedError: it cannot be written, another one runs, or none does.
    """
    if args.action == "start" and recorder.name_in_use is not None:
        raise RequestRefusedError(
            "recording.busy",
            f"{recorder.name_in_use!r} is being recorded",
            "stop it first; there is one recording at a time",
        )
    if args.action == "stop" and recorder.name_in_use is None:
        raise RequestRefusedError(
            "recording.none",
            "nothing is being recorded",
            "it may have ended by itself: see the events recording.stopped",
        )
    try:
        if args.action == "start":
            path = await recorder.begin(args.name or "", args.note or "")
            return {"name": args.name or "", "file": str(path)}
        recorded = await recorder.finish()
    except OSError as error:
        raise RequestRefusedError(
            "recording.failed",
            f"the recording cannot be written: {error.strerror or error}",
            "make room on the daemon's disk, or use another name",
        ) from error
    return {
        "name": recorded.name,
        "file": str(recorded.path),
        "bytes": recorded.n_bytes,
        "messages": recorded.messages,
        "seconds": recorded.seconds,
        "gaps": recorded.gaps,
    }
