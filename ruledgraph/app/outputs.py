# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""What a run writes or shows beside its results: pictures, a video, a Rerun log, a ROS 2 bag."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from ruledgraph.app.steps import Step
from ruledgraph.calibration.rig import Calibration
from ruledgraph.core.context import Closing
from ruledgraph.core.estimates import Estimate, LineEstimate
from ruledgraph.core.measurements import Frame
from ruledgraph.evaluation.ground_truth import GroundTruth
from ruledgraph.odometry import Odometry

if TYPE_CHECKING:  # it takes long to load
    from ruledgraph.visualization.plots import PlotRecorder

_Watch: TypeAlias = Callable[[Odometry, Frame], None]
_Write: TypeAlias = Callable[[Sequence[Estimate], Sequence[Estimate], Sequence[LineEstimate]], None]


@dataclass(frozen=True)
class OutputOptions:
    """Which of them are wanted."""

    plots: bool = False
    directrices: bool = False
    """In the plots."""
    video: Path | None = None
    rerun: str | None = None
    """A file, `viewer`, or a viewer's address."""
    ros2_bag: Path | None = None

    @property
    def replaceable(self) -> list[Path]:
        """The files, by their suffixes, that --force replaces beside the folder of results."""
        rerun = Path(self.rerun) if self.rerun else None
        named = (self.video, ".mp4"), (rerun, ".rrd"), (self.ros2_bag, ".mcap")
        return [path for path, suffix in named if path and path.suffix == suffix]


class Outputs(Closing):
    """All outputs that are wanted, opened together and closed together, however a run ends.

    Args:
        options: which they are.
        calibration: of the run.

    Raises:
        RuledgraphError: when one cannot be opened, as where its file exists; those before it are
            closed. `close` raises `MachineError` when one could not be written to its end; the
            others are closed all the same.
    """

    def __init__(self, options: OutputOptions, calibration: Calibration) -> None:
        self._options = options
        self._plots: PlotRecorder | None = None
        self._rerun_file: Path | None = None
        self._writes: list[_Write] = []
        self._watches: list[_Watch] = []
        with ExitStack() as opened:
            self._open(opened, calibration)
            self._opened = opened.pop_all()

    def observe(self, step: Step) -> None:
        """Hand a step on."""
        for write in self._writes:
            write(step.live, step.smoothed, step.lines)
        if step.frame is not None and isinstance(step.odometry, Odometry):
            for watch in self._watches:
                watch(step.odometry, step.frame)

    def close(self) -> None:
        """Finish the files."""
        self._opened.close()

    def draw(self, folder: Path, truth: GroundTruth | None) -> None:
        """Draw the pictures, if they are wanted, of the results in a folder."""
        if self._plots is not None:
            self._plots.draw(folder, truth, directrices=self._options.directrices)

    @property
    def rerun_file(self) -> Path | None:
        """The file for the Rerun viewer, where there is one."""
        file = self._rerun_file
        return file if file is not None and file.exists() else None

    def messages(self) -> Iterator[str]:
        """Where the video and the ROS 2 bag are, for those that have been written."""
        video, bag = self._options.video, self._options.ros2_bag
        if video is not None and video.exists():
            yield f"video: {video}"
        if bag is not None and bag.exists():
            yield f"for RViz and Foxglove: {bag}"

    def _open(self, opened: ExitStack, calibration: Calibration) -> None:
        options = self._options
        if options.plots:
            from ruledgraph.visualization.plots import PlotRecorder

            self._plots = PlotRecorder(calibration.camera)
            self._watches.append(self._plots.watch)
        if options.rerun is not None:
            from ruledgraph.visualization.rerun_log import RerunLog

            log = opened.enter_context(RerunLog(options.rerun, calibration))
            self._rerun_file = log.path
            self._writes.append(log.write)
            self._watches.append(log.watch)
        if options.video is not None:
            from ruledgraph.visualization.video import Video

            video = opened.enter_context(Video(options.video, calibration.camera))
            self._watches.append(video.watch)
        if options.ros2_bag is not None:
            from ruledgraph.app.ros_output import Ros2Output

            bag = opened.enter_context(Ros2Output(options.ros2_bag, calibration))
            self._writes.append(bag.write)
