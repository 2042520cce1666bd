# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
#
# add_native_kernel(NAME SOURCE PACKAGE): the C++ extension module NAME of the Python package in the
# folder PACKAGE. It sees the headers beside this folder. Where no extension can be built (no C++
# compiler, no Python headers) this says so and succeeds: the packages then run on their numpy kernel.
include(CheckLanguage)

check_language(CXX)
if(CMAKE_CXX_COMPILER)
  enable_language(CXX)
  find_package(Python 3.10 COMPONENTS Interpreter Development.Module)
  if(NOT Python_Development.Module_FOUND)
    set(kernel_obstacle "the headers of this Python were not found (Debian, Ubuntu: python3-dev)")
  endif()
else()
  set(kernel_obstacle "no working C++ compiler was found")
endif()

if(DEFINED kernel_obstacle)
  message(WARNING "${PROJECT_NAME} is installed without its native kernel: ${kernel_obstacle}. "
                  "The numpy kernel computes the same, many times slower.")
  function(add_native_kernel)
  endfunction()
  return()
endif()

find_package(nanobind CONFIG REQUIRED)
# Eigen comes from a build requirement; its CMake files lie in a prefix inside site-packages.
execute_process(
  COMMAND "${Python_EXECUTABLE}" -c
    "from importlib.metadata import distribution as d; print(d('cmeel-eigen').locate_file('cmeel.prefix'))"
  OUTPUT_VARIABLE eigen_prefix OUTPUT_STRIP_TRAILING_WHITESPACE ERROR_QUIET)
find_package(Eigen3 3.4 CONFIG REQUIRED HINTS "${eigen_prefix}")
set(kernel_headers "${CMAKE_CURRENT_LIST_DIR}/../include")

function(add_native_kernel name source package)
  nanobind_add_module(${name} NB_STATIC NOMINSIZE ${source})
  target_include_directories(${name} PRIVATE "${kernel_headers}")
  target_link_libraries(${name} PRIVATE Eigen3::Eigen)
  target_compile_features(${name} PRIVATE cxx_std_17)
  # The same rounding on every processor: no fused multiply-add where the compiler would like one.
  target_compile_options(${name} PRIVATE -Wall -Wextra -ffp-contract=off)
  install(TARGETS ${name} LIBRARY DESTINATION ${package})
endfunction()
