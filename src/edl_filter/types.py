"""Array types and names of axes of the whole package; docstrings of functions state the shapes of arrays."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
SingleArray = NDArray[np.float32]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]

#: Names of the axes of a vector, in the order of its components, and of the components of a quaternion.
AXES = ("x", "y", "z")
QUATERNION = (*AXES, "w")
