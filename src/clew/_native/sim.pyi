import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

def cast_rays(segments: Array, poses: Array, angles: Array, reach: float, ranges: Array) -> None: ...
