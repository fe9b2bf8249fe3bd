import asyncio
import json
import threading
import uuid

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.client.virtual_daemon import VirtualDaemon
from tests.lab.report.pages import Page
from tests.lab.uncertain_arm import write_uncertain_arm
from tests.protocol.message_examples import POINT
from tests.running import invoke
from traverse.kinematics.arm_file.arm import arm_digest, read_arm
from traverse.kinematics.effects.arm_effects import effects_from_arm
from traverse.kinematics.effects.base.block import Block
from traverse.kinematics.helmert.transformation import Helmert
from traverse.kinematics.model.forward import probe_pose
from traverse.kinematics.model.geometry import geometry_from_arm
from traverse.kinematics.uncertainty.arm_covariance import (
    parameter_columns,
    read_parameter_covariance,
)
from traverse.protocol.encoding import encode
from traverse.protocol.messages import AlignArgs
from traverse.protocol.messages.point import Label
from traverse.simulator.campaigns import NoiseTable, write_campaign
from traverse.simulator.campaigns.acceptance.poses import (
    acceptance_poses,
    drawn_acceptance,
)

TRUE = Helmert(
    Rotation.from_euler("xyz", [0.1, 0.2, 2.0]).as_matrix(),
    np.array([100.0, -200.0, 50.0]),
)
NOMINAL = np.array(
    [[0.0, 0, 0], [800, 0, 50], [800, 500, 0], [0, 500, 200], [400, 200, 100]]
)
NOISE_MM = 0.01


def align(*words, status=0):
    return invoke("align", *words, status=status)


def measured(transformation=TRUE, seed=1, places=NOMINAL):
    noise = np.random.default_rng(seed).normal(0.0, NOISE_MM, places.shape)
    return transformation.inverse().places_mm(places) + noise


def table(path, places):
    rows = [f"P{n},{x!r},{y!r},{z!r}" for n, (x, y, z) in enumerate(places.tolist())]
    path.write_text("\n".join(["name,x_mm,y_mm,z_mm", *rows]) + "\n")
    return path


def lines(path, places, arm="bench-7"):
    messages = [
        POINT.model_copy(
            update={
                "seq": n,
                "id": f"s-{n}",
                "arm": arm,
                "xyz_mm": tuple(place),
                "label": Label(artefact="part", feature=f"P{n}"),
            }
        )
        for n, place in enumerate(places.tolist())
    ]
    undone = messages[-1].model_copy(
        update={"id": "wrong", "seq": 99, "xyz_mm": (0.0, 0.0, 0.0)}
    )
    taken_back = undone.retraction(
        seq=100, point_id="back", trigger="command", time_ns=undone.time_ns
    )
    path.write_bytes(
        b"\n".join(encode(m, "json") for m in [*messages, undone, taken_back])
    )
    return path


@pytest.fixture
def files(tmp_path):
    return table(tmp_path / "m.csv", measured()), table(tmp_path / "n.csv", NOMINAL)


def test_a_table_is_aligned_and_everything_written(files, tmp_path):
    points, nominal = files
    out = tmp_path / "out"
    text = align(points, "--nominal", nominal, "--std", 0.01, "-o", out).stdout
    assert "global test passed" in text
    values = json.loads((out / "alignment.json").read_text())
    np.testing.assert_allclose(
        values["alignment"]["rotation"], TRUE.rotation, atol=1e-4
    )
    assert values["schema"] == "traverse/alignment/1"
    assert values["redundancy"] == 9
    assert len(values["points"]) == 5
    page = (out / "alignment.html").read_text()
    Page(page).check_is_self_contained()
    assert page.count("data:image/png") == 2
    assert "Quality" in page
    repeated = align(points, "--nominal", nominal, "--std", 0.01, "--json").stdout
    assert json.loads(repeated)["alignment"] == values["alignment"]


def test_points_bring_covariances_names_and_arm(files, tmp_path):
    points = lines(tmp_path / "p.jsonl", measured())
    values = json.loads(align(points, "--nominal", files[1], "--json").stdout)
    assert values["arm"] == POINT.arm
    assert values["errors_stated"]
    assert values["sigma0"] > 0.0
    assert [p["name"] for p in values["points"]] == [f"P{n}" for n in range(5)]
    assert any("carry flags" in remark for remark in values["remarks"])


@pytest.mark.parametrize(("changed", "is_flagged"), [("P1", True), ("bore", False)])
def test_centres_of_different_balls_are_flagged(files, tmp_path, changed, is_flagged):
    names = [*(f"P{n}" for n in range(5)), "bore"]  # which is not aligned
    radii_mm = [1.5 if name == changed else 3.0 for name in names]
    places = [*measured().tolist(), [1.0, 2.0, 3.0]]
    rows = [
        f"{name},{x},{y},{z},{radius_mm}"
        for name, (x, y, z), radius_mm in zip(names, places, radii_mm, strict=True)
    ]
    points = tmp_path / "two.csv"
    points.write_text("\n".join(["name,x_mm,y_mm,z_mm,probe_radius_mm", *rows]))
    words = (points, "--nominal", files[1], "--std", 0.01, "--json")
    values = json.loads(align(*words).stdout)
    flags = {flag["code"]: flag["text"] for flag in values["flags"]}
    assert ("different_balls" in flags) == is_flagged
    assert not is_flagged or "of 1.5 to 3 mm radius" in flags["different_balls"]


def test_a_failed_test_is_exit_status_1_and_strict_looks_at_flags(files):
    points, nominal = files
    align(points, "--nominal", nominal, "--std", 0.0001, status=1)
    align(points, "--nominal", nominal, "--std", 0.01, "--strict")
    align(points, "--nominal", nominal)
    align(points, "--nominal", nominal, "--strict", status=4)


def test_points_that_determine_nothing_are_refused(files, tmp_path):
    few = table(tmp_path / "few.csv", measured()[:2])
    refused = align(few, "--nominal", files[1], status=2)
    assert "2 common points on one line: the rotation about it" in refused.output
    none = tmp_path / "none.csv"
    none.write_text("name,x_mm,y_mm,z_mm\nX,1,2,3\n")
    assert "no common points" in align(none, "--nominal", files[1], status=2).output


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (
            ["--method", "worst-fit"],
            "'worst-fit' is not one of 'best-fit', '3-2-1', 'leapfrog'",
        ),
        (["--std", "-1"], "above zero"),
        (["--coordinates", "middle"], "'middle' is not one of 'centre', 'surface'"),
        (["--volume", "somewhere"], "six numbers"),
        (["--volume", "reach"], "--arm FILE"),
        (["--method", "3-2-1"], "3-2-1 needs [plane], [line], [point]"),
        (["--coordinates", "surface"], "surface_x_mm"),
    ],
)
def test_options_that_cannot_be_are_refused(files, words, expected):
    assert expected in align(files[0], "--nominal", files[1], *words, status=2).output


def test_a_volume_is_all_that_the_arm_reaches(files):
    arm = "cli/demo_data/arm.toml"
    options = ["--arm", arm, "--volume", "reach", "--std", 0.01, "--json"]
    values = json.loads(align(files[0], "--nominal", files[1], *options).stdout)
    volume = values["quality"]["volume"]
    assert volume["kind"] == "ball"
    assert values["quality"]["index"]["max"] > values["quality"]["index"]["rms"]


def test_a_leapfrog_onto_an_alignment_leads_to_the_part(files, tmp_path):
    points, nominal = files
    out = tmp_path / "first"
    align(points, "--nominal", nominal, "--std", 0.01, "--name", "part", "-o", out)
    moved = Helmert(
        Rotation.from_euler("xyz", [0.0, 0.1, -1.0]).as_matrix(),
        np.array([-300.0, 900.0, 10.0]),
    )
    second = table(
        tmp_path / "second.csv", measured(moved, seed=2, places=measured(seed=1))
    )
    options = ["--nominal", points, "--method", "leapfrog", "--std", 0.01]
    second_alone = json.loads(align(second, *options, "--json").stdout)
    np.testing.assert_allclose(
        second_alone["alignment"]["rotation"], moved.rotation, atol=1e-4
    )
    combined = json.loads(align(second, *options, "--onto", out, "--json").stdout)
    true = TRUE.after(moved)
    np.testing.assert_allclose(
        combined["alignment"]["rotation"], true.rotation, atol=1e-4
    )
    np.testing.assert_allclose(
        combined["alignment"]["translation_mm"], true.translation_mm, atol=0.1
    )
    assert combined["alignment"]["name"] == "part"
    first = json.loads((out / "alignment.json").read_text())
    pairs = zip(combined["covariance"]["std"], first["covariance"]["std"], strict=True)
    assert all(a > b for a, b in pairs)


@pytest.mark.needs("mosquitto")
def test_a_file_is_sent_later_or_at_once(files, tmp_path, mosquitto):
    points, nominal = files
    out = tmp_path / "out"
    align(points, "--nominal", nominal, "--std", 0.01, "--name", "part", "-o", out)
    values = json.loads((out / "alignment.json").read_text())
    expected = AlignArgs.model_validate_json(json.dumps(values["alignment"]))
    name = f"arm-{uuid.uuid4().hex[:8]}"
    broker = f"{mosquitto.host}:{mosquitto.port}"
    to = ["--send", "--arm-name", name, "--broker", broker]
    virtual = VirtualDaemon(name, mosquitto.host, mosquitto.port)
    loop = asyncio.new_event_loop()
    thread = threading.Thread(target=loop.run_forever)
    thread.start()

    def do(work):
        return asyncio.run_coroutine_threadsafe(work, loop).result(20.0)

    def aligned():
        return [args for args in virtual.commands if isinstance(args, AlignArgs)]

    life = virtual.running()
    do(life.__aenter__())
    try:
        align(out, *to)
        assert aligned() == [expected]
        options = ["--nominal", nominal, "--std", 0.01, "--name", "part"]
        align(points, *options, *to)
        assert aligned() == [expected, expected]
        # Nothing that failed a test is sent.
        align(points, "--nominal", nominal, "--std", 0.0001, *to, status=1)
        assert len(aligned()) == 2
    finally:
        do(life.__aexit__(None, None, None))
        do(loop.shutdown_default_executor())
        loop.call_soon_threadsafe(loop.stop)
        thread.join()
        loop.close()


def test_what_cannot_be_sent_is_reported(files, tmp_path):
    points, nominal = files
    out = tmp_path / "out"
    align(points, "--nominal", nominal, "--std", 0.01, "-o", out)
    assert "--arm-name" in align(out, "--send", status=2).output
    assert "--nominal missing" in align(out, status=2).output
    assert "is no alignment" in align(nominal, "--send", status=2).output
    nowhere = ["--send", "--arm-name", "x", "--broker", "localhost:1"]
    assert "start it" in align(out, *nowhere, status=3).output


def test_plane_line_and_point_of_a_table(tmp_path):
    nominal = tmp_path / "part.toml"
    nominal.write_text(
        'schema = "traverse/nominal/1"\nname = "bracket"\n'
        '[plane]\nfeature = "top"\npoint_mm = [0, 0, 0]\nnormal = [0, 0, 1]\n'
        '[line]\nfeature = "front"\npoint_mm = [0, 0, 0]\ndirection = [1, 0, 0]\n'
        '[point]\nfeature = "left"\npoint_mm = [0, 0, 0]\n'
        "[volume]\nmin_mm = [0, 0, -50]\nmax_mm = [300, 200, 0]\n"
    )
    places = {
        "top": [(0, 0, 0), (300, 0, 0), (300, 200, 0), (0, 200, 0)],
        "front": [(10, 0, -10), (150, 0, -10), (290, 0, -10)],
        "left": [(0, 100, -10)],
    }
    down = TRUE.rotation.T @ [0.0, 0.0, -1.0]
    rows = ["name,x_mm,y_mm,z_mm,i,j,k"]
    for name, group in places.items():
        for place in TRUE.inverse().places_mm(np.array(group, dtype=float)):
            cells = [*place.tolist(), *down.tolist()]
            rows.append(",".join([name, *map(repr, cells)]))
    points = tmp_path / "points.csv"
    points.write_text("\n".join(rows) + "\n")
    out = tmp_path / "out"
    options = ["--method", "3-2-1", "--std", 0.02, "-o", out]
    text = align(points, "--nominal", nominal, *options).stdout
    assert "left: residual +0.0000 +0.0000 +0.0000 mm; no error" in text
    values = json.loads((out / "alignment.json").read_text())
    np.testing.assert_allclose(
        values["alignment"]["rotation"], TRUE.rotation, atol=1e-9
    )
    assert values["alignment"]["name"] == "bracket"
    assert [f["redundancy"] for f in values["features"]] == [1, 1, 0]
    assert "Errors in the volume" in (out / "alignment.html").read_text()
    expected = ["--nominal", nominal, "--method", "3-2-1", "--scale"]
    assert "--scale" in align(points, *expected, status=2).output


def test_a_campaign_is_a_source_and_spheres_touched_all_around_are_no_points(tmp_path):
    arm = read_arm("cli/demo_data/arm.toml")
    folder = tmp_path / "campaign"
    poses = acceptance_poses(arm, "asme-b89.4.22", seed=1)
    write_campaign(folder, drawn_acceptance(poses, seed=1), arm)
    arguments = [folder, "--nominal", folder, "--method", "leapfrog", "--std", 0.02]
    arguments += ["--arm", folder / "arm.toml", "--json"]
    values = json.loads(align(*arguments).stdout)
    np.testing.assert_allclose(values["alignment"]["rotation"], np.eye(3), atol=1e-12)
    flags = {flag["code"]: flag["text"] for flag in values["flags"]}
    assert "diameter/1 (14" in flags["scattered_touches"]
    assert values["arm"] == arm.name
    align(*arguments[:-3], status=2)


@pytest.fixture(scope="module")
def same_arm(tmp_path_factory):
    """Points of six places with their angles, by one arm of its file."""
    folder = tmp_path_factory.mktemp("same_arm")
    path = write_uncertain_arm(folder, 0.02, 1e-5)
    arm = read_arm(path)
    rng = np.random.default_rng(6)
    angles_rad = rng.uniform(-1.0, 1.0, (6, len(arm.joints)))
    places, _ = probe_pose(geometry_from_arm(arm), angles_rad)
    shared_mm = shared_errors(path, arm, angles_rad)
    total = shared_mm @ shared_mm.transpose(0, 2, 1) + 0.01**2 * np.eye(3)
    upper = total[:, [0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]]
    measured_mm = places + shared_mm @ rng.normal(size=shared_mm.shape[2])
    measured_mm += rng.normal(0.0, 0.01, (6, 3))
    messages = [
        POINT.model_copy(
            update={
                "seq": n,
                "id": f"s-{n}",
                "arm": "bench-7",
                "model": arm_digest(arm),
                "xyz_mm": tuple(place),
                "angles_rad": tuple(angles_rad[n]),
                "counts": (0,) * len(arm.joints),
                "covariance_mm2": tuple(upper[n]),
                "temperature_c": None,
                "label": Label(artefact="part", feature=f"P{n}"),
            }
        )
        for n, place in enumerate(measured_mm.tolist())
    ]
    (folder / "points.jsonl").write_bytes(
        b"\n".join(encode(m, "json") for m in messages)
    )
    table(folder / "nominal.csv", TRUE.places_mm(places))
    return folder


def shared_errors(path, arm, angles_rad):
    effects = effects_from_arm(arm)
    known = read_parameter_covariance(path, arm, effects, effects)
    columns, _ = parameter_columns(geometry_from_arm(arm), effects, Block(angles_rad))
    return columns @ known.factor


def test_errors_of_the_arm_are_common_to_its_points(same_arm):
    arguments = [
        same_arm / "points.jsonl",
        "--nominal",
        same_arm / "nominal.csv",
        "--json",
    ]
    apart = json.loads(align(*arguments).stdout)
    together = json.loads(align(*arguments, "--arm", same_arm / "arm.toml").stdout)
    assert any(
        "as each point's own: the arm file is not" in r for r in apart["remarks"]
    )
    assert any(r.endswith("what they are: common to all") for r in together["remarks"])
    assert together["global_test"]["passed"]
    assert 0.6 < together["sigma0"] < 1.5
    # Residuals show less of an error that is common than of one that is each point's.
    assert together["sigma0"] > apart["sigma0"]
    assert (
        together["points"][0]["detectable_mm"]["best"]
        < 0.8 * (apart["points"][0]["detectable_mm"]["best"])
    )


def test_points_of_another_arm_file_share_nothing_and_it_is_told(same_arm, tmp_path):
    text = (same_arm / "arm.toml").read_text()
    (tmp_path / "arm.toml").write_text(text.replace("220.0", "220.5", 1))
    assert (tmp_path / "arm.toml").read_text() != text
    arguments = [
        same_arm / "points.jsonl",
        "--nominal",
        same_arm / "nominal.csv",
        "--json",
    ]
    values = json.loads(align(*arguments, "--arm", tmp_path / "arm.toml").stdout)
    assert any("were not taken with" in remark for remark in values["remarks"])


def test_a_leapfrog_of_one_arm_knows_what_both_stations_share(same_arm):
    points = same_arm / "points.jsonl"
    arguments = [points, "--nominal", points, "--method", "leapfrog", "--json"]
    apart = json.loads(align(*arguments).stdout)
    together = json.loads(align(*arguments, "--arm", same_arm / "arm.toml").stdout)
    # The same postures again: what the arm is off is off in both.
    assert np.sum(np.square(together["covariance"]["std"][:3])) == pytest.approx(
        2.0 * 3.0 * 0.01**2 / 6.0, rel=0.02
    )
    assert together["covariance"]["std"][0] < 0.5 * apart["covariance"]["std"][0]


def test_a_campaign_with_noise_states_its_errors(same_arm, tmp_path):
    arm = read_arm(same_arm / "arm.toml")
    folder = tmp_path / "campaign"
    poses = acceptance_poses(arm, "vdi2617-9", seed=1, noise=NoiseTable())
    write_campaign(folder, drawn_acceptance(poses, seed=1), arm)
    arguments = [folder, "--nominal", folder, "--method", "leapfrog", "--json"]
    values = json.loads(align(*arguments, "--arm", same_arm / "arm.toml").stdout)
    assert values["errors_stated"]
    text = (folder / "campaign.toml").read_text()
    (folder / "campaign.toml").write_text(text.replace("encoder_rad", "# encoder_rad"))
    values = json.loads(align(*arguments, "--arm", same_arm / "arm.toml").stdout)
    assert not values["errors_stated"]
    assert any("no errors stated: campaign.toml" in r for r in values["remarks"])
