"""One good file of every kind that commands read, in a folder."""

import asyncio
import contextlib
import json
import shutil
import sqlite3
from dataclasses import asdict, replace
from pathlib import Path

from typer.testing import CliRunner

import traverse.cli
from tests.certificates import Authority
from tests.cli.arm.test_urdf import ROBOT
from tests.cli.points.test_export import ALL
from tests.cli.test_align import NOMINAL, lines, measured, table
from tests.cli.test_check import PROBES
from tests.cli.test_verify import limits_file
from tests.daemon.recorder.recorded_runs import RecordedRun
from tests.daemon.store.test_damage import make
from tests.fleet.test_store import received
from tests.lab.certificates.made import LABORATORY
from tests.lab.collection.test_collection import CAMPAIGN, touch
from tests.protocol.message_examples import EVENT, HEALTH, SCAN, STATUS
from traverse.cli.__main__ import app
from traverse.fleet.evidence import add_evidence
from traverse.fleet.opening import open_database
from traverse.fleet.scan_files import ScanFiles
from traverse.fleet.store import Store
from traverse.fleet.tables import migrate
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
    (folder / "laboratory.toml").write_text(LABORATORY, "utf-8")
    (folder / "arm.key.pub").write_text(f"{'A' * 43}=\n")
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
    _collected(folder / "collected")
    _page_files(folder)
    (folder / "recorded").mkdir()
    shutil.copyfile(asyncio.run(_steps(folder / "recorded")), folder / "steps.mcap")
    if not computed:
        return folder
    noise = NoiseTable(encoder_rad=2e-6, contact_mm=0.003)
    tested = acceptance_poses(arm, STANDARD, 1, noise=noise)
    write_campaign(folder / "accepted", drawn_acceptance(tested, 1), arm)
    from tests.cli.test_daily_check import campaign  # noqa: PLC0415 - reads at import

    campaign(folder / "check", day=1)
    arm_words = ["--arm", str(folder / "arm.toml")]
    (folder / "identified").mkdir()
    words = ["identify", str(folder / "campaign"), *arm_words]
    _run([*words, "--out", str(folder / "identified")])
    # Without its digest, so that a damaged file is read.
    arm_file = folder / "identified" / "arm.toml"
    kept = arm_file.read_text("utf-8").splitlines(keepends=True)
    arm_file.write_text(
        "".join(line for line in kept if not line.startswith("covariance_digest"))
    )
    (folder / "identified.toml").write_text(
        (folder / "daemon.toml").read_text().replace("arm.toml", "identified/arm.toml")
    )
    planned = ["--plan", STANDARD, "--out", str(folder / "planned")]
    _run(["verify", *planned, *arm_words])
    filled = folder / "planned" / "campaign.toml"
    filled.write_text(filled.read_text().replace("EXAMPLE", "No. 1"))
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
        _run(words)
    _store(folder)
    values = json.loads((folder / "certificate" / "certificate.json").read_text())
    assert values["digest"]["files"]
    return folder


def _store(folder: Path) -> None:
    database = open_database(str(folder / "store.db"))
    migrate(database)
    store = Store(database, ScanFiles(str(folder / "scans"), "m"))
    store.write([received(message) for message in (*ALL, STATUS, HEALTH, EVENT)])
    add_evidence(database, folder / "history.db")
    database.close()
    # As it is when nobody uses it: in one file.
    with contextlib.closing(sqlite3.connect(folder / "store.db")) as connection:
        connection.execute("PRAGMA journal_mode = DELETE")


def _run(words: list[str]) -> None:
    done = CliRunner().invoke(app, words)
    assert isinstance(done.exception, SystemExit | None), done.exception


async def _steps(folder: Path) -> Path:
    """A recording that can be replayed: a second, and a few points."""
    async with RecordedRun(folder) as run:
        path = await run.recorder.begin("short", "")
        for _ in range(3):
            run.later(0.3)
            run.click()
        run.later(0.5)
        await run.recorder.finish()
    return Path(path)


def _collected(folder: Path) -> None:
    folder.mkdir()
    (folder / "campaign.toml").write_text(CAMPAIGN)
    values = {"angles_rad": [0.1] * 7, "approach": [1] * 7, "speed_rad_s": [0.1] * 7}
    touches = [asdict(replace(touch(number), **values)) for number in range(5)]
    (folder / "collected.jsonl").write_text(
        "".join(f"{json.dumps(line)}\n" for line in [*touches, {"retracts": "s-2"}])
    )


def _page_files(folder: Path) -> None:
    pair = Authority(folder, "ca").sign("localhost")
    shutil.copyfile(pair.certificate, folder / "page.pem")
    shutil.copyfile(pair.key, folder / "key.pem")
    (folder / "token").write_text("a-token-of-twenty-letters\n")
    for name in ("key.pem", "token"):
        (folder / name).chmod(0o600)
