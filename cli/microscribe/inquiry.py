"""Read from a MicroScribe what an arm file needs."""

import os
import re
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from traverse.cli.microscribe.arm_values import MicroscribeDescription
from traverse.drivers.io.serial_port import SerialPort
from traverse.drivers.microscribe.line import MicroscribeLine
from traverse.drivers.microscribe.session import (
    BAUD_RATES,
    MicroscribeIdentification,
    read_identification,
    sign_on_at_any_rate,
)
from traverse.protocol.microscribe.session import DH_FORMAT, kinematics_of
from traverse.strict_toml.problems import FileError, Problem


def query_microscribe(
    port: str, baud_rate: int | None, name: str | None
) -> tuple[MicroscribeIdentification, MicroscribeDescription]:
    """The properties that an arm reports, with its geometry.

    Without a baud rate all are tried; without a name it has the reported one.

    Raises:
        DeviceError: no MicroScribe answers.
        FileError: its geometry is not one that can be read.
    """
    rates = BAUD_RATES if baud_rate is None else (baud_rate,)
    with _session(port, rates) as (line, arm):
        said, comment = line.text("format"), line.text("comment")
        if said != DH_FORMAT:
            what = f"the arm keeps its geometry as {said!r}, expected {DH_FORMAT!r}; "
            what += "make the arm file with `traverse arm from-dh`"
            raise FileError(port, [Problem("format", what)])
        try:
            kinematics = kinematics_of(line.kinematics(), comment)
        except ValueError as error:
            what = f"{error}; make the arm file with `traverse arm from-dh`"
            raise FileError(port, [Problem("geometry", what)]) from error
        home = (*line.home(), *[0] * len(arm.maxes.encoders))
    maxes = arm.maxes.encoders
    return arm, MicroscribeDescription(
        name or topic_name(arm.name), port, kinematics, maxes, home
    )


def topic_name(text: str) -> str:
    """A text as a name of an arm, which is a part of its topics."""
    return re.sub(r"[^a-z0-9]+", "-", text.lower()).strip("-") or "microscribe"


@contextmanager
def _session(
    port: str, rates: Sequence[int]
) -> Iterator[tuple[MicroscribeLine, MicroscribeIdentification]]:
    """A session with the arm; ends with the block."""
    wake_read, wake_write = os.pipe2(os.O_NONBLOCK)

    def open_line(rate: int) -> MicroscribeLine:
        serial_port = SerialPort(port, rate, wake_read)
        return MicroscribeLine(serial_port, rate, time.monotonic_ns, lambda: False)

    try:
        line, box = sign_on_at_any_rate(open_line, rates)
        with line:
            try:
                yield line, read_identification(line, box)
            finally:
                line.end()
    finally:
        os.close(wake_read)
        os.close(wake_write)
