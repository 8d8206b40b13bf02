#include "sonocal/places/noise_growth.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <cmath>
#include <map>

#include "sonocal/robust/random.hpp"

namespace sonocal {
namespace {

constexpr int kDraws = 6;

// Normal deviates (Box and Muller).
class Normal {
 public:
  explicit Normal(std::uint64_t seed) : random_(seed) {}
  double operator()() {
    const double u = uniform(), v = uniform();
    return std::sqrt(-2 * std::log(u)) * std::cos(2 * M_PI * v);
  }
  Vector3d vector() { return {(*this)(), (*this)(), (*this)()}; }

 private:
  double uniform() { return (static_cast<double>(random_.next() >> 11) + 0.5) / 9007199254740992.0; }
  Random random_;
};

// A marker's error: a turn and a shift.
struct Shake {
  Matrix3d turn = Matrix3d::Identity();
  Vector3d shift = Vector3d::Zero();
};
Shake shake(Normal& normal, double mm, double rad_per_mm) {
  return {rotation_by(mm * rad_per_mm * normal.vector()), mm * normal.vector()};
}

}  // namespace

NoiseGrowth noise_growth(const PosedRows& rows, const std::vector<int>& chosen, const Unknowns& unknowns,
                         PlaceLevels levels, double rad_per_mm, const PlacesAnswer& at, std::uint64_t seed) {
  Normal normal(seed);
  const double px = std::sqrt(levels.px), mm = std::sqrt(levels.mm);
  const Eigen::MatrixXd known = information(rows, chosen, unknowns, levels, rad_per_mm, at);
  Eigen::MatrixXd shaken = Eigen::MatrixXd::Zero(known.rows(), known.cols());
  for (int draw = 0; draw < kDraws; ++draw) {
    PosedRows noisy = rows;
    std::map<int, Shake> of_probe;
    std::map<std::pair<int, int>, Shake> of_body;
    for (int i = 0; i < rows.size(); ++i) {
      PosedRow& row = noisy.row(i);
      for (int axis = 0; axis < rows.dimension(); ++axis) row.x[axis] += px * normal();
      if (!of_probe.count(row.group)) of_probe[row.group] = shake(normal, mm, rad_per_mm);
      const Shake& probe = of_probe[row.group];
      row.rotation = probe.turn * row.rotation;
      row.translation = probe.turn * row.translation + probe.shift;
      const int body = rows.target(row.target).body;
      if (body < 0) continue;
      const std::pair<int, int> key(body, row.group);
      if (!of_body.count(key)) of_body[key] = shake(normal, mm, rad_per_mm);
      const Shake& marker = of_body[key];
      // About the marker, which the rows' coordinates are not about.
      const Vector3d origin = rows.target(row.target).origin;
      const Vector3d shift = marker.turn * origin + marker.shift - origin;
      row.translation += row.rotation * shift;
      row.rotation = row.rotation * marker.turn;
    }
    shaken += information(noisy, chosen, unknowns, levels, rad_per_mm, at) / kDraws;
  }
  const Eigen::GeneralizedSelfAdjointEigenSolver<Eigen::MatrixXd> eigen(shaken, known);
  const Eigen::Index last = known.rows() - 1;
  return {eigen.eigenvalues()[last], eigen.eigenvectors().col(last)};
}

}  // namespace sonocal
