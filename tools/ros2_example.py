# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""A ROS 2 node that feeds live odometry and publishes its poses. It needs ROS 2's Python (rclpy).

python tools/ros2_example.py calib.yaml --ros-args \
    -r image:=/camera/camera/infra1/image_rect_raw -r imu:=/camera/camera/imu
"""

import sys

import numpy as np
import rclpy
from geometry_msgs.msg import PoseStamped
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import Image, Imu

import ruledgraph


class OdometryNode(Node):
    """From the topics `image` (mono8 or bgr8) and `imu` to the topic `pose`, in frame `odom`."""

    def __init__(self, calibration: ruledgraph.Calibration) -> None:
        super().__init__("ruledgraph")
        self.poses = self.create_publisher(PoseStamped, "pose", 10)
        self.odometry = ruledgraph.LiveOdometry(calibration, on_pose=self.publish)
        self.create_subscription(Image, "image", self.take_image, qos_profile_sensor_data)
        self.create_subscription(Imu, "imu", self.take_imu, qos_profile_sensor_data)

    def take_image(self, message: Image) -> None:
        """Add an image."""
        channels = 1 if message.encoding == "mono8" else 3
        rows = np.frombuffer(message.data, np.uint8).reshape(message.height, message.step)
        image = rows[:, : message.width * channels].reshape(message.height, message.width, channels)
        self.odometry.add_image(image, t_ns=nanoseconds(message.header.stamp))

    def take_imu(self, message: Imu) -> None:
        """Add an IMU sample."""
        turn, force = message.angular_velocity, message.linear_acceleration
        gyroscope, accelerometer = (turn.x, turn.y, turn.z), (force.x, force.y, force.z)
        self.odometry.add_imu(gyroscope, accelerometer, t_ns=nanoseconds(message.header.stamp))

    def publish(self, estimate: ruledgraph.Estimate) -> None:
        """Publish a live estimate; the odometry's thread calls this."""
        message = PoseStamped()
        message.header.frame_id = "odom"
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(estimate.stamp, 10**9)
        where, turned = message.pose.position, message.pose.orientation
        where.x, where.y, where.z = map(float, estimate.position)
        turned.x, turned.y, turned.z, turned.w = map(float, estimate.quaternion_xyzw)
        self.poses.publish(message)


def nanoseconds(stamp: object) -> int:
    """Of a `builtin_interfaces/Time`."""
    return int(stamp.sec * 10**9 + stamp.nanosec)  # type: ignore[attr-defined]


def main(calibration_file: str) -> None:
    """Run until Ctrl-C."""
    rclpy.init(args=sys.argv)
    node = OdometryNode(ruledgraph.read_calibration(calibration_file))
    with node.odometry:
        rclpy.spin(node)


if __name__ == "__main__":
    main(sys.argv[1])
