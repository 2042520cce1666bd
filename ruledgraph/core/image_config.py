# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Settings of the front end: edges in one image, and lines followed from image to image."""

from typing import Literal

from ruledgraph.core.section import Section, number


class EdgesConfig(Section):
    """Edge points and segments in one image."""

    detector: Literal["lsd", "hough"] = "lsd"
    """Where new lines come from: OpenCV's line segment detector or the paper's Hough transform."""
    points: Literal["maxima", "sobel"] = "maxima"
    """Edge points: maxima of the slope across a ruling, or the paper's thresholded Sobel pixels."""
    gate: float = number(3.0, "px", 0.5, 50.0)
    """The paper's tau: how far from its predicted ruling a Sobel pixel may lie."""
    max_lines: int = number(24, "", 2, 200)
    """Lines followed at a time."""
    min_length: float = number(40.0, "px", 20.0, 1e4)
    """Shortest segment that starts a line."""
    sigma_px: float = number(0.5, "px", 0.01, 20.0)
    """Standard deviation of an edge point."""
    effective_points: float = number(20.0, "", 1.0, 1e4)
    """The most points of that deviation a line's edge in one frame counts for."""
    bounded: bool = True
    """Whether a line is searched only where it was seen; the paper's rulings are unbounded."""


class TracksConfig(Section):
    """Following lines from frame to frame."""

    min_track_age: float = number(0.15, "s", 0.0, 60.0)
    """How long a line is followed before it enters the graph."""
    detection_interval: float = number(0.1, "s", 0.0, 10.0)
    """New lines are looked for this often at most."""
    start_support: float = number(0.6, "", 0.0, 1.0)
    """Share of its stations at which a new line must have an edge point."""
    max_rms_px: float = number(0.45, "px", 0.05, 10.0)
    """Points that miss a straight line by more (root mean square) are not one line's."""
    max_rms_sobel_px: float = number(1.2, "px", 0.05, 10.0)
    """The same of Sobel pixels, which take in parts of neighbouring edges."""
    fresh_sigma_px: float = number(4.0, "px", 0.5, 50.0)
    """Standard deviation across itself of the predicted ruling of a new track."""
    min_sigma_px: float = number(2.0, "px", 0.1, 50.0)
    """Least deviation of a ruling predicted from the track alone."""
    max_sigma_px: float = number(6.0, "px", 0.5, 50.0)
    """Largest deviation of a ruling predicted from the track alone."""
    motion_sigma_px: float = number(1.2, "px", 0.1, 50.0)
    """Deviation that the motion's uncertainty adds to a ruling predicted from the estimate."""
    sigma_growth: float = number(1.5, "", 1.0, 10.0)
    """Factor by which a ruling's deviation grows with every frame that misses the line."""
    sigma_decay: float = number(0.7, "", 0.0, 1.0)
    """Factor by which the deviation of a track's ruling shrinks with every sighting."""
    rate_gain: float = number(0.7, "", 0.0, 1.0)
    """Share of a prediction's miss that is taken for the track's own motion."""
    rate_gain_after_miss: float = number(0.3, "", 0.0, 1.0)
    """The same in the first sighting after a miss."""
    slope_gain: float = number(0.2, "", 0.0, 1.0)
    """Weight of the newest sighting in the usual grey level slope across a line."""
    max_misses: int = number(3, "", 0, 100)
    """Frames in a row that may miss a line; it is lost with the next one."""
    max_miss_time: float = number(0.12, "s", 0.0, 10.0)
    """A line that was not seen for longer is lost with the next miss."""
    search_beyond: float = number(0.06, "", 0.0, 10.0)
    """How far past its ends a line is searched, so that it can grow; share of its length."""
    min_length_px: float = number(25.0, "px", 1.0, 1e4)
    """A track whose segment becomes shorter is lost."""
    duplicate_distance_px: float = number(5.0, "px", 0.0, 100.0)
    """Two segments closer than this all along may be one line ..."""
    duplicate_cosine: float = number(0.99, "", 0.0, 1.0)
    """... if the cosine of their angle is no less than this (8 degrees) ..."""
    duplicate_gap: float = number(0.2, "", 0.0, 10.0)
    """... and the gap between them is shorter than this share of the one that is known."""
    crowding_radius: float = number(0.12, "", 0.001, 10.0)
    """A new line this close to a followed one, as a share of the image, is worth less."""
    crowding_weight: float = number(2.0, "", 0.0, 100.0)
    """By how much less: a line on top of a followed one counts one plus this times shorter."""
