"""What least squares must make of the errors that were planted.

At the true arm the equations are as good as linear in errors this small, so whitened
misclosures are whitened errors, and the adjustment leaves the part that no unknown
explains. With the noise as stated its square is chi-square distributed, exactly. An
adjustment that ends with this very sum of squares therefore passes its global test as
often as it should; how many of some hundred draws pass is luck of the draw. Estimates
are off by what the unknowns explain, and their chi-square is foreseen likewise.
"""

from dataclasses import dataclass, replace

import numpy as np

from benchmarks.tools.handover import campaign_from_simulation
from traverse.arrays import Floats
from traverse.lab.campaign.campaign import Campaign
from traverse.lab.identification.equations.network import Station
from traverse.lab.identification.equations.station_equations import (
    WhiteRows,
    white_rows,
)
from traverse.lab.identification.identify import Options, identify
from traverse.lab.identification.solve.adjustment import certified
from traverse.simulator.campaigns import PoseSet, SimulatedCampaign, draw_noise
from traverse.simulator.campaigns.spec import NoiseTable

# Below this part of the largest, a singular value of scaled columns is zero.
_RANK = 1e-9
_LENGTHS = ("distance_mm", "radius_mm")
_SILENCE = NoiseTable(encoder_rad=0.0, contact_mm=0.0)


@dataclass(frozen=True, slots=True, eq=False)
class Foreseen:
    """What must come out of a campaign.

    Attributes:
        sum_of_squares: Weighted.
        steps: By which free parameters are off, (n_free,).
    """

    sum_of_squares: float
    steps: Floats


class PlantedNoise:
    """The equations of a set of poses at the truth.

    Attributes:
        redundancy: Equations and certificates less the rank of their unknowns.
    """

    def __init__(self, poses: PoseSet, noise: NoiseTable) -> None:
        campaign = _without_errors(poses, noise)
        options = Options(n_suggestions=0, snooping=False)
        adjustment = identify(campaign, poses.arm, options).adjustment
        self._network, self._state = adjustment.network, adjustment.state
        self._rows: list[list[WhiteRows]] = []
        blocks = []
        at, width = 0, sum(len(s.scales) for s in self._network.stations)
        for station, unknowns in zip(
            self._network.stations, self._state.unknowns, strict=True
        ):
            rows = list(white_rows(self._network, station, self._state.arm, unknowns))
            self._rows.append(rows)
            own = slice(at, at + len(station.scales))
            blocks += [_wide(r.by_unknowns, r.by_parameters, own, width) for r in rows]
            said = certified(self._network, station, self._state.arm, unknowns)
            n_own = len(station.scales)
            blocks.append(_wide(said[:, :n_own], said[:, n_own:-1], own, width))
            at += n_own
        columns = np.vstack(blocks)
        sizes = np.linalg.norm(columns, axis=0)
        sizes = np.where(sizes > 0.0, sizes, 1.0)
        left, values, right = np.linalg.svd(columns / sizes, full_matrices=False)
        seen = values > _RANK * values[0]
        self._explained = left[:, seen]
        self._to_steps = (right[seen].T / values[seen] / sizes[:, np.newaxis])[width:]
        self.redundancy = int(np.subtract(*self._explained.shape))

    def foreseen(self, drawn: SimulatedCampaign) -> Foreseen:
        """Foresee what comes out of a campaign with these poses.

        Where there is no length, steps change the scale too, as happens to be least.
        """
        campaign = campaign_from_simulation(drawn.campaign)
        errors = np.concatenate(
            [
                self._errors(at, station, drawn, campaign)
                for at, station in enumerate(self._network.stations)
            ]
        )
        explained = errors @ self._explained
        return Foreseen(
            float(errors @ errors - explained @ explained),
            -self._to_steps @ explained,
        )

    def _errors(
        self, at: int, station: Station, drawn: SimulatedCampaign, campaign: Campaign
    ) -> Floats:
        """Whitened errors of a station's touches, then of its certificate."""
        by_reading = drawn.truth.encoder_noise_rad / self._network.noise.encoder_rad
        found = []
        for rows in self._rows[at]:
            poses = station.poses[rows.part]
            of_readings = np.einsum("nij,nj->ni", rows.by_readings, by_reading[poses])
            shifts_mm = drawn.truth.contact_noise_mm[poses]
            of_contacts = np.einsum("nij,nj->ni", rows.by_centre, shifts_mm)
            found.append((of_readings + of_contacts).ravel())
        # Lengths as they are, less what the campaign says of them.
        said = campaign.artefacts[station.index].certificate(
            self._state.unknowns[at], station.touches
        )
        return np.concatenate([*found, said.misclosures_mm / said.std_mm])


def _without_errors(poses: PoseSet, noise: NoiseTable) -> Campaign:
    """Make the campaign of readings and certificates that are right."""
    campaign = campaign_from_simulation(draw_noise(poses, 0, _SILENCE).campaign)
    artefacts = []
    for artefact, placed in zip(campaign.artefacts, poses.artefacts, strict=True):
        true_mm = {
            key: getattr(placed.artefact, key)
            for key in _LENGTHS
            if getattr(artefact, key, None) is not None
        }
        artefacts.append(artefact.model_copy(update=true_mm))
    return replace(
        campaign,
        artefacts=tuple(artefacts),
        encoder_rad=noise.encoder_rad,
        contact_mm=noise.contact_mm,
    )


def _wide(by_unknowns: Floats, by_parameters: Floats, own: slice, width: int) -> Floats:
    """Put derivatives of one station into columns of all unknowns."""
    n_free = by_parameters.shape[-1]
    rows = np.zeros((by_parameters.size // n_free, width + n_free))
    rows[:, own] = by_unknowns.reshape(len(rows), own.stop - own.start)
    rows[:, width:] = by_parameters.reshape(len(rows), n_free)
    return rows
