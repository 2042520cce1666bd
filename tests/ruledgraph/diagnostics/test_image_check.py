# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause

import numpy as np
import pytest

from ruledgraph.core.config import Config, TracksConfig
from ruledgraph.core.measurements import Frame
from ruledgraph.diagnostics.image_check import examine_image
from small_simulation import small_stream


@pytest.mark.parametrize(("light", "good"), [(1.0, True), (0.02, False), (0.0, False)])
def test_an_image_without_edges_is_found(light, good):
    stream, _ = small_stream(duration=1.0)
    image = next(m.image for m in stream if isinstance(m, Frame))
    (finding,) = examine_image(np.asarray(image * light, dtype=np.uint8))
    assert finding.good == good
    assert "straight edges of 20 px or more" in finding.text
    assert ("more light" in finding.text) == (not good)


@pytest.mark.parametrize(("min_length", "good"), [(20.0, True), (300.0, False)])
def test_edges_are_counted_as_the_settings_say(min_length, good):
    stream, _ = small_stream(duration=1.0)
    image = next(m.image for m in stream if isinstance(m, Frame))
    (finding,) = examine_image(image, Config(tracks=TracksConfig(min_length_px=min_length)))
    assert finding.good == good
    assert f"straight edges of {min_length:g} px or more" in finding.text
