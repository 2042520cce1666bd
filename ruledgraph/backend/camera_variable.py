# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""What is estimated of the camera beside lines and states."""

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import gtsam
from gtsam import noiseModel
from typing_extensions import Self

from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.config import Config


@dataclass(eq=False)
class CameraVariable(ABC):
    """A variable of the camera in the frames of one interval, or of some in a row, with a random
    walk from the one before.

    A single one for all frames would stay linearised where it was when its first neighbours left
    the window.
    """

    SIZE: ClassVar[int]
    """Dimension of its tangent."""

    index: int
    """Of the state before the first of these frames."""
    time: float
    """Of that state, s."""

    @property
    @abstractmethod
    def key(self) -> int:
        """Of its variable."""

    @abstractmethod
    def insert(self, values: gtsam.Values) -> None:
        """Add the estimate."""

    @abstractmethod
    def read(self, estimate: gtsam.Values) -> None:
        """Take over what the smoother found."""

    @abstractmethod
    def read_covariance(self, covariance: FloatArray) -> None:
        """Take over a marginal, (SIZE, SIZE)."""

    @abstractmethod
    def prior(self) -> gtsam.NonlinearFactor:
        """Prior on the first one of a window."""

    @abstractmethod
    def random_walk_factor(self, before: Self, config: Config) -> gtsam.NonlinearFactor:
        """Random walk from the variable before this one."""


@dataclass(eq=False)
class ScalarVariable(CameraVariable):
    """One that is a number."""

    SIZE: ClassVar[int] = 1

    value: float
    """The estimate."""
    sigma: float
    """Of that, as of the newest state whose frames it has."""

    def insert(self, values: gtsam.Values) -> None:
        """Add the estimate."""
        values.insert(self.key, self.value)

    def read(self, estimate: gtsam.Values) -> None:
        """Take over what the smoother found."""
        self.value = estimate.atDouble(self.key)

    def read_covariance(self, covariance: FloatArray) -> None:
        """Take over a marginal, (1, 1)."""
        self.sigma = math.sqrt(covariance[0, 0])

    def prior(self) -> gtsam.NonlinearFactor:
        """Prior on the first one of a window."""
        noise = noiseModel.Isotropic.Sigma(1, self.sigma)
        return gtsam.PriorFactorDouble(self.key, self.value, noise)
