"""Arrays by the kind of their elements, for annotations of every package."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Booleans = NDArray[np.bool_]
Bits = NDArray[np.uint32]
Indices = NDArray[np.intp]
