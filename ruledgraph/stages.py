# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The stages that process a frame before and after the graph: made once, for all segments."""

from typing import NamedTuple

from ruledgraph.calibration.online_calibration import OnlineCalibration
from ruledgraph.calibration.rig import Calibration
from ruledgraph.core.config import Config
from ruledgraph.core.output import Output
from ruledgraph.frontend.front_end import FrontEnd
from ruledgraph.integrity.rest import RestDetector
from ruledgraph.synchronization.camera_clock import CameraClock
from ruledgraph.synchronization.synchronizer import Synchronizer


class Stages(NamedTuple):
    """The stages that serve all segments."""

    synchronizer: Synchronizer
    front_end: FrontEnd
    rest_detector: RestDetector
    clock: CameraClock
    online_calibration: OnlineCalibration
    output: Output

    @classmethod
    def build(cls, calibration: Calibration, config: Config, output: Output) -> "Stages":
        """Those of an odometry with this output."""
        synchronizer = Synchronizer(calibration, output.warnings, config.imu)
        front_end = FrontEnd(calibration.camera, config.edges, config.tracks, output.timings)
        rest_detector = RestDetector(
            synchronizer.imu, synchronizer.frames, front_end.lines_moved, config.rest
        )
        synchronizer.image_rests = rest_detector.image_rests
        given = calibration.time_offset
        clock = CameraClock(synchronizer, given, config.time_offset, output.warnings)
        online_calibration = OnlineCalibration(calibration, config, output.warnings)
        return cls(synchronizer, front_end, rest_detector, clock, online_calibration, output)

    def forget(self, before: float) -> None:
        """End lost tracks, and drop what was measured before a time, s."""
        self.synchronizer.frames.forget(before)
        self.synchronizer.imu.forget(before)
        if self.synchronizer.frames:
            self.front_end.drop_lost(self.synchronizer.frames.first.stamp)
