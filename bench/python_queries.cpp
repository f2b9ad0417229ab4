// SPDX-License-Identifier: Apache-2.0
// The C++ side of bench/python_queries.py: a method learns a spring's samples from standard input
// and answers a million positions once for each further line; time and sum of forces go to standard
// output, so that both sides can take turns.
//   in: method, samples, positions (text), then doubles: samples * (t, position, force), end time,
//   positions * 3; then lines
//   out: for each line the seconds and the sum of all forces' components
#include <chrono>
#include <cstdio>
#include <iostream>
#include <memory>
#include <numeric>
#include <string>
#include <vector>

#include "forcegrid/method_variant.h"
#include "forcegrid/methods.h"

namespace {

std::vector<double> read_doubles(std::size_t count) {
  std::vector<double> numbers(count);
  std::cin.read(reinterpret_cast<char*>(numbers.data()),
                static_cast<std::streamsize>(count * sizeof(double)));
  return numbers;
}

}  // namespace

int main() {
  std::string name;
  std::size_t sample_count = 0;
  std::size_t position_count = 0;
  std::cin >> name >> sample_count >> position_count;
  std::cin.get();
  const std::vector<double> samples = read_doubles(7 * sample_count);
  const double end_s = read_doubles(1).front();
  const std::vector<double> positions = read_doubles(3 * position_count);
  if (!std::cin) {
    std::fprintf(stderr, "python_queries: standard input ended early\n");
    return 1;
  }

  forcegrid::MethodOptions options;
  options.grid.min_W.setConstant(-0.1);
  options.grid.max_W.setConstant(0.1);
  options.grid.cells.setConstant(49);
  const auto method = forcegrid::make_force_method(name, options);
  method->contact_made(1, Eigen::Vector3d::Zero());
  for (std::size_t i = 0; i < sample_count; ++i) {
    forcegrid::Sample sample;
    sample.time_s = samples[7 * i];
    sample.position_W = Eigen::Vector3d(&samples[7 * i + 1]);
    sample.force_W = Eigen::Vector3d(&samples[7 * i + 4]);
    sample.contact_epoch = 1;
    sample.contact_point_W = sample.position_W;
    method->observe(sample.time_s, sample.position_W);
    method->take_sample(sample);
    method->work(1 << 30);
  }
  for (std::string line; std::getline(std::cin, line);) {
    const auto began = std::chrono::steady_clock::now();
    // A new array in each round, as in Python.
    const auto forces = std::make_unique_for_overwrite<double[]>(3 * position_count);
    for (std::size_t i = 0; i < position_count; ++i) {
      Eigen::Vector3d::Map(forces.get() + 3 * i) =
          method->force(end_s, Eigen::Vector3d::Map(&positions[3 * i])).force_W;
    }
    const std::chrono::duration<double> took = std::chrono::steady_clock::now() - began;
    const double sum_N = std::accumulate(forces.get(), forces.get() + 3 * position_count, 0.0);
    std::printf("%.9f %.17g\n", took.count(), sum_N);
    std::fflush(stdout);
  }
  return 0;
}
