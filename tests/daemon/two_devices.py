"""An arm on two devices whose motion is known, and their readings of it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tests.daemon.values import ARM, arm_model
from traverse.daemon.acquisition.resampler import Resampler
from traverse.daemon.config.schema import AssemblySection
from traverse.drivers.base.values import CountSamples, Identity

BEGIN_NS = 10**12
# J1 on channel 2 and J2 on channel 0 of the base, J3 on channel 1 of the wrist.
TURNS = np.array([65536, 1048576, 8388608])
ON_TWO = ARM.replace('source = "base/1"', 'source = "wrist/1"')


def identity(jitter_ns=0):
    return Identity("device", "1", (), 0, 100.0, jitter_ns=jitter_ns)


def model_on_two(folder):
    return arm_model(folder, ON_TWO)


def assembly_on_two(folder, rates_hz=(100.0, 80.0), **settings):
    """An assembly whose devices, base and wrist, are up and stream."""
    assembly = Resampler(model_on_two(folder), AssemblySection(**settings))
    for device, rate_hz in zip(("base", "wrist"), rates_hz, strict=True):
        assembly.on_up(device, identity(), restarted=False)
        assembly.set_rate(device, rate_hz)
    return assembly


def true_counts(times_ns, speed=1.0):
    """Where the joints are, over all turns and unrounded, (n, 3)."""
    t = (np.asarray(times_ns) - BEGIN_NS)[..., np.newaxis] * 1e-9 * speed
    amplitudes = np.array([0.4, 3.0, 1.2])  # J2 crosses its turn to and fro
    rates = np.array([1.1, 0.9, 2.3])
    angles_rad = amplitudes * np.sin(rates * t + np.array([0.3, 1.4, 4.0]))
    return angles_rad * TURNS / (2 * np.pi)


@dataclass
class Reader:
    """A device that reads joints of the true motion.

    Attributes:
        channels: per channel the joint on it, None for none.
        skew_ns: per channel when it is read, counted from the instant of the sample.
    """

    device: str
    rate_hz: float
    channels: tuple[int | None, ...]
    skew_ns: tuple[int, ...] | None = None
    first_ns: int = BEGIN_NS
    stream: int = 1
    speed: float = 1.0

    def times_ns(self, seq):
        return self.first_ns + np.rint(np.asarray(seq) * 1e9 / self.rate_hz).astype(
            np.int64
        )

    def reading_times_ns(self, seq, joint):
        skew_ns = self.skew_ns[self.channels.index(joint)] if self.skew_ns else 0
        return self.times_ns(seq) + skew_ns

    def samples(self, seq: Sequence[int]) -> CountSamples:
        n, channels = len(seq), len(self.channels)
        counts = np.zeros((n, channels), np.uint32)
        for channel, joint in enumerate(self.channels):
            if joint is not None:
                times_ns = self.reading_times_ns(seq, joint)
                true = np.rint(true_counts(times_ns, self.speed)[:, joint])
                counts[:, channel] = true.astype(np.int64) % TURNS[joint]
        times_ns = self.times_ns(seq)
        skew_ns = None
        if self.skew_ns is not None:
            skew_ns = np.tile(np.array(self.skew_ns, np.int32), (n, 1))
        return CountSamples(
            self.device,
            self.stream,
            np.array(seq, np.int64),
            times_ns,
            int(times_ns[-1]) + 1_000_000,
            times_ns,
            np.zeros(n, np.uint8),
            counts,
            np.zeros((n, channels), np.uint8),
            skew_ns,
        )


def base(**changes) -> Reader:
    return Reader("base", **{"rate_hz": 100.0, "channels": (1, None, 0), **changes})


def wrist(**changes) -> Reader:
    return Reader("wrist", **{"rate_hz": 80.0, "channels": (None, 2), **changes})
