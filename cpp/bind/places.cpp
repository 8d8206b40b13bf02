// Targets whose place is asked for with the calibration.
#include <nanobind/stl/optional.h>
#include <nanobind/stl/vector.h>

#include <optional>

#include "bind/arrays.hpp"
#include "bind/checks.hpp"
#include "sonocal/places/find_places.hpp"

using namespace nb::literals;
using namespace sonocal;

namespace {

using PosedPoints = In<double, nb::shape<-1, 3>>;
using PosedPoses = In<double, nb::shape<-1, 3, 4>>;
using PosedCodes = In<std::int32_t, nb::shape<-1>>;
using PosedSpanning = In<double, nb::shape<-1, 3, 3>>;
using PosedNumbers = In<double, nb::shape<-1>>;

constexpr int kMostTargets = 64;

// An answer in the units that it was asked in.
struct FoundPlacesOut {
  Transform transform;
  double lag_s, level_px, level_mm, freedom, cost, growth;
  Eigen::MatrixXd covariance, nominal;
  Eigen::VectorXd motion;
  std::vector<Place> places;
  std::vector<double> distances;
  std::vector<bool> inlier;
};

void check_table(const PosedPoints& points, const PosedPoses& poses, const std::optional<PosedPoses>& changes,
                 const PosedCodes& group, const PosedCodes& target, int dimension) {
  const std::size_t rows = points.shape(0);
  require(dimension == 2 || dimension == 3, "dimension is neither 2 nor 3");
  require(rows > 0 && rows <= kMostRows, "a table has between one row and 2^28");
  require(poses.shape(0) == rows && group.shape(0) == rows && target.shape(0) == rows &&
              (!changes || changes->shape(0) == rows),
          "the arrays differ in their number of rows");
  check_finite(points.data(), rows * 3, "points");
  check_finite(poses.data(), rows * 12, "poses");
  if (changes) check_finite(changes->data(), rows * 12, "changes");
  for (std::size_t i = 1; i < rows; ++i)
    require(group.data()[i] >= group.data()[i - 1], "rows of one instant do not stand together");
  for (std::size_t i = 0; i < rows; ++i) {
    const Eigen::Map<const Eigen::Matrix<double, 3, 4, Eigen::RowMajor>> pose(poses.data() + 12 * i);
    const Matrix3d turned = pose.leftCols<3>();
    require((turned.transpose() * turned - Matrix3d::Identity()).cwiseAbs().maxCoeff() < 1e-6 &&
                determinant(turned) > 0,
            "a pose is not rigid");
  }
}

void check_targets(const PosedCodes& target, const PosedCodes& spans, const PosedSpanning& spanning,
                   const PosedNumbers& sigma_mm, const PosedNumbers& sigma_rad, const PosedCodes& body) {
  const std::size_t count = spans.shape(0);
  require(count > 0 && count <= kMostTargets, "between one target and 64 are asked for");
  require(spanning.shape(0) == count && sigma_mm.shape(0) == count && sigma_rad.shape(0) == count &&
              body.shape(0) == count,
          "the arrays differ in their number of targets");
  check_finite(spanning.data(), count * 9, "spanning");
  for (std::size_t i = 0; i < target.shape(0); ++i)
    require(target.data()[i] >= 0 && static_cast<std::size_t>(target.data()[i]) < count,
            "target holds a number below 0, or not below the number of targets");
  for (std::size_t k = 0; k < count; ++k) {
    require(spans.data()[k] >= 1 && spans.data()[k] <= 3, "a target is spanned by one, two or three points");
    require(sigma_mm.data()[k] >= 0 && sigma_rad.data()[k] >= 0, "a standard deviation is below 0");
  }
}

FoundPlacesOut to_out(const PosedRows& rows, const FoundPlaces& found, int scales) {
  const Normalisation& n = rows.normalisation();
  FoundPlacesOut out;
  out.transform = n.to_original(found.fit.answer.a);
  out.lag_s = found.fit.answer.lag;
  out.level_px = std::sqrt(found.fit.levels.px) * n.image_size;
  out.level_mm = std::sqrt(found.fit.levels.mm) * n.size;
  out.freedom = found.fit.freedom;
  out.cost = found.cost;
  const Eigen::Index p = found.fit.covariance.rows();
  Eigen::MatrixXd map = Eigen::MatrixXd::Identity(p, p);
  if (scales == 1)
    map.topLeftCorner<7, 7>() = tangent_to_original<7>(out.transform, n);
  else
    map.topLeftCorner<8, 8>() = tangent_to_original<8>(out.transform, n);
  Eigen::Index at = p;
  for (int k = rows.targets(); k-- > 0;) {
    out.places.insert(out.places.begin(), rows.to_original(found.fit.answer.places[k], k));
    if (rows.target(k).known()) continue;
    const Place& place = found.fit.answer.places[k];
    at -= place.freedom();
    for (int i = 0; i < place.normals(); ++i) map(at + i, at + i) = n.size;
  }
  out.covariance = map * found.fit.covariance * map.transpose();
  out.nominal = map * found.fit.nominal * map.transpose();
  out.growth = found.growth.factor;
  out.motion = map * found.growth.motion;
  out.distances = found.distances;
  out.inlier = found.inlier;
  return out;
}

std::vector<FoundPlacesOut> find(PosedPoints points, PosedPoses poses, std::optional<PosedPoses> changes,
                                 PosedCodes group, PosedCodes target, PosedCodes spans,
                                 PosedSpanning spanning, PosedNumbers sigma_mm, PosedNumbers sigma_rad,
                                 PosedCodes body, int dimension,
                                 std::optional<In<double, nb::shape<4, 4>>> start, int scales,
                                 double level_px, double level_mm, double rad_per_mm, bool levels_known,
                                 double threshold_mm, int max_samples, std::uint64_t seed) {
  check_table(points, poses, changes, group, target, dimension);
  check_targets(target, spans, spanning, sigma_mm, sigma_rad, body);
  require(scales == 1 || scales == 2, "scales is neither 1 nor 2");
  for (double level : {level_px, level_mm, threshold_mm})
    require(usable(level) && level > 0, "a level or a threshold is not a positive number");
  require(usable(rad_per_mm) && rad_per_mm >= 0, "rad_per_mm is not a number from 0 on");
  require(max_samples >= 1 && max_samples <= kMostSamples, "max_samples is not between 1 and 2^30");
  const PosedTable table{points.data(),
                         poses.data(),
                         changes ? changes->data() : nullptr,
                         group.data(),
                         target.data(),
                         static_cast<int>(points.shape(0)),
                         dimension,
                         spans.data(),
                         spanning.data(),
                         sigma_mm.data(),
                         sigma_rad.data(),
                         body.data(),
                         static_cast<int>(spans.shape(0))};
  PlacesOptions options;
  options.scales = scales;
  options.lag = changes.has_value();
  options.level_px = level_px;
  options.level_mm = level_mm;
  options.rad_per_mm = rad_per_mm;
  options.levels_known = levels_known;
  options.search.threshold_mm = threshold_mm;
  options.search.most_samples = max_samples;
  options.search.seed = seed;
  if (start) {
    const Eigen::Map<const Eigen::Matrix<double, 4, 4, Eigen::RowMajor>> matrix(start->data());
    check_finite(start->data(), 16, "start");
    Transform a;
    const Matrix3d linear = matrix.topLeftCorner<3, 3>();
    for (int axis = 0; axis < 3; ++axis) a.scales[axis] = linear.col(axis).norm();
    require(a.scales.minCoeff() > 0, "start has a column of zeros");
    a.rotation = orthonormal(linear * a.scales.cwiseInverse().asDiagonal());
    a.translation = matrix.topRightCorner<3, 1>();
    options.start = a;
  }
  nb::gil_scoped_release unlocked;
  const PosedRows rows(table);
  std::vector<FoundPlacesOut> out;
  for (const FoundPlaces& found : find_places(rows, table, options))
    out.push_back(to_out(rows, found, scales));
  return out;
}

}  // namespace

void bind_places(nb::module_& m) {
  const auto owned = nb::rv_policy::automatic;
  nb::class_<FoundPlacesOut>(m, "FoundPlaces", "A calibration and places that agree with the rows.")
      .def_prop_ro(
          "rotation", [](const FoundPlacesOut& f) { return to_numpy(f.transform.rotation); }, owned)
      .def_prop_ro(
          "translation", [](const FoundPlacesOut& f) { return to_numpy(f.transform.translation); }, owned)
      .def_prop_ro(
          "scales", [](const FoundPlacesOut& f) { return to_numpy(f.transform.scales); }, owned)
      .def_ro("lag_s", &FoundPlacesOut::lag_s)
      .def_ro("level_px", &FoundPlacesOut::level_px)
      .def_ro("level_mm", &FoundPlacesOut::level_mm)
      .def_ro("freedom", &FoundPlacesOut::freedom)
      .def_ro("cost", &FoundPlacesOut::cost)
      .def_ro("growth", &FoundPlacesOut::growth)
      .def_prop_ro(
          "motion", [](const FoundPlacesOut& f) { return to_numpy(f.motion); }, owned)
      .def_prop_ro(
          "covariance", [](const FoundPlacesOut& f) { return to_numpy(f.covariance); }, owned)
      .def_prop_ro(
          "nominal", [](const FoundPlacesOut& f) { return to_numpy(f.nominal); }, owned)
      .def_prop_ro(
          "bases",
          [](const FoundPlacesOut& f) {
            Eigen::MatrixXd bases(f.places.size(), 3);
            for (std::size_t k = 0; k < f.places.size(); ++k) bases.row(k) = f.places[k].base;
            return to_numpy(bases);
          },
          owned)
      .def_prop_ro(
          "axes",
          [](const FoundPlacesOut& f) {
            std::vector<double> axes;
            for (const Place& place : f.places)
              for (int r = 0; r < 3; ++r)
                for (int c = 0; c < 3; ++c) axes.push_back(place.axes(r, c));
            return make_array(std::move(axes), {f.places.size(), 3, 3});
          },
          owned)
      .def_prop_ro(
          "distances", [](const FoundPlacesOut& f) { return make_array(f.distances, {f.distances.size()}); },
          owned)
      .def_prop_ro(
          "inlier",
          [](const FoundPlacesOut& f) {
            auto* values = new std::vector<std::uint8_t>(f.inlier.begin(), f.inlier.end());
            nb::capsule owner(values,
                              [](void* p) noexcept { delete static_cast<std::vector<std::uint8_t>*>(p); });
            return nb::ndarray<nb::numpy, bool, nb::c_contig>(values->data(), {values->size()}, owner);
          },
          owned);
  m.def("find_places", &find, "points"_a.noconvert(), "poses"_a.noconvert(), "changes"_a.none(),
        "group"_a.noconvert(), "target"_a.noconvert(), "spans"_a.noconvert(), "spanning"_a.noconvert(),
        "sigma_mm"_a.noconvert(), "sigma_rad"_a.noconvert(), "body"_a.noconvert(), nb::kw_only(),
        "dimension"_a, "start"_a.none() = nb::none(), "scales"_a = 1, "level_px"_a = 1.0, "level_mm"_a = 0.3,
        "rad_per_mm"_a = 0.0116, "levels_known"_a = false, "threshold_mm"_a = 5.0, "max_samples"_a = 400,
        "seed"_a = 0);
}
