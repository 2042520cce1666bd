# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Live odometry fed by two threads, one a sensor; here they replay a recording at its own pace.

python tools/live_example.py flight.bag calib.yaml
"""

import logging
import sys
import threading
import time
from collections.abc import Callable, Iterable
from typing import Any

import ruledgraph


def main(recording: str, calibration_file: str) -> None:
    """Print each estimate as it comes, and what came of the lines."""
    logging.basicConfig(format="%(levelname)s %(message)s")
    calibration = ruledgraph.read_calibration(calibration_file)
    measurements = list(ruledgraph.open_recording(recording).stream())
    images = [m for m in measurements if isinstance(m, ruledgraph.Frame)]
    samples = [m for m in measurements if isinstance(m, ruledgraph.ImuSample)]
    begin, first = time.monotonic(), samples[0].stamp
    lines: list[object] = []

    def show(estimate: ruledgraph.Estimate) -> None:
        x, y, z = estimate.position
        sigma = estimate.position_covariance.diagonal().max() ** 0.5
        print(f"{estimate.time:.3f} s {x:8.3f} {y:8.3f} {z:8.3f} m ±{sigma:.3f} {estimate.status}")

    with ruledgraph.LiveOdometry(calibration, on_pose=show, on_line=lines.append) as odometry:

        def drive(items: Iterable[Any], add: Callable[[Any], None]) -> None:
            for item in items:
                time.sleep(max(0.0, begin + (item.stamp - first) * 1e-9 - time.monotonic()))
                add(item)

        def add_sample(m: ruledgraph.ImuSample) -> None:
            odometry.add_imu(m.gyroscope, m.accelerometer, t_ns=m.stamp)

        imu = threading.Thread(target=drive, args=(samples, add_sample))
        imu.start()
        drive(images, lambda m: odometry.add_image(m.image, t_ns=m.stamp))
        imu.join()
    print(f"{len(lines)} lines; {odometry.counts}")


if __name__ == "__main__":
    main(*sys.argv[1:3])
