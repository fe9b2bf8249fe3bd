"""Files of credentials: found, checked, never printed."""

import pickle

import pytest

from tests.certificates import Authority, openssl
from traverse.broker.address import BrokerAddress
from traverse.broker.credentials import (
    MAX_PASSWORD_BYTES,
    CredentialsError,
    read_credentials,
)
from traverse.daemon.config.schema import BrokerSection, broker_table_problems
from traverse.daemon.inputs import address_of

SECRET = "correct horse"


pytestmark = pytest.mark.needs("openssl")


@pytest.fixture(scope="module")
def certificates(tmp_path_factory):
    return Authority(tmp_path_factory.mktemp("certificates"))


@pytest.fixture(scope="module")
def arm(certificates):
    return certificates.sign("bench-7")


def address(folder, **options) -> BrokerAddress:
    return BrokerAddress(**{"host": "localhost", "folder": folder, **options})


def secret(folder, text=SECRET, mode=0o600):
    path = folder / "password"
    path.write_text(f"{text}\n")
    path.chmod(mode)
    return path


def test_the_password_is_read_and_shown_by_nothing(tmp_path):
    secret(tmp_path)
    access = read_credentials(address(tmp_path, username="a", password_file="password"))
    assert access.password == SECRET
    assert SECRET not in repr(access)
    assert access.warnings == ()


def test_a_credential_is_where_systemd_puts_it(tmp_path, monkeypatch):
    folder = tmp_path / "credentials"
    folder.mkdir()
    (folder / "broker.password").write_text(SECRET)
    given = address(tmp_path, username="a", password_file="credential:broker.password")
    with pytest.raises(CredentialsError, match=r"LoadCredential=broker\.password:FILE"):
        read_credentials(given)
    monkeypatch.setenv("CREDENTIALS_DIRECTORY", str(folder))
    access = read_credentials(given)
    assert (access.password, access.warnings) == (SECRET, ())


@pytest.mark.parametrize("name", ["", "..", "../x", "a/b", ".hidden", "a b"])
def test_a_credential_that_is_no_name_is_refused(tmp_path, monkeypatch, name):
    monkeypatch.setenv("CREDENTIALS_DIRECTORY", str(tmp_path))
    with pytest.raises(CredentialsError, match="no name of a credential"):
        read_credentials(
            address(tmp_path, username="a", password_file=f"credential:{name}")
        )


@pytest.mark.parametrize(
    ("content", "text"),
    [
        (b"", "holds 0 bytes"),
        (b" \n", "holds 0 bytes"),
        (b"x" * (MAX_PASSWORD_BYTES + 1), "holds 1025 bytes"),
        (SECRET.encode() + b"\xff", "no text in UTF-8"),
    ],
)
def test_a_password_that_is_none_is_refused_without_telling_it(tmp_path, content, text):
    (tmp_path / "password").write_bytes(content)
    with pytest.raises(CredentialsError, match=text) as caught:
        read_credentials(address(tmp_path, username="a", password_file="password"))
    assert caught.value.key == "password_file"
    assert SECRET.encode() not in pickle.dumps(caught.value.args)
    assert caught.value.__cause__ is None


def test_secrets_that_others_can_read_are_warned_of(tmp_path, arm, certificates):
    secret(tmp_path, mode=0o644)
    options = {"username": "a", "password_file": "password"}
    (text,) = read_credentials(address(tmp_path, **options)).warnings
    assert "mode 0644" in text
    assert "chmod 600" in text
    arm.key.chmod(0o640)
    options |= {
        "tls": True,
        "ca_file": str(certificates.certificate),
        "certificate_file": str(arm.certificate),
        "key_file": str(arm.key),
    }
    warnings = read_credentials(address(tmp_path, **options)).warnings
    assert [arm.key.name in text for text in warnings] == [False, True]
    arm.key.chmod(0o600)


def test_a_password_that_crosses_a_network_in_plain_text_is_warned_of(tmp_path):
    secret(tmp_path)
    far = address(tmp_path, host="b.example", username="a", password_file="password")
    (text,) = read_credentials(far).warnings
    assert "plain text" in text


def test_a_change_of_any_file_shows_in_the_digest(tmp_path):
    given = address(tmp_path, username="a", password_file="password")
    secret(tmp_path)
    before = read_credentials(given).digest
    assert read_credentials(given).digest == before
    secret(tmp_path, "another")
    assert read_credentials(given).digest != before


def test_files_that_are_no_certificates_are_named(tmp_path, certificates, arm):
    (tmp_path / "no.pem").write_text("nothing of the kind\n")
    other = certificates.sign("other")
    sealed = tmp_path / "sealed.key"
    openssl("pkey", "-in", arm.key, "-aes256", "-passout", "pass:x", "-out", sealed)
    ca, crt, key = str(certificates.certificate), str(arm.certificate), str(arm.key)
    for options, where, text in (
        ({"ca_file": "no.pem"}, "ca_file", "no certificate in PEM"),
        ({"ca_file": "gone.pem"}, "ca_file", "No such file"),
        (
            {"certificate_file": crt, "key_file": str(other.key)},
            "key_file",
            "is not the key of",
        ),
        (
            {"certificate_file": "no.pem", "key_file": key},
            "certificate_file",
            "no certificate and key",
        ),
        ({"certificate_file": crt, "key_file": str(sealed)}, "key_file", "encrypted"),
    ):
        section = BrokerSection(**{"tls": True, "ca_file": ca, **options})
        with pytest.raises(CredentialsError, match=text) as refused:
            read_credentials(address_of(section, tmp_path))
        assert refused.value.key == where


def test_with_tls_the_usual_port_is_another():
    assert BrokerSection().port == 1883
    assert BrokerSection(tls=True).port == 8883
    assert BrokerSection(tls=True, port=1884).port == 1884


@pytest.mark.parametrize(
    ("table", "where"),
    [
        ({"ca_file": "a"}, "broker.ca_file"),
        ({"tls": True, "certificate_file": "a"}, "broker.key_file"),
        ({"tls": True, "key_file": "a"}, "broker.certificate_file"),
        ({"password_file": "a"}, "broker.username"),
        ({"response_topics": ["traverse/#"]}, "broker.response_topics[0]"),
        ({"response_topics": ["answers/x", "#"]}, "broker.response_topics[1]"),
    ],
)
def test_keys_that_do_not_go_together_are_refused(table, where):
    assert [problem.where for problem in broker_table_problems(table)] == [where]


def test_keys_that_go_together_are_good():
    full = {
        "username": "a",
        "password_file": "p",
        "tls": True,
        "ca_file": "c",
        "certificate_file": "d",
        "key_file": "e",
        "response_topics": ["answers/+/x"],
    }
    assert list(broker_table_problems(full)) == []
