# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The camera's clock, its pose in the body and its focal length, where a window estimates them."""

from typing import NamedTuple

import gtsam

from ruledgraph.backend.camera_variable import CameraVariable
from ruledgraph.backend.extrinsics import ExtrinsicsVariable
from ruledgraph.backend.focal_ratio import FocalRatioVariable
from ruledgraph.backend.time_offset import TimeOffsetVariable
from ruledgraph.core.calibration_estimates import Extrinsics, FocalRatio, TimeOffset
from ruledgraph.core.config import Config


class CameraVariables(NamedTuple):
    """Those of an interval's frames, which intervals in a row may share; None of what is not
    estimated.
    """

    time_offset: TimeOffsetVariable | None = None
    extrinsics: ExtrinsicsVariable | None = None
    focal_ratio: FocalRatioVariable | None = None

    @property
    def estimated(self) -> list[CameraVariable]:
        """All that there are."""
        return [variable for variable in self if variable is not None]

    def new_since(self, before: "CameraVariables") -> list[CameraVariable]:
        """The variables that are not shared with the interval before."""
        return [each for each in self.estimated if each not in before.estimated]

    def factors(self, before: "CameraVariables", config: Config) -> list[gtsam.NonlinearFactor]:
        """Random walks from the variables of the interval before to the new ones, or priors."""
        earlier = {type(each): each for each in before.estimated}
        return [
            each.random_walk_factor(earlier[type(each)], config)
            if type(each) in earlier
            else each.prior()
            for each in self.new_since(before)
        ]


AS_CALIBRATED = CameraVariables()
"""Nothing is estimated."""


class SelfCalibration(NamedTuple):
    """What is known of the camera as of the newest interval; None of what is not estimated."""

    time_offset: TimeOffset | None = None
    """Beyond the calibration's."""
    extrinsics: Extrinsics | None = None
    focal_ratio: FocalRatio | None = None

    def variables(
        self,
        index: int,
        time: float,
        offset_correction: float,
        before: CameraVariables,
        period: float,
    ) -> CameraVariables:
        """For the frames after a state, `offset_correction` (s) being added to their times already.

        Args:
            index: of the state.
            time: of the state, s.
            offset_correction: see `TimeOffsetVariable`.
            before: those of the interval before.
            period: the setting `window.camera_period`, s.
        """
        offset, at = self.time_offset, (index, time)
        extrinsics, focal_ratio = before.extrinsics, before.focal_ratio
        if extrinsics is None or time - extrinsics.time >= period:
            extrinsics = (
                None if self.extrinsics is None else ExtrinsicsVariable(*at, *self.extrinsics)
            )
        if focal_ratio is None or time - focal_ratio.time >= period:
            ratio = self.focal_ratio
            focal_ratio = None if ratio is None else FocalRatioVariable(*at, *ratio)
        return CameraVariables(
            None
            if offset is None
            else TimeOffsetVariable(
                *at, offset.value - offset_correction, offset.sigma, offset_correction
            ),
            extrinsics,
            focal_ratio,
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
