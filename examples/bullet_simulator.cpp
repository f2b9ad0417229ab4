// SPDX-License-Identifier: Apache-2.0
// A foreign simulator behind Forcegrid's link: a soft block of the game engine Bullet
// (bullet_block.h).
// usage: bullet_simulator ADDR:PORT [STIFFNESS_N_PER_M [KEY_FILE]]

#include <atomic>
#include <chrono>
#include <csignal>
#include <cstdlib>
#include <exception>
#include <iostream>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "bullet_block.h"
#include "link/simulator_endpoint.h"

namespace {

using Clock = std::chrono::steady_clock;
using namespace forcegrid::link;

constexpr auto kPeriod = std::chrono::microseconds(33'333);
constexpr auto kBudget = std::chrono::milliseconds(22);
constexpr double kConvergedResidual = 0.02;  // within Bullet's reach: it is made for pictures

std::atomic<bool> stop{false};
void on_signal(int) { stop = true; }

double parse_stiffness_N_per_m(const std::string& text) {
  char* end = nullptr;
  const double value = std::strtod(text.c_str(), &end);
  if (text.empty() || *end != '\0' || !(value > 0.0 && value <= 1e4)) {
    throw std::invalid_argument("stiffness '" + text + "': give more than 0 and at most 1e4 N/m");
  }
  return value;
}

class Simulator {
 public:
  Simulator(const std::string& address, double stiffness_N_per_m, Access access)
      : servo_(address, std::chrono::seconds(2), std::move(access)), block_(stiffness_N_per_m) {}

  std::string address() const { return to_string(servo_.address()); }

  void run() {
    auto next = Clock::now();
    while (!stop) {
      const auto news = servo_.receive(next - Clock::now());
      if (news.new_session || news.servo_ended) {
        block_.release();
        newest_.reset();
        epoch_ = 0;
      }
      if (news.tool_state) {
        newest_ = news.tool_state;
      }
      if (Clock::now() < next) {
        continue;
      }
      next = std::max(next + kPeriod, Clock::now());
      if (newest_) {
        answer(*newest_);
        newest_.reset();
      }
    }
  }

 private:
  void answer(const ToolState& tool) {
    const auto begun = Clock::now();
    ForceSample sample = answer_to(tool);
    sample.converged = true;
    if (!block_.held() && BulletBlock::inside(tool.position_W_m)) {
      block_.grab(tool.position_W_m);
      contact_point_W_m_ = tool.position_W_m;
      ++epoch_;
    }
    if (block_.held()) {
      const BulletBlock::Answer solved = block_.move_to(tool.position_W_m, kBudget);
      sample.in_contact = true;
      sample.force_W_N = solved.force_W_N;
      sample.relative_residual = solved.relative_residual;
      sample.converged = solved.relative_residual <= kConvergedResidual;
      sample.contact_point_W_m = contact_point_W_m_;
    }
    sample.contact_epoch = epoch_;
    sample.solve_time_s = std::chrono::duration<double>(Clock::now() - begun).count();
    if (servo_.send(sample) == SendStatus::kInvalid) {
      std::cerr << "bullet_simulator: the force leaves the link's range; use a softer block\n";
    }
  }

  SimulatorEndpoint servo_;
  BulletBlock block_;
  std::optional<ToolState> newest_;
  Vector3 contact_point_W_m_{};
  std::uint32_t epoch_ = 0;
};

}  // namespace

int main(int argc, char** argv) {
  if (argc < 2 || argc > 4) {
    std::cerr << "usage: bullet_simulator ADDR:PORT [STIFFNESS_N_PER_M [KEY_FILE]]\n";
    return 2;
  }
  std::signal(SIGINT, on_signal);
  std::signal(SIGTERM, on_signal);
  try {
    Access access;
    if (argc > 3) {
      access.keys = load_keys({argv[3]});
    }
    Simulator simulator(argv[1], argc > 2 ? parse_stiffness_N_per_m(argv[2]) : 15.0,
                        std::move(access));
    std::cout << "listening " << simulator.address() << std::endl;
    simulator.run();
    return 0;
  } catch (const std::exception& error) {
    std::cerr << "bullet_simulator: " << error.what() << "\n";
    return 1;
  }
}
