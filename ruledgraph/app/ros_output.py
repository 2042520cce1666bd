# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""A run's estimates as ROS 2 messages in an MCAP file, for RViz, Foxglove and ROS nodes."""

import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import gtsam
import numpy as np
from rosbags import rosbag2

from ruledgraph.calibration.rig import Calibration
from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.context import Closing
from ruledgraph.core.errors import RuledgraphError, machine_error
from ruledgraph.core.estimates import Estimate, LineEstimate
from ruledgraph.core.trajectory import quaternion_xyzw
from ruledgraph.recording.messages import types
from ruledgraph_factors.so3 import hat

WORLD, BODY, CAMERA = "world", "body", "cam0"
"""The frames' names."""
# What ROS takes for unknown: a variance beyond use.
_UNKNOWN = 1e6
# Of a line as it is drawn: width, m, and colour.
_WIDTH, _COLOUR = 0.01, (0.1, 0.6, 1.0, 1.0)
_ODOMETRY, _PATH = "nav_msgs/msg/Odometry", "nav_msgs/msg/Path"
_TF, _MARKERS = "tf2_msgs/msg/TFMessage", "visualization_msgs/msg/MarkerArray"


class Ros2Output(Closing):
    """Writes an MCAP file; it bears its name when it is closed.

    - `/odometry`, nav_msgs/Odometry: live poses of `body` in `world` with covariance, velocity in
      `body`; the angular velocity is not estimated, its variance says so;
    - `/tf` the same poses, `/tf_static` the camera `cam0` in `body`;
    - `/path`, nav_msgs/Path: the smoothed trajectory, at the end;
    - `/lines`, visualization_msgs/MarkerArray: lines as they leave the window, by their numbers.

    Raises:
        RuledgraphError: when the file exists or its name does not end in .mcap.
    """

    def __init__(self, path: Path, calibration: Calibration) -> None:
        if path.suffix != ".mcap":
            raise RuledgraphError(f"{path}: the ROS 2 bag is an MCAP file, name it *.mcap")
        if path.exists() or path.is_symlink():
            raise RuledgraphError(f"{path}: exists already, choose another name")
        self.path = path
        self._body_T_cam = calibration.body_T_cam
        self._store = types(ros1=False)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._folder = tempfile.TemporaryDirectory(prefix=".ruledgraph-", dir=path.parent)
        except OSError as error:
            raise RuledgraphError(f"{path}: cannot be written: {error.strerror}") from None
        self._bag = Path(self._folder.name, "bag")
        # Version 8 is what ROS 2 Humble and later read.
        plugin = rosbag2.StoragePlugin.MCAP
        self._writer: Any = rosbag2.Writer(self._bag, version=8, storage_plugin=plugin)
        self._writer.open()
        self._connections: dict[str, Any] = {}
        self._path: list[Any] = []
        self._last = 0

    def write(
        self,
        live: Sequence[Estimate],
        smoothed: Sequence[Estimate],
        lines: Sequence[LineEstimate],
    ) -> None:
        """Append."""
        for estimate in live:
            if not self._last:
                transform = self._transform(estimate.stamp, BODY, CAMERA, self._body_T_cam)
                self._send("/tf_static", _TF, estimate.stamp, transforms=[transform])
            self._last = estimate.stamp
            self._write_pose(estimate)
        for estimate in smoothed:
            header = self._header(estimate.stamp, WORLD)
            pose = self._pose(estimate.world_T_body)
            self._path.append(self._new("geometry_msgs/msg/PoseStamped", header, pose))
        if lines:
            self._last = max(self._last, *(line.last_stamp for line in lines))
            markers = [self._marker(line) for line in lines]
            self._send("/lines", _MARKERS, self._last, markers=markers)

    def close(self) -> None:
        """Write the path and give the file its name; without any estimate there is none.

        Raises:
            MachineError: when not all could be written; the file then lacks its end.
        """
        try:
            if self._path:
                header = self._header(self._last, WORLD)
                self._send("/path", _PATH, self._last, header=header, poses=self._path)
            self._writer.close()
        except OSError as error:
            raise (machine_error(error, self.path) or error) from None
        finally:
            if self._last:
                (self._bag / f"{self._bag.name}.mcap").rename(self.path)
            self._folder.cleanup()

    def _write_pose(self, estimate: Estimate) -> None:
        pose, twist = estimate.world_T_body, np.zeros(6)
        twist[:3] = pose.rotation().unrotate(estimate.velocity)
        of_pose, of_twist = ros_covariances(estimate)
        linear, angular = (self._vector(part) for part in (twist[:3], twist[3:]))
        self._send(
            "/odometry",
            _ODOMETRY,
            estimate.stamp,
            header=self._header(estimate.stamp, WORLD),
            child_frame_id=BODY,
            pose=self._new(
                "geometry_msgs/msg/PoseWithCovariance", self._pose(pose), of_pose.ravel()
            ),
            twist=self._new(
                "geometry_msgs/msg/TwistWithCovariance",
                self._new("geometry_msgs/msg/Twist", linear, angular),
                of_twist.ravel(),
            ),
        )
        transform = self._transform(estimate.stamp, WORLD, BODY, pose)
        self._send("/tf", _TF, estimate.stamp, transforms=[transform])

    def _marker(self, line: LineEstimate) -> Any:
        no_pose = self._pose(gtsam.Pose3())
        empty = self._new("builtin_interfaces/msg/Duration", 0, 0)
        kind: Any = self._store.types["visualization_msgs/msg/Marker"]
        colour = self._new("std_msgs/msg/ColorRGBA", *_COLOUR)
        return kind(
            header=self._header(line.last_stamp, WORLD),
            ns="lines",
            id=line.id % 2**31,
            type=kind.LINE_LIST,
            action=kind.ADD,
            pose=no_pose,
            scale=self._vector(np.array([_WIDTH, 0.0, 0.0])),
            color=colour,
            lifetime=empty,
            frame_locked=False,
            points=[self._new("geometry_msgs/msg/Point", *map(float, end)) for end in line.ends],
            colors=[],
            texture_resource="",
            texture=self._new(
                "sensor_msgs/msg/CompressedImage",
                self._header(line.last_stamp, ""),
                "",
                np.zeros(0, np.uint8),
            ),
            uv_coordinates=[],
            text="",
            mesh_resource="",
            mesh_file=self._new(
                "visualization_msgs/msg/MeshFile", filename="", data=np.zeros(0, np.uint8)
            ),
            mesh_use_embedded_materials=False,
        )

    def _send(self, topic: str, type_name: str, stamp: int, **fields: Any) -> None:
        if topic not in self._connections:
            self._connections[topic] = self._writer.add_connection(
                topic, type_name, typestore=self._store
            )
        data = self._store.serialize_cdr(self._new(type_name, **fields), type_name)
        try:
            self._writer.write(self._connections[topic], stamp, data)
        except OSError as error:
            raise (machine_error(error, self.path) or error) from None

    def _new(self, type_name: str, *values: Any, **fields: Any) -> Any:
        return self._store.types[type_name](*values, **fields)

    def _header(self, stamp: int, frame: str) -> Any:
        time = self._new("builtin_interfaces/msg/Time", *divmod(stamp, 10**9))
        return self._new("std_msgs/msg/Header", stamp=time, frame_id=frame)

    def _vector(self, values: FloatArray) -> Any:
        return self._new("geometry_msgs/msg/Vector3", *map(float, values))

    def _quaternion(self, pose: gtsam.Pose3) -> Any:
        return self._new("geometry_msgs/msg/Quaternion", *map(float, quaternion_xyzw(pose)))

    def _pose(self, pose: gtsam.Pose3) -> Any:
        position = self._new("geometry_msgs/msg/Point", *map(float, pose.translation()))
        return self._new("geometry_msgs/msg/Pose", position, self._quaternion(pose))

    def _transform(self, stamp: int, parent: str, child: str, pose: gtsam.Pose3) -> Any:
        transform = self._new(
            "geometry_msgs/msg/Transform",
            self._vector(pose.translation()),
            self._quaternion(pose),
        )
        header = self._header(stamp, parent)
        return self._new("geometry_msgs/msg/TransformStamped", header, child, transform)


def ros_covariances(estimate: Estimate) -> tuple[FloatArray, FloatArray]:
    """Covariances in the order of ROS, linear before angular, (6, 6) each.

    Of the pose, in the axes of the world: GTSAM's tangent (w, p) is in those of the body, so
    A = [[0, R], [R, 0]] takes it there. Of the velocity in the body, v_b = R^T v:
    R^T S_v R + [v_b]x S_w [v_b]x^T; how rotation and velocity are correlated is not known.
    """
    R = estimate.world_T_body.rotation().matrix()
    A = np.zeros((6, 6))
    A[:3, 3:] = A[3:, :3] = R
    turned = hat(R.T @ estimate.velocity)
    twist = np.diag(np.full(6, _UNKNOWN))
    twist[:3, :3] = R.T @ estimate.velocity_covariance @ R
    twist[:3, :3] += turned @ estimate.rotation_covariance @ turned.T
    return A @ estimate.pose_covariance @ A.T, twist
