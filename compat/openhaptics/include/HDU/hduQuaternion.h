/* SPDX-License-Identifier: Apache-2.0 */
#ifndef FORCEGRID_HDU_QUATERNION_H
#define FORCEGRID_HDU_QUATERNION_H

/* NOLINTBEGIN: the names, and C89 or C++98, are those of the interface. */

#ifdef __cplusplus

#include <math.h>

#include "hduMatrix.h"
#include "hduVector.h"

/* Four contiguous doubles: scalar, x, y, z; the identity unless told otherwise. It turns column
 * vectors as the matrix does that has the same memory as the hduMatrix, column by column. */
class hduQuaternion {
 public:
  hduQuaternion() { set(1.0, 0.0, 0.0, 0.0); }
  hduQuaternion(double scalar, const hduVector3Dd& vector) {
    set(scalar, vector[0], vector[1], vector[2]);
  }
  /* Of the matrix's rotation (Shepperd's method), with a scalar of at least 0. */
  hduQuaternion(const hduMatrix& m) {
    /* R(r, c) = m[c][r] */
    const double trace = m[0][0] + m[1][1] + m[2][2];
    int largest = -1;
    for (int i = 0; i < 3; ++i) {
      if (m[i][i] > (largest < 0 ? trace : m[largest][largest])) {
        largest = i;
      }
    }
    if (largest < 0) {
      const double w = sqrt(1.0 + trace) / 2.0;
      set(w, (m[1][2] - m[2][1]) / (4.0 * w), (m[2][0] - m[0][2]) / (4.0 * w),
          (m[0][1] - m[1][0]) / (4.0 * w));
      return;
    }
    const int i = largest;
    const int j = (i + 1) % 3;
    const int k = (i + 2) % 3;
    const double e = sqrt(1.0 + m[i][i] - m[j][j] - m[k][k]) / 2.0;
    const double w = (m[j][k] - m[k][j]) / (4.0 * e);
    const double sign = w < 0.0 ? -1.0 : 1.0;
    q_[0] = sign * w;
    q_[1 + i] = sign * e;
    q_[1 + j] = sign * (m[i][j] + m[j][i]) / (4.0 * e);
    q_[1 + k] = sign * (m[i][k] + m[k][i]) / (4.0 * e);
  }

  double s() const { return q_[0]; }
  hduVector3Dd v() const { return hduVector3Dd(q_[1], q_[2], q_[3]); }

  template <class Index>
  double& operator[](Index i) {
    return q_[i];
  }
  template <class Index>
  const double& operator[](Index i) const {
    return q_[i];
  }
  operator double*() { return q_; }
  operator const double*() const { return q_; }

  /* The inverse of the constructor from a matrix. */
  void toRotationMatrix(hduMatrix& m) const {
    const double w = q_[0];
    const double x = q_[1];
    const double y = q_[2];
    const double z = q_[3];
    m.makeIdentity();
    hduVecSet(m[0], 1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y));
    hduVecSet(m[1], 2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x));
    hduVecSet(m[2], 2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y));
  }

  hduQuaternion inverse() const {
    const double norm = q_[0] * q_[0] + v().dotProduct(v());
    return hduQuaternion(q_[0] / norm, -v() / norm);
  }

 private:
  void set(double s, double x, double y, double z) {
    q_[0] = s;
    hduVecSet(q_ + 1, x, y, z);
  }

  double q_[4];
};

/* Hamilton's product: first turns by b, then by a. */
inline hduQuaternion operator*(const hduQuaternion& a, const hduQuaternion& b) {
  return hduQuaternion(a.s() * b.s() - a.v().dotProduct(b.v()),
                       a.s() * b.v() + b.s() * a.v() + a.v().crossProduct(b.v()));
}

#endif

/* NOLINTEND */

#endif
