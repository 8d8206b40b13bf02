// The whole estimate without Python, to run under sanitizers: sound, hopeless and broken tables.
#include <limits>

#include "check.hpp"
#include "scenes.hpp"
#include "sonocal/correspondences/correspondences.hpp"
#include "sonocal/estimate/estimate.hpp"
#include "sonocal/estimate/white_residuals.hpp"

using namespace sonocal;

namespace {

Options options(Weighting weighting, Model model, double threshold) {
  Options out;
  out.weighting = weighting;
  out.model = model;
  out.threshold_mm = threshold;
  return out;
}

bool near_truth(const Estimate& e, const Scene& scene) { return e.found && scene.near_truth(e.transform); }

void sound() {
  for (const int dimension : {2, 3})
    for (const Weighting weighting : {Weighting::kGeometric, Weighting::kLikelihood})
      for (const double threshold : {5.0, 0.0})
        for (const int seen : {7, 40, 9000}) {
          const Scene scene(dimension, seen, seen / 5, 3 + seen);
          const Estimate e = estimate(scene.table(), options(weighting, Model::kSimilarity, threshold));
          check(near_truth(e, scene), "the truth is estimated");
          check(e.squares.size() == scene.rows && e.covariance.allFinite(), "and its covariance");
          if (dimension == 2 && seen > 7)
            check(near_truth(estimate(scene.table(), options(weighting, Model::kAnisotropic, 5.0)), scene),
                  "with two scales, too");
        }
}

void refinement_and_residuals() {
  for (const int dimension : {2, 3}) {
    const Scene scene(dimension, 30, 0, 5);
    const std::vector<char> all(scene.rows, 1);
    const bool* chosen = reinterpret_cast<const bool*>(all.data());
    Options o = options(Weighting::kLikelihood, Model::kSimilarity, 5.0);
    check(near_truth(refine_chosen(scene.table(), chosen, scene.truth, o), scene), "refined from the truth");
    o.levels = {0.2, 0.05};
    const WhiteResiduals white = white_residuals(scene.table(), chosen, scene.truth, o);
    check(white.jacobian.rows() == 2 * scene.rows && white.jacobian.allFinite(), "white residuals");
  }
}

void few_and_broken() {
  for (const int dimension : {2, 3})
    for (const int seen : {0, 1, 2, 3, 4}) {
      const Scene scene(dimension, seen, 0, 6);
      const Estimate e = estimate(scene.table(), options(Weighting::kLikelihood, Model::kSimilarity, 5.0));
      check(!e.found || e.inliers >= 0, "few rows");
    }
  for (const double bad :
       {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity(), 0.0, 1e300}) {
    Scene scene(2, 12, 0, 7);
    for (int i = 0; i < 12; ++i) scene.segments[6 * i] = bad;
    const Estimate e = estimate(scene.table(), options(Weighting::kLikelihood, Model::kSimilarity, 5.0));
    check(!e.found || e.squares.size() == 12, "broken rows");
  }
}

void correspondences() {
  const Scene scene(3, 12, 3, 8);
  std::vector<double> points, planes;
  std::vector<std::int32_t> first{0};
  for (int i = 0; i < scene.rows; ++i) {
    const Eigen::Map<const Vector3d> x(&scene.points[3 * i]), a(&scene.segments[6 * i]),
        b(&scene.segments[6 * i + 3]);
    PointOnPlane rows[2];
    planes_of_line(x, a, (b - a).normalized(), rows);
    for (const auto& row : rows) {
      points.insert(points.end(), row.point.data(), row.point.data() + 3);
      planes.insert(planes.end(), row.normal.data(), row.normal.data() + 3);
      planes.push_back(row.offset);
    }
    if (i % 2 == 1) first.push_back(2 * (i + 1));
  }
  const CorrespondenceEstimate e = estimate(Correspondences{points.data(), planes.data(), first.data(), 12},
                                            CorrespondenceOptions{1.0, true, {}});
  check(e.found && e.inliers == 9, "the sound correspondences of a mix");
}

}  // namespace

int main() {
  sound();
  refinement_and_residuals();
  few_and_broken();
  correspondences();
  return summary("estimates");
}
