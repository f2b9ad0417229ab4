/* SPDX-License-Identifier: Apache-2.0 */
/* Empty: programs that only include this header compile. There is no HL here. */
#ifndef FORCEGRID_HL_H
#define FORCEGRID_HL_H

#endif
