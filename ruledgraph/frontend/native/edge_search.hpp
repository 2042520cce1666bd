// SPDX-FileCopyrightText: The ruledgraph developers
// SPDX-License-Identifier: BSD-3-Clause
//
// Edge points along predicted rulings, in plain C++; `search` is the entry. The native version of
// `search` in `ruledgraph/frontend/edge_search.py`, which says what is computed and stays the
// reference: same steps, same order of operations, same names. Slopes are float there and here.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdlib>
#include <optional>
#include <tuple>
#include <utility>
#include <vector>

#include "camera.hpp"
#include "gradient.hpp"
#include "moved_ends.hpp"

namespace ruledgraph {

/// Of `EdgesConfig` in Python, which says what they mean and where their values come from.
struct SearchSettings {
  double station_distance_px;
  int max_stations, min_points;
  double min_support, min_extent, min_slope, min_slope_share;
  int stripe_px;
  double stripe_share, vote_px, inlier_px, sigma_penalty, rival_distance_px, rival_share,
      end_growth;
};

/// A predicted segment: ends, normalised; deviation across it at both, px; usual signed slope.
struct Ruling {
  Point first, second;
  double sigma_first, sigma_second;
  double slope;
  Point bow{0.0, 0.0};  ///< of its middle from the straight line, where it is bent: a parabola
};

/// y = a + b x.
struct StraightLine {
  double a, b;
};

/// What was found along a ruling: of `EdgePoints` in Python what `Edges` takes.
struct EdgePoints {
  std::vector<Point> points;
  Point first, second;  ///< the ruling's ends, moved
  StraightLine line;
  double support, deviation, slope;
  bool ambiguous;
};

namespace edge_search {

/// Where the slope across the ruling is looked at.
struct Station {
  double along;
  Point normalised, pixel, across;
};

/// `std::nearbyint` without the call: beyond 2^52 a double has no fraction left. Of small numbers.
inline double rounded(double x) {
  constexpr double kWhole = 6755399441055744.0;  // 1.5 * 2^52
  return (x + kWhole) - kWhole;
}

/// A local maximum of the slope.
struct Candidate {
  std::size_t station;
  double place, offset, height;
  double s() const { return 2.0 * place - 1.0; }
};

/// Least squares of `y(c)` over `x(c)`.
template <typename X, typename Y>
StraightLine fit_line(const std::vector<Candidate>& candidates, X x, Y y) {
  const auto count = static_cast<double>(candidates.size());
  double x_mean = 0.0, y_mean = 0.0;
  for (const Candidate& c : candidates) {
    x_mean += x(c);
    y_mean += y(c);
  }
  x_mean /= count;
  y_mean /= count;
  double xy = 0.0, xx = 0.0;
  for (const Candidate& c : candidates) {
    const double from_mean = x(c) - x_mean;
    xy += from_mean * y(c);
    xx += from_mean * from_mean;
  }
  const double b = xy / xx;
  return {y_mean - b * x_mean, b};
}

/// The stations inside the image, none where the ruling has too few or no sensible length.
inline std::vector<Station> stations(const GradientView& gradient, const Camera& camera,
                                     const Ruling& ruling, double beyond,
                                     const SearchSettings& settings) {
  const Point segment = ruling.second - ruling.first;
  const double length =
      norm(camera.distort(ruling.second).pixel - camera.distort(ruling.first).pixel);
  const double shortest = settings.station_distance_px * settings.min_points;
  if (!(shortest < length && length < 4.0 * (camera.width + camera.height))) return {};
  const double extent = std::max(std::hypot(segment.x, segment.y), 1e-12);
  const Point normal{-segment.y / extent, segment.x / extent};
  const int last =
      static_cast<int>(std::min(length * (1.0 + 2.0 * beyond) / settings.station_distance_px,
                                static_cast<double>(settings.max_stations)));
  const double step = (1.0 + beyond + beyond) / last;
  const bool bent = ruling.bow.x != 0.0 || ruling.bow.y != 0.0;
  std::vector<Station> found;
  for (int i = 0; i <= last; ++i) {
    const double along = i == last ? 1.0 + beyond : i * step - beyond;
    Point normalised = ruling.first + along * segment;
    Point direction = segment;
    if (bent) {
      normalised = normalised + (4.0 * along * (1.0 - along)) * ruling.bow;
      direction = direction + (4.0 - 8.0 * along) * ruling.bow;
    }
    const Distorted distorted = camera.distort(normalised);
    if (!gradient.inside(distorted.pixel)) continue;
    // Across the ruling's image: perpendicular to J (second - first).
    const Matrix2& J = distorted.jacobian;
    const Point tangent = J * direction;
    const double size = norm(tangent);
    Point across{-tangent.y / size, tangent.x / size};
    const Point turned = J * normal;
    if (across.x * turned.x + across.y * turned.y < 0.0) across = -1.0 * across;
    found.push_back({along, normalised, distorted.pixel, across});
  }
  if (static_cast<int>(found.size()) < settings.min_points) found.clear();
  return found;
}

/// Local maxima of the slope across the ruling within the band, by a parabola; in order of station.
inline std::vector<Candidate> maxima(const GradientView& gradient, const Ruling& ruling,
                                     const std::vector<Station>& stations,
                                     const SearchSettings& settings) {
  const double sigma_first = ruling.sigma_first, sigma_second = ruling.sigma_second;
  const int half = static_cast<int>(std::ceil(3.0 * std::max(sigma_first, sigma_second))) + 1;
  const auto sign = static_cast<float>((ruling.slope > 0.0) - (ruling.slope < 0.0));
  const auto least = static_cast<float>(
      std::max(settings.min_slope, settings.min_slope_share * std::abs(ruling.slope)));
  const int stripe = settings.stripe_px;
  const auto stripe_share = static_cast<float>(settings.stripe_share);
  const int reach = half + 1;
  std::vector<float> slopes(static_cast<std::size_t>(2 * reach + 1));
  std::vector<Candidate> found;
  for (std::size_t i = 0; i < stations.size(); ++i) {
    const Station& station = stations[i];
    const auto slope = [&](int step) {
      return gradient.along(station.pixel + step * station.across, station.across) * sign;
    };
    // With both ends all between them is inside.
    const bool inside = gradient.inside(station.pixel - reach * station.across) &&
                        gradient.inside(station.pixel + reach * station.across);
    for (int step = -reach; step <= reach; ++step) {
      const Point at = station.pixel + step * station.across;
      slopes[static_cast<std::size_t>(step + reach)] =
          inside ? gradient.interpolated(at, station.across) * sign : slope(step);
    }
    for (int step = -half; step <= half; ++step) {
      const float* at = slopes.data() + (step + reach);
      if (!(at[0] > least && at[0] >= at[-1] && at[0] > at[1])) continue;
      // A stripe's other edge may lie outside the band.
      float lowest = at[0];
      for (int near = step - stripe; near <= step + stripe; ++near) {
        const bool sampled = std::abs(near) <= reach;
        lowest = std::min(lowest, sampled ? at[near - step] : slope(near));
      }
      if (lowest < -stripe_share * at[0]) continue;
      const double middle = at[0], left = at[-1], right = at[1];
      const double offset = step + 0.5 * (left - right) / (left - 2.0 * middle + right);
      // Beyond an end as at it.
      const double of_end = std::clamp(station.along, 0.0, 1.0);
      const double sigma = sigma_first + (sigma_second - sigma_first) * of_end;
      if (std::abs(offset) <= 3.0 * sigma + 1.0) {
        found.push_back({i, station.along, offset, middle});
      }
    }
  }
  return found;
}

/// The line offset = a + b (2 place - 1) with most candidates near it, less a penalty for its
/// distance from the prediction; and whether another comes close.
inline std::pair<StraightLine, bool> vote(const std::vector<Candidate>& candidates,
                                          const Ruling& ruling, const SearchSettings& settings) {
  const double tilt = 3.0 * std::max(ruling.sigma_first, ruling.sigma_second);
  double furthest = 0.0;
  for (const Candidate& c : candidates) furthest = std::max(furthest, std::abs(c.offset));
  const int steepest = static_cast<int>(std::ceil(tilt));
  const int reach = static_cast<int>(std::ceil(furthest + tilt)) + 2;
  const double first = std::max(ruling.sigma_first, 0.5);
  const double second = std::max(ruling.sigma_second, 0.5);
  const int bins = 2 * reach + 1;
  // With a cell to spare at both ends.
  std::vector<double> votes(static_cast<std::size_t>(bins + 2));
  std::vector<double> score(static_cast<std::size_t>((2 * steepest + 1) * bins));
  for (int b = -steepest; b <= steepest; ++b) {
    std::fill(votes.begin(), votes.end(), 0.0);
    double* const middle = votes.data() + 1;
    for (const Candidate& c : candidates) {
      const int cell = static_cast<int>(rounded(c.offset - c.s() * b)) + reach;
      if (cell >= 0 && cell < bins) middle[cell] += 1.0;
    }
    double* const own = score.data() + (b + steepest) * bins;
    for (int i = 0; i < bins; ++i) {
      const double smooth = middle[i] + 0.5 * middle[i - 1] + 0.5 * middle[i + 1];
      const int a = i - reach;
      const double at_first = (a - b) / first, at_second = (a + b) / second;
      const double away = at_first * at_first + at_second * at_second;
      own[i] = smooth * std::max(1.0 - settings.sigma_penalty * away, 0.0);
    }
  }
  const auto best = std::max_element(score.begin(), score.end());
  const auto winner = static_cast<int>(best - score.begin());
  const int b0 = winner / bins - steepest, a0 = winner % bins - reach;
  double rival = 0.0;
  auto next = score.begin();
  for (int b = -steepest; b <= steepest; ++b) {
    for (int a = -reach; a <= reach; ++a, ++next) {
      const int distance = std::max(std::abs(a - b - a0 + b0), std::abs(a + b - a0 - b0));
      if (distance > settings.rival_distance_px) rival = std::max(rival, *next);
    }
  }
  return {{static_cast<double>(a0), static_cast<double>(b0)}, rival > settings.rival_share * *best};
}

/// The points on the line, one for each station, after refining it twice.
inline std::vector<Candidate> inliers(const std::vector<Candidate>& candidates, StraightLine line,
                                      const SearchSettings& settings) {
  std::vector<Candidate> chosen;
  // The vote counts in cells of 1 px.
  for (const double tolerance : {settings.vote_px + 0.5, settings.vote_px, settings.inlier_px}) {
    chosen.clear();
    for (std::size_t i = 0; i < candidates.size();) {
      const std::size_t station = candidates[i].station;
      double nearest = tolerance;
      std::size_t best = candidates.size();
      for (; i < candidates.size() && candidates[i].station == station; ++i) {
        const Candidate& c = candidates[i];
        const double residual = std::abs(c.offset - line.a - line.b * c.s());
        if (residual < nearest) {
          nearest = residual;
          best = i;
        }
      }
      if (best < candidates.size()) chosen.push_back(candidates[best]);
    }
    if (static_cast<int>(chosen.size()) < settings.min_points ||
        chosen.back().s() - chosen.front().s() < 2.0 * settings.min_extent) {
      return {};
    }
    line = fit_line(
        chosen, [](const Candidate& c) { return c.s(); },
        [](const Candidate& c) { return c.offset; });
  }
  return chosen;
}

inline double median(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  const std::size_t half = values.size() / 2;
  return values.size() % 2 == 1 ? values[half] : 0.5 * (values[half - 1] + values[half]);
}

}  // namespace edge_search

/// Edge points of one line, none if there is no such line in the band. It is looked for `beyond`
/// past both ends, a share of the segment's length. The ruling's sigmas must be finite.
inline std::optional<EdgePoints> search(const GradientView& gradient, const Camera& camera,
                                        const Ruling& ruling, double beyond,
                                        const SearchSettings& settings) {
  using namespace edge_search;
  const std::vector<Station> stations =
      edge_search::stations(gradient, camera, ruling, beyond, settings);
  if (stations.empty()) return std::nullopt;
  const std::vector<Candidate> candidates = maxima(gradient, ruling, stations, settings);
  if (static_cast<int>(candidates.size()) < settings.min_points) return std::nullopt;
  const auto [winner, ambiguous] = vote(candidates, ruling, settings);
  const std::vector<Candidate> chosen = inliers(candidates, winner, settings);
  const auto looked_at = static_cast<double>(stations.size());
  const auto count = static_cast<double>(chosen.size());
  if (count < std::max<double>(settings.min_points, settings.min_support * looked_at)) {
    return std::nullopt;
  }

  EdgePoints found;
  std::vector<Point> pixels, near;
  std::vector<double> heights;
  for (const Candidate& c : chosen) {
    const Station& station = stations[c.station];
    pixels.push_back(station.pixel + c.offset * station.across);
    near.push_back(station.normalised);
    heights.push_back(c.height);
  }
  found.points = camera.undistort(pixels, std::move(near));
  for (const Point& point : found.points) {
    if (!std::isfinite(point.x) || !std::isfinite(point.y)) return std::nullopt;
  }
  std::tie(found.first, found.second) =
      moved_ends(ruling.first, ruling.second, found.points, settings.end_growth);
  found.line = fit_line(
      chosen, [](const Candidate& c) { return c.place; },
      [](const Candidate& c) { return c.offset; });
  double squares = 0.0;
  for (const Candidate& c : chosen) {
    const double off = c.offset - found.line.a - found.line.b * c.place;
    squares += off * off;
  }
  found.deviation = std::sqrt(squares / count);
  found.support = count / looked_at;
  found.slope = std::copysign(median(std::move(heights)), ruling.slope);
  found.ambiguous = ambiguous;
  return found;
}

}  // namespace ruledgraph
