// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>

namespace forcegrid::firmware {

/// Files and messages of the host, for a program under an emulator or a debugger.
/// Source: Arm, Semihosting for AArch32 and AArch64, version 2.
namespace semihosting {

inline std::intptr_t call(std::intptr_t operation, const void* argument) noexcept {
  register std::intptr_t r0 asm("r0") = operation;
  register const void* r1 asm("r1") = argument;
  asm volatile("bkpt 0xab" : "+r"(r0) : "r"(r1) : "memory");
  return r0;
}

inline void print(const char* text) noexcept { call(0x04, text); }

/// @param mode 1: read bytes, 5: write bytes anew. @returns a handle, or -1.
inline std::intptr_t open(const char* name, std::intptr_t mode) noexcept {
  const std::intptr_t block[] = {reinterpret_cast<std::intptr_t>(name), mode,
                                 static_cast<std::intptr_t>(std::strlen(name))};
  return call(0x01, block);
}
/// @returns false at the end of the file.
template <typename Value>
bool read(std::intptr_t file, Value& value) noexcept {
  const std::intptr_t block[] = {file, reinterpret_cast<std::intptr_t>(&value),
                                 static_cast<std::intptr_t>(sizeof value)};
  return call(0x06, block) == 0;
}
template <typename Value>
bool write(std::intptr_t file, const Value& value) noexcept {
  const std::intptr_t block[] = {file, reinterpret_cast<std::intptr_t>(&value),
                                 static_cast<std::intptr_t>(sizeof value)};
  return call(0x05, block) == 0;
}
inline void close(std::intptr_t file) noexcept { call(0x02, &file); }

/// The emulator's command line, words separated by blanks.
inline bool command_line(char* text, std::size_t size) noexcept {
  std::intptr_t block[] = {reinterpret_cast<std::intptr_t>(text), static_cast<std::intptr_t>(size)};
  return call(0x15, block) == 0;
}

[[noreturn]] inline void exit(std::intptr_t status) noexcept {
  const std::intptr_t block[] = {0x20026, status};  // the program ended by itself
  for (;;) {
    call(0x20, block);
  }
}

}  // namespace semihosting
}  // namespace forcegrid::firmware
