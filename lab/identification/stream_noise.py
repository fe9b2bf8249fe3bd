"""What neighbouring samples of a stream share, from residuals.

A recorded stream has hundreds of samples a second, and what disturbs one disturbs the
next. With rho_l the correlation of residuals l samples apart, within a stretch over one
artefact, n samples say as much as n over

    tau = 1 + 2 sum of rho_l             for a mean, and so for parameters
    theta = 1 + 2 sum of rho_l^2         for a mean square, and so for sigma0

independent ones, as long as the posture hardly changes meanwhile; else they say more.
What the model lacks is correlated too and counts here as noise. Sums end where the lag
is three times tau (Sokal's window): beyond there is only chance.
"""

from dataclasses import dataclass

import numpy as np

from traverse.arrays import Floats
from traverse.lab.adjustment import Adjustment
from traverse.lab.campaign.campaign import touching_stretches

_WINDOW = 3.0
_MOST_LAGS = 4096
# Below this correlation noise is over.
_OVER = 0.05
# Where more than this would be lost to the fit, the loss cannot be estimated.
_LEAST_LEFT = 0.5


@dataclass(frozen=True, slots=True)
class SerialNoise:
    """How much neighbouring samples share.

    Attributes:
        samples_per_mean: tau, at least 1.
        samples_per_square: theta, at least 1.
        lasts_s: Until the correlation is below a twentieth.
        redundancy: Of the adjustment in which all samples counted, each unknown having
            taken tau of their squares.
    """

    samples_per_mean: float
    samples_per_square: float
    lasts_s: float
    redundancy: int


def serial_noise(adjustment: Adjustment) -> SerialNoise:
    """Determine how much the samples of an adjusted stream share.

    The fit takes of what lasts: each of u unknowns tau of the n squares, spread over
    long lags. So residuals l lags apart show (rho_l - b) / (1 - b) only, b = u tau / n,
    which is solved for tau.
    """
    seen = _in_window(correlations(adjustment))
    n_rows = adjustment.network.n_rows
    n_unknowns = n_rows - adjustment.redundancy
    total = float(np.sum(seen))
    lost = 2.0 * n_unknowns / n_rows * (len(seen) - total)
    tau = max((1.0 + 2.0 * total) / max(1.0 - lost, _LEAST_LEFT), 1.0)
    absorbed_part = min(n_unknowns * tau / n_rows, 1.0)
    shared = absorbed_part + (1.0 - absorbed_part) * seen
    low = np.append(shared < _OVER, True)
    steps_s = np.diff(adjustment.network.campaign.poses.time_s)
    step_s = float(np.median(steps_s)) if len(steps_s) else 0.0
    return SerialNoise(
        samples_per_mean=tau,
        samples_per_square=1.0 + 2.0 * float(np.sum(shared**2)),
        lasts_s=step_s * (int(np.argmax(low)) + 1),
        redundancy=round(n_rows - n_unknowns * tau),
    )


def _in_window(rhos: Floats) -> Floats:
    """Cut correlations off at the lag that is some times tau up to there."""
    taus = 1.0 + 2.0 * np.cumsum(rhos)
    beyond = np.arange(1, len(rhos) + 1) >= _WINDOW * taus
    return rhos[: int(np.argmax(beyond)) + 1] if np.any(beyond) else rhos


def correlations(adjustment: Adjustment) -> Floats:
    """Compute rho_1, rho_2, ... of whitened residuals, of all artefacts together."""
    network, state = adjustment.network, adjustment.state
    stretches = touching_stretches(network.campaign)
    products, counts = np.zeros(_MOST_LAGS + 1), np.zeros(_MOST_LAGS + 1)
    for station, unknowns, corrections in zip(
        network.stations, state.unknowns, state.corrections, strict=True
    ):
        blocks = network.white_rows(station, state.arm, unknowns, corrections)
        white = np.concatenate([rows.misclosures for rows in blocks])
        of_station = stretches[station.poses]
        ends = np.append(np.flatnonzero(np.diff(of_station)) + 1, len(of_station))
        for first, end in zip(np.append(0, ends[:-1]), ends, strict=True):
            # Samples that were excluded leave holes.
            places = station.poses[first:end] - station.poses[first]
            values = np.zeros((int(places[-1]) + 1, white.shape[1]))
            values[places] = white[first:end]
            taking_part = np.zeros((len(values), 1))
            taking_part[places] = 1.0
            of_stretch = _lagged(values)
            products[: len(of_stretch)] += of_stretch
            counts[: len(of_stretch)] += white.shape[1] * _lagged(taking_part)
    # Where few pairs are that far apart, chance rules.
    n_lags = int(np.argmax(np.append(counts, 0.0) < 0.5 * counts[0]))
    if n_lags < 2 or products[0] == 0.0:
        return np.zeros(0)
    means = products[:n_lags] / counts[:n_lags]
    rhos: Floats = means[1:] / means[0]
    return rhos


def _lagged(values: Floats) -> Floats:
    """Sum products of values (n, n_rows) lags apart, (at most _MOST_LAGS + 1,)."""
    n = len(values)
    size = 1 << (2 * n - 1).bit_length()
    spectrum = np.fft.rfft(values, size, axis=0)
    sums: Floats = np.fft.irfft(np.sum(np.abs(spectrum) ** 2, axis=1), size)
    return sums[: min(n, _MOST_LAGS + 1)]
