/* SPDX-License-Identifier: Apache-2.0 */
#ifndef FORCEGRID_HDU_MATH_H
#define FORCEGRID_HDU_MATH_H

/* NOLINTBEGIN: the names, and C89 or C++98, are those of the interface. */

/* A function of a header that C includes, too. */
#ifdef __cplusplus
#define FORCEGRID_HDU_FUNCTION inline
#else
#define FORCEGRID_HDU_FUNCTION static __inline__
#endif

#ifdef __cplusplus

template <class T>
inline T hduMin(T a, T b) {
  return b < a ? b : a;
}

template <class T>
inline T hduMax(T a, T b) {
  return a < b ? b : a;
}

#else

#define hduMin(a, b) ((b) < (a) ? (b) : (a))
#define hduMax(a, b) ((a) < (b) ? (b) : (a))

#endif

/* Whether a and b differ by no more than `tolerance`. */
FORCEGRID_HDU_FUNCTION int hduIsEqual(double a, double b, double tolerance) {
  const double difference = a < b ? b - a : a - b;
  return difference <= tolerance;
}

/* NOLINTEND */

#endif
