# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The camera's clock, its pose in the body and its focal length, where a window estimates them."""

from typing import NamedTuple

import gtsam

from ruledgraph.backend.camera_variable import CameraVariable
from ruledgraph.backend.extrinsics import ExtrinsicsState
from ruledgraph.backend.focal_ratio import FocalRatioState
from ruledgraph.backend.time_offset import TimeOffsetState
from ruledgraph.core.config import Config
from ruledgraph.core.extrinsics import Extrinsics
from ruledgraph.core.focal_ratio import FocalRatio
from ruledgraph.core.time_offset import TimeOffset


class CameraVariables(NamedTuple):
    """Those of an interval's frames; None of what is not estimated."""

    time_offset: TimeOffsetState | None = None
    extrinsics: ExtrinsicsState | None = None
    focal_ratio: FocalRatioState | None = None

    @property
    def estimated(self) -> list[CameraVariable]:
        """All that there are."""
        return [variable for variable in self if variable is not None]

    def factors(
        self, before: "CameraVariables | None", config: Config
    ) -> list[gtsam.NonlinearFactor]:
        """Ties to the variables of the interval before, or priors if there are none."""
        earlier = {type(each): each for each in before.estimated} if before else {}
        return [
            each.random_walk_factor(earlier[type(each)], config)
            if type(each) in earlier
            else each.prior()
            for each in self.estimated
        ]


AS_CALIBRATED = CameraVariables()
"""Nothing is estimated."""


class SelfCalibration(NamedTuple):
    """What is known of the camera as of the newest interval; None of what is not estimated."""

    time_offset: TimeOffset | None = None
    """Beyond the calibration's."""
    extrinsics: Extrinsics | None = None
    focal_ratio: FocalRatio | None = None

    def variables(self, index: int, time: float, offset_correction: float) -> CameraVariables:
        """For the frames after a state, `offset_correction` (s) being added to their times already.

        Args:
            index: of the state.
            time: of the state, s.
            offset_correction: see `TimeOffsetState`.
        """
        offset, at = self.time_offset, (index, time)
        return CameraVariables(
            None
            if offset is None
            else TimeOffsetState(
                *at, offset.value - offset_correction, offset.sigma, offset_correction
            ),
            None if self.extrinsics is None else ExtrinsicsState(*at, *self.extrinsics),
            None if self.focal_ratio is None else FocalRatioState(*at, *self.focal_ratio),
        )

    @classmethod
    def of(cls, camera: CameraVariables) -> "SelfCalibration":
        """As the variables of an interval have it."""
        offset, extrinsics, focal_ratio = camera
        return cls(
            None if offset is None else offset.offset,
            None if extrinsics is None else extrinsics.extrinsics,
            None if focal_ratio is None else focal_ratio.focal_ratio,
        )
