// SPDX-License-Identifier: Apache-2.0
// A force method of the shared library against a spring's closed form, and what crosses its border:
// exceptions, and the types of objects that it or this program has made.
#include <cmath>
#include <cstdio>
#include <stdexcept>
#include <string>

#include "forcegrid/methods.h"

namespace {

constexpr double kStiffness_N_per_m = 100.0;
constexpr double kTolerance_N = 0.01;  // 1 % of the largest force

Eigen::Vector3d tool_W(double time_s) {
  return {0.005 * std::sin(2.0 * time_s), 0.003 * std::cos(3.0 * time_s), -0.01 * time_s};
}

/// `auto` on a spring -k x, whose answers come 30 times a second and 30 ms late.
/// @returns [N] the largest error of its force in the second of two seconds.
double error_on_a_spring_N() {
  forcegrid::MethodOptions options;
  options.grid.min_W.setConstant(-0.05);
  options.grid.max_W.setConstant(0.05);
  options.grid.cells.setConstant(20);
  const auto method = forcegrid::make_force_method("auto", options);
  method->contact_made(1, Eigen::Vector3d::Zero());
  double worst_N = 0.0;
  for (int cycle = 0; cycle < 1000; ++cycle) {
    const double time_s = 0.002 * cycle;
    method->observe(time_s, tool_W(time_s));
    if (cycle % 16 == 15) {
      forcegrid::Sample sample;
      sample.time_s = time_s - 0.03;
      sample.position_W = tool_W(sample.time_s);
      sample.force_W = -kStiffness_N_per_m * sample.position_W;
      sample.contact_epoch = 1;
      method->take_sample(sample);
    }
    method->work(1000);
    const Eigen::Vector3d force_N = method->force(time_s, tool_W(time_s)).force_W;
    if (cycle >= 500) {
      worst_N = std::max(worst_N, (force_N + kStiffness_N_per_m * tool_W(time_s)).norm());
    }
  }
  return worst_N;
}

class OwnMethod final : public forcegrid::ForceMethod {
 public:
  const char* name() const noexcept override { return "own"; }
  std::size_t memory_bytes() const noexcept override { return sizeof *this; }
  void take_sample(const forcegrid::Sample&) noexcept override {}
  void contact_made(std::uint32_t, const Eigen::Vector3d&) noexcept override {}
  void contact_lost() noexcept override {}
  int work(int) noexcept override { return 0; }
  forcegrid::ForceEstimate force(double, const Eigen::Vector3d&) const noexcept override {
    return {};
  }
};

bool types_cross() {
  const std::unique_ptr<forcegrid::ForceMethod> own = std::make_unique<OwnMethod>();
  const auto hold = forcegrid::make_force_method("hold", {});
  return dynamic_cast<OwnMethod*>(own.get()) != nullptr &&
         dynamic_cast<OwnMethod*>(hold.get()) == nullptr &&
         dynamic_cast<forcegrid::ForceMethod*>(hold.get()) == hold.get();
}

bool exception_crosses() {
  try {
    forcegrid::make_force_method("no such method", {});
  } catch (const std::invalid_argument& error) {
    return std::string(error.what()).find("no such method") != std::string::npos;
  }
  return false;
}

}  // namespace

int main() {
  const double error_N = error_on_a_spring_N();
  const bool types = types_cross();
  const bool exception = exception_crosses();
  std::printf("error %.5f N, types %d, exception %d\n", error_N, types, exception);
  return error_N < kTolerance_N && types && exception ? 0 : 1;
}
