"""Conversations of the specification, and more, with a session without sockets.

A file of `conversations` has, a line each: `>` what the client sends, `<` all that it
is answered, in order, `*` what happens at the arm:

    * live X Y Z [flags=a,b] [model=b] [radius=1.5]   a pose
    * point X Y Z [id=a] [flags=a,b] [out=0,0,1] [age=1]   a touch; the last one
      was taken before the latest pose
    * undo ID                    a point is taken back
    * doubt ID                   a point is in doubt since it was sent
    * probe NAME                 the arm has another probe
    * changed / refused          the answer to a requested change of the probe
    * offline / online           the arm goes, and is back
    * alarm CODE / calm          a lasting alarm, and its end
    * wait S                     time passes
    * press INPUT                a button
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.client.display.values import doubt
from tests.client.gateways.ippdme.transcripts import write
from tests.protocol.message_examples import LIVE, POINT, STATUS
from traverse.client.gateways.ippdme.grammar import IppError
from traverse.client.gateways.ippdme.options import Options
from traverse.client.gateways.ippdme.session import Session
from traverse.client.points.session_order import Lost
from traverse.protocol.messages.quality import Quality

assert STATUS.alarms
ALARM = STATUS.alarms[0]
FILES = sorted((Path(__file__).parent / "conversations").glob("*.txt"))


class Bench:
    """A session, and an arm that follows a file."""

    def __init__(self) -> None:
        self.now_s, self._n = 100.0, 0
        self.replies: list[str] = []
        self.reports: list[str] = []
        self.session = Session(
            Options(radii_mm={"star": 1.5}, keys={"base/1": "Done"}),
            self.replies.append,
            self.reports.append,
            lambda _: None,
            lambda: self.now_s,
        )
        self._time_ns = LIVE.time_ns
        self.status = STATUS.model_copy(
            update={"probe": None, "probes": ("ball", "star"), "alarms": ()}
        )
        self.happens("online")
        self.happens("live 0 0 0")

    def happens(self, line: str) -> None:
        happening, *rest = line.split()
        words = [word for word in rest if "=" not in word]
        options = dict(word.split("=") for word in rest if "=" in word)
        kinds: dict[str, Callable[..., None]] = {
            "live": self._live,
            "point": self._point,
            "undo": self._undo,
            "doubt": lambda point: self.session.take_doubt(doubt(points=point)),
            "probe": lambda name: self._say(probe=None if name == "-" else name),
            "changed": lambda: self.session.tool_changed("b"),
            "refused": lambda: self.session.tool_refused(IppError(1502)),
            "offline": lambda: self._say(online=False),
            "online": lambda: self._say(online=True),
            "alarm": lambda code: self._say(
                alarms=(ALARM.model_copy(update={"code": code}),)
            ),
            "calm": lambda: self._say(alarms=()),
            "wait": self._wait,
            "press": self.session.press,
            "lost": lambda: self.session.take_loss(Lost("s", 3, 5, "cut")),
        }
        kinds[happening](*words, **options)

    def _wait(self, seconds: str) -> None:
        self.now_s += float(seconds)

    def _say(self, **fields: Any) -> None:
        self.status = self.status.model_copy(update=fields)
        self.session.take_status(self.status)

    def _live(
        self, *xyz: str, flags: str = "", model: str = "a", radius: str = "3"
    ) -> None:
        self._time_ns += 50_000_000
        fields = {
            "xyz_mm": tuple(map(float, xyz)),
            "ijk": (0.0, 0.0, -1.0),
            "model": model,
            "time_ns": self._time_ns,
            "probe_radius_mm": float(radius),
            "quality": _quality(flags),
        }
        self.session.take_live(LIVE.model_copy(update=fields))

    def _point(
        self, *xyz: str, id: str = "", flags: str = "", out: str = "", age: str = "0"
    ) -> None:
        self._n += 1
        place = np.array(xyz, float)
        outwards = np.array((out or "0,0,0").split(","), float)
        fields = {
            "seq": self._n,
            "id": id or str(self._n),
            "retracts": None,
            "xyz_mm": tuple(place),
            "surface_mm": tuple(place - 3.0 * outwards) if out else None,
            "time_ns": self._time_ns + round((0.01 - float(age)) * 1e9),
            "probe_radius_mm": 3.0,
            "quality": _quality(flags),
        }
        self.session.take_point(POINT.model_copy(update=fields))

    def _undo(self, point_id: str) -> None:
        fields = {"id": f"-{point_id}", "retracts": point_id}
        self.session.take_point(POINT.model_copy(update=fields))


def _quality(flags: str) -> Quality:
    names = tuple(flags.split(",")) if flags else ()
    return Quality(ok=not names, flags=names)


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_a_conversation(file: Path) -> None:
    bench = Bench()
    expected: list[str] = []
    commands: list[str] = []
    for n, line in enumerate(file.read_text("ascii").splitlines(), 1):
        sign, text = line[:1], line[2:]
        if sign in (">", "*"):
            assert bench.replies == expected, f"before line {n} of {file.name}"
        if sign == ">":
            commands.append(text)
            bench.session.take_line(text.encode() + b"\r\n")
        elif sign == "*":
            bench.happens(text)
        elif sign == "<":
            expected.append(text)
    assert bench.replies == expected
    write(file.stem, commands, bench.replies)


def test_what_is_not_sent_is_said_to_people() -> None:
    bench = Bench()
    bench.happens("point 1 2 3")
    bench.session.take_line(b"00001 StartSession()\r\n")
    bench.happens("point 1 2 3")
    bench.session.take_line(b"00002 EnableUser()\r\n")
    bench.happens("point 1 2 3 flags=singular")
    assert bench.reports == [
        "point 1 not sent: there is no session",
        "point 2 not sent: the client has not enabled the user",
        "E0000 PtMeas: 1001 Illegal touch: point 3 is in doubt (singular)",
    ]


def test_a_connection_that_is_lost_ends_the_session_and_keeps_the_system() -> None:
    bench = Bench()
    for line in (
        "00001 StartSession()",
        "00002 SetCsyTransformation(PartCsy,1,2,3,0,0,0)",
        "00003 SetCoordSystem(PartCsy)",
        "E0004 OnMoveReportE(Time(1),X())",
        "00005 PtMeas(X(1))",
        "00006 Home()",
    ):
        bench.session.take_line(line.encode() + b"\r\n")
    bench.session.disconnected()
    bench.replies.clear()
    bench.happens("live 5 0 0")
    bench.happens("point 1 0 0")
    assert bench.replies == []
    bench.session.take_line(b"00001 StartSession()\r\n")
    bench.session.take_line(b"00002 GetCoordSystem()\r\n")
    assert bench.replies[-2:] == ["00002 # CoordSystem(PartCsy)", "00002 %"]


def test_more_commands_than_may_wait_are_refused() -> None:
    bench = Bench()
    for n in range(1, 1005):
        name = {1: "StartSession()", 2: "PtMeas(X(1))"}.get(n, "Home()")
        bench.session.take_line(f"{n:05d} {name}\r\n".encode())
    assert '01003 ! Error(2,0000,"Home","Buffer full")' in bench.replies
    assert sum(reply.endswith("%") for reply in bench.replies) == 1004
