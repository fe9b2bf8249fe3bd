import pytest
from hypothesis import given
from hypothesis import strategies as st

from traverse.protocol import topics
from traverse.protocol.message_error import MessageError
from traverse.protocol.topics import CHANNELS, Topic, parse_topic

levels = st.text(
    st.characters(exclude_categories=["Cs", "Cc"], exclude_characters="/+#"),
    min_size=1,
    max_size=64,
)

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
    assert topics.reply_filter("a") == "traverse/a/reply/+"
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
        "clock": (1, True),
        "cmd": (1, False),
        "reply": (1, False),
    }


@given(levels, st.sampled_from(sorted(CHANNELS)), levels)
def test_every_name_of_one_level_is_restored(arm, kind, name):
    named = kind in topics.NAMED
    topic = f"traverse/{arm}/{kind}" + (f"/{name}" if named else "")
    assert parse_topic(topic) == Topic(arm, kind, name if named else None)


@pytest.mark.parametrize("name", ["", "a/b", "+", "a#", "a\0", "a\nb", "a" * 65])
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


@pytest.mark.parametrize(
    "topic",
    [
        "traverse/a/reply/point",
        "traverse/a/reply/point/client-7/1",
        "answers/x",
        "answers/x/y",
        "lab/7/in",
    ],
)
def test_answers_may_go_below_reply_and_where_a_filter_says(topic):
    assert topics.is_response_topic(topic, "a", ("answers/#", "lab/+/in"))


@pytest.mark.parametrize(
    "topic",
    [
        "",
        "traverse",
        "traverse/a/reply",
        "traverse/a/reply/",
        "traverse/a/reply//x",
        "traverse/a/reply/1/2/3/4/5",
        "traverse/a/cmd/point",
        "traverse/a/point",
        "traverse/a/status",
        "traverse/b/reply/point",
        "traverse/b/cmd/point",
        "traverse/+/reply/point",
        "traverse/a/reply/#",
        "traverse/a/reply/x\ny",
        "$SYS/broker",
        "lab/7",
        "lab/7/in/deeper",
        "elsewhere/x",
        "answers/" + "x" * 256,
    ],
)
def test_answers_may_go_nowhere_else(topic):
    assert not topics.is_response_topic(topic, "a", ("answers/#", "lab/+/in"))


@pytest.mark.parametrize(
    "topic_filter",
    [
        "#",
        "+/x",
        "traverse/#",
        "traverse/+/cmd/x",
        "$SYS/#",
        "a",
        "a/#/b",
        "a/b+",
        "/x",
    ],
)
def test_filters_that_reach_topics_of_arms_are_refused(topic_filter):
    with pytest.raises(MessageError, match="filter"):
        topics.check_response_filter(topic_filter)


def test_other_filters_of_answers_are_good():
    for topic_filter in ("answers/#", "lab/+/in", "lab/answers"):
        topics.check_response_filter(topic_filter)
