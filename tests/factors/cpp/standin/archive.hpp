// SPDX-FileCopyrightText: The ruledgraph developers
// SPDX-License-Identifier: BSD-3-Clause
//
// A stand-in, written for the tests, of what ruledgraph's headers use of Boost's serialisation:
// archives of numbers, without versions or pointers.
#pragma once

#include <Eigen/Core>
#include <iomanip>
#include <istream>
#include <ostream>
#include <type_traits>
#include <vector>

#define BOOST_CLASS_EXPORT_GUID(Class, name) static_assert(true, name)

namespace boost {

namespace serialization {

class access {
 public:
  template <class Archive, typename T>
  static auto member(Archive& archive, T& object, int)
      -> decltype(object.serialize(archive, 0u), void()) {
    object.serialize(archive, 0u);
  }
  template <class Archive, typename T>
  static void member(Archive& archive, T& object, long) {
    serialize(archive, object, 0u);
  }
};

template <typename T>
T& make_nvp(const char*, T& object) {
  return object;
}

template <class Base, class Derived>
Base& base_object(Derived& object) {
  return object;
}

}  // namespace serialization

namespace archive {

template <bool Loading>
class Archive {
 public:
  using is_loading = std::bool_constant<Loading>;
  using Stream = std::conditional_t<Loading, std::istream, std::ostream>;

  explicit Archive(Stream& stream) : stream_(stream) {}

  template <typename T>
  Archive& operator&(T& object) {
    if constexpr (std::is_arithmetic_v<T>) {
      if constexpr (Loading) {
        stream_ >> object;
      } else {
        stream_ << std::setprecision(17) << object << " ";
      }
    } else {
      serialization::access::member(*this, object, 0);
    }
    return *this;
  }
  template <typename T>
  Archive& operator&(std::vector<T>& items) {
    std::size_t size = items.size();
    *this& size;
    items.resize(size);
    for (T& item : items) *this& item;
    return *this;
  }
  template <int Rows, int Columns>
  Archive& operator&(Eigen::Matrix<double, Rows, Columns>& matrix) {
    Eigen::Index rows = matrix.rows(), columns = matrix.cols();
    *this & rows & columns;
    matrix.resize(rows, columns);
    for (Eigen::Index i = 0; i < matrix.size(); ++i) *this& matrix.data()[i];
    return *this;
  }
  template <typename T>
  Archive& operator<<(const T& object) {
    return *this & const_cast<T&>(object);
  }
  template <typename T>
  Archive& operator>>(T& object) {
    return *this & object;
  }

 private:
  Stream& stream_;
};

using text_oarchive = Archive<false>;
using text_iarchive = Archive<true>;

}  // namespace archive

}  // namespace boost
