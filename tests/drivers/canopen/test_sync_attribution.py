"""No count without a flag is of another SYNC, however late and lossy nodes are."""

from dataclasses import dataclass
from typing import Literal

import pytest
from hypothesis import given
from hypothesis import strategies as st

from traverse.drivers.base.values import CountSamples
from traverse.drivers.canopen.sync_attribution import SyncAttribution
from traverse.drivers.canopen.sync_cycles import SyncCycleAssembler

NODES = (3, 7, 11)
PERIOD_NS, LATE_NS = 1_000, 10_000

Source = Literal["host", "kernel"]
# How late a node answers, and whether it does: mostly in time, as real ones.
ANSWER = st.one_of(st.integers(1, 900), st.integers(1, LATE_NS - 1), st.none())
ANSWERS = st.lists(st.tuples(ANSWER, ANSWER, ANSWER), min_size=1, max_size=80)


@dataclass
class Bus:
    """SYNCs and answers in the order of time; counts are the number of the SYNC."""

    cycles: SyncCycleAssembler
    source: Source
    now_ns: int = 0

    def play(self, answers: list[tuple[int | None, ...]]) -> list[int]:
        coming: list[tuple[int, int, int]] = []  # when, channel, count
        sent_ns: list[int] = []
        last_ns = [0] * len(NODES)
        for row in answers:
            due_ns = self.now_ns + PERIOD_NS
            self._listen(coming, due_ns)
            while (until_ns := self._free_ns()) > due_ns:
                due_ns = min([until_ns, *(due for due, _, _ in coming)])
                self._listen(coming, due_ns)
            self.now_ns = due_ns
            self.cycles.sync(due_ns)
            for channel, late_ns in enumerate(row):
                if late_ns is not None:  # in order, as one encoder sends
                    at_ns = max(last_ns[channel], due_ns + late_ns)
                    last_ns[channel] = at_ns
                    coming.append((at_ns, channel, len(sent_ns)))
            sent_ns.append(due_ns)
        return sent_ns

    def _free_ns(self) -> int:
        if self.source == "host":
            return self.cycles.wait_until_ns
        return self.cycles.pause_until_ns

    def _listen(self, coming: list[tuple[int, int, int]], until_ns: int) -> None:
        for frame in sorted(f for f in coming if f[0] <= until_ns):
            coming.remove(frame)
            self.cycles.take(0x180 + NODES[frame[1]], frame[2].to_bytes(4, "little"))


def samples(blocks: list[CountSamples]) -> list[tuple[int, list[int], list[int]]]:
    return [
        (int(at_ns), counts.tolist(), status.tolist())
        for block in blocks
        for at_ns, counts, status in zip(
            block.sample_time_ns, block.counts, block.status, strict=True
        )
    ]


def played(source: Source, answers: list[tuple[int | None, ...]]) -> tuple[int, int]:
    """How many counts bore no flag, and of how many SYNCs; all of them are true."""
    blocks: list[CountSamples] = []
    cycles = SyncCycleAssembler(
        "arm", NODES, (1 << 20,) * 3, (0,) * 3, blocks.append, late_ns=LATE_NS
    )
    cycles.restart(1)
    sent_ns = Bus(cycles, source).play(answers)
    cycles.flush(1 << 60, at_once=True)
    n_good = 0
    for at_ns, counts, status in samples(blocks):
        for count, bits in zip(counts, status, strict=True):
            if not bits:
                assert sent_ns[count] == at_ns
                n_good += 1
    return n_good, len(sent_ns)


@pytest.mark.parametrize("source", ["host", "kernel"])
@given(answers=ANSWERS, stalls=st.tuples(*[st.integers(0, 60)] * 3))
def test_a_count_without_a_flag_is_of_its_sync(source, answers, stalls):
    rows = [list(row) for row in answers]
    for channel, n_th in enumerate(stalls):  # then all held-up frames arrive at once
        if n_th < len(rows):
            rows[n_th][channel] = 5 * LATE_NS
    played(source, [tuple(row) for row in rows])


@pytest.mark.parametrize("source", ["host", "kernel"])
def test_nodes_in_time_are_never_flagged(source):
    assert played(source, [(900, 900, 900)] * 40)[0] == 3 * 39  # the last is open


def test_a_node_that_is_always_a_period_late_is_waited_for_by_the_host():
    assert played("host", [(100, 100, 1_300)] * 40)[0] == 3 * 39


def test_of_a_node_that_is_always_a_period_late_what_came_in_pauses_is_believed():
    good, n = played("kernel", [(100, 100, 1_300)] * 40)
    assert 2 * (n - 1) + n // 3 < good < 2 * (n - 1) + n // 2


def test_an_answer_that_was_lost_costs_a_pause_and_no_more():
    answers: list[tuple[int | None, ...]] = [(100, 100, 100)] * 40
    answers[10] = (100, 100, None)
    assert played("kernel", answers)[0] == 3 * 39 - 2  # missing, then late
    assert played("host", answers)[0] == 3 * 39 - 2


def test_pending_answers_are_resolved_one_by_one():
    attribution = SyncAttribution(2)
    attribution.record_missed(0b11)
    attribution.record_missed(0b01)
    assert attribution.resolve(1)
    assert not attribution.resolve(1)
    assert attribution.resolve(0)
    assert attribution.pending == 0b01
    assert attribution.resolve(0)
    assert attribution.pending == 0


def test_a_node_set_up_anew_owes_nothing_until_it_answers():
    attribution = SyncAttribution(1)
    attribution.record_missed(1)
    attribution.reset(1)
    attribution.record_missed(1)
    assert (attribution.pending, attribution.unanswered) == (0, 1)
    attribution.record_missed(0)
    attribution.record_missed(1)
    assert attribution.pending == 1
