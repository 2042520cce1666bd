# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Numbers that shape an estimate stand in `Config`; which others a stage may have is said here."""

import ast
from pathlib import Path

import ruledgraph
from ruledgraph.core.config import Config

ROOT = Path(ruledgraph.__file__).parent
STAGES = (
    "frontend",
    "backend",
    "integrity",
    "imu",
    "synchronization",
    "initialization",
    "segments",
)

NUMERICS = "guards against dividing by nothing"
MEMORY = "bounds memory or work"
ALLOWED = {
    "backend/bias_jump.py": {
        "JUMP_DOF": "three axes of two sensors",
        "_CONVERGED": "far below one, a standard deviation",
        "_MAX_ITERATIONS": MEMORY,
        "_QUADRATIC": NUMERICS,
    },
    "backend/innovation.py": {"_MIN_GAIN": "below it what images tell is lost in linearisation"},
    "backend/landmarks.py": {"_KEPT": MEMORY, "_INFINITE": NUMERICS},
    "backend/line_distance.py": {"_KNOWN": "three standard deviations"},
    "backend/line_fit.py": {"_AT_INFINITY": NUMERICS},
    "backend/line_graph_builder.py": {"_MIN_RECENTRE_SIGMA": NUMERICS},
    "backend/line_weights.py": {
        "_NO_NOISE": NUMERICS,
        "_LINE_DOF": "counts unknowns",
        "_STATE_DOF": "counts unknowns",
    },
    "backend/line_merging.py": {
        "_PARALLEL": "up to which angle the chart is close to linear",
        "_ROUNDING": NUMERICS,
    },
    "frontend/detection.py": {"_MAX_PREFETCHED": MEMORY},
    "frontend/edge_batch.py": {"_LEVEL": NUMERICS, "_MIN_PART": NUMERICS},
    "frontend/field_of_view.py": {"_WIDEST": "beyond it a pixel says next to nothing"},
    "frontend/front_end.py": {
        "_MAX_GRADIENTS": MEMORY,
    },
    "frontend/gradient.py": {
        "BORDER_PX": "follows from the width of blur and derivative",
        "_BLUR": "belongs to the derivative",
        "_WIDTH": "belongs to the derivative",
        "_SCALE": "belongs to Scharr's derivative",
    },
    "frontend/line_detection.py": dict.fromkeys(
        ("_HOUGH_ROUNDS", "_HOUGH_REMOVE", "_LSD_STEPS"), "belongs to the detector's method"
    ),
    "frontend/row_motion.py": {"_REPETITIONS": "until a fixed point stands"},
    "frontend/ruling_prediction.py": {
        "_AT_INFINITY": NUMERICS,
        "_MIN_ELAPSED": NUMERICS,
    },
    "frontend/sobel.py": dict.fromkeys(
        ("_THRESHOLD", "_SPACING"),
        "belongs to the paper's method, which is kept for comparison",
    ),
    "frontend/tracker.py": {"_UNBOUNDED": "stands for infinity: beyond any image"},
    "integrity/variance_factor.py": {"_SIGMAS": "the bounds that errors are held against"},
    "imu/buffer.py": {"_REPEATS_KEPT": MEMORY},
    "synchronization/camera_clock.py": {"_SIGNIFICANT": "three standard deviations"},
    "imu/propagation.py": {"_SHORTEST": NUMERICS},
    "imu/faults.py": {
        "_CHANGES": MEMORY,
        "_OF_STEPS": "definition: the first decile, below which interpolated readings are left out",
    },
    "synchronization/image_input.py": dict.fromkeys(
        ("_MANY_CLOSE", "_CLOSE"), "tells a wrong unit from stamps that scatter"
    ),
    "integrity/unmoved_lines.py": {"_NOISE": "how well lines of real images are found"},
    "imu/rest.py": {"_MIN_READINGS": "two readings, less their mean, have no integral"},
    "synchronization/synchronizer.py": {"_UNRELATED": "chooses the words of a warning"},
    "initialization/batch.py": {"_BETTER": "a chi-square of two: more than rounding"},
    "initialization/bordered_system.py": dict.fromkeys(("_MIN", "_MAX"), NUMERICS),
    "initialization/calibration_search.py": {"_SIGNIFICANT": "three standard deviations"},
    "initialization/image_rotation.py": {
        "POINT_SIGMA": "where to begin: the noise is found from what is left over",
        "_CAUCHY": "an efficiency of 95 % for Gaussian noise",
        "_MEDIAN": "the median of a Gaussian's absolute value",
        "_EPIPOLE": NUMERICS,
        "_POINTS": MEMORY,
        "_MIN_POINTS": "four times the unknowns of a pair",
        "_RETURNS": "a point that comes back elsewhere was not followed",
    },
    "initialization/in_motion.py": {
        "_MAX_FRAMES": MEMORY,
        "_SEEN_SHARE": MEMORY,
        "_MIN_SIGHTINGS": "fewer say less than a line's four coordinates",
        "_DISTANCES": "where hypotheses begin, a factor of three apart",
        **dict.fromkeys(("_WIDE", "_NARROW", "_BETWEEN"), "on the way to the smoother's own loss"),
        "_MIN_LINES": "along a single line no motion is seen",
        "_STATE_DOF": "counts unknowns",
    },
    "initialization/initial_values.py": dict.fromkeys(
        ("_NEAR", "_FAR", "_BETWEEN"), "where lines begin that the closed form does not place"
    ),
    "initialization/levenberg_marquardt.py": dict.fromkeys(
        ("_FIRST_DAMPING", "_FACTOR", "_MAX_DAMPING", "_MIN_FIDELITY", "_TOLERANCE"),
        "belongs to the method: GTSAM's",
    ),
    "initialization/mounting_check.py": {
        "MIN_PAIRS": "400 points, whose median is known to 6 %",
        "BETTER": "far beyond what two such medians differ by",
        "_USUAL_ERROR": "what good calibrations leave, doubled",
        "_MIRRORS": "definition of the two mirrors",
    },
    "initialization/prior.py": {"_GAUGE": NUMERICS},
    "initialization/readout.py": {
        "_READOUT_STEP": "of a grid, between whose points the minimum is interpolated",
        "_OFFSET_STEP": "of a grid, between whose points the minimum is interpolated",
        "_UNMODELLED": "what the model leaves out, measured",
        "_BETTER": "a chi-square that no chance gives",
        "_CONFIDENCE": "of a test",
    },
    "initialization/readout_search.py": {
        "_SIGNIFICANT": "three standard deviations",
        "_ENOUGH": "half a pixel of a hand's rotation",
        "_MIN_PAIRS": "the fewest of which a sign test says enough",
    },
    "initialization/rotation_fit.py": {
        "PARAMETERS": "counts unknowns",
        "MIN_RATE_VARIATION": "far above the noise of a rate of rotation by images",
        "_DIFFERENCE": "of a numerical derivative",
        "_STEPS": MEMORY,
    },
    "initialization/time_offset_finder.py": {
        "RANGE": "of the search",
        **dict.fromkeys(
            ("_STEP", "_FINE"), "of a grid, between whose points the minimum is interpolated"
        ),
        **dict.fromkeys(("_APART", "_TOO_FAR"), "chooses pairs of images"),
        "_MIN_FREE": "fewer say nothing of a variance",
        "_NEW_SHARE": "how often to look: the result hardly depends on it",
        **dict.fromkeys(("_BEYOND", "_BEATEN"), "a chi-square that no chance gives"),
        "_UNMODELLED": "what the model leaves out: stamps scatter, rows are read in turn",
    },
    "segments/rows.py": {"_ROWS": "a grid about as fine as the IMU's samples"},
}


def numeric_constants(path: Path) -> set[str]:
    """Names in capitals that a module binds to numbers, or to sequences of them."""
    found = set()
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        if not isinstance(node, ast.Assign | ast.AnnAssign) or node.value is None:
            continue
        targets = node.targets if isinstance(node, ast.Assign) else [node.target]
        for target in targets:
            tupled = isinstance(target, ast.Tuple) and isinstance(node.value, ast.Tuple)
            pairs = (
                zip(target.elts, node.value.elts, strict=True) if tupled else [(target, node.value)]
            )
            for name, value in pairs:
                if isinstance(name, ast.Name) and name.id.isupper() and _is_number(value):
                    found.add(name.id)
    return found


def _is_number(value: ast.expr) -> bool:
    """Whether an expression is made of literal numbers alone, whatever is called on them."""
    if isinstance(value, ast.Constant):
        return isinstance(value.value, int | float) and not isinstance(value.value, bool)
    if isinstance(value, ast.UnaryOp):
        return _is_number(value.operand)
    if isinstance(value, ast.BinOp):
        return _is_number(value.left) and _is_number(value.right)
    if isinstance(value, ast.Tuple | ast.List):
        return bool(value.elts) and all(map(_is_number, value.elts))
    if isinstance(value, ast.Dict):
        return bool(value.values) and all(map(_is_number, value.values))
    return False


def test_every_number_of_a_stage_is_a_setting_or_has_a_reason():
    found = {
        str(path.relative_to(ROOT)): numbers
        for stage in STAGES
        for path in sorted((ROOT / stage).glob("*.py"))
        if (numbers := numeric_constants(path))
    }
    assert found == {path: set(reasons) for path, reasons in ALLOWED.items()}


def test_every_setting_is_used_by_some_stage():
    sources = [p for p in sorted(ROOT.rglob("*.py")) if p.parent.name != "core"]
    used = {
        node.attr
        for path in sources
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Attribute)
    }
    assert [f"{name}.{key}" for name, part in Config() for key, _ in part if key not in used] == []
