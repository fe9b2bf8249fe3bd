"""Counts of encoders to readings of joints: alpha = sign 2 pi counts / counts_per_turn.

An encoder counts modulo one turn or several. The first sample is put into the turn in
which its reading is nearest to zero_rad; every further one nearest to the sample
before. Half a turn exactly is taken downwards in counts. All is integer arithmetic
until the last step, so that nothing is lost over many turns.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from traverse.arrays import Booleans, Floats, Integers
from traverse.plurals import counted

if TYPE_CHECKING:
    from traverse.kinematics.arm_file.arm import Arm

_LARGEST_COUNTS_PER_TURN = 2**32
# Above, a float no longer holds every count.
_LARGEST_COUNTS = 2**53

Counts = Integers | NDArray[np.uint32]


@dataclass(frozen=True, slots=True, eq=False)
class Encoders:
    """The encoders of an arm, one entry a joint; arrays are read-only.

    Attributes:
        counts_per_turn: 1 to 2^32, (n_joints,) int64.
        signs: +1 or -1, (n_joints,) int64.
        zeros_rad: Readings in the base posture, (n_joints,).
    """

    counts_per_turn: Integers
    signs: Integers
    zeros_rad: Floats

    def __post_init__(self) -> None:
        counts_per_turn = np.array(self.counts_per_turn, dtype=np.int64)
        signs = np.array(self.signs, dtype=np.int64)
        zeros_rad = np.array(self.zeros_rad, dtype=np.float64)
        shapes = {counts_per_turn.shape, signs.shape, zeros_rad.shape}
        if len(shapes) != 1 or counts_per_turn.ndim != 1 or not len(counts_per_turn):
            raise ValueError(f"encoders: shapes {shapes} differ; expected (n_joints,)")
        if not np.all(
            (counts_per_turn >= 1) & (counts_per_turn <= _LARGEST_COUNTS_PER_TURN)
        ):
            raise ValueError(
                f"encoders: counts_per_turn is {counts_per_turn.tolist()}, expected "
                "1 to 2^32 each"
            )
        if not np.all(np.abs(signs) == 1):
            raise ValueError(f"encoders: signs are {signs.tolist()}, expected 1 or -1")
        largest = np.abs(zeros_rad) * counts_per_turn / (2.0 * np.pi)
        if not np.all(largest < _LARGEST_COUNTS):
            raise ValueError(
                f"encoders: zeros_rad is {zeros_rad.tolist()}, beyond what counts can "
                "tell apart; expected a reading within some turns of zero"
            )
        for name, array in (
            ("counts_per_turn", counts_per_turn),
            ("signs", signs),
            ("zeros_rad", zeros_rad),
        ):
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    @property
    def n_joints(self) -> int:
        return len(self.signs)


def encoders_from_arm(arm: "Arm") -> Encoders:
    """Return the encoders of an arm file.

    Raises:
        ValueError: a joint has no encoder; names all such joints.
    """
    encoders = [joint.encoder for joint in arm.joints if joint.encoder is not None]
    missing = [joint.name for joint in arm.joints if joint.encoder is None]
    if missing:
        raise ValueError(
            f"arm {arm.name}: no encoder for {', '.join(missing)}, so counts cannot "
            "become angles; add [joints.encoder] to the arm file"
        )
    return Encoders(
        counts_per_turn=np.array([e.counts_per_turn for e in encoders], dtype=np.int64),
        signs=np.array([e.sign for e in encoders], dtype=np.int64),
        zeros_rad=np.array([joint.zero_rad for joint in arm.joints]),
    )


class Unwrapper:
    """Counts encoders over their turns, independent of how a stream is cut."""

    def __init__(self, encoders: Encoders) -> None:
        self._counts_per_turn = encoders.counts_per_turn
        self._wraps = encoders.counts_per_turn
        # Whole turns [counts] from what an encoder counts to `_last`, once known.
        self._offsets = np.zeros(encoders.n_joints, dtype=np.int64)
        self._offset_known = np.zeros(encoders.n_joints, dtype=np.bool_)
        # The reading zero_rad in counts; at most half a count of a turn is at stake.
        self._signs = encoders.signs
        self.use_zeros(encoders.zeros_rad)
        self._last = np.zeros(encoders.n_joints, dtype=np.int64)
        self._fresh = np.ones(encoders.n_joints, dtype=np.bool_)

    def use_zeros(self, zeros_rad: Floats) -> None:
        """Put first samples into the turns nearest to these readings, (n_joints,)."""
        self._zero_counts = (
            self._signs * zeros_rad * (self._counts_per_turn / (2.0 * np.pi))
        )

    def use_wraps(self, wraps_counts: Integers) -> None:
        """Set where counts wrap to 0, (n_joints,), whole turns each."""
        self._forget_offsets(self._wraps != wraps_counts)
        self._wraps = wraps_counts

    def unwrap(self, counts: Counts, valid: Booleans | None = None) -> Integers:
        """Continue the stream by a block.

        Args:
            counts: of the encoders, (n_samples, n_joints).
            valid: (n_samples, n_joints); invalid counts move no turn. None: all.

        Returns:
            Counts over all turns, (n_samples, n_joints).
        """
        raw = self._checked(counts, dimensions=2)
        if len(raw) == 0:
            return raw
        held = raw if valid is None else self._held(raw, valid)
        unwrapped = self._nearest(held[0])[np.newaxis]
        if len(held) > 1:
            steps = self._shortest(held[1:] - held[:-1])
            unwrapped = np.concatenate([unwrapped, steps]).cumsum(axis=0)
        self._last = unwrapped[-1].copy()
        if not self._offset_known.all():
            known = np.ones_like(self._fresh) if valid is None else valid.any(axis=0)
            self._fresh &= ~known
            now_known = ~self._offset_known & known
            self._offsets[now_known] = (unwrapped[-1] - held[-1])[now_known]
            self._offset_known |= known
        return unwrapped if valid is None else unwrapped + self._shortest(raw - held)

    def _held(self, raw: Integers, valid: Booleans) -> Integers:
        """Replace invalid counts by the one before; first ones by the first valid."""
        rows = np.where(valid, np.arange(len(raw))[:, np.newaxis], -1)
        latest = np.maximum.accumulate(rows, axis=0)
        first = np.take_along_axis(raw, valid.argmax(axis=0)[np.newaxis], 0)
        before = np.where(self._offset_known, self._last, first)
        held = np.take_along_axis(raw, np.maximum(latest, 0), 0)
        return np.where(latest >= 0, held, before)

    def near(self, counts: Counts) -> Integers:
        """Unwrap counts latched at an event, without advancing the stream.

        Args:
            counts: of the encoders, (n_joints,).

        Returns:
            Counts over all turns, nearest to the last sample, (n_joints,).
        """
        return self._nearest(self._checked(counts, dimensions=1))

    def with_turns_near_zero(self, counts: Integers, joints: Sequence[int]) -> Integers:
        """Return the last block's counts with the turns of some joints reset.

        Args:
            counts: of `unwrap`, (n_samples, n_joints).
            joints: from 0, whose last count is put into the turn nearest to zero_rad.
        """
        shift = np.zeros_like(self._last)
        chosen = list(joints)
        shift[chosen] = self._to_zero(counts[-1])[chosen]
        self._last = self._last + shift
        self._offsets[self._offset_known] += shift[self._offset_known]
        return counts + shift

    @property
    def turns(self) -> tuple[Integers, Booleans]:
        """The last sample over all turns, and which joints have had none, (n_joints,).

        `resume` takes them; a stream continues as if never interrupted.
        """
        return self._last.copy(), self._fresh.copy()

    def resume(self, last: Integers, fresh: Booleans) -> None:
        """Continue from earlier `turns`."""
        shape = self._last.shape
        if last.shape != shape or fresh.shape != shape:
            raise ValueError(
                f"turns of {last.shape} and {fresh.shape} joints, expected {shape}"
            )
        self._last, self._fresh = last.astype(np.int64), fresh.astype(np.bool_)
        self._forget_offsets(np.ones_like(self._fresh))

    def reset(self, joints: Booleans | None = None) -> None:
        """Forget turns: the next sample is a first one.

        Args:
            joints: (n_joints,); None for all.
        """
        self._fresh |= True if joints is None else joints
        self._forget_offsets(self._fresh)

    def _forget_offsets(self, joints: Booleans) -> None:
        self._offset_known &= ~joints
        self._offsets[joints] = 0

    def _nearest(self, raw: Integers) -> Integers:
        near_last = self._last + self._shortest(raw - self._last)
        if self._offset_known.all():  # then no joint is fresh
            return near_last
        turn = self._counts_per_turn
        step = (raw - self._last + turn // 2) % turn - turn // 2
        near_last = np.where(self._offset_known, near_last, self._last + step)
        return np.where(self._fresh, raw + self._to_zero(raw), near_last)

    def _to_zero(self, counts: Integers) -> Integers:
        """Return whole turns that bring counts (n_joints,) nearest to zero_rad."""
        turns = np.ceil((self._zero_counts - counts) / self._counts_per_turn - 0.5)
        return turns.astype(np.int64) * self._counts_per_turn

    def _shortest(self, differences: Integers) -> Integers:
        """Reduce differences to half a wrap: -wrap/2 <= d < wrap/2."""
        half = self._wraps // 2
        return (differences + half) % self._wraps - half

    def _checked(self, counts: Counts, dimensions: int) -> Integers:
        n_joints = len(self._counts_per_turn)
        if counts.ndim != dimensions or counts.shape[-1] != n_joints:
            expected = "(n_samples, n_joints)" if dimensions == 2 else "(n_joints,)"
            raise ValueError(
                f"counts have shape {counts.shape}, expected {expected} with "
                f"{counted(n_joints, 'joint')}"
            )
        return counts.astype(np.int64) % self._wraps + self._offsets


def counts_to_angles(encoders: Encoders, unwrapped_counts: Integers) -> Floats:
    """Convert counts over all turns to readings in rad, (n_samples, n_joints)."""
    per_count_rad = encoders.signs * (2.0 * np.pi / encoders.counts_per_turn)
    return unwrapped_counts * per_count_rad
