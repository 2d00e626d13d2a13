"""The array that nearly everything here takes and gives."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
"""A NumPy array of double precision; docstrings give the shape."""
