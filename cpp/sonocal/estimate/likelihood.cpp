#include "sonocal/estimate/likelihood.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "sonocal/interrupt/interrupt.hpp"
#include "sonocal/linalg/ldlt.hpp"
#include "sonocal/linalg/product.hpp"
#include "sonocal/linalg/vectors.hpp"

namespace sonocal {
namespace {

constexpr int kMostRounds = 50;
constexpr int kIterationsARound = 2;
// A thousandth of what the rows of the largest tables leave unknown, and less.
constexpr double kConvergedMove = 1e-7;   // of the transform's entries, which are of order one
constexpr double kConvergedLevel = 1e-5;  // of a squared level, relative
constexpr double kMostStep = 1.4;         // of a squared level's logarithm
constexpr double kNear = 0.5;             // a step of it that is no longer one of many
constexpr double kLeastLevel = 1e-34;     // squared, so that noise-free rows have a weight
constexpr double kFreeMotion = 1e-12;     // of the greatest pivot, in coordinates of order one
constexpr double kRounding = 1e-24;       // variance, in coordinates of order one
// How far, in standard deviations of its logarithm, the ratio of the two noises' shares in the residuals is
// expected from one: wide enough to be forgotten when the data know better, and all there is when they do
// not (few rows, or rows that all weigh the two alike).
constexpr double kRatioSpread = 2.0;
// The levels are two numbers: more sightings than this do not tell them better.
constexpr int kSightingsForLevels = 20000;

// Sums over rows, with W = V^-1 and A = dV / da, a and b the squared levels of px and mm:
//     trace = tr WA,  qa = r'WAWr,  qaa = r'WAWAWr,  qq = r'Wr,
// and what guesses at the levels need.
struct Scalars {
  double trace = 0, qa = 0, qaa = 0, qq = 0, alpha = 0, beta = 0, rr = 0;
};

// Adds a block's; its weights become those of WAW, which the matrices with A take.
SONOCAL_WIDEST_VECTORS void add_scalars(IndependentBlock& block, Scalars& sums) {
  const int count = block.count;
  double trace = 0, qa = 0, qaa = 0, qq = 0, alpha = 0, beta = 0, rr = 0;
  for (int k = 0; k < 2; ++k) {
#pragma omp simd reduction(+ : trace, qa, qaa, qq, alpha, beta, rr)
    for (int i = 0; i < count; ++i) {
      const double weight = block.weight[k][i], share = block.alpha[k][i] * weight;
      const double r = block.residual[k][i], square = r * r;
      trace += share;
      qq += weight * square;
      qa += share * weight * square;
      qaa += share * share * weight * square;
      alpha += block.alpha[k][i];
      beta += block.beta[k][i];
      rr += square;
      block.weight[k][i] = share * weight;
    }
  }
  sums.trace += trace, sums.qa += qa, sums.qaa += qaa, sums.qq += qq;
  sums.alpha += alpha, sums.beta += beta, sums.rr += rr;
}

// The weights times the sightings' Huber factors; what they lose by that goes to `lost`. False: they lose
// nothing.
bool robustify(IndependentBlock& block, Block& lost) {
  const double* factors = block.huber;
  if (*std::min_element(factors, factors + block.count) == 1.0) return false;
  lost = block;
  for (int k = 0; k < 2; ++k)
    for (int i = 0; i < block.count; ++i) {
      lost.weight[k][i] *= 1 - factors[i];
      block.weight[k][i] *= factors[i];
    }
  return true;
}

// One pass over the sightings at a transform and levels.
struct Pass {
  explicit Pass(int dimension) : fit(dimension), lost(dimension), shares(dimension) {}
  NormalEquations fit;     // weights W, with Huber's factors
  NormalEquations lost;    // what those take away
  NormalEquations shares;  // weights WAW
  Scalars scalars;
  int residuals = 0;
};

template <class Noise>
Pass pass_over(const Noise& noise, const Transform& at, Variances levels, int step, bool for_levels) {
  Pass pass(noise.dimension());
  IndependentBlock block;
  Block lost;
  typename Noise::Blocks blocks(noise, at, levels, step, !for_levels);
  while (blocks.next(block)) {
    pass.residuals += block.residuals;
    const bool loses = robustify(block, lost);
    pass.fit.add(block);
    if (!for_levels) {
      pass.fit.add_linear(block, block.pull, block.column_pull);
      continue;
    }
    if (loses) {
      pass.lost.add(lost);
      for (int k = 0; k < 2; ++k)
        for (int i = 0; i < block.count; ++i) block.weight[k][i] += lost.weight[k][i];
    }
    add_scalars(block, pass.scalars);
    pass.shares.add(block);
  }
  return pass;
}

// What rows say of the squared levels' logarithms by restricted maximum likelihood: the score, and the
// average of the expected and the observed information (Gilmour, Thompson and Cullis 1995): where the data
// contradict the model, the expected one alone overshoots back and forth.
template <int kParameters>
struct LevelScore {
  using Matrix = Eigen::Matrix<double, kParameters, kParameters>;
  Vector2d score;
  Eigen::Matrix2d information;
  Matrix shares;  // (J'WJ)^-1 J'WAWJ a: the part of the transform's covariance that is the px level's
};
template <int kParameters>
LevelScore<kParameters> level_score(const Pass& pass, const Transform& at, Variances levels) {
  LevelScore<kParameters> out;
  const double a = levels.px, b = levels.mm;
  const auto& [trace, qa, qaa, qq, alpha, beta, rr] = pass.scalars;
  typename LevelScore<kParameters>::Matrix m0, m1, more;  // J'WJ, J'WAWJ
  Eigen::Matrix<double, kParameters, 1> pull, unused;     // J'WAWr
  pass.fit.linearise<kParameters>(at, m0, unused);
  if (pass.lost.rows() > 0) {
    pass.lost.linearise<kParameters>(at, more, unused);
    m0 += more;
  }
  pass.shares.linearise<kParameters>(at, m1, pull);
  const Ldlt<kParameters> solver(m0);
  out.shares = solver.solve(m1);
  const double pa = trace - out.shares.trace();  // tr(P A), P what the fit leaves of V^-1
  out.shares *= a;
  // a A + b B = V turns every sum with B into one with A.
  const double pb = (pass.residuals - kParameters - a * pa) / b, qb = (qq - a * qa) / b;
  const double aa = qaa - pull.dot(solver.solve(pull)), ab = (qa - a * aa) / b;
  const double bb = (qq - 2.0 * a * qa + a * a * aa) / (b * b);
  out.information << a * a * aa, a * b * ab, a * b * ab, b * b * bb;
  out.information *= 0.5;
  out.score = Vector2d(0.5 * a * (qa - pa), 0.5 * b * (qb - pb));
  return out;
}

// That the two noises' shares in the residuals are alike.
Eigen::Matrix2d prior_information() {
  const double precision = 1.0 / (kRatioSpread * kRatioSpread);
  Eigen::Matrix2d prior;
  prior << precision, -precision, -precision, precision;
  return prior;
}

// The step of the squared levels' logarithms. A level that is known does not move.
template <int kParameters>
Vector2d level_step(const Pass& pass, const Transform& at, Variances levels, bool move_px, bool move_mm) {
  const LevelScore<kParameters> of = level_score<kParameters>(pass, at, levels);
  const Eigen::Matrix2d& information = of.information;
  const Vector2d& score = of.score;
  Vector2d result = Vector2d::Zero();
  if (move_px && move_mm) {
    const double off = std::log(levels.px * pass.scalars.alpha / (levels.mm * pass.scalars.beta));
    const Eigen::Matrix2d prior = prior_information();
    result = Ldlt<2>(information + prior).solve<1>(score - prior * Vector2d(off, 0));
  } else if (move_px) {
    result[0] = score[0] / information(0, 0);
  } else if (move_mm) {
    result[1] = score[1] / information(1, 1);
  }
  if (!result.allFinite()) return Vector2d::Zero();
  return result.cwiseMax(-kMostStep).cwiseMin(kMostStep);
}

Variances variances(const Normalisation& n, NoiseLevels levels) {
  return {std::pow(levels.px / n.image_size, 2), std::pow(levels.mm / n.size, 2)};
}

template <int kParameters, class Noise>
class Maximiser {
 public:
  Maximiser(const Noise& noise, Model model, NoiseLevels known)
      : noise_(noise), model_(model), move_px_(!(known.px > 0)), move_mm_(!(known.mm > 0)) {
    levels_ = variances(noise.normalisation(), known);
  }

  LikelihoodFit run(const Transform& start) {
    LikelihoodFit fit;
    fit.transform = start;
    bool found_levels = true;
    if (moves()) {
      const int few =
          1 + noise_.sightings() / kSightingsForLevels;  // the levels of a part are those of the whole
      // Nothing but rounding is left: there are no levels to find, and no better transform.
      fit.converged = guess_levels(start, few) < kRounding;
      alternate(start, few, fit);
      found_levels = fit.converged;
      move_px_ = move_mm_ = false;
      // On to the transform at these levels. Both in one would let residuals that levels explain move it.
      fit.converged = false;
    }
    alternate(start, 1, fit);
    fit.converged = fit.converged && found_levels;
    const Normalisation& n = noise_.normalisation();
    fit.levels = {std::sqrt(levels_.px) * n.image_size, std::sqrt(levels_.mm) * n.size};
    const Pass last = pass_over(noise_, fit.transform, levels_, 1, false);
    if (fit.converged) fit.transform = refine(last.fit, fit.transform, model_, kIterationsARound).transform;
    fit.information = last.fit.information(fit.transform, model_);
    return fit;
  }

 private:
  bool moves() const { return move_px_ || move_mm_; }

  // Levels and transform together, on every n-th sighting, until both come to rest.
  void alternate(const Transform& start, int step, LikelihoodFit& fit) {
    for (int round = 0; round < kMostRounds && !fit.converged; ++round) {
      allow_interrupt();
      const Pass pass = pass_over(noise_, fit.transform, levels_, step, moves());
      const double moved_levels = moves() ? move_levels(pass, fit.transform) : 0.0;
      const Refinement refined = refine(pass.fit, fit.transform, model_, kIterationsARound);
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
  double guess_levels(const Transform& at, int step) {
    const Pass pass = pass_over(noise_, at, {1, 1}, step, true);
    const Scalars& sums = pass.scalars;
    const int count = pass.residuals;
    // Residuals may be zero; a level never is.
    const double variance = std::max(sums.rr / std::max(count - kParameters, 1), 1e-30) * count;
    if (move_px_) levels_.px = (move_mm_ ? 0.5 : 1.0) * variance / sums.alpha;
    if (move_mm_) levels_.mm = (move_px_ ? 0.5 : 1.0) * variance / sums.beta;
    return sums.rr / std::max(count, 1);
  }

  double move_levels(const Pass& pass, const Transform& at) {
    if (pass.residuals <= kParameters) return 0;
    const Vector2d newton = level_step<kParameters>(pass, at, levels_, move_px_, move_mm_);
    Vector2d step = newton;
    const Vector2d change = newton - last_newton_;
    if (newton.cwiseAbs().maxCoeff() > kNear || last_newton_.cwiseAbs().maxCoeff() > kNear) {
      // Where the data contradict the model full steps can overshoot back and forth for ever.
      damping_ = newton.dot(last_step_) < 0 ? 0.5 * damping_ : std::min(1.0, 1.2 * damping_);
      step *= damping_;
    } else if (last_step_.squaredNorm() > 0 && change.squaredNorm() > 0) {
      // What the last step left undone tells how far this one falls short (Anderson 1965, over one step).
      step -= std::clamp(newton.dot(change) / change.squaredNorm(), -2.0, 0.9) * (last_step_ + change);
    }
    last_newton_ = newton;
    last_step_ = step;
    levels_.px = std::max(levels_.px * std::exp(step[0]), kLeastLevel);
    levels_.mm = std::max(levels_.mm * std::exp(step[1]), kLeastLevel);
    return step.cwiseAbs().maxCoeff();
  }

  const Noise& noise_;
  const Model model_;
  bool move_px_, move_mm_;
  Variances levels_;
  Vector2d last_newton_ = Vector2d::Zero(), last_step_ = Vector2d::Zero();
  double damping_ = 1;
};

}  // namespace

namespace {

// J' WAWAW J a^2: information with the px level's share of every row's variance, squared.
template <int kParameters>
Eigen::Matrix<double, kParameters, kParameters> squared_shares(const MixedNoise& noise, const Transform& at,
                                                               Variances levels) {
  NormalEquations sum(noise.dimension());
  IndependentBlock block;
  MixedBlocks blocks(noise, at, levels);
  while (blocks.next(block)) {
    for (int k = 0; k < 2; ++k)
      for (int i = 0; i < block.count; ++i)
        block.weight[k][i] *= std::pow(levels.px * block.alpha[k][i] * block.weight[k][i], 2);
    sum.add(block);
  }
  Eigen::Matrix<double, kParameters, kParameters> out;
  Eigen::Matrix<double, kParameters, 1> unused;
  sum.linearise<kParameters>(at, out, unused);
  return out;
}

// Covariance of the levels' logarithms; of one that is known, nothing.
Eigen::Matrix2d unsure_levels(const Eigen::Matrix2d& information, NoiseLevels known) {
  Eigen::Matrix2d out = Eigen::Matrix2d::Zero();
  if (known.px > 0 && known.mm > 0) return out;
  if (known.px > 0)
    out(1, 1) = 1.0 / information(1, 1);
  else if (known.mm > 0)
    out(0, 0) = 1.0 / information(0, 0);
  else
    out = Ldlt<2>(information + prior_information()).solve<2>(Eigen::Matrix2d::Identity());
  return out;
}

// With C the covariance if the levels were known, and U that of their logarithms: what their errors add
// (Kenward and Roger 1997), and the freedom that they leave (Satterthwaite 1946, a mean over all directions
// of the tangent),
//     C + 2 C (sum_lm U_lm (Q_lm - M_l C M_m)) C,   2 k (k + 2) / sum_lm U_lm (tr G_l tr G_m + 2 tr G_l G_m),
// M_l = J'W V_l W J, Q_lm = J'W V_l W V_m W J, G_l = C M_l, V_px + V_mm = V.
template <int kParameters>
LikelihoodCovariance covariance_as(const MixedNoise& noise, const LikelihoodFit& fit, NoiseLevels known) {
  using Matrix = Eigen::Matrix<double, kParameters, kParameters>;
  const Variances levels = variances(noise.normalisation(), fit.levels);
  const Pass pass = pass_over(noise, fit.transform, levels, 1, true);
  const LevelScore<kParameters> of = level_score<kParameters>(pass, fit.transform, levels);
  const Eigen::Matrix2d unsure = unsure_levels(of.information, known);
  const Ldlt<kParameters> information(Matrix(fit.information));
  const Matrix identity = Matrix::Identity(), covariance = information.solve(identity);
  const Matrix parts[2] = {of.shares, identity - of.shares};  // G_l
  const Matrix squares = information.solve(squared_shares<kParameters>(noise, fit.transform, levels));
  const Matrix both[2][2] = {{squares, of.shares - squares},
                             {of.shares - squares, identity - 2.0 * of.shares + squares}};  // C Q_lm
  Matrix added = Matrix::Zero();
  double sum = 0;
  for (int l = 0; l < 2; ++l)
    for (int m = 0; m < 2; ++m) {
      added += 2.0 * unsure(l, m) * (both[l][m] - product(parts[l], parts[m]));
      sum += unsure(l, m) *
             (parts[l].trace() * parts[m].trace() + 2.0 * parts[l].cwiseProduct(parts[m].transpose()).sum());
    }
  const double spare = pass.residuals - kParameters;
  double freedom = std::numeric_limits<double>::infinity();
  if (sum > 0) freedom = std::min(2.0 * kParameters * (kParameters + 2) / sum, spare);
  const Matrix matrix = covariance + product(added, covariance);
  return {0.5 * (matrix + matrix.transpose()), freedom,
          information.least_pivot() > kFreeMotion * information.greatest_pivot()};
}

}  // namespace

LikelihoodCovariance covariance_of(const MixedNoise& noise, const LikelihoodFit& fit, Model model,
                                   NoiseLevels known) {
  switch (model) {
    case Model::kScaleKnown:
      return covariance_as<6>(noise, fit, known);
    case Model::kSimilarity:
      return covariance_as<7>(noise, fit, known);
    default:
      return covariance_as<8>(noise, fit, known);
  }
}

template <class Noise>
LikelihoodFit maximise_likelihood(const Noise& noise, const Transform& start, Model model,
                                  NoiseLevels known) {
  switch (model) {
    case Model::kScaleKnown:
      return Maximiser<6, Noise>(noise, model, known).run(start);
    case Model::kSimilarity:
      return Maximiser<7, Noise>(noise, model, known).run(start);
    default:
      return Maximiser<8, Noise>(noise, model, known).run(start);
  }
}
template LikelihoodFit maximise_likelihood(const NoiseModel&, const Transform&, Model, NoiseLevels);
template LikelihoodFit maximise_likelihood(const MixedNoise&, const Transform&, Model, NoiseLevels);

template <class Noise>
NormalEquations weighted_cost(const Noise& noise, const Transform& at, NoiseLevels levels) {
  return pass_over(noise, at, variances(noise.normalisation(), levels), 1, false).fit;
}
template NormalEquations weighted_cost(const NoiseModel&, const Transform&, NoiseLevels);
template NormalEquations weighted_cost(const MixedNoise&, const Transform&, NoiseLevels);

template <class Noise>
double deviance(const Noise& noise, const Transform& at, NoiseLevels levels) {
  typename Noise::Blocks blocks(noise, at, variances(noise.normalisation(), levels));
  IndependentBlock block;
  double sum = 0;
  while (blocks.next(block))
    for (int k = 0; k < PointLines::kPlanes; ++k)
      for (int i = 0; i < block.count; ++i)
        if (block.weight[k][i] > 0)
          sum +=
              block.residual[k][i] * block.residual[k][i] * block.weight[k][i] - std::log(block.weight[k][i]);
  return sum;
}
template double deviance(const NoiseModel&, const Transform&, NoiseLevels);
template double deviance(const MixedNoise&, const Transform&, NoiseLevels);

}  // namespace sonocal
