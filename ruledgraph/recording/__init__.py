# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Recordings in and out: ROS 1 bags, ROS 2 bags, MCAP files, EuRoC (ASL) folders.

recording = open_recording("flight.bag", duration=30.0)
for measurement in recording.stream():
    ...
print(recording.report.warnings)
"""

from ruledgraph.core.measurements import MAX_IMU_GAP
from ruledgraph.recording.container import Kind, Topic
from ruledgraph.recording.errors import RecordingError
from ruledgraph.recording.formats import recordings_in
from ruledgraph.recording.images import check_frame_size
from ruledgraph.recording.order import REORDER_BOUND
from ruledgraph.recording.recording import Recording, open_recording
from ruledgraph.recording.report import Report, StampRange
from ruledgraph.recording.writer import kind_of, write_recording
from ruledgraph.recording.writers import GroundTruthPose

__all__ = [
    "MAX_IMU_GAP",
    "REORDER_BOUND",
    "GroundTruthPose",
    "Kind",
    "Recording",
    "RecordingError",
    "Report",
    "StampRange",
    "Topic",
    "check_frame_size",
    "kind_of",
    "open_recording",
    "recordings_in",
    "write_recording",
]
