#pragma once

#include "simulator/spring_kernels.h"

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

namespace forcegrid::simulator::kernels {

/// The first half of evaluate(): every spring's tangent at the present positions.
void find_tangents(const SpringRows& rows, const SpringConstants<float>* constants,
                   bool exponential, const Lanes* state, Single* position,
                   SpringTangent* tangent) noexcept;
/// The same of positions alone.
void find_tangents_at(const SpringRows& rows, const SpringConstants<float>* constants,
                      bool exponential, const Single* position, SpringTangent* tangent) noexcept;
void find_tangents(const SpringRows& rows, const SpringConstants<double>* constants,
                   bool exponential, const Precise* position, double* t_N_per_m,
                   SpringTangent* tangent) noexcept;

}  // namespace forcegrid::simulator::kernels
