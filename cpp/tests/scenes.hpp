// Tables of needles seen by a probe, with their truth, for the tests of estimates and studies.
#pragma once

#include "problems.hpp"
#include "sonocal/estimate/table.hpp"

namespace sonocal {

// A table of one scene: 2D, or 3D with two rows a sighting; the first `wrong` sightings see nothing of
// theirs.
struct Scene {
  int dimension, rows;
  Transform truth;
  std::vector<double> points, segments;
  std::vector<std::int32_t> sightings, frames, targets;

  Scene(int dimension, int seen, int wrong, std::uint64_t seed) : dimension(dimension) {
    Random random(seed);
    const Problems one = make_problems(false, 1, seed);
    truth = one.truth[0];
    const int each = dimension - 1;
    rows = seen * each;
    for (int s = 0; s < seen; ++s) {
      Vector3d image[2], place[2];
      for (int i = 0; i < 2; ++i) {
        image[i] = {uniform(random, 0, 500), uniform(random, 0, 500),
                    dimension == 2 ? 0.0 : uniform(random, 0, 500)};
        place[i] = truth.apply(image[i]) + 0.05 * direction(random);
        if (s < wrong) place[i] += 60 * direction(random);
      }
      const Vector3d along = dimension == 2 ? direction(random) : (place[1] - place[0]).normalized();
      const Vector3d ends[2] = {place[0] - 100 * along, place[0] + 200 * along};
      for (int i = 0; i < each; ++i) {
        points.insert(points.end(), image[i].data(), image[i].data() + 3);
        for (const Vector3d& end : ends) segments.insert(segments.end(), end.data(), end.data() + 3);
        sightings.push_back(s);
        frames.push_back(s / 2);
        targets.push_back(s % 3);
      }
    }
  }
  Table table() const {
    return {points.data(),
            segments.data(),
            dimension == 3 ? sightings.data() : nullptr,
            {frames.data(), targets.data()},
            {},
            rows,
            dimension};
  }
  // Whether a transform carries the image's middle to within a millimetre of where it is.
  bool near_truth(const Transform& a) const {
    const Vector3d middle(250, 250, dimension == 2 ? 0 : 250);
    return (a.apply(middle) - truth.apply(middle)).norm() < 1;
  }
};

}  // namespace sonocal
