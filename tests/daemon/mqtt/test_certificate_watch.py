"""Certificates that end soon: read from files, warned of once a day."""

import ssl
from datetime import UTC, datetime, timedelta

import pytest

from tests.certificates import Authority
from tests.daemon.values import SetClock
from tests.running import run_program
from traverse.broker.certificates import ends_of_pem
from traverse.daemon.monitoring.events import EventLog
from traverse.daemon.mqtt.certificate_watch import REPEAT_NS, CertificateWatch


def stated_end(path):
    """When it ends, by openssl."""
    stated = run_program("openssl", "x509", "-enddate", "-noout", "-in", path).stdout
    end_s = ssl.cert_time_to_seconds(stated.strip().removeprefix("notAfter="))
    return datetime.fromtimestamp(end_s, UTC)


@pytest.mark.needs("openssl")
def test_the_ends_in_a_file_are_those_that_openssl_states(tmp_path):
    """The far one is written as a time with four digits of the year."""
    house = Authority(tmp_path)
    near, far = house.sign("near"), house.sign("far", days=20_000)
    files = [near.certificate, far.certificate, house.certificate]
    content = b"# a chain\n" + b"".join(file.read_bytes() for file in files)
    assert ends_of_pem(content) == [stated_end(file) for file in files]
    der = ssl.PEM_cert_to_DER_cert(near.certificate.read_text())
    for cut in range(0, len(der), 7):  # no part of one is taken for one, or raises
        assert ends_of_pem(ssl.DER_cert_to_PEM_cert(der[:cut]).encode()) == []
    assert ends_of_pem(b"\xff no certificate") == []


def test_a_certificate_is_warned_of_two_weeks_before_and_then_daily():
    clock, occurrences = SetClock(), []
    watch = CertificateWatch(EventLog(clock, occurrences.append), clock)
    now = datetime.fromtimestamp(clock.to_utc_ns(clock.monotonic_ns()) // 10**9, UTC)
    end = now + timedelta(days=15)
    ends = {
        "certificate_file": end,
        "the broker's certificate": now + timedelta(days=400),
    }
    for _ in range(16):
        watch.check(ends)
        watch.check(ends)
        clock.now_ns += REPEAT_NS
    watch.check({})
    assert len(occurrences) == 15
    first, last = occurrences[0], occurrences[-1]
    assert first.code == "broker.certificate"
    assert first.active is None
    assert (
        f"certificate_file of [broker] ends on {end:%Y-%m-%d %H:%M} UTC" in first.text
    )
    assert "renew certificate_file of [broker]; it is used after" in first.remedy
    assert "has ended on" in last.text
