"""Tables of many worlds, and their verdict."""

from collections import Counter
from collections.abc import Iterable, Sequence

from benchmarks.trials.lines import Line, unbroken
from benchmarks.trials.program import Verdict
from traverse.protocol.messages import REMARKS
from traverse.protocol.messages.quality import flag_names

FAULTLESS = "none"
MOST_LIARS = 40
MOST_FLAGS = 8
REMARK_NAMES = frozenset(flag_names(REMARKS.value))


def verdict(lines: Sequence[Line]) -> Verdict:
    """Judge that there is neither a lie nor doubt without a fault."""
    sound = unbroken(lines)
    liars = [line for line in sound if _sum([line], "lies")]
    faultless = [line for line in sound if line["kinds"] == [FAULTLESS]]
    doubters = [line for line in faultless if _unexplained(line)]
    quick = [line for line in faultless if _by_motion(line)]
    # Where a device cannot be read at all, the operator was told at each request.
    silent = [
        line
        for line in sound
        if not _sum([line], "ok") + _sum([line], "doubt") and not line["refused"]
    ]
    n_lies, n_points = _sum(sound, "lies"), _sum(sound, "ok") + _sum(sound, "doubt")
    parts = [
        "\n".join(_table("family", _by(sound, "family"))),
        "\n".join(_table("kind of fault", _by(sound, "kinds"))),
    ]
    if doubters:
        flags: Counter[str] = Counter()
        for line in doubters:
            flags.update(line["flags"])
        parts.append(
            "doubt without a fault, by flags: "
            + ", ".join(f"{n} {flag}" for flag, n in flags.most_common(MOST_FLAGS))
        )
    for line in [*liars, *doubters][:MOST_LIARS]:
        example = line["examples"][0] if line in liars else "doubt without a fault"
        parts.append(
            f"world {line['world']}, {line['family']} ({', '.join(line['kinds'])}, "
            f"{line['pace']}): {_sum([line], 'lies')} lies, "
            f"{_unexplained(line)} in doubt; {example}\n"
            f"    python -m benchmarks.honesty --seed {line['world']} -v"
        )
    parts += [f"world {line['world']}: nothing was measured" for line in silent]
    unseen = [line for line in sound if line.get("unseen")]
    for line in unseen:
        by_rad, least_rad = line["jump_rad"]
        parts.append(
            f"world {line['world']}, {line['family']}: {_sum([line], 'unseen')} "
            f"numbers after a jump of {by_rad:.4f} rad; {least_rad:.4f} can be seen"
        )
    left = len(liars) + len(doubters) - MOST_LIARS
    if left > 0:
        parts.append(f"and {left} more worlds")
    parts.append(
        f"{len(sound)} worlds, {n_points} points, samples and live poses judged: "
        f"{n_lies} lies in {len(liars)} worlds; in {len(faultless)} worlds without a "
        f"fault {sum(map(_unexplained, faultless))} in doubt after the first 5 s, and "
        f"{sum(map(_by_motion, quick))} in {len(quick)} worlds where the arm moved "
        "faster than skew_limit_mm allows joints at different instants; "
        f"{_sum(unseen, 'unseen')} numbers in {len(unseen)} worlds are wrong by a jump "
        "that is too small to be seen"
    )
    return Verdict("\n\n".join(parts), not (liars or doubters or silent))


def _by_motion(line: Line) -> int:
    """Return how many numbers were in doubt after a while for their skew alone."""
    texts = line["flags"].items()
    return sum(n for text, n in texts if {*text.split(",")} - REMARK_NAMES == {"skew"})


def _unexplained(line: Line) -> int:
    return _sum([line], "settled_doubt") - _by_motion(line)


def _by(lines: Iterable[Line], key: str) -> dict[str, list[Line]]:
    groups: dict[str, list[Line]] = {}
    for line in lines:
        values = line[key] if isinstance(line[key], list) else [line[key]]
        for value in values:
            groups.setdefault(value, []).append(line)
    return dict(sorted(groups.items()))


def _table(title: str, groups: dict[str, list[Line]]) -> list[str]:
    head = f"{title:18}{'worlds':>8}{'points':>9}{'samples':>9}{'live':>9}"
    rows = [f"{head}{'ok %':>8}{'lies':>8}{'liars':>7}"]
    for name, lines in groups.items():
        ok, doubt = _sum(lines, "ok"), _sum(lines, "doubt")
        live = _sum(lines, "ok", "live") + _sum(lines, "doubt", "live")
        scans = _sum(lines, "ok", "scan") + _sum(lines, "doubt", "scan")
        n_liars = sum(1 for line in lines if _sum([line], "lies"))
        rows.append(
            f"{name:18}{len(lines):8}{ok + doubt - live - scans:9}{scans:9}{live:9}"
            f"{100.0 * ok / max(1, ok + doubt):8.1f}{_sum(lines, 'lies'):8}{n_liars:7}"
        )
    return rows


def _sum(lines: Iterable[Line], key: str, kind: str | None = None) -> int:
    if kind is not None:
        return sum(line[key].get(kind, 0) for line in lines)
    return sum(sum(line[key].values()) for line in lines)
