#include "sonocal/places/relaxed.hpp"

#include <Eigen/SVD>
#include <cmath>

namespace sonocal {
namespace {

// Of the greatest diagonal entry.
constexpr double kLeastPivot = 1e-14;
constexpr double kRidge = 1e-9;

// L L' in the lower triangle.
bool factorise(double (*h)[15], int size) {
  double greatest = 0;
  for (int i = 0; i < size; ++i) greatest = std::max(greatest, h[i][i]);
  for (int j = 0; j < size; ++j) {
    double pivot = h[j][j];
    for (int k = 0; k < j; ++k) pivot -= h[j][k] * h[j][k];
    if (!(pivot > kLeastPivot * greatest)) return false;
    h[j][j] = std::sqrt(pivot);
    const double inverse = 1 / h[j][j];
    for (int i = j + 1; i < size; ++i) {
      double sum = h[i][j];
      for (int k = 0; k < j; ++k) sum -= h[i][k] * h[j][k];
      h[i][j] = sum * inverse;
    }
  }
  return true;
}

void forward(const double (*h)[15], int size, double* b) {
  for (int i = 0; i < size; ++i) {
    for (int k = 0; k < i; ++k) b[i] -= h[i][k] * b[k];
    b[i] /= h[i][i];
  }
}

void backward(const double (*h)[15], int size, double* b) {
  for (int i = size; i-- > 0;) {
    for (int k = i + 1; k < size; ++k) b[i] -= h[k][i] * b[k];
    b[i] /= h[i][i];
  }
}

// The similarity nearest to columns of a linear map, of which a 2D image knows two.
Transform nearest(const double* columns, int dimension) {
  Matrix3d linear = Matrix3d::Zero();
  for (int c = 0; c < dimension; ++c) linear.col(c) = Eigen::Map<const Vector3d>(columns + 3 * c);
  if (dimension == 2)
    linear.col(2) = cross(linear.col(0), linear.col(1)).normalized() *
                    std::sqrt(linear.col(0).norm() * linear.col(1).norm());
  const Eigen::JacobiSVD<Matrix3d> svd(linear, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Transform a;
  Matrix3d sign = Matrix3d::Identity();
  sign(2, 2) = determinant(svd.matrixU() * svd.matrixV().transpose()) < 0 ? -1 : 1;
  a.rotation = svd.matrixU() * sign * svd.matrixV().transpose();
  const double scale = svd.singularValues().head(dimension).mean();
  a.scales.setConstant(scale > 0 ? scale : 1);
  return a;
}

}  // namespace

RelaxedSystem::RelaxedSystem(const PosedRows& rows, const int* chosen, int count)
    : rows_(rows), chosen_(chosen), count_(count) {}

int RelaxedSystem::equations(const Place& along) {
  const int dimension = rows_.dimension(), normals = along.normals(), size = 3 * dimension + 3 + normals;
  for (int i = 0; i < size; ++i) {
    std::fill_n(h_[i], i + 1, 0.0);
    g_[i] = 0;
  }
  c_ = 0;
  for (int j = 0; j < count_; ++j) {
    const PosedRow& row = rows_.row(chosen_[j]);
    for (int k = 0; k < normals; ++k) {
      const Vector3d n = row.rotation * along.axes.col(k);
      double a[15] = {};
      for (int axis = 0; axis < dimension; ++axis)
        for (int i = 0; i < 3; ++i) a[3 * axis + i] = n[i] * row.x[axis];
      for (int i = 0; i < 3; ++i) a[3 * dimension + i] = n[i];
      a[3 * dimension + 3 + k] = -1;
      const double right = n.dot(row.translation);
      c_ += right * right;
      for (int i = 0; i < size; ++i) {
        g_[i] += a[i] * right;
        for (int l = 0; l <= i; ++l) h_[i][l] += a[i] * a[l];
      }
    }
  }
  return size;
}

bool RelaxedSystem::cost(const Place& along, double* cost) {
  const int size = equations(along);
  // A few rows leave a linear map free where they hold a similarity: the least of those is as good a start as
  // any.
  for (int i = 0; i < size; ++i) h_[i][i] += kRidge;
  if (!factorise(h_, size)) return false;
  forward(h_, size, g_);
  *cost = c_;
  for (int i = 0; i < size; ++i) *cost -= g_[i] * g_[i];
  return true;
}

std::optional<Relaxed> RelaxedSystem::solve(const Place& along) {
  Relaxed found;
  if (!cost(along, &found.cost)) return std::nullopt;
  const int dimension = rows_.dimension();
  backward(h_, 3 * dimension + 3 + along.normals(), g_);
  found.answer.a = nearest(g_, dimension);
  found.answer.a.translation = Eigen::Map<const Vector3d>(g_ + 3 * dimension);
  Place place = along;
  place.base.setZero();
  for (int k = 0; k < place.normals(); ++k) place.base += g_[3 * dimension + 3 + k] * place.axes.col(k);
  found.answer.places = {place};
  return found;
}

}  // namespace sonocal
