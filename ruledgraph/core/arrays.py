# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The type of the arrays that all packages compute with."""

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
