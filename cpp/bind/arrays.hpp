// Arrays in, plain structs out: what every binding file shares.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <Eigen/Core>
#include <cstdint>
#include <limits>
#include <utility>
#include <vector>

namespace nb = nanobind;

template <class T, class... Shape>
using In = nb::ndarray<const T, nb::numpy, nb::c_contig, nb::device::cpu, Shape...>;
template <class T>
using Out = nb::ndarray<nb::numpy, T, nb::c_contig>;
constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

template <class T>
Out<T> make_array(std::vector<T> values, std::initializer_list<std::size_t> shape) {
  auto* owned = new std::vector<T>(std::move(values));
  nb::capsule owner(owned, [](void* p) noexcept { delete static_cast<std::vector<T>*>(p); });
  return Out<T>(owned->data(), shape, owner);
}

template <class Derived>
Out<double> to_numpy(const Eigen::MatrixBase<Derived>& m) {
  std::vector<double> values(m.size());
  Eigen::Map<Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>>(values.data(), m.rows(),
                                                                                     m.cols()) = m;
  if (m.cols() == 1) return make_array(std::move(values), {static_cast<std::size_t>(m.rows())});
  return make_array(std::move(values),
                    {static_cast<std::size_t>(m.rows()), static_cast<std::size_t>(m.cols())});
}

void bind_solvers(nb::module_& m);
void bind_table(nb::module_& m);
void bind_estimate(nb::module_& m);
void bind_certificate(nb::module_& m);
void bind_noise(nb::module_& m);
void bind_places(nb::module_& m);
void bind_labels(nb::module_& m);
void bind_detection(nb::module_& m);
void bind_study(nb::module_& m);
void bind_igtl(nb::module_& m);
void bind_volumes(nb::module_& m);
void bind_plus(nb::module_& m);
