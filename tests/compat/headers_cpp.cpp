// SPDX-License-Identifier: Apache-2.0
// The headers in C++98 and C++20: what programs do with the HDU classes.
// NOLINTBEGIN: C++98
#include <cstring>
#include <iostream>
#include <string>

#include "header_shapes.h"

STATIC_CHECK(vector_is_three_doubles, sizeof(hduVector3Dd) == 3 * sizeof(double));
STATIC_CHECK(matrix_is_sixteen_doubles, sizeof(hduMatrix) == 16 * sizeof(double));
STATIC_CHECK(quaternion_is_four_doubles, sizeof(hduQuaternion) == 4 * sizeof(double));

#if __cplusplus >= 201103L
#include <type_traits>
static_assert(std::is_standard_layout<hduVector3Dd>::value, "three doubles");
static_assert(std::is_standard_layout<hduMatrix>::value, "sixteen doubles");
static_assert(std::is_standard_layout<hduQuaternion>::value, "four doubles");
#endif

class Member {
 public:
  static HDCallbackCode HDCALLBACK run(void*) { return HD_CALLBACK_DONE; }
};

static double use_vectors(int i, float f, unsigned u, std::size_t n) {
  const double array[3] = {1, 2, 3};
  hduVector3Dd a(0, f, 2.5);
  hduVector3Dd b(array);
  hduVector3Dd force = -a * 2 + b / 2 - 3 * b + 0.5 * a - (a + b) * f;
  force += a;
  force -= b;
  force *= i;
  force /= 2;
  force = a - array;
  force = array + b;
  hdSetDoublev(HD_CURRENT_FORCE, force);
  hdSetDoublev(HD_CURRENT_FORCE, a + b);
  hdGetDoublev(HD_CURRENT_POSITION, a);
  const hduVector3Dd constant = b;
  hdSetDoublev(HD_CURRENT_FORCE, constant);
  std::memcpy((double*)a, array, sizeof array);
  std::memset(static_cast<void*>(&a), 0, sizeof(hduVector3Dd));
#if __cplusplus >= 201103L
  hduVector3Dd braced = {0, 0, 0};
  braced = {i, f, 2.0};
  a = braced;
#endif
  std::cout << a << constant << '\n';
  hduVecAdd(a, a, b);
  hduVecSubtract(a, a, b);
  hduVecScale(a, b, 2);
  hduVecScaleInPlace(a, 0.5);
  hduVecNormalize(a, b);
  if (a == b || a != constant || b.isZero(1e-9)) {
    a.set(1, 2, 3);
  }
  b.normalize();
  return a[0] + a[i] + a[u] + a[n] + constant[2] + a.magnitude() + a.dotProduct(b) +
         a.crossProduct(b)[1] + normalize(a)[0] + hduVecMagnitude(a) + hduVecDotProduct(a, b);
}

static double use_matrices(const double elements[16]) {
  double nested[4][4];
  hduMatrix m(elements);
  hdGetDoublev(HD_CURRENT_TRANSFORM, m);
  hduMatrix rotation(m);
  rotation.getRotationMatrix(rotation);
  rotation.transpose();
  m.get(nested);
  m[3][0] = m.get(3, 1) + nested[0][0];
  hduMatrix product = m * rotation * hduMatrix::createTranslation(1, 2, 3) *
                      hduMatrix::createScale(hduVector3Dd(1, 1, 1));
  product.multLeft(hduMatrix::createRotation(hduVector3Dd(0, 0, 1), 0.5));
  product.multRight(hduMatrix::createRotation(1, 0, 0, 0.5));
  product.createRotation(1, 0, 0, 0.5);
  hduVector3Dd moved;
  product.getInverse().multVecMatrix(moved, moved);
  product.multMatrixVec(moved, moved);
  hduQuaternion q(product);
  product.getRotation(q);
  q = q.inverse() * hduQuaternion(1, hduVector3Dd(0, 0, 0));
  q.toRotationMatrix(product);
  product.makeIdentity();
  hduPlaned plane(hduVector3Dd(0, 1, 0), 0);
  plane = hduPlaned(hduVector3Dd(0, 1, 0), hduVector3Dd(1, 1, 1));
  plane = hduPlaned(0, 1, 0, 2);
  const hduLineSegmentd line(moved, moved);
  return q.s() + q.v()[0] + q[3] + plane.a() + plane.b() + plane.c() + plane.d() +
         plane.normal()[1] + plane.projectPoint(line.p())[0] + plane.perpDistance(line.q());
}

int main(int argc, char** argv) {
  if (argc > 1) {
    const std::string name = argv[1];
    shape_calls(argv[1]);
    hdInitDevice(argc > 2 ? HD_DEFAULT_DEVICE : name.c_str());
    hdScheduleAsynchronous(&Member::run, 0, HD_MIN_SCHEDULER_PRIORITY);
    double elements[16] = {1};
    std::cout << use_vectors(1, 2, 0, 1) + use_matrices(elements) << '\n';
  }
  return 0;
}
// NOLINTEND
