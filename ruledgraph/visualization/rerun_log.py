# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""A run for the Rerun viewer, to a file or a viewer as it goes: nothing of it is kept in memory.

- `world/body`: the live pose, and in it `camera/image` with `lines`, the rulings, and `points`,
  yellow until the line is in the graph;
- `world/live` and `world/smoothed`: the trajectories, a piece from each pose to the next;
- `world/window`: the lines in the window at each state, without badly known ones;
- `world/lines`: lines as they left the window, with `ends`; the badly known ones in
  `world/uncertain`, which the 3D view leaves out;
- `states`: velocity, biases, sigma of the position and number of lines at each state;
- `messages`: warnings, recoveries and changes of the status.

Times are those of the frames: `time`, since the first one, and `stamp`, the recording's own.
"""

import os
import socket
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, TypeAlias
from urllib.parse import urlsplit

import cv2
import numpy as np

from ruledgraph.calibration.rig import Calibration
from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.context import Closing
from ruledgraph.core.errors import MachineError, RuledgraphError
from ruledgraph.core.estimates import Estimate, LineEstimate
from ruledgraph.core.figure_style import line_color
from ruledgraph.core.measurements import Frame
from ruledgraph.odometry import Odometry
from ruledgraph.visualization.views import View, ViewQueue

# rerun's, which is imported when it is needed.
_Stream: TypeAlias = Any

VIEWER = "viewer"
_URL, _PORT = "rerun+http", 9876
# A viewer on another machine answers within, s.
_ANSWER = 5.0
_QUALITY = 85
# Of lines that are followed but not in the graph yet; no line of the graph has it.
_YELLOW = (255, 225, 40)
# A line whose worse end is known worse than this is uncertain, m.
_UNCERTAIN = 0.2
_AXES = ("x", "y", "z")
_STATES = ("velocity", "gyroscope_bias", "accelerometer_bias")
_LIVE, _SMOOTHED = (90, 200, 165), (255, 255, 255)


class RerunError(RuledgraphError):
    """Rerun is not installed, its file cannot be written, or no viewer answers."""


class RerunLog(Closing):
    """Writes an .rrd file, or streams to a viewer.

    Args:
        target: a file, which must not exist, and goes again without anything to write;
            `viewer`, which is the one of this machine, started if none runs; or the address of a
            running one, `rerun+http://HOST:9876/proxy`.
        calibration: of the camera and its mounting.

    Raises:
        RerunError: when rerun-sdk is not installed, the file cannot be written there, or no viewer
            answers or can be started.
    """

    def __init__(self, target: Path | str, calibration: Calibration) -> None:
        try:
            import rerun
        except ImportError:
            raise RerunError(
                "--rerun needs the package rerun-sdk: pip install 'rerun-sdk>=0.39'"
            ) from None
        self._rr = rerun
        self._target = str(target)
        to_viewer = self._target == VIEWER or self._target.startswith(_URL)
        self.path = None if to_viewer else Path(target)
        """The file, if it is one."""
        self._calibration = calibration
        self._stream = self._begin()
        self._first: int | None = None
        self._now, self._node = 0, -np.inf
        self._views = ViewQueue()
        self._last: dict[str, FloatArray] = {}
        self._status = ""
        self._logged = {"warnings": 0, "recoveries": 0}

    # -- what is logged ----------------------------------------------------------------------------

    def write(
        self,
        live: Sequence[Estimate],
        smoothed: Sequence[Estimate],
        lines: Sequence[LineEstimate],
    ) -> None:
        """Estimates and lines, as they come."""
        rr = self._rr
        for estimate in live:
            self._at(estimate.stamp)
            pose = estimate.world_T_body
            self._log("world/body", _transform(rr, pose))
            self._path_piece("world/live", pose.translation(), _LIVE)
            if estimate.at_state:
                self._states(estimate)
            if estimate.status != self._status:
                self._status = estimate.status
                self._log("messages", rr.TextLog(estimate.status, level="INFO"))
        for estimate in smoothed:
            self._at(estimate.stamp)
            self._path_piece("world/smoothed", estimate.world_T_body.translation(), _SMOOTHED)
        for line in lines:
            self._at(line.last_stamp)
            where = "world/lines" if _sigma(line) < _UNCERTAIN else "world/uncertain"
            color = line_color(line.id)
            strip = rr.LineStrips3D([line.ends], colors=[color], radii=-1.5)
            self._log(where, strip)
            self._log(f"{where}/ends", rr.Points3D(line.ends, colors=[color], radii=-2.5))

    def watch(self, odometry: Odometry, frame: Frame) -> None:
        """Images with rulings and points, lines of the window, warnings."""
        rr = self._rr
        for view in self._views.take(odometry, frame):
            self._now = view.frame.stamp
            self._at(self._now)
            self._image(view)
        if not self._now:
            return
        self._at(self._now)
        window = odometry.window
        recoveries = [*odometry.recoveries, *(window.recoveries if window is not None else ())]
        for name, texts in (("warnings", odometry.warnings), ("recoveries", recoveries)):
            for text in texts[self._logged[name] :]:
                self._log("messages", rr.TextLog(text, level="WARN"))
            self._logged[name] = len(texts)
        if window is not None and window.newest.time != self._node:
            self._node = window.newest.time
            outliers = odometry.config.lines.extent_outliers
            known = [line.estimate(outliers) for line in window.lines.values()]
            drawn = [x for x in known if x is not None and _sigma(x) < _UNCERTAIN]
            ends, colors = [line.ends for line in drawn], [line_color(x.id) for x in drawn]
            self._log("world/window", rr.LineStrips3D(ends, colors=colors, radii=-2.0))

    def _image(self, view: View) -> None:
        rr = self._rr
        _, encoded = cv2.imencode(".jpg", view.frame.image, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
        image = rr.EncodedImage(contents=encoded.tobytes(), media_type="image/jpeg")
        self._log("world/body/camera/image", image)
        camera = self._calibration.camera
        colors = [line_color(line.id) if line.in_graph else _YELLOW for line in view.lines]
        # Pixel (0, 0) has its centre at (0.5, 0.5) in Rerun.
        curves = [line.curve(camera) + 0.5 for line in view.lines]
        labels = [str(line.id) for line in view.lines]
        self._log(
            "world/body/camera/image/lines",
            rr.LineStrips2D(curves, colors=colors, labels=labels, radii=-1.5, show_labels=False),
        )
        points = [line.pixels(camera) + 0.5 for line in view.lines]
        spread = [color for color, each in zip(colors, points, strict=True) for _ in each]
        self._log(
            "world/body/camera/image/points",
            rr.Points2D(np.concatenate([np.empty((0, 2)), *points]), colors=spread, radii=-1.5),
        )

    def _states(self, estimate: Estimate) -> None:
        scalars = self._rr.Scalars
        bias = estimate.bias
        values = (estimate.velocity, bias.gyroscope(), bias.accelerometer())
        for name, value in zip(_STATES, values, strict=True):
            self._log(f"states/{name}", scalars(value))
        position = estimate.covariances[0][3:, 3:]
        self._log("states/position_sigma", scalars([float(np.sqrt(np.trace(position)))]))
        self._log("states/lines", scalars([float(estimate.lines)]))

    def _path_piece(self, where: str, position: FloatArray, color: tuple[int, int, int]) -> None:
        before = self._last.get(where)
        self._last[where] = position
        if before is not None:
            # A negative radius is in pixels, whatever the distance.
            piece = self._rr.LineStrips3D([[before, position]], colors=[color], radii=-2.5)
            self._log(where, piece)

    # -- the file or viewer ------------------------------------------------------------------------

    def _at(self, stamp: int) -> None:
        """Set the time of what is logged next."""
        if self._first is None:
            self._first = stamp
        self._stream.set_time("time", duration=np.timedelta64(stamp - self._first, "ns"))
        self._stream.set_time("stamp", timestamp=np.datetime64(stamp, "ns"))

    def _log(self, where: str, what: Any) -> None:
        self._stream.log(where, what)

    def _begin(self) -> _Stream:
        rr = self._rr
        stream = rr.RecordingStream("ruledgraph")
        if self.path is not None:
            _save(stream, self.path)
        else:
            self._connect(stream)
        camera = self._calibration.camera
        K = [[camera.fx, 0.0, camera.cx + 0.5], [0.0, camera.fy, camera.cy + 0.5], [0.0, 0.0, 1.0]]
        fixed = {
            "world": rr.ViewCoordinates.RIGHT_HAND_Z_UP,
            "world/body/camera": _transform(rr, self._calibration.body_T_cam),
            "world/body/camera/image": rr.Pinhole(
                image_from_camera=K,
                resolution=[camera.width, camera.height],
                image_plane_distance=0.3,
            ),
        } | {f"states/{name}": rr.SeriesLines(names=_AXES) for name in _STATES}
        for where, what in fixed.items():
            stream.log(where, what, static=True)
        return stream

    def _connect(self, stream: _Stream) -> None:
        try:
            if self._target == VIEWER:
                # pip installs it beside Python, where PATH may not lead.
                beside = Path(sys.executable).with_name("rerun")
                program = str(beside) if beside.exists() else None
                stream.spawn(executable_path=program, default_blueprint=_layout())
            else:
                _probe(self._target)
                stream.connect_grpc(self._target, default_blueprint=_layout())
            stream.flush(timeout_sec=_ANSWER)
        except (OSError, RuntimeError, ValueError) as error:
            reason = str(error).partition("\n")[0]
            raise RerunError(
                f"--rerun {self._target}: no Rerun viewer answers ({reason}); start one: rerun"
            ) from None

    def close(self) -> None:
        """Write what is left.

        Raises:
            MachineError: when not all could be written; what is in the file can be read.
            RerunError: when the viewer is gone.
        """
        try:
            self._stream.flush()
        except RuntimeError:
            if self.path is None:
                raise RerunError(f"--rerun {self._target}: the viewer is gone") from None
            raise MachineError(f"{self.path}: cannot be written; is there space left?") from None
        finally:
            self._stream.disconnect()
        if self.path is not None and self._first is None:
            self.path.unlink(missing_ok=True)


def _probe(url: str) -> None:
    """Whether something listens there: Rerun itself would try for long, and print."""
    address = urlsplit(url)
    with socket.create_connection((address.hostname, address.port or _PORT), _ANSWER):
        pass


def _save(stream: _Stream, path: Path) -> None:
    if path.exists():
        raise RerunError(f"{path}: exists already, choose another name")
    if not os.access(path.parent, os.W_OK):
        raise RerunError(f"{path}: cannot be written: {path.parent} is no folder to write in")
    try:
        stream.save(path, default_blueprint=_layout())
    except (OSError, RuntimeError) as error:
        raise RerunError(f"{path}: cannot be written: {error}") from None


def _transform(rr: Any, pose: Any) -> Any:
    return rr.Transform3D(translation=pose.translation(), mat3x3=pose.rotation().matrix())


def _sigma(line: LineEstimate) -> float:
    """Deviation of the worse end, m."""
    return max(float(np.sqrt(np.trace(covariance))) for covariance in line.covariance)


def _layout() -> Any:
    """Paths and finished lines from the start on, everything else as of the moment shown."""
    import rerun.blueprint as rrb

    until_now = rrb.VisibleTimeRanges(
        [
            rrb.VisibleTimeRange(
                timeline,
                start=rrb.TimeRangeBoundary.infinite(),
                end=rrb.TimeRangeBoundary.cursor_relative(nanos=0),
            )
            for timeline in ("time", "stamp")
        ]
    )
    kept = ("world/live", "world/smoothed", "world/lines", "world/lines/ends")
    plots = [
        rrb.TimeSeriesView(origin=f"states/{name}", name=title)
        for name, title in (
            ("lines", "lines in view"),
            ("position_sigma", "position sigma (m)"),
            ("velocity", "velocity (m/s)"),
            ("gyroscope_bias", "gyroscope bias (rad/s)"),
            ("accelerometer_bias", "accelerometer bias (m/s²)"),
        )
    ]
    return rrb.Blueprint(
        rrb.Vertical(
            rrb.Horizontal(
                rrb.Spatial2DView(origin="world/body/camera/image", name="camera"),
                rrb.Spatial3DView(
                    origin="world",
                    name="trajectory and lines",
                    contents=["$origin/**", "- $origin/uncertain/**"],
                    background=[18, 23, 31],
                    overrides={where: [until_now] for where in kept},
                ),
                column_shares=[4, 5],
            ),
            rrb.Horizontal(
                *plots[:3],
                rrb.Tabs(
                    *plots[3:], rrb.TextLogView(origin="messages", name="messages"), active_tab=2
                ),
            ),
            row_shares=[7, 3],
        ),
        rrb.TimePanel(timeline="time", state="collapsed"),
        collapse_panels=True,
    )
