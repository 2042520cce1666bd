# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Numbers that shape an estimate stand in `Config`; which others a stage may have is said here."""

import ast
from pathlib import Path

import ruledgraph
from ruledgraph.core.config import Config

ROOT = Path(ruledgraph.__file__).parent
STAGES = ("frontend", "backend", "integrity", "imu")

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
    "backend/landmarks.py": {"_KEPT": MEMORY, "_INFINITE": NUMERICS, "_PARALLEL": NUMERICS},
    "backend/line_distance.py": {"_KNOWN": "three standard deviations"},
    "backend/line_fit.py": {"_AT_INFINITY": NUMERICS},
    "backend/line_graph_builder.py": {"_MIN_REANCHOR_SIGMA": NUMERICS},
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
    "frontend/rolling_edges.py": {"_THROUGH_CENTRE": NUMERICS},
    "frontend/row_motion.py": {"_REPETITIONS": "until a fixed point stands"},
    "frontend/ruling_prediction.py": {
        "_THROUGH_CENTRE": NUMERICS,
        "_AT_INFINITY": NUMERICS,
        "_ALONG_RAY": NUMERICS,
    },
    "frontend/sobel.py": dict.fromkeys(
        ("_THRESHOLD", "_SPACING"),
        "belongs to the paper's method, which is kept for comparison",
    ),
    "frontend/tracker.py": {"_UNBOUNDED": "stands for infinity: beyond any image"},
    "integrity/variance_factor.py": {"_SIGMAS": "the bounds that errors are held against"},
    "imu/buffer.py": {"_REPEATS_KEPT": MEMORY},
    "imu/faults.py": {
        "_CHANGES": MEMORY,
        "_OF_STEPS": "definition: the first decile, below which interpolated readings are left out",
    },
    "imu/image_input.py": dict.fromkeys(
        ("_MANY_CLOSE", "_CLOSE"), "tells a wrong unit from stamps that scatter"
    ),
    "integrity/unmoved_lines.py": {"_NOISE": "how well lines of real images are found"},
    "imu/rest.py": {"_MIN_READINGS": "two readings, less their mean, have no integral"},
    "imu/synchronizer.py": {"_UNRELATED": "chooses the words of a warning"},
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
