"""What is hidden how often."""

from collections.abc import Mapping
from types import MappingProxyType

from benchmarks.blind.round import Scenario

# The campaign states a noise that is too small by this.
_TOO_SMALL = 1.0 / 1.4
_SERIAL_SHARE = 0.3

# Every scenario has a stream of its own, but those with blunders: they are compared
# with the same effects in the same noise without them.
CLEAN = (
    Scenario("clean, noise known", stream=1),
    Scenario("clean, noise 1.4 x stated", stated_factor=_TOO_SMALL, stream=2),
    Scenario("clean, noise serial", serial_share=_SERIAL_SHARE, stream=3),
)
ONE = tuple(
    Scenario(f"one at {size}", 1, size, stream=10 + size) for size in (6, 8, 10, 14, 20)
)
TWO = tuple(
    Scenario(f"two at {size}", 2, size, stream=40 + size) for size in (6, 8, 10, 14)
)
THREE = Scenario("three at 10", 3, 10, stream=70)
BLUNDERS = tuple(
    Scenario(f"one at 8, {share:.0%} blunders", 1, 8, blunder_share=share, stream=18)
    for share in (0.02, 0.05)
)
OUTSIDE = tuple(
    Scenario(f"outside at {size}", 1, size, outside=True, stream=80 + size)
    for size in (10, 15)
)

SCENARIOS: Mapping[str, Scenario] = MappingProxyType(
    {s.name: s for s in (*CLEAN, *ONE, *TWO, THREE, *BLUNDERS, *OUTSIDE)}
)

# Runs of each in `make blind`, 200 in all.
QUICK: Mapping[str, int] = MappingProxyType(
    {
        **dict.fromkeys((s.name for s in CLEAN), 20),
        **dict.fromkeys((s.name for s in ONE), 14),
        **dict.fromkeys((s.name for s in TWO), 8),
        THREE.name: 2,
        **dict.fromkeys((s.name for s in BLUNDERS), 8),
        **dict.fromkeys((s.name for s in OUTSIDE), 10),
    }
)
# What it takes until the interval of a rate is as narrow as its figure deserves.
FULL: Mapping[str, int] = MappingProxyType(
    {
        **dict.fromkeys((s.name for s in CLEAN), 400),
        **dict.fromkeys((s.name for s in ONE), 300),
        **dict.fromkeys((s.name for s in TWO), 150),
        THREE.name: 100,
        **dict.fromkeys((s.name for s in BLUNDERS), 300),
        **dict.fromkeys((s.name for s in OUTSIDE), 200),
    }
)
