/* SPDX-License-Identifier: Apache-2.0 */
/* The utilities: vectors, matrices, quaternions, planes, errors. Header-only. */
#ifndef FORCEGRID_HDU_H
#define FORCEGRID_HDU_H

/* NOLINTBEGIN: the names, and C89 or C++98, are those of the interface. */

#include "hduError.h"
#include "hduLineSegment.h"
#include "hduMath.h"
#include "hduMatrix.h"
#include "hduPlane.h"
#include "hduQuaternion.h"
#include "hduVector.h"

/* NOLINTEND */

#endif
