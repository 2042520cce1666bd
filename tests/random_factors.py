# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Random, geometrically sensible factors of every form, with values to evaluate them at."""

import dataclasses
from dataclasses import dataclass
from typing import get_args

import gtsam
import numpy as np
from gtsam import noiseModel
from gtsam.symbol_shorthand import B, E, F, G, L, T, V, X

from ruledgraph_factors import (
    FrameMotion,
    GeometricPoints,
    LineChart,
    ReprojectionPoints,
    RuledSurfaceFactor,
    ruled_surface_factor,
    ruled_surface_factor_with_gravity_direction,
    ruled_surface_factor_with_gravity_vector,
    ruled_surface_pose_factor,
)
from ruledgraph_factors.spec import Form

CAMERA_KEYS = {"time": T(0), "extrinsics": E(0), "focal": F(0)}
FORMS = (
    *get_args(Form),
    "node+time",
    "node+extrinsics",
    "node+focal",
    "node+time+extrinsics",
    "node+time+extrinsics+focal",
    "pose+extrinsics",
    "pose+extrinsics+focal",
)
"""Of a spec, and the camera's variables."""
POINTS = (GeometricPoints, ReprojectionPoints)


@dataclass
class Case:
    """One random configuration: a camera on a moving body sees a line, with some error."""

    rng: np.random.Generator
    motion: FrameMotion
    chart: LineChart
    frames: list[np.ndarray]
    body_T_cam: gtsam.Pose3
    values: gtsam.Values

    def factor(self, form: str, kind=GeometricPoints, sigma: float = 1.0) -> RuledSurfaceFactor:
        own, *variables = form.split("+")
        frames = self.frames[:1] if own == "pose" else self.frames
        points = kind.from_frames(frames)
        noise = noiseModel.Isotropic.Sigma(points.rows, sigma)
        node = (X(0), V(0), B(0))
        motion = self.motion
        if "time" not in variables:
            motion = dataclasses.replace(motion, time_jacobian=None)
        of_camera = {f"{name}_key": CAMERA_KEYS[name] for name in variables}
        camera = None if "extrinsics" in variables else self.body_T_cam
        rest = (motion, self.chart, points, camera)
        if own == "node":
            return ruled_surface_factor(noise, *node, L(0), *rest, **of_camera)
        if own == "node_gravity_direction":
            return ruled_surface_factor_with_gravity_direction(noise, *node, G(0), L(0), *rest)
        if own == "node_gravity_vector":
            return ruled_surface_factor_with_gravity_vector(noise, *node, G(1), L(0), *rest)
        return ruled_surface_pose_factor(noise, X(0), L(0), *rest[1:], **of_camera)


def random_case(seed: int, frames: int = 3, points: int = 6, distance: float | None = None) -> Case:
    """A line `distance` metres away (by default 1 to 6), seen from a body that moves."""
    rng = np.random.default_rng(seed)
    world_T_body = gtsam.Pose3(gtsam.Rot3.Expmap(rng.normal(size=3)), rng.normal(size=3))
    body_T_cam = gtsam.Pose3(gtsam.Rot3.Expmap(rng.normal(size=3)), rng.normal(size=3) * 0.1)
    elapsed = np.cumsum(rng.uniform(0.005, 0.03, size=frames))
    motion = FrameMotion(
        elapsed,
        np.hstack([rng.normal(size=(frames, 3)) * 0.05, rng.normal(size=(frames, 6)) * 0.02]),
        rng.normal(size=(frames, 9, 6)) * 0.05,
        rng.normal(size=6) * 0.05,
    )
    time_jacobian = np.random.default_rng([seed, 1]).normal(size=(frames, 6))
    motion = dataclasses.replace(motion, time_jacobian=time_jacobian)
    far = rng.uniform(1.0, 6.0) if distance is None else distance
    ends = rng.uniform(-0.5, 0.5, size=(2, 2))
    while np.linalg.norm(ends[1] - ends[0]) < 0.2:
        ends = rng.uniform(-0.5, 0.5, size=(2, 2))
    world_T_cam = world_T_body * body_T_cam
    first, second = (
        world_T_cam.transformFrom(far * rng.uniform(0.7, 1.4) * np.append(end, 1.0)) for end in ends
    )
    anchor = world_T_cam.retract(rng.normal(size=6) * 0.1)
    chart = LineChart.from_points(anchor, first, second)
    along = rng.uniform(size=(frames, points, 1))
    seen = ends[0] + along * (ends[1] - ends[0]) + rng.normal(size=(frames, points, 2)) * 0.02

    values = gtsam.Values()
    values.insert(X(0), world_T_body)
    values.insert(V(0), rng.normal(size=3) * 0.5)
    bias = rng.normal(size=6) * 0.1
    values.insert(B(0), gtsam.imuBias.ConstantBias(bias[:3], bias[3:]))
    values.insert(G(0), gtsam.Unit3(rng.normal(size=3)))
    values.insert(G(1), rng.normal(size=3) * 9.0)
    values.insert(L(0), np.append(rng.normal() * 0.01, rng.normal(size=3) * 0.02))
    values.insert(T(0), rng.normal() * 0.01)
    values.insert(E(0), body_T_cam)
    values.insert(F(0), 1.03)
    return Case(rng, motion, chart, list(seen), body_T_cam, values)
