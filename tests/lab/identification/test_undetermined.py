"""What data do not say is held at the design value and named with its reason.

How many parameters data determine: the counts of the theory.
"""

from dataclasses import replace

import numpy as np
import pytest

from tests.lab.simulated import (
    DESIGN,
    DESIGN_ARM,
    arm_value,
    bar,
    built,
    cones,
    simulate,
)
from traverse.lab.adjustment.prepare import IdentificationError
from traverse.lab.identification.identify import Options, identify

TABLES = [*cones(3), bar()]
EVERYWHERE = np.full(7, np.pi)
QUICK = Options(n_suggestions=0)


def test_cones_alone_leave_the_scale_at_the_design():
    true = replace(built(1), links_mm=built(1).links_mm * 1.002)
    result = identify(simulate(true, cones(4), 50, 5), DESIGN_ARM, QUICK)
    (scale,) = result.undetermined
    assert "add a ball bar" in scale.why
    assert all(".link." in name for name in scale.direction)
    assert result.converged
    size_mm = np.linalg.norm([joint.link_mm for joint in result.arm.joints])
    # No data show that the arm is larger than designed by 2 parts in a thousand.
    assert size_mm == pytest.approx(np.linalg.norm(DESIGN.links_mm), rel=1e-3)


def test_a_probe_on_the_last_axis_is_named():
    links = DESIGN.links_mm.copy()
    links[-1] = [145.0, 0, 0]
    straight = replace(DESIGN, links_mm=links)
    result = identify(simulate(straight, TABLES, 50, 8), arm_value(straight), QUICK)
    assert len(result.undetermined) == 2
    for entry in result.undetermined:
        assert "the probe lies on the axis of J7" in entry.why
        assert any(name.startswith("J7.axis") for name in entry.direction)
    assert result.adjustment.split.n_determined == 25 - 2
    assert result.converged


def test_a_joint_that_did_not_turn_is_named():
    travel = EVERYWHERE.copy()
    travel[4] = 1e-4
    campaign = simulate(built(1), TABLES, 50, 9, travel_rad=travel)
    result = identify(campaign, DESIGN_ARM, QUICK)
    assert 1 <= len(result.undetermined) <= 4
    for entry in result.undetermined:
        assert entry.why.startswith("J5 turned by ")
        assert any(name.startswith("J5.") for name in entry.direction)


def test_a_joint_that_hardly_turned_makes_weak_parameters():
    travel = EVERYWHERE.copy()
    travel[4] = 0.003
    campaign = simulate(built(1), TABLES, 50, 9, travel_rad=travel)
    result = identify(campaign, DESIGN_ARM, QUICK)
    assert result.weak
    worst = result.weak[0]
    assert worst.why.startswith("J5 turned by 0.")
    assert worst.probe_mm > 0.05
    assert [entry.probe_mm for entry in result.weak] == sorted(
        (entry.probe_mm for entry in result.weak), reverse=True
    )


def test_freeing_the_probe_vector_with_the_last_link_is_named():
    campaign = simulate(DESIGN, TABLES, 40, 2)
    options = replace(QUICK, free=("probe.vector.*",))
    result = identify(campaign, DESIGN_ARM, options)
    whys = [entry.why for entry in result.undetermined]
    assert len(whys) == 3
    assert all("hold one of them" in why for why in whys)


def test_too_few_poses_are_named_not_crashed_upon():
    campaign = simulate(DESIGN, [*cones(1), bar()], 6, 2)
    result = identify(campaign, DESIGN_ARM, QUICK)
    assert result.undetermined
    assert any("measure more" in entry.why for entry in result.undetermined)


def test_an_artefact_touched_once_says_nothing_and_harms_nothing():
    # Touches of earlier artefacts are drawn first, whatever comes behind them.
    plain = identify(simulate(DESIGN, TABLES, 40, 3), DESIGN_ARM, QUICK)
    for kind in ("sphere", "plane", "cone"):
        campaign = simulate(DESIGN, [*TABLES, {"id": "once", "kind": kind}], 40, 3)
        last = np.flatnonzero(campaign.poses.artefacts == 4)
        keep = np.ones(len(campaign.poses), bool)
        keep[last[1:]] = False
        result = identify(campaign.part(keep), DESIGN_ARM, QUICK)
        assert result.converged
        assert result.redundancy == plain.redundancy
        assert result.sigma0 == pytest.approx(plain.sigma0, rel=1e-6)


def test_held_parameters_stay_at_the_design():
    campaign = simulate(built(1), TABLES, 40, 2)
    options = replace(QUICK, hold=("J4.*",), snooping=False)
    result = identify(campaign, DESIGN_ARM, options)
    assert not any(entry.name.startswith("J4.") for entry in result.parameters)
    assert result.arm.joints[3].axis == tuple(DESIGN.axes[3])
    assert result.arm.joints[3].link_mm == tuple(DESIGN.links_mm[3])


def test_a_pattern_that_fits_nothing_is_refused():
    campaign = simulate(DESIGN, cones(1), 5, 2)
    with pytest.raises(IdentificationError, match=r"'J9\.\*' fits no parameter"):
        identify(campaign, DESIGN_ARM, Options(hold=("J9.*",)))


def test_another_arms_campaign_is_refused():
    campaign = replace(simulate(DESIGN, cones(1), 5, 2), joint_names=tuple("ABCDEFG"))
    with pytest.raises(IdentificationError, match="take the arm file"):
        identify(campaign, DESIGN_ARM, QUICK)


def test_everything_held_still_tests_the_design():
    campaign = simulate(DESIGN, TABLES, 40, 2)
    result = identify(campaign, DESIGN_ARM, replace(QUICK, hold=("J*", "origin.*")))
    assert result.parameters == ()
    assert result.global_test.passed


def determined(tables, n_each=40, **more):
    campaign = simulate(built(3), tables, n_each, 11)
    result = identify(campaign, DESIGN_ARM, replace(QUICK, snooping=False, **more))
    assert result.converged
    return result


@pytest.mark.parametrize(
    "tables",
    [
        [{"id": f"s{i}", "kind": "sphere"} for i in range(5)],
        [{"id": f"p{i}", "kind": "plane"} for i in range(8)],
    ],
)
def test_surfaces_without_a_length_determine_all_but_the_scale(tables):
    # The probe's radius is no length where the surface is unknown.
    result = determined(tables, 60)
    assert result.adjustment.split.n_determined == 4 * 7 - 4
    assert "no length" in result.undetermined[0].why


def test_points_with_a_scale_of_their_own_give_no_length():
    table = {
        "id": "net",
        "kind": "points",
        "frame": "own_scaled",
        "points_mm": {"A": [0.0, 0, 0], "B": [200.0, 0, 0], "C": [0.0, 150, 0]},
        "true_scale": 1.003,
    }
    result = determined([table, *cones(3)], 60)
    assert result.adjustment.split.n_determined == 4 * 7 - 4


def test_redundancy_counts_equations_less_unknowns():
    result = determined([*cones(3), bar()])
    equations = 3 * 3 * 40 + 40 + 3  # three certified lengths
    assert result.redundancy == equations - 3 * 3 - 8 - 25
