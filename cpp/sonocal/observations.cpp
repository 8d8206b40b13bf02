#include "sonocal/observations.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "sonocal/vectors.hpp"

namespace sonocal {

Transform Normalisation::to_normalised(const Transform& a) const {
  Transform out = a;
  out.scales = a.scales * (image_size / size);
  out.translation = (a.apply(image_centre) - centre) / size;
  return out;
}

Transform Normalisation::to_original(const Transform& a) const {
  Transform out = a;
  out.scales = a.scales * (size / image_size);
  out.translation = size * a.translation + centre - out.linear() * image_centre;
  return out;
}

namespace {

using Columns3 = PointLines::Columns3;
using Rows3 = Eigen::Map<const Eigen::Array<double, Eigen::Dynamic, 3, Eigen::RowMajor>>;

struct Pointers {
  const double *x, *y, *z;
  explicit Pointers(const Columns3& c) : x(c.col(0).data()), y(c.col(1).data()), z(c.col(2).data()) {}
};

// Root mean square distance from the mean of rows of three, the mean in `centre`; 1 where all coincide.
double centre_and_size(const Rows3& points, Vector3d& centre) {
  centre = points.colwise().mean().matrix();
  double sum = 0;
  for (Eigen::Index i = 0; i < points.rows(); ++i)
    sum += (points.row(i).matrix().transpose() - centre).squaredNorm();
  const double size = std::sqrt(sum / points.rows());
  return size > 0 ? size : 1;
}

// The transform and the columns, in registers: through pointers the compiler must expect them to change.
struct Rows {
  Rows(const Transform& a, const Columns3& points, const Columns3* normals, const PointLines::Column* offsets)
      : s(a.linear()),
        t(a.translation),
        x(points),
        n(normals[0]),
        m(normals[1]),
        o(offsets[0].data()),
        p(offsets[1].data()) {}
  Matrix3d s;
  Vector3d t;
  Pointers x, n, m;
  const double *o, *p;
};

// Squared distances of rows begin .. end - 1 to `out`: (n . y + o)^2 + (m . y + p)^2 with y = S x + t.
SONOCAL_WIDEST_VECTORS void squares_of(const Rows& rows, int begin, int end, double* __restrict out) {
  const double s00 = rows.s(0, 0), s01 = rows.s(0, 1), s02 = rows.s(0, 2), t0 = rows.t[0];
  const double s10 = rows.s(1, 0), s11 = rows.s(1, 1), s12 = rows.s(1, 2), t1 = rows.t[1];
  const double s20 = rows.s(2, 0), s21 = rows.s(2, 1), s22 = rows.s(2, 2), t2 = rows.t[2];
  const double* __restrict xx = rows.x.x + begin;
  const double* __restrict xy = rows.x.y + begin;
  const double* __restrict xz = rows.x.z + begin;
  const double* __restrict nx = rows.n.x + begin;
  const double* __restrict ny = rows.n.y + begin;
  const double* __restrict nz = rows.n.z + begin;
  const double* __restrict mx = rows.m.x + begin;
  const double* __restrict my = rows.m.y + begin;
  const double* __restrict mz = rows.m.z + begin;
  const double* __restrict o = rows.o + begin;
  const double* __restrict p = rows.p + begin;
#pragma omp simd
  for (int i = 0; i < end - begin; ++i) {
    const double y0 = s00 * xx[i] + s01 * xy[i] + s02 * xz[i] + t0;
    const double y1 = s10 * xx[i] + s11 * xy[i] + s12 * xz[i] + t1;
    const double y2 = s20 * xx[i] + s21 * xy[i] + s22 * xz[i] + t2;
    const double r = nx[i] * y0 + ny[i] * y1 + nz[i] * y2 + o[i];
    const double q = mx[i] * y0 + my[i] * y1 + mz[i] * y2 + p[i];
    out[i] = r * r + q * q;
  }
}

SONOCAL_WIDEST_VECTORS double sum_truncated(const double* values, int count, double limit) {
  double sum = 0;
#pragma omp simd reduction(+ : sum)
  for (int i = 0; i < count; ++i) sum += values[i] < limit ? values[i] : limit;
  return sum;
}

}  // namespace

PointLines::PointLines(const double* points, const double* segments, int count, int dimension)
    : dimension_(dimension), segments_(segments), points_(count, 3) {
  Normalisation& n = normalisation_;
  n.image_size = centre_and_size(Rows3(points, count, 3), n.image_centre);
  n.size = centre_and_size(Rows3(segments, 2 * count, 3), n.centre);
  for (int axis = 0; axis < 3; ++axis)
    points_.col(axis) = (Rows3(points, count, 3).col(axis) - n.image_centre[axis]) / n.image_size;
  for (int k = 0; k < kPlanes; ++k) {
    normals_[k].resize(count, 3);
    offsets_[k].resize(count);
  }
  for (int i = 0; i < count; ++i) {
    const Needle line = needle(i);
    Vector3d basis[kPlanes];
    perpendicular_basis(line.direction, basis[0], basis[1]);
    for (int k = 0; k < kPlanes; ++k) {
      normals_[k].row(i) = basis[k].array();
      offsets_[k][i] = -basis[k].dot(line.middle);
    }
  }
}

Needle PointLines::needle(int i) const {
  const Eigen::Map<const Vector3d> from(segments_ + 6 * i), to(segments_ + 6 * i + 3);
  const Vector3d along = to - from;
  const double length = along.norm();
  return {(0.5 * (from + to) - normalisation_.centre) / normalisation_.size, along / length,
          0.5 * length / normalisation_.size};
}

void PointLines::squared_distances(const Transform& a, Column& out) const {
  out.resize(size());
  squares_of(Rows(a, points_, normals_, offsets_), 0, size(), out.data());
}

double PointLines::truncated_sum(const Transform& a, double limit, double enough) const {
  constexpr int kBlock = 256;
  alignas(64) double squares[kBlock];
  const Rows rows(a, points_, normals_, offsets_);
  double sum = 0;
  for (int begin = 0; begin < size() && sum < enough; begin += kBlock) {
    const int end = std::min(begin + kBlock, size());
    squares_of(rows, begin, end, squares);
    sum += sum_truncated(squares, end - begin, limit);
  }
  return sum;
}

NormalEquations PointLines::geometric_cost(const Column& squares, double limit) const {
  NormalEquations equations(dimension_);
  Block block;
  std::fill_n(block.h, Block::kRows, 1.0);
  std::fill_n(&block.weight[0][0], 2 * Block::kRows, 1.0);
  for (int i = 0; i < size(); ++i) {
    if (!(squares[i] <= limit)) continue;
    const int to = block.count++;
    for (int axis = 0; axis < 3; ++axis) {
      block.x[axis][to] = points_(i, axis);
      for (int k = 0; k < kPlanes; ++k) block.normal[k][axis][to] = normals_[k](i, axis);
    }
    for (int k = 0; k < kPlanes; ++k) block.offset[k][to] = offsets_[k][i];
    if (block.count == Block::kRows) {
      equations.add(block);
      block.count = 0;
    }
  }
  if (block.count > 0) equations.add(block);
  return equations;
}

}  // namespace sonocal
