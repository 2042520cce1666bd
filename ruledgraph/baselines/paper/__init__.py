# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The paper's own solver, as a baseline: Zhu, Burner, Aloimonos, arXiv 2512.00327.

As published: derotation by the gyroscope to each window's first frame; thresholded Sobel points;
lines by the Hough transform; association by distance from the predicted ruling; reprojection loss
with alpha in closed form (eq. 12 to 15); 4 M + 6 unknowns; a window of 140 frames that is extruded
(algorithm 1) and then slides by one frame (algorithm 2); a loss above 0.01 perturbs and solves
again; the trajectory is the sum of each window's first displacement.

What the paper leaves open, and what is chosen here:

- M is 4, as in its scenes. A line that leaves the view is predicted on, none takes its place.
- tau is 0.01 in normalised coordinates, 4 px of its camera: wider than half of an edge's band of
  Sobel points, narrower than half of a slat of 4 cm.
- At most 20 points per line and frame, drawn at random.
- OpenCV's probabilistic Hough transform, the one that has these parameters, gives no votes: its
  longest segment stands for the strongest, and a straight line fitted to its points replaces it. It
  runs on the first frame, extrusion begins with the second. "5 centimeters in undistorted image
  plane", within which a found line's points are removed, is read as 0.05 in normalised coordinates.
- All rulings start 1 m away and parallel to the image, with no velocity, and with the mean specific
  force of the first 0.1 s for gravity.
- The constraints on X0 and V0 hold by the choice of unknowns: V0 on the sphere, X0 perpendicular to
  it. Positive depth: a point behind the camera has a residual of 1.
- At rest, and along a line's own direction always, the points leave depth and more open, and least
  squares would run away. Each solve is therefore held to the solution before it, with the weight of
  one point (`surfaces.solve`); a moving camera's thousands of points outweigh that.
- Eq. 12's sum is over the points of one time, so what is compared with 0.01 is that sum's mean over
  the frames. Perturbations are normal with deviation 0.03 (rad, m, m/s, m/s^2), at most five; the
  best solution stays.
- Levenberg-Marquardt (MINPACK) with the analytic Jacobian. Since alpha makes a residual
  perpendicular to its ruling, its two numbers are one.
- The gyroscope's mean over an initial rest, if there is one, is taken for its bias. The
  accelerometer's is in the free vector g, as published.
- The camera's place beside the IMU is taken into account.
- The frames of the last window follow from its own displacements. The world is levelled by the
  first 0.1 s of specific force.
- A gap in the IMU's samples ends the trajectory.
"""

from ruledgraph.baselines.paper.odometry import PaperOdometry
from ruledgraph.baselines.paper.window import Rulings

__all__ = ["PaperOdometry", "Rulings"]
