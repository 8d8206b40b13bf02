#include "sonocal/places/descend.hpp"

#include <Eigen/Cholesky>
#include <cmath>
#include <limits>

namespace sonocal {
namespace {

struct Quadratic {
  Eigen::MatrixXd h;
  Eigen::VectorXd g;
  double cost = 0;
};

double rho(double square, double scale) { return square / (1 + square / (scale * scale)); }

double cost_of(const PosedRows& rows, const int* chosen, int count, double scale, const PlacesAnswer& at) {
  double sum = 0;
  for (int j = 0; j < count; ++j) sum += rho(rows.square(at, chosen[j]), scale);
  return sum;
}

void add(const PosedRows& rows, const Unknowns& unknowns, const PlacesAnswer& at, int i, double scale,
         double* j, Quadratic& q) {
  double e[3];
  const int normals = linearise(rows, unknowns, at, i, e, j), p = unknowns.count;
  double square = 0;
  for (int k = 0; k < normals; ++k) square += e[k] * e[k];
  const double part = 1 / (1 + square / (scale * scale)), weight = part * part;
  q.cost += square * part;
  for (int k = 0; k < normals; ++k) {
    const double* row = j + k * p;
    for (int a = 0; a < p; ++a) {
      if (row[a] == 0) continue;
      const double wa = weight * row[a];
      q.g[a] += wa * e[k];
      double* column = q.h.data() + a * p;
      for (int b = a; b < p; ++b) column[b] += wa * row[b];
    }
  }
}

}  // namespace

double descend(const PosedRows& rows, const int* chosen, int count, const Unknowns& unknowns,
               const Descent& how, PlacesAnswer& at) {
  const int p = unknowns.count;
  std::vector<double> jacobian(3 * p);
  Quadratic q;
  double damping = 1e-4, cost = std::numeric_limits<double>::infinity();
  bool anew = true;
  for (int iteration = 0; iteration < how.iterations; ++iteration) {
    if (anew) {
      q.h.setZero(p, p);
      q.g.setZero(p);
      q.cost = 0;
      for (int j = 0; j < count; ++j) add(rows, unknowns, at, chosen[j], how.scale, jacobian.data(), q);
      cost = q.cost;
    }
    Eigen::MatrixXd damped = q.h;
    for (int a = 0; a < p; ++a) damped(a, a) += damping * q.h(a, a) + 1e-14;
    const Eigen::LLT<Eigen::MatrixXd> llt(damped);
    if (llt.info() != Eigen::Success) {
      damping *= 10;
      anew = false;
      continue;
    }
    const Eigen::VectorXd step = -llt.solve(q.g);
    const PlacesAnswer next = moved(rows, unknowns, at, step.data());
    const double now = cost_of(rows, chosen, count, how.scale, next);
    anew = now < cost;
    if (!anew) {
      if ((damping *= 8) > 1e8) break;
      continue;
    }
    const bool rest = cost - now <= how.tolerance * cost;
    at = next;
    cost = now;
    damping = std::max(damping * 0.1, 1e-12);
    if (rest) break;
  }
  return cost;
}

}  // namespace sonocal
