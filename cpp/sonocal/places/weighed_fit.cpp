#include "sonocal/places/weighed_fit.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

namespace sonocal {
namespace {

constexpr int kFitRounds = 60;
// Standard deviations.
constexpr double kFitAtRest = 1e-4;
// Residuals to spare, below which two levels are not told apart and only their common factor is: of 30 the
// region stated to hold a floor's place in 95 of 100 holds it in 92.
constexpr int kTellsApart = 60;
// Of what a level is expected to be, squared.
constexpr double kLeastLevel = 1e-4;

// Residuals of one instant: how the noise of each kind makes them vary together, per unit of its variance.
struct Group {
  Eigen::MatrixXd jacobian, px, mm;
  Eigen::VectorXd residual;
};

using Motion = Eigen::Matrix<double, 6, 1>;

Group group_of(const PosedRows& rows, const int* begin, const int* end, const Unknowns& unknowns,
               const PlacesAnswer& at, double rad_per_mm) {
  int m = 0;
  for (const int* i = begin; i != end; ++i) m += at.places[rows.row(*i).target].normals();
  Group g{Eigen::MatrixXd(m, unknowns.count), Eigen::MatrixXd::Zero(m, m), Eigen::MatrixXd(m, m),
          Eigen::VectorXd(m)};
  std::vector<double> jacobian(3 * unknowns.count);
  std::vector<Motion> of_probe, of_target;
  std::vector<int> body;
  const Eigen::MatrixXd columns = at.a.linear().leftCols(rows.dimension());
  int first = 0;
  for (const int* i = begin; i != end; ++i) {
    const PosedRow& row = rows.row(*i);
    const Place& place = at.places[row.target];
    const int normals = linearise(rows, unknowns, at, *i, g.residual.data() + first, jacobian.data());
    const Vector3d there = at.a.apply(row.x);
    const Vector3d y = rows.seen(at.a, at.lag, *i) + rows.target(row.target).origin;
    Eigen::MatrixXd across(normals, rows.dimension());
    for (int k = 0; k < normals; ++k) {
      const Vector3d n = place.axes.col(k), in_probe = row.rotation * n;
      g.jacobian.row(first + k) =
          Eigen::Map<const Eigen::RowVectorXd>(jacobian.data() + k * unknowns.count, unknowns.count);
      across.row(k) = in_probe.transpose() * columns;
      Motion probe, target;
      probe << in_probe, rad_per_mm * cross(there, in_probe);
      target << n, rad_per_mm * cross(y, n);
      of_probe.push_back(probe);
      of_target.push_back(target);
      body.push_back(rows.target(row.target).body);
    }
    g.px.block(first, first, normals, normals) = across * across.transpose();
    first += normals;
  }
  for (int a = 0; a < m; ++a)
    for (int b = 0; b < m; ++b) {
      g.mm(a, b) = of_probe[a].dot(of_probe[b]);
      if (body[a] >= 0 && body[a] == body[b]) g.mm(a, b) += of_target[a].dot(of_target[b]);
    }
  return g;
}

struct Equations {
  Eigen::MatrixXd h;
  Eigen::VectorXd g;
  double chi = 0;
  int residuals = 0;
};

void add_priors(const PosedRows& rows, const Unknowns& unknowns, const PlacesAnswer& at, Equations& to) {
  for (int k = 0; k < rows.targets(); ++k) {
    const PosedTarget& target = rows.target(k);
    if (unknowns.offset[k] < 0 || target.nothing_known()) continue;
    const Place &place = at.places[k], &prior = target.prior;
    const int normals = place.normals(), reaches = place.reaches();
    Eigen::VectorXd row = Eigen::VectorXd::Zero(unknowns.count);
    const auto add = [&](double residual, double sigma) {
      row /= sigma;
      to.h += row * row.transpose();
      to.g += row * (residual / sigma);
      to.chi += std::pow(residual / sigma, 2);
      ++to.residuals;
      row.setZero();
    };
    for (int n = 0; n < normals; ++n) {
      by_place(place, prior.base, n, row.data() + unknowns.offset[k]);
      add(place.axes.col(n).dot(prior.base - place.base), std::max(target.sigma, 1e-9));
      for (int r = 0; r < reaches; ++r) {
        const Vector3d along = prior.axes.col(normals + r);
        for (int q = 0; q < reaches; ++q)
          row[unknowns.offset[k] + normals + n * reaches + q] = place.axes.col(normals + q).dot(along);
        add(place.axes.col(n).dot(along), std::max(target.sigma_rad, 1e-9));
      }
    }
  }
}

// How far each level is from what the residuals say (restricted maximum likelihood): its factor.
struct LevelSums {
  double seen[2] = {0, 0}, expected[2] = {0, 0};
  Eigen::MatrixXd by[2];
};

Equations equations(const PosedRows& rows, const std::vector<int>& chosen, const Unknowns& unknowns,
                    double rad_per_mm, PlaceLevels levels, const PlacesAnswer& at, LevelSums* sums) {
  Equations out{Eigen::MatrixXd::Zero(unknowns.count, unknowns.count), Eigen::VectorXd::Zero(unknowns.count)};
  if (sums)
    for (auto& by : sums->by) by.setZero(unknowns.count, unknowns.count);
  for (std::size_t begin = 0, end; begin < chosen.size(); begin = end) {
    for (end = begin; end < chosen.size() && rows.row(chosen[end]).group == rows.row(chosen[begin]).group;)
      ++end;
    Group g = group_of(rows, &chosen[begin], chosen.data() + end, unknowns, at, rad_per_mm);
    const Eigen::MatrixXd variance = levels.px * g.px + levels.mm * g.mm;
    const Eigen::LLT<Eigen::MatrixXd> llt(variance);
    llt.matrixL().solveInPlace(g.jacobian);
    llt.matrixL().solveInPlace(g.residual);
    out.h.noalias() += g.jacobian.transpose() * g.jacobian;
    out.g.noalias() += g.jacobian.transpose() * g.residual;
    out.chi += g.residual.squaredNorm();
    out.residuals += static_cast<int>(g.residual.size());
    if (!sums) continue;
    for (int kind = 0; kind < 2; ++kind) {
      Eigen::MatrixXd white = llt.matrixL().solve(kind == 0 ? g.px : g.mm);
      white = llt.matrixL().solve(Eigen::MatrixXd(white.transpose()));
      sums->seen[kind] += g.residual.dot(white * g.residual);
      sums->expected[kind] += white.trace();
      sums->by[kind].noalias() += g.jacobian.transpose() * (white * g.jacobian);
    }
  }
  add_priors(rows, unknowns, at, out);
  return out;
}

double factor(double seen, double expected) {
  return std::clamp(seen / std::max(expected, 1e-300), 1e-4, 1e4);
}

// The levels that the residuals at an answer say, from those that they were weighed by.
PlaceLevels levels_after(const Equations& now, LevelSums& sums,
                         const Eigen::LLT<Eigen::MatrixXd>& information, const PlacesNoise& noise,
                         PlaceLevels levels, int unknowns) {
  const int spare = now.residuals - unknowns;
  if (spare <= 0) return noise.expected;
  if (spare < kTellsApart) {
    const double both = factor(now.chi, spare);
    return {levels.px * both, levels.mm * both};
  }
  for (int kind = 0; kind < 2; ++kind) sums.expected[kind] -= information.solve(sums.by[kind]).trace();
  return {std::max(levels.px * factor(sums.seen[0], sums.expected[0]), kLeastLevel * noise.expected.px),
          std::max(levels.mm * factor(sums.seen[1], sums.expected[1]), kLeastLevel * noise.expected.mm)};
}

}  // namespace

PlacesFit fit_places(const PosedRows& rows, const std::vector<int>& chosen, const Unknowns& unknowns,
                     const PlacesNoise& noise, const PlacesAnswer& start) {
  PlacesFit fit{start, noise.expected, {}, {}};
  double damping = 1e-6, before = 1e300;
  PlacesAnswer last = start;
  for (int round = 0; round < kFitRounds; ++round) {
    LevelSums sums;
    Equations now = equations(rows, chosen, unknowns, noise.rad_per_mm, fit.levels, fit.answer,
                              noise.estimated ? &sums : nullptr);
    if (now.chi > before * (1 + 1e-9) && damping < 1e6) {  // the step was too long
      fit.answer = last;
      damping *= 30;
      before = 1e300;
      continue;
    }
    Eigen::MatrixXd damped = now.h;
    damped.diagonal() *= 1 + damping;
    const Eigen::LLT<Eigen::MatrixXd> llt(damped);
    const Eigen::VectorXd step = -llt.solve(now.g);
    fit.rest = std::sqrt(std::max(-step.dot(now.g), 0.0));
    const PlaceLevels levels =
        noise.estimated ? levels_after(now, sums, llt, noise, fit.levels, unknowns.count) : fit.levels;
    const bool settled = std::abs(std::log(levels.px / fit.levels.px)) < 1e-3 &&
                         std::abs(std::log(levels.mm / fit.levels.mm)) < 1e-3;
    last = fit.answer;
    fit.answer = moved(rows, unknowns, fit.answer, step.data());
    before = settled ? now.chi : 1e300;
    damping = std::max(damping * 0.1, 1e-12);
    if (fit.rest < 1e3 * kFitAtRest) fit.levels = levels;
    if (fit.rest < kFitAtRest && settled) break;
  }
  const auto covariance = [&](PlaceLevels levels, double* spare) {
    const Equations at = equations(rows, chosen, unknowns, noise.rad_per_mm, levels, fit.answer, nullptr);
    if (spare) *spare = at.residuals - unknowns.count;
    return Eigen::MatrixXd(at.h.llt().solve(Eigen::MatrixXd::Identity(unknowns.count, unknowns.count)));
  };
  fit.covariance = covariance(fit.levels, &fit.freedom);
  fit.nominal = covariance(
      {std::max(fit.levels.px, noise.expected.px), std::max(fit.levels.mm, noise.expected.mm)}, nullptr);
  return fit;
}

Eigen::MatrixXd information(const PosedRows& rows, const std::vector<int>& chosen, const Unknowns& unknowns,
                            PlaceLevels levels, double rad_per_mm, const PlacesAnswer& at) {
  return equations(rows, chosen, unknowns, rad_per_mm, levels, at, nullptr).h;
}

std::vector<double> chi_squared(const PosedRows& rows, const PlacesAnswer& at, PlaceLevels levels,
                                double rad_per_mm) {
  const Unknowns none(rows, 1, false);
  std::vector<double> out;
  for (int i = 0; i < rows.size(); ++i) {
    const Group g = group_of(rows, &i, &i + 1, none, at, rad_per_mm);
    const Eigen::MatrixXd variance = levels.px * g.px + levels.mm * g.mm;
    out.push_back(g.residual.dot(variance.llt().solve(g.residual)));
  }
  return out;
}

}  // namespace sonocal
