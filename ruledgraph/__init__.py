# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Line-based visual-inertial odometry as a GTSAM backend.

recording = ruledgraph.open_recording("flight.bag")
calibration = ruledgraph.read_calibration("calib.yaml")
for estimate in ruledgraph.smooth(recording.stream(), calibration):
    print(estimate.stamp, estimate.world_T_body.translation())
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ruledgraph.calibration import read_calibration as read_calibration
    from ruledgraph.calibration.sensors import Calibration as Calibration
    from ruledgraph.core.config import Config as Config
    from ruledgraph.core.estimates import Estimate as Estimate
    from ruledgraph.core.settings import load_config as load_config
    from ruledgraph.odometry import Odometry as Odometry
    from ruledgraph.odometry import smooth as smooth
    from ruledgraph.recording import open_recording as open_recording

    __version__: str

_LAZY = {
    "Calibration": "calibration.sensors",
    "Config": "core.config",
    "Estimate": "core.estimates",
    "Odometry": "odometry",
    "load_config": "core.settings",
    "open_recording": "recording",
    "read_calibration": "calibration",
    "smooth": "odometry",
}
__all__ = ["__version__", *_LAZY]


def __getattr__(name: str) -> Any:
    # gtsam and opencv take long to import: `ruledgraph --help` does without them.
    if name in _LAZY:
        return getattr(import_module(f"ruledgraph.{_LAZY[name]}"), name)
    if name == "__version__":
        from importlib.metadata import version

        return version("ruledgraph")
    raise AttributeError(f"module 'ruledgraph' has no attribute {name!r}")
