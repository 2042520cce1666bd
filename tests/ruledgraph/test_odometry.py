# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause

import itertools

import cv2
import numpy as np
import pytest

import ruledgraph
from ruledgraph.backend.sliding_window import Window
from ruledgraph.core.errors import RuledgraphError
from ruledgraph.core.estimates import Estimate
from ruledgraph.core.measurements import Frame, Gap, ImuSample, Measurement
from ruledgraph.core.settings import load_config
from ruledgraph.evaluation import alignment
from ruledgraph.frontend.gradient import Gradient
from ruledgraph.initialization.trial import Trial
from ruledgraph.integrity.gauge import heading
from ruledgraph.odometry import Odometry
from ruledgraph.simulation.options import simulation_from_options
from ruledgraph_factors import kernel
from small_simulation import frames, small_simulation, small_stream


def run(measurements, calibration) -> tuple[Odometry, list[Estimate], list[Estimate]]:
    odometry = Odometry(calibration)
    live, smoothed = [], []
    for measurement in measurements:
        odometry.add(measurement)
        live += odometry.take_live()
        smoothed += odometry.take_smoothed()
    odometry.finish()
    live += odometry.take_live()
    smoothed += odometry.take_smoothed()
    return odometry, live, smoothed


def ate(estimates: list[Estimate], simulation) -> float:
    """RMSE of the aligned positions, m."""
    true = simulation.truth(np.array([e.stamp for e in estimates])).position
    own = np.array([e.world_T_body.translation() for e in estimates])
    A = alignment(own, true)
    return float(np.sqrt(np.mean(np.sum((own @ A[:3, :3].T + A[:3, 3] - true) ** 2, axis=1))))


@pytest.mark.parametrize("moving", [False, True], ids=["from rest", "moving"])
def test_the_trajectory_of_a_simulated_recording(moving):
    stream, calibration = small_stream(moving=moving)
    odometry, live, smoothed = run(stream, calibration)
    simulation = small_simulation(moving=moving)
    assert odometry.recoveries == []
    # A quarter of the default image and a third of its rate; at full size it is below 1 mm.
    assert ate(live, simulation) < 0.02
    assert ate(smoothed, simulation) < 0.015
    # Every frame from the start on, but for those after the last IMU sample.
    stamps = [frame.stamp for frame in frames(stream)]
    for estimates in (live, smoothed):
        first = stamps.index(estimates[0].stamp)
        assert [e.stamp for e in estimates] == stamps[first : first + len(estimates)]
        assert first + len(estimates) >= len(stamps) - 3
    assert len(live) > (0.55 if moving else 0.7) * len(stamps)
    lines = odometry.take_lines()
    assert len(lines) > 5
    for line in lines:
        assert line.first_stamp < line.last_stamp
        assert np.all(np.linalg.eigvalsh(line.covariance) > -1e-9)


def resting_stream(seconds: float, drift: float = 0.0) -> list[Measurement]:
    """The first frame again and again, with other noise, and an IMU that rests; the image drifts
    right and down by so many px/s.
    """
    stream, _ = small_stream()
    image, rng = frames(stream)[0].image, np.random.default_rng(0)
    noise, gravity = np.repeat([1e-3, 0.02], 3), np.array([0.0, 0.0, 9.81])
    resting: list[Measurement] = []
    for step in range(int(200 * seconds)):
        stamp, drawn = step * 5_000_000, noise * rng.normal(size=6)
        resting.append(ImuSample(stamp, drawn[:3], drawn[3:] + gravity))
        if step % 6 == 1:
            by = drift * stamp * 1e-9
            shift = np.array([[1.0, 0.0, by], [0.0, 1.0, by]])
            moved = cv2.warpAffine(image, shift, image.shape[::-1], borderMode=cv2.BORDER_REPLICATE)
            grey = moved + rng.normal(scale=1.5, size=image.shape)
            resting.append(Frame(stamp, grey.clip(0, 255).astype(np.uint8)))
    return resting


def times_solved(monkeypatch) -> list[float]:
    """Of the newest state whenever a window is solved, from now on."""
    solved, optimize = [], Window.optimize

    def counted(window):
        solved.append(window.newest.time)
        return optimize(window)

    monkeypatch.setattr(Window, "optimize", counted)
    return solved


def test_a_long_rest_costs_little_and_moves_nothing(monkeypatch):
    solved = times_solved(monkeypatch)
    odometry, live, smoothed = run(resting_stream(6.0), small_stream()[1])
    nodes = [e for e in live if e.at_state]
    assert len(nodes) > 25
    # One state in four is solved for, and the one at the end.
    assert np.diff(solved)[:-1] == pytest.approx(0.8, abs=0.05)
    assert len(solved) <= 8
    assert {e.status for e in nodes[1:]} == {"still"}
    assert live[-1].lines >= 4  # few are longer than 40 px
    for estimates in (live, smoothed):
        places = np.array([e.world_T_body.translation() for e in estimates])
        assert np.linalg.norm(places - places[0], axis=1).max() < 0.002
    assert list(odometry.warnings) == []


def test_slow_motion_that_looks_like_rest_is_solved_as_often_as_it_moves(monkeypatch):
    """In 0.4 s the image moves by half of what rest allows; that alone would be rest for ever."""
    solved = times_solved(monkeypatch)
    odometry, live, _ = run(resting_stream(6.0, drift=0.5), small_stream()[1])
    assert odometry.warnings == []
    moving = [e for e in live if e.at_state and e.status == "tracking"]
    assert len(moving) >= 3
    assert np.median(np.diff(solved)) < 0.5


def test_a_recording_that_ends_at_an_unsolved_node_is_solved_to_its_end(monkeypatch):
    solved, odometry = times_solved(monkeypatch), Odometry(small_stream()[1])
    for measurement in resting_stream(3.0):
        odometry.add(measurement)
        live = odometry.take_live()
        if solved and live and live[-1].at_state and odometry.window.newest.time > solved[-1]:
            break
    end = odometry.window.newest.time
    assert odometry.window.solved < end
    odometry.finish()
    assert solved[-1] == end


def test_a_plane_whose_images_turn_in_two_ways_keeps_the_windows_time_offset():
    """A second motion explains the images of a plane as well as the camera's own; its rotation
    follows the gyroscope's 27 ms later.
    """
    simulation = simulation_from_options(
        scene="square", motion="linear-parallel-rot-y", rate=30.0, duration=3.5
    )
    odometry, live, _ = run(simulation.stream(), simulation.calibration)
    assert abs(odometry.clock_search.found.value) > 0.02
    assert not odometry.warnings
    assert len(live) > 90
    assert ate(live, simulation) < 0.005


def test_the_same_input_gives_the_same_output():
    stream, calibration = small_stream()
    stream = stream[: len(stream) // 2]
    first, second = (run(stream, calibration) for _ in range(2))
    for one, other in zip(first[1] + first[2], second[1] + second[2], strict=True):
        assert one.stamp == other.stamp
        np.testing.assert_array_equal(one.world_T_body.matrix(), other.world_T_body.matrix())


@pytest.mark.skipif(kernel.native is None, reason="the native kernel was not built")
def test_both_kernels_give_the_same_trajectory(monkeypatch):
    stream, calibration = small_stream()
    results = []
    for name in ("native", "numpy"):
        monkeypatch.setenv("RULEDGRAPH_KERNEL", name)
        _, live, smoothed = run(stream, calibration)
        results.append(live + smoothed)
    for one, other in zip(*results, strict=True):
        assert (one.stamp, one.lines) == (other.stamp, other.lines)
        np.testing.assert_allclose(
            one.world_T_body.matrix(), other.world_T_body.matrix(), rtol=0.0, atol=1e-6
        )


def test_smooth_yields_the_live_estimates():
    stream, calibration = small_stream()
    stream = stream[: len(stream) // 2]
    estimates = list(ruledgraph.smooth(stream, calibration))
    _, live, _ = run(stream, calibration)
    assert [e.stamp for e in estimates] == [e.stamp for e in live]


def test_a_covered_lens_is_flagged_and_got_over():
    stream, calibration = small_stream()
    stamps = [frame.stamp for frame in frames(stream)]
    first, last = stamps[75], stamps[105]  # one second of black
    covered = [
        Frame(m.stamp, np.zeros_like(m.image))
        if isinstance(m, Frame) and first <= m.stamp <= last
        else m
        for m in stream
    ]
    odometry, live, _ = run(covered, calibration)
    statuses = {e.stamp: e.status for e in live}
    assert statuses[stamps[104]] == "dead reckoning"
    assert statuses[stamps[70]] == "tracking"
    assert live[-1].status == "tracking"
    assert live[-1].lines >= 4
    assert len(live) > 0.7 * len(stamps)
    assert ate(live, small_simulation()) < 0.1  # a second by the IMU alone
    assert odometry.recoveries == []


def test_a_gap_in_the_imu_begins_a_new_segment():
    stream, calibration = small_stream(moving=True)
    stamps = [m.stamp for m in stream if isinstance(m, ImuSample)]
    start, stop = stamps[int(0.5 * len(stamps))], stamps[int(0.62 * len(stamps))]
    cut = []
    for m in stream:
        if start < m.stamp < stop:
            continue
        if isinstance(m, ImuSample) and m.stamp == stop:
            cut.append(Gap(start, stop))
        cut.append(m)
    odometry, live, smoothed = run(cut, calibration)
    assert sum("a new segment begins" in warning for warning in odometry.warnings) == 1
    assert any(e.stamp < start for e in live)
    assert any(e.stamp > stop for e in live)
    # The new segment begins near where the last one ended, as its covariance says.
    before = [e for e in smoothed if e.stamp <= start][-1]
    after = next(e for e in smoothed if e.stamp >= stop)
    assert (before.segment, after.segment) == (0, 1)
    true = small_simulation(moving=True).truth(np.array([before.stamp, after.stamp]))
    turn = before.world_T_body.rotation().matrix() @ true.rotation[0].T
    error = after.world_T_body.translation() - before.world_T_body.translation()
    error -= turn @ (true.position[1] - true.position[0])
    R = after.world_T_body.rotation().matrix()
    covariance = R @ after.covariances[0][3:, 3:] @ R.T
    assert error @ np.linalg.solve(covariance, error) < 9.0
    assert np.sqrt(np.trace(covariance)) < 0.8
    attitudes = (e.world_T_body.rotation().matrix()[None] for e in (after, before))
    assert abs(heading(*attitudes).yaw()) < 0.01


def test_a_camera_that_is_silent_for_longer_than_the_window_begins_a_new_segment():
    stream, calibration = small_stream(duration=11.0)
    first = stream[0].stamp
    silent = [
        m
        for m in stream
        if not (isinstance(m, Frame) and 3.0e9 < m.stamp - first < 6.0e9)  # lag: 2.5 s
    ]
    odometry, live, smoothed = run(silent, calibration)
    assert [w for w in odometry.warnings if "no frame for 3.0" in w]
    assert {e.segment for e in live} == {e.segment for e in smoothed} == {0, 1}


def test_blank_frames_never_start_and_never_crash():
    stream, calibration = small_stream(moving=True)
    blank = [
        Frame(m.stamp, np.full_like(m.image, 40)) if isinstance(m, Frame) else m for m in stream
    ]
    odometry, live, _ = run(blank, calibration)
    assert live == []
    assert any("0 lines were followed long enough, 2 are" in text for text in odometry.warnings)


@pytest.mark.parametrize("rate", [10.0, 15.0])
def test_low_frame_rates(rate):
    stream, calibration = small_stream()
    keep = {frame.stamp for frame in frames(stream)[:: round(30.0 / rate)]}
    thinned = [m for m in stream if not isinstance(m, Frame) or m.stamp in keep]
    _, live, _ = run(thinned, calibration)
    assert len(live) > 0.6 * len(keep)
    assert ate(live, small_simulation()) < 0.03


def test_dropped_and_repeated_frames():
    stream, calibration = small_stream()
    rng = np.random.default_rng(0)
    dropped = [m for m in stream if not isinstance(m, Frame) or rng.uniform() > 0.3]
    repeated = list(
        itertools.chain.from_iterable([m, m] if isinstance(m, Frame) else [m] for m in dropped)
    )
    _, live, _ = run(repeated, calibration)
    assert ate(live, small_simulation()) < 0.03
    assert len({e.stamp for e in live}) == len(live)


def test_frames_of_another_size_are_refused():
    _, calibration = small_stream()
    with pytest.raises(RuledgraphError, match="a frame is 64x48, but the calibration is for 320x"):
        Odometry(calibration).add_image(Frame(0, np.zeros((48, 64), np.uint8)))


@pytest.mark.parametrize(
    ("image", "fault"),
    [
        (np.zeros((240, 320, 3), np.uint8), r"shape \(240, 320, 3\); convert images to grey"),
        (np.zeros((240, 320), np.uint16), "is uint16; convert images to 8 bit"),
        (np.zeros((240, 320), np.float32), "is float32; convert images to 8 bit"),
    ],
)
def test_images_that_are_not_grey_of_8_bit_are_refused_when_they_are_added(image, fault):
    _, calibration = small_stream()
    odometry = Odometry(calibration)
    odometry.prefetch(Frame(0, image))
    with pytest.raises(RuledgraphError, match=fault):
        odometry.add_image(Frame(0, image))


def test_frames_that_wait_for_the_imu_are_not_all_prepared(monkeypatch):
    _, calibration = small_stream()
    odometry, made = Odometry(calibration), []

    def counted(image: np.ndarray) -> Gradient:
        made.append(image)
        return Gradient(image)

    monkeypatch.setattr("ruledgraph.frontend.front_end.Gradient", counted)
    for i in range(100):
        frame = Frame(10_000_000 * i, np.full((240, 320), i, np.uint8))
        odometry.prefetch(frame)
        odometry.add_image(frame)
    assert 0 < len(made) < 50


def test_memory_of_a_run_does_not_grow():
    stream, calibration = small_stream()
    odometry = Odometry(calibration)
    for measurement in stream:
        odometry.add(measurement)
        odometry.take_live(), odometry.take_smoothed(), odometry.take_lines()
    assert odometry.window is not None
    kept = odometry.config.window.lag + 1.0
    assert len(odometry.window.nodes) < 10 * kept
    assert all(len(track.sightings) < 30 * kept for track in odometry.tracker.tracks)


def test_an_estimate_that_ran_away_ends_its_segment(monkeypatch):
    stream, calibration = small_stream(moving=True)
    plausible, calls = Window.is_plausible, []

    def runs_away_once(self):
        calls.append(1)
        return plausible(self) and len(calls) != 8

    monkeypatch.setattr(Window, "is_plausible", runs_away_once)
    odometry, live, smoothed = run(stream, calibration)
    assert sum("ran away" in warning for warning in odometry.warnings) == 1
    assert len(live) > 8  # it started again
    stamps = [e.stamp for e in smoothed]
    assert stamps == sorted(set(stamps))


def test_the_papers_points_work_too():
    stream, calibration = small_stream()
    odometry = Odometry(calibration, load_config(None, ["edges.points=sobel"]))
    live = []
    for measurement in stream:
        odometry.add(measurement)
        live += odometry.take_live()
    assert len(live) > 60
    assert ate(live, small_simulation()) < 0.05  # whole pixels of both sides of an edge


def test_an_imu_that_is_silent_for_long_begins_a_new_segment_without_a_gap_message():
    stream, calibration = small_stream(moving=True)
    stamps = [m.stamp for m in stream if isinstance(m, ImuSample)]
    start, stop = stamps[int(0.5 * len(stamps))], stamps[int(0.65 * len(stamps))]
    cut = [m for m in stream if not (isinstance(m, ImuSample) and start < m.stamp < stop)]
    odometry, live, _ = run(cut, calibration)
    assert sum("no IMU for" in warning for warning in odometry.warnings) == 1
    assert any(e.stamp < start for e in live)
    assert any(e.stamp > stop for e in live)
    assert not any(start < e.stamp < stop for e in live)


def off_by_sigmas(live: list[Estimate], simulation) -> np.ndarray:
    """Errors of the positions over three sigmas, where the first estimate says the world is."""
    true = simulation.truth(np.array([e.stamp for e in live]))
    turn = live[0].world_T_body.rotation().matrix() @ true.rotation[0].T
    yaw = np.arctan2(turn[1, 0] - turn[0, 1], turn[0, 0] + turn[1, 1])
    R = np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
    found = []
    for e, place in zip(live, true.position - true.position[0], strict=True):
        error = e.world_T_body.translation() - live[0].world_T_body.translation() - R @ place
        error = e.world_T_body.rotation().matrix().T @ error
        covariance = e.covariances[0][3:, 3:] + np.eye(3) * 0.01**2
        found.append(np.sqrt(error @ np.linalg.solve(covariance, error)) / 3.0)
    return np.array(found)


@pytest.mark.parametrize("hangs", [False, True], ids=["silent", "hanging"])
def test_a_hole_of_the_imu_is_got_over_and_shows_in_the_covariance(hangs):
    stream, calibration = small_stream()
    stamps = [m.stamp for m in stream if isinstance(m, ImuSample)]
    start, stop = stamps[int(0.6 * len(stamps))], stamps[int(0.68 * len(stamps))]
    cut, last = [], None
    for m in stream:
        if isinstance(m, ImuSample) and start < m.stamp < stop:
            if hangs:
                cut.append(last._replace(stamp=m.stamp))
            continue
        last = m if isinstance(m, ImuSample) else last
        cut.append(m)
    odometry, live, _ = run(cut, calibration)
    assert sum("the IMU hung at" in warning for warning in odometry.warnings) == hangs
    assert ate(live, small_simulation()) < 0.05
    assert off_by_sigmas(live, small_simulation()).max() < 1.0


def test_spikes_of_the_imu_are_replaced_and_counted():
    stream, calibration = small_stream()
    rng = np.random.default_rng(0)
    spiked, count = [], 0
    for i, m in enumerate(stream):
        if isinstance(m, ImuSample) and i > 100 and rng.random() < 0.01:
            rate, force = rng.normal(size=(2, 3)) * [[3.0], [30.0]]
            m = ImuSample(m.stamp, m.gyroscope + rate, m.accelerometer + force)
            count += 1
        spiked.append(m)
    odometry, live, _ = run(spiked, calibration)
    (warning,) = odometry.warnings
    assert "the IMU spikes at" in warning
    assert f"({count} times)" in warning
    assert ate(live, small_simulation()) < 0.02  # as without


def test_a_saturated_imu_is_reported_and_flagged():
    stream, calibration = small_stream()
    clipped = [
        m._replace(gyroscope=np.clip(m.gyroscope, -0.2, 0.2)) if isinstance(m, ImuSample) else m
        for m in stream
    ]
    odometry, live, _ = run(clipped, calibration)
    assert any("the gyroscope's" in w and "ends at" in w for w in odometry.warnings)
    assert sum(e.status == "degraded" for e in live) > 0.2 * len(live)
    assert ate(live, small_simulation()) < 0.1


def test_a_camera_that_hangs_is_reported_and_not_used():
    stream, calibration = small_stream()
    stamps = [frame.stamp for frame in frames(stream)]
    first, last = stamps[75], stamps[105]
    hung, image = [], None
    for m in stream:
        if isinstance(m, Frame) and first <= m.stamp <= last:
            m = Frame(m.stamp, image)
        image = m.image if isinstance(m, Frame) else image
        hung.append(m)
    odometry, live, _ = run(hung, calibration)
    assert sum("the camera hangs" in warning for warning in odometry.warnings) == 1
    assert {e.stamp: e.status for e in live}[stamps[104]] == "dead reckoning"
    assert live[-1].status == "tracking"
    assert off_by_sigmas(live, small_simulation()).max() < 1.0


def test_frames_that_come_late_are_reported_once():
    stream, calibration = small_stream()
    measurements = list(stream)
    for i, m in enumerate(measurements):
        if isinstance(m, Frame) and i % 5 == 0:
            later = next(k for k in range(i + 1, len(stream)) if isinstance(stream[k], Frame))
            measurements[i], measurements[later] = measurements[later], measurements[i]
            if i > len(stream) // 4:
                break
    odometry, _, _ = run(measurements, calibration)
    assert sum("came after a later one" in warning for warning in odometry.warnings) == 1


def test_every_frames_velocity_is_its_own():
    """Not that of the state before it, from which it differs by 0.3 m/s and more."""
    stream, calibration = small_stream(moving=True)
    _, live, smoothed = run(stream, calibration)
    for estimates in (live, smoothed):
        true = small_simulation(moving=True).truth(np.array([e.stamp for e in estimates]))
        own = np.linalg.norm([e.velocity for e in estimates], axis=1)
        off = own - np.linalg.norm(true.velocity, axis=1)
        assert np.sqrt(np.mean(off**2)) < 0.05
        # Within 0.2 s they would lag behind by as much as the body speeds up.
        assert np.abs(off).max() < 0.2


def test_what_a_trial_held_back_is_handed_out_as_the_window_knows_it_by_then():
    stream, calibration = small_stream(moving=True)
    odometry = Odometry(calibration)
    released: list[Estimate] = []
    for measurement in stream:
        odometry.add(measurement)
        if released := odometry.take_live():
            break
    assert odometry.window is not None
    by_stamp = {estimate.stamp: estimate for estimate in released}
    compared = 0
    for interval in odometry.window.intervals:
        for stamp, pose in zip(interval.stamps, interval.poses(), strict=True):
            if stamp in by_stamp and stamp < released[-1].stamp:
                assert by_stamp[stamp].world_T_body.equals(pose, 1e-12)
                compared += 1
    assert compared > 10


def test_a_start_on_moving_things_is_taken_back(monkeypatch):
    stream, calibration = small_stream(moving=True)
    passed, calls = Trial.passed, []

    def refuted_once(self, window):
        calls.append(window)
        if len(calls) == 3:
            self.failure = "its lines were no good"
        return passed(self, window)

    monkeypatch.setattr(Trial, "passed", refuted_once)
    odometry, live, smoothed = run(stream, calibration)
    assert sum("is taken back: its lines" in warning for warning in odometry.warnings) == 1
    # Nothing of it was handed out, and the next one was.
    assert {e.segment for e in live + smoothed} == {0}
    assert len(live) > 20
    assert [e.stamp for e in live] == sorted({e.stamp for e in live})
    assert ate(live, small_simulation(moving=True)) < 0.03


def mirrored(measurements, after: float):
    """From so many s on the images are mirrored: they move against what the IMU feels."""
    start = frames(measurements)[0].stamp
    for measurement in measurements:
        if isinstance(measurement, Frame) and measurement.stamp > start + after * 1e9:
            image = np.ascontiguousarray(measurement.image[:, ::-1])
            yield Frame(measurement.stamp, image)
        else:
            yield measurement


def test_lines_that_contradict_the_imu_are_reported_and_flagged_or_end_the_segment():
    measurements, calibration = small_stream(seed=3)
    odometry, live = Odometry(calibration), []
    for measurement in mirrored(measurements, 2.5):
        odometry.add(measurement)
        live += odometry.take_live()
    assert any("of the lines do not fit the estimate" in warning for warning in odometry.warnings)
    flagged = sum(e.status == "degraded" for e in live) > 5
    assert flagged or "a new segment begins" in odometry.warnings[-1]
    before = [e for e in live if e.stamp < frames(measurements)[0].stamp + 2.4e9]
    assert all(e.status != "degraded" for e in before)


def test_a_lost_estimate_ends_its_segment_at_its_last_reliable_state():
    config = load_config(None, ["integrity.lost_misfit=0.35"])
    measurements, calibration = small_stream(seed=3)
    odometry, live, smoothed = Odometry(calibration, config), [], []
    for measurement in mirrored(measurements, 2.5):
        odometry.add(measurement)
        live += odometry.take_live()
        smoothed += odometry.take_smoothed()
        if odometry.window is None and live:
            break
    assert "most lines do not fit the estimate" in odometry.warnings[-1]
    smoothed += odometry.take_smoothed()
    assert smoothed[-1].status == "degraded"
    reliable = [e for e in live if e.status != "degraded"]
    assert odometry.last_reliable is not None
    assert odometry.last_reliable.pose.equals(reliable[-1].world_T_body, 1e-9)
