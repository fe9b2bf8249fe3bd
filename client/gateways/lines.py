"""Points and scans as lines of text, for programs that take text."""

import asyncio
import contextlib
from dataclasses import dataclass

from traverse.client.arm import Arm
from traverse.client.cancel_tasks import run_together
from traverse.client.exports.line_template import LineTemplate
from traverse.client.exports.point_table import Coordinates, block_table
from traverse.client.exports.text import SPECIMEN, scan_values, values_of
from traverse.client.gateways.outlets import NotTakenError, Outlet, Report
from traverse.client.points.doubts import SentPoints
from traverse.client.points.session_order import Lost
from traverse.plurals import counted
from traverse.protocol.messages import Point, Scan

TEMPLATES = {
    "pcdmis": r"{x:.4f},{y:.4f},{z:.4f}\r\n",
    "linuxcnc": r"{x:.6f} {y:.6f} {z:.6f} 0 0 0 0 0 0\n",
    "mtconnect": r"{time_utc}|point_id|{id}|point|{x:.4f} {y:.4f} {z:.4f}\n",
    "spreadsheet": r"{seq}\t{x:.4f}\t{y:.4f}\t{z:.4f}\t{artefact}\t{flags}\r\n",
}
"""PC-DMIS: a line of a machine of type "Generic CMM"; LinuxCNC: a line of a probe log,
X Y Z A B C U V W; MTConnect: SHDR of an adapter; a spreadsheet: columns with tabs, the
flags of doubt last."""
LOOK_S = 0.5  # how often the arm's state is looked at
UNITS_MM = {"mm": 1.0, "inch": 25.4}


class LineForm:
    """Form of lines, from texts of the user.

    Args:
        undo: of a retraction's line, or None.
        coordinates: of x, y and z.
        unit: their unit, of `UNITS_MM`.
        sends_doubtful: a point in doubt is sent, even if its line does not say so.

    Raises:
        ValueError: a template is refused.
    """

    def __init__(
        self,
        template: str,
        undo: str | None,
        coordinates: Coordinates,
        unit: str,
        decimal: str,
        *,
        sends_doubtful: bool,
    ) -> None:
        chosen = TEMPLATES.get(template, template)
        self.template = LineTemplate(chosen, SPECIMEN, decimal)
        self.undo = None if undo is None else LineTemplate(undo, SPECIMEN, decimal)
        self.coordinates: Coordinates = coordinates
        self.unit_mm = UNITS_MM[unit]
        says_doubt = bool({"ok", "flags"} & self.template.names)
        self.passes_doubtful = sends_doubtful or says_doubt


@dataclass(slots=True)
class LineCounts:
    """Counts of points by outcome."""

    sent: int = 0
    held_back: int = 0
    undone: int = 0
    doubted: int = 0
    lost: int = 0


class LineGateway:
    """Sends an arm's points, or its scans, to one outlet.

    Args:
        outlet: takes them; open while this sends.
        report: called with messages for people.
    """

    def __init__(self, form: LineForm, outlet: Outlet, report: Report) -> None:
        self._form = form
        self.outlet = outlet
        self._report = report
        self._sent = SentPoints()
        self._turn = asyncio.Lock()  # of the outlet
        self.counts = LineCounts()

    async def send_points(self, arm: Arm) -> None:
        """Send points until the arm's client is closed."""
        await run_together(
            *(self._send_each(arm), self._send_doubts(arm), self._follow_state(arm))
        )

    async def _follow_state(self, arm: Arm) -> None:
        """Report when the arm goes and comes: without points lines look all right."""
        reported = ""
        while True:
            with contextlib.suppress(TimeoutError):  # an arm that was never there
                status = await arm.status()
                absence = arm.absence or ("" if status.online else "it is offline")
                if absence != reported:
                    state = f"{absence}; no line comes" if absence else "it is there"
                    self._report(f"{arm.name}: {state}")
                    reported = absence
            await asyncio.sleep(LOOK_S)

    async def _send_each(self, arm: Arm) -> None:
        """Request the next point when the last one is sent: `Arm` keeps the place."""
        async for item in arm.points_and_losses():
            if isinstance(item, Lost):
                self.counts.lost += (item.to_seq or item.from_seq) - item.from_seq + 1
                self._report(str(item))
            elif (line := self._line(item)) is not None:
                try:
                    async with self._turn:
                        await self.outlet.send(line.encode())
                except NotTakenError as error:
                    self._held_back(1, f"point {item.seq}: {error}")
                else:
                    self._note_sent(item)

    async def _send_doubts(self, arm: Arm) -> None:
        form = self._form
        async for doubt in arm.doubts():
            for point in self._sent.doubt(doubt):
                flags = ", ".join(point.quality.flags)
                self._report(
                    f"point {point.seq} is in doubt since it was sent ({flags})"
                )
                if form.undo is not None and not form.passes_doubtful:
                    undone = point.model_copy(update={"retracts": point.id})
                    values = values_of(undone, form.coordinates, form.unit_mm)
                    with contextlib.suppress(NotTakenError):  # as it was reported
                        async with self._turn:
                            await self.outlet.send(form.undo.filled(values).encode())
                self.counts.doubted += 1

    async def send_scans(self, arm: Arm) -> None:
        """Send scans until the arm's client is closed."""
        await run_together(self._send_blocks(arm), self._follow_state(arm))

    async def _send_blocks(self, arm: Arm) -> None:
        scan, next_seq = "", 0
        async for block in await arm.scans():
            n_lost = block.seq - next_seq if block.scan == scan else 0
            scan, next_seq = block.scan, block.seq + len(block.dtime_ns)
            if n_lost > 0:
                self.counts.lost += n_lost
                self._report(f"scan {scan}: {counted(n_lost, 'point')} lost")
            if lines := self._scan_lines(block):
                await self.outlet.send("".join(lines).encode())
                self.counts.sent += len(lines)

    def _line(self, point: Point) -> str | None:
        """Return the line of a point; None, with a report, if none is sent."""
        form, template = self._form, self._form.template
        if point.retracts is not None:
            if point.retracts not in self._sent.by_id:
                self._report(f"{point.retracts} was taken back; it was not sent by now")
                return None
            if form.undo is None:
                self.counts.undone += 1
                self._report(f"{point.retracts} was taken back after it was sent")
                return None
            template = form.undo
        elif not (point.quality.ok or form.passes_doubtful):
            doubt = ", ".join(point.quality.flags)
            self._held_back(1, f"point {point.seq} is in doubt ({doubt})")
            return None
        try:
            return template.filled(values_of(point, form.coordinates, form.unit_mm))
        except ValueError as error:  # it has no such coordinates
            self._held_back(1, str(error))
            return None

    def _note_sent(self, point: Point) -> None:
        self.counts.sent += 1
        if point.retracts is None:
            self._sent.add(point)
        else:
            self.counts.undone += 1

    def _scan_lines(self, block: Scan) -> list[str]:
        form, n = self._form, len(block.dtime_ns)
        table = block_table(block, form.coordinates)
        if table is None:
            self._held_back(n, f"scan {block.scan} was made without an alignment")
            return []
        rows = [
            values
            for values in scan_values(table, form.unit_mm)
            if values["ok"] or form.passes_doubtful
        ]
        if len(rows) < n:
            self._held_back(n - len(rows), f"scan {block.scan} is in doubt there")
        return [form.template.filled(values) for values in rows]

    def _held_back(self, n: int, why: str) -> None:
        self.counts.held_back += n
        self._report(f"{counted(n, 'point')} not sent: {why}")
