/* SPDX-License-Identifier: Apache-2.0 */
/* 4 x 4 matrices for row vectors: p' = p M, the translation is the last row. The memory is that of
 * HD_CURRENT_TRANSFORM, which is the transposed matrix, column by column. */
#ifndef FORCEGRID_HDU_MATRIX_H
#define FORCEGRID_HDU_MATRIX_H

/* NOLINTBEGIN: the names, and C89 or C++98, are those of the interface. */

#ifdef __cplusplus

#include <math.h>

#include "hduVector.h"

class hduQuaternion;

/* Sixteen contiguous doubles; the identity unless told otherwise. */
class hduMatrix {
 public:
  hduMatrix() { makeIdentity(); }
  hduMatrix(const double* elements) {
    for (int i = 0; i < 16; ++i) {
      m_[i / 4][i % 4] = elements[i];
    }
  }

  template <class Index>
  double* operator[](Index row) {
    return m_[row];
  }
  template <class Index>
  const double* operator[](Index row) const {
    return m_[row];
  }
  operator double*() { return &m_[0][0]; }
  operator const double*() const { return &m_[0][0]; }

  double get(int row, int column) const { return m_[row][column]; }
  void get(double elements[4][4]) const {
    for (int i = 0; i < 16; ++i) {
      elements[i / 4][i % 4] = m_[i / 4][i % 4];
    }
  }
  void set(int row, int column, double value) { m_[row][column] = value; }

  hduMatrix& makeIdentity() {
    for (int i = 0; i < 16; ++i) {
      m_[i / 4][i % 4] = i / 4 == i % 4 ? 1.0 : 0.0;
    }
    return *this;
  }
  /* In place. */
  hduMatrix& transpose() {
    for (int r = 0; r < 4; ++r) {
      for (int c = 0; c < r; ++c) {
        const double below = m_[r][c];
        m_[r][c] = m_[c][r];
        m_[c][r] = below;
      }
    }
    return *this;
  }

  /* The rotation alone; `rotation` may be this matrix. */
  void getRotationMatrix(hduMatrix& rotation) const {
    hduMatrix only;
    for (int r = 0; r < 3; ++r) {
      for (int c = 0; c < 3; ++c) {
        only.m_[r][c] = m_[r][c];
      }
    }
    rotation = only;
  }
  inline void getRotation(hduQuaternion& quaternion) const;

  /* this = this * right */
  hduMatrix& multRight(const hduMatrix& right) {
    const hduMatrix left = *this;
    for (int r = 0; r < 4; ++r) {
      for (int c = 0; c < 4; ++c) {
        m_[r][c] = left.m_[r][0] * right.m_[0][c] + left.m_[r][1] * right.m_[1][c] +
                   left.m_[r][2] * right.m_[2][c] + left.m_[r][3] * right.m_[3][c];
      }
    }
    return *this;
  }
  /* this = left * this */
  hduMatrix& multLeft(const hduMatrix& left) {
    hduMatrix product = left;
    product.multRight(*this);
    return *this = product;
  }

  /* result = (source, 1) * this */
  void multVecMatrix(const hduVector3Dd& source, hduVector3Dd& result) const {
    double sum[3];
    for (int c = 0; c < 3; ++c) {
      sum[c] = source[0] * m_[0][c] + source[1] * m_[1][c] + source[2] * m_[2][c] + m_[3][c];
    }
    result.set(sum[0], sum[1], sum[2]);
  }
  /* result = this * (source, 1) as a column */
  void multMatrixVec(const hduVector3Dd& source, hduVector3Dd& result) const {
    double sum[3];
    for (int r = 0; r < 3; ++r) {
      sum[r] = m_[r][0] * source[0] + m_[r][1] * source[1] + m_[r][2] * source[2] + m_[r][3];
    }
    result.set(sum[0], sum[1], sum[2]);
  }

  /* The inverse by elimination with row pivots; the identity for a singular matrix. */
  hduMatrix getInverse() const {
    hduMatrix left = *this;
    hduMatrix right;
    for (int c = 0; c < 4; ++c) {
      int pivot = c;
      for (int r = c + 1; r < 4; ++r) {
        pivot = fabs(left.m_[r][c]) > fabs(left.m_[pivot][c]) ? r : pivot;
      }
      if (left.m_[pivot][c] == 0.0) {
        return hduMatrix();
      }
      left.swapRows(c, pivot);
      right.swapRows(c, pivot);
      const double scale = 1.0 / left.m_[c][c];
      left.addRow(c, c, scale - 1.0);
      right.addRow(c, c, scale - 1.0);
      for (int r = 0; r < 4; ++r) {
        if (r != c) {
          const double factor = -left.m_[r][c];
          left.addRow(r, c, factor);
          right.addRow(r, c, factor);
        }
      }
    }
    return right;
  }

  static hduMatrix createTranslation(double x, double y, double z) {
    hduMatrix m;
    hduVecSet(m.m_[3], x, y, z);
    return m;
  }
  static hduMatrix createTranslation(const hduVector3Dd& v) {
    return createTranslation(v[0], v[1], v[2]);
  }
  static hduMatrix createScale(double x, double y, double z) {
    hduMatrix m;
    m.m_[0][0] = x;
    m.m_[1][1] = y;
    m.m_[2][2] = z;
    return m;
  }
  static hduMatrix createScale(const hduVector3Dd& v) { return createScale(v[0], v[1], v[2]); }
  /* By `angle` radians about `axis`, which need not be a unit vector (Rodrigues). */
  static hduMatrix createRotation(const hduVector3Dd& axis, double angle) {
    const hduVector3Dd u = normalize(axis);
    const double c = cos(angle);
    const double s = sin(angle);
    hduMatrix m;
    for (int i = 0; i < 3; ++i) {
      const int j = (i + 1) % 3;
      const int k = (i + 2) % 3;
      m.m_[i][i] = c + u[i] * u[i] * (1.0 - c);
      m.m_[i][j] = u[i] * u[j] * (1.0 - c) + u[k] * s;
      m.m_[j][i] = u[i] * u[j] * (1.0 - c) - u[k] * s;
    }
    return m;
  }
  static hduMatrix createRotation(double x, double y, double z, double angle) {
    return createRotation(hduVector3Dd(x, y, z), angle);
  }

 private:
  void swapRows(int a, int b) {
    for (int c = 0; c < 4; ++c) {
      const double kept = m_[a][c];
      m_[a][c] = m_[b][c];
      m_[b][c] = kept;
    }
  }
  void addRow(int to, int from, double factor) {
    for (int c = 0; c < 4; ++c) {
      m_[to][c] += factor * m_[from][c];
    }
  }

  double m_[4][4];
};

inline hduMatrix operator*(hduMatrix a, const hduMatrix& b) { return a.multRight(b); }

#include "hduQuaternion.h"

inline void hduMatrix::getRotation(hduQuaternion& quaternion) const {
  quaternion = hduQuaternion(*this);
}

#endif

/* NOLINTEND */

#endif
