// SPDX-FileCopyrightText: The ruledgraph developers
// SPDX-License-Identifier: BSD-3-Clause
//
// The camera models, in plain C++. The native version of `CameraModel` in
// `ruledgraph/calibration/camera_model.py` and of `wide_angle.py` beside it, which say what is
// computed and stay the reference: same order of operations.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <vector>

namespace ruledgraph {

struct Point {
  double x, y;
};

inline Point operator+(Point a, Point b) { return {a.x + b.x, a.y + b.y}; }
inline Point operator-(Point a, Point b) { return {a.x - b.x, a.y - b.y}; }
inline Point operator*(double s, Point a) { return {s * a.x, s * a.y}; }
inline double norm(Point a) { return std::sqrt(a.x * a.x + a.y * a.y); }

/// A 2x2 matrix, named by row and column.
struct Matrix2 {
  double xx, xy, yx, yy;
};

inline Point operator*(const Matrix2& m, Point a) {
  return {m.xx * a.x + m.xy * a.y, m.yx * a.x + m.yy * a.y};
}

/// A pixel and its derivative in the normalised coordinates.
struct Distorted {
  Point pixel;
  Matrix2 jacobian;
};

enum class Distortion { kNone, kRadtan, kEquidistant, kOmni, kEucm, kDoubleSphere };

/// Pinhole camera with distortion; pixel (0, 0) is the centre of the top left pixel.
struct Camera {
  static constexpr double kConverged = 1e-10;
  static constexpr int kMostSteps = 50;

  int width, height;
  double fx, fy, cx, cy;
  Distortion distortion;
  std::array<double, 5> coefficients;  ///< those that a model lacks are 0

  Distorted distort(Point normalised) const {
    Distorted d{normalised, {1.0, 0.0, 0.0, 1.0}};
    if (distortion == Distortion::kRadtan) {
      const auto [k1, k2, p1, p2, k3] = coefficients;
      d = radtan(normalised, k1, k2, p1, p2, k3);
    } else if (distortion == Distortion::kEquidistant) {
      d = equidistant(normalised);
    } else if (distortion != Distortion::kNone) {
      d = wide_angle(normalised);
      if (distortion == Distortion::kOmni) {
        const auto [xi, k1, k2, p1, p2] = coefficients;
        static_cast<void>(xi);
        const Distorted bent = radtan(d.pixel, k1, k2, p1, p2, 0.0);
        const Matrix2 &B = bent.jacobian, A = d.jacobian;
        d = {bent.pixel,
             {B.xx * A.xx + B.xy * A.yx, B.xx * A.xy + B.xy * A.yy, B.yx * A.xx + B.yy * A.yx,
              B.yx * A.xy + B.yy * A.yy}};
      }
    }
    const Matrix2& J = d.jacobian;
    return {{d.pixel.x * fx + cx, d.pixel.y * fy + cy},
            {J.xx * fx, J.xy * fx, J.yx * fy, J.yy * fy}};
  }

  /// Normalised coordinates of pixels, NaN where the model has no solution, by Newton's method
  /// from `near`, as many guesses. All take as many steps as the slowest.
  std::vector<Point> undistort(const std::vector<Point>& pixels, std::vector<Point> near) const {
    std::vector<Point>& xy = near;
    const std::size_t count = pixels.size();
    if (distortion == Distortion::kNone) {
      for (std::size_t i = 0; i < count; ++i) {
        xy[i] = {(pixels[i].x - cx) / fx, (pixels[i].y - cy) / fy};
      }
      return xy;
    }
    constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
    std::vector<Distorted> distorted(count);
    std::vector<Point> error(count);
    for (int step = 0; step < kMostSteps; ++step) {
      double largest = 0.0;
      for (std::size_t i = 0; i < count; ++i) {
        distorted[i] = distort(xy[i]);
        const Point off = distorted[i].pixel - pixels[i];
        error[i] = {off.x / fx, off.y / fy};
        // std::fmax passes over NaN.
        largest = std::fmax(largest, std::fmax(std::abs(error[i].x), std::abs(error[i].y)));
      }
      if (largest < kConverged) break;
      for (std::size_t i = 0; i < count; ++i) {
        const Matrix2& by_px = distorted[i].jacobian;
        const Matrix2 J{by_px.xx / fx, by_px.xy / fx, by_px.yx / fy, by_px.yy / fy};
        double determinant = J.xx * J.yy - J.xy * J.yx;
        // Where the distortion folds over, there is no inverse.
        if (!(determinant > 1e-9)) determinant = kNan;
        xy[i] = xy[i] - Point{(J.yy * error[i].x - J.xy * error[i].y) / determinant,
                              (J.xx * error[i].y - J.yx * error[i].x) / determinant};
      }
    }
    for (std::size_t i = 0; i < count; ++i) {
      const bool solved = std::abs(error[i].x) < kConverged && std::abs(error[i].y) < kConverged;
      if (!solved) xy[i] = {kNan, kNan};
    }
    return xy;
  }

 private:
  static Distorted radtan(Point at, double k1, double k2, double p1, double p2, double k3) {
    const double x = at.x, y = at.y;
    const double xx = x * x, yy = y * y, xy = x * y;
    const double r2 = xx + yy;
    const double radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
    const double slope = 2.0 * (k1 + r2 * (2.0 * k2 + 3.0 * k3 * r2));  // d radial / d r2, times 2
    const double mixed = xy * slope + 2.0 * p1 * x + 2.0 * p2 * y;
    return {{x * radial + 2.0 * p1 * xy + p2 * (r2 + 2.0 * xx),
             y * radial + p1 * (r2 + 2.0 * yy) + 2.0 * p2 * xy},
            {radial + xx * slope + 2.0 * p1 * y + 6.0 * p2 * x, mixed, mixed,
             radial + yy * slope + 6.0 * p1 * y + 2.0 * p2 * x}};
  }

  Distorted wide_angle(Point at) const {
    const double r2 = at.x * at.x + at.y * at.y;
    double h, slope;
    if (distortion == Distortion::kEucm) {
      const double alpha = coefficients[0], beta = coefficients[1];
      const double root = std::sqrt(beta * r2 + 1.0);
      h = alpha * root + 1.0 - alpha;
      slope = 0.5 * alpha * beta / root;
    } else {
      const double xi = coefficients[0];
      const double root = std::sqrt(r2 + 1.0);
      h = xi * root + 1.0;
      slope = 0.5 * xi / root;
      if (distortion == Distortion::kDoubleSphere) {
        const double alpha = coefficients[1], k = h, k_slope = slope;
        const double outer = std::sqrt(r2 + k * k);
        h = alpha * outer + (1.0 - alpha) * k;
        slope = alpha * (0.5 + k * k_slope) / outer + (1.0 - alpha) * k_slope;
      }
    }
    const double bend = -2.0 * slope / (h * h);
    const double mixed = bend * at.x * at.y;
    return {{at.x / h, at.y / h},
            {bend * at.x * at.x + 1.0 / h, mixed, mixed, bend * at.y * at.y + 1.0 / h}};
  }

  Distorted equidistant(Point at) const {
    const auto [k1, k2, k3, k4, unused] = coefficients;
    static_cast<void>(unused);
    const double r = norm(at);
    const double theta = std::atan(r);
    const double t2 = theta * theta;
    const double bent = theta * (1.0 + t2 * (k1 + t2 * (k2 + t2 * (k3 + t2 * k4))));
    const double slope = 1.0 + t2 * (3.0 * k1 + t2 * (5.0 * k2 + t2 * (7.0 * k3 + t2 * 9.0 * k4)));
    const double safe = std::fmax(r, 1e-9);
    const double scale = r > 1e-9 ? bent / safe : 1.0;
    // d = scale(r) xy; along the radius the derivative is d bent / d r, across it is the scale.
    const double bend = slope / (1.0 + r * r) - scale;
    const Point unit{at.x / safe, at.y / safe};
    const double mixed = bend * (unit.x * unit.y);
    return {{at.x * scale, at.y * scale},
            {scale + bend * (unit.x * unit.x), mixed, mixed, scale + bend * (unit.y * unit.y)}};
  }
};

}  // namespace ruledgraph
