"""What signing a point costs: encoded alone and signed, in turns.

python -m benchmarks.service.signing [--rounds N]
"""

import argparse
import statistics
import time
from collections.abc import Callable, Sequence
from functools import partial

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from tests.protocol.message_examples import POINT
from traverse.daemon.store.point_signer import PointSigner
from traverse.protocol.encoding import encode
from traverse.protocol.messages import Point
from traverse.protocol.signed_points import PointChain, verifier

N = 2000


def microseconds(work: Callable[[int], object]) -> float:
    """Time of one call, the mean of many."""
    begun_ns = time.perf_counter_ns()
    for number in range(N):
        work(number)
    return (time.perf_counter_ns() - begun_ns) * 1e-3 / N


def _check(chain: PointChain, kept: Sequence[Point], number: int) -> str | None:
    return chain.problem(kept[number])


def main() -> None:
    """Print medians and the spread of the rounds."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=15)
    rounds = parser.parse_args().rounds
    key = Ed25519PrivateKey.generate()
    signer = PointSigner(key)
    public = key.public_key().public_bytes_raw()
    kept = [
        signer.signed(POINT.model_copy(update={"seq": number, "session": "s"}))
        for number in range(N)
    ]
    found: dict[str, list[float]] = {"encoded": [], "and signed": [], "checked": []}
    for _ in range(rounds):
        chain = verifier(public)
        found["encoded"].append(microseconds(lambda _: encode(POINT, "msgpack")))
        found["and signed"].append(
            microseconds(lambda _: encode(signer.signed(POINT), "msgpack"))
        )
        found["checked"].append(microseconds(partial(_check, chain, kept)))
    for name, times in found.items():
        median = statistics.median(times)
        print(f"{name:12} {median:6.1f} us ({min(times):.1f} to {max(times):.1f})")
    more = [a - b for a, b in zip(found["and signed"], found["encoded"], strict=True)]
    print(f"signing      {statistics.median(more):6.1f} us a point")


if __name__ == "__main__":
    main()
