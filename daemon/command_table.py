"""Which command is carried out by what, and what buttons do besides points."""

from collections.abc import Callable, Mapping
from pathlib import Path

from traverse.daemon.commands.alignment import AlignmentCommands
from traverse.daemon.commands.button_actions import ButtonScans
from traverse.daemon.commands.dispatcher import CommandHandler
from traverse.daemon.commands.points import PointCommands
from traverse.daemon.commands.probe import ProbeCommands
from traverse.daemon.commands.recording import RecordingCommands
from traverse.daemon.commands.reload import Inputs, Reload
from traverse.daemon.commands.resend import ResendCommands
from traverse.daemon.commands.scans import Requests
from traverse.daemon.instrument import Instrument
from traverse.daemon.output import Output
from traverse.daemon.system.systemd import Notifier


class CommandTable:
    """Composed of what carries commands out.

    Args:
        inputs: in force.
        path: of the configuration.
        embedded: the daemon has its own broker.
        instrument: that measures.
        output: where points, scans and recordings are kept.
        notifier: told of reloads.
        status_changed: called after what a status tells: session or probe.
        use: puts new inputs into force, in one go.

    Attributes:
        reload: for those who have another reason than a command.
        carry_out: by name of the command.
    """

    def __init__(
        self,
        inputs: Inputs,
        path: Path,
        *,
        embedded: bool,
        instrument: Instrument,
        output: Output,
        notifier: Notifier,
        status_changed: Callable[[], None],
        use: Callable[[Inputs], None],
    ) -> None:
        configuration, measuring = inputs.configuration, instrument.measuring
        self._scans = Requests(
            settings=configuration.capture,
            scan=configuration.scan,
            devices=instrument.arm_devices,
            scanner=instrument.scanner,
            measuring=measuring,
        )
        self._points = PointCommands(
            settings=configuration.capture,
            devices=instrument.arm_devices,
            capture=instrument.capture,
            measuring=measuring,
            session_changed=status_changed,
        )
        library = configuration.arm.probes
        probes = ProbeCommands(
            library=None if library is None else path.parent / library,
            measuring=measuring,
            changed=status_changed,
        )
        self.reload = Reload(
            path=path,
            embedded=embedded,
            inputs=inputs,
            devices=instrument.devices,
            measuring=measuring,
            with_probe=probes.model_of,
            use=use,
            events=output.events,
            notifier=notifier,
        )
        resend = ResendCommands(output.outbox.again.carry_out, output.spool.again)
        self.carry_out: Mapping[str, CommandHandler] = {
            "point": self._points.take_point,
            "undo": self._points.undo,
            "label": self._points.label,
            "session": self._points.begin_session,
            "probe": probes.change,
            "scan": self._scans.change_scan,
            "align": AlignmentCommands(instrument.part, measuring).change,
            "reload": self.reload.carry_out,
            "resend": resend.carry_out,
            "record": RecordingCommands(output.recorder).carry_out,
        }
        actions = ButtonScans(self._scans.change_scan, output.events)
        measuring.points.carry_out |= {
            "scan": actions.start_scan,
            "stop": actions.stop_scan,
            "session": status_changed,
        }

    def track(self) -> None:
        """Have the devices stream at the rate that follows the joints."""
        self._scans.track()

    def use(self, inputs: Inputs) -> None:
        """Carry commands out by a new configuration."""
        configuration = inputs.configuration
        self._scans.use(configuration.capture, configuration.scan)
        self._points.use(configuration.capture)
