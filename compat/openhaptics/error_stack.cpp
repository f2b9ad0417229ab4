// SPDX-License-Identifier: Apache-2.0
#include "compat/openhaptics/error_stack.h"

#include <algorithm>

namespace forcegrid::openhaptics {
namespace {

struct ErrorText {
  HDerror code;
  const char* text;
};

constexpr ErrorText kTexts[] = {
    {HD_SUCCESS, "No error"},
    {HD_INVALID_ENUM, "Unknown parameter or capability"},
    {HD_INVALID_VALUE, "Value out of range or not finite"},
    {HD_INVALID_OPERATION, "Not possible now"},
    {HD_INVALID_INPUT_TYPE, "The parameter has another type"},
    {HD_BAD_HANDLE, "No such device"},
    {HD_WARM_MOTORS, "The motors are too warm"},
    {HD_EXCEEDED_MAX_FORCE, "The force exceeds what the device can give; it was shortened"},
    {HD_EXCEEDED_MAX_FORCE_IMPULSE, "The force changes too fast"},
    {HD_EXCEEDED_MAX_VELOCITY, "The device moves too fast"},
    {HD_FORCE_ERROR, "The force was switched off: a callback took too long"},
    {HD_DEVICE_FAULT, "The device has a fault, or another program has it"},
    {HD_DEVICE_ALREADY_INITIATED, "This program has opened the device already"},
    {HD_COMM_ERROR, "The device does not answer or is not configured"},
    {HD_COMM_CONFIG_ERROR, "The configuration of devices can't be used"},
    {HD_TIMER_ERROR, "The servo thread did not keep its time, or a callback did not return"},
    {HD_ILLEGAL_BEGIN, "A frame can't begin here"},
    {HD_ILLEGAL_END, "No frame of this device has begun"},
    {HD_FRAME_ERROR, "Only possible between hdBeginFrame and hdEndFrame"},
    {HD_INVALID_PRIORITY, "Not a priority"},
    {HD_SCHEDULER_FULL, "Too many callbacks are scheduled"},
    {HD_INVALID_LICENSE, "Invalid licence"},
};

thread_local constinit ErrorStack errors;

}  // namespace

void ErrorStack::push(const HDErrorInfo& error) noexcept {
  errors_[next_] = error;
  next_ = (next_ + 1) % kCapacity;
  size_ = std::min(size_ + 1, kCapacity);
}

HDErrorInfo ErrorStack::pop() noexcept {
  if (size_ == 0) {
    return {HD_SUCCESS, 0, 0};
  }
  next_ = (next_ + kCapacity - 1) % kCapacity;
  --size_;
  return errors_[next_];
}

ErrorStack& errors_of_this_thread() noexcept { return errors; }

void push_error(HDerror code, HHD device, int internal) noexcept {
  errors.push({code, internal, device});
}

const char* error_text(HDerror code) noexcept {
  for (const ErrorText& one : kTexts) {
    if (one.code == code) {
      return one.text;
    }
  }
  return "Unknown error";
}

}  // namespace forcegrid::openhaptics
