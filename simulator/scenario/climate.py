"""How warm it is around the virtual arm."""

import numpy as np
from pydantic import Field

from traverse.kinematics.arm_file.arm import StrictModel
from traverse.simulator.arm.physics import Floats


class ClimateTable(StrictModel):
    """A temperature that drifts and swings.

    Attributes:
        temperature_c: Of the arm at the start of the script.
        drift_c_s: By how much it rises in a second, for ever.
        swing_c: Largest departure from that, up first.
        swing_period_s: From wave to wave.
    """

    temperature_c: float = 20.0
    drift_c_s: float = 0.0
    swing_c: float = Field(default=0.0, ge=0.0)
    swing_period_s: float = Field(default=3600.0, gt=0.0)

    def change_c(self, script_s: Floats) -> Floats:
        """By how much it is warmer than at the start, any shape."""
        waves: Floats = np.sin(2.0 * np.pi / self.swing_period_s * script_s)
        return self.drift_c_s * script_s + self.swing_c * waves
