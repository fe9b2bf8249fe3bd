"""The daemon as a program: read the inputs, run the service, return the exit status."""

import contextlib
import logging
from pathlib import Path

from traverse.daemon.config.schema import BrokerSection
from traverse.daemon.inputs import REFUSED, UNREACHABLE, StartupError, read_inputs
from traverse.daemon.lifecycle import run
from traverse.daemon.mqtt.embedded_broker import HOST, BrokerStartError, embedded_broker
from traverse.daemon.service import Service
from traverse.daemon.store.records import DatabaseRefusedError, StateFolderError
from traverse.daemon.system.memory import limit_malloc_arenas

log = logging.getLogger(__name__)


async def run_service(
    path: Path, *, embedded: bool, embedded_port: int = 1883, keep_trying: bool = False
) -> int:
    """Run the daemon until SIGTERM or SIGINT; return the exit status.

    With ``embedded`` it starts a broker on loopback, at a free port for 0; with
    ``keep_trying`` it starts without unreachable devices or broker.
    """
    limit_malloc_arenas()
    try:
        inputs = read_inputs(path, embedded)
        async with contextlib.AsyncExitStack() as stack:
            section = inputs.configuration.broker or BrokerSection()
            if embedded:
                port = await stack.enter_async_context(embedded_broker(embedded_port))
                section = BrokerSection(host=HOST, port=port, encoding=section.encoding)
                log.info("embedded broker on %s:%d", HOST, port)
            service = Service(inputs, section, path, embedded=embedded)
            await run(service, keep_trying=keep_trying)
    except (BrokerStartError, DatabaseRefusedError) as error:
        may_mend = isinstance(error, BrokerStartError | StateFolderError)
        status = UNREACHABLE if may_mend else REFUSED
        log.error("%s", StartupError([str(error)], status))
        return status
    except StartupError as error:
        log.error("%s", error)
        return error.status
    return 0
