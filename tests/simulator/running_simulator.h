// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <chrono>
#include <future>
#include <optional>
#include <ostream>
#include <sstream>
#include <string>
#include <thread>

#include "link/servo_endpoint.h"
#include "simulator/run_simulator.h"
#include "tests/support/flushed_text.h"

namespace forcegrid::simulator {

// Generous: the machine may be busy. Everything that works ends far earlier.
inline constexpr auto kPatience = std::chrono::seconds(20);

/// A simulator on a thread of this process.
class RunningSimulator {
 public:
  explicit RunningSimulator(SimulatorOptions options = {}, int stop_fd = -1) {
    if (options.listen == SimulatorOptions{}.listen) {
      options.listen = "127.0.0.1:0";
    }
    if (options.scene == SimulatorOptions{}.scene) {
      options.scene = "small";
    }
    options.nice = 0;
    result_ = std::async(std::launch::async, [this, options, stop_fd] {
      std::ostream out(&out_);
      return run_simulator(options, out, stop_, stop_fd);
    });
    const auto give_up = std::chrono::steady_clock::now() + kPatience;
    while (out_.flushed().empty() && std::chrono::steady_clock::now() < give_up) {
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
  }
  ~RunningSimulator() { stop_ = true; }

  std::string line() { return out_.flushed(); }
  std::string address() {
    std::istringstream words(line());
    std::string listening;
    std::string address;
    words >> listening >> address;
    return address;
  }
  SimulatorSummary stop() {
    stop_ = true;
    return result_.get();
  }
  std::future<SimulatorSummary>& result() { return result_; }

 private:
  std::atomic<bool> stop_{false};
  FlushedText out_;
  std::future<SimulatorSummary> result_;
};

// Sends the tool's position every few ms until a sample computed there arrives.
inline std::optional<link::ForceSample> answer_at(link::ServoEndpoint& servo,
                                                  std::uint32_t& sequence,
                                                  const link::Vector3& position_W_m) {
  const auto give_up = std::chrono::steady_clock::now() + kPatience;
  while (std::chrono::steady_clock::now() < give_up) {
    link::ToolState state;
    state.sequence = ++sequence;
    state.servo_time_ns = 1000 + sequence;
    state.position_W_m = position_W_m;
    servo.send(state);
    servo.wait(std::chrono::milliseconds(2));
    while (const auto sample = servo.receive()) {
      if (sample->query_id == 0 && sample->position_W_m == position_W_m) {
        return sample;
      }
    }
  }
  return std::nullopt;
}

}  // namespace forcegrid::simulator
