#include "sonocal/estimate/shared_errors.hpp"

#include <algorithm>
#include <cstdint>
#include <numeric>

#include "sonocal/interrupt/interrupt.hpp"

namespace sonocal {
namespace {

// A grouping whose offsets the fit takes up almost whole cannot be told from the calibration itself.
constexpr double kLeastShareLeft = 0.05;

using Pull = Eigen::Matrix<double, Eigen::Dynamic, 3, 0, kMostParameters, 3>;  // J'B of one group

// Numbers from 0 on in the place of whatever codes.
int count_codes(std::vector<std::int64_t>& codes) {
  std::vector<std::int64_t> distinct(codes);
  std::sort(distinct.begin(), distinct.end());
  distinct.erase(std::unique(distinct.begin(), distinct.end()), distinct.end());
  for (std::int64_t& code : codes)
    code = std::lower_bound(distinct.begin(), distinct.end(), code) - distinct.begin();
  return static_cast<int>(distinct.size());
}

double inner(const Pull& a, const TangentMatrix& c, const Pull& b, int i, int j) {
  double sum = 0;
  for (Eigen::Index k = 0; k < a.rows(); ++k)
    for (Eigen::Index l = 0; l < b.rows(); ++l) sum += a(k, i) * c(k, l) * b(l, j);
  return sum;
}

// With B the map from a grouping's offsets to white residuals, P = I - J C J' what the fit leaves of them:
// `weight` and `left` are the traces of the blocks of B'B and B'PB.
class Grouping {
 public:
  Grouping(const WhiteResiduals& white, std::vector<std::int64_t> labels, int groups, const TangentMatrix& c)
      : labels_(std::move(labels)), shift_(white.shift), covariance_(c) {
    const auto k = white.jacobian.cols();
    pulls_.assign(groups, Pull::Zero(k, 3));
    weight_.assign(groups, 0.0);
    std::vector<Eigen::Vector3d> sums(groups, Eigen::Vector3d::Zero());
    for (std::size_t m = 0; m < labels_.size(); ++m) {
      const auto row = static_cast<Eigen::Index>(m), g = static_cast<Eigen::Index>(labels_[m]);
      const double* j = white.jacobian.data() + row * k;
      const double* s = shift_.data() + row * 3;
      for (int i = 0; i < 3; ++i) {
        for (Eigen::Index a = 0; a < k; ++a) pulls_[g](a, i) += j[a] * s[i];
        weight_[g] += s[i] * s[i];
        sums[g][i] += s[i] * white.residual[row];
      }
    }
    together_ = TangentMatrix::Zero(k, k);
    for (int g = 0; g < groups; ++g) {
      double taken = 0;
      for (int i = 0; i < 3; ++i) taken += inner(pulls_[g], c, pulls_[g], i, i);
      left_ += weight_[g] - taken;
      if (weight_[g] > 0) {
        left_share_ += (weight_[g] - taken) / weight_[g];
        between_ += sums[g].squaredNorm() / weight_[g];
      }
      together_ += pulls_[g].lazyProduct(pulls_[g].transpose());
    }
    const TangentMatrix half = c.lazyProduct(together_);
    together_ = half.lazyProduct(c);
  }

  bool told_apart() const {
    return left_ > kLeastShareLeft * std::accumulate(weight_.begin(), weight_.end(), 0.0);
  }
  double between() const { return between_; }
  double left() const { return left_; }
  double left_share() const { return left_share_; }
  // C J'B B'J C
  const TangentMatrix& of_offsets() const { return together_; }

  // Expected sum of squares between these groups from unit offsets of the other's groups.
  //
  // sum_t |block row t of B'P B_other|^2 / weight_t, with P B_other = B_other - J C J' B_other: blocks where
  // both groups have rows are computed one by one, the rest only through k x k products.
  double expected_between(const Grouping& other) const {
    double sum = 0;
    for (std::size_t g = 0; g < pulls_.size(); ++g)
      for (int i = 0; i < 3 && weight_[g] > 0; ++i)
        sum += inner(pulls_[g], other.together_, pulls_[g], i, i) / weight_[g];
    const auto others = static_cast<std::int64_t>(other.pulls_.size());
    std::vector<std::int64_t> cells(labels_.size());
    for (std::size_t m = 0; m < cells.size(); ++m) cells[m] = labels_[m] * others + other.labels_[m];
    std::vector<std::int64_t> cell(cells);
    const int count = count_codes(cells);
    std::vector<Eigen::Matrix3d> common(count, Eigen::Matrix3d::Zero());
    std::vector<std::int64_t> of_cell(count);
    for (std::size_t m = 0; m < cells.size(); ++m) {
      const double* s = shift_.data() + 3 * m;
      for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) common[cells[m]](i, j) += s[i] * s[j];
      of_cell[cells[m]] = cell[m];
    }
    for (int n = 0; n < count; ++n) {
      const std::int64_t g = of_cell[n] / others, h = of_cell[n] % others;
      if (!(weight_[g] > 0)) continue;
      double here = 0;
      for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j)
          here +=
              common[n](i, j) * (common[n](i, j) - 2 * inner(pulls_[g], covariance_, other.pulls_[h], i, j));
      sum += here / weight_[g];
    }
    return sum;
  }

 private:
  std::vector<std::int64_t> labels_;
  const Eigen::Matrix<double, Eigen::Dynamic, 3, Eigen::RowMajor>& shift_;
  const TangentMatrix& covariance_;
  std::vector<Pull> pulls_;
  std::vector<double> weight_;
  double left_ = 0, left_share_ = 0, between_ = 0;
  TangentMatrix together_;
};

}  // namespace

SharedErrors shared_errors(const WhiteResiduals& white, const std::vector<const std::int32_t*>& codes,
                           int units, const TangentMatrix& covariance) {
  SharedErrors out;
  std::vector<Grouping> groupings;
  for (std::size_t g = 0; g < codes.size(); ++g) {
    std::vector<std::int64_t> labels(white.row.size());
    for (std::size_t m = 0; m < labels.size(); ++m) labels[m] = codes[g][white.row[m]];
    const int groups = count_codes(labels);
    if (groups <= 1 || groups >= units) continue;
    allow_interrupt();
    Grouping grouping(white, std::move(labels), groups, covariance);
    if (!grouping.told_apart()) continue;
    out.kept.push_back(static_cast<int>(g));
    groupings.push_back(std::move(grouping));
  }
  const auto count = static_cast<Eigen::Index>(groupings.size());
  out.expected.resize(count + 1, count + 1);
  out.observed.resize(count + 1);
  out.expected(0, 0) = static_cast<double>(white.residual.size() - covariance.rows());
  out.observed[0] = white.residual.squaredNorm();
  for (Eigen::Index h = 0; h < count; ++h) {
    allow_interrupt();
    out.expected(0, h + 1) = groupings[h].left();
    out.expected(h + 1, 0) = groupings[h].left_share();
    out.observed[h + 1] = groupings[h].between();
    for (Eigen::Index g = 0; g < count; ++g)
      out.expected(h + 1, g + 1) = groupings[h].expected_between(groupings[g]);
    out.of_offsets.push_back(groupings[h].of_offsets());
  }
  return out;
}

}  // namespace sonocal
