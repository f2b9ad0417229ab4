// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "link/messages.h"
#include "link/surface_patch.h"
#include "link/wire.h"

/// Whether the other end would take a message, for encode() and decode(). Each finds the first of
/// kNotFinite, kBadReserved (something is there without its flag or beyond its count) and
/// kOutOfRange. Real-time: bounded, no allocation, lock or throw. Threads: any.
namespace forcegrid::link {

[[nodiscard]] WireStatus check(const ToolState& message) noexcept;
[[nodiscard]] WireStatus check(const Query& message) noexcept;
[[nodiscard]] WireStatus check(const ForceSample& message) noexcept;
[[nodiscard]] WireStatus check(const Goodbye& message) noexcept;
[[nodiscard]] WireStatus check(const SurfacePatch& message) noexcept;
[[nodiscard]] WireStatus check(const OtherTools& message) noexcept;
[[nodiscard]] WireStatus check(const Refusal& message) noexcept;

}  // namespace forcegrid::link
