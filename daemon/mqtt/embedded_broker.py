"""Embedded broker on loopback, for demonstrations and first steps.

amqtt in a separate process, so that it cannot delay the measurement path; it ends when
its standard input closes, so it never outlives the daemon. MQTT 3.1.1 only, no
passwords, loopback only: not for production.
"""

import asyncio
import contextlib
import logging
import socket
import subprocess
import sys
from collections.abc import AsyncIterator
from importlib.util import find_spec
from typing import Any

from traverse.installation import missing

log = logging.getLogger(__name__)

HOST = "127.0.0.1"
START_S = 20.0


class BrokerStartError(Exception):
    """The embedded broker did not start."""


@contextlib.asynccontextmanager
async def embedded_broker(port: int) -> AsyncIterator[int]:
    """Run a broker on loopback, at a free port for 0; yield its port.

    Raises:
        BrokerStartError: the port is taken, or the extra `demo` is not installed.
    """
    if find_spec("amqtt") is None:
        raise BrokerStartError(missing("the embedded broker", "amqtt", "demo"))
    number = port or free_port()
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((HOST, number))
        except OSError as error:
            raise BrokerStartError(
                f"the embedded broker cannot listen on {HOST}:{number}: "
                f"{error.strerror}. Another broker may be there: use it, without "
                "--embedded-broker, or choose another with --embedded-port"
            ) from error
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-m", "traverse.daemon.mqtt.embedded_broker", str(number)),
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    complaints = None
    try:
        await _wait_until_ready(process, number)
        complaints = asyncio.create_task(_log_complaints(process))
        yield number
    finally:
        with contextlib.suppress(ProcessLookupError):
            process.terminate()
        if complaints is not None:
            await complaints
        await process.communicate()


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind((HOST, 0))
        return int(probe.getsockname()[1])


async def _wait_until_ready(process: asyncio.subprocess.Process, port: int) -> None:
    if process.stdout is None or process.stderr is None:
        raise BrokerStartError("the broker's process has no pipes")
    try:
        line = await asyncio.wait_for(process.stdout.readline(), START_S)
    except TimeoutError:
        line = b""
    if line.strip() != b"ready":
        with contextlib.suppress(ProcessLookupError):
            process.kill()
        errors = (await process.stderr.read()).decode(errors="replace").strip()
        last = errors.splitlines()[-1] if errors else "no answer"
        raise BrokerStartError(
            f"the embedded broker did not start on port {port}: {last}. Choose another "
            "port, or start one yourself"
        )


async def _log_complaints(process: asyncio.subprocess.Process) -> None:
    """Log the broker's output; on a full pipe the broker would stop."""
    while process.stderr is not None and (text := await process.stderr.read(4096)):
        log.warning("embedded broker: %s", text.decode(errors="replace").strip())


def _broker_class() -> type[Any]:
    """Return a broker of amqtt that sends retained messages to their subscribers alone.

    amqtt 0.12.1 sends each new connection the retained messages of all topics that
    anybody subscribes to.
    """
    from amqtt.broker import Broker  # noqa: PLC0415 - only in this process

    class RetainingBroker(Broker):  # type: ignore[misc]  # amqtt is not typed
        async def _publish_retained_messages_for_subscription(
            self, subscription: tuple[str, int], session: object
        ) -> None:
            subscribers = self.subscriptions.get(subscription[0], ())
            if any(subscriber is session for subscriber, _ in subscribers):
                await super()._publish_retained_messages_for_subscription(
                    subscription, session
                )

    return RetainingBroker


async def _serve(port: int) -> None:
    broker = _broker_class()(
        {
            "listeners": {"default": {"type": "tcp", "bind": f"{HOST}:{port}"}},
            "plugins": {
                "amqtt.plugins.authentication.AnonymousAuthPlugin": {
                    "allow_anonymous": True
                }
            },
        }
    )
    await broker.start()
    sys.stdout.write("ready\n")
    sys.stdout.flush()
    # Ends with its parent: then standard input is at its end.
    await asyncio.to_thread(sys.stdin.buffer.read)
    await broker.shutdown()


if __name__ == "__main__":
    logging.basicConfig(level=logging.ERROR, stream=sys.stderr)
    with contextlib.suppress(KeyboardInterrupt):
        asyncio.run(_serve(int(sys.argv[1])))
