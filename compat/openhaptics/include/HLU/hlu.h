/* SPDX-License-Identifier: Apache-2.0 */
/* Empty: programs that only include this header compile. There is no HL here. */
#ifndef FORCEGRID_HLU_H
#define FORCEGRID_HLU_H

#endif
