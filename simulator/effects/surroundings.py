"""What is around the arm, sample by sample, besides the turns of its joints."""

from dataclasses import dataclass

import numpy as np

from traverse.arrays import Floats


@dataclass(frozen=True, slots=True)
class Surroundings:
    """Everything that a fault may depend on; one sample a row.

    Attributes:
        time_s: (n,) since the campaign or the script began.
        utc_s: (n,) since 1970, or None if unknown.
        temperature_c: (n,) of the whole arm.
        speed_rad_s: (n, n_joints) of the turns.
        approach: (n, n_joints) -1, 0, +1: sense of the last motion.
        towards: (n, 3) unit vectors from the ball towards the material; NaN where the
            ball touches nothing or sits in a seat.
        force_n: (n,) of the contact.
    """

    time_s: Floats
    utc_s: Floats | None
    temperature_c: Floats
    speed_rad_s: Floats
    approach: Floats
    towards: Floats
    force_n: Floats

    @property
    def towards_or_nothing(self) -> Floats:
        """Directions (n, 3), zero where there is none."""
        return np.nan_to_num(self.towards)

    def since_s(self, epoch_utc_s: float) -> Floats:
        """Seconds (n,) since a moment.

        Raises:
            ValueError: The time is unknown.
        """
        if self.utc_s is None:
            raise ValueError(
                "an effect counts from its epoch_utc, but the start in UTC is unknown"
            )
        return self.utc_s - epoch_utc_s
