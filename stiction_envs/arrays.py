"""Types of numpy's arrays; shapes and units are where an array is described. Their size: `rms`."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Bools = NDArray[np.bool_]


def rms(x: Array, axis: int | tuple[int, ...] = 0) -> Array:
    """Return the root mean square along the rows, or along other axes."""
    return np.asarray(np.sqrt(np.mean(np.square(x), axis=axis)))
