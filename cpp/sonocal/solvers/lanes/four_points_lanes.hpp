// The four points of four_points.hpp, in lanes.
#pragma once

#include "sonocal/solvers/lanes/conics.hpp"
#include "sonocal/solvers/lanes/lanes_io.hpp"
#include "sonocal/solvers/lanes/polynomial.hpp"

namespace sonocal {
namespace planar {

template <class T>
struct Point2 {
  T x, y;
};

template <class T>
SONOCAL_INLINE T cross2(const Point2<T>& a, const Point2<T>& b) {
  return a.x * b.y - a.y * b.x;
}

// A point, its line by a foot and a unit direction, and the point's weight in the affine dependency.
template <class T>
struct Row {
  Point2<T> image;
  Vec3<T> foot, direction;
  T weight;
};

template <class T>
SONOCAL_INLINE void swap_rows(const Mask<T>& mask, Row<T>& a, Row<T>& b) {
  swap_where<T>(mask, a.image.x, b.image.x);
  swap_where<T>(mask, a.image.y, b.image.y);
  swap_where<T>(mask, a.foot, b.foot);
  swap_where<T>(mask, a.direction, b.direction);
  swap_where<T>(mask, a.weight, b.weight);
}

// The problem about its own centres, lengths in units of `size`; each foot is nearest to the centre.
template <class T>
struct Problem {
  Row<T> row[4];
  Point2<T> image_centre;
  Vec3<T> centre;
  T size;
  Mask<T> valid;
};

// sum_i w_i (x_i, 1) = 0: w_i is the signed area of the triangle of the other three.
template <class T>
SONOCAL_INLINE void weigh(Row<T> (&row)[4]) {
  Point2<T> from_first[3];
  for (int i = 0; i < 3; ++i)
    from_first[i] = {row[i + 1].image.x - row[0].image.x, row[i + 1].image.y - row[0].image.y};
  row[1].weight = cross2(from_first[1], from_first[2]);
  row[2].weight = cross2(from_first[2], from_first[0]);
  row[3].weight = cross2(from_first[0], from_first[1]);
  row[0].weight = -(row[1].weight + row[2].weight + row[3].weight);
}

// Orders the rows so that the sum of places closes best: rows 0 and 1 span a plane with their directions,
// row 3 can leave its line across that plane, row 2 is what is left. Needles often tilt in one plane only,
// so places along three lines alone could not always close it. Returns zero where nothing does.
template <class T>
SONOCAL_INLINE T order(Row<T> (&row)[4]) {
  T best{}, last = broadcast<T>(3.0), third = broadcast<T>(2.0);
  for (int e = 0; e < 4; ++e)
    for (int c = 0; c < 4; ++c) {
      if (c == e) continue;
      const int a = e == 0 || c == 0 ? (e == 1 || c == 1 ? 2 : 1) : 0, b = 6 - e - c - a;
      const Vec3<T> normal = cross(row[a].direction, row[b].direction);
      const T along = dot(normal, row[e].direction), w = row[a].weight * row[b].weight * row[e].weight;
      const T volume = w * w * (dot(normal, normal) - along * along);
      const Mask<T> better = volume > best;
      best = select(better, volume, best);
      last = select(better, broadcast<T>(e), last);
      third = select(better, broadcast<T>(c), third);
    }
  for (int i = 0; i < 3; ++i) {
    const Mask<T> here = last == static_cast<double>(i);
    swap_rows<T>(here, row[i], row[3]);
    third = select(here & (third == 3.0), broadcast<T>(i), third);
  }
  for (int i = 0; i < 2; ++i) swap_rows<T>(third == static_cast<double>(i), row[i], row[2]);
  return best;
}

// Given images, points on the lines (in `foot`) and unit directions.
template <class T>
SONOCAL_INLINE void prepare(Problem<T>& p) {
  p.image_centre = {T{}, T{}};
  p.centre = {T{}, T{}, T{}};
  const T quarter = broadcast<T>(0.25);
  for (const Row<T>& row : p.row) {
    p.image_centre = {p.image_centre.x + 0.25 * row.image.x, p.image_centre.y + 0.25 * row.image.y};
    p.centre = p.centre + quarter * row.foot;
  }
  T square{};
  for (Row<T>& row : p.row) {
    row.image = {row.image.x - p.image_centre.x, row.image.y - p.image_centre.y};
    const Vec3<T> from_centre = row.foot - p.centre;
    row.foot = from_centre - dot(row.direction, from_centre) * row.direction;
    square = square + dot(row.foot, row.foot);
  }
  p.size = sqrt(square);
  const T inverse = 1.0 / p.size;
  for (Row<T>& row : p.row) row.foot = inverse * row.foot;
  weigh(p.row);
  const T best = order(p.row);
  p.valid = (best > 0.0) & (square > 0.0);
}

// c1, c2 and the points' mean, each affine in alpha and mu.
template <class T>
struct Columns {
  Affine3<T> c1, c2, mean;
};

// The points as affine functions of alpha (along line 3) and mu (along line 2), with m across lines 0 and 1:
//     P_i = f_i + lambda_i d_i, i = 0, 1,  P_2 = f_2 + mu d_2,  P_3 = f_3 + alpha d_3 + nu m,
//     sum_i w_i P_i = 0 gives lambda_0, lambda_1, nu.
template <class T>
SONOCAL_INLINE void place(const Row<T> (&row)[4], Affine3<T> (&point)[4]) {
  Vec3<T> sum{};
  for (const Row<T>& r : row) sum = sum + r.weight * r.foot;
  const Vec3<T> normal = cross(row[0].direction, row[1].direction);
  const T inverse = 1.0 / dot(normal, normal), root = sqrt(inverse);
  const Vec3<T> across = root * normal;
  const Vec3<T> by_alpha = row[3].weight * row[3].direction, by_mu = row[2].weight * row[2].direction;
  // Rows of the inverse of (d_0 d_1 m).
  const Vec3<T> faces[3] = {cross(row[1].direction, inverse * normal),
                            cross(inverse * normal, row[0].direction), across};
  for (int i = 0; i < 2; ++i) {
    const Vec3<T> face = (-1.0 / row[i].weight) * faces[i];
    const Vec3<T>& d = row[i].direction;
    point[i] = {row[i].foot + dot(face, sum) * d, dot(face, by_alpha) * d, dot(face, by_mu) * d};
  }
  const Vec3<T> face = (-1.0 / row[3].weight) * across;
  point[2] = {row[2].foot, Vec3<T>{}, row[2].direction};
  point[3] = {row[3].foot + dot(face, sum) * across, row[3].direction + dot(face, by_alpha) * across,
              dot(face, by_mu) * across};
}

// The columns by least squares, (c1 c2) = sum_i P_i x_i^T (sum_i x_i x_i^T)^-1.
template <class T>
SONOCAL_INLINE Columns<T> columns_of(const Row<T> (&row)[4]) {
  T xx{}, xy{}, yy{};
  for (const Row<T>& r : row) {
    xx = xx + r.image.x * r.image.x;
    xy = xy + r.image.x * r.image.y;
    yy = yy + r.image.y * r.image.y;
  }
  const T unit = 1.0 / (xx * yy - xy * xy), quarter = broadcast<T>(0.25);
  Affine3<T> point[4];
  place(row, point);
  Columns<T> out{};
  for (int i = 0; i < 4; ++i) {
    out.c1 = out.c1.plus(unit * (yy * row[i].image.x - xy * row[i].image.y), point[i]);
    out.c2 = out.c2.plus(unit * (xx * row[i].image.y - xy * row[i].image.x), point[i]);
    out.mean = out.mean.plus(quarter, point[i]);
  }
  return out;
}

template <class T>
struct Solved {
  Candidate<T> candidate[4];
  Mask<T> real[4], part[2];  // part: of candidates 0 and 2
};

template <class T>
SONOCAL_INLINE void solve(Problem<T>& p, bool real_parts, Solved<T>& out) {
  prepare(p);
  const Columns<T> columns = columns_of(p.row);
  const T one = broadcast<T>(1.0);
  const Conic<T> f = product(columns.c1.plus(one, columns.c2), columns.c1.plus(-one, columns.c2));
  const Conic<T> g = product(columns.c1, columns.c2);
  const Elimination<T> elimination = eliminate_mu(f, g);
  const QuarticRoots<T> roots = quartic_roots(elimination.quartic);
  for (int i = 0; i < 4; ++i) {
    out.real[i] = roots.real[i / 2] & p.valid;
    if (i % 2 == 0) out.part[i / 2] = roots.part[i / 2] & p.valid;
    const Mask<T> wanted = i % 2 == 0 && real_parts ? out.real[i] | out.part[i / 2] : out.real[i];
    if (!any(wanted)) continue;
    T alpha = roots.value[i], mu = elimination.mu(alpha);
    polish(f, g, out.real[i], alpha, mu);
    Candidate<T>& c = out.candidate[i];
    frame_from_columns(columns.c1.at(alpha, mu), columns.c2.at(alpha, mu), c);
    c.scale = c.scale * p.size;
    const Vec3<T> shift = p.image_centre.x * c.column[0] + p.image_centre.y * c.column[1];
    c.translation = p.centre + p.size * columns.mean.at(alpha, mu) - c.scale * shift;
    c.valid = c.valid & finite(c.translation.x + c.translation.y + c.translation.z);
    out.real[i] = out.real[i] & c.valid;
    if (i % 2 == 0) out.part[i / 2] = out.part[i / 2] & c.valid;
  }
}

SONOCAL_INLINE void pack(const double* points, const double* segments, int problems, bool real_parts,
                         BatchOut out) {
  Problem<Pack> p;
  for (int i = 0; i < 4; ++i) {
    for (int b = 0; b < kWidth; ++b) {
      const double* at = points + 8 * (b < problems ? b : problems - 1) + 2 * i;
      p.row[i].image.x[b] = at[0];
      p.row[i].image.y[b] = at[1];
    }
    p.row[i].foot = gather3(segments + 6 * i, 24, problems - 1);
    p.row[i].direction = unit(gather3(segments + 6 * i + 3, 24, problems - 1) - p.row[i].foot);
  }
  Solved<Pack> solved;
  solve(p, real_parts, solved);
  for (int b = 0; b < problems; ++b) out.counts[b] = 0;
  for (int i = 0; i < 4; ++i) append<4>(solved.candidate[i], solved.real[i], problems, out);
  if (real_parts)
    for (int i = 0; i < 2; ++i) append<4>(solved.candidate[2 * i], solved.part[i], problems, out);
  fill_rest<4>(problems, out);
}

}  // namespace planar

SONOCAL_INLINE void four_points_range(const double* points, const double* segments, std::size_t size,
                                      bool real_parts, BatchOut out) {
  for (std::size_t b = 0; b < size; b += kWidth)
    planar::pack(points + b * 8, segments + b * 24, size - b < kWidth ? static_cast<int>(size - b) : kWidth,
                 real_parts, {out.matrices + b * 64, out.counts + b});
}

}  // namespace sonocal
