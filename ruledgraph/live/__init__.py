# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Odometry while the sensors run: fed by their drivers' threads, answering by callbacks.

A package of its own above `odometry`: an interface for programs, not part of the command line.
"""

from ruledgraph.live.odometry import Counts, LiveOdometry

__all__ = ["Counts", "LiveOdometry"]
