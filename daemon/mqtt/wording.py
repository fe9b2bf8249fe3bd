"""Wording of the broker's errors."""

from traverse.broker.reasons import Wording

WORDING = Wording(
    who="this arm",
    where=" of [broker]",
    use_tls="set tls = true in [broker]",
    absent="",  # an event has its remedy beside it
)
