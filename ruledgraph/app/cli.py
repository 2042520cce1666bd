# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The `ruledgraph` command. Thin: it parses arguments and calls the package.

Whatever is slow to import is imported where it is used, so that `--help` comes at once.
"""

import gc
from pathlib import Path
from typing import Any

import click

from ruledgraph.app.options import calibration_options, recording_options
from ruledgraph.app.settings_command import settings
from ruledgraph.core.errors import RuledgraphError


class _Group(click.Group):
    """Turns the package's errors into one line and exit code 2."""

    def invoke(self, ctx: click.Context) -> Any:
        try:
            return super().invoke(ctx)
        except RuledgraphError as error:
            click.echo(f"ruledgraph: {error}", err=True)
            ctx.exit(2)


def _print_version(context: click.Context, _option: click.Parameter, wanted: bool) -> None:
    if wanted:
        from ruledgraph.core.versions import version_text
        from ruledgraph_factors import FactorError

        try:
            click.echo(version_text())
        except FactorError as error:
            raise click.UsageError(str(error)) from None
        context.exit()


@click.group(cls=_Group, no_args_is_help=True)
@click.option(
    "--version",
    is_flag=True,
    is_eager=True,
    expose_value=False,
    callback=_print_version,
    help="Show the versions of ruledgraph, gtsam, numpy, Python, and the kernel.",
)
def main() -> None:
    """Line-based visual-inertial odometry as a GTSAM backend."""


main.add_command(settings)


@main.command()
@click.argument("recording", type=click.Path(path_type=Path))
@calibration_options
@recording_options
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@click.option(
    "--plots",
    type=click.Path(path_type=Path),
    metavar="FOLDER",
    help="Draw its timing and IMU into it.",
)
def info(recording: Path, **options: Any) -> None:
    """Show what a RECORDING holds, what would be used of it, and whether that will do.

    RECORDING is a ROS 1 bag, a ROS 2 bag's folder, an MCAP file or a EuRoC (ASL) folder. All of
    its stamps are read, so damage and gaps show. With a calibration its figures are looked at, too,
    and whether the images turn as the gyroscope does.

    \b
    Examples:
      ruledgraph info flight.bag --duration 30
      ruledgraph info flight.bag --calibration calib.yaml --plots flight_timing
    """
    from ruledgraph.app.info_command import info_command

    info_command(recording, **options)


@main.command()
@click.argument("recording", type=click.Path(path_type=Path))
@click.argument("out", type=click.Path(path_type=Path))
@click.option(
    "--format",
    "kind",
    type=click.Choice(["rosbag1", "rosbag2", "mcap", "asl"]),
    required=True,
    help="rosbag2 is a folder with an sqlite3 file, asl a folder as of EuRoC.",
)
@recording_options
def export(recording: Path, out: Path, kind: Any, **choice: Any) -> None:
    """Write the camera and the IMU of a RECORDING to OUT in another format.

    Frames are written grey, 8 bit, without loss. OUT must not exist.

    \b
    Example:
      ruledgraph export flight.bag flight_euroc --format asl
    """
    from ruledgraph.recording import open_recording, write_recording

    source = open_recording(recording, **choice)
    write_recording(source.stream(), out, kind)
    for warning in source.report.warnings:
        click.echo(f"warning: {warning}", err=True)
    report = source.report
    click.echo(f"{out}: {report.frames.count} frames, {report.imu.count} IMU samples")


def _list_simulations(context: click.Context, _option: click.Parameter, wanted: bool) -> None:
    if wanted:
        from ruledgraph.simulation.options import catalogue

        click.echo(catalogue())
        context.exit()


@main.command()
@click.argument("scene")
@click.argument("motion")
@click.argument("out", type=click.Path(path_type=Path), required=False)
@click.option(
    "--list",
    is_flag=True,
    is_eager=True,
    expose_value=False,
    callback=_list_simulations,
    help="Show all scenes and motions.",
)
@click.option(
    "--format",
    "kind",
    type=click.Choice(["rosbag1", "rosbag2", "mcap", "asl"]),
    help="Of OUT, by default what its suffix says.",
)
@click.option(
    "--preview",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="PNG",
    help="Write a contact sheet; OUT may then be left out.",
)
@click.option("--duration", type=float, help="Seconds; by default 12, or all of a measured motion.")
@click.option("--start", type=float, default=0.0, help="Where in a measured motion to begin, s.")
@click.option(
    "--moving-start", is_flag=True, help="Start at full speed, not with a second of rest."
)
@click.option("--seed", type=click.IntRange(min=0), default=0, help="Of all randomness.")
@click.option(
    "--calibration",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Camera, IMU and mounting; by default like a RealSense D435i.",
)
@click.option("--resolution", metavar="WxH", help="Of the images, by default the calibration's.")
@click.option("--rate", type=float, default=90.0, show_default=True, help="Frames a second.")
@click.option(
    "--imu",
    metavar="d435i|euroc|none|FILE",
    help="Noise, or EuRoC's imu0.csv that goes with a measured motion.",
)
@click.option("--imu-rate", type=float, default=200.0, show_default=True, help="Samples a second.")
def simulate(
    scene: str, motion: str, out: Path | None, kind: Any, preview: Path | None, **options: Any
) -> None:
    """Simulate a recording of a SCENE along a MOTION, with ground truth.

    OUT is a .bag (ROS 1), an .mcap, or a folder, and must not exist. Beside it come the
    calibration (.calib.yaml), the true poses (.gt.tum) and the scene's lines (.lines.csv). MOTION
    may be a TUM file or EuRoC's CSV of a real flight; the room is then built around it.

    \b
    Examples:
      ruledgraph simulate --list
      ruledgraph simulate square_cluttered circular-tilted-rot-x sim.bag
      ruledgraph simulate room flight/groundtruth.csv flight.bag --imu flight/imu0.csv --rate 20
    """
    from ruledgraph.simulation.options import kind_of, simulation_from_options
    from ruledgraph.simulation.write import (
        Files,
        check_free,
        write_contact_sheet,
        write_with_progress,
    )

    if out is None and preview is None:
        raise click.UsageError("name OUT, or --preview for a contact sheet alone")
    if out:
        kind = kind_of(out, kind)
        check_free(*Files.beside(out))
    if preview:
        check_free(preview)
    simulation = simulation_from_options(scene, motion, **options)
    if preview:
        write_contact_sheet(simulation, preview)
        click.echo(str(preview))
    if out:
        files = write_with_progress(simulation, out, kind)
        for path in files:
            click.echo(str(path))


@main.command()
@click.argument("recording", type=click.Path(path_type=Path))
@calibration_options
@click.option(
    "--output",
    type=click.Path(path_type=Path),
    metavar="FOLDER",
    help="Where the results go; by default results/<name>-<time>.",
)
@click.option(
    "--ground-truth",
    type=click.Path(),
    metavar="FILE|TOPIC",
    help="To report errors against.",
)
@click.option(
    "--config",
    "config_file",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Settings, YAML.",
)
@click.option("--set", "settings", multiple=True, metavar="SECTION.KEY=VALUE", help="One setting.")
@click.option(
    "--time-offset",
    type=click.FloatRange(-10.0, 10.0),
    metavar="SECONDS",
    help="How much later frames are taken than their stamps say, on the IMU's clock; instead of "
    "the calibration's timeshift_cam_imu.",
)
@click.option("--plots", is_flag=True, help="Draw pictures of the results.")
@click.option("--directrices", is_flag=True, help="With --plots, draw the paper's directrices too.")
@click.option(
    "--video",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="MP4",
    help="Write a video of the images with their lines.",
)
@click.option(
    "--rerun",
    type=click.Path(path_type=Path),
    metavar="RRD",
    help="Write a file for the Rerun viewer; needs rerun-sdk.",
)
@click.option(
    "--solver",
    type=click.Choice(["graph", "paper"]),
    default="graph",
    show_default=True,
    help="The factor graph, or the paper's own solver as a baseline: slow, four lines.",
)
@click.option("-v", "--verbose", is_flag=True, help="Say more: all warnings, stage timings.")
@recording_options
def smooth(recording: Path, **options: Any) -> None:
    """Estimate the metric trajectory and the lines of a RECORDING.

    RECORDING is what `ruledgraph info` reads. The results folder gets trajectory.tum (smoothed) and
    trajectory_live.tum, states.csv, lines.csv, summary.json and the config.yaml in effect. The exit
    code is 3 when nothing could be estimated.

    \b
    Examples:
      ruledgraph smooth flight.bag --calibration calib.yaml
      ruledgraph smooth MH_01_easy --output run1 --plots \\
          --ground-truth MH_01_easy/mav0/state_groundtruth_estimate0/data.csv
      ruledgraph smooth flight.bag --calibration calib.yaml --set window.lag=2
    """
    # What is imported stays: the garbage collector need not look through it, now or at the end.
    gc.disable()
    from ruledgraph.app.smooth_command import smooth_command

    gc.freeze()
    gc.enable()
    smooth_command(recording, **options)


@main.command()
@click.argument(
    "estimates", nargs=-1, required=True, type=click.Path(), metavar="ESTIMATE [ESTIMATE ...]"
)
@click.argument("reference", type=click.Path())
@click.option("--live", is_flag=True, help="Of a run's folder, its trajectory_live.tum.")
@click.option(
    "--align",
    type=click.Choice(["none", "origin", "posyaw", "se3", "sim3"]),
    default="se3",
    show_default=True,
    help="origin: first pose; posyaw: position and yaw.",
)
@click.option(
    "--tolerance", type=float, default=0.01, show_default=True, help="Between paired stamps, s."
)
@click.option(
    "--length",
    "lengths",
    type=click.FloatRange(min=0.0, min_open=True),
    multiple=True,
    metavar="M",
    help="Of RPE, m; repeat it for several. By default 1, 2, 5 and 10.",
)
@click.option(
    "--calibration",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Differences by axis are then the camera's, not the body's.",
)
@click.option(
    "--markers",
    type=click.Path(),
    metavar="FILE|BAG:/TOPIC",
    help="Points on true lines, CSV or YAML, named line/marker: how far a run's lines miss them.",
)
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@click.option(
    "--plots", type=click.Path(path_type=Path), metavar="FOLDER", help="Draw all estimates into it."
)
@click.option(
    "--save",
    type=click.Path(path_type=Path),
    metavar="FOLDER",
    help="Write evo's result files into it, for evo_res.",
)
def evaluate(estimates: tuple[str, ...], reference: str, **options: Any) -> None:
    """Compare one or several ESTIMATEs with a REFERENCE: ATE and RPE by evo.

    Each is a TUM file, EuRoC's CSV, KITTI poses and their times as `poses.txt,times.txt`, the
    results folder of `ruledgraph smooth`, or a topic as `recording.bag:/topic`. Poses are
    associated as evo_ape does it, by nearest stamps, and errors are those it prints.

    \b
    Examples:
      ruledgraph evaluate results/run1 flight.gt.tum
      ruledgraph evaluate results/run1 flight.bag:/vicon/pose --align posyaw --json
      ruledgraph evaluate other.tum flight.gt.tum --length 1 --length 10 --save other_evo
      ruledgraph evaluate results/run1 results/run2 other.tum flight.gt.tum --plots compared
    """
    from ruledgraph.app.evaluate_command import evaluate_command

    evaluate_command(estimates, reference, **options)


@main.command()
@click.argument(
    "runs", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="RUN [RUN ...]"
)
@click.option(
    "--output",
    type=click.Path(path_type=Path),
    metavar="HTML",
    help="The page; by default report.html in RUN, of several runs in the current folder.",
)
@click.option("--force", is_flag=True, help="Overwrite the page.")
@click.option(
    "--ground-truth",
    metavar="FILE|BAG:/TOPIC",
    help="Evaluate all runs against this; by default the page has the errors each run noted.",
)
def report(
    runs: tuple[Path, ...], output: Path | None, force: bool, ground_truth: str | None
) -> None:
    """Put results folders on one HTML page.

    RUN is a results folder of `ruledgraph smooth`. The page holds pictures, the trajectory to turn
    and zoom, errors, status, timings, warnings and settings, of several runs also a table of
    comparison. It is one file that needs no other, and prints.

    \b
    Examples:
      ruledgraph report results/run1
      ruledgraph report results/run1 results/run2 --ground-truth flight.gt.tum --output both.html
    """
    from ruledgraph.evaluation.sources import read_poses
    from ruledgraph.visualization.report import write_report

    if output is None:
        output = (runs[0] if len(runs) == 1 else Path()) / "report.html"
    truth = read_poses(ground_truth) if ground_truth else None
    write_report(runs, output, truth, force=force)
    click.echo(str(output))


@main.command()
@click.argument("shell", type=click.Choice(["bash", "zsh", "fish"]))
def completion(shell: str) -> None:
    """Print what makes a SHELL complete commands, options and file names.

    \b
    Examples:
      eval "$(ruledgraph completion bash)"                      # in ~/.bashrc; zsh likewise
      ruledgraph completion fish > ~/.config/fish/completions/ruledgraph.fish
    """
    from click.shell_completion import get_completion_class

    complete = get_completion_class(shell)
    if complete is None:
        raise click.UsageError(f"this version of click knows no completion for {shell}")
    click.echo(complete(main, {}, "ruledgraph", "_RULEDGRAPH_COMPLETE").source())
