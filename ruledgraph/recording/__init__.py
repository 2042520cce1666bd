# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Recordings in and out: ROS 1 bags, ROS 2 bags, MCAP files, EuRoC (ASL) folders.

recording = open_recording("flight.bag", duration=30.0)
for measurement in recording.stream():
    ...
print(recording.report.warnings)
"""

from ruledgraph.recording.errors import RecordingError
from ruledgraph.recording.report import Report
from ruledgraph.recording.writer import GroundTruthPose, Kind, write_recording

__all__ = ["GroundTruthPose", "Kind", "RecordingError", "Report", "write_recording"]
