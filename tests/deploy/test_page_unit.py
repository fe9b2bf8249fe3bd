"""The page as its unit starts it: behind a token, and beyond this machine with TLS."""

import contextlib
import http.client
import re
import signal
import ssl
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.deploy.places import DEPLOY, output_of, program
from tests.deploy.test_mosquitto_configuration import listens
from tests.end_to_end.programs import Program
from tests.mosquitto import HOST, Mosquitto, free_port
from traverse.testing.waiting import until

UNIT = DEPLOY / "systemd/traverse-page@.service"
ENVIRONMENT = DEPLOY / "systemd/environment"
ARM, TOKEN, PASSWORD = "bench-7", "a-token-of-some-length", "battery-staple"

pytestmark = pytest.mark.needs("mosquitto", "openssl")


def started(folder: Path, options: str) -> Program:
    (line,) = re.findall(r"^ExecStart=/usr/bin/traverse (.*)$", UNIT.read_text(), re.M)
    line = line.replace("%i", ARM).replace("$TRAVERSE_PAGE_OPTIONS", options)
    with pytest.MonkeyPatch.context() as environment:
        # NiceGUI behaves otherwise where it believes to be tested by its own means.
        environment.delenv("PYTEST_CURRENT_TEST", raising=False)
        return Program(folder, "page", *line.split())


@pytest.fixture
def credentials(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder as LoadCredential= makes it, with a token."""
    folder = tmp_path / "credentials"
    folder.mkdir()
    (folder / "page.token").write_text(f"{TOKEN}\n")
    (folder / "page.token").chmod(0o400)
    for name in re.findall(r"^SetCredential=(.*):\\n$", UNIT.read_text(), re.M):
        (folder / name).write_text("\n")
    monkeypatch.setenv("CREDENTIALS_DIRECTORY", str(folder))
    return folder


@pytest.fixture
def broker(tmp_path: Path) -> Iterator[Mosquitto]:
    mosquitto = Mosquitto(tmp_path, {f"{ARM}-operator": PASSWORD})
    mosquitto.start()
    yield mosquitto
    mosquitto.stop()


async def visited(connection: http.client.HTTPConnection) -> str:
    """Request the page, log in, load it; return the cookie."""
    with contextlib.closing(connection):

        def status_of(method: str, path: str, body: str = "", **headers: str) -> int:
            connection.request(method, path, body, headers)
            nonlocal text, cookie
            with connection.getresponse() as answer:
                text = answer.read().decode()
                cookie = answer.getheader("set-cookie", "")
                return answer.status

        text = cookie = ""
        await until(lambda: listens(connection.port), "the page listens")
        assert status_of("GET", "/") == 303
        assert status_of("POST", "/login", "token=something-else-here") == 401
        assert status_of("POST", "/login", f"token={TOKEN}") == 303
        flags = cookie
        assert status_of("GET", "/", cookie=cookie.partition(";")[0]) == 200
        assert ARM in text
        return flags


async def test_the_unit_asks_for_its_token_on_this_machine(
    credentials: Path, broker: Mosquitto, tmp_path: Path
) -> None:
    port = free_port()
    options = f"--port={port} --broker={HOST}:{broker.port}"
    with started(tmp_path, options) as server:
        await server.says(f"{ARM} on {HOST}:{broker.port}: http://127.0.0.1:{port}")
        assert "Secure" not in await visited(http.client.HTTPConnection(HOST, port))
        assert await server.stop() in {0, -signal.SIGTERM}
    assert TOKEN not in server.output + server.log


async def test_the_example_of_the_environment_is_for_other_computers(
    credentials: Path, broker: Mosquitto, tmp_path: Path
) -> None:
    openssl = program("openssl")
    output_of(
        *(openssl, "req", "-x509", "-newkey", "ec", "-nodes", "-days", "1"),
        *("-pkeyopt", "ec_paramgen_curve:prime256v1", "-subj", "/CN=localhost"),
        *("-keyout", credentials / "page.key", "-out", credentials / "page.pem"),
    )
    (credentials / "page.password").write_text(f"{PASSWORD}\n")
    (line,) = re.findall(
        r"^#TRAVERSE_PAGE_OPTIONS=(.*)$", ENVIRONMENT.read_text(), re.M
    )
    port = free_port()
    options = f"{line} --port={port} --broker={HOST}:{broker.port}"
    with started(tmp_path, options) as server:
        await server.says(f"https://0.0.0.0:{port}")
        context = ssl.create_default_context(cafile=str(credentials / "page.pem"))
        connection = http.client.HTTPSConnection("localhost", port, context=context)
        assert "Secure" in await visited(connection)
        assert await server.stop() in {0, -signal.SIGTERM}
    assert "not authorised" not in server.log + server.output


@pytest.mark.parametrize(
    ("options", "refusal"),
    [
        ("--host=0.0.0.0", "give --token-file, --certificate and --key"),
        (
            "--certificate=credential:page.pem --key=credential:page.key",
            "expected a certificate and its key without a passphrase, PEM",
        ),
        ("--username=a --password-file=credential:no/name", "is no name of a"),
    ],
)
async def test_what_is_refused_is_said_and_not_tried_again(
    credentials: Path, tmp_path: Path, options: str, refusal: str
) -> None:
    with started(tmp_path, options) as server:
        assert await server.ended() == 2
    assert refusal in re.sub(r"[\s│]+", " ", server.log)
    assert "Traceback" not in server.log
    assert "\nRestartPreventExitStatus=2\n" in UNIT.read_text()
