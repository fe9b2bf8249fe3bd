"""Commands to an arm that measures: point, undo, scan, label, session, confirm ..."""

import asyncio
import json
import math
from collections.abc import Awaitable, Callable
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeVar

import typer

from traverse.cli.common.broker_options import BrokerOptions, only_arm
from traverse.cli.common.options import Json
from traverse.cli.common.refusals import client_errors, refuse

if TYPE_CHECKING:
    from traverse.client.arm import Arm
    from traverse.protocol.messages import Point
    from traverse.protocol.messages.scan import ScanMode

T = TypeVar("T")
FIND_S = 2.0
CONNECT_S = 3.0  # a user waits for it at a terminal

ArmName = Annotated[
    str | None, typer.Option("--arm-name", help="Name of the arm; else the only one.")
]


def point(
    *,
    arm: ArmName = None,
    samples: Annotated[int | None, typer.Option(min=1)] = None,
    seconds: Annotated[float | None, typer.Option(min=0.001)] = None,
    as_json: Json = False,
    broker: BrokerOptions,
) -> None:
    """Take a point now.

    Exit status 1: it was taken, and its quality is in doubt.

    Args:
        samples: Average so many samples.
        seconds: Average all samples of this time.
    """
    if samples is not None and seconds is not None:
        refuse("--samples or --seconds, not both")
    captured = send_command(
        arm, broker, lambda client: client.capture(samples, seconds)
    )
    _show_point(captured, as_json=as_json)
    raise typer.Exit(0 if captured.quality.ok else 1)


def undo(*, arm: ArmName = None, as_json: Json = False, broker: BrokerOptions) -> None:
    """Take the last point back."""
    _show_point(
        send_command(arm, broker, lambda client: client.undo()), as_json=as_json
    )


def scan(
    action: Literal["start", "stop"],
    *,
    arm: ArmName = None,
    rate_hz: Annotated[float | None, typer.Option(min=0.001)] = None,
    spacing_mm: Annotated[float | None, typer.Option(min=1e-6)] = None,
    as_json: Json = False,
    broker: BrokerOptions,
) -> None:
    """Start a scan, or stop the running one.

    Args:
        action: What to do.
        rate_hz: Points a second [Hz]; else as configured.
        spacing_mm: A point after each such distance [mm] instead.
    """
    if rate_hz is not None and spacing_mm is not None:
        refuse("--rate-hz or --spacing-mm, not both")
    if action == "stop":
        send_command(arm, broker, lambda client: client.stop_scan())
        _show({"scan": None}, "no scan is running", as_json=as_json)
    else:
        mode: ScanMode = "time" if spacing_mm is None else "distance"
        started = send_command(
            arm,
            broker,
            lambda client: client.start_scan(
                mode, rate_hz=rate_hz, spacing_mm=spacing_mm
            ),
        )
        _show(
            {"scan": started.scan}, f"scan {started.scan} is running", as_json=as_json
        )


def label(
    artefact: str | None = None,
    feature: str | None = None,
    *,
    arm: ArmName = None,
    as_json: Json = False,
    broker: BrokerOptions,
) -> None:
    """Set the label of the next points.

    Args:
        artefact: Touched artefact; without it the label ends.
        feature: Touched feature of it.
    """
    send_command(arm, broker, lambda client: client.label(artefact, feature))
    names = " ".join(filter(None, (artefact, feature)))
    text = f"label: {names}" if names else "points have no label"
    _show({"artefact": artefact, "feature": feature}, text, as_json=as_json)


def session(
    *,
    arm: ArmName = None,
    note: str | None = None,
    as_json: Json = False,
    broker: BrokerOptions,
) -> None:
    """Begin a new session: points are numbered from 0 again.

    Args:
        note: Text that is stored with the session.
    """
    name = send_command(arm, broker, lambda client: client.new_session(note))
    _show({"session": name}, name, as_json=as_json)


def use_probe(
    name: str,
    *,
    arm: ArmName = None,
    as_json: Json = False,
    broker: BrokerOptions,
) -> None:
    """Measure with another probe of the library.

    Args:
        name: Name in the arm's probe library.
    """
    model = send_command(arm, broker, lambda client: client.probe(name))
    text = f"probe {name}, model {model[:12]}"
    _show({"probe": name, "model": model}, text, as_json=as_json)


def reload(
    *, arm: ArmName = None, as_json: Json = False, broker: BrokerOptions
) -> None:
    """Have the daemon read arm file and configuration again."""
    model = send_command(arm, broker, lambda client: client.reload())
    _show({"model": model}, f"model {model[:12]}", as_json=as_json)


def confirm(
    *,
    arm: ArmName = None,
    at: str | None = None,
    tolerance_mm: Annotated[float, typer.Option(min=1e-6)] = 1.0,
    utc: Annotated[bool, typer.Option("--utc")] = False,
    as_json: Json = False,
    broker: BrokerOptions,
) -> None:
    """Accept the positions of the encoders after a loss of power.

    Before, bring the arm to its reference and touch a point that you know: only you can
    verify that the encoders still count from there. With --at the daemon compares.

    Args:
        at: x,y,z [mm] where the probe is now, refused if it is not.
        tolerance_mm: How far from there it may be [mm].
        utc: Accept the UTC of the daemon's computer as right, and no positions.
    """
    known_mm = None if at is None else _place(at)
    accepted = send_command(
        arm,
        broker,
        lambda client: client.confirm_reference(known_mm, tolerance_mm, utc=utc),
    )
    text = "\n".join(accepted) if accepted else "nothing was in doubt"
    _show({"confirmed": accepted}, text, as_json=as_json)


def home(
    joints: Annotated[list[str] | None, typer.Argument()] = None,
    *,
    arm: ArmName = None,
    as_json: Json = False,
    broker: BrokerOptions,
) -> None:
    """Set the counts of incremental encoders: the arm is in its home posture now.

    The posture is that of [home] in the arm file. Put the arm into it, hold it still,
    and call this; it is needed after each loss of power.

    Args:
        joints: Names of the joints that are there; all of [home] without.
    """
    homed = send_command(arm, broker, lambda client: client.home(joints or None))
    _show({"homed": homed}, f"homed: {', '.join(homed)}", as_json=as_json)


def send(
    command: str,
    values: Annotated[list[str] | None, typer.Argument(metavar="KEY=VALUE")] = None,
    *,
    arm: ArmName = None,
    as_json: Json = False,
    broker: BrokerOptions,
) -> None:
    """Send any command of the MQTT interface, and print its result.

    Args:
        command: Its name, such as covariance.
        values: Its arguments; each value is JSON, or else a text.
    """
    from traverse.protocol.encoding import parse_args
    from traverse.protocol.message_error import MessageError

    try:
        args = parse_args(command, dict(map(_argument, values or ())))
    except MessageError as error:
        refuse(str(error))
    result = dict(send_command(arm, broker, lambda client: client.execute(args)))
    lines = [f"{key}: {json.dumps(value)}" for key, value in result.items()]
    _show(result, "\n".join(lines) or "done", as_json=as_json)


def send_command(
    name: str | None, broker: BrokerOptions, act: Callable[["Arm"], Awaitable[T]]
) -> T:
    """Have an arm do something; ends the program where it does not."""
    from traverse.client.arm import Arm

    address = broker.address()
    arm = name or only_arm(address, FIND_S)

    async def run() -> T:
        async with Arm(arm, address, connect_timeout_s=CONNECT_S) as client:
            return await act(client)

    with client_errors():
        return asyncio.run(run())


def _argument(text: str) -> tuple[str, Any]:
    key, is_there, value = text.partition("=")
    if not is_there:
        refuse(f"{text}: expected KEY=VALUE, such as note=second")
    try:
        return key, json.loads(value)
    except ValueError:
        return key, value


def _place(text: str) -> tuple[float, float, float]:
    try:
        x_mm, y_mm, z_mm = (float(part) for part in text.split(","))
        if not math.isfinite(x_mm + y_mm + z_mm):
            raise ValueError
    except ValueError:
        refuse(f"--at {text}: expected x,y,z in mm, such as 120.5,-30,75")
    return x_mm, y_mm, z_mm


def _show_point(captured: "Point", *, as_json: bool) -> None:
    from traverse.cli.common.message_lines import line

    values = captured.model_dump(mode="json", by_alias=True)
    _show(values, line(captured.arm, captured), as_json=as_json)


def _show(values: dict[str, Any], text: str, *, as_json: bool) -> None:
    typer.echo(json.dumps(values) if as_json else text)
