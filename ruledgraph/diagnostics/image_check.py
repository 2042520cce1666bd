# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Whether an image shows straight edges."""

from collections.abc import Iterator

import numpy as np

from ruledgraph.core.config import DEFAULTS, Config
from ruledgraph.diagnostics.finding import Finding
from ruledgraph.frontend.line_detection import DETECTORS
from ruledgraph.recording.images import Grey

# Segments; the images of rooms and halls hold dozens, two lines are needed at any time.
_MIN_SEGMENTS = 6


def examine_image(image: Grey, config: Config = DEFAULTS) -> Iterator[Finding]:
    """One of the first images: straight segments that may become lines, and how bright it is.

    Args:
        image: to look at.
        config: with the detector and the least length of these settings.
    """
    segments = DETECTORS[config.edges.detector](image)
    lengths = np.linalg.norm(segments[:, 1] - segments[:, 0], axis=1)
    least = config.tracks.min_length_px
    count = int(np.count_nonzero(lengths >= least))
    text = f"an image at the beginning has {count} straight edges of {least:g} px or more"
    if count >= _MIN_SEGMENTS:
        yield Finding(True, text)
        return
    yield Finding(
        False,
        f"{text}, mean grey level {image.mean():.0f} of 255: more light, a longer exposure, or a "
        "view with edges",
    )
