// The whole estimate without Python, to run under sanitizers: sound, hopeless and broken tables.
#include <Eigen/LU>
#include <cmath>
#include <limits>

#include "check.hpp"
#include "scenes.hpp"
#include "sonocal/correspondences/correspondences.hpp"
#include "sonocal/estimate/estimate.hpp"
#include "sonocal/estimate/likelihood.hpp"
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

// Points on needles of one sighting each, 1 to 5 of them.
struct Uneven {
  std::vector<double> points, segments;
  std::vector<std::int32_t> codes;

  explicit Uneven(const Transform& truth) {
    Random random(16);
    for (int size = 1; size <= 5; ++size)
      for (int repeat = 0; repeat < 3; ++repeat) {
        const Vector3d middle = truth.apply({250, 250, 250}) + 30 * direction(random),
                       along = direction(random);
        for (int i = 0; i < size; ++i) {
          const Vector3d place = middle + uniform(random, -60, 60) * along + direction(random);
          const Vector3d image = truth.rotation.transpose() * (place - truth.translation) / truth.scales[0];
          points.insert(points.end(), image.data(), image.data() + 3);
          for (const Vector3d& end : {Vector3d(middle - 80 * along), Vector3d(middle + 120 * along)})
            segments.insert(segments.end(), end.data(), end.data() + 3);
          codes.push_back(3 * size - 3 + repeat);
        }
      }
  }
  int rows() const { return static_cast<int>(codes.size()); }
};

// -2 log likelihood of one sighting by its whole covariance, px^2 s^2 + mm^2 (1 + tau_j tau_k) / 2.
double dense_deviance(const PointLines& rows, Sightings::Range members, const Transform& a,
                      NoiseLevels levels) {
  const Normalisation& n = rows.normalisation();
  const int size = members.size(), first = members[0];
  Eigen::MatrixXd residuals(size, 2);
  Eigen::VectorXd tau(size);
  for (int j = 0; j < size; ++j) {
    const Vector3d y = a.apply(rows.point(members[j]));
    tau[j] = (rows.direction(first).dot(y) - rows.middle(first)) / rows.half_length(first);
    for (int k = 0; k < 2; ++k) residuals(j, k) = rows.normal(first, k).dot(y) + rows.offset(first, k);
  }
  const double px = levels.px / n.image_size * a.scales[0], mm = levels.mm / n.size;
  const Eigen::MatrixXd ones = Eigen::MatrixXd::Ones(size, size);
  const Eigen::MatrixXd v =
      px * px * Eigen::MatrixXd::Identity(size, size) + 0.5 * mm * mm * (ones + tau * tau.transpose());
  return (residuals.transpose() * v.inverse() * residuals).trace() + 2 * std::log(v.determinant());
}

void any_number_of_points_shares_its_noise() {
  const Scene scene(3, 2, 0, 16);
  const Uneven uneven(scene.truth);
  const PointLines rows(uneven.points.data(), uneven.segments.data(), uneven.rows(), 3);
  const Sightings sightings = Sightings::of_codes(uneven.codes.data(), uneven.rows());
  const NoiseModel noise(rows, sightings, {}, PointLines::Column::Zero(uneven.rows()), 1);
  Transform at = rows.normalisation().to_normalised(scene.truth);
  for (const NoiseLevels levels : {NoiseLevels{0.5, 0.3}, NoiseLevels{2, 0.1}, NoiseLevels{0.1, 2}}) {
    double whole = 0;
    for (int i = 0; i < sightings.size(); ++i) whole += dense_deviance(rows, sightings[i], at, levels);
    const double split = deviance(noise, at, levels);
    check(std::fabs(split - whole) < 1e-8 * std::fabs(whole), "split or whole, a sighting is as likely");
    at.translation += Vector3d(0.01, -0.02, 0.01);
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
  any_number_of_points_shares_its_noise();
  correspondences();
  return summary("estimates");
}
