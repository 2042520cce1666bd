// SPDX-FileCopyrightText: The ruledgraph developers
// SPDX-License-Identifier: BSD-3-Clause
//
// The gradient of a lightly blurred image, in plain C++. The native version of `gradient_by_opencv`
// in `ruledgraph/frontend/gradient.py`, which says what is computed and stays the reference: the
// same to the rounding of float. It goes through the image once, row by row, with what it needs of
// the rows before in the processor's cache. `GradientView` is the native version of `Gradient`
// there.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "camera.hpp"

namespace ruledgraph {

/// The loops are written out for it.
constexpr int kBlurReach = 4;
/// Scharr's derivative is 32 times the grey levels per pixel.
constexpr float kScharr = 1.0F / 32.0F;

namespace detail {

/// A place beyond the border is where it is mirrored to: the border itself is not repeated.
inline int mirrored(int i, int size) {
  if (size == 1) return 0;
  while (i < 0 || i >= size) i = i < 0 ? -i : 2 * (size - 1) - i;
  return i;
}

/// The middle weight of the Gaussian and those to either side of it.
inline std::array<float, kBlurReach + 1> blur_weights(double deviation) {
  std::array<double, kBlurReach + 1> exact{};
  double sum = 0.0;
  for (int i = 0; i <= kBlurReach; ++i) {
    exact[i] = std::exp(-0.5 * i * i / (deviation * deviation));
    sum += (i == 0 ? 1.0 : 2.0) * exact[i];
  }
  std::array<float, kBlurReach + 1> weights{};
  for (int i = 0; i <= kBlurReach; ++i) weights[i] = static_cast<float>(exact[i] / sum);
  return weights;
}

}  // namespace detail

/// Write d/dx and d/dy of the blurred image, side by side, (height, width, 2), grey levels per px;
/// `blur` is the deviation of the blur, px.
inline void gradient(const std::uint8_t* image, int width, int height, double blur, float* xy) {
  using detail::mirrored;
  if (width <= 0 || height <= 0) return;
  constexpr int kRows = 2 * kBlurReach + 1;
  const auto k = detail::blur_weights(blur);
  const auto columns = static_cast<std::size_t>(width);
  std::vector<float> grey(columns + 2 * kBlurReach);
  // Rows blurred along x, each at its number modulo kRows; rows blurred both ways, modulo 3, with
  // a mirrored pixel at both ends.
  std::vector<float> along(kRows * columns), blurred(3 * (columns + 2));
  const auto along_row = [&](int y) {
    return &along[static_cast<std::size_t>(y % kRows) * columns];
  };
  const auto blurred_row = [&](int y) {
    return &blurred[static_cast<std::size_t>(y % 3) * (columns + 2) + 1];
  };

  const auto blur_along = [&](int y) {
    const std::uint8_t* source = image + static_cast<std::size_t>(y) * columns;
    float* padded = grey.data() + kBlurReach;
    for (int x = 0; x < width; ++x) padded[x] = static_cast<float>(source[x]);
    for (int i = 1; i <= kBlurReach; ++i) {
      padded[-i] = padded[mirrored(-i, width)];
      padded[width - 1 + i] = padded[mirrored(width - 1 + i, width)];
    }
    float* out = along_row(y);
    for (int x = 0; x < width; ++x) {
      const float* p = padded + x;
      out[x] = k[0] * p[0] + k[1] * (p[-1] + p[1]) + k[2] * (p[-2] + p[2]) + k[3] * (p[-3] + p[3]) +
               k[4] * (p[-4] + p[4]);
    }
  };

  const auto blur_across = [&](int y) {
    std::array<const float*, kRows> r{};
    for (int i = 0; i < kRows; ++i) r[i] = along_row(mirrored(y + i - kBlurReach, height));
    float* out = blurred_row(y);
    for (int x = 0; x < width; ++x) {
      out[x] = k[0] * r[4][x] + k[1] * (r[3][x] + r[5][x]) + k[2] * (r[2][x] + r[6][x]) +
               k[3] * (r[1][x] + r[7][x]) + k[4] * (r[0][x] + r[8][x]);
    }
    out[-1] = out[mirrored(-1, width)];
    out[width] = out[mirrored(width, width)];
  };

  int next_along = 0, next_blurred = 0;
  for (int y = 0; y < height; ++y) {
    const int below = y + 1 < height ? y + 1 : y;
    for (; next_blurred <= below; ++next_blurred) {
      for (; next_along < height && next_along <= next_blurred + kBlurReach; ++next_along) {
        blur_along(next_along);
      }
      blur_across(next_blurred);
    }
    const float* a = blurred_row(mirrored(y - 1, height));
    const float* b = blurred_row(y);
    const float* c = blurred_row(mirrored(y + 1, height));
    float* out = xy + 2 * static_cast<std::size_t>(y) * columns;
    for (int x = 0; x < width; ++x) {
      const float dx =
          3.0F * (a[x + 1] - a[x - 1] + c[x + 1] - c[x - 1]) + 10.0F * (b[x + 1] - b[x - 1]);
      const float dy = 3.0F * (c[x - 1] - a[x - 1] + c[x + 1] - a[x + 1]) + 10.0F * (c[x] - a[x]);
      out[2 * x] = kScharr * dx;
      out[2 * x + 1] = kScharr * dy;
    }
  }
}

/// The image gradient, x and y side by side, rows from the top; not owned.
struct GradientView {
  const float* xy;
  int width, height;
  double border;  ///< pixels so near the border are not used

  bool inside(Point pixel) const {
    return pixel.x >= border && pixel.y >= border && pixel.x <= width - 1.0 - border &&
           pixel.y <= height - 1.0 - border;
  }

  /// Derivative along a unit direction by bilinear interpolation; outside the image 0.
  float along(Point pixel, Point direction) const {
    return inside(pixel) ? interpolated(pixel, direction) : 0.0F;
  }

  /// `along` of a pixel that is inside.
  float interpolated(Point pixel, Point direction) const {
    const auto column = static_cast<std::int64_t>(pixel.x);
    const auto row = static_cast<std::int64_t>(pixel.y);
    const auto u = static_cast<float>(pixel.x - static_cast<double>(column));
    const auto v = static_cast<float>(pixel.y - static_cast<double>(row));
    const float* top = xy + 2 * (row * width + column);
    const float* bottom = top + 2 * static_cast<std::int64_t>(width);
    const auto blend = [&](int axis) {
      const float above = top[axis] * (1.0F - u) + top[axis + 2] * u;
      const float below = bottom[axis] * (1.0F - u) + bottom[axis + 2] * u;
      return above * (1.0F - v) + below * v;
    };
    return blend(0) * static_cast<float>(direction.x) + blend(1) * static_cast<float>(direction.y);
  }
};

}  // namespace ruledgraph
