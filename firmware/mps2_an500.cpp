// SPDX-License-Identifier: Apache-2.0
// Start-up, timer and serial port. Source: Arm, Application Note AN500 (memory map) and Cortex-M
// System Design Kit, Technical Reference Manual (APB timer and UART).
#include <array>
#include <cstring>

#include "firmware/board.h"

extern "C" {
// Of the linker script.
extern std::uint32_t data_begin[], data_end[], data_image[], bss_begin[], bss_end[];
extern std::uint32_t stack_begin[], stack_end[];
using Initialiser = void (*)();
extern Initialiser init_begin[], init_end[];

int run_image() __asm__("main");
[[noreturn]] void reset();
[[noreturn]] void fault();
}

namespace forcegrid::firmware {
namespace {

constexpr std::uint32_t kUnused = 0xdeadbeef;  // what the stack is filled with

volatile std::uint32_t& at(std::uintptr_t address) noexcept {
  return *reinterpret_cast<volatile std::uint32_t*>(address);
}

constexpr std::uintptr_t kTimer = 0x40000000;
constexpr std::uintptr_t kTimerControl = kTimer, kTimerValue = kTimer + 4,
                         kTimerReload = kTimer + 8;
constexpr std::uintptr_t kSerial = 0x40004000, kSerialStep = 0x1000;  // from port to port
constexpr std::uintptr_t kData = 0, kState = 4, kControl = 8, kInterrupt = 12, kDivider = 16;
constexpr std::uint32_t kBothWays = 3, kReceiveInterrupt = 8, kReceived = 2;
constexpr std::uintptr_t kInterruptEnable = 0xE000E100, kInterruptPending = 0xE000E280;
constexpr std::uint32_t kReceiveLines = 1 << 0 | 1 << 2;  // of UART 0 and 1
constexpr std::uint32_t kTransmitFull = 1, kReceiveFull = 2;
constexpr std::uintptr_t kCoprocessorAccess = 0xE000ED88;

volatile std::uint32_t& serial(Port port, std::uintptr_t offset) noexcept {
  return at(kSerial + static_cast<std::uintptr_t>(port) * kSerialStep + offset);
}

}  // namespace

void start_timer() noexcept {
  at(kTimerControl) = 0;
  at(kTimerReload) = 0xffffffff;
  at(kTimerValue) = 0xffffffff;
  at(kTimerControl) = 1;
}

std::uint32_t timer_ticks() noexcept { return 0xffffffff - at(kTimerValue); }

void start_serial(Port port) noexcept {
  serial(port, kDivider) = kBoardClock_Hz / 1'000'000;
  serial(port, kControl) = kBothWays | kReceiveInterrupt;
  // What came before is nobody's. QEMU also begins to listen at this read, not at the line above.
  [[maybe_unused]] const std::uint32_t dropped = serial(port, kData);
}

bool serial_read(Port port, std::uint8_t& byte) noexcept {
  if ((serial(port, kState) & kReceiveFull) == 0) {
    return false;
  }
  byte = static_cast<std::uint8_t>(serial(port, kData));
  return true;
}

bool serial_write(Port port, std::uint8_t byte) noexcept {
  if ((serial(port, kState) & kTransmitFull) != 0) {
    return false;
  }
  serial(port, kData) = byte;
  return true;
}

// Interrupts wake the processor, but stay masked: there is no handler.
void wait_for_serial() noexcept {
  asm volatile("cpsid i" ::: "memory");
  at(kInterruptEnable) = kReceiveLines;
  asm volatile("dsb\n wfi" ::: "memory");
  for (const Port port : {Port::kSimulator, Port::kArm}) {
    serial(port, kInterrupt) = kReceived;
  }
  at(kInterruptPending) = kReceiveLines;
}

std::size_t stack_bytes() noexcept {
  return static_cast<std::size_t>(stack_end - stack_begin) * sizeof(std::uint32_t);
}

std::size_t stack_bytes_used() noexcept {
  const std::uint32_t* lowest = stack_begin;
  while (lowest < stack_end && *lowest == kUnused) {
    ++lowest;
  }
  return static_cast<std::size_t>(stack_end - lowest) * sizeof(std::uint32_t);
}

}  // namespace forcegrid::firmware

using namespace forcegrid::firmware;

// Before it no floating-point instruction may run; the compiler keeps them out of it, since it does
// nothing with numbers.
__attribute__((noinline)) static void prepare_memory() {
  std::memcpy(data_begin, data_image,
              static_cast<std::size_t>(data_end - data_begin) * sizeof(std::uint32_t));
  std::memset(bss_begin, 0, static_cast<std::size_t>(bss_end - bss_begin) * sizeof(std::uint32_t));
  const auto* here = static_cast<const std::uint32_t*>(__builtin_frame_address(0));
  for (std::uint32_t* word = stack_begin; word < here - 16; ++word) {
    *word = kUnused;
  }
  for (const Initialiser* initialise = init_begin; initialise < init_end; ++initialise) {
    (*initialise)();
  }
}

[[noreturn]] void reset() {
  at(kCoprocessorAccess) = at(kCoprocessorAccess) | 0xf << 20;  // the floating-point unit
  asm volatile("dsb\n isb" ::: "memory");
  prepare_memory();
  run_image();
  stop_device();
}

// Every exception: nothing here uses interrupts, so each is a mistake.
[[noreturn]] void fault() { stop_device(); }

__attribute__((section(".vectors"), used)) static const std::array<void (*)(), 15> kVectors = {
    reset, fault, fault, fault, fault, fault, fault, fault,
    fault, fault, fault, fault, fault, fault, fault};  // the stack's end stands before them
