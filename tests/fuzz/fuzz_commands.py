"""Commands as anybody may send them: refused with a message, or understood."""

import contextlib
from pathlib import Path

from traverse.daemon.commands.dispatcher import MAX_COMMAND_BYTES
from traverse.protocol.encoding import decode, encode, parse_args
from traverse.protocol.message_error import MessageError
from traverse.protocol.messages import COMMANDS, Command
from traverse.protocol.topics import parse_topic

GOLDEN = Path(__file__).parent.parent / "protocol" / "golden"
NAMES = sorted(COMMANDS)


def _seeds() -> tuple[bytes, ...]:
    seeds = []
    for number, name in enumerate(NAMES):
        head = bytes((number,))
        seeds.append(head + (GOLDEN / f"command-{name}.json").read_bytes())
        text = (GOLDEN / f"command-{name}.msgpack.hex").read_text("utf-8")
        seeds.append(head + bytes.fromhex(text))
    seeds.append(b"\x00traverse/arm/command/point")
    return tuple(seeds)


SEEDS = _seeds()


def check(data: bytes) -> None:
    """The first byte chooses the command, the rest is its payload and a topic."""
    name = NAMES[data[0] % len(NAMES)] if data else NAMES[0]
    payload = data[1:]
    with contextlib.suppress(MessageError):
        topic = parse_topic(payload.decode("utf-8", "replace"))
        assert topic.arm
    try:
        command = decode(Command, payload, max_bytes=MAX_COMMAND_BYTES)
        parse_args(name, command.args)
    except MessageError:
        return
    repeated = decode(
        Command, encode(command, "json"), max_bytes=10 * MAX_COMMAND_BYTES
    )
    assert repeated.request == command.request
