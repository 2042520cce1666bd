# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
#
# find_package(ruledgraph [COMPONENTS core gtsam]), core by default:
#   ruledgraph::core   the headers that need Eigen alone
#   ruledgraph::gtsam  all headers, with the GTSAM that is found and the Eigen that it was built with
include(CMakeFindDependencyMacro)

# In a clone and in the Python package the headers lie beside this folder.
set(ruledgraph_INCLUDE_DIR "${CMAKE_CURRENT_LIST_DIR}/../include")
if(NOT EXISTS "${ruledgraph_INCLUDE_DIR}/ruledgraph")
  set(ruledgraph_INCLUDE_DIR "${CMAKE_CURRENT_LIST_DIR}/../../../include")
endif()
get_filename_component(ruledgraph_INCLUDE_DIR "${ruledgraph_INCLUDE_DIR}" ABSOLUTE)

if(NOT ruledgraph_FIND_COMPONENTS)
  set(ruledgraph_FIND_COMPONENTS core)
endif()
foreach(component IN LISTS ruledgraph_FIND_COMPONENTS)
  if(component STREQUAL "core")
    find_dependency(Eigen3)
    set(ruledgraph_needs Eigen3::Eigen)
  elseif(component STREQUAL "gtsam")
    find_dependency(GTSAM)
    set(ruledgraph_needs gtsam)
  else()
    set(ruledgraph_FOUND FALSE)
    set(ruledgraph_NOT_FOUND_MESSAGE "there is no component ${component}, only core and gtsam")
    return()
  endif()
  if(NOT TARGET ruledgraph::${component})
    add_library(ruledgraph::${component} INTERFACE IMPORTED)
    set_target_properties(
      ruledgraph::${component}
      PROPERTIES INTERFACE_INCLUDE_DIRECTORIES "${ruledgraph_INCLUDE_DIR}"
                 INTERFACE_LINK_LIBRARIES ${ruledgraph_needs}
                 INTERFACE_COMPILE_FEATURES cxx_std_17)
  endif()
endforeach()
