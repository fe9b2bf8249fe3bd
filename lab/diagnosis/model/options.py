"""What one may wish of a diagnosis."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class DiagnosisOptions:
    """Wishes.

    Attributes:
        seed: Of the split into choosing and held-out poses, and of the thresholds.
        most_terms: That are added at most.
        level: Probability that anything is found where nothing is missing.
        n_draws: Of noise, for the thresholds.
        details: Whether to work out what could have been seen, the final estimates
            from all poses, and the ledger's steps between the first and the last; a
            decision alone needs none of it.
        accept_tentative: Whether tentative terms enter the adapted arm.
    """

    seed: int = 1
    most_terms: int = 4
    level: float = 0.01
    n_draws: int = 1000
    details: bool = True
    accept_tentative: bool = False
