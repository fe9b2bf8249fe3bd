"""Requests, and the points expected from them: a model of `Capture`."""

from dataclasses import dataclass

from traverse.protocol.messages import Label

HOLD_MS = 650.5  # no sum of the times that pass below


@dataclass
class Asked:
    """One request.

    Attributes:
        what: "point", "press" (of the holder), "undo", "label", "session" or "probe".
        counts: of the latch.
        value: label, or number of the probe.
        held_ms: how long the holder was pressed; None while it is.
        token: of the edge; None for commands.
    """

    what: str
    counts: int = 0
    trigger: str = "command"
    value: object = None
    pressed_ns: int = 0
    held_ms: float | None = None
    token: int | None = None


def has_room(counts: int, *, is_undo: bool) -> bool:
    """Whether the queue takes a point, or its retraction: now and then it does not."""
    return counts % (11 if is_undo else 7) != 3


def expected_points(asked_for, attempts, keepings, sessions, failures):
    """Return the expected points, and their edges, of a list of requests.

    Args:
        asked_for: in order, as `Asked`.
        attempts: result of each undo; None: refused.
        keepings: of points, by their counts.
        sessions: ids, in order.
        failures: how often the disk has failed.
    """
    lines, session, seq, label, model = [], 0, 0, Label(), "probe-0"
    standing: list[tuple[str, str, int, Label, str]] = []
    attempts = iter(attempts)
    for asked in asked_for:
        what = asked.what
        if what == "press":
            what = "undo" if asked.held_ms >= HOLD_MS else "point"
        if what == "point" and has_room(asked.counts, is_undo=False):
            if keepings[asked.counts].trouble is not None:
                continue
            identifier = f"{sessions[session]}-{seq}"
            rest = (asked.trigger, asked.counts, label, model)
            lines.append(((session, seq, None, *rest), asked.token))
            standing.append((identifier, *rest))
            seq += 1
        elif what == "undo":
            attempt = next(attempts)
            if attempt is None:
                # With failures a point may be valid again that was not at the request.
                assert (
                    failures
                    or not standing
                    or not has_room(standing[-1][2], is_undo=True)
                )
            elif attempt.trouble is None:
                identifier, _, *rest = standing.pop()
                line = (session, seq, identifier, asked.trigger, *rest)
                lines.append((line, asked.token))
                seq += 1
        elif what == "label":
            label = asked.value
        elif what == "session":
            session, seq, label, standing = session + 1, 0, Label(), []
        elif what == "probe":
            model = f"probe-{asked.value}"
    return lines
