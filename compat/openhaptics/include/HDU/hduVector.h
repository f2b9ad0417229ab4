/* SPDX-License-Identifier: Apache-2.0 */
/* Vectors of three doubles: functions on arrays for C and C++, and a class for C++. */
#ifndef FORCEGRID_HDU_VECTOR_H
#define FORCEGRID_HDU_VECTOR_H

/* NOLINTBEGIN: the names, and C89 or C++98, are those of the interface. */

#include <math.h>

#include "hduMath.h"

/* The result may be one of the arguments. */
FORCEGRID_HDU_FUNCTION void hduVecSet(double* r, double x, double y, double z) {
  r[0] = x;
  r[1] = y;
  r[2] = z;
}

FORCEGRID_HDU_FUNCTION void hduVecAdd(double* r, const double* a, const double* b) {
  hduVecSet(r, a[0] + b[0], a[1] + b[1], a[2] + b[2]);
}

FORCEGRID_HDU_FUNCTION void hduVecSubtract(double* r, const double* a, const double* b) {
  hduVecSet(r, a[0] - b[0], a[1] - b[1], a[2] - b[2]);
}

FORCEGRID_HDU_FUNCTION void hduVecScale(double* r, const double* a, double s) {
  hduVecSet(r, a[0] * s, a[1] * s, a[2] * s);
}

FORCEGRID_HDU_FUNCTION void hduVecScaleInPlace(double* v, double s) { hduVecScale(v, v, s); }

FORCEGRID_HDU_FUNCTION double hduVecDotProduct(const double* a, const double* b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

FORCEGRID_HDU_FUNCTION void hduVecCrossProduct(double* r, const double* a, const double* b) {
  hduVecSet(r, a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]);
}

FORCEGRID_HDU_FUNCTION double hduVecMagnitude(const double* v) {
  return sqrt(hduVecDotProduct(v, v));
}

/* The zero vector stays zero. */
FORCEGRID_HDU_FUNCTION void hduVecNormalize(double* r, const double* a) {
  const double length = hduVecMagnitude(a);
  hduVecScale(r, a, length > 0.0 ? 1.0 / length : 0.0);
}

FORCEGRID_HDU_FUNCTION void hduVecNormalizeInPlace(double* v) { hduVecNormalize(v, v); }

#ifdef __cplusplus

#include <ostream>

/* Three contiguous doubles; zero unless told otherwise. */
class hduVector3Dd {
 public:
  typedef double EltType;

  hduVector3Dd() { set(0.0, 0.0, 0.0); }
  /* Of any number types, so that {0, i, 1.5f} does not narrow. */
  template <class X, class Y, class Z>
  hduVector3Dd(X x, Y y, Z z) {
    set(static_cast<double>(x), static_cast<double>(y), static_cast<double>(z));
  }
  hduVector3Dd(const double* v) { set(v[0], v[1], v[2]); }

  void set(double x, double y, double z) { hduVecSet(v_, x, y, z); }

  template <class Index>
  double& operator[](Index i) {
    return v_[i];
  }
  template <class Index>
  const double& operator[](Index i) const {
    return v_[i];
  }
  operator double*() { return v_; }
  operator const double*() const { return v_; }

  double magnitude() const { return hduVecMagnitude(v_); }
  /* Makes it a unit vector; the zero vector stays zero. */
  hduVector3Dd& normalize() {
    hduVecNormalize(v_, v_);
    return *this;
  }
  double dotProduct(const hduVector3Dd& b) const { return hduVecDotProduct(v_, b.v_); }
  hduVector3Dd crossProduct(const hduVector3Dd& b) const {
    hduVector3Dd r;
    hduVecCrossProduct(r.v_, v_, b.v_);
    return r;
  }
  /* Whether no element is farther from zero than `tolerance`. */
  bool isZero(double tolerance) const {
    return hduIsEqual(v_[0], 0.0, tolerance) && hduIsEqual(v_[1], 0.0, tolerance) &&
           hduIsEqual(v_[2], 0.0, tolerance);
  }

  hduVector3Dd& operator+=(const hduVector3Dd& b) {
    hduVecAdd(v_, v_, b.v_);
    return *this;
  }
  hduVector3Dd& operator-=(const hduVector3Dd& b) {
    hduVecSubtract(v_, v_, b.v_);
    return *this;
  }
  hduVector3Dd& operator*=(double s) {
    hduVecScale(v_, v_, s);
    return *this;
  }
  hduVector3Dd& operator/=(double s) {
    set(v_[0] / s, v_[1] / s, v_[2] / s);
    return *this;
  }
  hduVector3Dd operator-() const { return hduVector3Dd(-v_[0], -v_[1], -v_[2]); }

 private:
  double v_[3];
};

inline hduVector3Dd operator+(hduVector3Dd a, const hduVector3Dd& b) { return a += b; }
inline hduVector3Dd operator-(hduVector3Dd a, const hduVector3Dd& b) { return a -= b; }
/* With an array on one side: without these, pointer arithmetic would be as good a match. */
inline hduVector3Dd operator+(const hduVector3Dd& a, const double* b) {
  return a + hduVector3Dd(b);
}
inline hduVector3Dd operator-(const hduVector3Dd& a, const double* b) {
  return a - hduVector3Dd(b);
}
inline hduVector3Dd operator+(const double* a, const hduVector3Dd& b) {
  return hduVector3Dd(a) + b;
}
inline hduVector3Dd operator-(const double* a, const hduVector3Dd& b) {
  return hduVector3Dd(a) - b;
}
inline hduVector3Dd operator*(hduVector3Dd v, double s) { return v *= s; }
inline hduVector3Dd operator*(double s, hduVector3Dd v) { return v *= s; }
inline hduVector3Dd operator/(hduVector3Dd v, double s) { return v /= s; }
inline bool operator==(const hduVector3Dd& a, const hduVector3Dd& b) {
  return a[0] == b[0] && a[1] == b[1] && a[2] == b[2];
}
inline bool operator!=(const hduVector3Dd& a, const hduVector3Dd& b) { return !(a == b); }

inline std::ostream& operator<<(std::ostream& stream, const hduVector3Dd& v) {
  return stream << "(" << v[0] << ", " << v[1] << ", " << v[2] << ")";
}

/* A unit vector in the direction of v; zero for zero. */
inline hduVector3Dd normalize(hduVector3Dd v) { return v.normalize(); }
inline double magnitude(const hduVector3Dd& v) { return v.magnitude(); }
inline double dotProduct(const hduVector3Dd& a, const hduVector3Dd& b) { return a.dotProduct(b); }
inline hduVector3Dd crossProduct(const hduVector3Dd& a, const hduVector3Dd& b) {
  return a.crossProduct(b);
}

#endif

/* NOLINTEND */

#endif
