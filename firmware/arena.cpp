// SPDX-License-Identifier: Apache-2.0
#include "firmware/arena.h"

#include <array>
#include <cstdint>
#include <new>

#include "firmware/board.h"

namespace forcegrid::firmware {
namespace {

constexpr std::size_t kCacheLine = 32;  // of a Cortex-M7; also the usual alignment of `new`

alignas(64) std::array<std::byte, FORCEGRID_ARENA_BYTES> arena;
std::size_t used = 0;
bool sealed = false;

void* take(std::size_t bytes, std::size_t alignment) noexcept {
  const std::size_t first = (used + alignment - 1) / alignment * alignment;
  if (sealed || alignment > 64 || bytes > arena.size() || first > arena.size() - bytes) {
    return nullptr;
  }
  used = first + bytes;
  return arena.data() + first;
}

void* take_or_stop(std::size_t bytes, std::size_t alignment) noexcept {
  void* const memory = take(bytes, alignment);
  if (memory == nullptr) {
    stop_device();
  }
  return memory;
}

}  // namespace

void seal_arena() noexcept { sealed = true; }
std::size_t arena_bytes_used() noexcept { return used; }

}  // namespace forcegrid::firmware

using forcegrid::firmware::kCacheLine;
using forcegrid::firmware::take;
using forcegrid::firmware::take_or_stop;

void* operator new(std::size_t bytes) { return take_or_stop(bytes, kCacheLine); }
void* operator new(std::size_t bytes, std::align_val_t alignment) {
  return take_or_stop(bytes, static_cast<std::size_t>(alignment));
}
void* operator new(std::size_t bytes, const std::nothrow_t&) noexcept {
  return take(bytes, kCacheLine);
}
void* operator new(std::size_t bytes, std::align_val_t alignment, const std::nothrow_t&) noexcept {
  return take(bytes, static_cast<std::size_t>(alignment));
}
void operator delete(void*) noexcept {}
void operator delete(void*, std::size_t) noexcept {}
void operator delete(void*, std::align_val_t) noexcept {}
void operator delete(void*, std::size_t, std::align_val_t) noexcept {}
