// SPDX-License-Identifier: Apache-2.0
// What the C and C++ libraries ask the system for, in an image without one.
#include <cstddef>
#include <new>

#include "firmware/board.h"

// Nothing else is needed of the C++ library's compiled part, so it is not linked.
const std::nothrow_t std::nothrow{};

extern "C" {

// There is no heap. Eigen names these for matrices too large for the stack, of which there are
// none.
void* malloc(std::size_t) { forcegrid::firmware::stop_device(); }
void free(void*) {}

// errno of the mathematical functions, without the state of stdio behind it.
int* __errno() {
  static int value = 0;
  return &value;
}

[[noreturn]] void abort() { forcegrid::firmware::stop_device(); }
[[noreturn]] void __cxa_pure_virtual() { forcegrid::firmware::stop_device(); }
// Objects of static lifetime live until the power goes.
int __aeabi_atexit(void*, void (*)(void*), void*) { return 0; }
int __cxa_atexit(void (*)(void*), void*, void*) { return 0; }
void* __dso_handle = nullptr;
}
