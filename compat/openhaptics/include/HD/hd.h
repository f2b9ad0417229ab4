/* SPDX-License-Identifier: Apache-2.0 */
#ifndef FORCEGRID_HD_H
#define FORCEGRID_HD_H

/* NOLINTBEGIN: the names, and C89 or C++98, are those of the interface. */

#include "hdDefines.h"
#include "hdDevice.h"
#include "hdScheduler.h"

/* NOLINTEND */

#endif
