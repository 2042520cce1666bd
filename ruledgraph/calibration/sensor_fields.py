# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""One sensor's part of a calibration file, checked as it is asked for."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import gtsam
import numpy as np

from ruledgraph.core.errors import RuledgraphError
from ruledgraph.core.plain_yaml import Node

NOISE_KEYS = {
    "gyroscope": "gyroscope_noise_density",
    "accelerometer": "accelerometer_noise_density",
    "gyroscope_walk": "gyroscope_random_walk",
    "accelerometer_walk": "accelerometer_random_walk",
}
"""Field of `ImuNoise` -> key, in Kalibr as in EuRoC."""

# Six printed digits pass, a rotation with a wrong entry or sign does not.
_ORTHONORMAL = 1e-3
LONGEST_LEVER = 10.0
"""No camera is further from its IMU, m."""


class CalibrationError(RuledgraphError):
    """A calibration that is missing, incomplete or implausible: names the file and the key."""


@dataclass(frozen=True)
class Section:
    """A mapping of a file; what it is asked for is checked, errors name file and key."""

    file: str
    prefix: str
    values: Mapping[str, Node]

    def error(self, key: str, problem: str) -> CalibrationError:
        """The error to raise about a key."""
        return CalibrationError(f"{self.file}: {self.prefix}{key} {problem}")

    def key(self, *names: str) -> str:
        """The first of these names that is present, else the first."""
        return next((name for name in names if name in self.values), names[0])

    def text(self, key: str, default: str = "") -> str:
        """The text of a key, without blanks or line ends."""
        value = self.values.get(key, default)
        if not isinstance(value, str) or " " in value or not value.isprintable():
            raise self.error(key, "must be a word")
        return value

    def flag(self, key: str) -> bool:
        """Whether a key says `true`; without it, not."""
        text = self.text(key, "false").lower()
        if text not in ("true", "false"):
            raise self.error(key, f"= {text[:40]!r} must be true or false")
        return text == "true"

    def numbers(self, key: str) -> list[float]:
        """A list, a list of rows, or the `data` of a matrix as OpenCV and ROS write it."""
        if key not in self.values:
            raise self.error(key, "is missing")
        node = self.values[key]
        if isinstance(node, dict):
            node = node.get("data", "")
        rows = node if isinstance(node, list) else [node]
        entries = [entry for row in rows for entry in (row if isinstance(row, list) else [row])]
        return [self._float(key, entry) for entry in entries]

    def some_numbers(self, key: str, count: int) -> list[float]:
        """As `numbers`, of which there must be `count`."""
        values = self.numbers(key)
        if len(values) != count:
            raise self.error(key, f"must be {count} numbers, not {len(values)}")
        return values

    def number(
        self, key: str, smallest: float, largest: float, default: float | None = None
    ) -> float:
        """The number of a key, within these limits."""
        if default is not None and key not in self.values:
            return default
        value = self.some_numbers(key, 1)[0]
        if not smallest <= value <= largest:
            raise self.error(key, f"= {value:g} is not within {smallest:g} to {largest:g}")
        return value

    def transform(self, key: str) -> gtsam.Pose3:
        """A 4x4 rigid motion, its rotation made orthonormal."""
        matrix = np.reshape(self.some_numbers(key, 16), (4, 4))
        rotation, position = matrix[:3, :3], matrix[:3, 3]
        if np.abs(matrix[3] - [0.0, 0.0, 0.0, 1.0]).max() > _ORTHONORMAL:
            raise self.error(key, "must have 0, 0, 0, 1 as its last row")
        # Before the product below, which would overflow.
        if np.abs(rotation).max() > 2.0:
            raise self.error(key, "has a rotation with an entry above 1")
        defect = float(np.abs(rotation @ rotation.T - np.eye(3)).max())
        if defect > _ORTHONORMAL:
            raise self.error(key, f"has a rotation R with R R^T off the identity by {defect:.1g}")
        if np.linalg.det(rotation) < 0.0:
            raise self.error(key, "has a mirrored rotation, with determinant -1")
        if np.abs(position).max() > LONGEST_LEVER:
            raise self.error(
                key, f"has a translation above {LONGEST_LEVER:g} m; it must be in metres"
            )
        u, _, vt = np.linalg.svd(rotation)
        return gtsam.Pose3(gtsam.Rot3(u @ vt), position)

    def _float(self, key: str, entry: Node) -> float:
        try:
            value = float(entry) if isinstance(entry, str) else math.nan
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            shown = repr(entry[:40]) if isinstance(entry, str) else "a list or mapping"
            raise self.error(key, f"must be numbers, but one is {shown}")
        return value
