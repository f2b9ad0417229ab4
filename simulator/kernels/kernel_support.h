// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstring>

#include "simulator/kernels/lanes.h"

// One binary for every x86-64: the loader picks the version that the processor can run.
#if defined(__x86_64__) && defined(__gnu_linux__) && !defined(FORCEGRID_SANITIZED) && \
    defined(__has_attribute)
#if __has_attribute(target_clones)
#define FORCEGRID_MULTIVERSION __attribute__((target_clones("arch=x86-64-v3", "default")))
#endif
#endif
#ifndef FORCEGRID_MULTIVERSION
#define FORCEGRID_MULTIVERSION
#endif
#define FORCEGRID_INLINE inline __attribute__((always_inline))

/// Two Float4 side by side, and the halves again. These are not functions, because the versions
/// differ in how they pass a vector this wide.
#define FORCEGRID_PAIR(low, high) __builtin_shufflevector(low, high, 0, 1, 2, 3, 4, 5, 6, 7)
#define FORCEGRID_LOW(pair) __builtin_shufflevector(pair, pair, 0, 1, 2, 3)
#define FORCEGRID_HIGH(pair) __builtin_shufflevector(pair, pair, 4, 5, 6, 7)

namespace forcegrid::simulator::kernels {

/// Two vertices' or springs' four numbers in one wide SIMD register.
using Float8 = float __attribute__((vector_size(32)));

FORCEGRID_INLINE Float4 broadcast(float value) { return Float4{value, value, value, value}; }

/// Numbers that lie one after the other in memory, as a vector.
template <typename Vector, typename Memory>
FORCEGRID_INLINE Vector load(const Memory* from) {
  Vector vector;
  std::memcpy(&vector, from, sizeof vector);
  return vector;
}
template <typename Vector, typename Memory>
FORCEGRID_INLINE void store(Memory* to, const Vector& vector) {
  std::memcpy(to, &vector, sizeof vector);
}

}  // namespace forcegrid::simulator::kernels
