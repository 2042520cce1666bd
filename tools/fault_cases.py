# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The cases of the fault campaign."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

import faults as f
from fault_images import (
    blurred,
    covered,
    exposure_jumps,
    moving_object,
    of_images,
    overlay,
    textured_rectangle,
)
from ruledgraph.calibration.rig import Calibration
from ruledgraph.core.measurements import Frame, ImuSample

_ALL = 1e9


@dataclass(frozen=True, eq=False)
class Case:
    """A fault on a recording."""

    recording: str
    fault: str
    apply: f.Fault = f.none
    calibrate: Callable[[Calibration], Calibration] = lambda calibration: calibration
    live: bool = False
    """Fed as it comes; otherwise as a recording's reader does, which tells of gaps of the IMU."""
    late: float = 0.0
    """By how much the stamps of frames are late, s."""

    @property
    def key(self) -> str:
        """Names the case."""
        return f"{self.recording}: {self.fault}"


CLEAN = "none"


def cases(recording: str, imu_limits: tuple[float, float]) -> Iterator[Case]:
    """All faults on a recording.

    Args:
        recording: its name.
        imu_limits: where a saturated gyroscope and accelerometer end, rad/s and m/s^2.
    """
    case = partial(Case, recording)
    yield case(CLEAN)
    for share in (0.05, 0.2, 0.5):
        yield case(f"{share:.0%} of the frames lost", f.drop_frames(share))
    for length in (0.02, 0.1, 0.3):
        yield case(
            f"IMU silent for {1e3 * length:.0f} ms every 2 s", f.silent_imu(3.0, length, 2.0)
        )
    yield case("IMU silent for 0.45 s, once", f.silent_imu(4.0, 0.45))
    yield case("IMU silent for 1 s, once", f.silent_imu(4.0, 1.0))
    yield case("IMU silent for 1 s, live, no gap reported", f.silent_imu(4.0, 1.0), live=True)
    yield case("10% of the messages swapped, live", f.swapped(0.1), live=True)
    yield case("all frames 0.2 s late, live", f.late(Frame, 0.2, 1.0), live=True)
    yield case("30% of the frames 0.1 s late, live", f.late(Frame, 0.1, 0.3), live=True)
    yield case("5% of the IMU samples 0.1 s late, live", f.late(ImuSample, 0.1, 0.05), live=True)
    for ms in (-20, -10, -5, 5, 10, 20):
        late = 1e-3 * ms
        yield case(f"stamps of frames off by {ms:+d} ms", f.shifted_frames(late), late=late)
    for degrees in (0.3, 1.0, 3.0):
        turned = partial(f.turned_camera, degrees=degrees)
        yield case(f"extrinsic rotation off by {degrees:g} deg", calibrate=turned)
    for mm in (5, 30):
        moved = partial(f.moved_camera, metres=1e-3 * mm)
        yield case(f"extrinsic translation off by {mm} mm", calibrate=moved)
    longer = partial(f.scaled_focal_length, factor=1.03)
    yield case("focal length off by 3%", calibrate=longer)
    yield case("IMU noise figures x10", calibrate=partial(f.scaled_noise, factor=10.0))
    yield case("IMU noise figures /10", calibrate=partial(f.scaled_noise, factor=0.1))
    jumps = exposure_jumps((1.0, 0.4, 1.7), 0.8)
    yield case("exposure jumps", of_images(jumps, 0.0, _ALL))
    for pixels in (9, 25):
        yield case(f"images blurred over {pixels} px", of_images(blurred(pixels), 0.0, _ALL))
    yield case("blank wall for 2 s", of_images(covered(150, 2.0), 4.0, 2.0))
    yield case("blank wall for 0.5 s", of_images(covered(150, 2.0), 4.0, 0.5))
    yield case("lens covered for 2 s", of_images(covered(), 4.0, 2.0))
    yield case("lens covered from the start for 2 s", of_images(covered(), 0.0, 2.0))
    yield case("frozen camera for 1 s", f.repeated(Frame, 4.0, 1.0))
    yield case("frozen IMU for 0.5 s", f.repeated(ImuSample, 4.0, 0.5))
    yield case("IMU saturated", f.saturated(*imu_limits))
    yield case("0.2% of the IMU samples spikes of 3 rad/s", f.spikes(0.002, 3.0))
    yield case("moving board before a third", of_images(moving_object(), 0.0, _ALL))
    yield case("overlay in all images", of_images(overlay(), 0.0, _ALL))
    poster = of_images(textured_rectangle(), 0.0, _ALL)
    yield case("poster drifts before a third of the scene", poster)
    step = f.bias_step(4.0, accelerometer=0.3)
    yield case("accelerometer's bias steps by 0.3 m/s^2", step)
    ramp = f.bias_step(4.0, gyroscope_ramp=0.02)
    yield case("gyroscope's bias ramps by 0.02 rad/s^2", ramp)
    halves = of_images(moving_object(), 4.0, _ALL)
    yield case("moving board comes after 4 s", halves)


def lift_cases(recording: str) -> Iterator[Case]:
    """On a recording of a body that rests for its first seconds. How errors of some centimetres
    come out is chance: each lift sets off at three moments between two states.
    """
    for acceleration in (0.1, 0.5, 1.0):
        for start in (2.0, 2.13, 3.07):
            lifted = f.lift(start, acceleration, 6.0)
            fault = f"at rest in a lift of {acceleration:g} m/s^2 from {start:g} s"
            yield Case(recording, fault, lifted)


def other_camera_case(recording: str, other: Calibration) -> Case:
    """A calibration with the figures of the rig's other camera."""
    exchanged = partial(f.other_camera, other=other)
    return Case(recording, "calibration of the rig's other camera", calibrate=exchanged)
