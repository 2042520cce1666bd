# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Line-based visual-inertial odometry as a GTSAM backend.

recording = ruledgraph.open_recording("flight.bag")
calibration = ruledgraph.read_calibration("calib.yaml")
for estimate in ruledgraph.smooth(recording.stream(), calibration):
    print(estimate.stamp, estimate.position)
"""

import logging
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ruledgraph.calibration import read_calibration as read_calibration
    from ruledgraph.calibration.camera_model import CameraModel as CameraModel
    from ruledgraph.calibration.imu_noise import ImuNoise as ImuNoise
    from ruledgraph.calibration.rig import Calibration as Calibration
    from ruledgraph.core.config import Config as Config
    from ruledgraph.core.errors import MeasurementError as MeasurementError
    from ruledgraph.core.errors import RuledgraphError as RuledgraphError
    from ruledgraph.core.estimates import Estimate as Estimate
    from ruledgraph.core.measurements import Frame as Frame
    from ruledgraph.core.measurements import ImuSample as ImuSample
    from ruledgraph.core.settings import load_config as load_config
    from ruledgraph.core.trajectory import Trajectory as Trajectory
    from ruledgraph.core.trajectory import read_tum as read_tum
    from ruledgraph.live import LiveOdometry as LiveOdometry
    from ruledgraph.live.smooth import smooth as smooth
    from ruledgraph.odometry import Odometry as Odometry
    from ruledgraph.recording import open_recording as open_recording

    __version__: str

_LAZY = {
    "Calibration": "calibration.rig",
    "CameraModel": "calibration.camera_model",
    "Config": "core.config",
    "Estimate": "core.estimates",
    "Frame": "core.measurements",
    "ImuNoise": "calibration.imu_noise",
    "ImuSample": "core.measurements",
    "LiveOdometry": "live",
    "MeasurementError": "core.errors",
    "Odometry": "odometry",
    "RuledgraphError": "core.errors",
    "Trajectory": "core.trajectory",
    "load_config": "core.settings",
    "open_recording": "recording",
    "read_calibration": "calibration",
    "read_tum": "core.trajectory",
    "smooth": "live.smooth",
}
__all__ = ["__version__", *_LAZY]

# Warnings are for programs that set up logging; the command prints its own.
logging.getLogger("ruledgraph").addHandler(logging.NullHandler())


def __getattr__(name: str) -> Any:
    # gtsam and opencv take long to import: `ruledgraph --help` does without them.
    if name in _LAZY:
        return getattr(import_module(f"ruledgraph.{_LAZY[name]}"), name)
    if name == "__version__":
        from importlib.metadata import version

        return version("ruledgraph")
    raise AttributeError(f"module 'ruledgraph' has no attribute {name!r}")
