"""Which channel a hand has turned, by how much, and its counts at rest."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

from traverse.drivers.base.values import (
    STATUS_WARNING,
    CountSamples,
    Identity,
    are_valid,
)

TOLERANCE = 0.2  # of an angle that a hand turns by eye
OTHERS = 0.2  # of the turn: another joint was turned, too
LARGEST_DIVISOR = 64  # turns that a counter may hold


@dataclass(slots=True)
class Track:
    """A channel's counts since a moment, unwrapped.

    Attributes:
        source: as an arm file names it, `<device id>/<channel>`.
        moved_counts: from the first valid sample to the last.
        n_samples, n_invalid, n_weak: how many there were, without a valid count, and
            with a warning of the encoder.
    """

    source: str
    modulus_counts: int
    counts_per_turn: int | None
    moved_counts: int = 0
    lowest_counts: int = 0
    highest_counts: int = 0
    n_samples: int = 0
    n_invalid: int = 0
    n_weak: int = 0
    _last: int | None = field(default=None, repr=False)

    @property
    def is_silent(self) -> bool:
        return self.n_invalid == self.n_samples

    def begin(self) -> None:
        self.moved_counts = self.lowest_counts = self.highest_counts = 0
        self.n_samples = self.n_invalid = self.n_weak = 0

    def feed(self, counts: Iterable[int], valid: Iterable[bool], n_weak: int) -> None:
        self.n_weak += n_weak
        for count, is_valid in zip(counts, valid, strict=True):
            self.n_samples += 1
            if not is_valid:
                self.n_invalid += 1
                continue
            if self._last is not None:
                half = self.modulus_counts // 2
                step = (count - self._last + half) % self.modulus_counts - half
                self.moved_counts += step
            self._last = count
            self.lowest_counts = min(self.lowest_counts, self.moved_counts)
            self.highest_counts = max(self.highest_counts, self.moved_counts)


def tracks_of(device: str, identity: Identity) -> list[Track]:
    reported = identity.counts_per_turn or (None,) * len(identity.moduli_counts)
    return [
        Track(f"{device}/{channel}", modulus, per_turn)
        for channel, (modulus, per_turn) in enumerate(
            zip(identity.moduli_counts, reported, strict=True)
        )
    ]


def feed_tracks(tracks: Sequence[Track], block: CountSamples) -> None:
    """Add samples of all channels of a device."""
    valid = are_valid(block.status)
    weak = (block.status & STATUS_WARNING) != 0
    for channel, track in enumerate(tracks):
        track.feed(
            map(int, block.counts[:, channel]),
            map(bool, valid[:, channel]),
            int(weak[:, channel].sum()),
        )


@dataclass(frozen=True, slots=True)
class Turned:
    """A joint that was turned.

    Attributes:
        sign: -1 if its counts decreased.
        counts_per_turn: None where the angle fits no divisor of the modulus, or two.
        angle_turns: by the counts, where these are known.
    """

    source: str
    sign: int
    moved_counts: int
    counts_per_turn: int | None
    angle_turns: float | None


def turned_joint(
    tracks: Sequence[Track],
    noise_counts: dict[str, int],
    angle_turns: float,
    expected_counts: int | None,
) -> Turned | str:
    """Find the channel that was turned positively by about an angle.

    Args:
        tracks: since the turning began.
        noise_counts: range of each source at rest.
        angle_turns: by about how much, in turns.
        expected_counts: counts per turn of the arm file.

    Returns:
        the joint, or why it is unknown, in a sentence.
    """
    moved = sorted(
        (track for track in tracks if _fraction(track) > 0.0),
        key=_fraction,
        reverse=True,
    )
    if not moved or abs(moved[0].moved_counts) <= 4 * noise_counts.get(
        moved[0].source, 0
    ):
        silent = [track.source for track in tracks if track.is_silent]
        suspected = f"; no valid count came from {', '.join(silent)}" if silent else ""
        return f"no channel has moved{suspected}"
    first = moved[0]
    also_moved = [
        t.source for t in moved[1:] if _fraction(t) > OTHERS * _fraction(first)
    ]
    if also_moved:
        return (
            f"more than one joint was turned: {', '.join([first.source, *also_moved])}"
        )
    per_turn = _counts_per_turn(first, angle_turns, expected_counts)
    return Turned(
        first.source,
        1 if first.moved_counts > 0 else -1,
        first.moved_counts,
        per_turn,
        abs(first.moved_counts) / per_turn if per_turn else None,
    )


def _fraction(track: Track) -> float:
    """The part of its counter's range that a channel has moved by."""
    return abs(track.moved_counts) / (track.counts_per_turn or track.modulus_counts)


def _counts_per_turn(
    track: Track, angle_turns: float, expected_counts: int | None
) -> int | None:
    """Counts per turn that fit the angle; a known value is preferred."""
    estimate = abs(track.moved_counts) / angle_turns

    def fits(counts: int | None) -> bool:
        return counts is not None and abs(counts - estimate) <= TOLERANCE * counts

    for known in (track.counts_per_turn, expected_counts):
        if fits(known):
            return known
    divisors = {
        track.modulus_counts // n
        for n in range(1, LARGEST_DIVISOR + 1)
        if track.modulus_counts % n == 0
    }
    fitting = [divisor for divisor in divisors if fits(divisor)]
    return fitting[0] if len(fitting) == 1 else None
