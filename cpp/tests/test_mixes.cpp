// Mixes of correspondences: side by side or one by one they say the same, and samples are what they claim to
// be.
#include "check.hpp"
#include "mixes.hpp"
#include "sonocal/correspondences/descent.hpp"
#include "sonocal/correspondences/mixed_samples.hpp"

using namespace sonocal;

namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

// In the rows' own coordinates.
Transform normalised(const UnitRows& rows, const Transform& original) {
  Transform a = original;
  a.scales = original.scales * (rows.source_size() / rows.size());
  a.translation.setZero();
  a.translation = (original.translation - rows.to_original(a).translation) / rows.size();
  return a;
}

double plain_square(const UnitRows& rows, int slot, const Transform& a) {
  double sum = 0;
  for (int j = 0; j < rows.kind(slot).rows(); ++j) {
    const PointOnPlane row = rows.row(slot, j);
    sum += squared_residuals(&row, 1, a);
  }
  return sum / rows.kind(slot).points();
}

void kinds() {
  const Mix mix(40, 0, 3);
  const UnitRows rows(mix.table());
  check(static_cast<int>(rows.kinds().size()) == Mix::kKinds, "each kind once");
  std::vector<bool> there(rows.units());
  int lines = 0;
  for (int slot = 0; slot < rows.slots(); ++slot) {
    if (rows.unit(slot) < 0) continue;
    check(!there[rows.unit(slot)], "each correspondence has one place");
    there[rows.unit(slot)] = true;
    check(rows.kind(slot).held() == std::array<int, 5>{1, 2, 3, 4, 2}[rows.unit(slot) / 40],
          "what each kind holds");
    lines += rows.kind(slot).line;
  }
  check(std::count(there.begin(), there.end(), true) == rows.units(), "and all have one");
  check(lines == 40, "lines on lines are known");
}

void scores_and_sums() {
  const Mix mix(70, 30, 4, 0.3);
  const UnitRows rows(mix.table());
  Transform a = normalised(rows, mix.truth);
  a.translation += Vector3d(1e-3, -2e-3, 1e-3);
  const double limit = std::pow(2 / rows.size(), 2);
  UnitRows::Column squares;
  rows.squares(a, squares);
  double truncated = 0, within = 0;
  for (int slot = 0; slot < rows.slots(); ++slot) {
    if (rows.unit(slot) < 0) continue;
    const double square = plain_square(rows, slot, a);
    check(std::fabs(squares[slot] - square) <= 1e-12 * (1 + square), "squares, side by side or one by one");
    truncated += std::min(square, limit);
    if (squares[slot] <= limit) within += square * rows.kind(slot).points();
  }
  const double sum = rows.truncated_sum(a, limit, kInfinity);
  check(std::fabs(sum - truncated) < 1e-12 * truncated, "and their truncated sum");
  check(std::fabs(rows.cost(squares, limit).cost(a) - within) < 1e-9 * within,
        "and the cost of those within");
  check(rows.truncated_sum(a, limit, 2 * sum) == sum, "a better one is scored to the end");
  check(rows.truncated_sum(a, limit, 0.3 * sum) >= 0.3 * sum, "a worse one says so");
  a.translation += Vector3d(1, 1, 1);
  check(rows.truncated_sum(a, limit, sum) >= sum, "and a hopeless one, seen in part");
}

void descent() {
  const Mix mix(30, 0, 5);
  const UnitRows rows(mix.table());
  const Transform truth = normalised(rows, mix.truth);
  for (const bool scale_known : {false, true}) {
    Transform a = truth;
    a.rotation = rotation_by({0.05, -0.03, 0.02}) * a.rotation;
    a.translation += Vector3d(0.02, 0.01, -0.03);
    if (!scale_known) a.scales *= 1.05;
    UnitRows::Column squares;
    rows.squares(a, squares);
    descend(rows.cost(squares, kInfinity), 20, scale_known, a);
    check((a.linear() - truth.linear()).norm() < 1e-6 && (a.translation - truth.translation).norm() < 1e-6,
          "descent ends at the truth");
    check(!scale_known || a.scales == truth.scales, "a known scale stays");
  }
}

void samples() {
  const Mix mix(60, 20, 6);
  const UnitRows rows(mix.table());
  const Transform truth = normalised(rows, mix.truth);
  MixedSamples samples(rows, nullptr, false);
  Random random(1);
  MixedSamples::Models models;
  constexpr int kDraws = 20'000;
  int clean = 0, missed = 0;
  for (int i = 0; i < kDraws; ++i) {
    samples.draw(random);
    const auto& drawn = samples.rows();
    check(drawn.size() >= 7, "seven rows at least");
    if (squared_residuals(drawn.data(), static_cast<int>(drawn.size()), truth) > 1e-12) continue;
    ++clean;
    const int count = samples.solve(models);
    const auto near = [&](const Transform& a) { return (a.linear() - truth.linear()).norm() < 1e-5; };
    missed += std::none_of(models.begin(), models.begin() + count, near);
  }
  const double share = samples.clean_share(std::vector<double>(Mix::kKinds, 2.0 / 3));
  check(std::fabs(clean - share * kDraws) < 5 * std::sqrt(share * kDraws), "as many are clean as it says");
  check(missed <= clean / 100, "clean samples have the truth among their solutions");
}

void better_ones_first() {
  const Mix mix(40, 0, 7);
  const UnitRows rows(mix.table());
  std::vector<double> weights(rows.units(), 1.0);
  for (int c = 0; c < rows.units(); c += 2) weights[c] = 0.1;
  MixedSamples samples(rows, weights.data(), false);
  Random random(1);
  int of_the_better = 0, of_all = 0;
  for (int i = 0; i < 60; ++i) {
    samples.draw(random);
    for (const PointOnPlane& drawn : samples.rows())
      for (int slot = 0; slot < rows.slots(); ++slot)
        if (rows.unit(slot) >= 0 && rows.row(slot, 0).point == drawn.point) {
          ++of_all;
          of_the_better += rows.unit(slot) % 2;
        }
  }
  check(of_the_better == of_all, "the first samples are of those that weigh most");
}

void estimates() {
  const Mix mix(40, 24, 8, 0.2);
  CorrespondenceOptions options;
  options.threshold = 2;
  const CorrespondenceEstimate e = estimate(mix.table(), options), again = estimate(mix.table(), options);
  check(e.found && e.converged && (e.transform.linear() - mix.truth.linear()).norm() < 1e-2,
        "the truth is found");
  check(e.transform.matrix() == again.transform.matrix() && e.samples == again.samples,
        "the same seed, the same answer");
  options.fixed_scale = mix.truth.scales[0];
  const CorrespondenceEstimate rigid = estimate(mix.table(), options);
  check(rigid.found && rigid.transform.scales == mix.truth.scales &&
            (rigid.transform.rotation - mix.truth.rotation).norm() < 1e-2,
        "and with the scale known");
}

}  // namespace

int main() {
  kinds();
  scores_and_sums();
  descent();
  samples();
  better_ones_first();
  estimates();
  return summary("mixes");
}
