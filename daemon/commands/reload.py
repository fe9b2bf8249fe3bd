"""The command `reload`: read arm file and configuration again, between two samples.

The files are read and checked completely before anything changes, and take effect while
no point is being taken, so that each point belongs to one arm and one configuration. If
they are refused, the old ones stay in force.
"""

import asyncio
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from traverse.daemon.command_handlers import handles
from traverse.daemon.config.schema import Configuration
from traverse.daemon.errors import RequestRefusedError, Result
from traverse.daemon.inputs import Inputs, StartupError, read_inputs
from traverse.daemon.measurement import Measurement
from traverse.daemon.monitoring.events import EventLog
from traverse.daemon.pose.arm_model import model_with_probe
from traverse.daemon.system.systemd import Notifier
from traverse.protocol.messages import ReloadArgs

QUIET_S = 5.0
LOOK_S = 0.01


@dataclass(eq=False, kw_only=True)
class ConfigurationReloader:
    """Reads the inputs again and puts them into force.

    Args:
        embedded: the daemon has its own broker.
        measurement: must be idle for a change.
        use: puts new inputs into force.
    """

    path: Path
    embedded: bool
    inputs: Inputs
    measurement: Measurement
    use: Callable[[Inputs], None]
    events: EventLog
    notifier: Notifier

    def __post_init__(self) -> None:
        self._turn = asyncio.Lock()

    @handles(ReloadArgs)
    async def carry_out(self, args: ReloadArgs) -> Result:
        """Reload; return the new model and the changes.

        Raises:
            RequestRefusedError: the files are wrong; the old ones stay in force.
        """
        del args  # it has none
        async with self._turn:
            self.notifier.reloading()
            try:
                changed = await self._reload()
            except RequestRefusedError as error:
                self.events.report("error", error.code, str(error), remedy=error.remedy)
                raise
            finally:
                self.notifier.ready()  # with the new one or with the old one
        model = self.inputs.model
        self.events.report(
            "info",
            "reload.done",
            f"changed: {', '.join(changed) or 'nothing'}; model {model.digest[:12]}",
            distinct=True,
        )
        return {"model": model.digest, "changed": changed}

    async def on_sighup(self) -> None:
        """Reload on SIGHUP; a failure is reported by an event."""
        try:
            await self.carry_out(ReloadArgs())
        except RequestRefusedError:
            return

    async def _reload(self) -> list[str]:
        try:
            new = await asyncio.to_thread(read_inputs, self.path, self.embedded)
        except StartupError as error:
            text = "; ".join(file.line for file in error.files) or str(error)
            raise RequestRefusedError(
                "reload.refused", text, "correct the files and reload again"
            ) from error
        old = self.inputs
        fixed = restart_required(old, new)
        fixed += [
            text
            for device in self.measurement.devices.values()
            if device.identity is not None
            for text in new.model.mismatches_with(device.section.id, device.identity)
        ]
        if fixed:
            raise RequestRefusedError(
                "reload.refused",
                f"a running daemon cannot change this: {'; '.join(fixed)}",
                "start the daemon anew, or take these changes back",
            )
        await self._quiet()
        new = self._with_probe(new)
        changed = changed_tables(old.configuration, new.configuration)
        used = self.measurement.model.digest, self.measurement.probe
        if used != (new.model.digest, new.probe):
            changed.insert(0, "arm")
        self.use(new)  # no `await` since it became quiet: nothing can intervene
        self.inputs = new
        return changed

    def _with_probe(self, new: Inputs) -> Inputs:
        """Return inputs with the probe in use, as the library has it now.

        Raises:
            RequestRefusedError: the arm cannot have it.
        """
        probe = self.measurement.probe
        if probe is None:
            return new._replace(probe=None)
        if new.probe is not None and new.probe.name == probe.name:
            probe = new.probe
        try:
            model = model_with_probe(new.model, probe)
        except ValueError as error:
            raise RequestRefusedError(
                "reload.refused",
                f"the arm cannot have the probe that is in use: {error}",
                "correct the arm file, or change the probe first",
            ) from error
        return new._replace(model=model, probe=probe)

    async def _quiet(self) -> None:
        try:
            async with asyncio.timeout(QUIET_S):
                while not self.measurement.is_idle:  # noqa: ASYNC110 - a state, no event
                    await asyncio.sleep(LOOK_S)
        except TimeoutError as error:
            raise RequestRefusedError(
                "reload.busy",
                f"points were being taken, or buttons held, for {QUIET_S:g} s",
                "release the buttons, then reload again",
            ) from error


_FIXED = ["broker", "device", "assembly", "metrics", "realtime", "recording", "signing"]


def restart_required(old: Inputs, new: Inputs) -> list[str]:
    before, after = old.configuration, new.configuration
    sections = [
        f"[{name}]" for name in _FIXED if getattr(before, name) != getattr(after, name)
    ]
    if before.capture.max_waiting_points != after.capture.max_waiting_points:
        sections.append("max_waiting_points of [capture]")
    if before.arm.probes != after.arm.probes:
        sections.append("probes of [arm]")
    if old.model.name != new.model.name:
        sections.append(f"the arm's name, {old.model.name} to {new.model.name}")
    elif not new.model.has_same_encoders(old.model):
        sections.append("which encoders read the joints")
    return sections


def changed_tables(old: Configuration, new: Configuration) -> list[str]:
    return [
        name
        for name in type(new).model_fields
        if name != "arm" and getattr(old, name) != getattr(new, name)
    ]
