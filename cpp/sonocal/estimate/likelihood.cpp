#include "sonocal/estimate/likelihood.hpp"

#include <algorithm>
#include <cmath>

#include "sonocal/interrupt/interrupt.hpp"
#include "sonocal/linalg/ldlt.hpp"
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
constexpr double kLeastRatio = 1e-10;     // of the two noises' shares in the residuals, squared
constexpr double kRounding = 1e-24;       // variance, in coordinates of order one
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

// The step of the squared levels' logarithms by restricted maximum likelihood, with the average of the
// expected and the observed information (Gilmour, Thompson and Cullis 1995): where the data contradict the
// model, the expected one alone overshoots back and forth. A level that is known does not move.
template <int kParameters>
Vector2d level_step(const Pass& pass, const Transform& at, Variances levels, bool move_px, bool move_mm) {
  using Matrix = Eigen::Matrix<double, kParameters, kParameters>;
  const double a = levels.px, b = levels.mm;
  const auto& [trace, qa, qaa, qq, alpha, beta, rr] = pass.scalars;
  Matrix m0, m1, more;                                 // J'WJ, J'WAWJ
  Eigen::Matrix<double, kParameters, 1> pull, unused;  // J'WAWr
  pass.fit.linearise<kParameters>(at, m0, unused);
  if (pass.lost.rows() > 0) {
    pass.lost.linearise<kParameters>(at, more, unused);
    m0 += more;
  }
  pass.shares.linearise<kParameters>(at, m1, pull);
  const Ldlt<kParameters> solver(m0);
  const double pa = trace - solver.solve(m1).trace();  // tr(P A), P what the fit leaves of V^-1
  // a A + b B = V turns every sum with B into one with A.
  const double pb = (pass.residuals - kParameters - a * pa) / b, qb = (qq - a * qa) / b;
  const double aa = qaa - pull.dot(solver.solve(pull)), ab = (qa - a * aa) / b;
  const double bb = (qq - 2.0 * a * qa + a * a * aa) / (b * b);
  Eigen::Matrix2d information;
  information << a * a * aa, a * b * ab, a * b * ab, b * b * bb;
  information *= 0.5;
  Vector2d score(0.5 * a * (qa - pa), 0.5 * b * (qb - pb));
  Vector2d result = Vector2d::Zero();
  if (move_px && move_mm) {
    const double precision = 1.0 / (kRatioSpread * kRatioSpread), off = std::log(a * alpha / (b * beta));
    Eigen::Matrix2d prior;
    prior << precision, -precision, -precision, precision;
    result = Ldlt<2>(information + prior).solve<1>(score + precision * Vector2d(-off, off));
  } else if (move_px) {
    result[0] = score[0] / information(0, 0);
  } else if (move_mm) {
    result[1] = score[1] / information(1, 1);
  }
  if (!result.allFinite()) return Vector2d::Zero();
  return result.cwiseMax(-kMostStep).cwiseMin(kMostStep);
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
    const Variances before = levels_;
    levels_.px = std::max(levels_.px * std::exp(step[0]), kLeastLevel);
    levels_.mm = std::max(levels_.mm * std::exp(step[1]), kLeastLevel);
    // Rows that see one noise alone, and none of it, would take that level to nothing.
    const double px_of_mm = pass.scalars.beta / pass.scalars.alpha;
    if (move_px_) levels_.px = std::max(levels_.px, kLeastRatio * px_of_mm * levels_.mm);
    if (move_mm_) levels_.mm = std::max(levels_.mm, kLeastRatio / px_of_mm * levels_.px);
    return std::max(std::abs(std::log(levels_.px / before.px)), std::abs(std::log(levels_.mm / before.mm)));
  }

  const Noise& noise_;
  const Model model_;
  bool move_px_, move_mm_;
  Variances levels_;
  Vector2d last_newton_ = Vector2d::Zero(), last_step_ = Vector2d::Zero();
  double damping_ = 1;
};

}  // namespace

template <class Noise>
LikelihoodFit maximise_likelihood(const Noise& noise, const Transform& start, Model model,
                                  NoiseLevels known) {
  switch (model) {
    case Model::kScaleKnown:
      return Maximiser<6, Noise>(noise, model, known).run(start);
    case Model::kSimilarity:
      return Maximiser<7, Noise>(noise, model, known).run(start);
    case Model::kAnisotropic:
      return Maximiser<8, Noise>(noise, model, known).run(start);
    default:
      return Maximiser<9, Noise>(noise, model, known).run(start);
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
