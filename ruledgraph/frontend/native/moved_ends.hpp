// SPDX-FileCopyrightText: The ruledgraph developers
// SPDX-License-Identifier: BSD-3-Clause
//
// Where a line ends, from where it was searched and where it was found. The native version of
// `moved_ends` in `ruledgraph/frontend/edge_batch.py`, which stays the reference.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <utility>
#include <vector>

#include "camera.hpp"

namespace ruledgraph {

inline double dot(Point a, Point b) { return a.x * b.x + a.y * b.y; }

/// A segment's ends moved onto the line through the points, and towards the outermost ones; as
/// `moved_ends` in Python.
inline std::pair<Point, Point> moved_ends(Point first, Point second,
                                          const std::vector<Point>& points, double growth) {
  const auto count = static_cast<double>(points.size());
  Point middle{0.0, 0.0};
  for (const Point& point : points) middle = middle + point;
  middle = {middle.x / count, middle.y / count};
  double xx = 0.0, xy = 0.0, yy = 0.0;
  for (const Point& point : points) {
    const Point off = point - middle;
    xx += off.x * off.x;
    xy += off.x * off.y;
    yy += off.y * off.y;
  }
  const double angle = 0.5 * std::atan2(2.0 * xy, xx - yy);
  Point direction{std::cos(angle), std::sin(angle)};
  if (dot(direction, second - first) < 0.0) direction = -1.0 * direction;
  std::vector<double> places;
  for (const Point& point : points) places.push_back(dot(point - middle, direction));
  double station = std::numeric_limits<double>::infinity();
  for (std::size_t i = 1; i < places.size(); ++i) {
    station = std::min(station, places[i] - places[i - 1]);
  }
  station = std::max(station, 0.0);
  const auto moved = [&](Point end, double outermost) {
    const double predicted = dot(end - middle, direction);
    return middle + (predicted + growth * (outermost - predicted)) * direction;
  };
  // One stray point does not stretch it: a station beyond the second and the last but one.
  return {moved(first, places[1] - station), moved(second, places[places.size() - 2] + station)};
}

}  // namespace ruledgraph
