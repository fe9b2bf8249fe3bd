"""Size of an effect for a campaign: sqrt(lambda), everything re-estimated.

The effect is played without noise, at poses where the arm without it is fitted. The
change of the rows of that fit by its readings, whitened and free of absorbed parts, has
the length sqrt(lambda): the mean of the best possible test in standard deviations. No
code of the effect itself takes part.
"""

from dataclasses import dataclass, replace

import numpy as np

from benchmarks.blind.hidden.poses import Hidden, played
from benchmarks.blind.score import Identity
from benchmarks.tools.handover import campaign_from_simulation
from traverse.arrays import Booleans, Floats
from traverse.kinematics.arm_file.arm import Arm
from traverse.lab.adjustment import Options, Problem, adjust
from traverse.lab.campaign.campaign import Campaign
from traverse.lab.campaign.prior import Prior
from traverse.lab.diagnosis.candidates.library import library_bank
from traverse.lab.diagnosis.candidates.scoring import ALIAS, ProjectedCandidate, project
from traverse.lab.diagnosis.candidates.waves import harmonic_bank, wave_bank
from traverse.lab.diagnosis.model.observation_equations import (
    ObservationEquations,
    equations_of,
)
from traverse.simulator.campaigns import Campaign as Columns
from traverse.simulator.campaigns import NoiseTable, PoseSet, draw_noise

# An effect larger than this many plausible sizes is not credible.
MOST_PLAUSIBLE = 30.0
# A signal that moves the data by less than this at its plausible size is undetectable.
_LEAST = 1e-3
_SILENT = NoiseTable(encoder_rad=0.0, contact_mm=0.0, direction_rad=0.0)


@dataclass(frozen=True, slots=True, eq=False)
class SizeScale:
    """Measures effects on a set of poses.

    Attributes:
        rows: Of a fit to these, of the poses that are used for choosing.
        library: All names but steps, to find aliases.
    """

    poses: PoseSet
    exact: Columns
    rows: ObservationEquations
    library: tuple[ProjectedCandidate, ...]

    def signal(self, hidden: tuple[Hidden, ...]) -> Floats:
        """Compute the effects' changes of the rows that nothing absorbs, (n_rows,)."""
        rows, columns = self.rows, exact_columns(played(self.poses, hidden))
        changes_rad = columns.readings_rad - self.exact.readings_rad
        change = np.einsum("rk,rk->r", rows.by_readings, changes_rad[rows.poses])
        lengths, stated = _lengths_mm(self.exact), _lengths_mm(columns)
        for row, artefact, by_part in rows.certificates:
            # What is longer than its certificate says has a certificate that is short.
            change[row] += by_part * (lengths[artefact] / stated[artefact] - 1.0)
        return rows.project(change[:, np.newaxis])[:, 0]

    def sized(self, hidden: Hidden, size: float) -> Hidden | None:
        """Scale an effect to a size in sqrt(lambda).

        Returns:
            The effect, or None if the campaign does not see it at a plausible size.
        """
        factor = 1.0
        for _ in range(2):
            signal_size = float(np.linalg.norm(self.signal((hidden.scaled(factor),))))
            if signal_size < _LEAST * factor:
                return None
            factor *= size / signal_size
            if factor > MOST_PLAUSIBLE:
                return None
        return hidden.scaled(factor)

    def names_like(self, hidden: Hidden) -> frozenset[Identity]:
        """Return library effects whose columns span an effect's signal.

        Measurements at such poses cannot distinguish them.
        """
        return frozenset(
            identity for identity, part in self._explained(hidden) if part > ALIAS
        )

    def likeness(self, hidden: Hidden) -> float:
        """Return how much of an effect's signal the best name explains, 0 to 1."""
        return max(part for _, part in self._explained(hidden))

    def _explained(self, hidden: Hidden) -> list[tuple[Identity, float]]:
        signal = self.signal((hidden,))
        signal = signal / np.linalg.norm(signal)
        names, cycles = self.library, hidden.keys.get("cycles")
        if cycles is not None:
            # Searched by the diagnosis: the name at the cycles that it should find.
            columns = wave_bank(self.rows, str(hidden.joint), cycles)
            names = (*names, *project(self.rows, columns))
        return [
            (
                sensed.candidate.identity,
                float(np.linalg.norm(sensed.directions.T @ signal)),
            )
            for sensed in names
        ]


def ruler(
    poses: PoseSet, arm: Arm, choosing: Booleans, prior: Prior | None = None
) -> SizeScale:
    """Fit an arm without effects to poses without noise.

    Args:
        poses: Without effects.
        arm: As in the arm file.
        choosing: Which poses are used for choosing, (n_poses,).
        prior: Of the arm's family.
    """
    campaign = replace(noise_free_campaign(poses), prior=prior)
    problem = Problem.of(campaign, arm, Options(coarse_start=False))
    network, design = problem.network(choosing), problem.design
    # No tests: nothing contradicts anything where there is no noise.
    rows = equations_of(adjust(network, network.start(design), design))
    banks = (library_bank(rows, arm), harmonic_bank(rows))
    library = tuple(projected for bank in banks for projected in project(rows, bank))
    return SizeScale(poses, exact_columns(poses), rows, library)


def noise_free_campaign(poses: PoseSet) -> Campaign:
    stated = poses.spec.noise
    exact = campaign_from_simulation(exact_columns(poses))
    return replace(exact, encoder_rad=stated.encoder_rad, contact_mm=stated.contact_mm)


def exact_columns(poses: PoseSet) -> Columns:
    return draw_noise(poses, 0, _SILENT).campaign


def _lengths_mm(columns: Columns) -> dict[str, float]:
    """Return the certified lengths [mm] by artefact."""
    return {
        stated.id: float(stated.table["distance_mm"])
        for stated in columns.artefacts
        if "distance_mm" in stated.table
    }
