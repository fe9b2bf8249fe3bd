"""The kernel in C with the effects of an arm, where it runs.

What it computes is what `pose.py` computes by NumPy: the two agree within the last
digits, and each of them gives a sample the same bits in whatever block it comes.
"""

from dataclasses import fields, replace
from functools import lru_cache
from typing import Any

from traverse.arrays import Floats
from traverse.kinematics.effects.arm_effects import ArmEffects
from traverse.kinematics.effects.base.block import Block
from traverse.kinematics.kernel.choice import KERNEL, aligned_floats, compiled_chain
from traverse.kinematics.model.geometry import Geometry

if KERNEL != "numpy":
    from traverse.kinematics.kernel.compiled import DeflectedChain


_KG_M_PER_KG_MM = 1e-3


def compiled_pose(
    geometry: Geometry, effects: ArmEffects, block: Block
) -> tuple[Floats, Floats] | None:
    """Compute the pose with the effects of readings and bodies, not of contacts.

    Args:
        geometry: The arm.
        effects: Of the same arm.
        block: The samples with all that the effects need.

    Returns:
        Centres in mm and directions, both (n_samples, 3); None where NumPy is to
        compute.
    """
    if compiled_chain(geometry) is None:
        return None
    gravity = block.gravity_m_s2
    return _chain(geometry, effects).poses(
        _readable(block),
        (effects.gravity_m_s2 if gravity is None else gravity).tolist(),
    )


def _readable(block: Block) -> Block:
    """Take the block, its columns copied only where they lie or are otherwise."""
    changes: dict[str, Any] = {}
    for field in fields(block):
        column = getattr(block, field.name)
        if column is None or field.name == "utc_ns":
            continue
        floats = aligned_floats(column)
        if floats is not column:
            changes[field.name] = floats
    return replace(block, **changes) if changes else block


# Neither ever changes, and most calls are for the same arm.
@lru_cache(maxsize=8)
def _chain(geometry: Geometry, effects: ArmEffects) -> "DeflectedChain":
    terms = [term for correction in effects.readings for term in correction.terms]
    terms += [term for correction in effects.mechanical for term in correction.terms]
    levers_kg_m = _KG_M_PER_KG_MM * effects.bodies.levers_kg_mm(geometry)
    return DeflectedChain(geometry, KERNEL, terms, levers_kg_m)
