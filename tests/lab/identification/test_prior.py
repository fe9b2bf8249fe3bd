"""A family as prior: against normal equations written out, on drawn arms, by name."""

import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from benchmarks.proofs.conditions import demo_arm
from benchmarks.tools.handover import campaign_from_simulation
from tests.running import invoke
from traverse.kinematics.arm_file.arm import arm_digest, read_arm, write_arm
from traverse.lab.adjustment.prepare import IdentificationError
from traverse.lab.campaign.prior import Prior, read_prior
from traverse.lab.certificates.evidence import add_data, evidence_problems
from traverse.lab.diagnosis.model.observation_equations import equations_of
from traverse.lab.identification.family import population_of
from traverse.lab.identification.identify import Options, identify
from traverse.lab.identification.results.arm_comparison import compare_arms
from traverse.simulator.arm.truth import Deviations, true_arm
from traverse.simulator.campaigns import (
    BallBar,
    CampaignSpec,
    Cone,
    draw_noise,
    make_poses,
    true_arm_file,
    write_campaign,
)
from traverse.strict_toml.problems import FileError

OFFSETS = Deviations(links_mm=0.5, axes_rad=2e-3, zeros_rad=2e-3)
SPREAD = Deviations(links_mm=0.03, axes_rad=1e-4, zeros_rad=1e-4)
QUICK = Options(n_suggestions=0)
N_ARMS = 12


def measured(seed, n_poses, deviations=SPREAD):
    """Measure an arm of the family: cones and a bar."""
    design = demo_arm()
    typical = true_arm_file(design, true_arm(design, OFFSETS, 7))
    spec = CampaignSpec(
        artefacts=(
            *(Cone(id=f"cone-{k}", n_poses=n_poses // 6) for k in range(3)),
            BallBar(id="bar", n_poses=n_poses // 2, radius_mm=12.7, distance_mm=500.0),
        )
    )
    poses = make_poses(design, spec, seed, true_arm(typical, deviations, seed))
    return draw_noise(poses, seed)


def campaign_of(seed, n_poses, deviations=SPREAD):
    return campaign_from_simulation(measured(seed, n_poses, deviations).campaign)


@cache
def member(seed):
    """An arm of the family, identified from a long campaign."""
    return identify(campaign_of(seed, 240), demo_arm(), QUICK)


@cache
def family():
    """Twelve arms of it."""
    members = [member(seed) for seed in range(N_ARMS)]
    names = tuple(parameter.name for parameter in members[0].parameters)
    values, stds = (
        np.array([[getattr(p, key) for p in arm.parameters] for arm in members])
        for key in ("value", "std")
    )
    populations = [
        population_of(values[:, k], stds[:, k], 0.01 / values.size)
        for k in range(len(names))
    ]
    means, of_one_more = (
        np.array([getattr(population, key) for population in populations])
        for key in ("mean", "std")
    )
    return Prior("family.toml", demo_arm(), N_ARMS, names, means, of_one_more, names)


@pytest.mark.slow
def test_it_is_the_least_squares_of_poses_and_expectations():
    """Around the result of both the step of the stacked normal equations is none."""
    prior = family()
    result = identify(replace(campaign_of(50, 36), prior=prior), demo_arm())
    assert result.converged
    rows = equations_of(result.adjustment)
    # Its last rows are the family's: written out here from the estimates.
    estimates = {parameter.name: parameter.value for parameter in result.parameters}
    expected = [
        (mean - estimates[name]) / std
        for name, mean, std in zip(prior.names, prior.changes, prior.stds, strict=True)
    ]
    # Coordinates at the estimate, not at the design: equal to the second order.
    np.testing.assert_allclose(rows.values[-len(expected) :], expected, atol=0.05)
    step = np.linalg.lstsq(rows.columns, rows.values)[0]
    assert np.linalg.norm(rows.columns @ step) < 0.02
    n_poses_alone = len(rows.values) - len(expected)
    assert result.redundancy == n_poses_alone + len(expected) - np.linalg.matrix_rank(
        rows.columns, tol=0.02
    )


@pytest.mark.slow
def test_a_few_poses_are_enough_with_a_family_and_its_figures_hold():
    """With 24 poses of most arms little is known; the family tells the rest."""
    assert len(identify(campaign_of(60, 24), demo_arm(), QUICK).undetermined) > 0
    z = []
    for seed in range(60, 66):
        few_poses = replace(campaign_of(seed, 24), prior=family())
        result = identify(few_poses, demo_arm(), QUICK)
        assert not result.campaign.prior.contradicted
        assert len(result.undetermined) == 0
        true = identify(campaign_of(seed, 240), demo_arm(), QUICK)
        z += [
            (estimate.value - known.value) / np.hypot(estimate.std, known.std)
            for estimate, known in zip(result.parameters, true.parameters, strict=True)
        ]
    # 150 figures, correlated within an arm.
    assert 0.5 < float(np.sqrt(np.mean(np.square(z)))) < 1.4


def test_many_poses_hardly_notice_it():
    campaign = campaign_of(80, 240)
    without_family = identify(campaign, demo_arm(), QUICK)
    result = identify(replace(campaign, prior=family()), demo_arm(), QUICK)
    # At the probe: parts of links along their axes, which nothing measures, may differ.
    true = true_arm_file(demo_arm(), measured(80, 240).truth.arm)
    off_mm = compare_arms(without_family.arm, true).rms_mm
    assert compare_arms(without_family.arm, result.arm).rms_mm < 0.3 * off_mm
    for without, with_family in zip(
        without_family.parameters, result.parameters, strict=True
    ):
        assert with_family.std <= without.std * 1.01


def test_who_left_the_family_in_one_parameter_keeps_the_others():
    prior = family()
    at = prior.names.index("J4.link.w")
    moved = prior.changes.copy()
    moved[at] += 1.0
    odd = replace(prior, changes=moved)
    result = identify(replace(campaign_of(81, 48), prior=odd), demo_arm())
    (name, sigmas), *further = result.campaign.prior.contradicted
    assert (name, further) == ("J4.link.w", [])
    assert sigmas > 8.0
    plain = identify(
        replace(campaign_of(81, 48), prior=prior.without("J4.link.w", 0.0)), demo_arm()
    )
    assert result.parameters == plain.parameters


@pytest.mark.slow
def test_a_stranger_is_none_of_the_family_and_judged_by_its_poses():
    campaign = campaign_of(82, 48, OFFSETS)
    result = identify(replace(campaign, prior=family()), demo_arm(), QUICK)
    assert result.campaign.prior.names == ()
    assert len(result.campaign.prior.contradicted) > 4
    without_family = identify(campaign, demo_arm(), QUICK)
    for without, judged in zip(
        without_family.parameters, result.parameters, strict=True
    ):
        assert without.value == pytest.approx(judged.value, abs=0.01 * without.std)


def test_other_held_parameters_are_refused():
    campaign = replace(campaign_of(83, 48), prior=family())
    with pytest.raises(IdentificationError, match=r"J7\.axis\.v"):
        identify(campaign, demo_arm(), Options(hold=("J7.*",)))


# The commands.


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A design, results of its family, the family's file, and a short campaign."""
    folder = tmp_path_factory.mktemp("family")
    write_arm(folder / "design.toml", demo_arm())
    for seed in range(8):
        identified = member(seed)
        results = folder / "results" / f"bench-{seed}"
        results.mkdir(parents=True)
        values = {
            "schema": "traverse/identification/1",
            "converged": True,
            "inputs": {"arm_digest": arm_digest(read_arm(folder / "design.toml"))},
            "parameters": [
                {"name": p.name, "value": p.value, "unit": p.unit, "std": p.std}
                for p in identified.parameters
            ],
        }
        (results / "identification.json").write_text(json.dumps(values))
    invoke(
        *("fleet", "family", *sorted((folder / "results").iterdir())),
        *("--out", folder / "family.toml"),
    )
    write_campaign(folder / "short", measured(50, 36), demo_arm())
    return folder


@pytest.mark.slow
def test_the_commands_take_a_family_and_say_so(folder):
    arguments = (folder / "short", "--arm", folder / "design.toml")
    family = ("--family", folder / "family.toml")
    ran = invoke("identify", *arguments, *family, "--out", folder / "out", "--json")
    of_family = json.loads(ran.stdout)["family"]
    assert (of_family["file"], of_family["arms"], of_family["contradicted"]) == (
        "family.toml",
        8,
        [],
    )
    assert len(of_family["parameters"]) == 25
    ran = invoke(
        "identify", *arguments, *family, "--prior", "J3.*", "--out", folder / "out3"
    )
    assert "Family family.toml (8 arms): 2 parameters taken as its arms have them." in (
        ran.output
    )
    page = (folder / "out3" / "report.html").read_text()
    assert "Family family.toml (8 arms)" in page
    ran = invoke("diagnose", *arguments, *family, "--out", folder / "found", "--json")
    assert json.loads(ran.stdout)["family"]["arms"] == 8
    ran = invoke("diagnose", *arguments, *family, "--plan")


@pytest.mark.slow
def test_what_a_family_told_is_no_evidence_of_the_arm_alone(folder):
    out = folder / "evidence"
    arguments = (folder / "short", "--arm", folder / "design.toml", "--out", out)
    invoke("identify", *arguments, "--family", folder / "family.toml")
    add_data(out, folder / "short", folder / "design.toml")
    assert list(evidence_problems(out)) == [
        "what its family says took part; identify from its own poses alone"
    ]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("schema = 'traverse/family/2'\n", "schema: 'traverse/family/2'"),
        ("a = [", "family.toml"),
        (None, "std: 0.0 is too small; it must be greater than 0"),
    ],
)
def test_a_wrong_file_is_refused_in_words(folder, tmp_path, text, message):
    if text is None:
        lines = (folder / "family.toml").read_text().splitlines()
        place = next(n for n, line in enumerate(lines) if line.startswith("std"))
        lines[place] = "std = 0.0"
        text = "\n".join(lines)
    file = tmp_path / "family.toml"
    file.write_text(text)
    arguments = (
        folder / "short",
        "--arm",
        folder / "design.toml",
        "--out",
        tmp_path / "o",
    )
    ran = invoke("identify", *arguments, "--family", file, status=2)
    assert message in ran.output, ran.output
    assert "Traceback" not in ran.output


def test_another_design_and_unknown_patterns_are_refused(folder):
    design = read_arm(folder / "design.toml")
    other = design.model_copy(update={"name": "another"})
    with pytest.raises(FileError, match="identified from another design"):
        read_prior(folder / "family.toml", other)
    with pytest.raises(FileError, match=r"'J9\.\*' fits no parameter; there are J1"):
        read_prior(folder / "family.toml", design, ("J9.*",))
    arguments = (
        folder / "short",
        "--arm",
        folder / "design.toml",
        "--out",
        folder / "o",
    )
    ran = invoke("identify", *arguments, "--prior", "J3.*", status=2)
    assert "give --family, too" in ran.output
