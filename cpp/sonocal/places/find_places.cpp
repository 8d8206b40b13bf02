#include "sonocal/places/find_places.hpp"

#include <algorithm>
#include <cmath>

#include "sonocal/linalg/sort_by.hpp"
#include "sonocal/places/descend.hpp"
#include "sonocal/places/place_seen.hpp"

namespace sonocal {
namespace {

// Chi-squared of 1, 2 and 3 residuals that 1 sound row in 1000 exceeds.
constexpr double kOutlier[4] = {0, 10.83, 13.82, 16.27};
constexpr int kChoiceRounds = 6;
// So many candidates of the search are fitted.
constexpr int kFitted = 4;

// The unknown target that most rows see.
int lead_of(const PosedRows& rows) {
  std::vector<int> seen(rows.targets(), 0);
  for (int i = 0; i < rows.size(); ++i)
    if (rows.target(rows.row(i).target).nothing_known()) ++seen[rows.row(i).target];
  return static_cast<int>(std::max_element(seen.begin(), seen.end()) - seen.begin());
}

// Places where a calibration says that targets were, known ones as they are known.
PlacesAnswer placed(const PosedRows& rows, const Transform& a, double limit, Random& random) {
  PlacesAnswer at;
  at.a = a;
  for (int k = 0; k < rows.targets(); ++k) {
    const PosedTarget& target = rows.target(k);
    if (!target.nothing_known()) {
      at.places.push_back(target.prior);
      continue;
    }
    std::vector<Vector3d> seen;
    for (int i = 0; i < rows.size(); ++i)
      if (rows.row(i).target == k) seen.push_back(rows.seen(a, 0, i));
    at.places.push_back(place_seen(seen, target.prior.spans, limit, random));
  }
  return at;
}

PlaceLevels at_least(PlaceLevels levels, PlaceLevels expected) {
  return {std::max(levels.px, expected.px), std::max(levels.mm, expected.mm)};
}

// Rows that agree, and the fit to them, in turn, from the rows that agree now.
void settle(const PosedRows& rows, const Unknowns& unknowns, const PlacesNoise& noise,
            std::vector<int>& chosen, PlacesFit& fit) {
  for (int round = 0; round < kChoiceRounds; ++round) {
    fit = fit_places(rows, chosen, unknowns, noise, fit.answer);
    const std::vector<double> chi =
        chi_squared(rows, fit.answer, at_least(fit.levels, noise.expected), noise.rad_per_mm);
    std::vector<int> now;
    for (int i = 0; i < rows.size(); ++i)
      if (chi[i] < kOutlier[fit.answer.places[rows.row(i).target].normals()]) now.push_back(i);
    if (now == chosen || static_cast<int>(now.size()) * 3 < unknowns.count) break;
    chosen = std::move(now);
  }
}

FoundPlaces fitted(const PosedRows& rows, const PlacesOptions& options, const PlacesNoise& noise,
                   PlacesAnswer at, double limit) {
  const Unknowns unknowns(rows, options.scales, options.lag);
  std::vector<int> chosen;
  for (int i = 0; i < rows.size(); ++i)
    if (rows.square(at, i) < limit) chosen.push_back(i);
  FoundPlaces found;
  found.fit.answer = std::move(at);
  // Levels that are estimated while outliers are among the rows grow until these agree.
  settle(rows, unknowns, {noise.expected, false, noise.rad_per_mm}, chosen, found.fit);
  if (noise.estimated) settle(rows, unknowns, noise, chosen, found.fit);
  found.growth = noise_growth(rows, chosen, unknowns, at_least(found.fit.levels, noise.expected),
                              noise.rad_per_mm, found.fit.answer, options.search.seed);
  found.inlier.assign(rows.size(), false);
  for (int i : chosen) found.inlier[i] = true;
  for (int i = 0; i < rows.size(); ++i)
    found.distances.push_back(std::sqrt(rows.square(found.fit.answer, i)) * rows.normalisation().size);
  return found;
}

// What rows cost, all answers by the same levels: the least that one of them has.
void weigh(const PosedRows& rows, const PlacesNoise& noise, std::vector<FoundPlaces>& all) {
  PlaceLevels levels{1e300, 1e300};
  for (const FoundPlaces& found : all) {
    const PlaceLevels own = at_least(found.fit.levels, noise.expected);
    levels = {std::min(levels.px, own.px), std::min(levels.mm, own.mm)};
  }
  for (FoundPlaces& found : all) {
    const std::vector<double> chi = chi_squared(rows, found.fit.answer, levels, noise.rad_per_mm);
    for (int i = 0; i < rows.size(); ++i)
      found.cost += std::min(chi[i], kOutlier[found.fit.answer.places[rows.row(i).target].normals()]);
  }
  sort_by(all, [](const FoundPlaces& one) { return one.cost; });
}

bool same(const PosedRows& rows, const PlacesAnswer& a, const PlacesAnswer& b, double limit) {
  for (int i = 0; i < rows.size(); ++i)
    if ((a.a.apply(rows.row(i).x) - b.a.apply(rows.row(i).x)).squaredNorm() > limit) return false;
  return true;
}

}  // namespace

std::vector<FoundPlaces> find_places(const PosedRows& rows, const PosedTable& table,
                                     const PlacesOptions& options) {
  const Normalisation& n = rows.normalisation();
  const double limit = std::pow(options.search.threshold_mm / n.size, 2);
  const PlacesNoise noise{
      {std::pow(options.level_px / n.image_size, 2), std::pow(options.level_mm / n.size, 2)},
      !options.levels_known,
      options.rad_per_mm * n.size};
  Random random(options.search.seed ^ 0x5eed);
  std::vector<Transform> starts;
  if (options.start) {
    starts.push_back(n.to_normalised(*options.start));
  } else {
    const PosedRows lead(table, lead_of(rows));
    for (const PlaceCandidate& candidate : search_place(lead, options.scales, options.search)) {
      starts.push_back(n.to_normalised(lead.normalisation().to_original(candidate.answer.a)));
      if (starts.size() == kFitted) break;
    }
  }
  std::vector<FoundPlaces> all;
  const Unknowns unknowns(rows, options.scales, false);
  std::vector<int> every(rows.size());
  for (int i = 0; i < rows.size(); ++i) every[i] = i;
  for (const Transform& start : starts) {
    PlacesAnswer at = placed(rows, start, limit, random);
    if (!options.start) {
      Descent how;
      how.scale = std::sqrt(limit);
      descend(rows, every.data(), rows.size(), unknowns, how, at);
    }
    FoundPlaces found = fitted(rows, options, noise, at, limit);
    if (!found.fit.answer.a.matrix().allFinite()) continue;
    const bool again = std::any_of(all.begin(), all.end(), [&](const FoundPlaces& other) {
      return same(rows, other.fit.answer, found.fit.answer, limit / 25);
    });
    if (!again) all.push_back(std::move(found));
  }
  weigh(rows, noise, all);
  return all;
}

}  // namespace sonocal
