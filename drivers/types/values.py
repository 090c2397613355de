"""Arrays and small words that many records share."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

Approach = Literal[1, -1]

CompensatedFor = Literal["nothing", "air", "air+material"]

Sense = Literal[1, -1]
"""In which sense a cross table's values are held: +1 as they stand in the control. A driver's own: kept, never used."""

# um or arcsec: an acting compensation below this is none
GONE = 0.001
