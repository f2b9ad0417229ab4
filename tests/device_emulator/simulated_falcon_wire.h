// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <chrono>
#include <vector>

#include "device_emulator/emulated_falcon.h"
#include "device_emulator/urb_host.h"
#include "falcon_client.h"

namespace forcegrid::emulator {

/// A bus in simulated time: frames of 1 ms, and the device's own wake times between them.
class SimulatedFalconWire final : public FalconWire {
 public:
  explicit SimulatedFalconWire(const DeviceOptions& options) : device(options, now) {}

  bool control(std::uint8_t request_type, std::uint8_t request, std::uint16_t value,
               std::uint16_t index, std::uint16_t length, Bytes* reply) override {
    step(kTurnaround);
    auto result = device.control({request_type, request, value, index, length}, {}, now);
    if (reply != nullptr) {
      *reply = result.data;
    }
    return !result.stalled;
  }
  std::size_t write(const Bytes& data) override {
    step(kTurnaround);
    Urb& urb = pending_.emplace_back();
    urb.sequence = ++sequence_;
    urb.endpoint = {0x02, UsbTransferType::kBulk, 64};
    urb.data = data;
    return wait_for(sequence_).size;
  }
  Bytes read(std::size_t size) override {
    step(kTurnaround);
    Urb& urb = pending_.emplace_back();
    urb.sequence = ++sequence_;
    urb.endpoint = {0x81, UsbTransferType::kBulk, 64};
    urb.buffer_bytes = size;
    return wait_for(sequence_).data;
  }
  /// Lets time pass with nobody asking.
  void step(rt::Duration duration) {
    const rt::TimePoint end = now + duration;
    while (now < end) {
      now = std::min(end, next_event());
      serve();
    }
  }

  /// The client's own time between two calls.
  static constexpr rt::Duration kTurnaround = std::chrono::microseconds(50);
  rt::TimePoint now{std::chrono::seconds(100)};
  EmulatedFalcon device;

 private:
  struct Done {
    std::size_t size = 0;
    Bytes data;
  };

  rt::TimePoint next_event() const {
    const rt::TimePoint frame = now + std::chrono::milliseconds(1);
    const auto wake = device.wake_time();
    return wake && *wake > now ? std::min(frame, *wake) : frame;
  }
  void serve() {
    UrbHost host(pending_, replies_);
    device.run(now, host);
  }
  Done wait_for(std::uint32_t sequence) {
    const rt::TimePoint patience = now + std::chrono::seconds(1);
    replies_.clear();
    serve();
    while (replies_.empty() && now < patience) {
      now = next_event();
      serve();
    }
    Done done;
    if (replies_.empty()) {
      std::erase_if(pending_, [sequence](const Urb& urb) { return urb.sequence == sequence; });
      serve();
      return done;
    }
    // RET_SUBMIT: actual length at 24, data from 48 on.
    done.size = static_cast<std::size_t>((replies_.at(26) << 8) | replies_.at(27));
    done.data.assign(replies_.begin() + 48, replies_.end());
    return done;
  }

  std::vector<Urb> pending_;
  std::vector<std::uint8_t> replies_;
  std::uint32_t sequence_ = 0;
};

}  // namespace forcegrid::emulator
