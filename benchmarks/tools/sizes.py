"""How much a benchmark does: all of it, or as little as shows that it runs.

`TINY=1` in the environment, as in `make bench TINY=1`, asks for the latter. Figures of
tiny sizes mean nothing; nothing is judged by them.
"""

import os
from typing import TypeVar

Size = TypeVar("Size")

IS_TINY = bool(os.environ.get("TINY"))


def sized(full: Size, tiny: Size) -> Size:
    return tiny if IS_TINY else full
