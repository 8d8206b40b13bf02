// Trials of studies without Python, to run under sanitizers: every method, and the bound of the covariance.
#include <Eigen/Geometry>

#include "check.hpp"
#include "scenes.hpp"
#include "sonocal/solvers/batch.hpp"
#include "sonocal/study/trial.hpp"

using namespace sonocal;

namespace {

std::vector<Method> methods(int dimension) {
  std::vector<Method> out{{Solver::kClosedForm, Weighting::kGeometric},
                          {Solver::kClosedForm, Weighting::kLikelihood},
                          {Solver::kTwoLines, Weighting::kGeometric},
                          {Solver::kLinear, Weighting::kGeometric}};
  if (dimension == 2) out.push_back({Solver::kFourPoints, Weighting::kGeometric});
  return out;
}

Options options(std::uint64_t seed = 1) {
  Options out;
  out.threshold_mm = 5;
  out.consensus.max_samples = 400;
  out.consensus.seed = seed;
  return out;
}

void methods_find_the_truth() {
  for (const int dimension : {2, 3})
    for (const Method& method : methods(dimension)) {
      const Scene scene(dimension, 30, 6, 11);
      const TrialAnswer answer = run_trial(scene.table(), method, options());
      check(answer.start.has_value(), "a method has an answer");
      check(answer.refined && scene.near_truth(*answer.refined), "which refined is the truth");
    }
}

void too_few_rows() {
  for (const int dimension : {2, 3})
    for (const int seen : {0, 1, 2, 3, 4, 5})
      for (const Method& method : methods(dimension)) {
        const Scene scene(dimension, seen, 0, 12);
        const TrialAnswer answer = run_trial(scene.table(), method, options());
        check(seen > 1 || !answer.start, "one sighting determines nothing");
      }
}

std::vector<Matrix4d> answers(const Scene& scene, const Method& method, int threads) {
  constexpr int kTrials = 130;  // more than two threads' blocks
  std::vector<Matrix4d> out(kTrials);
  in_threads(kTrials, threads, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      const TrialAnswer answer = run_trial(scene.table(), method, options(i));
      out[i] = answer.start ? answer.start->matrix() : Matrix4d::Zero();
    }
  });
  return out;
}

void threads_change_nothing() {
  const Scene scene(2, 10, 2, 13);
  const Method method{Solver::kClosedForm, Weighting::kGeometric};
  const auto one = answers(scene, method, 1);
  check(one == answers(scene, method, 2) && one == answers(scene, method, 5), "threads change no trial");
}

// Another marker: y becomes turn y + shift.
void moving_the_marker_moves_the_answer() {
  const Matrix3d turn = Eigen::AngleAxisd(0.7, Vector3d(1, 2, 2) / 3).toRotationMatrix();
  const Vector3d shift(10, -20, 5);
  for (const int dimension : {2, 3}) {
    const Scene scene(dimension, 30, 6, 14);
    Scene moved = scene;
    for (int i = 0; i < 2 * scene.rows; ++i) {
      const Eigen::Map<const Vector3d> from(&scene.segments[3 * i]);
      Eigen::Map<Vector3d>(&moved.segments[3 * i]) = turn * from + shift;
    }
    moved.truth.rotation = turn * scene.truth.rotation;
    moved.truth.translation = turn * scene.truth.translation + shift;
    const Method method{Solver::kClosedForm, Weighting::kGeometric};
    const auto here = run_trial(scene.table(), method, options()).refined;
    const auto there = run_trial(moved.table(), method, options()).refined;
    check(here && there && (turn * here->linear() - there->linear()).norm() < 1e-6, "turned with the marker");
    check(here && there && (turn * here->translation + shift - there->translation).norm() < 1e-4,
          "and moved");
  }
}

Eigen::Matrix<double, 7, 7> bound(const Scene& scene, double px, double mm, int used) {
  std::vector<char> sound(scene.rows, 0);
  std::fill_n(sound.begin(), used, 1);
  Options o = options();
  o.levels = {px, mm};
  return cramer_rao_bound(scene.table(), reinterpret_cast<const bool*>(sound.data()), scene.truth, o);
}

void the_bound_grows_with_noise_and_shrinks_with_rows() {
  for (const int dimension : {2, 3}) {
    const Scene scene(dimension, 30, 0, 15);
    const auto all = bound(scene, 0.5, 0.2, scene.rows),
               half = bound(scene, 0.5, 0.2, scene.rows / 2 / 2 * 2);
    check((all - all.transpose()).norm() < 1e-9 * all.norm(), "a covariance is symmetric");
    check((4 * all - bound(scene, 1.0, 0.4, scene.rows)).norm() < 1e-6 * all.norm(), "twice the noise");
    check((half.diagonal() - all.diagonal()).minCoeff() > 0, "fewer rows tell less");
    check(bound(scene, 0.5, 0.2, 2).hasNaN() && bound(scene, 0.5, 0.2, 0).hasNaN(),
          "and two leave motions free");
  }
}

}  // namespace

int main() {
  methods_find_the_truth();
  too_few_rows();
  threads_change_nothing();
  moving_the_marker_moves_the_answer();
  the_bound_grows_with_noise_and_shrinks_with_rows();
  return summary("studies");
}
