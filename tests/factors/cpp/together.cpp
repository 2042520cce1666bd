// SPDX-FileCopyrightText: The ruledgraph developers
// SPDX-License-Identifier: BSD-3-Clause
//
// Both test programs and both examples in one piece, which compiles in less than half the time:
// most of it goes into Eigen's templates, which they share. The core comes first, to compile before
// anything of GTSAM. The examples are compiled only: the stand-in has no solvers to link. With the
// argument `core` it is `core_test`, otherwise `factor_test`.

#define main core_test_main
#include "core_test.cpp"
#undef main
// Inline, or they would be kept.
#define main static inline line_in_graph_main
#include "../../../factors/examples/line_in_graph.cpp"
#undef main
#define main static inline vio_main
#include "../../../factors/examples/vio.cpp"
#undef main
#define main factor_test_main
#include "factor_test.cpp"
#undef main

#include <string_view>

int main(int count, char** arguments) {
  const bool core = count > 1 && std::string_view(arguments[1]) == "core";
  return core ? core_test_main(count - 1, arguments + 1) : factor_test_main();
}
