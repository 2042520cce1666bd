# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Line-based visual-inertial odometry as a GTSAM backend.

recording = ruledgraph.open_recording("flight.bag")
calibration = ruledgraph.read_calibration("calib.yaml")
for estimate in ruledgraph.smooth(recording.stream(), calibration):
    print(estimate.stamp, estimate.world_T_body.translation())
"""

from importlib import import_module
from importlib.metadata import version
from typing import Any

__version__ = version("ruledgraph")

_LAZY = {
    "Calibration": "sensors",
    "Config": "config",
    "Estimate": "pipeline",
    "Odometry": "pipeline",
    "load_config": "config",
    "open_recording": "recording",
    "read_calibration": "calibration",
    "smooth": "pipeline",
}
__all__ = ["__version__", *_LAZY]


def __getattr__(name: str) -> Any:
    # gtsam and opencv take long to import: `ruledgraph --help` does without them.
    if name in _LAZY:
        return getattr(import_module(f"ruledgraph.{_LAZY[name]}"), name)
    raise AttributeError(f"module 'ruledgraph' has no attribute {name!r}")
