"""Which handler executes which command."""

from collections.abc import Callable, Mapping
from pathlib import Path

from traverse.daemon.commands.dispatcher import CommandHandler
from traverse.daemon.commands.points import PointCommands
from traverse.daemon.commands.recording import RecordingCommands
from traverse.daemon.commands.reload import Inputs, Reload
from traverse.daemon.commands.resend import ResendCommands
from traverse.daemon.commands.scans import Requests
from traverse.daemon.measurement import Measurement
from traverse.daemon.output import Output
from traverse.daemon.system.systemd import Notifier


class CommandTable:
    """Composed of what carries commands out.

    Args:
        inputs: in force.
        path: of the configuration.
        embedded: the daemon has its own broker.
        measurement: that measures.
        output: where points, scans and recordings are kept.
        notifier: notified of reloads.
        use: puts new inputs into force, in one go.

    Attributes:
        reload: for those who have another reason than a command.
        change_scan: the command `scan`, which buttons have, too.
        carry_out: by name of the command.
    """

    def __init__(
        self,
        inputs: Inputs,
        path: Path,
        *,
        embedded: bool,
        measurement: Measurement,
        output: Output,
        notifier: Notifier,
        use: Callable[[Inputs], None],
    ) -> None:
        configuration = inputs.configuration
        self._scans = Requests(
            settings=configuration.capture,
            scan=configuration.scan,
            measurement=measurement,
        )
        library = configuration.arm.probes
        self._points = PointCommands(
            configuration.capture,
            measurement,
            None if library is None else path.parent / library,
        )
        self.reload = Reload(
            path=path,
            embedded=embedded,
            inputs=inputs,
            measurement=measurement,
            use=use,
            events=output.events,
            notifier=notifier,
        )
        resend = ResendCommands(output.outbox.again.carry_out, output.spool.again)
        self.change_scan = self._scans.change_scan
        self.carry_out: Mapping[str, CommandHandler] = {
            "point": self._points.take_point,
            "undo": self._points.undo,
            "label": self._points.label,
            "session": self._points.begin_session,
            "probe": self._points.change_probe,
            "scan": self._scans.change_scan,
            "align": self._points.align,
            "reload": self.reload.carry_out,
            "resend": resend.carry_out,
            "record": RecordingCommands(output.recorder).carry_out,
        }

    def track(self) -> None:
        """Have the devices stream at the rate that follows the joints."""
        self._scans.track()

    def use(self, inputs: Inputs) -> None:
        """Carry commands out by a new configuration."""
        configuration = inputs.configuration
        self._scans.use(configuration.capture, configuration.scan)
        self._points.use(configuration.capture)
