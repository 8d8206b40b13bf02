#include "sonocal/correspondences/unit_rows.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "sonocal/linalg/small.hpp"
#include "sonocal/linalg/vectors.hpp"

namespace sonocal {
namespace {

constexpr int kUnits = UnitBlock::kUnits, kFields = UnitBlock::kFields;
// A transform as good as the best so far is given up in error once in some thousand times.
constexpr double kDeviations = 3;

// A transform as plain numbers: a local copy stays in registers.
struct Linear {
  explicit Linear(const Transform& a) {
    const Matrix3d linear = a.linear();
    for (int i = 0; i < 3; ++i) {
      for (int j = 0; j < 3; ++j) s[i][j] = linear(i, j);
      t[i] = a.translation[i];
    }
  }
  double s[3][3], t[3];
};

[[gnu::always_inline]] inline void squares_of(const Linear& a, const UnitBlock& block,
                                              double* __restrict out) {
  for (int i = 0; i < kUnits; ++i) out[i] = 0;
  for (int row = 0; row < block.rows; ++row) {
    const double* __restrict d = block.data + row * kFields * kUnits;
#pragma omp simd
    for (int i = 0; i < kUnits; ++i) {
      const double x0 = d[i], x1 = d[kUnits + i], x2 = d[2 * kUnits + i];
      const double y0 = a.s[0][0] * x0 + a.s[0][1] * x1 + a.s[0][2] * x2 + a.t[0];
      const double y1 = a.s[1][0] * x0 + a.s[1][1] * x1 + a.s[1][2] * x2 + a.t[1];
      const double y2 = a.s[2][0] * x0 + a.s[2][1] * x1 + a.s[2][2] * x2 + a.t[2];
      const double r =
          d[3 * kUnits + i] * y0 + d[4 * kUnits + i] * y1 + d[5 * kUnits + i] * y2 + d[6 * kUnits + i];
      out[i] += r * r;
    }
  }
  for (int i = 0; i < kUnits; ++i) out[i] *= block.per_point;
}

SONOCAL_WIDEST_VECTORS void all_squares(const Linear& given, const UnitBlock* blocks, int count,
                                        double* out) {
  const Linear a = given;
  for (int b = 0; b < count; ++b) squares_of(a, blocks[b], out + blocks[b].slot);
}

// Whether the mean over `seen` of `all`, a random part, is further above `mean` than chance brings it where
// that is the mean of all: of numbers from 0 to `limit`, whose variance is mean (limit - mean) at the most.
[[gnu::always_inline]] inline bool hopeless(double sum, int seen, int all, double mean, double limit) {
  const double above = sum / seen - mean, rest = 1 - static_cast<double>(seen) / all;
  return above > 0 && above * above * seen > kDeviations * kDeviations * rest * mean * (limit - mean);
}

SONOCAL_WIDEST_VECTORS double sum_truncated(const Linear& given, const UnitBlock* blocks, int count, int all,
                                            double limit, double enough) {
  const Linear a = given;
  double sum = 0;
  int seen = 0;
  for (int b = 0; b < count && sum < enough; ++b) {
    alignas(64) double square[kUnits];
    squares_of(a, blocks[b], square);
    double block = 0;
#pragma omp simd reduction(+ : block)
    for (int i = 0; i < kUnits; ++i) block += square[i] < limit ? square[i] : limit;
    sum += block;
    seen += blocks[b].units;
    if (hopeless(sum, seen, all, enough / all, limit)) return std::max(sum, enough);
  }
  return sum;
}

double positive(double size) { return size > 0 && std::isfinite(size) ? size : 1; }

// Entries of NormalEquations, filled block by block: a point with one plane or two.
class Entries {
 public:
  Entries() {
    std::fill_n(block_.h, Block::kRows, 1.0);
    std::fill_n(&block_.weight[0][0], 2 * Block::kRows, 1.0);
  }
  void add(const PointOnPlane& row, bool same_point) {
    if (same_point && planes_ == 1) {
      put(row, 1);
      return;
    }
    if (block_.count == Block::kRows) flush();
    const int to = block_.count++;
    for (int axis = 0; axis < 3; ++axis) {
      block_.x[axis][to] = row.point[axis];
      block_.normal[1][axis][to] = 0;
    }
    block_.offset[1][to] = 0;
    put(row, 0);
  }
  NormalEquations finish() {
    if (block_.count > 0) flush();
    return equations_;
  }

 private:
  void put(const PointOnPlane& row, int plane) {
    const int to = block_.count - 1;
    for (int axis = 0; axis < 3; ++axis) block_.normal[plane][axis][to] = row.normal[axis];
    block_.offset[plane][to] = row.offset;
    planes_ = plane + 1;
  }
  void flush() {
    equations_.add(block_);
    block_.count = 0;
  }

  NormalEquations equations_{3};
  Block block_;
  int planes_ = 0;
};

}  // namespace

UnitRows::UnitRows(const Correspondences& all) : kinds_(kinds_of(all)), units_(all.count) {
  normalise(all);
  lay_out(all);
}

void UnitRows::normalise(const Correspondences& all) {
  const int rows = all.first[all.count];
  Matrix3d normals = Matrix3d::Zero();
  Vector3d right = Vector3d::Zero();
  for (int i = 0; i < rows; ++i) {
    const PointOnPlane row = read_row(all.points, all.planes, i);
    source_centre_ += row.point / rows;
    flat_ = flat_ && row.point[2] == all.points[2];
    for (int column = 0; column < 3; ++column) normals.col(column) += row.normal[column] * row.normal;
    right -= row.offset * row.normal;
  }
  if (flat_ && rows > 0) source_centre_[2] = all.points[2];
  centre_ = least_squares(normals, right);
  if (!centre_.allFinite()) centre_.setZero();
  double source = 0, target = 0;
  for (int i = 0; i < rows; ++i) {
    const PointOnPlane row = read_row(all.points, all.planes, i);
    source += (row.point - source_centre_).squaredNorm();
    target += std::pow(row.normal.dot(centre_) + row.offset, 2);
  }
  source_size_ = positive(std::sqrt(source / rows));
  size_ = positive(std::sqrt(target / rows));
}

void UnitRows::lay_out(const Correspondences& all) {
  std::size_t numbers = 0, slots = 0;
  for (const UnitKind& kind : kinds_) {
    const std::size_t padded = (kind.units.size() + kUnits - 1) / kUnits * kUnits;
    numbers += padded * kind.rows() * kFields;
    slots += padded;
  }
  data_.assign(numbers, 0.0);
  unit_.assign(slots, -1);
  kind_.assign(slots, 0);
  double* to = data_.data();
  std::vector<std::pair<double, int>> turns;
  for (int k = 0; k < static_cast<int>(kinds_.size()); ++k) {
    const int count = static_cast<int>(kinds_[k].units.size());
    for (int begin = 0; begin < count; begin += kUnits) {
      turns.emplace_back((begin + 0.5 * kUnits) / count, static_cast<int>(blocks_.size()));
      to = add_block(all, k, begin, to);
    }
  }
  std::sort(turns.begin(), turns.end());
  for (const auto& [place, block] : turns) scored_.push_back(blocks_[block]);
}

double* UnitRows::add_block(const Correspondences& all, int of_kind, int begin, double* to) {
  const UnitKind& kind = kinds_[of_kind];
  const int units = std::min(kUnits, static_cast<int>(kind.units.size()) - begin), rows = kind.rows();
  const int slot = kUnits * static_cast<int>(blocks_.size());
  blocks_.push_back({to, rows, 1.0 / kind.points(), slot, units});
  std::fill_n(kind_.begin() + slot, kUnits, of_kind);
  for (int i = 0; i < units; ++i) {
    const int unit = unit_[slot + i] = kind.units[begin + i];
    for (int j = 0; j < rows; ++j) {
      const PointOnPlane row = read_row(all.points, all.planes, all.first[unit] + j);
      double* field = to + j * kFields * kUnits + i;
      for (int axis = 0; axis < 3; ++axis) {
        field[axis * kUnits] = (row.point[axis] - source_centre_[axis]) / source_size_;
        field[(3 + axis) * kUnits] = row.normal[axis];
      }
      field[6 * kUnits] = (row.offset + row.normal.dot(centre_)) / size_;
    }
  }
  return to + rows * kFields * kUnits;
}

PointOnPlane UnitRows::row(int slot, int row) const {
  const UnitBlock& block = blocks_[slot / kUnits];
  const double* d = block.data + row * kFields * kUnits + (slot - block.slot);
  return {{d[0], d[kUnits], d[2 * kUnits]}, {d[3 * kUnits], d[4 * kUnits], d[5 * kUnits]}, d[6 * kUnits]};
}

Transform UnitRows::to_original(const Transform& a) const {
  Transform out = a;
  out.scales = a.scales * (size_ / source_size_);
  out.translation = size_ * a.translation + centre_ - out.linear() * source_centre_;
  return out;
}

void UnitRows::squares(const Transform& a, Column& out) const {
  out.resize(slots());
  all_squares(Linear(a), blocks_.data(), static_cast<int>(blocks_.size()), out.data());
}

double UnitRows::truncated_sum(const Transform& a, double limit, double enough) const {
  return sum_truncated(Linear(a), scored_.data(), static_cast<int>(scored_.size()), units_, limit, enough);
}

NormalEquations UnitRows::cost(const Column& squares, double limit) const {
  Entries entries;
  for (const UnitBlock& block : blocks_)
    for (int slot = block.slot; slot < block.slot + block.units; ++slot) {
      if (!(squares[slot] <= limit)) continue;
      const UnitKind& kind = this->kind(slot);
      for (int j = 0; j < block.rows; ++j) entries.add(row(slot, j), kind.same_point[j]);
    }
  return entries.finish();
}

int UnitRows::rows_within(const Column& squares, double limit) const {
  int rows = 0;
  for (const UnitBlock& block : blocks_)
    rows += block.rows * static_cast<int>((squares.segment(block.slot, block.units) <= limit).count());
  return rows;
}

std::vector<double> UnitRows::shares_within(const Column& squares, double limit) const {
  std::vector<double> shares(kinds_.size());
  for (const UnitBlock& block : blocks_) {
    const int kind = kind_[block.slot];
    shares[kind] += static_cast<double>((squares.segment(block.slot, block.units) <= limit).count()) /
                    static_cast<double>(kinds_[kind].units.size());
  }
  return shares;
}

}  // namespace sonocal
