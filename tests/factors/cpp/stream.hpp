// SPDX-FileCopyrightText: The ruledgraph developers
// SPDX-License-Identifier: BSD-3-Clause
//
// Numbers from standard input and to standard output, for tests that compare with Python. Matrices
// are row by row.
#pragma once

#include <cstdio>
#include <iostream>
#include <stdexcept>
#include <vector>

#include "ruledgraph/frame_motions.hpp"
#include "ruledgraph/observations.hpp"

namespace ruledgraph {

inline double read_number() {
  double number;
  if (!(std::cin >> number)) throw std::runtime_error("the numbers ended too early");
  return number;
}

inline std::size_t read_count() { return static_cast<std::size_t>(read_number()); }

template <int Rows, int Columns = 1>
Eigen::Matrix<double, Rows, Columns> read_fixed() {
  Eigen::Matrix<double, Rows, Columns> matrix;
  for (int i = 0; i < Rows; ++i) {
    for (int j = 0; j < Columns; ++j) matrix(i, j) = read_number();
  }
  return matrix;
}

/// Number of rows, then the rows.
inline Eigen::MatrixXd read_rows(Eigen::Index columns) {
  Eigen::MatrixXd matrix(static_cast<Eigen::Index>(read_count()), columns);
  for (Eigen::Index i = 0; i < matrix.rows(); ++i) {
    for (Eigen::Index j = 0; j < columns; ++j) matrix(i, j) = read_number();
  }
  return matrix;
}

inline Pose read_plain_pose() {
  const Matrix3 rotation = read_fixed<3, 3>();
  return {rotation, read_fixed<3>()};
}

inline LineChart read_chart() {
  const Pose anchor = read_plain_pose();
  const Matrix3 basis = read_fixed<3, 3>();
  return {anchor.rotation, anchor.position, basis, read_number()};
}

inline FrameMotions read_motions() {
  FrameMotions motions;
  motions.timed = read_number() != 0.0;
  motions.bias = read_fixed<6>();
  motions.frames.resize(read_count());
  for (FrameMotion& frame : motions.frames) {
    frame.elapsed = read_number();
    frame.preintegrated = read_fixed<6>();
    frame.bias_jacobian = read_fixed<6, 6>();
    if (motions.timed) frame.time_jacobian = read_fixed<6>();
  }
  return motions;
}

inline std::vector<PointRows> read_frames() {
  std::vector<PointRows> frames(read_count());
  for (PointRows& points : frames) points = read_rows(2);
  return frames;
}

template <typename Matrix>
void write(const Matrix& matrix) {
  for (Eigen::Index i = 0; i < matrix.rows(); ++i) {
    for (Eigen::Index j = 0; j < matrix.cols(); ++j) std::printf("%.17g ", matrix(i, j));
  }
  std::printf("\n");
}

inline void write(double number) { std::printf("%.17g\n", number); }

}  // namespace ruledgraph
