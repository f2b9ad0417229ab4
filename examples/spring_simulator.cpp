// SPDX-License-Identifier: Apache-2.0
// A spring for Forcegrid: F = -k (P - P0), with P0 where it catches the tool near W's origin.
// usage: spring_simulator ADDR:PORT [STIFFNESS_N_PER_M]

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <exception>
#include <iostream>
#include <optional>
#include <stdexcept>
#include <string>
#include <thread>

#include "link/simulator_endpoint.h"
#include "link/wire.h"

namespace {

using Clock = std::chrono::steady_clock;
using namespace forcegrid::link;

constexpr double kReach_m = 0.005;  // the spring catches a tool this near to W's origin

double parse_stiffness_N_per_m(const std::string& text) {
  char* end = nullptr;
  const double value = std::strtod(text.c_str(), &end);
  if (text.empty() || *end != '\0' || !(value >= 0.0 && value <= kMaxStiffness_N_per_m)) {
    throw std::invalid_argument("stiffness '" + text + "': give a number from 0 to 1e7 N/m");
  }
  return value;
}

void run(SimulatorEndpoint& servo, double stiffness_N_per_m) {
  std::optional<Vector3> first_W_m;
  Clock::time_point next = Clock::now();
  while (true) {
    const auto news = servo.receive(std::chrono::seconds(1));
    if (news.new_session) {
      first_W_m.reset();
    }
    if (!news.tool_state) {
      continue;
    }
    const Vector3& p = news.tool_state->position_W_m;
    if (!first_W_m && p[0] * p[0] + p[1] * p[1] + p[2] * p[2] < kReach_m * kReach_m) {
      first_W_m = p;
    }
    ForceSample sample = answer_to(*news.tool_state);  // position and echo filled in
    sample.converged = true;
    for (std::size_t i = 0; first_W_m && i < 3; ++i) {
      sample.force_W_N[i] = -stiffness_N_per_m * (sample.position_W_m[i] - (*first_W_m)[i]);
      sample.stiffness_W_N_per_m[4 * i] = -stiffness_N_per_m;
    }
    if (first_W_m) {
      sample.has_stiffness = sample.in_contact = true;
      sample.contact_epoch = 1;
      sample.contact_point_W_m = *first_W_m;
    }
    if (servo.send(sample) == SendStatus::kInvalid) {
      std::cerr << "spring_simulator: the force leaves the link's range; use a softer spring\n";
    }
    next = std::max(next + std::chrono::nanoseconds(1'000'000'000 / 30), Clock::now());
    std::this_thread::sleep_until(next);
  }
}

}  // namespace

int main(int argument_count, char** arguments) try {
  if (argument_count < 2 || argument_count > 3) {
    std::cerr << "usage: spring_simulator ADDR:PORT [STIFFNESS_N_PER_M]\n";
    return EXIT_FAILURE;
  }
  const double stiffness_N_per_m =
      argument_count == 3 ? parse_stiffness_N_per_m(arguments[2]) : 100.0;
  SimulatorEndpoint servo(arguments[1]);
  std::cout << "listening on " << to_string(servo.address()) << std::endl;
  run(servo, stiffness_N_per_m);
} catch (const std::exception& error) {
  std::cerr << "spring_simulator: " << error.what() << '\n';
  return EXIT_FAILURE;
}
