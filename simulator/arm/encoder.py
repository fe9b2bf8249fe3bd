"""Encoders: readings in, counts out."""

from dataclasses import dataclass

import numpy as np

from traverse.arrays import Floats, Integers


@dataclass(frozen=True, slots=True)
class EncoderSet:
    """The encoders on one board, by channel.

    Attributes:
        joints: (n_channels,) number of the joint on each channel, from 0.
        counts_per_turn: (n_channels,)
        signs: (n_channels,) +1 or -1.
        moduli: (n_channels,) counts at which the encoders wrap.
        noise_rad: Standard deviation of a reading.
    """

    joints: Integers
    counts_per_turn: Integers
    signs: Integers
    moduli: Integers
    noise_rad: float

    def counts(self, readings_rad: Floats, noise: np.random.Generator) -> Integers:
        """Quantise readings (n, n_joints) to counts (n, n_channels) below the moduli.

        The generator is drawn from row by row, so that cutting a stream into blocks
        in another way changes nothing.
        """
        seen_rad = readings_rad[:, self.joints]
        if self.noise_rad > 0.0:
            seen_rad = seen_rad + self.noise_rad * noise.standard_normal(seen_rad.shape)
        scale = self.signs * self.counts_per_turn / (2.0 * np.pi)
        return np.rint(seen_rad * scale).astype(np.int64) % self.moduli
