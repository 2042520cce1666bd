# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""What the stream makes of recordings that are not as they should be."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

from recordings import (
    MS,
    SECOND,
    T0,
    Entry,
    assert_same,
    compressed_image,
    entries_of,
    fields,
    image,
    imu,
    png,
    raw_image,
    sequence,
    texture,
    write_bag,
)
from ruledgraph.core.measurements import Frame, Gap, ImuSample, Measurement
from ruledgraph.recording import Recording, RecordingError, open_recording

GYRO, ACCEL = "/camera/gyro/sample", "/camera/accel/sample"


@pytest.fixture
def record(tmp_path: Path) -> Callable[..., Recording]:
    """Makes a recording of entries, received in the given order, one after the other."""

    def make(entries: Sequence[Entry], **options: float) -> Recording:
        path = write_bag(tmp_path / "a.bag", "rosbag1", entries)
        return open_recording(path, **options)  # type: ignore[arg-type]

    return make


def in_reception_order(entries: Sequence[Entry]) -> list[Entry]:
    return sorted(entries, key=lambda entry: entry.stamp + entry.delay)


def stamps(measurements: Sequence[Measurement], kind: type) -> list[int]:
    return [m.stamp for m in measurements if isinstance(m, kind) and not isinstance(m, Gap)]


def test_header_stamps_rule_not_the_reception(record: Callable[..., Recording]) -> None:
    measurements = sequence()
    # Images come 100 ms late; every third IMU sample 12 ms.
    entries = [
        e._replace(delay=100 * MS if e.topic != "/imu0" else 12 * MS * (i % 3 == 0))
        for i, e in enumerate(entries_of(measurements))
    ]
    recording = record(in_reception_order(entries))
    assert_same(list(recording.stream()), measurements)
    assert recording.report.reordered > 0
    assert recording.report.warnings == [
        f"{recording.report.reordered} messages came out of stamp order and were sorted"
    ]


def test_what_comes_too_late_is_dropped(record: Callable[..., Recording]) -> None:
    measurements = sequence(3.0)
    entries = entries_of(measurements)
    late = next(e for e in entries if e.topic != "/imu0" and e.stamp > T0 + SECOND)
    entries = [e._replace(delay=700 * MS) if e is late else e for e in entries]
    recording = record(in_reception_order(entries))
    assert_same(list(recording.stream()), [m for m in measurements if fields(m)[0] != late.stamp])
    assert recording.report.warnings == [
        "1 frame skipped: its stamp is more than 0.5 s behind others"
    ]


@pytest.mark.parametrize("jump", [3600 * SECOND, -3600 * SECOND])
@pytest.mark.parametrize("index", [20, 50, -1])
def test_one_stamp_far_off_is_dropped_alone(
    jump: int, index: int, record: Callable[..., Recording]
) -> None:
    measurements = sequence()
    entries = entries_of(measurements)
    odd = entries[index]
    entries[index] = odd._replace(stamp=odd.stamp + jump, delay=-jump)
    recording = record(entries)
    assert_same(list(recording.stream()), [m for m in measurements if fields(m)[0] != odd.stamp])
    (warning,) = recording.report.warnings
    assert "its stamp" in warning


def test_crop(record: Callable[..., Recording]) -> None:
    measurements = sequence(3.0)
    entries = entries_of(measurements)
    # What lies outside is not even decoded.
    entries = [
        e if e.topic == "/imu0" or e.stamp >= T0 + SECOND else e._replace(fields=rubbish(e))
        for e in entries
    ]
    recording = record(entries, start=1.0, duration=1.5)
    expected = [m for m in measurements if T0 + SECOND <= fields(m)[0] < T0 + 2.5 * SECOND]
    assert_same(list(recording.stream()), expected)
    assert recording.report.warnings == []


def rubbish(entry: Entry) -> dict[str, object]:
    return {**entry.fields, "encoding": "rubbish"}


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"start": 100.0}, "no frame in the stretch of time; there are some at 0.00 to 0.90 s"),
        ({"start": -1.0}, "start must be a number of seconds, got -1.0"),
        ({"start": float("nan")}, "start must be a number of seconds, got nan"),
        ({"duration": 0.0}, "duration must be positive"),
    ],
)
def test_crop_that_leaves_nothing(
    options: dict[str, float], text: str, record: Callable[..., Recording]
) -> None:
    with pytest.raises(RecordingError, match=text):
        list(record(entries_of(sequence()), **options).stream())


def test_a_split_imu_is_interpolated(record: Callable[..., Recording]) -> None:
    def force(stamp: int) -> list[float]:
        t = (stamp - T0) / SECOND
        return [t, -2.0 * t, 9.8 + t]

    gyro = [T0 + i * SECOND // 200 for i in range(200)]
    accel = [T0 + 7 * MS + i * SECOND // 62 for i in range(60)]
    frames = [image(T0 + 3 * MS + i * SECOND // 10, texture(i)) for i in range(10)]
    entries = frames + [imu(s, w=[(s - T0) / SECOND, 0, 0], a=[0, 0, 0], topic=GYRO) for s in gyro]
    entries += [imu(s, w=[0, 0, 0], a=force(s), topic=ACCEL) for s in accel]
    recording = record(in_reception_order(entries))
    found = list(recording.stream())
    assert [fields(m)[0] for m in found] == sorted(fields(m)[0] for m in found)
    assert stamps(found, Frame) == [e.stamp for e in frames]
    inside = [s for s in gyro if accel[0] <= s <= accel[-1]]
    assert stamps(found, ImuSample) == inside
    for m in found:
        if isinstance(m, ImuSample):
            np.testing.assert_array_equal(m.gyroscope, [(m.stamp - T0) / SECOND, 0, 0])
            np.testing.assert_allclose(m.accelerometer, force(m.stamp), atol=1e-9)
    skipped = len(gyro) - len(inside)
    assert recording.report.skipped_imu == {"no accelerometer sample before or after it": skipped}


def test_a_pause_of_the_accelerometer_is_not_bridged(record: Callable[..., Recording]) -> None:
    entries = [imu(T0 + i * 5 * MS, topic=GYRO) for i in range(600)]
    entries += [imu(T0 + i * 10 * MS, topic=ACCEL) for i in range(300) if not 1000 <= i * 10 < 1700]
    entries += [image(T0 + i * 100 * MS + MS, texture(i)) for i in range(29)]
    recording = record(in_reception_order(entries))
    found = list(recording.stream())
    # The gyroscope sample at 1700 ms comes before the accelerometer's of the same stamp.
    gap = Gap(T0 + 990 * MS, T0 + 1705 * MS)
    (at,) = [i for i, m in enumerate(found) if isinstance(m, Gap)]
    assert found[at] == gap
    assert found[at + 1][0] == gap.stop
    assert recording.report.imu_gaps == [gap]
    assert recording.report.skipped_frames == {"the IMU is silent around it": 3}


def test_gaps_of_the_imu_end_a_segment(record: Callable[..., Recording]) -> None:
    measurements = sequence(4.0)
    silent = (T0 + SECOND, T0 + 2 * SECOND)
    kept = [
        m for m in measurements if isinstance(m, Frame) or not silent[0] <= fields(m)[0] < silent[1]
    ]
    recording = record(entries_of(kept))
    found = list(recording.stream())
    gap = Gap(T0 + 990 * MS, silent[1])
    at = [isinstance(m, Gap) for m in found].index(True)
    assert found[at] == gap
    # Frames up to 0.5 s into the gap are delivered, later ones are not.
    expected = [
        m
        for m in kept
        if isinstance(m, ImuSample) or not gap.start + SECOND // 2 < m.stamp < gap.stop
    ]
    assert_same(found[:at] + found[at + 1 :], expected)
    assert "the IMU was silent 1 time, for up to 1.01 s: each gap ends a segment" in (
        recording.report.warnings
    )


def test_repeated_stamps_and_numbers_that_are_none(record: Callable[..., Recording]) -> None:
    measurements = sequence()
    entries = entries_of(measurements)
    entries[50:50] = [entries[49], imu(entries[49].stamp)] if entries[49].topic == "/imu0" else []
    frame = next(i for i, e in enumerate(entries) if e.topic != "/imu0")
    entries.insert(frame, entries[frame])
    entries.insert(70, imu(entries[69].stamp + 2 * MS, a=[float("nan"), 0, 0]))
    entries.insert(80, imu(entries[79].stamp + 2 * MS, w=[0, float("inf"), 0]))
    recording = record(entries)
    assert_same(list(recording.stream()), measurements)
    assert recording.report.skipped_imu == {
        "its stamp repeats the one before": 2,
        "its numbers are not finite, or absurd": 2,
    }
    assert recording.report.skipped_frames == {"its stamp repeats the one before": 1}


def test_stamps_of_zero(record: Callable[..., Recording]) -> None:
    entries = [e._replace(stamp=0, delay=e.stamp) for e in entries_of(sequence())]
    with pytest.raises(RecordingError, match=r"10 frames .* unusable: it has no stamp"):
        list(record(entries).stream())


def test_damaged_frames_are_skipped(record: Callable[..., Recording]) -> None:
    measurements = sequence()
    entries = [
        compressed_image(e.stamp, png(texture(i)), "png") if e.topic != "/imu0" else e
        for i, e in enumerate(entries_of(measurements))
    ]
    frames = [i for i, e in enumerate(entries) if e.topic != "/imu0"]
    for i in frames[:2]:  # the first of all, too
        cut = entries[i].fields["data"][:100]
        entries[i] = entries[i]._replace(fields={"format": "png", "data": cut})
    recording = record(entries)
    found = list(recording.stream())
    assert stamps(found, Frame) == [entries[i].stamp for i in frames[2:]]
    assert recording.report.warnings == ["2 frames skipped: a PNG image is cut"]


def test_an_encoding_nobody_knows(record: Callable[..., Recording]) -> None:
    entries = [imu(T0)]
    entries += [
        raw_image(T0 + i * 50 * MS, "nv12", 16, 12, 16, texture(i).tobytes()) for i in range(20)
    ]
    with pytest.raises(RecordingError) as caught:
        list(record(entries).stream())
    assert "unknown image encoding 'nv12'; supported are mono8, 8UC1, mono16" in str(caught.value)


def test_a_frame_of_another_size_is_skipped_a_new_size_is_an_error(
    record: Callable[..., Recording],
) -> None:
    measurements = sequence(4.0)
    entries = entries_of(measurements)
    frames = [i for i, e in enumerate(entries) if e.topic != "/imu0"]
    entries[frames[5]] = image(entries[frames[5]].stamp, texture(0, (10, 16)))
    recording = record(entries)
    found = list(recording.stream())
    assert len(stamps(found, Frame)) == len(frames) - 1
    assert recording.report.warnings == [
        "1 frame skipped: it is 16x10, not 16x12 like those before"
    ]


def test_frames_that_change_their_size(record: Callable[..., Recording]) -> None:
    entries = entries_of(sequence(4.0))
    entries = [
        image(e.stamp, texture(0, (10, 16)))
        if e.topic != "/imu0" and e.stamp > T0 + 2 * SECOND
        else e
        for e in entries
    ]
    with pytest.raises(RecordingError, match=r"the frames change their size: .* 16x10, not 16x12"):
        list(record(entries).stream())


def test_stamps_that_do_not_overlap(record: Callable[..., Recording]) -> None:
    entries = [imu(T0 + i * 10 * MS) for i in range(100)]
    entries += [
        Entry(e.topic, e.type, e.stamp - T0 + SECOND, e.fields, T0 - SECOND)
        for e in (image(T0 + i * 50 * MS, texture(i)) for i in range(20))
    ]
    with pytest.raises(RecordingError) as caught:
        list(record(in_reception_order(entries)).stream())
    assert str(caught.value) == (
        "the stamps do not overlap: camera 1.000 to 1.950 s, IMU 1700000000.000 to 1700000000.990 s"
    )


@pytest.mark.parametrize(
    ("w", "a", "text"),
    [
        ((0.1, 0.0, 0.0), (0.0, 0.0, 1.0), "norm is 1, not near 9.81 m/s^2; is it in g?"),
        ((0.1, 0.0, 0.0), (0.0, 0.3, 0.0), "norm is 0.3, not near 9.81 m/s^2; was gravity taken"),
        ((0.1, 0.0, 0.0), (0.0, 0.0, 980.0), "norm is 980, not near 9.81 m/s^2; is it in cm/s^2 ("),
        ((0.1, 0.0, 0.0), (0.0, 0.0, 1000.0), "norm is 1000, not near 9.81 m/s^2; is it in mg ("),
        ((30.0, 0.0, 0.0), (0.0, 0.0, 9.8), "norm is 30 rad/s, faster than a camera can follow"),
    ],
)
def test_units_that_cannot_be_right(
    w: Sequence[float], a: Sequence[float], text: str, record: Callable[..., Recording]
) -> None:
    entries = [imu(e.stamp, w, a) if e.topic == "/imu0" else e for e in entries_of(sequence(1.5))]
    recording = record(entries)
    list(recording.stream())
    (warning,) = recording.report.warnings
    assert text in warning


def test_one_bad_clock_jump_back_is_reported(record: Callable[..., Recording]) -> None:
    measurements = sequence(2.0)
    entries = [
        e._replace(stamp=e.stamp - 100 * SECOND, delay=100 * SECOND) if e.stamp > T0 + SECOND else e
        for e in entries_of(measurements)
    ]
    recording = record(entries)
    found = list(recording.stream())
    assert_same(found, [m for m in measurements if fields(m)[0] <= T0 + SECOND])
    assert len(recording.report.warnings) == 2
    assert all("more than 0.5 s behind others" in line for line in recording.report.warnings)
