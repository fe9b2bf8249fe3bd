"""Certificates that end soon: read from files, warned of once a day."""

import ssl
from datetime import UTC, datetime, timedelta

import pytest

from tests.certificates import Authority
from tests.running import run_program
from traverse.broker.certificates import OF_BROKER, CertificateWatch, ends_of_pem


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
    now = datetime(2026, 11, 28, 12, 0, tzinfo=UTC)
    end = now + timedelta(days=15)
    ends = {"certificate_file arm.crt": end, OF_BROKER: now + timedelta(days=400)}
    warnings = []
    watch = CertificateWatch(warnings.append, lambda: now)
    for _ in range(16):
        watch.check(ends)
        watch.check(ends)
        now += timedelta(days=1)
    watch.check({})
    assert len(warnings) == 15
    assert str(warnings[0]) == (
        "certificate_file arm.crt ends on 2026-12-13 12:00 UTC; after that the broker "
        "is not connected to again once the connection is lost; renew certificate_file "
        "arm.crt; it is used from the next connection on, by the daemon at once after "
        "`systemctl reload`"
    )
    assert "has ended on" in warnings[-1].text
