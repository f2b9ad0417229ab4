/* SPDX-License-Identifier: Apache-2.0 */
#ifndef FORCEGRID_HDU_LINE_SEGMENT_H
#define FORCEGRID_HDU_LINE_SEGMENT_H

/* NOLINTBEGIN: the names, and C89 or C++98, are those of the interface. */

#ifdef __cplusplus

#include "hduVector.h"

/* The straight line from p to q. */
class hduLineSegmentd {
 public:
  hduLineSegmentd(const hduVector3Dd& p, const hduVector3Dd& q) : p_(p), q_(q) {}

  const hduVector3Dd& p() const { return p_; }
  const hduVector3Dd& q() const { return q_; }

 private:
  hduVector3Dd p_;
  hduVector3Dd q_;
};

#endif

/* NOLINTEND */

#endif
