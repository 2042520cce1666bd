# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The factor graph: states, lines, sliding window, fixed-lag smoother."""
