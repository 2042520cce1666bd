// SPDX-FileCopyrightText: The ruledgraph developers
// SPDX-License-Identifier: BSD-3-Clause
//
// A factor written to an archive and read back, where GTSAM has serialisation.
#pragma once

#include "ruledgraph/gtsam/line_factors.hpp"
#include "ruledgraph/gtsam/ruled_surface_factor.hpp"

#ifdef RULEDGRAPH_SERIALIZATION

#include <boost/archive/text_iarchive.hpp>
#include <boost/archive/text_oarchive.hpp>
#include <boost/serialization/export.hpp>
#include <sstream>

BOOST_CLASS_EXPORT_GUID(gtsam::noiseModel::Unit, "gtsam_noiseModel_Unit");

template <typename Factor>
bool survives_an_archive(const gtsam::NonlinearFactor& factor) {
  const auto* original = dynamic_cast<const Factor*>(&factor);
  if (original == nullptr) return false;
  std::stringstream text;
  {
    boost::archive::text_oarchive out(text);
    out << *original;
  }
  Factor copy;
  boost::archive::text_iarchive in(text);
  in >> copy;
  return copy.equals(*original, 1e-12);
}

inline bool survives_an_archive(const gtsam::NonlinearFactor& factor) {
  using namespace ruledgraph;
  return survives_an_archive<RuledSurfaceFactor>(factor) ||
         survives_an_archive<RuledSurfacePoseFactor>(factor) ||
         survives_an_archive<NewLineFactor>(factor) ||
         survives_an_archive<LineDistanceFactor>(factor) ||
         survives_an_archive<SameLineFactor>(factor);
}

#else

inline bool survives_an_archive(const gtsam::NonlinearFactor&) { return true; }

#endif
