"""What data do not say is held at the design value and named with its reason."""

from dataclasses import replace

import numpy as np
import pytest

from tests.lab.simulated import (
    arm_value,
    bar,
    cones,
    disturbed,
    seven_joints,
    simulate,
)
from traverse.lab.identification.identify import IdentificationError, Options, identify

TABLES = [*cones(3), bar()]
EVERYWHERE = np.full(7, np.pi)


def test_cones_alone_leave_the_scale_at_the_design():
    design = seven_joints()
    true = replace(disturbed(design, 1), links_mm=disturbed(design, 1).links_mm * 1.002)
    result = identify(simulate(true, cones(4), 50, 5), arm_value(design))
    (scale,) = result.undetermined
    assert "add a ball bar" in scale.why
    assert all(".link." in name for name in scale.direction)
    assert result.converged
    found = np.linalg.norm([joint.link_mm for joint in result.arm.joints])
    # No data show that the arm is larger than designed by 2 parts in a thousand.
    assert found == pytest.approx(np.linalg.norm(design.links_mm), rel=1e-3)


def test_a_probe_on_the_last_axis_is_named():
    design = seven_joints()
    links = design.links_mm.copy()
    links[-1] = [145.0, 0, 0]
    straight = replace(design, links_mm=links)
    result = identify(simulate(straight, TABLES, 50, 8), arm_value(straight))
    assert len(result.undetermined) == 2
    for entry in result.undetermined:
        assert "the probe lies on the axis of J7" in entry.why
        assert any(name.startswith("J7.axis") for name in entry.direction)
    assert result.adjustment.split.n_determined == 25 - 2
    assert result.converged


def test_a_joint_that_did_not_turn_is_named():
    design = seven_joints()
    travel = EVERYWHERE.copy()
    travel[4] = 1e-4
    campaign = simulate(disturbed(design, 1), TABLES, 50, 9, travel_rad=travel)
    result = identify(campaign, arm_value(design))
    assert 1 <= len(result.undetermined) <= 4
    for entry in result.undetermined:
        assert entry.why.startswith("J5 turned by ")
        assert any(name.startswith("J5.") for name in entry.direction)


def test_a_joint_that_hardly_turned_makes_weak_parameters():
    design = seven_joints()
    travel = EVERYWHERE.copy()
    travel[4] = 0.003
    campaign = simulate(disturbed(design, 1), TABLES, 50, 9, travel_rad=travel)
    result = identify(campaign, arm_value(design))
    assert result.weak
    worst = result.weak[0]
    assert worst.why.startswith("J5 turned by 0.")
    assert worst.probe_mm > 0.05
    assert [entry.probe_mm for entry in result.weak] == sorted(
        (entry.probe_mm for entry in result.weak), reverse=True
    )


def test_freeing_the_probe_vector_with_the_last_link_is_named():
    design = seven_joints()
    campaign = simulate(design, TABLES, 40, 2)
    options = Options(free=("probe.vector.*",))
    result = identify(campaign, arm_value(design), options)
    whys = [entry.why for entry in result.undetermined]
    assert len(whys) == 3
    assert all("hold one of them" in why for why in whys)


def test_too_few_poses_are_named_not_crashed_upon():
    design = seven_joints()
    campaign = simulate(design, [*cones(1), bar()], 6, 2)
    result = identify(campaign, arm_value(design))
    assert result.undetermined
    assert any("measure more" in entry.why for entry in result.undetermined)


@pytest.mark.parametrize("kind", ["sphere", "plane", "cone"])
def test_an_artefact_touched_once_says_nothing_and_harms_nothing(kind):
    design = seven_joints()
    campaign = simulate(design, [*TABLES, {"id": "once", "kind": kind}], 40, 3)
    last = np.flatnonzero(campaign.poses.artefacts == 4)
    keep = np.ones(len(campaign.poses), bool)
    keep[last[1:]] = False
    result = identify(campaign.part(keep), arm_value(design))
    plain = identify(campaign.part(campaign.poses.artefacts < 4), arm_value(design))
    assert result.converged
    assert result.redundancy == plain.redundancy
    assert result.sigma0 == pytest.approx(plain.sigma0, rel=1e-6)


def test_held_parameters_stay_at_the_design():
    design = seven_joints()
    campaign = simulate(disturbed(design, 1), TABLES, 40, 2)
    options = Options(hold=("J4.*",), snooping=False)
    result = identify(campaign, arm_value(design), options)
    assert not any(entry.name.startswith("J4.") for entry in result.parameters)
    assert result.arm.joints[3].axis == tuple(design.axes[3])
    assert result.arm.joints[3].link_mm == tuple(design.links_mm[3])


def test_a_pattern_that_fits_nothing_is_refused():
    design = seven_joints()
    campaign = simulate(design, cones(1), 5, 2)
    with pytest.raises(IdentificationError, match=r"'J9\.\*' fits no parameter"):
        identify(campaign, arm_value(design), Options(hold=("J9.*",)))


def test_another_arms_campaign_is_refused():
    design = seven_joints()
    campaign = replace(simulate(design, cones(1), 5, 2), joint_names=tuple("ABCDEFG"))
    with pytest.raises(IdentificationError, match="take the arm file"):
        identify(campaign, arm_value(design))


def test_everything_held_still_tests_the_design():
    design = seven_joints()
    campaign = simulate(design, TABLES, 40, 2)
    result = identify(campaign, arm_value(design), Options(hold=("J*", "origin.*")))
    assert result.parameters == ()
    assert result.global_test.passed
