"""Properties that are packed once are those that paho packs each time."""

import pytest

from traverse.daemon.mqtt.client import CachedProperties, publish_properties


@pytest.mark.parametrize("encoding", ["msgpack", "json"])
def test_usual_properties_are_packed_as_paho_packs_them(encoding):
    usual = CachedProperties(encoding)
    expected = publish_properties(encoding).pack()
    assert usual.pack() == usual.pack() == expected


def test_packed_properties_by_hand():
    length, content_type, name = "13", "03", b"application/msgpack"
    head = bytes.fromhex(f"16 {content_type} 00 {length}")
    assert CachedProperties("msgpack").pack() == head + name
