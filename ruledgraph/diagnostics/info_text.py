# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""What `ruledgraph info` prints for people."""

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from ruledgraph.diagnostics.info import RecordingInfo

_KINDS = {
    "rosbag1": "ROS 1 bag",
    "rosbag2": "ROS 2 bag",
    "mcap": "MCAP file",
    "asl": "EuRoC (ASL) folder",
}
# Columns of the table when the output is no terminal and nothing says how wide it is.
_PIPE_WIDTH = 160


def print_info(info: RecordingInfo) -> None:
    """Print it for people."""
    console = Console(highlight=False)
    if not console.is_terminal:
        console = Console(highlight=False, width=_PIPE_WIDTH)

    def line(label: str, text: str, style: str = "bold") -> None:
        console.print(f"[{style}]{label:<8}[/] {escape(text)}", soft_wrap=True)

    console.print(f"[bold]{escape(info.path)}[/]: {_KINDS[info.kind]}", soft_wrap=True)
    table = Table(box=None, pad_edge=False, header_style="bold")
    table.add_column("Topic", overflow="fold")
    table.add_column("Type", overflow="fold")
    for name in ("Messages", "Rate", "Longest step"):
        table.add_column(name, justify="right", no_wrap=True)
    for topic in info.topics:
        step = _milliseconds(topic.longest_step)
        rate = f"{topic.rate:.3g} Hz"
        table.add_row(escape(topic.name), topic.type, str(topic.messages), rate, step)
    console.print(table)
    console.print()
    for label, sensor, what in (
        ("Camera", info.camera, "images"),
        ("IMU", info.imu, "samples"),
    ):
        if sensor is not None:
            size = ""
            if label == "Camera" and info.image_size:
                size = ", {}x{}".format(*info.image_size)
            line(
                label,
                f"{' + '.join(sensor.topics)}: {sensor.count} {what} at {sensor.rate:.3g} Hz"
                f"{size}, longest step {_milliseconds(sensor.longest_step)}",
            )
    line("Overlap", f"{info.overlap:.2f} s of both")
    for text in info.missing:
        line("Missing", text, "bold red")
    for text in info.warnings:
        line("Warning", text, "yellow")
    for finding in sorted(info.findings, key=lambda finding: not finding.good):
        line(*("Good", finding.text) if finding.good else ("Check", finding.text, "yellow"))
    if info.plot:
        line("Plot", info.plot)


def _milliseconds(seconds: float) -> str:
    return f"{seconds * 1e3:.1f} ms"
