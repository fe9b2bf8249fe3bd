"""Names of topics and what is refused as one."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from protocol import topics
from protocol.encoding import MessageError
from protocol.topics import CHANNELS, Topic, parse_topic
from tests.protocol.message_strategies import arms

PLAIN = {
    "status": topics.status_topic,
    "point": topics.point_topic,
    "scan": topics.scan_topic,
    "live": topics.live_topic,
    "event": topics.event_topic,
    "health": topics.health_topic,
}


@pytest.mark.parametrize("kind", PLAIN)
def test_topic_is_root_arm_and_kind(kind):
    assert PLAIN[kind]("bench-7") == f"traverse/bench-7/{kind}"
    assert parse_topic(f"traverse/bench-7/{kind}") == Topic("bench-7", kind)


def test_commands_and_replies_have_one_more_level():
    assert topics.command_topic("a", "scan") == "traverse/a/cmd/scan"
    assert topics.reply_topic("a", "scan") == "traverse/a/reply/scan"
    assert parse_topic("traverse/a/cmd/scan") == Topic("a", "cmd", "scan")
    assert parse_topic("traverse/a/reply/undo") == Topic("a", "reply", "undo")


def test_filters_subscribe_to_one_arm_or_to_all():
    assert topics.command_filter("a") == "traverse/a/cmd/+"
    assert topics.kind_filter("point") == "traverse/+/point"
    assert topics.kind_filter("cmd") == "traverse/+/cmd/+"
    with pytest.raises(MessageError, match="one of status, point"):
        topics.kind_filter("points")


def test_quality_of_service_and_retention_are_those_of_the_contract():
    assert {
        kind: (channel.qos, channel.retained) for kind, channel in CHANNELS.items()
    } == {
        "status": (1, True),
        "point": (1, False),
        "scan": (0, False),
        "live": (0, False),
        "event": (1, False),
        "health": (0, True),
        "cmd": (1, False),
        "reply": (1, False),
    }


@given(arms, st.sampled_from(sorted(CHANNELS)), arms)
def test_every_name_of_one_level_comes_back(arm, kind, name):
    named = kind in topics.NAMED
    topic = f"traverse/{arm}/{kind}" + (f"/{name}" if named else "")
    assert parse_topic(topic) == Topic(arm, kind, name if named else None)


@pytest.mark.parametrize("name", ["", "a/b", "+", "a#", "a\0", "a" * 65])
def test_names_that_are_no_single_level_are_refused(name):
    with pytest.raises(MessageError, match="arm name"):
        topics.point_topic(name)
    with pytest.raises(MessageError, match="command name"):
        topics.command_topic("a", name)


@pytest.mark.parametrize(
    "topic",
    [
        "",
        "traverse",
        "traverse/a",
        "traverse/a/points",
        "traverse//point",
        "traverse/a/point/more",
        "traverse/a/cmd",
        "traverse/a/cmd/",
        "traverse/a/cmd/scan/more",
        "traverse/+/point",
        "other/a/point",
        "/traverse/a/point",
    ],
)
def test_foreign_topics_are_refused(topic):
    with pytest.raises(MessageError):
        parse_topic(topic)


@given(st.text(max_size=60))
def test_arbitrary_text_is_a_topic_or_a_message_error(text):
    try:
        parsed = parse_topic(text)
    except MessageError:
        return
    assert text.startswith(f"traverse/{parsed.arm}/{parsed.kind}")
