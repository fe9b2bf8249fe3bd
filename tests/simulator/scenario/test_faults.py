import numpy as np
import pytest

from traverse.simulator.arm.physics import Mechanism
from traverse.simulator.arm.trajectory import Trajectory, move_pieces
from traverse.simulator.arm.truth import EncoderSet
from traverse.simulator.devices.serial_line import DisturbedLine
from traverse.simulator.effects import FaultyArm
from traverse.simulator.effects.posture import Build
from traverse.simulator.scenario.course import ClimateTable, Course
from traverse.simulator.scenario.faults import Fault
from traverse.simulator.scenario.script import Script
from traverse.simulator.scenario.signals import AlarmChange
from traverse.simulator.scenario.wiring import ScriptClock, ScriptedCounts, Wiring

FRAME = bytes(range(1, 50)) + b"\0"


def line(seed=1, **table):
    return DisturbedLine((Fault.from_table(table),), seed)


@pytest.mark.parametrize("kind", ["lost", "corrupted", "repeated", "garbage"])
def test_faults_strike_at_their_rate_and_are_counted(kind):
    disturbed = line(kind=kind, probability=0.1)
    sent = [disturbed.disturb(FRAME, 0.0) for _ in range(5000)]
    struck = sum(data != FRAME for data in sent)
    assert struck == getattr(disturbed.counts, kind)
    assert abs(struck - 500) < 4 * np.sqrt(5000 * 0.1 * 0.9)
    repeated = line(kind=kind, probability=0.1)
    assert [repeated.disturb(FRAME, 0.0) for _ in range(5000)] == sent


def test_what_faults_do_to_a_frame():
    def strike(kind):
        return line(kind=kind, probability=1.0).disturb(FRAME, 0.0)

    assert strike("lost") == b""
    assert strike("repeated") == FRAME + FRAME
    assert strike("garbage").endswith(FRAME)
    assert 1 <= len(strike("garbage")) - len(FRAME) <= 64
    flipped = np.frombuffer(strike("corrupted"), np.uint8) ^ np.frombuffer(
        FRAME, np.uint8
    )
    assert np.sum(np.unpackbits(flipped)) == 1


def test_a_fault_lasts_from_its_beginning_for_its_duration():
    disturbed = line(kind="silent", at_s=2.0, duration_s=1.0)
    sent = [disturbed.disturb(FRAME, at_s) for at_s in (1.999, 2.0, 2.999, 3.0)]
    assert sent == [FRAME, b"", b"", FRAME]
    assert disturbed.counts.silenced == 2


def course(script: Script) -> Course:
    axes, nowhere = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0]]), np.zeros((2, 3))
    mechanism = Mechanism(nowhere, axes, np.ones(3), axes[0])
    build = Build(
        mechanism,
        zeros_rad=np.array([0.5, 0.0]),
        links_mm=nowhere,
        masses_kg=np.zeros(3),
        centres_mm=np.zeros((3, 3)),
        first_moments_kg_m=np.zeros((2, 3)),
        gravity_m_s2=np.zeros(3),
        gearing=np.eye(2),
    )
    return Course(script, FaultyArm(build, (), (), ()), ClimateTable(), 0.0)


def wiring(*faults, begin_s=0.0):
    trajectory = Trajectory(
        np.array([0.0, 4.0]), move_pieces(np.zeros(2), np.array([1.0, -2.0]))
    )
    script = Script(trajectory, (), repeat=False)
    encoders = EncoderSet(
        joints=np.array([0, 1]),
        counts_per_turn=np.array([3600, 1000]),
        signs=np.array([1, -1]),
        moduli=np.array([3600, 3000]),
        noise_rad=0.0,
    )
    return Wiring(
        ScriptedCounts(course(script), encoders),
        script,
        ScriptClock(begin_s),
        inputs=["button"],
        faults=[Fault.from_table(fault) for fault in faults],
        moduli=encoders.moduli,
        seed=(1, 0),
    )


TIMES = np.linspace(0.0, 6.0, 601)


def test_counts_are_readings_with_sign_and_wrap():
    counts, status = wiring().latch(TIMES, edge=False)
    assert counts[0].tolist() == [round(0.5 / (2 * np.pi) * 3600), 0]
    assert counts[-1].tolist() == [
        round(1.5 / (2 * np.pi) * 3600),
        round(2.0 / (2 * np.pi) * 1000),
    ]
    assert not status.any()


def test_a_stuck_encoder_shows_its_last_count():
    fault = {"kind": "stuck", "channel": 1, "at_s": 1.0, "duration_s": 2.0}
    good, _ = wiring().latch(TIMES, edge=False)
    counts, _ = wiring(fault).latch(TIMES, edge=False)
    stuck = (TIMES >= 1.0) & (TIMES < 3.0)
    assert np.all(counts[stuck, 1] == good[100, 1])
    assert np.array_equal(counts[~stuck], good[~stuck])
    assert np.array_equal(counts[:, 0], good[:, 0])


def test_a_jumping_encoder_is_off_by_its_step_modulo_its_modulus():
    fault = {"kind": "jump", "channel": 0, "at_s": 1.0, "step_counts": -500}
    good, _ = wiring().latch(TIMES, edge=False)
    counts, _ = wiring(fault).latch(TIMES, edge=False)
    off = (counts[:, 0].astype(int) - good[:, 0] + 1800) % 3600 - 1800
    assert np.array_equal(off, np.where(TIMES >= 1.0, -500, 0))


@pytest.mark.parametrize("most", [1, 3])
def test_an_encoder_that_is_not_read_shows_the_count_before(most):
    fault = {"kind": "unread", "channel": 0, "probability": 0.1, "most": most}
    fault |= {"at_s": 1.0, "duration_s": 2.0}
    good, _ = wiring().latch(TIMES, edge=False)
    wired = wiring(fault)
    blocks = [wired.latch(block, edge=False)[0] for block in np.split(TIMES[:600], 60)]
    counts = np.concatenate(blocks)
    failed_s = np.array(wired.failing_reads[0].failed_s)
    assert 10 <= len(failed_s) <= 20 * (most + 1) / 2 + 20
    assert ((failed_s >= 0.99) & (failed_s < 3.0)).all()
    expected = good[:600].copy()
    for read_s, time_s in failed_s:
        expected[round(100 * time_s), 0] = good[round(100 * read_s), 0]
    in_a_row = np.rint(100 * (failed_s[:, 1] - failed_s[:, 0])).max()
    assert in_a_row == most
    assert np.array_equal(counts, expected)
    # The same instant, as of another channel, is the same read.
    again, _ = wired.latch(TIMES[599:600], edge=False)
    assert np.array_equal(again[0], counts[-1])


def test_a_status_error_raises_and_clears_its_alarm():
    fault = {"kind": "status", "channel": 1, "at_s": 1.0, "duration_s": 2.0, "code": 1}
    wired = wiring(fault, begin_s=10.0)
    _, status = wired.latch(10.0 + TIMES, edge=False)
    assert np.array_equal(status[:, 1] & 1, (TIMES >= 1.0) & (TIMES < 3.0))
    alarms = []
    while (change := wired.peek_change()) is not None and len(alarms) < 5:
        alarms.append(change)
        wired.take_change()
    assert alarms == [AlarmChange(11.0, 1, 1, 1, 0), AlarmChange(13.0, 1, 0, 1, 0)]


def test_before_the_script_begins_the_arm_rests_at_its_start():
    wired = wiring(begin_s=None)
    counts, _ = wired.latch(np.array([0.0, 100.0]), edge=False)
    assert np.array_equal(counts[0], counts[1])
    assert wired.peek_change() is None


def test_noise_does_not_depend_on_the_cutting_into_blocks():
    undivided, pieces = (
        EncoderSet(
            np.array([0, 1]), *(np.array([2**20, 2**20]),), np.array([1, 1]),
            np.array([2**20, 2**20]), noise_rad=1e-4,
        )
        for _ in range(2)
    )  # fmt: skip
    readings = np.zeros((100, 2))
    first = undivided.counts(readings, np.random.default_rng(3))
    rng = np.random.default_rng(3)
    cut = [pieces.counts(readings[a:b], rng) for a, b in ((0, 7), (7, 8), (8, 100))]
    assert np.array_equal(first, np.concatenate(cut))
    assert len(np.unique(first)) > 20
