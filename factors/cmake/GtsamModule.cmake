# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
#
# The extension module ruledgraph_factors._gtsam: the C++ factors for the Python module of the GTSAM
# that GTSAM_DIR or CMAKE_PREFIX_PATH names. It must be the one that this Python imports.
enable_language(CXX)
find_package(Python 3.10 REQUIRED COMPONENTS Interpreter Development.Module)
find_package(GTSAM CONFIG REQUIRED)
# GTSAM installs the pybind11 that its own module was built with.
find_path(pybind11_headers pybind11/pybind11.h REQUIRED NO_DEFAULT_PATH
          HINTS "${GTSAM_DIR}/../../gtwrap/pybind11/include")

Python_add_library(_gtsam MODULE WITH_SOABI src/gtsam_module.cpp)
target_include_directories(_gtsam PRIVATE include)
target_include_directories(_gtsam SYSTEM PRIVATE "${pybind11_headers}")
target_link_libraries(_gtsam PRIVATE gtsam)
target_compile_features(_gtsam PRIVATE cxx_std_17)
# As the native kernel: the same rounding on every processor.
target_compile_options(_gtsam PRIVATE -Wall -Wextra -ffp-contract=off)
set_target_properties(
  _gtsam PROPERTIES CXX_VISIBILITY_PRESET hidden INSTALL_RPATH_USE_LINK_PATH TRUE)
install(TARGETS _gtsam LIBRARY DESTINATION ruledgraph_factors)
