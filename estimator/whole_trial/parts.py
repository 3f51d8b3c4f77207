"""Parts of a trial that are computed together."""

import numpy as np
from numpy.typing import NDArray

Frames = slice | NDArray[np.int64]
"""Numbers of frames."""
STACKED = 64
"""Number of frames whose arrays are stacked: few enough for the processor's cache."""
WINDOW = 2000
"""Number of frames that are solved together, and whose covariances are held: 42 MB of band, and 20 MB."""
