/* SPDX-License-Identifier: Apache-2.0 */
#ifndef FORCEGRID_HDU_PLANE_H
#define FORCEGRID_HDU_PLANE_H

/* NOLINTBEGIN: the names, and C89 or C++98, are those of the interface. */

#ifdef __cplusplus

#include "hduVector.h"

/* The plane a x + b y + c z + d = 0. */
class hduPlaned {
 public:
  hduPlaned() : normal_(0.0, 0.0, 1.0), d_(0.0) {}
  hduPlaned(double a, double b, double c, double d) : normal_(a, b, c), d_(d) {}
  hduPlaned(const hduVector3Dd& normal, double d) : normal_(normal), d_(d) {}
  /* Through `point`. */
  hduPlaned(const hduVector3Dd& normal, const hduVector3Dd& point)
      : normal_(normal), d_(-normal.dotProduct(point)) {}

  double a() const { return normal_[0]; }
  double b() const { return normal_[1]; }
  double c() const { return normal_[2]; }
  double d() const { return d_; }
  const hduVector3Dd& normal() const { return normal_; }

  /* The distance of `point`, positive on the side of the normal. */
  double perpDistance(const hduVector3Dd& point) const {
    return (normal_.dotProduct(point) + d_) / normal_.magnitude();
  }
  /* The point of the plane that is nearest to `point`. */
  hduVector3Dd projectPoint(const hduVector3Dd& point) const {
    return point - normalize(normal_) * perpDistance(point);
  }

 private:
  hduVector3Dd normal_;
  double d_;
};

#endif

/* NOLINTEND */

#endif
