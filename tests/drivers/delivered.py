from typing import Any

import numpy as np

from traverse.drivers.base.values import STATUS_MISSING, CountSamples, DeviceCounters


class Delivered:
    all: list[Any]

    def of(self, kind):
        return [delivery for delivery in self.all if isinstance(delivery, kind)]

    def joined(self, name: str) -> np.ndarray:
        return np.concatenate([getattr(b, name) for b in self.of(CountSamples)])

    def missing(self) -> np.ndarray:
        """(n, n_channels) of samples that lack a reading."""
        return (self.joined("status") & STATUS_MISSING) != 0

    def counters(self) -> dict[str, int]:
        return dict(self.of(DeviceCounters)[-1].values)
