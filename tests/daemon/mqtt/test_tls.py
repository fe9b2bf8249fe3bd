"""The publisher over TLS with a real mosquitto: accepted, or refused with reason."""

import asyncio
import ssl
from datetime import UTC, datetime, timedelta

import pytest

from tests.certificates import Authority
from tests.daemon.mqtt.connection_harness import Bench, Witness
from traverse.broker.address import BrokerAddress
from traverse.daemon.mqtt.outgoing_queue import OutgoingMessage
from traverse.testing.waiting import until

pytestmark = pytest.mark.needs("mosquitto", "openssl")


@pytest.fixture(scope="module")
def house(tmp_path_factory):
    return Authority(tmp_path_factory.mktemp("house"))


@pytest.fixture(scope="module")
def broker_pair(house):
    return house.sign("broker", "DNS:localhost,IP:127.0.0.1")


@pytest.fixture(scope="module")
def arm_pair(house):
    return house.sign("bench-7")


def tls_lines(house, pair, *more):
    return (
        f"cafile {house.certificate}",
        f"certfile {pair.certificate}",
        f"keyfile {pair.key}",
        *more,
    )


def address(broker, house, host="localhost", **options):
    files = {"ca_file": str(house.certificate)} if house else {}
    return BrokerAddress(host, broker.port, tls=True, **files, **options)


def of(pair):
    return {
        "certificate_file": str(pair.certificate),
        "key_file": str(pair.key),
    }


def witness(broker, house, topic):
    context = ssl.create_default_context(cafile=str(house.certificate))
    return Witness(broker.port, topic, tls_context=context)


async def reason(given: BrokerAddress) -> str:
    return await Bench(given).publisher.probe() or ""


@pytest.mark.parametrize("host", ["localhost", "127.0.0.1"])
async def test_points_go_over_an_encrypted_line(
    make_mosquitto, house, broker_pair, host
):
    broker = make_mosquitto(lines=tls_lines(house, broker_pair))
    async with (
        witness(broker, house, "traverse/bench-7/#") as seen,
        Bench(address(broker, house, host)).running() as bench,
    ):
        for k in range(100):
            bench.point(str(k))
        for k in range(5):  # more than a record, and than a socket takes at once
            blocks = bytes([k]) * 400_000
            bench.queue.offer("scan", OutgoingMessage("traverse/bench-7/scan", blocks))
        payloads = await seen.payloads(105)
        await bench.all_sent()
    points = [
        content for content in payloads if len(content) < 3
    ]  # QoS 0 may overtake QoS 1
    assert points == [str(k).encode() for k in range(100)]
    assert sorted(len(content) for content in payloads)[100:] == [400_000] * 5


async def test_many_commands_in_one_record_all_arrive(
    make_mosquitto, house, broker_pair
):
    broker = make_mosquitto(lines=tls_lines(house, broker_pair))
    async with (
        witness(broker, house, "none") as other,
        Bench(address(broker, house)).running() as bench,
    ):
        sending = (
            other.client.publish("traverse/bench-7/cmd/point", str(k).encode(), qos=1)
            for k in range(60)
        )
        await asyncio.gather(*sending)
        await until(lambda: len(bench.received) == 60, "60 commands")


async def test_a_client_certificate_opens_where_one_is_requested(
    make_mosquitto, house, broker_pair, arm_pair, tmp_path
):
    wanting = tls_lines(
        house, broker_pair, "require_certificate true", "use_identity_as_username true"
    )
    broker = make_mosquitto(lines=wanting)
    assert await reason(address(broker, house, **of(arm_pair))) == ""
    assert "requires a certificate of this arm" in await reason(address(broker, house))
    stranger = Authority(tmp_path, "stranger").sign("bench-7")
    text = await reason(address(broker, house, **of(stranger)))
    assert "does not trust this arm's certificate" in text
    old = house.sign("bench-7", days=0, file="old")
    text = await reason(address(broker, house, **of(old)))
    assert "this arm's certificate has expired" in text


async def test_a_broker_that_cannot_be_trusted_is_told_why(
    make_mosquitto, house, broker_pair, tmp_path
):
    broker = make_mosquitto(lines=tls_lines(house, broker_pair))
    stranger = Authority(tmp_path, "stranger")
    text = await reason(address(broker, stranger))
    assert "not signed by any of ca_file" in text
    assert "not signed by any of the system's" in await reason(address(broker, None))
    named = house.sign("named", "DNS:broker.example")
    other = make_mosquitto(lines=tls_lines(house, named))
    text = await reason(address(other, house))
    assert "certificate is not for 'localhost'" in text
    assert "not for '127.0.0.1'" in await reason(address(other, house, "127.0.0.1"))
    expired = house.sign("expired", "DNS:localhost", days=0)
    late = make_mosquitto(lines=tls_lines(house, expired))
    text = await reason(address(late, house))
    assert "certificate has expired" in text
    assert "renew the broker's certificate, or set the clock" in text


async def test_a_line_encrypted_on_one_side_only_is_reported(
    make_mosquitto, house, broker_pair
):
    plain = make_mosquitto()
    assert "does it speak TLS on this port?" in await reason(address(plain, house))
    broker = make_mosquitto(lines=tls_lines(house, broker_pair))
    text = await reason(BrokerAddress("localhost", broker.port))
    assert "does it require TLS?" in text


async def test_a_refused_password_is_reported_without_it(
    make_mosquitto, house, broker_pair, tmp_path
):
    password = tmp_path / "password"
    password.write_text("a wrong guess\n")
    password.chmod(0o600)
    broker = make_mosquitto({"arm": "right"}, lines=tls_lines(house, broker_pair))
    given = address(broker, house, username="arm", password_file=str(password))
    text = await reason(given)
    assert "it refuses user 'arm' or the password" in text
    assert "guess" not in text
    assert "guess" not in repr(given)
    password.write_text("right\n")
    assert await reason(given) == ""


async def test_certificates_can_be_renewed_while_it_runs(
    make_mosquitto, house, broker_pair, tmp_path
):
    pairs = [house.sign("bench-7", file=f"bench-7-{k}") for k in range(2)]
    mine = {name: tmp_path / name for name in ("arm.crt", "arm.key")}

    def install(pair):
        mine["arm.crt"].write_bytes(pair.certificate.read_bytes())
        mine["arm.key"].write_bytes(pair.key.read_bytes())
        mine["arm.key"].chmod(0o600)

    install(pairs[0])
    wanting = tls_lines(house, broker_pair, "require_certificate true")
    broker = make_mosquitto(lines=wanting)
    given = address(
        broker,
        house,
        folder=tmp_path,
        certificate_file="arm.crt",
        key_file="arm.key",
    )
    async with Bench(given).running() as bench:
        bench.publisher.renew()  # nothing has changed
        bench.point("0")
        await bench.all_sent()
        install(pairs[1])
        bench.publisher.renew()
        await until(lambda: len(bench.changes) == 2, "a second connection")
        bench.point("1")
        await bench.all_sent()
        assert bench.publisher.reconnects == 1
        ends = bench.publisher.certificate_ends
        files = f"certificate_file {tmp_path}/arm.crt", f"ca_file {house.certificate}"
        assert set(ends) == {*files, "the broker's certificate"}
        in_two_days = datetime.now(UTC) + timedelta(days=2)
        assert all(abs(end - in_two_days) < timedelta(hours=1) for end in ends.values())
        mine["arm.key"].write_text("rubbish")
        bench.publisher.renew()  # does not end what works
        bench.point("2")
        await bench.all_sent()
        assert [up for up, _ in bench.changes] == [True, True]
