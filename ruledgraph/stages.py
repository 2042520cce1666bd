# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The stages that process a frame before and after the graph: made once, for all segments."""

from typing import NamedTuple

from ruledgraph.calibration.camera_mounting import CameraMounting
from ruledgraph.calibration.sensors import Calibration
from ruledgraph.core.config import Config
from ruledgraph.core.output import Output
from ruledgraph.frontend.front_end import FrontEnd
from ruledgraph.imu.camera_clock import CameraClock
from ruledgraph.imu.synchronizer import Synchronizer
from ruledgraph.integrity.rest import RestDetector


class Stages(NamedTuple):
    """The stages that serve all segments."""

    sensors: Synchronizer
    front_end: FrontEnd
    rest_detector: RestDetector
    clock: CameraClock
    mounting: CameraMounting
    output: Output

    @classmethod
    def build(cls, calibration: Calibration, config: Config, output: Output) -> "Stages":
        """Those of an odometry with this output."""
        sensors = Synchronizer(calibration, output.warnings, config.imu)
        front_end = FrontEnd(calibration.camera, config.edges, config.tracks, output.timings)
        rest_detector = RestDetector(
            sensors.imu, sensors.frames, front_end.lines_moved, config.rest
        )
        sensors.image_rests = rest_detector.image_rests
        given = calibration.time_offset
        clock = CameraClock(sensors, given, config.time_offset, output.warnings)
        mounting = CameraMounting(calibration, config, output.warnings)
        return cls(sensors, front_end, rest_detector, clock, mounting, output)

    def forget(self, before: float) -> None:
        """End lost tracks, and drop what was measured before a time, s."""
        self.sensors.frames.forget(before)
        self.sensors.imu.forget(before)
        if self.sensors.frames:
            self.front_end.drop_lost(self.sensors.frames.first.stamp)
