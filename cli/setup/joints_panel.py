"""Finding each joint's encoder on the page, as `traverse joints` does."""

import asyncio
from functools import partial
from html import escape
from typing import TYPE_CHECKING

from nicegui import background_tasks, ui

from traverse.cli.common.refusals import RefusalError
from traverse.cli.joints.devices import TurningDevices, turning_devices
from traverse.cli.joints.search import JointSearch, encoder_sentence
from traverse.cli.setup.draft import Draft, keep_previous
from traverse.cli.setup.form import Say, button
from traverse.kinematics.arm_file.arm import read_arm, write_arm
from traverse.strict_toml.problems import FileError, system_reason

if TYPE_CHECKING:
    from traverse.drivers.turning import Track

ANGLE_DEG = 90.0
SHOW_S = 0.2
TURNED, LEAVE_OUT, END = "It is turned", "Leave it out", "End"


class JointsPanel:
    """Prompts for one joint after the other, and shows the channels' motions."""

    def __init__(self, draft: Draft, say: Say) -> None:
        self._draft = draft
        self._say = say
        # One at most: a second press of a button is not an answer to the next prompt.
        self._answers: asyncio.Queue[str] = asyncio.Queue()
        self._devices: TurningDevices | None = None
        self._search: JointSearch | None = None
        self._task: asyncio.Task[None] | None = None
        ui.label(
            "The configuration must be written, and the daemon not running. Each joint "
            "is turned alone, base outwards."
        ).classes("dim")
        with ui.element("div").classes("bar"):
            self._begin_button = button("Begin", self._begin)
            self._answer_buttons = [
                button(text, partial(self._answer, text))
                for text in (TURNED, LEAVE_OUT, END)
            ]
        self._prompt = ui.label("").classes("instruction").props('role="status"')
        self._outcomes = ui.html("", sanitize=False)
        self._table = ui.html("", sanitize=False)
        self._allow(is_turning=False)
        ui.timer(SHOW_S, self._show)
        ui.context.client.on_delete(self._cancel)

    def _begin(self) -> None:
        if self._task is None or self._task.done():
            self._task = background_tasks.create(self._run(), name="joints")

    def _cancel(self) -> None:
        if self._task is not None:
            self._task.cancel()

    def _answer(self, text: str) -> None:
        if self._answers.empty():
            self._answers.put_nowait(text)

    def _allow(self, *, is_turning: bool) -> None:
        for answer_button in self._answer_buttons:
            answer_button.set_enabled(is_turning)

    async def _run(self) -> None:
        self._begin_button.set_enabled(False)
        try:
            await self._converse()
        except RefusalError as error:
            self._say(f"{error}. Is the daemon still running?", is_bad=True)
        except FileError as error:
            self._say(str(error), is_bad=True)
        except OSError as error:
            self._say(system_reason(error), is_bad=True)
        finally:
            self._devices = None
            self._prompt.set_text("")
            self._allow(is_turning=False)
            self._begin_button.set_enabled(True)

    async def _converse(self) -> None:
        configuration = self._draft.configuration()
        arm_file = self._draft.path.parent / configuration.arm.file
        arm = read_arm(arm_file)
        outcomes: list[str] = []
        async with turning_devices(configuration.device) as devices:
            self._search = search = JointSearch(devices, arm, ANGLE_DEG)
            self._prompt.set_text("Let the arm rest, and wait for a moment ...")
            await search.rest()
            self._devices = devices
            for joint in arm.joints:
                answer, reason = "", ""
                while not answer or reason:
                    search.begin()
                    self._prompt.set_text(f"{reason}{search.prompt(joint)}")
                    self._allow(is_turning=True)
                    answer, reason = await self._answers.get(), ""
                    self._allow(is_turning=False)
                    if answer != TURNED:
                        break
                    outcome = await search.take(joint)
                    if isinstance(outcome, str):
                        reason = f"{joint.name}: {outcome}. Once more. "
                    else:
                        outcomes.append(encoder_sentence(joint, outcome))
                lines = "".join(f"<li>{escape(text)}</li>" for text in outcomes)
                self._outcomes.set_content(f"<ul>{lines}</ul>")
                if answer == END:
                    break
        with_encoders = search.arm_with_encoders()
        missing = ", ".join(search.missing)
        end = f" Not turned: {missing}." if missing else ""
        if with_encoders == arm:
            self._say(f"{arm_file} stays as it is.{end}")
            return
        previous = keep_previous(arm_file)
        write_arm(arm_file, with_encoders)
        self._say(f"{arm_file} is written; the file before is {previous.name}.{end}")

    def _show(self) -> None:
        devices, search = self._devices, self._search
        if devices is None or search is None:
            return
        rows = "".join(
            _row(track, search.noise_counts[track.source], devices.alarms)
            for track in devices.tracks
        )
        self._table.set_content(
            '<table class="plain"><tr><th class="text">channel</th><th>moved, counts'
            "</th><th>noise at rest, counts</th><th>invalid</th><th>weak</th>"
            f'<th class="text">alarm</th></tr>{rows}</table>'
        )


def _row(track: "Track", noise_counts: int, alarms: dict[str, str]) -> str:
    n = max(track.n_samples, 1)
    cells = (
        f"{track.moved_counts:+d}",
        str(noise_counts),
        f"{track.n_invalid / n:.0%}",
        f"{track.n_weak / n:.0%}",
    )
    numbers = "".join(f"<td>{cell}</td>" for cell in cells)
    alarm = escape(alarms.get(track.source, ""))
    has_doubt = track.n_invalid or track.n_weak or alarm
    return (
        f'<tr{" class=doubt" if has_doubt else ""}><td class="text">'
        f'{escape(track.source)}</td>{numbers}<td class="text">{alarm}</td></tr>'
    )
