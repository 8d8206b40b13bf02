#include "sonocal/correspondences/label_grid.hpp"

#include <algorithm>
#include <cmath>

#include "sonocal/linalg/vectors.hpp"

namespace sonocal {
namespace {

// Of the box that holds all dots, beyond it on every side.
constexpr double kGridMargin = 0.06;
// A wire that runs along the image crosses it nowhere in particular: cosine to the image's normal.
constexpr float kAlongImage = 0.05f;

// Where wires cross an image, for many at once.
SONOCAL_WIDEST_VECTORS void crossings(const float* wires, int stride, int count, const float (&r)[9],
                                      const float (&t)[3], float per_scale, float* u, float* v) {
  const float *px = wires, *py = px + stride, *pz = py + stride;
  const float *dx = pz + stride, *dy = dx + stride, *dz = dy + stride;
#pragma omp simd
  for (int i = 0; i < count; ++i) {
    const float x = px[i] - t[0], y = py[i] - t[1], z = pz[i] - t[2];
    const float across = r[6] * dx[i] + r[7] * dy[i] + r[8] * dz[i];
    const float along = -(r[6] * x + r[7] * y + r[8] * z) / across;
    const float cx = x + along * dx[i], cy = y + along * dy[i], cz = z + along * dz[i];
    const bool crosses = across > kAlongImage || across < -kAlongImage;
    u[i] = crosses ? per_scale * (r[0] * cx + r[1] * cy + r[2] * cz) : 1e9f;
    v[i] = crosses ? per_scale * (r[3] * cx + r[4] * cy + r[5] * cz) : 1e9f;
  }
}

}  // namespace

LabelGrid::LabelGrid(const LabelScene& scene, std::vector<int> frames)
    : scene_(scene), frames_(std::move(frames)), stride_((scene.wires() + 15) / 16 * 16) {
  const Vector2d margin = kGridMargin * (scene.high() - scene.low()).cwiseMax(0.05);
  const Vector2d low = scene.low() - margin, side = scene.high() + margin - low;
  low_u_ = static_cast<float>(low.x()), low_v_ = static_cast<float>(low.y());
  per_u_ = static_cast<float>(kCells / side.x()), per_v_ = static_cast<float>(kCells / side.y());
  wires_.assign(frames_.size() * 6 * stride_, 0.0f);
  cells_.assign(frames_.size() * kCells * kCells, -1);
  for (std::size_t k = 0; k < frames_.size(); ++k) {
    const int f = frames_[k], first = scene.first(f);
    for (int w = 0; w < scene.wires(); ++w)
      for (int axis = 0; axis < 3; ++axis) {
        wires_[(k * 6 + axis) * stride_ + w] = static_cast<float>(scene.foot(f, w)[axis]);
        wires_[(k * 6 + 3 + axis) * stride_ + w] = static_cast<float>(scene.direction(f, w)[axis]);
      }
    for (int cell = 0; cell < kCells * kCells; ++cell) {
      const Vector2d at = low + Vector2d((cell % kCells + 0.5) * side.x() / kCells,
                                         (cell / kCells + 0.5) * side.y() / kCells);
      double least = 1e300;
      for (int i = 0; i < scene.dots(f); ++i) {
        const double square = (scene.dot(first + i) - at).squaredNorm();
        if (square >= least) continue;
        least = square;
        cells_[k * kCells * kCells + cell] = static_cast<std::int16_t>(i);
      }
    }
  }
}

void LabelGrid::match(const Transform& a, int k, float limit, Nearest& out) const {
  float u[kMostWires + 1], v[kMostWires + 1], r[9], t[3];
  for (int column = 0; column < 3; ++column) {
    t[column] = static_cast<float>(a.translation[column]);
    for (int row = 0; row < 3; ++row) r[3 * column + row] = static_cast<float>(a.rotation(row, column));
  }
  const float s = static_cast<float>(a.scales[0]);
  const float* wires = wires_.data() + static_cast<std::size_t>(k) * 6 * stride_;
  const int count = scene_.wires(), first = scene_.first(frames_[k]), dots = scene_.dots(frames_[k]);
  crossings(wires, stride_, count, r, t, 1 / s, u, v);
  std::fill_n(out.square.begin(), dots, limit);
  const std::int16_t* cells = cells_.data() + static_cast<std::size_t>(k) * kCells * kCells;
  for (int w = 0; w < count; ++w) {
    const float gu = (u[w] - low_u_) * per_u_, gv = (v[w] - low_v_) * per_v_;
    if (!(gu >= 0 && gv >= 0 && gu < kCells && gv < kCells)) continue;
    const int dot = cells[static_cast<int>(gv) * kCells + static_cast<int>(gu)];
    if (dot < 0) continue;
    const Vector2d x = scene_.dot(first + dot);
    const float du = s * (static_cast<float>(x.x()) - u[w]), dv = s * (static_cast<float>(x.y()) - v[w]);
    const float fx = du * r[0] + dv * r[3], fy = du * r[1] + dv * r[4], fz = du * r[2] + dv * r[5];
    const float along =
        fx * wires[3 * stride_ + w] + fy * wires[4 * stride_ + w] + fz * wires[5 * stride_ + w];
    const float square = std::max(fx * fx + fy * fy + fz * fz - along * along, 0.0f);
    if (square >= out.square[dot]) continue;
    out.square[dot] = square;
    out.wire[dot] = static_cast<std::int16_t>(w);
  }
}

double LabelGrid::quality(const Transform& a, int k, double reach) const {
  Nearest nearest;
  const float limit = static_cast<float>(reach * reach);
  match(a, k, limit, nearest);
  float sum = 0;
  const int dots = scene_.dots(frames_[k]);
  for (int i = 0; i < dots; ++i) sum += limit - nearest.square[i];
  return sum / limit;
}

void LabelGrid::pairs(const Transform& a, int k, double reach, std::vector<DotOnWire>& out) const {
  Nearest nearest;
  const float limit = static_cast<float>(reach * reach);
  match(a, k, limit, nearest);
  const int first = scene_.first(frames_[k]);
  for (int i = 0; i < scene_.dots(frames_[k]); ++i)
    if (nearest.square[i] < limit) out.push_back({first + i, nearest.wire[i], nearest.square[i]});
}

}  // namespace sonocal
