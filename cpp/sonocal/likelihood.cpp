#include "sonocal/likelihood.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>

namespace sonocal {
namespace {

constexpr int kMostRounds = 50;
constexpr int kIterationsARound = 2;
constexpr double kConvergedMove = 1e-9;   // of the transform's entries, which are of order one
constexpr double kConvergedLevel = 1e-5;  // of a squared level, relative
constexpr double kMostShrinking = -0.75, kMostGrowing = 3.0;  // of a squared level in one step, relative
constexpr double kLeastLevel = 1e-34;  // squared, so that noise-free rows have a weight
// How far, in standard deviations of its logarithm, the ratio of the two noises' shares in the residuals is
// expected from one: wide enough to be forgotten when the data know better, and all there is when they do
// not (few rows, or rows that all weigh the two alike).
constexpr double kRatioSpread = 2.0;
// Sightings further off than this many standard deviations count less (Huber): 1 in 3000 of sound ones.
constexpr double kHuber = 4.0;
// The levels are two numbers: more sightings than this do not tell them better.
constexpr double kRounding = 1e-24;  // variance, in coordinates of order one
constexpr int kSightingsForLevels = 20000;

// The eigenvectors (columns) and eigenvalues of a small symmetric matrix.
template <class Matrix>
auto eigen_of(const Matrix& m) {
  Eigen::SelfAdjointEigenSolver<Matrix> solver;
  if constexpr (Matrix::RowsAtCompileTime == 2)
    solver.computeDirect(m);
  else
    solver.compute(m);
  return solver;
}

double place_on(const Needle& needle, const Vector3d& mapped) {
  return needle.direction.dot(mapped - needle.middle) / needle.half_length;
}

// Sums over independent rows for one step of restricted maximum likelihood, with the average of the
// expected and the observed information (Gilmour, Thompson and Cullis 1995): where the data contradict the
// model, the expected one alone overshoots back and forth. With W = V^-1 and A = dV / da,
//     m0 = J'WJ,  m1 = J'WAWJ,  pull = J'WAWr,  trace = tr WA,  qa = r'WAWr,  qaa = r'WAWAWr,  qq = r'Wr.
template <int kParameters>
struct LevelSums {
  using Matrix = Eigen::Matrix<double, kParameters, kParameters>;
  Matrix m0 = Matrix::Zero(), m1 = Matrix::Zero();
  Eigen::Matrix<double, kParameters, 1> pull = Eigen::Matrix<double, kParameters, 1>::Zero();
  double trace = 0, qa = 0, qaa = 0, qq = 0, alpha = 0, beta = 0;
  int count = 0;

  void add(const IndependentRow& row, int plane, const Transform& t, const Matrix3d& s, double a, double b) {
    const double weight = 1.0 / (a * row.alpha[plane] + b * row.beta[plane]);
    const double share = row.alpha[plane] * weight;
    const double r = residual(row, plane, s, t.translation);
    const auto j = residual_jacobian<kParameters>(row, plane, s);
    const Matrix jj = weight * (j * j.transpose());
    m0 += jj;
    m1 += share * jj;
    pull += (share * weight * r) * j;
    trace += share;
    qa += share * weight * r * r;
    qaa += share * share * weight * r * r;
    qq += weight * r * r;
    alpha += row.alpha[plane];
    beta += row.beta[plane];
    ++count;
  }

  // The relative step of (a, b); a level that is known does not move.
  Vector2d step(double a, double b, bool move_a, bool move_b) const {
    const auto solver = m0.ldlt();
    const double pa = trace - solver.solve(m1).trace();  // tr(P A), P what the fit leaves of V^-1
    // a A + b B = V turns every sum with B into one with A.
    const double pb = (count - kParameters - a * pa) / b, qb = (qq - a * qa) / b;
    const double aa = qaa - pull.dot(solver.solve(pull)), ab = (qa - a * aa) / b;
    const double bb = (qq - 2.0 * a * qa + a * a * aa) / (b * b);
    Eigen::Matrix2d information;
    information << a * a * aa, a * b * ab, a * b * ab, b * b * bb;
    information *= 0.5;
    Vector2d score(0.5 * a * (qa - pa), 0.5 * b * (qb - pb));
    const double precision = 1.0 / (kRatioSpread * kRatioSpread);
    const double off = std::log(a * alpha / (b * beta));
    Eigen::Matrix2d prior;
    prior << precision, -precision, -precision, precision;
    information += prior;
    score += Vector2d(-off, off) * precision;
    Vector2d result = Vector2d::Zero();
    if (move_a && move_b)
      result = information.ldlt().solve(score);
    else if (move_a)
      result[0] = (score[0] + off * precision) / (information(0, 0) - precision);
    else if (move_b)
      result[1] = (score[1] - off * precision) / (information(1, 1) - precision);
    if (!result.allFinite()) return Vector2d::Zero();
    return result.cwiseMax(kMostShrinking).cwiseMin(kMostGrowing);
  }
};

void append(const IndependentRow& row, double a, double b, double huber, Block& block) {
  const int to = block.count++;
  block.h[to] = row.h;
  for (int axis = 0; axis < 3; ++axis) {
    block.x[axis][to] = row.x[axis];
    for (int k = 0; k < 2; ++k) block.normal[k][axis][to] = row.normal[k][axis];
  }
  for (int k = 0; k < 2; ++k) {
    block.offset[k][to] = row.offset[k];
    block.weight[k][to] = huber / (a * row.alpha[k] + b * row.beta[k]);
  }
}

// Huber's weight of a sighting from its squared distance in standard deviations.
double huber_weight(const std::vector<IndependentRow>& rows, const Transform& t, const Matrix3d& s, double a,
                    double b) {
  double squared = 0;
  for (const auto& row : rows)
    for (int k = 0; k < 2; ++k) {
      const double r = residual(row, k, s, t.translation);
      squared += r * r / (a * row.alpha[k] + b * row.beta[k]);
    }
  const double limit = kHuber * kHuber * rows.size();
  return squared > limit ? std::sqrt(limit / squared) : 1.0;
}

template <int kParameters>
class Maximiser {
 public:
  Maximiser(const NoiseModel& noise, const PointLines::Column& squares, double limit, Model model,
            NoiseLevels known)
      : noise_(noise), squares_(squares), limit_(limit), model_(model) {
    const Normalisation& n = noise.rows().normalisation();
    a_ = std::pow(known.px / n.image_size, 2);
    b_ = std::pow(known.mm / n.size, 2);
    move_a_ = !(known.px > 0);
    move_b_ = !(known.mm > 0);
  }

  LikelihoodFit run(const Transform& start) {
    LikelihoodFit fit;
    fit.transform = start;
    // Nothing but rounding is left: there are no levels to find, and no better transform.
    if ((move_a_ || move_b_) && guess_levels(start) < kRounding) fit.converged = true;
    if ((move_a_ || move_b_) && stride() > 1 &&
        !fit.converged) {  // the levels of a part are those of the whole
      alternate(start, stride(), fit);
      move_a_ = move_b_ = fit.converged = false;
    }
    alternate(start, 1, fit);
    const Normalisation& n = noise_.rows().normalisation();
    fit.levels = {std::sqrt(a_) * n.image_size, std::sqrt(b_) * n.size};
    fit.information = cost_at(fit.transform, 1).information(fit.transform, model_);
    return fit;
  }

 private:
  // Levels and transform in turn, on every n-th sighting, until both come to rest.
  void alternate(const Transform& start, int step, LikelihoodFit& fit) {
    for (int round = 0; round < kMostRounds && !fit.converged; ++round) {
      const double moved_levels = move_a_ || move_b_ ? update_levels(fit.transform) : 0.0;
      const Refinement refined =
          refine(cost_at(fit.transform, step), fit.transform, model_, kIterationsARound);
      const double moved = (refined.transform.matrix() - fit.transform.matrix()).cwiseAbs().maxCoeff();
      if (ran_away(refined.transform, start)) {
        fit.transform = start;
        break;
      }
      fit.transform = refined.transform;
      fit.converged = moved < kConvergedMove && moved_levels < kConvergedLevel;
    }
  }

  // Both noises alike in size, and together as large as the residuals are. Returns the residuals' variance.
  double guess_levels(const Transform& t) {
    double squares = 0, alpha = 0, beta = 0;
    int count = 0;
    const Matrix3d s = t.linear();
    each(t, stride(), [&](const std::vector<IndependentRow>& rows) {
      for (const auto& row : rows)
        for (int k = 0; k < 2; ++k, ++count) {
          const double r = residual(row, k, s, t.translation);
          squares += r * r;
          alpha += row.alpha[k];
          beta += row.beta[k];
        }
    });
    // Residuals may be zero; a level never is.
    const double variance = std::max(squares / std::max(count - kParameters, 1), 1e-30) * count;
    if (move_a_) a_ = (move_b_ ? 0.5 : 1.0) * variance / alpha;
    if (move_b_) b_ = (move_a_ ? 0.5 : 1.0) * variance / beta;
    return squares / std::max(count, 1);
  }

  double update_levels(const Transform& t) {
    LevelSums<kParameters> sums;
    const Matrix3d s = t.linear();
    each(t, stride(), [&](const std::vector<IndependentRow>& rows) {
      for (const auto& row : rows)
        for (int k = 0; k < 2; ++k) sums.add(row, k, t, s, a_, b_);
    });
    if (sums.count <= kParameters) return 0;
    Vector2d step = sums.step(a_, b_, move_a_, move_b_);
    // Where the data contradict the model full steps can overshoot back and forth for ever.
    damping_ = step.dot(last_step_) < 0 ? 0.5 * damping_ : std::min(1.0, 1.2 * damping_);
    last_step_ = step;
    step *= damping_;
    a_ = std::max(a_ * (1 + step[0]), kLeastLevel);
    b_ = std::max(b_ * (1 + step[1]), kLeastLevel);
    return step.cwiseAbs().maxCoeff();
  }

  NormalEquations cost_at(const Transform& t, int step) const {
    NormalEquations equations(noise_.rows().dimension());
    Block block;
    const Matrix3d s = t.linear();
    each(t, step, [&](const std::vector<IndependentRow>& rows) {
      const double huber = huber_weight(rows, t, s, a_, b_);
      for (const auto& row : rows) {
        append(row, a_, b_, huber, block);
        if (block.count == Block::kRows) {
          equations.add(block);
          block.count = 0;
        }
      }
    });
    if (block.count > 0) equations.add(block);
    return equations;
  }

  template <class Visitor>
  void each(const Transform& t, int stride, Visitor visit) const {
    std::vector<IndependentRow> rows;
    for (int i = 0; i < noise_.size(); i += stride) {
      noise_.independent_rows(i, t, squares_, limit_, rows);
      if (!rows.empty()) visit(rows);
    }
  }

  int stride() const { return 1 + noise_.size() / kSightingsForLevels; }

  const NoiseModel& noise_;
  const PointLines::Column& squares_;
  const double limit_;
  const Model model_;
  double a_, b_;
  bool move_a_, move_b_;
  Vector2d last_step_ = Vector2d::Zero();
  double damping_ = 1;
};

}  // namespace

void NoiseModel::independent_rows(int i, const Transform& a, const PointLines::Column& squares, double limit,
                                  std::vector<IndependentRow>& out) const {
  out.clear();
  const Sightings::Range members = sightings_[i];
  if (rows_.dimension() == 2) {
    for (const int row : members)
      if (squares[row] <= limit) out.push_back(across_needle(row, a));
    return;
  }
  static thread_local std::vector<int> agreeing;
  agreeing.clear();
  for (const int row : members)
    if (squares[row] <= limit) agreeing.push_back(row);
  if (!agreeing.empty()) along_needle(agreeing, a, out);
}

void NoiseModel::alike_rows(int i, const PointLines::Column& squares, double limit,
                            std::vector<IndependentRow>& out) const {
  out.clear();
  for (const int row : sightings_[i])
    if (squares[row] <= limit)
      out.push_back({rows_.point(row),
                     1,
                     {rows_.normal(row, 0), rows_.normal(row, 1)},
                     {rows_.offset(row, 0), rows_.offset(row, 1)},
                     {0, 0},
                     {1, 1}});
}

IndependentRow NoiseModel::across_needle(int row, const Transform& a) const {
  const Vector3d x = rows_.point(row);
  const double tau = place_on(rows_.needle(row), a.apply(x));
  const Matrix3d s = a.linear();
  const Vector3d n1 = rows_.normal(row, 0), n2 = rows_.normal(row, 1);
  Eigen::Matrix2d seen;  // N' (c1 c1' + c2 c2') N: pixel noise across the needle
  const Vector2d u(n1.dot(s.col(0)), n2.dot(s.col(0))), v(n1.dot(s.col(1)), n2.dot(s.col(1)));
  seen = u * u.transpose() + v * v.transpose();
  const auto eigen = eigen_of(seen);
  IndependentRow out;
  out.x = x;
  out.h = 1;
  for (int k = 0; k < 2; ++k) {
    const Vector2d e = eigen.eigenvectors().col(k);
    const double fp = noise_.px ? noise_.px[row] : 1.0, fm = noise_.mm ? noise_.mm[row] : 1.0;
    out.normal[k] = e[0] * n1 + e[1] * n2;
    out.offset[k] = e[0] * rows_.offset(row, 0) + e[1] * rows_.offset(row, 1);
    out.alpha[k] = std::max(eigen.eigenvalues()[k], 0.0) * fp * fp;
    out.beta[k] = 0.5 * (1 + tau * tau) * fm * fm;
  }
  return out;
}

void NoiseModel::along_needle(const std::vector<int>& rows, const Transform& a,
                              std::vector<IndependentRow>& out) const {
  const int m = static_cast<int>(rows.size());
  const Needle needle = rows_.needle(rows[0]);
  // Points of unlike pixel noise are brought to a common one by a factor each.
  Eigen::VectorXd factor(m), tau(m);
  for (int j = 0; j < m; ++j) {
    factor[j] = noise_.px ? 1.0 / noise_.px[rows[j]] : 1.0;
    tau[j] = place_on(needle, a.apply(rows_.point(rows[j]))) * factor[j];
  }
  const double fm = noise_.mm ? noise_.mm[rows[0]] : 1.0;
  Eigen::MatrixXd vectors(m, m);
  Eigen::VectorXd values(m);
  if (m == 2) {
    const Eigen::Matrix2d shared = 0.5 * (factor * factor.transpose() + tau * tau.transpose());
    const auto eigen = eigen_of(shared);
    vectors = eigen.eigenvectors();
    values = eigen.eigenvalues();
  } else {
    const Eigen::MatrixXd shared = 0.5 * (factor * factor.transpose() + tau * tau.transpose());
    const auto eigen = eigen_of(shared);
    vectors = eigen.eigenvectors();
    values = eigen.eigenvalues();
  }
  for (int j = 0; j < m; ++j) {
    IndependentRow row;
    row.x.setZero();
    row.h = 0;
    for (int i = 0; i < m; ++i) {
      row.x += vectors(i, j) * factor[i] * rows_.point(rows[i]);
      row.h += vectors(i, j) * factor[i];
    }
    for (int k = 0; k < 2; ++k) {
      row.normal[k] = rows_.normal(rows[0], k);
      row.offset[k] = rows_.offset(rows[0], k);
      row.alpha[k] = a.scales[0] * a.scales[0];
      row.beta[k] = std::max(values[j], 0.0) * fm * fm;
    }
    out.push_back(row);
  }
}

LikelihoodFit maximise_likelihood(const NoiseModel& noise, const PointLines::Column& squares, double limit,
                                  const Transform& start, Model model, NoiseLevels known) {
  return model == Model::kSimilarity ? Maximiser<7>(noise, squares, limit, model, known).run(start)
                                     : Maximiser<8>(noise, squares, limit, model, known).run(start);
}

}  // namespace sonocal
