"""One good file of every kind that commands read, in a folder."""

import json
import shutil
from pathlib import Path

from typer.testing import CliRunner

import traverse.cli
from tests.cli.arm.test_urdf import ROBOT
from tests.cli.points.test_export import ALL
from tests.cli.test_align import NOMINAL, lines, measured, table
from tests.cli.test_check import PROBES
from tests.cli.test_verify import limits_file
from tests.daemon.store.test_damage import make
from tests.protocol.message_examples import SCAN
from traverse.cli.__main__ import app
from traverse.kinematics.arm_file.arm import read_arm
from traverse.recording.run_writer import Entry, RunHead, RunWriter
from traverse.recording.views import cloud_to_bytes, point_to_bytes
from traverse.simulator.campaigns import (
    CampaignSpec,
    NoiseTable,
    draw_noise,
    make_poses,
    write_campaign,
)
from traverse.simulator.campaigns.acceptance.poses import (
    acceptance_poses,
    drawn_acceptance,
)

DATA = Path(traverse.cli.__file__).parent / "demo_data"
STANDARD = "asme-b89.4.22"
PLAN = """\
schema = "traverse/collection-plan/1"
centre_mm = [0.0, 0.0, 220.0]
reach_mm = 1238.0
[[steps]]
artefact = "cone"
feature = "left"
touches = 5
say = "cone, elbow to the left"
"""


def make_samples(folder: Path, *, computed: bool = True) -> Path:
    """Write them all, or without what takes long to compute; returns the folder."""
    for name in ("arm.toml", "simulator.toml"):
        shutil.copyfile(DATA / name, folder / name)
    daemon = (DATA / "daemon.toml").read_text("utf-8")
    # Nobody listens there.
    values = {"folder": folder, "host": "127.0.0.1", "port": 9}
    (folder / "daemon.toml").write_text(
        daemon.format(**values).replace(
            'file = "arm.toml"', 'file = "arm.toml"\nprobes = "probes.toml"'
        )
    )
    arm = read_arm(folder / "arm.toml")
    (folder / "probes.toml").write_text(PROBES)
    (folder / "plan.toml").write_text(PLAN)
    (folder / "robot.urdf").write_text(ROBOT)
    (folder / "dh.csv").write_text(
        "name,a_mm,d_mm,alpha_rad\nJ1,0,127,pi/2\nJ2,-612,0,0\nJ3,-572,0,0\n"
    )
    (folder / "dh.toml").write_text(
        'convention = "classic"\n[[rows]]\na_mm = 0\nd_mm = 127\nalpha_rad = "pi/2"\n'
        "[[rows]]\na_mm = -612\nd_mm = 0\nalpha_rad = 0\n"
    )
    limits_file(folder, p_size_mm=0.05, p_form_mm=0.05)
    nominal = "".join(
        f'[[points]]\nname = "P{n}"\nx_mm = {x}\ny_mm = {y}\nz_mm = {z}\n'
        for n, (x, y, z) in enumerate(NOMINAL.tolist())
    )
    (folder / "nominal.toml").write_text(f'schema = "traverse/nominal/1"\n{nominal}')
    table(folder / "measured.csv", measured())
    lines(folder / "points.jsonl", measured())
    make(folder / "outbox.db")
    with RunWriter(folder / "run.mcap", RunHead({"arm": "a"}, {})) as writer:
        for point in ALL:
            writer.add(Entry("point", point.time_ns, point_to_bytes(point)))
        writer.add(Entry("cloud", SCAN.time_ns, cloud_to_bytes(SCAN)))
    poses = make_poses(arm, CampaignSpec(mix="cones+bar", n_poses=60), seed=3)
    write_campaign(folder / "campaign", draw_noise(poses, 5), arm)
    if not computed:
        return folder
    noise = NoiseTable(encoder_rad=2e-6, contact_mm=0.003)
    tested = acceptance_poses(arm, STANDARD, 1, noise=noise)
    write_campaign(folder / "accepted", drawn_acceptance(tested, 1), arm)
    from tests.cli.test_daily_check import campaign  # noqa: PLC0415 - reads at import

    campaign(folder / "check", day=1)
    arm_words = ["--arm", str(folder / "arm.toml")]
    for words in (
        [
            "verify",
            str(folder / "accepted"),
            "--standard",
            STANDARD,
            *arm_words,
            "--out",
            str(folder / "certificate"),
        ],
        [
            "daily-check",
            "--history",
            str(folder / "history.db"),
            *arm_words,
            "--campaign",
            str(folder / "check"),
        ],
    ):
        done = CliRunner().invoke(app, words)
        assert isinstance(done.exception, SystemExit | None), done.exception
    values = json.loads((folder / "certificate" / "certificate.json").read_text())
    assert values["digest"]["files"]
    return folder
