"""What one may wish of an identification."""

from dataclasses import dataclass

from traverse.lab.identification.solve.variance_components import VarianceModel


@dataclass(frozen=True, slots=True)
class Options:
    """Wishes.

    Attributes:
        hold: Patterns of parameters to hold at their design values.
        free: Patterns of parameters to free; `hold` has the last word.
        snooping: Whether contradicting poses are excluded.
        family_level: Probability that a campaign without blunders loses any pose.
        variances: Which noise is estimated; None: what the campaign does not give.
        coarse_start: Whether wrong zeros are looked for where the design fits badly.
        n_suggestions: Poses to suggest.
    """

    hold: tuple[str, ...] = ()
    free: tuple[str, ...] = ()
    snooping: bool = True
    family_level: float = 0.01
    variances: VarianceModel | None = None
    coarse_start: bool = True
    n_suggestions: int = 8
