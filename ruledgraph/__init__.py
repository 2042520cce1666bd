# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Line-based visual-inertial odometry as a GTSAM backend."""

from importlib.metadata import version

__version__ = version("ruledgraph")
