// Problems into lanes, solutions out of them.
#pragma once

#include "sonocal/solvers/lanes/kernels.hpp"
#include "sonocal/solvers/lanes/lanes.hpp"

namespace sonocal {

// Three numbers a lane, `stride` doubles apart; lanes past the end repeat the last problem.
SONOCAL_INLINE Vec3<Pack> gather3(const double* first, std::size_t stride, int last) {
  Vec3<Pack> out;
  for (int i = 0; i < kWidth; ++i) {
    const double* at = first + stride * static_cast<std::size_t>(i < last ? i : last);
    set_lane(out.x, i, at[0]);
    set_lane(out.y, i, at[1]);
    set_lane(out.z, i, at[2]);
  }
  return out;
}

// Appends the wanted lanes' matrices behind those their problems have already; lane i belongs to
// problem[i].
template <int kMost>
SONOCAL_INLINE void append(const Candidate<Pack>& c, const PackMask& wanted, const PackMask& problem,
                           int lanes, BatchOut out) {
  if (!any(wanted)) return;
  const Vec3<Pack> x = c.scale * c.column[0], y = c.scale * c.column[1], z = c.scale * c.column[2];
  const Vec3<Pack>& t = c.translation;
  for (int i = 0; i < lanes; ++i) {
    if (!wanted[i] || out.counts[problem[i]] >= kMost) continue;
    double* m = out.matrices + (static_cast<std::size_t>(problem[i]) * kMost + out.counts[problem[i]]++) * 16;
    const double rows[16] = {x.x[i], y.x[i], z.x[i], t.x[i], x.y[i], y.y[i], z.y[i], t.y[i],
                             x.z[i], y.z[i], z.z[i], t.z[i], 0,      0,      0,      1};
    std::memcpy(m, rows, sizeof rows);
  }
}

template <int kMost>
SONOCAL_INLINE void append(const Candidate<Pack>& c, const PackMask& wanted, int lanes, BatchOut out) {
  PackMask own;
  for (int i = 0; i < kWidth; ++i) own[i] = i;
  append<kMost>(c, wanted, own, lanes, out);
}

template <int kMost>
SONOCAL_INLINE void fill_rest(int problems, BatchOut out) {
  for (int i = 0; i < problems; ++i) {
    double* end = out.matrices + static_cast<std::size_t>(i + 1) * kMost * 16;
    for (double* m = end - (kMost - out.counts[i]) * 16; m < end; ++m) *m = kNoSolution;
  }
}

}  // namespace sonocal
