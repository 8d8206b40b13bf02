#include "sonocal/observations.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

// The scoring loops are most of the time of a consensus: let the machine's widest vectors run them.
#if defined(__x86_64__) && defined(__gnu_linux__) && defined(__GNUC__) && !defined(__clang__) && \
    !defined(__SANITIZE_ADDRESS__)
#define SONOCAL_WIDEST_VECTORS __attribute__((target_clones("arch=x86-64-v4", "arch=x86-64-v3", "default")))
#else
#define SONOCAL_WIDEST_VECTORS
#endif

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

// Mean and root mean square distance from it (1 where all points coincide).
void centre_and_size(const Columns3& points, Vector3d& centre, double& size) {
  centre = points.colwise().mean().matrix();
  size = std::sqrt((points.rowwise() - centre.transpose().array()).square().rowwise().sum().mean());
  if (!(size > 0)) size = 1;
}

struct Pointers {
  const double *x, *y, *z;
  explicit Pointers(const Columns3& c) : x(c.col(0).data()), y(c.col(1).data()), z(c.col(2).data()) {}
};

// Residuals of plane k are linear in the point: n . (S x + t) + offset.
SONOCAL_WIDEST_VECTORS void add_squares(const double* s, const double* t, const Pointers& p,
                                        const Pointers& n, const double* offset, int begin, int end,
                                        double* out, bool first) {
  const double *px = p.x, *py = p.y, *pz = p.z, *nx = n.x, *ny = n.y, *nz = n.z;
#pragma GCC ivdep
  for (int i = begin; i < end; ++i) {
    const double y0 = s[0] * px[i] + s[3] * py[i] + s[6] * pz[i] + t[0];
    const double y1 = s[1] * px[i] + s[4] * py[i] + s[7] * pz[i] + t[1];
    const double y2 = s[2] * px[i] + s[5] * py[i] + s[8] * pz[i] + t[2];
    const double r = nx[i] * y0 + ny[i] * y1 + nz[i] * y2 + offset[i];
    out[i - begin] = (first ? 0.0 : out[i - begin]) + r * r;
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
    : dimension_(dimension), points_(count, 3), line_points_(count, 3), directions_(count, 3) {
  for (int k = 0; k < kPlanes; ++k) {
    normals_[k].resize(count, 3);
    offsets_[k].resize(count);
  }
  using Rows3 = Eigen::Map<const Eigen::Array<double, Eigen::Dynamic, 3, Eigen::RowMajor>>;
  using Rows6 = Eigen::Map<const Eigen::Array<double, Eigen::Dynamic, 6, Eigen::RowMajor>>;
  points_ = Rows3(points, count, 3);
  const Rows6 ends(segments, count, 6);
  line_points_ = 0.5 * (ends.leftCols<3>() + ends.rightCols<3>());
  Normalisation& n = normalisation_;
  centre_and_size(points_, n.image_centre, n.image_size);
  centre_and_size(line_points_, n.centre, n.size);
  points_ = (points_.rowwise() - n.image_centre.transpose().array()) / n.image_size;
  for (int i = 0; i < count; ++i) {
    const Vector3d direction = (ends.row(i).rightCols<3>() - ends.row(i).leftCols<3>()).matrix().normalized();
    const Vector3d middle = (line_points_.row(i).matrix() - n.centre.transpose()) / n.size;
    Vector3d n1, n2;
    perpendicular_basis(direction, n1, n2);
    directions_.row(i) = direction.array();
    line_points_.row(i) = (middle - direction * direction.dot(middle)).array();
    normals_[0].row(i) = n1.array();
    normals_[1].row(i) = n2.array();
    offsets_[0][i] = -n1.dot(middle);
    offsets_[1][i] = -n2.dot(middle);
  }
}

void PointLines::squared_distances(const Transform& a, Column& out) const {
  out.resize(size());
  const Matrix3d linear = a.linear();
  for (int k = 0; k < kPlanes; ++k)
    add_squares(linear.data(), a.translation.data(), Pointers(points_), Pointers(normals_[k]),
                offsets_[k].data(), 0, size(), out.data(), k == 0);
}

double PointLines::truncated_sum(const Transform& a, double limit, double enough) const {
  constexpr int kBlock = 256;
  alignas(64) double squares[kBlock];
  const Matrix3d linear = a.linear();
  double sum = 0;
  for (int begin = 0; begin < size() && sum < enough; begin += kBlock) {
    const int end = std::min(begin + kBlock, size());
    for (int k = 0; k < kPlanes; ++k)
      add_squares(linear.data(), a.translation.data(), Pointers(points_), Pointers(normals_[k]),
                  offsets_[k].data(), begin, end, squares, k == 0);
    sum += sum_truncated(squares, end - begin, limit);
  }
  return sum;
}

}  // namespace sonocal
