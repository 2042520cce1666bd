# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Point-to-ruled-surface factors for GTSAM: lines in a visual-inertial graph, without matching.

Needs gtsam and numpy alone. `EMBEDDING.md` beside this package is the guide.
"""

from ruledgraph_factors.check import LineCheck, check_lines
from ruledgraph_factors.cpp import get_cmake_dir, get_include
from ruledgraph_factors.errors import DegenerateWindowError, FactorError
from ruledgraph_factors.factor import RuledSurfaceFactor
from ruledgraph_factors.factor_spec import FactorSpec, SpecFactor, spec_of
from ruledgraph_factors.factories import (
    ruled_surface_factor,
    ruled_surface_factor_with_gravity_direction,
    ruled_surface_factor_with_gravity_vector,
    ruled_surface_pose_factor,
)
from ruledgraph_factors.first_window import solve_first_window
from ruledgraph_factors.graph_io import build_factor, clone_graph, load_graph, save_graph
from ruledgraph_factors.gravity import level_attitude
from ruledgraph_factors.imu_noise import with_imu_noise
from ruledgraph_factors.imu_samples import ImuSamples, ImuSegment
from ruledgraph_factors.kernel import active_kernel
from ruledgraph_factors.line import LineChart
from ruledgraph_factors.line_distance import (
    LineDistanceFactor,
    LineDistanceSpec,
    line_distance_factor,
)
from ruledgraph_factors.motion import (
    STANDARD_GRAVITY,
    FrameMotion,
    preintegrate_frames,
)
from ruledgraph_factors.native_factor import native_factor
from ruledgraph_factors.new_line import NewLineFactor, NewLineSpec, new_line_factor
from ruledgraph_factors.observations import GeometricPoints, ReprojectionPoints, bin_points
from ruledgraph_factors.ruled_surface import Residual, State
from ruledgraph_factors.ruling import NEW_LINE_SIGMAS, line_from_ruling
from ruledgraph_factors.same_line import SameLineFactor, SameLineSpec, same_line_factor
from ruledgraph_factors.solvers import (
    MovedLine,
    isam2_params,
    levenberg_marquardt_params,
    move_line,
)
from ruledgraph_factors.spec import RuledSurfaceSpec
from ruledgraph_factors.triangulation import LineStatus, LineTriangulation, triangulate_line
from ruledgraph_factors.window_rays import LineTrack
from ruledgraph_factors.window_refinement import WindowSolution

__all__ = [
    "NEW_LINE_SIGMAS",
    "STANDARD_GRAVITY",
    "DegenerateWindowError",
    "FactorError",
    "FactorSpec",
    "FrameMotion",
    "GeometricPoints",
    "ImuSamples",
    "ImuSegment",
    "LineChart",
    "LineCheck",
    "LineDistanceFactor",
    "LineDistanceSpec",
    "LineStatus",
    "LineTrack",
    "LineTriangulation",
    "MovedLine",
    "NewLineFactor",
    "NewLineSpec",
    "ReprojectionPoints",
    "Residual",
    "RuledSurfaceFactor",
    "RuledSurfaceSpec",
    "SameLineFactor",
    "SameLineSpec",
    "SpecFactor",
    "State",
    "WindowSolution",
    "active_kernel",
    "bin_points",
    "build_factor",
    "check_lines",
    "clone_graph",
    "get_cmake_dir",
    "get_include",
    "isam2_params",
    "level_attitude",
    "levenberg_marquardt_params",
    "line_distance_factor",
    "line_from_ruling",
    "load_graph",
    "move_line",
    "native_factor",
    "new_line_factor",
    "preintegrate_frames",
    "ruled_surface_factor",
    "ruled_surface_factor_with_gravity_direction",
    "ruled_surface_factor_with_gravity_vector",
    "ruled_surface_pose_factor",
    "same_line_factor",
    "save_graph",
    "solve_first_window",
    "spec_of",
    "triangulate_line",
    "with_imu_noise",
]
