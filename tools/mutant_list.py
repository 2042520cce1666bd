# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Mistakes that tests should notice, for `mutants.py`."""

from typing import NamedTuple


class Mutant(NamedTuple):
    """A mistake: a text of a file of a package, and what is put in its position."""

    file: str
    old: str
    new: str
    tests: tuple[str, ...]
    """Files of which a test should fail."""


_AREAS: tuple[tuple[str, str, tuple[tuple[str, str], ...]], ...] = (
    # Results.
    (
        "app/results.py",
        "app/test_results",
        (
            (
                '_rotation_{a}" for a in _AXES),\n    *(f"sigma_position_',
                '_position_{a}" for a in _AXES),\n    *(f"sigma_rotation_',
            ),
            (
                "            pose,\n            velocity,",
                "            velocity,\n            pose,",
            ),
            ("bias[3:],\n            bias[:3],", "bias[:3],\n            bias[3:],"),
            ("np.sqrt(np.diag(c))", "np.diag(c)"),
            ("attitude.unrotate(", "attitude.rotate("),
            ("if estimate.at_state:", "if not estimate.at_state:"),
            ("line.ends.ravel()", "line.ends[::-1].ravel()"),
            ("seconds(line.first_stamp)", "seconds(line.last_stamp)"),
        ),
    ),
    (
        "app/trajectory_files.py",
        "app/test_outputs",
        (("[w, x, y, z]", "[x, y, z, w]"), ("estimate.matrix[:3]", "estimate.matrix.T[:3]")),
    ),
    (
        "app/ros_output.py",
        "app/test_outputs",
        (
            ("A[:3, 3:] = A[3:, :3] = R", "A[:3, :3] = A[3:, 3:] = R"),
            ("twist[:3, :3] += turned", "twist[:3, :3] -= turned"),
        ),
    ),
    # Integrity.
    (
        "integrity/gauge.py",
        "integrity/test_gauge",
        (
            ("        + of_velocity * gap**2\n", ""),
            ("of_velocity * gap**2", "of_velocity * gap"),
            ("attitude @ of_pose[3:, 3:] @ attitude.T", "of_pose[3:, 3:]"),
            ("0.5 * config.gap_acceleration", "config.gap_acceleration"),
            ("(config.gap_rotation_rate * gap) ** 2", "(config.gap_rotation_rate * gap)"),
            ("M[1, 0] - M[0, 1]", "M[0, 1] - M[1, 0]"),
            ("+ fading * last.velocity", "- fading * last.velocity"),
            ("R.T @ self.position_covariance @ R", "self.position_covariance"),
            ("np.cross(UP, velocity)", "velocity"),
        ),
    ),
    (
        "integrity/contradictions.py",
        "integrity/test_monitor",
        (("misfits / compared if", "0.5 * misfits / compared if"),),
    ),
    (
        "integrity/parallel_lines.py",
        "integrity/test_monitor",
        (
            ("1.0 - self._config.parallel_spread", "1.0 - 10.0 * self._config.parallel_spread"),
            ("velocity_variance * elapsed**2", "velocity_variance * elapsed"),
        ),
    ),
    (
        "integrity/monitor.py",
        "integrity/test_monitor",
        (
            ("max(1.0, self._variance.estimate)", "self._variance.estimate"),
            ("= self._variance.of_covariances", "= self._variance.estimate"),
        ),
    ),
    (
        "integrity/variance_factor.py",
        "integrity/test_variance_factor",
        (
            ("if sums and sums[0].time <= innovation.since:", "if sums:"),
            ("(t / _SIGMAS) ** 2", "t / _SIGMAS"),
            ("kept * self.nis", "self.nis"),
            ("len(sums) > 1 and sums[1].time", "len(sums) > 1 and sums[0].time"),
            ("return dof * expected * float(", "return dof * float("),
            ("fdtri(dof, known, conf", "fdtri(known, dof, conf"),
        ),
    ),
    (
        "backend/bias_jump.py",
        "backend/test_bias_jump",
        (
            ("ratio > threshold and", ""),
            ("each.line.inverse_distance().is_known", "True"),
            ("jump.squares < none.squares", "jump.squares < np.inf"),
            ("@ line.covariance @", "@ (0.01 * line.covariance) @"),
        ),
    ),
    (
        "backend/innovation.py",
        "backend/test_innovation",
        (
            ("shares > _MIN_GAIN", "shares > -1.0"),
            ("steps**2 / shares[observed]", "steps**2"),
            ("found.bias.vector() - predicted.bias.vector()", "np.zeros(6)"),
            ("self._predictions[0]", "self._predictions[-1]"),
        ),
    ),
    (
        "simulation/inertial_motion.py",
        "simulation/test_inertial_motion",
        (
            (
                "noiseModel.Robust.Create(noiseModel.mEstimator.Huber.Create(_HUBER), sigmas)",
                "sigmas",
            ),
            (
                "np.searchsorted(middles, measured.stamps)",
                "1 + np.searchsorted(middles, measured.stamps)",
            ),
            ("+ 0.5) * _BIAS_TIME", ") * _BIAS_TIME"),
        ),
    ),
    (
        "integrity/rest_slide.py",
        "integrity/test_monitor",
        (
            ("self._slide = self._slide, position", "self._slide = self._slide, 9 * position"),
            ("np.outer(self._slide, self._slide)", "np.zeros((3, 3))"),
        ),
    ),
    (
        "integrity/rest.py",
        "integrity/test_rest",
        (
            ("self.image_motion(begin) <", "self.image_motion(begin) >"),
            ("begin = min(begin,", "begin = max(begin,"),
        ),
    ),
    (
        "imu/rest.py",
        "integrity/test_rest",
        (("imu - mean, times", "imu, times"), ("3.0 * sigmas", "30.0 * sigmas")),
    ),
    # Initialization.
    (
        "initialization/at_rest.py",
        "initialization/test_at_rest",
        (
            ("force - of_gravity, samples", "force, samples"),
            ("samples.gyroscope.mean(axis=0)", "np.zeros(3)"),
            ("config.start.gravity_share * gravity", "gravity"),
        ),
    ),
    (
        "initialization/prior.py",
        "initialization/test_at_rest",
        (("attitude.matrix().T @", "attitude.matrix() @"), ("_GAUGE = 1e-4", "_GAUGE = 1e-3")),
    ),
    (
        "initialization/in_motion.py",
        "initialization/test_in_motion",
        (
            ("sigma < start.velocity_sigma", "sigma < 2.0 * start.velocity_sigma"),
            ("sigma < start.velocity_sigma", "sigma < 0.5 * start.velocity_sigma"),
            ("speed < sure * along", "speed < 2.0 * sure * along"),
            ("along > start.rest_velocity_sigma and", ""),
            ("outliers > start.outlier_share", "outliers > 2.0 * start.outlier_share"),
            ("return True  # it may be any", "return False"),
            ("key=lambda batch: batch.error)", "key=lambda batch: -batch.error)"),
            ("for other in best[1:]", "for other in best[1:2]"),
        ),
    ),
    (
        "initialization/levenberg_marquardt.py",
        "initialization/test_batch_problem",
        (("lowered < _TOLERANCE * (cost + lowered)", "True"),),
    ),
    (
        "initialization/batch_problem.py",
        "initialization/test_batch_problem",
        (
            ("+ 0.5 * np.sum(", "+ 1.0 * np.sum("),
            ("+= _LINE_PRIOR * at.deltas", "-= _LINE_PRIOR * at.deltas"),
        ),
    ),
    (
        "initialization/bordered_system.py",
        "initialization/test_bordered_system",
        (
            ("- border.transpose(0, 2, 1) @ by_line", "+ border.transpose(0, 2, 1) @ by_line"),
            ("diagonal += damping", "diagonal += 2.0 * damping"),
        ),
    ),
    (
        "core/config.py",
        "initialization/test_in_motion",
        (
            ("velocity_sigma: float = number(0.12,", "velocity_sigma: float = number(0.24,"),
            ("velocity_sigma: float = number(0.12,", "velocity_sigma: float = number(0.06,"),
            ("outlier_share: float = number(0.35,", "outlier_share: float = number(0.45,"),
            ("outlier_share: float = number(0.35,", "outlier_share: float = number(0.2,"),
        ),
    ),
    (
        "ruledgraph_factors/closed_form.py",
        "factors/test_closed_form",
        (
            ("by_centre * (0.5 * t * t)", "by_centre * (t * t)"),
            ("+ rotations @ body_p_cam", "- rotations @ body_p_cam"),
            ("bias = bias - step", "bias = bias + step"),
            ("rough = -gravity_magnitude *", "rough = gravity_magnitude *"),
        ),
    ),
    (
        "segments/trial.py",
        "segments/test_trial",
        (
            ("time + self._config.trial_time", "time"),
            ("(1.0 - self._config.trial_min_stay)", "2.0 * (1.0 - self._config.trial_min_stay)"),
            ("whitened @ whitened", "abs(whitened).max()"),
        ),
    ),
    # Back end.
    (
        "backend/landmarks.py",
        "backend/test_landmarks",
        (
            ("by_delta @ self.covariance @", "4.0 * by_delta @ self.covariance @"),
            ("[outliers, 1.0 - outliers]", "[1.0 - outliers, outliers]"),
        ),
    ),
    (
        "core/config.py",
        "backend/test_window_recovery",
        (
            ("jump_position: float = number(1.0,", "jump_position: float = number(100.0,"),
            ("jump_velocity: float = number(3.0,", "jump_velocity: float = number(300.0,"),
        ),
    ),
    (
        "backend/sliding_window.py",
        "backend/test_innovation",
        (("if interval.node.time == self.solved:", "if True:"),),
    ),
    (
        "backend/state_sequence.py",
        "backend/test_sliding_window",
        (("[0].node.time >= time", "[0].node.time >= time - 0.5"),),
    ),
    (
        "backend/rest_factors.py",
        "backend/test_sliding_window",
        (
            ("Sigma(3, config.velocity_sigma)", "Sigma(3, 100.0 * config.velocity_sigma)"),
            ("Sigma(6, config.pose_sigma)", "Sigma(6, 100.0 * config.pose_sigma)"),
        ),
    ),
    (
        "backend/line_factors.py",
        "backend/test_sliding_window",
        (
            ("if cauchy_scale > 0.0:", "if cauchy_scale > 1e9:"),
            ("math.log(config.prior_distance_factor)", "1e-2"),
        ),
    ),
    (
        "backend/window_solver.py",
        "backend/test_unknown_distance",
        (("            self._solve(again)\n", "            break\n"),),
    ),
    (
        "backend/recovery.py",
        "backend/test_window_recovery",
        (("if id(line) not in kept:", "if id(line) in kept:"),),
    ),
    # Front end.
    (
        "frontend/edge_search.py",
        "frontend/test_edge_search",
        (
            ("0.5 * (lft - rgt)", "0.5 * (rgt - lft)"),
            ("np.float32(np.sign(ruling.slope))", "np.float32(1.0)"),
            (">= -np.float32(config.stripe_share) * middle", ">= -9.0 * middle"),
        ),
    ),
    (
        "core/image_config.py",
        "frontend/test_edge_search",
        (
            (
                "rival_distance_px: float = number(3.0,",
                "rival_distance_px: float = number(50.0,",
            ),
            ("min_support: float = number(0.35,", "min_support: float = number(0.0,"),
        ),
    ),
    (
        "frontend/tracker.py",
        "frontend/test_tracker",
        (
            ("first + gain * a, second +", "first - gain * a, second +"),
            ("statistics, self._edges.effective_points)", "statistics, 1e9)"),
            ("sightings[0].stamp < before", "sightings[0].stamp > before"),
        ),
    ),
    (
        "frontend/duplicates.py",
        "frontend/test_tracker",
        (("(same >= config.duplicate_cosine) & near", "near"),),
    ),
    (
        "frontend/ruling_prediction.py",
        "frontend/test_ruling_prediction",
        (
            ("(moment - direction @ hat_p.T) @ R", "(moment + direction @ hat_p.T) @ R"),
            ("ends + moved[..., None]", "ends - moved[..., None]"),
            ("focal * np.sqrt(np.maximum(variance, 0.0))", "np.sqrt(np.maximum(variance, 0.0))"),
            ("track.config.sigma_growth**track.misses", "1.0"),
        ),
    ),
)

_FACTORS = ("ruledgraph_factors/", "factors/")


def _within(folder: str, name: str) -> str:
    return name if name.startswith(_FACTORS) else f"{folder}/{name}"


MUTANTS = tuple(
    Mutant(_within("ruledgraph", file), old, new, (f"tests/{_within('ruledgraph', tests)}.py",))
    for file, tests, changes in _AREAS
    for old, new in changes
)
