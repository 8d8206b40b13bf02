// Point-plane rows in lanes: their equations in coordinates of order one, and what gives the translation.
#pragma once

#include "sonocal/solvers/lanes/lanes_io.hpp"

namespace sonocal {

// normal . (A point) + offset = 0
template <class T>
struct PointPlane {
  Vec3<T> point, normal;
  T offset;
};

// What was subtracted from points and from places, and what they were divided by.
template <class T>
struct Normalisation {
  Vec3<T> image_centre, centre;
  T image_size, size;
};

// The equations of rows, n . (S x + t) + d = 0: of each the numbers that t, 1 and the columns of S are
// multiplied by, 13 of them, or 10 where no point has a third coordinate.
//
// Centres both sides and scales them to order one: what the elimination sees. With `scale` > 0 that of the
// image is such that S is a rotation.
template <class T, int kRows, int kColumns>
SONOCAL_INLINE Mask<T> normalise(const PointPlane<T> (&row)[kRows], double scale, Normalisation<T>& units,
                                 T (&m)[kRows][kColumns]) {
  Vec3<T> sum = row[0].point, c0{}, c1{}, c2{}, right{};
  for (int i = 1; i < kRows; ++i) sum = sum + row[i].point;
  units.image_centre = broadcast<T>(1.0 / kRows) * sum;
  for (int i = 0; i < kRows; ++i) {
    const Vec3<T>& n = row[i].normal;
    c0 = c0 + n.x * n;
    c1 = c1 + n.y * n;
    c2 = c2 + n.z * n;
    right = right - row[i].offset * n;
  }
  // The point nearest to all planes.
  const Vec3<T> a0 = cross(c1, c2), a1 = cross(c2, c0), a2 = cross(c0, c1);
  units.centre = (1.0 / dot(c0, a0)) * (right.x * a0 + right.y * a1 + right.z * a2);
  units.size = units.image_size = broadcast<T>(0);
  T offset[kRows];
  Vec3<T> x[kRows];
  for (int i = 0; i < kRows; ++i) {
    offset[i] = row[i].offset + dot(row[i].normal, units.centre);
    x[i] = row[i].point - units.image_centre;
    units.size = units.size + abs(offset[i]);
    units.image_size = larger<T>(units.image_size, dot(x[i], x[i]));
  }
  units.image_size = sqrt(units.image_size);
  if (scale > 0) units.size = scale * units.image_size;  // planes through one point have none of their own
  const T shrink = 1.0 / units.size, shrink_image = 1.0 / units.image_size;
  for (int i = 0; i < kRows; ++i) {
    const Vec3<T>& n = row[i].normal;
    const Vec3<T> u = shrink_image * x[i];
    const T to[13] = {n.x,       n.y,       n.z,       offset[i] * shrink, u.x * n.x, u.x * n.y, u.x * n.z,
                      u.y * n.x, u.y * n.y, u.y * n.z, u.z * n.x,          u.z * n.y, u.z * n.z};
    for (int k = 0; k < kColumns; ++k) m[i][k] = to[k];
  }
  return (units.size > 0.0) & (units.image_size > 0.0) & finite(shrink + shrink_image + units.size);
}

// Householder reflections that clear the first columns below the diagonal; false where they depend.
template <int kCleared, class T, int kRows, int kColumns>
SONOCAL_INLINE Mask<T> eliminate(T (&m)[kRows][kColumns]) {
  Mask<T> independent = m[0][0] == m[0][0];
  for (int c = 0; c < kCleared; ++c) {
    T square = m[c][c] * m[c][c];
    for (int r = c + 1; r < kRows; ++r) square += m[r][c] * m[r][c];
    const T norm = with_sign<T>(sqrt(square), m[c][c]);
    independent &= square > 1e-26;
    T mirror[kRows];
    for (int r = c + 1; r < kRows; ++r) mirror[r] = m[r][c];
    mirror[c] = m[c][c] + norm;
    const T factor = 1.0 / (norm * mirror[c]);
    for (int k = c; k < kColumns; ++k) {
      T along = mirror[c] * m[c][k];
      for (int r = c + 1; r < kRows; ++r) along += mirror[r] * m[r][k];
      along = along * factor;
      for (int r = c; r < kRows; ++r) m[r][k] -= along * mirror[r];
    }
  }
  return independent;
}

// The translation, from three rows that are upper triangular in it and what is added to them.
template <class T, int kRows, int kColumns>
SONOCAL_INLINE Vec3<T> translation_of(const T (&rows)[kRows][kColumns], const T (&right)[3]) {
  T t[3];
  for (int i = 3; i-- > 0;) {
    T sum = right[i];
    for (int k = i + 1; k < 3; ++k) sum += rows[i][k] * t[k];
    t[i] = -sum / rows[i][i];
  }
  return {t[0], t[1], t[2]};
}

// A candidate whose columns are there, with a scale and a translation of the normalised coordinates.
template <class T>
SONOCAL_INLINE void denormalise(const Normalisation<T>& units, const T& scale, const Vec3<T>& translation,
                                Candidate<T>& out) {
  out.scale = scale * units.size / units.image_size;
  const Vec3<T>& centre = units.image_centre;
  out.translation =
      units.centre + units.size * translation -
      out.scale * (centre.x * out.column[0] + centre.y * out.column[1] + centre.z * out.column[2]);
  out.valid =
      (out.scale > 0.0) & finite(out.scale + out.translation.x + out.translation.y + out.translation.z);
}

// The first rows of each problem, which has `rows` of them.
template <int kRows>
SONOCAL_INLINE void gather_rows(const double* points, const double* planes, int rows, int problems,
                                PointPlane<Pack> (&row)[kRows]) {
  for (int i = 0; i < kRows; ++i) {
    row[i].point = gather3(points + 3 * i, 3 * rows, problems - 1);
    row[i].normal = gather3(planes + 4 * i, 4 * rows, problems - 1);
    for (int b = 0; b < kWidth; ++b)
      row[i].offset[b] =
          planes[static_cast<std::size_t>(b < problems ? b : problems - 1) * 4 * rows + 4 * i + 3];
  }
}

}  // namespace sonocal
