#include "sonocal/estimate/point_lines.hpp"

#include <algorithm>
#include <cmath>

#include "sonocal/linalg/vectors.hpp"

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

// Root mean square distance from the mean of rows of three, the mean in `centre`; 1 where all coincide.
double centre_and_size(const Rows3& points, Vector3d& centre) {
  centre = points.colwise().mean().matrix();
  double sum = 0;
  for (Eigen::Index i = 0; i < points.rows(); ++i)
    sum += (points.row(i).matrix().transpose() - centre).squaredNorm();
  const double size = std::sqrt(sum / points.rows());
  return size > 0 ? size : 1;
}

// The transform and the columns as plain numbers and pointers: a local copy stays in registers.
struct Rows {
  Rows(const Transform& a, const Columns3& points, const Columns3* normals, const PointLines::Column* offsets)
      : o(offsets[0].data()), p(offsets[1].data()) {
    const Matrix3d linear = a.linear();
    for (int i = 0; i < 3; ++i) {
      for (int j = 0; j < 3; ++j) s[i][j] = linear(i, j);
      t[i] = a.translation[i];
      x[i] = points.col(i).data();
      n[i] = normals[0].col(i).data();
      m[i] = normals[1].col(i).data();
    }
  }

  // Squared distance of row i: (n . y + o)^2 + (m . y + p)^2 with y = S x + t.
  [[gnu::always_inline]] inline double square(int i) const {
    const double x0 = x[0][i], x1 = x[1][i], x2 = x[2][i];
    const double y0 = s[0][0] * x0 + s[0][1] * x1 + s[0][2] * x2 + t[0];
    const double y1 = s[1][0] * x0 + s[1][1] * x1 + s[1][2] * x2 + t[1];
    const double y2 = s[2][0] * x0 + s[2][1] * x1 + s[2][2] * x2 + t[2];
    const double r = n[0][i] * y0 + n[1][i] * y1 + n[2][i] * y2 + o[i];
    const double q = m[0][i] * y0 + m[1][i] * y1 + m[2][i] * y2 + p[i];
    return r * r + q * q;
  }

  double s[3][3], t[3];
  const double *x[3], *n[3], *m[3];
  const double *o, *p;
};

SONOCAL_WIDEST_VECTORS void squares_of(const Rows& given, int count, double* __restrict out) {
  const Rows rows = given;
#pragma omp simd
  for (int i = 0; i < count; ++i) out[i] = rows.square(i);
}

// Block by block, given up once it reaches `enough`: most transforms that are tried are bad and show it soon.
SONOCAL_WIDEST_VECTORS double sum_truncated(const Rows& given, int count, double limit, double enough) {
  const Rows rows = given;
  double sum = 0;
  for (int begin = 0; begin < count && sum < enough; begin += PointLines::kPadding) {
    double block = 0;
#pragma omp simd reduction(+ : block)
    for (int i = begin; i < begin + PointLines::kPadding; ++i) {
      const double square = rows.square(i);
      block += square < limit ? square : limit;
    }
    sum += block;
  }
  return sum;
}

int padded(int count) {
  return (count + PointLines::kPadding - 1) / PointLines::kPadding * PointLines::kPadding;
}

}  // namespace

PointLines::PointLines(const double* points, const double* segments, int count, int dimension)
    : size_(count),
      dimension_(dimension),
      points_(Columns3::Zero(padded(count), 3)),
      normals_{Columns3::Zero(padded(count), 3), Columns3::Zero(padded(count), 3)},
      offsets_{Column::Zero(padded(count)), Column::Zero(padded(count))},
      middles_(count),
      half_lengths_(count) {
  Normalisation& n = normalisation_;
  n.image_size = centre_and_size(Rows3(points, count, 3), n.image_centre);
  n.size = centre_and_size(Rows3(segments, 2 * count, 3), n.centre);
  for (int axis = 0; axis < 3; ++axis)
    points_.col(axis).head(count) = (Rows3(points, count, 3).col(axis) - n.image_centre[axis]) / n.image_size;
  for (int i = 0; i < count; ++i) {
    const Eigen::Map<const Vector3d> from(segments + 6 * i), to(segments + 6 * i + 3);
    const Vector3d along = to - from, middle = (0.5 * (from + to) - n.centre) / n.size;
    const double length = along.norm();
    const Vector3d direction = along / length;
    Vector3d basis[kPlanes];
    perpendicular_basis(direction, basis[0], basis[1]);
    for (int k = 0; k < kPlanes; ++k) {
      normals_[k].row(i) = basis[k].array();
      offsets_[k][i] = -basis[k].dot(middle);
    }
    middles_[i] = direction.dot(middle);
    half_lengths_[i] = 0.5 * length / n.size;
  }
}

void PointLines::squared_distances(const Transform& a, Column& out) const {
  out.resize(size());
  squares_of(Rows(a, points_, normals_, offsets_), size(), out.data());
}

double PointLines::truncated_sum(const Transform& a, double limit, double enough) const {
  return sum_truncated(Rows(a, points_, normals_, offsets_), padded(size()), limit, enough);
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
