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
    sobel_gate_px: float = number(3.0, "px", 0.5, 50.0)
    """The paper's tau: how far from its predicted ruling a Sobel pixel may lie."""
    max_lines: int = number(60, "", 2, 200)
    """Lines followed at a time, which bounds the time that takes: more than most images hold. Those
    with nets or gravel hold more, of which the longest are followed."""
    sigma_px: float = number(1.0, "px", 0.01, 20.0)
    """Standard deviation of an edge point. It counts until the images have shown another one. A
    point alone scatters less, but the points of a line err together, and from frame to frame."""
    variance_prior: float = number(5.0, "", 0.1, 1e9)
    """Degrees of freedom that this figure counts for, beside the residuals of lines: few. A huge
    number keeps the figure."""
    correlation: float = number(8.0, "", 1.0, 100.0)
    """By what factor a line's errors, which last from frame to frame, are worse than independent
    ones of the same size. In 494 first windows of seven recordings, at full and at half size, the
    velocity's squared error was 4 to 18 times what independent residuals would mean, by their
    medians for each recording and size; 8 times in the geometric mean."""
    effective_points: float = number(20.0, "", 1.0, 1e4)
    """The most points of that deviation a line's edge in one frame counts for."""
    bounded: bool = True
    """Whether a line is searched only where it was seen; the paper's rulings are unbounded."""
    station_distance_px: float = number(2.0, "px", 0.5, 50.0)
    """Distance between the places along a ruling (stations) where edge points are looked for: what
    the image's smoothing leaves of independent noise, and enough points on the shortest line."""
    max_stations: int = number(80, "", 10, 1000)
    """Stations of a ruling at most: a long one has them further apart."""
    min_points: int = number(8, "", 3, 100)
    """Fewer edge points are no line."""
    min_support: float = number(0.35, "", 0.0, 1.0)
    """Share of the stations inside the image that must have a point."""
    min_extent: float = number(0.1, "", 0.0, 1.0)
    """Share of the ruling's length that the points must cover."""
    min_slope: float = number(1.5, "grey/px", 0.1, 100.0)
    """Smallest slope across an edge: seven times what pixel noise of 1.5 grey levels leaves."""
    min_slope_share: float = number(0.3, "", 0.0, 1.0)
    """How much weaker than the line usually is a point may be."""
    stripe_angle: float = number(0.011, "rad", 0.0, 0.1)
    """An edge with one of the other polarity within this angle bounds a thin stripe and is left
    out: tracks confuse its edges, and blur moves them."""
    stripe_px: int = number(5, "px", 0, 50)
    """The most of that in the image: 5 px is the angle at a focal length of 450 px ..."""
    stripe_blur_px: int = number(3, "px", 0, 50)
    """... and the least. Blur pushes the edges of a stripe apart, more the thinner it is: moving
    towards it would seem slower. With the gradient's own, the blur of sharp images has a deviation
    of 1.4 to 1.6 px; two edges are felt at this distance up to 5 px apart, where each is displaced
    by 0.03 px."""
    stripe_share: float = number(0.4, "", 0.0, 10.0)
    """How strong the other edge of such a stripe is at least, as a share of the one."""
    vote_px: float = number(1.0, "px", 0.1, 10.0)
    """How far a point may lie off the winning line while that is refined ..."""
    inlier_px: float = number(0.7, "px", 0.1, 10.0)
    """... and at the end."""
    sigma_penalty: float = number(0.025, "", 0.0, 1.0)
    """Share of its points that a line loses in the vote for each squared standard deviation that
    an end is away from the prediction."""
    rival_distance_px: float = number(3.0, "px", 1.0, 50.0)
    """A second line so far from the winner ..."""
    rival_share: float = number(0.85, "", 0.0, 1.0)
    """... with this share of its votes makes it ambiguous."""
    end_growth: float = number(0.3, "", 0.0, 1.0)
    """How much of the way to its outermost points a line's end goes in a frame."""


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
    flow_reach: float = number(0.2, "", 0.01, 10.0)
    """How far the motions of two tracks have to do with each other, as a share of the image; taken
    for a fifth, not fitted ..."""
    flow_noise: float = number(0.3, "", 0.0, 10.0)
    """... and what share of it differs, as things beside each other are at different distances:
    taken for a third, not fitted."""
    min_sigma_px: float = number(2.0, "px", 0.1, 50.0)
    """Least deviation of a ruling predicted from the track alone."""
    max_sigma_px: float = number(6.0, "px", 0.5, 50.0)
    """Largest deviation of a ruling predicted from the track alone."""
    motion_sigma_px: float = number(1.2, "px", 0.1, 50.0)
    """Deviation that the motion's uncertainty adds to a ruling predicted from the estimate."""
    max_predicted_sigma_px: float = number(8.0, "px", 0.5, 50.0)
    """Largest deviation of a ruling predicted from the estimate, to bound the search's time."""
    nearest: float = number(0.05, "m", 1e-4, 10.0)
    """A point of a line that is nearer to the image plane may be behind it: it is not predicted."""
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
    min_length_px: float = number(20.0, "px", 10.0, 1e4)
    """Shortest segment that starts a track; one whose segment becomes shorter is lost."""
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
