"""The arm of a world: its file, its truth, its motion.

The truth differs from the arm file by the covariance beside the file, or by millimetres
if the arm was never identified; so it does from the probe library.
"""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.arm_file.arm import Arm, geometry_digest, read_arm
from traverse.simulator.arm.trajectory import Trajectory, move_pieces, rest_pieces
from traverse.simulator.arm.truth import Deviations, true_arm
from traverse.simulator.effects.faulty_arm import faulty_arm
from traverse.simulator.scenario.course import ClimateTable, Course
from traverse.simulator.scenario.script import Script, ScriptEvent

# A six-joint arm of some 800 mm: roll, hinge, hinge, roll, hinge, roll.
AXES = np.array([[0, 0, 1], [0, 1, 0], [0, 1, 0], [1, 0, 0], [0, 1, 0], [1, 0, 0.0]])
LINKS_MM = np.array(
    [[0, 0, 200], [300, 0, 0], [20, 0, 30], [250, 0, 0], [0, 15, 0], [40, 0, 0.0]]
)
TIP_MM = np.array([60.0, 0.0, -20.0])
PROBES_MM = {"short": np.array([50.0, 0, 0]), "long": np.array([140.0, 20.0, -30.0])}
PROBE_STD_MM = 0.005
LIBRARY = "probes.toml"
LINK_STD_MM, AXIS_STD_RAD = 0.004, 4e-6  # of an arm that was identified
UNKNOWN_LINK_MM, UNKNOWN_AXIS_RAD = 1.0, 2e-3  # of one that never was
REACH_RAD = 0.9  # of every joint to both sides
PRESS_S = 0.12
HOME_S, LEAVE_S, HURRY_S = 4.0, 2.5, 0.5  # in the home posture; on the way to it


@dataclass(frozen=True, slots=True)
class ArmSource:
    """An encoder of the arm.

    Attributes:
        source: "<device>/<channel>".
        sign: +1 or -1.
        absolute: As the arm file says; None: nothing.
    """

    source: str
    counts_per_turn: int
    sign: int
    absolute: bool | None


def write_arm(
    folder: Path,
    sources: Sequence[ArmSource],
    rng: np.random.Generator,
    *,
    is_identified: bool,
) -> None:
    """Write arm.toml with its covariance, and true.toml, unknown to the daemon."""
    zeros_rad = rng.uniform(-2.0, 2.0, len(sources))
    names = [f"J{k + 1}" for k in range(len(sources))]
    provenance = ""
    home = ", ".join(
        f"{n} = {z!r}" for n, z in zip(names, zeros_rad.tolist(), strict=True)
    )
    if is_identified:
        parts = {"axis": AXIS_STD_RAD, "link": LINK_STD_MM}
        stds = {
            f"{joint}.{part}.{c}": std
            for part, std in parts.items()
            for joint in names
            for c in "xyz"
        }
        file = folder / "arm.cov.npz"
        covariance = np.diag(np.square(list(stds.values())))
        np.savez(file, names=list(stds), covariance=covariance)
        digest = hashlib.sha256(file.read_bytes()).hexdigest()
        provenance = (
            f'[identification]\ncovariance_file = "{file.name}"\n'
            f'covariance_digest = "sha256:{digest}"\ndate = "2026-01-01"\n'
        )
    link_mm = LINK_STD_MM if is_identified else UNKNOWN_LINK_MM
    axis_rad = AXIS_STD_RAD if is_identified else UNKNOWN_AXIS_RAD
    tables = [
        (name, AXES[k], LINKS_MM[k], float(zeros_rad[k]), sources[k])
        for k, name in enumerate(names)
    ]
    true = [
        (
            name,
            axis + axis_rad * rng.standard_normal(3),
            link + link_mm * rng.standard_normal(3),
            zero_rad,
            source,
        )
        for name, axis, link, zero_rad, source in tables
    ]
    text = f"{_arm_text(tables)}[home]\nangles_rad = {{ {home} }}\n"
    path = folder / "arm.toml"
    path.write_text(text)
    if is_identified:
        provenance += f'arm_digest = "{geometry_digest(read_arm(path))}"\n'
    path.write_text(text + provenance)
    (folder / "true.toml").write_text(_arm_text(true))
    library = 'schema = "traverse/probes/1"\n'
    six = [PROBE_STD_MM**2 * part for part in (1, 0, 0, 1, 0, 1)]
    probe_rng = np.random.default_rng(round(1e6 * float(np.abs(zeros_rad).sum())))
    for name, vector_mm in PROBES_MM.items():
        library += (
            f'[[probes]]\nname = "{name}"\nkind = "hard"\nradius_mm = 3.0\n'
            f"vector_mm = {vector_mm.tolist()}\nvector_covariance_mm2 = {six}\n"
        )
        really_mm = vector_mm + PROBE_STD_MM * probe_rng.standard_normal(3)
        (folder / f"true-{name}.toml").write_text(_arm_text(true, really_mm))
    (folder / LIBRARY).write_text(library)


def _arm_text(
    joints: Sequence[tuple[str, Floats, Floats, float, ArmSource]],
    tip_mm: Floats = TIP_MM,
) -> str:
    text = 'schema = "traverse/arm/1"\nname = "honest"\norigin_mm = [0.0, 0.0, 0.0]\n'
    for name, axis, link_mm, zero_rad, source in joints:
        text += (
            f'[[joints]]\nname = "{name}"\naxis = {axis.tolist()}\n'
            f"link_mm = {link_mm.tolist()}\nzero_rad = {zero_rad!r}\n"
            f"[joints.encoder]\ncounts_per_turn = {source.counts_per_turn}\n"
            f'sign = {source.sign}\nsource = "{source.source}"\n'
        )
        if source.absolute is not None:
            text += f"absolute = {str(source.absolute).lower()}\n"
    return (
        f'{text}[probe]\nradius_mm = 3.0\nkind = "hard"\n'
        f"vector_mm = {tip_mm.tolist()}\n"
        "[reference]\ntemperature_c = 20.0\ngravity_m_s2 = [0.0, 0.0, -9.80665]\n"
    )


@dataclass(frozen=True, slots=True)
class Pace:
    """How the arm is led.

    Attributes:
        rest_s: longest rest between two moves; 0: it never rests.
        reach: of `REACH_RAD` in one move.
    """

    rest_s: float
    move_s: float
    reach: float
    press_s: float


PACES = {
    "rest": Pace(1e9, 1.0, 0.0, 1.5),
    "slow": Pace(2.0, 3.0, 0.25, 2.0),
    "hand": Pace(1.5, 1.2, 0.7, 2.0),
    "fast": Pace(0.3, 0.7, 1.0, 1.5),
}


def play(
    pace: Pace,
    duration_s: float,
    rng: np.random.Generator,
    homes_s: Sequence[float] = (),
) -> Script:
    """Lead the arm for a time; press the button now and then, wherever it is.

    At ``homes_s`` it rests in its home posture, which is the base posture, for
    `HOME_S`.
    """
    n_joints = len(AXES)
    posture_rad = np.zeros(n_joints)
    time_s, ends_s, pieces = 0.0, [], []
    homes = list(homes_s)
    slowest_s = 2.0 * pace.move_s  # one that has begun must not end too late
    while time_s < duration_s:
        if homes and time_s + slowest_s >= homes[0] - LEAVE_S:
            if at_s := homes.pop(0):
                time_s = max(time_s + HURRY_S, at_s)
                ends_s.append(time_s)
                pieces.append(move_pieces(posture_rad, np.zeros(n_joints)))
            posture_rad = np.zeros(n_joints)
            time_s += HOME_S
            ends_s.append(time_s)
            pieces.append(rest_pieces(posture_rad))
        if pace.rest_s:
            rest_s = float(rng.uniform(0.2, 1.0)) * pace.rest_s
            left_s = homes[0] - LEAVE_S - time_s if homes else duration_s
            time_s += max(0.05, min(rest_s, left_s))
            ends_s.append(time_s)
            pieces.append(rest_pieces(posture_rad))
        if not pace.reach:
            continue
        step = pace.reach * REACH_RAD * rng.uniform(-1.0, 1.0, n_joints)
        target = np.clip(posture_rad + step, -REACH_RAD, REACH_RAD)
        time_s += pace.move_s * float(rng.uniform(1.0, 2.0))
        ends_s.append(time_s)
        pieces.append(move_pieces(posture_rad, target))
        posture_rad = target
    events, at_s = [], float(rng.uniform(0.5, pace.press_s))
    while at_s < duration_s - 1.0:
        events.append(ScriptEvent(at_s, "button", 1))
        events.append(ScriptEvent(at_s + PRESS_S, "button", 0))
        at_s += 2.0 * PRESS_S + float(rng.exponential(pace.press_s))
    breaks_s = np.array([0.0, *ends_s])
    return Script(Trajectory(breaks_s, np.concatenate(pieces)), tuple(events), False)


@dataclass(frozen=True, slots=True)
class ArmTruth:
    """The true arm on its way.

    Attributes:
        nominal: As in the arm file, for the wiring of encoders alone.
        course: with the arm's own probe.
        others: with those of the library, by name.
        changes: when another probe was put on, and the course with it.
    """

    nominal: Arm
    course: Course
    others: Mapping[str, Course]
    changes: list[tuple[float, Course]] = field(default_factory=list)

    def centres_mm(self, true_s: Floats) -> Floats:
        """Return ball centres (n, 3) at true times (n,)."""
        true_s = np.maximum(true_s, 0.0)
        centres_mm = self.course.probe(true_s)[0]
        for from_s, course in self.changes:
            if (true_s >= from_s).any():
                later = (true_s >= from_s)[:, np.newaxis]
                centres_mm = np.where(later, course.probe(true_s)[0], centres_mm)
        return centres_mm

    def put_on(self, name: str, true_s: float) -> None:
        """Put on a probe of the library."""
        self.changes.append((true_s, self.others[name]))


def arm_truth(folder: Path, script: Script, utc_s: float, seed: int) -> ArmTruth:
    """Read the true arm and let it follow a script that begins at the true time 0."""

    def course(file: str) -> Course:
        really = read_arm(folder / file)
        truth = true_arm(really, Deviations(), seed)
        arm = faulty_arm(really, truth.mechanism, truth.zeros_rad, ())
        return Course(script, arm, ClimateTable(), utc_s)

    others = {name: course(f"true-{name}.toml") for name in PROBES_MM}
    return ArmTruth(read_arm(folder / "arm.toml"), course("true.toml"), others)
