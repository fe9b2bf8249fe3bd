"""Every kind of effect hidden once by the simulator's physics, and found.

Those of `ELSEWHERE` are found in whole diagnoses of other modules here.
"""

import pytest

from benchmarks.blind.hidden.effects import EFFECT_KINDS
from tests.lab.diagnosis.engine_campaigns import decided, hidden, measure

pytestmark = pytest.mark.slow

ELSEWHERE = {
    *("encoder_eccentricity", "encoder_harmonic", "encoder_latency", "backlash"),
    *("joint_compliance", "bearing_compliance", "mount_compliance"),
}


@pytest.mark.parametrize("kind", [k for k in EFFECT_KINDS if k not in ELSEWHERE])
def test_an_effect_is_found_under_its_name_or_an_alias(kind):
    # A bar could not be believed to be so wrong that these poses saw more of it.
    size = 12.0 if kind == "artefact_length" else 25.0
    wrong, diagnosis = hidden(kind, size), decided(kind, size)
    assert diagnosis.verdict in ("named", "tentative")
    term = max(diagnosis.terms, key=lambda term: term.log_bayes_factor)
    keys = wrong.keys
    component = keys["component"] if kind == "axis_runout" else None
    true = (kind, wrong.joint, keys.get("order"), component, keys.get("artefact"))
    named = {term.candidate.identity}
    named |= {rival.candidate.identity for rival in term.alternatives}
    aliases = measure(kind == "artefact_length").names_like(wrong)
    assert named & (aliases | {true})
    if term.status == "named" and len(named) == 1:
        assert named <= aliases | {true}
    assert term.log10_p < -20.0
    if diagnosis.gap.closed is not None:
        assert diagnosis.gap.closed > 0.8
