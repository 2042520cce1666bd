# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The options of `ruledgraph simulate`."""

from pathlib import Path
from typing import Any

import click

from ruledgraph.app.cli.options import LONGEST_READOUT, force_option, format_option
from ruledgraph.app.remove_existing import remove_existing


def _list_simulations(context: click.Context, _option: click.Parameter, wanted: bool) -> None:
    if wanted:
        from ruledgraph.simulation.options import catalogue

        click.echo(catalogue())
        context.exit()


@click.command(short_help="Simulate a recording with ground truth.")
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
@format_option
@force_option
@click.option(
    "--preview",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="PNG",
    help="Write a contact sheet; OUT may then be left out.",
)
@click.option(
    "--duration",
    type=float,
    metavar="SECONDS",
    help="Length of the recording, by default 12 s, or all of a measured motion.",
)
@click.option(
    "--start",
    type=float,
    default=0.0,
    metavar="SECONDS",
    help="Begin this long after the beginning of a measured motion.",
)
@click.option(
    "--moving-start", is_flag=True, help="Start at full speed, not with a second of rest."
)
@click.option(
    "--seed", type=click.IntRange(min=0), default=0, help="Draw all randomness from this seed."
)
@click.option(
    "--calibration",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Take camera, IMU and mounting from this file; by default like a RealSense D435i.",
)
@click.option(
    "--resolution", metavar="WxH", help="Render images of this size, by default the calibration's."
)
@click.option(
    "--rate", type=float, default=90.0, show_default=True, metavar="HZ", help="Rate of the images."
)
@click.option(
    "--imu",
    metavar="d435i|euroc|none|FILE",
    help="Take this IMU's noise, or EuRoC's imu0.csv that goes with a measured motion: the views "
    "then follow the motion that it measured.",
)
@click.option(
    "--imu-rate",
    type=float,
    default=200.0,
    show_default=True,
    metavar="HZ",
    help="Rate of the IMU.",
)
@click.option(
    "--readout",
    type=click.FloatRange(0.0, LONGEST_READOUT),
    metavar="SECONDS",
    help="Expose the rows of an image one after the other within this time, as a rolling shutter "
    "does; by default as the calibration's line_delay says.",
)
def simulate(
    scene: str,
    motion: str,
    out: Path | None,
    kind: Any,
    force: bool,
    preview: Path | None,
    **options: Any,
) -> None:
    """Simulate a recording of a SCENE along a MOTION, with ground truth.

    OUT is a .bag (ROS 1), an .mcap, or a folder, and must not exist unless --force is given. Beside
    it come the calibration (.calib.yaml), the true poses (.gt.tum) and the scene's lines
    (.lines.csv).
    MOTION may be a TUM file or EuRoC's CSV of a real flight; the room is then built around it.

    \b
    Examples:
      ruledgraph simulate --list
      ruledgraph simulate square_cluttered circular-tilted-rot-x sim.bag
      ruledgraph simulate room flight/groundtruth.csv flight.bag --imu flight/imu0.csv --rate 20
    """
    from ruledgraph.recording import kind_of
    from ruledgraph.simulation.options import simulation_from_options
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
    written = [*(Files.beside(out) if out else ()), *([preview] if preview else ())]
    if not force:
        check_free(*written)
    simulation = simulation_from_options(scene, motion, **options)
    if force:  # not before all else has proved possible
        named = motion, options["calibration"], options["imu"]
        remove_existing(*written, inputs=[Path(name) for name in named if name is not None])
    if preview:
        write_contact_sheet(simulation, preview)
        click.echo(str(preview))
    if out:
        files = write_with_progress(simulation, out, kind)
        for path in files:
            click.echo(str(path))
