"""A file that says which parameters are held and which are free.

schema = "traverse/identification-masks/1"
hold = ["J7.*"]
free = ["probe.vector.*"]
"""

from typing import Literal

from pydantic import Field

from traverse.strict_toml.reader import StrictModel


class Masks(StrictModel):
    """Patterns of parameters' names; `hold` has the last word."""

    schema_: Literal["traverse/identification-masks/1"] = Field(alias="schema")
    hold: tuple[str, ...] = ()
    free: tuple[str, ...] = ()
