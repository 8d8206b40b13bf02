#include "sonocal/estimate/noise_model.hpp"

#include <algorithm>
#include <cmath>

#include "sonocal/linalg/small.hpp"
#include "sonocal/linalg/vectors.hpp"

namespace sonocal {
namespace {

// Sightings further off than this many standard deviations count less (Huber): 1 in 3000 of sound ones.
constexpr double kHuber = 4.0;
constexpr int kRows = Block::kRows;

// What a block's rows need beside the block: where their needles are, and the factors of their noise.
struct Places {
  alignas(64) double middle[kRows], half_length[kRows], px[kRows], mm[kRows];
};

// A transform and two levels as plain numbers: a local copy stays in registers.
struct Mapping {
  Mapping(const Transform& at, Variances levels) : a(levels.px), b(levels.mm) {
    const Matrix3d linear = at.linear();
    for (int i = 0; i < 3; ++i) {
      for (int j = 0; j < 3; ++j) s[i][j] = linear(i, j);
      t[i] = at.translation[i];
    }
    squared_scale = at.scales[0] * at.scales[0];
  }
  double s[3][3], t[3], a, b, squared_scale;
};

// Eigenvalues and the greater one's eigenvector (c, s) of the symmetric 2 x 2 matrix ((p, q), (q, r)) with
// the determinant det, which its entries may no longer tell.
struct Eigen2 {
  double most, least, c, s;
};
[[gnu::always_inline]] inline Eigen2 eigen_of(double p, double q, double r, double det) {
  const double half = 0.5 * (p - r), radius = std::sqrt(half * half + q * q);
  const double most = 0.5 * (p + r) + radius;
  const bool round = !(radius > 1e-150);
  const double inverse = 1.0 / (round ? 1.0 : radius);
  // cos^2 and sin^2 of the angle, the greater of them first.
  const double greater = std::sqrt(0.5 + 0.5 * std::abs(half) * inverse);
  const double lesser = 0.5 * q * inverse / greater;
  const double c = half < 0 ? lesser : greater, s = half < 0 ? greater : lesser;
  return {most, most > 0 ? det / most : 0.0, round ? 1.0 : c, round ? 0.0 : s};
}

// residual = n . (S x + h t) + h o, and its weight.
[[gnu::always_inline]] inline void weigh(const Mapping& m, int k, int i, IndependentBlock& block) {
  const double x = block.x[0][i], y = block.x[1][i], z = block.x[2][i], h = block.h[i];
  double sum = h * block.offset[k][i];
  for (int axis = 0; axis < 3; ++axis)
    sum +=
        block.normal[k][axis][i] * (m.s[axis][0] * x + m.s[axis][1] * y + m.s[axis][2] * z + h * m.t[axis]);
  block.residual[k][i] = sum;
  block.weight[k][i] = 1.0 / (m.a * block.alpha[k][i] + m.b * block.beta[k][i]);
}

[[gnu::always_inline]] inline double squared_distance(const IndependentBlock& block, int i) {
  return block.residual[0][i] * block.residual[0][i] * block.weight[0][i] +
         block.residual[1][i] * block.residual[1][i] * block.weight[1][i];
}

[[gnu::always_inline]] inline double huber_of(double squared, int rows) {
  const double limit = kHuber * kHuber * rows;
  return std::sqrt(limit / std::max(squared, limit));
}

// Squared residual over squared variance: half the derivative of r^2 / v by v, but for the sign.
[[gnu::always_inline]] inline double strain(const IndependentBlock& block, int k, int i) {
  const double scaled = block.residual[k][i] * block.weight[k][i];
  return 0.5 * block.huber[i] * scaled * scaled;
}

SONOCAL_WIDEST_VECTORS void weigh_alike(const Mapping& given, IndependentBlock& block) {
  const Mapping m = given;
#pragma omp simd
  for (int i = 0; i < block.count; ++i)
    for (int k = 0; k < 2; ++k) {
      block.alpha[k][i] = 0;
      block.beta[k][i] = 1;
      weigh(m, k, i, block);
      block.huber[i] = 1;
    }
}

// Points of a 2D probe: the planes turn to where the pixel noise across the needle is greatest and least.
//
// With z = V^-1 r, across the needle, half the derivative of r' V^-1 r through V = a N'SS'N + b beta I is
//     -a (z . s_c) z by a column s_c of S,    -b |z|^2 tau / (2 half length) by the place along the needle.
template <bool kPulls>
SONOCAL_WIDEST_VECTORS void weigh_across(const Mapping& given, const Places& places,
                                         IndependentBlock& block) {
  const Mapping m = given;
  const int count = block.count;
  double p0 = 0, p1 = 0, p2 = 0, q0 = 0, q1 = 0, q2 = 0;
#pragma omp simd reduction(+ : p0, p1, p2, q0, q1, q2)
  for (int i = 0; i < count; ++i) {
    const double x = block.x[0][i], y = block.x[1][i], z = block.x[2][i];
    const double n0 = block.normal[0][0][i], n1 = block.normal[0][1][i], n2 = block.normal[0][2][i];
    const double m0 = block.normal[1][0][i], m1 = block.normal[1][1][i], m2 = block.normal[1][2][i];
    const double y0 = m.s[0][0] * x + m.s[0][1] * y + m.s[0][2] * z + m.t[0];
    const double y1 = m.s[1][0] * x + m.s[1][1] * y + m.s[1][2] * z + m.t[1];
    const double y2 = m.s[2][0] * x + m.s[2][1] * y + m.s[2][2] * z + m.t[2];
    const double d0 = n1 * m2 - n2 * m1, d1 = n2 * m0 - n0 * m2, d2 = n0 * m1 - n1 * m0;
    const double tau = (d0 * y0 + d1 * y1 + d2 * y2 - places.middle[i]) / places.half_length[i];
    // N' c1 and N' c2: what a pixel along u, and along v, is across the needle.
    const double u0 = n0 * m.s[0][0] + n1 * m.s[1][0] + n2 * m.s[2][0];
    const double u1 = m0 * m.s[0][0] + m1 * m.s[1][0] + m2 * m.s[2][0];
    const double v0 = n0 * m.s[0][1] + n1 * m.s[1][1] + n2 * m.s[2][1];
    const double v1 = m0 * m.s[0][1] + m1 * m.s[1][1] + m2 * m.s[2][1];
    const double volume = u0 * v1 - u1 * v0;
    const Eigen2 e = eigen_of(u0 * u0 + v0 * v0, u0 * u1 + v0 * v1, u1 * u1 + v1 * v1, volume * volume);
    block.normal[0][0][i] = e.c * m0 - e.s * n0;
    block.normal[0][1][i] = e.c * m1 - e.s * n1;
    block.normal[0][2][i] = e.c * m2 - e.s * n2;
    block.normal[1][0][i] = e.c * n0 + e.s * m0;
    block.normal[1][1][i] = e.c * n1 + e.s * m1;
    block.normal[1][2][i] = e.c * n2 + e.s * m2;
    const double o = block.offset[0][i], p = block.offset[1][i];
    block.offset[0][i] = e.c * p - e.s * o;
    block.offset[1][i] = e.c * o + e.s * p;
    const double fp = places.px[i] * places.px[i], fm = places.mm[i] * places.mm[i];
    block.alpha[0][i] = e.least * fp;
    block.alpha[1][i] = e.most * fp;
    block.beta[0][i] = block.beta[1][i] = 0.5 * (1 + tau * tau) * fm;
    weigh(m, 0, i, block);
    weigh(m, 1, i, block);
    block.huber[i] = huber_of(squared_distance(block, i), 1);
    if constexpr (kPulls) {
      const double z0 = block.residual[0][i] * block.weight[0][i];
      const double z1 = block.residual[1][i] * block.weight[1][i];
      const double by_place =
          -0.5 * block.huber[i] * (z0 * z0 + z1 * z1) * m.b * fm * tau / places.half_length[i];
      block.pull[0][i] = by_place * d0;
      block.pull[1][i] = by_place * d1;
      block.pull[2][i] = by_place * d2;
      const double w0 = z0 * block.normal[0][0][i] + z1 * block.normal[1][0][i];
      const double w1 = z0 * block.normal[0][1][i] + z1 * block.normal[1][1][i];
      const double w2 = z0 * block.normal[0][2][i] + z1 * block.normal[1][2][i];
      const double by_pixel = -block.huber[i] * m.a * fp;
      const double along_u = by_pixel * (w0 * m.s[0][0] + w1 * m.s[1][0] + w2 * m.s[2][0]);
      const double along_v = by_pixel * (w0 * m.s[0][1] + w1 * m.s[1][1] + w2 * m.s[2][1]);
      p0 += along_u * w0, p1 += along_u * w1, p2 += along_u * w2;
      q0 += along_v * w0, q1 += along_v * w1, q2 += along_v * w2;
    }
  }
  block.column_pull[0] = Vector3d(p0, p1, p2);
  block.column_pull[1] = Vector3d(q0, q1, q2);
}

// Pixel noise of all rows grows as the squared scale does, which is a third of the columns' squares.
void pull_scale(const Mapping& m, double strained, IndependentBlock& block) {
  for (int column = 0; column < 3; ++column)
    for (int axis = 0; axis < 3; ++axis)
      block.column_pull[column][axis] = -strained * m.a * (2.0 / 3.0) * m.s[axis][column];
}

// Two points of a 3D probe's needle, the second ones behind the first ones: from points to the two
// combinations of them that see the ends' noise independently.
SONOCAL_WIDEST_VECTORS void weigh_along(const Mapping& given, const Places& places, IndependentBlock& block) {
  const Mapping m = given;
  const int pairs = block.count / 2;
  double strained = 0;
#pragma omp simd reduction(+ : strained)
  for (int i = 0; i < pairs; ++i) {
    const int j = pairs + i;
    const double n0 = block.normal[0][0][i], n1 = block.normal[0][1][i], n2 = block.normal[0][2][i];
    const double m0 = block.normal[1][0][i], m1 = block.normal[1][1][i], m2 = block.normal[1][2][i];
    const double d0 = n1 * m2 - n2 * m1, d1 = n2 * m0 - n0 * m2, d2 = n0 * m1 - n1 * m0;
    // The points' places differ by the part of S (x - x') along the needle.
    const double a0 = d0 * m.s[0][0] + d1 * m.s[1][0] + d2 * m.s[2][0];
    const double a1 = d0 * m.s[0][1] + d1 * m.s[1][1] + d2 * m.s[2][1];
    const double a2 = d0 * m.s[0][2] + d1 * m.s[1][2] + d2 * m.s[2][2];
    const double shift = d0 * m.t[0] + d1 * m.t[1] + d2 * m.t[2] - places.middle[i];
    const double xi[3] = {block.x[0][i], block.x[1][i], block.x[2][i]};
    const double xj[3] = {block.x[0][j], block.x[1][j], block.x[2][j]};
    // Points of unlike pixel noise are brought to a common one by a factor each.
    const double fi = 1.0 / places.px[i], fj = 1.0 / places.px[j];
    const double ti = fi * (a0 * xi[0] + a1 * xi[1] + a2 * xi[2] + shift) / places.half_length[i];
    const double tj = fj * (a0 * xj[0] + a1 * xj[1] + a2 * xj[2] + shift) / places.half_length[i];
    const double volume = fi * tj - fj * ti;
    const Eigen2 e = eigen_of(0.5 * (fi * fi + ti * ti), 0.5 * (fi * fj + ti * tj), 0.5 * (fj * fj + tj * tj),
                              0.25 * volume * volume);
    const double ci = e.c * fi, cj = e.c * fj, si = e.s * fi, sj = e.s * fj;
    for (int axis = 0; axis < 3; ++axis) {
      block.x[axis][i] = cj * xj[axis] - si * xi[axis];
      block.x[axis][j] = ci * xi[axis] + sj * xj[axis];
    }
    block.h[i] = cj - si;
    block.h[j] = ci + sj;
    const double fm = places.mm[i] * places.mm[i];
    for (int k = 0; k < 2; ++k) {
      block.alpha[k][i] = block.alpha[k][j] = m.squared_scale;
      block.beta[k][i] = e.least * fm;
      block.beta[k][j] = e.most * fm;
      weigh(m, k, i, block);
      weigh(m, k, j, block);
    }
    const double huber = huber_of(squared_distance(block, i) + squared_distance(block, j), 2);
    block.huber[i] = block.huber[j] = huber;
    const double least = strain(block, 0, i) + strain(block, 1, i);
    const double most = strain(block, 0, j) + strain(block, 1, j);
    // beta = ((e . f)^2 + (e . tau)^2) / 2 for the eigenvector e
    const double by_i = -least * m.b * fm * (e.c * tj - e.s * ti) / places.half_length[i];
    const double by_j = -most * m.b * fm * (e.c * ti + e.s * tj) / places.half_length[i];
    block.pull[0][i] = by_i * d0, block.pull[0][j] = by_j * d0;
    block.pull[1][i] = by_i * d1, block.pull[1][j] = by_j * d1;
    block.pull[2][i] = by_i * d2, block.pull[2][j] = by_j * d2;
    strained += least + most;
  }
  pull_scale(m, strained, block);
}

// Eigenvectors of (f f' + t t') / 2 in columns, with its eigenvalues: two of them, then zeros.
struct Combinations {
  Eigen::MatrixXd vectors;
  Eigen::VectorXd values;
};
Combinations combine(const Eigen::VectorXd& f, const Eigen::VectorXd& t) {
  if (f.size() == 1)
    return {Eigen::MatrixXd::Ones(1, 1), Eigen::VectorXd::Constant(1, 0.5 * (f[0] * f[0] + t[0] * t[0]))};
  Eigen::MatrixXd both(f.size(), 2);
  both << f, t;
  Combinations out{orthogonal_factor(both), Eigen::VectorXd::Zero(f.size())};
  // In the basis Q the matrix is R R' / 2, of f = r q0 and t = a q0 + b q1.
  const Eigen::VectorXd q0 = out.vectors.col(0), q1 = out.vectors.col(1);
  const double r = q0.dot(f), a = q0.dot(t), b = q1.dot(t);
  const Eigen2 e = eigen_of(0.5 * (r * r + a * a), 0.5 * a * b, 0.5 * b * b, 0.25 * r * r * b * b);
  out.values[0] = e.most;
  out.values[1] = e.least;
  out.vectors.col(0) = e.c * q0 + e.s * q1;
  out.vectors.col(1) = e.c * q1 - e.s * q0;
  return out;
}

}  // namespace

NoiseModel::NoiseModel(const PointLines& rows, const Sightings& sightings, RowNoise noise,
                       const PointLines::Column& squares, double limit, Kind kind)
    : rows_(rows), noise_(noise), kind_(kind) {
  std::vector<int> agreeing;
  for (int i = 0; i < sightings.size(); ++i) {
    const Sightings::Range members = sightings[i];
    agreeing.clear();
    for (const int row : members)
      if (squares[row] <= limit) agreeing.push_back(row);
    if (rows.dimension() == 2 || kind == Kind::kAlike)
      for (const int row : agreeing) singles_.push_back({row, members[0]});
    else if (agreeing.size() == 2)
      pairs_.push_back({{agreeing[0], agreeing[1]}, members[0]});
    else if (!agreeing.empty())
      others_.push_back({agreeing, members[0]});
  }
}

void NoiseModel::copy_row(int row, int to, IndependentBlock& block) const {
  const Vector3d x = rows_.point(row), n = rows_.normal(row, 0), m = rows_.normal(row, 1);
  for (int axis = 0; axis < 3; ++axis) {
    block.x[axis][to] = x[axis];
    block.normal[0][axis][to] = n[axis];
    block.normal[1][axis][to] = m[axis];
  }
  block.h[to] = 1;
  block.offset[0][to] = rows_.offset(row, 0);
  block.offset[1][to] = rows_.offset(row, 1);
}

bool NoiseBlocks::next(IndependentBlock& block) {
  block.count = 0;
  if (single_ < model_.singles_.size())
    take_singles(block);
  else if (pair_ < model_.pairs_.size())
    take_pairs(block);
  else
    take_others(block);
  block.residuals = PointLines::kPlanes * block.count;
  return block.count > 0;
}

void NoiseBlocks::take_singles(IndependentBlock& block) {
  Places places;
  for (; single_ < model_.singles_.size() && block.count < kRows; single_ += step_) {
    const auto [row, first_row] = model_.singles_[single_];
    const int to = block.count++;
    model_.copy_row(row, to, block);
    block.first_row[to] = first_row;
    places.middle[to] = model_.rows_.middle(row);
    places.half_length[to] = model_.rows_.half_length(row);
    places.px[to] = model_.px_factor(row);
    places.mm[to] = model_.mm_factor(row);
  }
  if (model_.kind_ == NoiseModel::Kind::kAlike)
    weigh_alike(Mapping(at_, levels_), block);
  else
    (pulls_ ? weigh_across<true> : weigh_across<false>)(Mapping(at_, levels_), places, block);
}

void NoiseBlocks::take_pairs(IndependentBlock& block) {
  Places places;
  const std::size_t left = (model_.pairs_.size() - pair_ + step_ - 1) / step_;
  const int pairs = static_cast<int>(std::min<std::size_t>(left, kRows / 2));
  for (int i = 0; i < pairs; ++i, pair_ += step_) {
    const NoiseModel::Pair& pair = model_.pairs_[pair_];
    for (int k = 0; k < 2; ++k) {
      const int to = i + k * pairs;
      model_.copy_row(pair.row[k], to, block);
      // Both are of the first point's needle.
      for (int plane = 0; plane < 2; ++plane) {
        for (int axis = 0; axis < 3; ++axis) block.normal[plane][axis][to] = block.normal[plane][axis][i];
        block.offset[plane][to] = block.offset[plane][i];
      }
      block.first_row[to] = pair.first_row;
      places.px[to] = model_.px_factor(pair.row[k]);
    }
    places.middle[i] = model_.rows_.middle(pair.row[0]);
    places.half_length[i] = model_.rows_.half_length(pair.row[0]);
    places.mm[i] = model_.mm_factor(pair.row[0]);
  }
  block.count = 2 * pairs;
  weigh_along(Mapping(at_, levels_), places, block);
}

// One by one: they are few.
void NoiseBlocks::take_others(IndependentBlock& block) {
  const Mapping mapping(at_, levels_);
  double strained = 0;
  while (block.count < kRows) {
    if (waiting_.empty()) {
      if (other_ >= model_.others_.size()) break;
      split(model_.others_[other_]);
      other_ += step_;
    }
    const Combination& from = waiting_.back();
    const int to = block.count++;
    model_.copy_row(from.row, to, block);
    for (int axis = 0; axis < 3; ++axis) block.x[axis][to] = from.x[axis];
    block.h[to] = from.h;
    for (int k = 0; k < 2; ++k) {
      block.alpha[k][to] = at_.scales[0] * at_.scales[0];
      block.beta[k][to] = from.beta;
      weigh(mapping, k, to, block);
    }
    block.huber[to] = from.huber;
    block.first_row[to] = from.first_row;
    const double both = strain(block, 0, to) + strain(block, 1, to);
    const Vector3d pull = -both * levels_.mm * from.by_place * model_.rows_.direction(from.row);
    for (int axis = 0; axis < 3; ++axis) block.pull[axis][to] = pull[axis];
    strained += both;
    waiting_.pop_back();
  }
  pull_scale(mapping, strained, block);
}

void NoiseBlocks::split(const NoiseModel::Other& sighting) {
  const PointLines& rows = model_.rows_;
  const int m = static_cast<int>(sighting.rows.size()), first = sighting.rows[0];
  Eigen::VectorXd factor(m), tau(m);
  for (int j = 0; j < m; ++j) {
    const int row = sighting.rows[j];
    factor[j] = 1.0 / model_.px_factor(row);
    const double along = rows.direction(first).dot(at_.apply(rows.point(row)));
    tau[j] = factor[j] * (along - rows.middle(first)) / rows.half_length(first);
  }
  const Combinations eigen = combine(factor, tau);
  const double fm = model_.mm_factor(first) * model_.mm_factor(first);
  double squared = 0;
  for (int j = 0; j < m; ++j) {
    const double by_place = fm * eigen.vectors.col(j).dot(tau) / rows.half_length(first);
    Combination to{Vector3d::Zero(),  0, std::max(eigen.values[j], 0.0) * fm, by_place, 1, first,
                   sighting.first_row};
    for (int i = 0; i < m; ++i) {
      to.x += eigen.vectors(i, j) * factor[i] * rows.point(sighting.rows[i]);
      to.h += eigen.vectors(i, j) * factor[i];
    }
    const Vector3d mapped = at_.linear() * to.x + to.h * at_.translation;
    const double variance = levels_.px * at_.scales[0] * at_.scales[0] + levels_.mm * to.beta;
    for (int k = 0; k < PointLines::kPlanes; ++k)
      squared += std::pow(rows.normal(first, k).dot(mapped) + to.h * rows.offset(first, k), 2) / variance;
    waiting_.push_back(to);
  }
  for (Combination& to : waiting_) to.huber = huber_of(squared, m);
}

}  // namespace sonocal
