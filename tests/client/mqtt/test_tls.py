import re
import shlex
import uuid
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import pytest
from typer.testing import Result

from tests.certificates import Authority, Pair
from tests.client.reading import PATIENCE_S, read
from tests.client.virtual_daemon import VirtualDaemon
from tests.docs.pages import commands
from tests.end_to_end.programs import Program
from tests.mosquitto import HOST, Mosquitto, free_port
from tests.running import invoke
from traverse.broker.certificates import OF_BROKER
from traverse.client import Arm, BrokerAddress, BrokerUnreachableError
from traverse.client.display.follower import Follower, following
from traverse.client.mqtt.connection import CERTIFICATES_LOG
from traverse.client.mqtt.subscription import find_arms
from traverse.protocol.messages import Point
from traverse.testing.waiting import until

pytestmark = pytest.mark.needs("mosquitto", "openssl")

GUIDE = "docs/how-to/secure-the-broker.md"
SECRET = "Xy-not-to-be-shown-8"


@dataclass(frozen=True)
class House:
    """A broker that requires certificate and password over TLS.

    Attributes:
        broker: the same without TLS, for the arm.
        address: with all that opens the door.
        stranger: certificate of an unknown authority.
    """

    folder: Path
    broker: Mosquitto
    address: BrokerAddress
    stranger: Pair
    strange_authority: Path

    def daemon(self) -> VirtualDaemon:
        where = (f"arm-{uuid.uuid4().hex[:8]}", HOST, self.broker.port)
        return VirtualDaemon(*where, username="person", password=SECRET)

    def options(self, **files: Path) -> list[str]:
        """Options of commands that grant access; some files otherwise."""
        ours = {
            "password-file": self.address.password_file,
            "ca-file": self.address.ca_file,
            "client-certificate": self.address.certificate_file,
            "client-key": self.address.key_file,
            **{name.replace("_", "-"): file for name, file in files.items()},
        }
        file_options = [
            word for name, file in ours.items() for word in (f"--{name}", file)
        ]
        where = ("--broker", f"mqtts://{self.address}", "--username", "person")
        return [*where, *map(str, file_options)]


@pytest.fixture(scope="module")
def house(tmp_path_factory: pytest.TempPathFactory) -> Iterator[House]:
    folder = tmp_path_factory.mktemp("house")
    authority, stranger = Authority(folder, "house"), Authority(folder, "strange")
    pair, person = authority.sign("broker", "DNS:localhost"), authority.sign("person")
    port = free_port()
    lines = (
        f"listener {port} {HOST}",
        f"cafile {authority.certificate}",
        f"certfile {pair.certificate}",
        f"keyfile {pair.key}",
        "require_certificate true",
    )
    broker = Mosquitto(folder, {"person": SECRET}, lines)
    (folder / "password").write_text(SECRET + "\n")
    (folder / "wrong").write_text("a wrong guess")
    address = BrokerAddress(
        "localhost",
        port,
        "person",
        password_file=folder / "password",
        tls=True,
        ca_file=authority.certificate,
        certificate_file=person.certificate,
        key_file=person.key,
    )
    broker.start()
    yield House(
        folder,
        broker,
        address,
        stranger.sign("person", file="other"),
        stranger.certificate,
    )
    broker.stop()


async def reasons(address: BrokerAddress) -> tuple[str, str]:
    """Why arms cannot be looked for, and why one cannot be followed, at once."""
    with pytest.raises(BrokerUnreachableError) as of_finding:
        await find_arms(address, 0.1)
    with pytest.raises(BrokerUnreachableError) as of_arm:
        async with Arm("bench-7", address, connect_timeout_s=PATIENCE_S):
            pass
    assert SECRET not in str(of_arm.value)
    return str(of_finding.value), str(of_arm.value)


async def reason(address: BrokerAddress) -> str:
    """Why an arm cannot be followed; as looking for arms says."""
    of_finding, of_arm = await reasons(address)
    assert of_arm == of_finding
    return of_arm


async def test_points_and_commands_go_with_certificate_and_password(
    house: House, caplog: pytest.LogCaptureFixture
) -> None:
    async with (
        house.daemon().running() as daemon,
        Arm(daemon.arm, house.address) as arm,
    ):
        assert daemon.arm in await find_arms(house.address, 1.0)
        captured = await daemon.take(3)
        assert await read(arm, 3) == captured
        assert isinstance(await arm.capture(), Point)
    # All end in two days; to find arms warns of none.
    warnings = [r.getMessage() for r in caplog.records if r.name == CERTIFICATES_LOG]
    files = house.address.certificate_file, house.address.ca_file
    names = f"certificate_file {files[0]}", f"ca_file {files[1]}", OF_BROKER
    assert len(warnings) == len(names)
    for name, warning in zip(names, warnings, strict=True):
        assert warning.startswith(f"broker {house.address}: {name} ends on 20")


async def test_a_broker_of_another_authority_or_name_is_not_trusted(
    house: House,
) -> None:
    strange = replace(house.address, ca_file=house.strange_authority)
    assert "not signed by any of ca_file" in await reason(strange)
    unnamed = replace(house.address, ca_file=None)
    assert "any of the system's authorities" in await reason(unnamed)
    assert "is not for '127.0.0.1'" in await reason(replace(house.address, host=HOST))


async def test_a_wrong_password_or_none_is_reported_without_it(house: House) -> None:
    wrong = replace(house.address, password_file=house.folder / "wrong")
    assert "refuses user 'person' or the password" in await reason(wrong)
    nobody = replace(house.address, username=None, password_file=None)
    assert "no account for this client's certificate" in await reason(nobody)


async def test_a_certificate_that_is_not_there_or_not_known_is_reported(
    house: House,
) -> None:
    # If the broker disconnects before its reason is read, only that is reported:
    # one of two attempts may report more.
    bare = replace(house.address, certificate_file=None, key_file=None)
    assert all("certificate_file" in why for why in await reasons(bare))
    other = house.stranger
    strange = replace(
        house.address, certificate_file=other.certificate, key_file=other.key
    )
    assert all("certificate_file" in why for why in await reasons(strange))


async def test_files_that_cannot_be_used_are_named(house: House) -> None:
    missing = house.folder / "missing"
    for name in ("password_file", "ca_file", "certificate_file"):
        why = await reason(replace(house.address, **{name: missing}))
        assert f"{name}: {missing} cannot be read: " in why
    mixed = replace(house.address, key_file=house.stranger.key)
    assert f"{house.stranger.key} is not the key of" in await reason(mixed)


async def test_watch_prints_points_over_tls_as_the_guide_shows(
    house: House, tmp_path: Path
) -> None:
    (line,) = (
        command for command in commands(GUIDE) if command.startswith("traverse watch")
    )
    async with house.daemon().running() as daemon:
        ours = {
            "broker.lab": str(house.address),
            "bench-7-operator": "person",
            "authority.crt": str(house.address.ca_file),
            "operator.password": str(house.address.password_file),
            "--arm-name bench-7": f"--arm-name {daemon.arm}",
        }
        for shown, replacement in ours.items():
            assert shown in line
            line = line.replace(shown, replacement)
        words = shlex.split(line)[1:]
        # The guide's listener requires a password only; this one a certificate, too.
        words += house.options()[-4:]
        with Program(tmp_path, "watch", *words, "--json") as watching:
            await watching.says('"online":true')
            await daemon.take(2)
            await watching.says('"seq":1')


async def test_the_follower_of_page_and_display_sees_points_over_tls(
    house: House,
) -> None:
    async with house.daemon().running() as daemon:
        follower = Follower(daemon.arm, house.address)
        async with following(follower):
            await until(lambda: follower.sight.status is not None)
            await daemon.take(2)
            await until(lambda: len(follower.sight.points) == 2)


COMMANDS = (
    ("watch",),
    ("page",),
    ("record", "new", "--arm-name", "bench-7"),
    ("points", "resend", "--arm-name", "bench-7"),
)


def run(*words: str, status: int = 0) -> Result:
    return invoke(*words, status=status)


@pytest.mark.parametrize("command", COMMANDS, ids=lambda words: words[0])
def test_commands_say_why_they_are_not_let_in(
    command: tuple[str, ...], house: House
) -> None:
    wrong = run(
        *command, *house.options(password_file=house.folder / "wrong"), status=3
    )
    assert re.search("refuses user 'person' or the password", wrong.stderr)
    untrusted = run(*command, *house.options(ca_file=house.strange_authority), status=3)
    assert "not signed by any of ca_file" in untrusted.stderr


@pytest.mark.parametrize("command", COMMANDS, ids=lambda words: words[0])
def test_commands_refuse_files_that_cannot_be_used(
    command: tuple[str, ...], house: House
) -> None:
    missing = house.folder / "missing"
    refused = run(*command, *house.options(client_key=missing), status=2)
    assert f"key_file: {missing} cannot be read" in refused.stderr
    unencrypted = run(*command, "--ca-file", str(house.address.ca_file), status=2)
    assert "tls" in unencrypted.stderr
