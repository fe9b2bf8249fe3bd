import struct

import numpy as np
import pytest

from tests.kinematics.arms import ARM_TEXT, random_geometry
from tests.running import invoke
from traverse.kinematics.importers.arm_values import JointParts, assemble_arm

picture = pytest.importorskip(
    "traverse.lab.report.arm_picture", reason="needs the extra lab"
)


def size_of_png(path):
    """Width and height in the file's first chunk."""
    content = path.read_bytes()
    assert content[:8] == b"\x89PNG\r\n\x1a\n"
    return struct.unpack(">II", content[16:24])


def test_show_draws_the_base_posture_beside_the_text(tmp_path):
    file, png = tmp_path / "arm.toml", tmp_path / "arm.png"
    file.write_text(ARM_TEXT, "utf-8")
    words = ["arm", "show", str(file), "--png", str(png)]
    ended = invoke(*words)
    assert ended.stdout.startswith("bench-7: 2 joints")
    width, height = size_of_png(png)
    assert width == 1430
    assert height > 400


def test_a_picture_that_cannot_be_written_is_refused(tmp_path):
    file = tmp_path / "arm.toml"
    file.write_text(ARM_TEXT, "utf-8")
    words = ["arm", "show", str(file), "--png", str(tmp_path / "no" / "arm.png")]
    ended = invoke(*words, status=2)
    assert f"there is no folder {tmp_path / 'no'}; make it" in ended.output


@pytest.mark.parametrize("n_joints", [1, 7])
def test_an_arm_without_any_symmetry_is_drawn(tmp_path, n_joints):
    names = [f"J{k}" for k in range(n_joints)]
    skew = assemble_arm(
        "skew",
        random_geometry(3, n_joints),
        [JointParts(name, None, 1, "base/0") for name in names],
        "skew",
        radius_mm=2.0,
    )
    picture.draw_base_posture(skew, tmp_path / "skew.png")
    assert np.all(np.array(size_of_png(tmp_path / "skew.png")) > 400)
