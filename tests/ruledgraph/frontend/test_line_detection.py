# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause

import numpy as np
import pytest

from ruledgraph.frontend.line_detection import DETECTORS


def square_image() -> np.ndarray:
    image = np.full((240, 320), 70, np.uint8)
    image[50:190, 80:240] = 160
    return image


@pytest.mark.parametrize("detector", DETECTORS)
def test_the_four_sides_of_a_square_are_found(detector):
    segments = DETECTORS[detector](square_image())
    for axis, place in ((0, 79.5), (0, 239.5), (1, 49.5), (1, 189.5)):
        # Hough lines are as good as its 5 px by 1 degree cells.
        near = np.all(np.abs(segments[:, :, axis] - place) < 5.0, axis=1)
        lengths = np.linalg.norm(segments[near, 1] - segments[near, 0], axis=1)
        assert lengths.max(initial=0.0) > 100.0


@pytest.mark.parametrize("detector", DETECTORS)
def test_a_blank_image_has_no_lines(detector):
    assert DETECTORS[detector](np.full((240, 320), 90, np.uint8)).shape == (0, 2, 2)
