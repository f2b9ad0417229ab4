// SPDX-License-Identifier: Apache-2.0
#pragma once

// Motions of a hand on an elastic object, played to a method as servo and simulator would.

#include <algorithm>
#include <cmath>
#include <deque>
#include <functional>
#include <random>

#include "forcegrid/core/force_method.h"
#include "tests/forcegrid/kriging/kriging_support.h"

namespace forcegrid::testing {

inline constexpr unsigned kSeed = 3;
inline constexpr int kAllWork = 1 << 30;
inline constexpr double kServo_s = 0.002;
inline constexpr double kPeriod_s = 1.0 / 30.0;
inline const Eigen::Vector3d kPoint_W(0.08, 0.06, 0.05);

/// Plays a motion to a method as servo and simulator would: samples at 30 Hz, one period late.
struct Play {
  std::function<Eigen::Vector3d(double time_s)> displacement_m;
  std::function<Eigen::Vector3d(double time_s, const Eigen::Vector3d& d_m)> force_N;
  std::function<Eigen::Matrix3d(const Eigen::Vector3d& d_m)>
      stiffness_N_per_m;  ///< empty: not on the link
  double duration_s = 8.0;
  double first_s = 1.0;  ///< errors before and after this time are told apart
  double noise_N = 0.0;
  double delay_s = 0.0;
  double requests_per_s = 0.0;
  int work_budget = kAllWork;

  double error_first_1s = 0.0;  ///< RMS, of the RMS of the true force
  double error_after_1s = 0.0;
  double worst_after_1s = 0.0;  ///< of the same
  int requests = 0;
  int requests_after_2s = 0;

  void run(ForceMethod& method) {
    std::mt19937 random(kSeed);
    std::normal_distribution<double> normal(0.0, noise_N);
    struct Delivery {
      double at_s;
      Sample sample;
    };
    std::deque<Delivery> on_the_way, answers;
    double next_sample_s = 0.0;
    double next_request_s = 0.0;
    double first_N2 = 0.0, after_N2 = 0.0, reference_N2 = 0.0, worst_N2 = 0.0;
    int first = 0, after = 0;
    const auto sample_at = [&](double time_s, const Eigen::Vector3d& d_m) {
      Sample sample;
      sample.time_s = time_s;
      sample.position_W = kPoint_W + d_m;
      sample.force_W = force_N(time_s, d_m);
      if (noise_N > 0.0) {
        for (double& f : sample.force_W) {
          f += normal(random);
        }
      }
      if (stiffness_N_per_m) {
        sample.has_stiffness = true;
        sample.stiffness_W = stiffness_N_per_m(d_m);
      }
      return sample;
    };
    method.contact_made(1, kPoint_W);
    const int cycles = static_cast<int>(duration_s / kServo_s);
    for (int i = 0; i < cycles; ++i) {
      const double t_s = i * kServo_s;
      const Eigen::Vector3d d_m = displacement_m(t_s);
      const Eigen::Vector3d reference_N = force_N(t_s, d_m);
      if (t_s >= next_sample_s) {
        on_the_way.push_back({t_s + kPeriod_s + delay_s, sample_at(t_s, d_m)});
        next_sample_s += kPeriod_s;
      }
      for (auto* queue : {&on_the_way, &answers}) {
        while (!queue->empty() && queue->front().at_s <= t_s) {
          method.take_sample(queue->front().sample);
          queue->pop_front();
        }
      }
      method.observe(t_s, kPoint_W + d_m);
      const ForceEstimate estimate = method.force(t_s, kPoint_W + d_m);
      const double error_N2 = (estimate.force_W - reference_N).squaredNorm();
      reference_N2 += reference_N.squaredNorm();
      if (t_s < first_s) {
        first_N2 += error_N2;
        ++first;
      } else {
        after_N2 += error_N2;
        worst_N2 = std::max(worst_N2, error_N2);
        ++after;
      }
      if (requests_per_s > 0.0 && t_s >= next_request_s) {
        next_request_s += 1.0 / requests_per_s;
        Eigen::Vector3d wanted_W;
        if (method.plan_request(t_s, kPoint_W + d_m, wanted_W)) {
          ++requests;
          requests_after_2s += t_s > 2.0 ? 1 : 0;
          Sample answer = sample_at(t_s, wanted_W - kPoint_W);
          answer.from_query = true;
          answers.push_back({t_s + 1.0 / requests_per_s, answer});
        }
      }
      method.work(work_budget);
    }
    const double rms_N = std::sqrt(reference_N2 / cycles);
    error_first_1s = std::sqrt(first_N2 / first) / rms_N;
    error_after_1s = std::sqrt(after_N2 / after) / rms_N;
    worst_after_1s = std::sqrt(worst_N2) / rms_N;
  }
};

inline Play hand_on(const AnchoredSprings& object, unsigned seed = kSeed) {
  Play play;
  play.displacement_m = [motion = HandMotion(seed)](double t_s) { return motion.position_m(t_s); };
  play.force_N = [object](double, const Eigen::Vector3d& d_m) { return object.force_N(d_m); };
  return play;
}

// Minimum-jerk pokes of 100 ms to targets around, one every 0.8 s, back and forth.
inline Play poke_on(const AnchoredSprings& object) {
  Play play = hand_on(object);
  play.displacement_m = [](double t_s) {
    static const Eigen::Vector3d targets[] = {{0, 0, 0.018},
                                              {0.012, 0.004, 0.006},
                                              {-0.008, 0.01, 0.01},
                                              {0.002, -0.012, 0.014},
                                              {-0.01, -0.006, 0.004}};
    const double phase_s = std::fmod(t_s, 0.8);
    const Eigen::Vector3d target = targets[static_cast<std::size_t>(t_s / 0.8) % 5];
    const auto rise = [](double u) {
      const double v = std::clamp(u, 0.0, 1.0);
      return v * v * v * (10.0 - 15.0 * v + 6.0 * v * v);
    };
    return Eigen::Vector3d(target * (rise(phase_s / 0.1) - rise((phase_s - 0.45) / 0.1)));
  };
  return play;
}

}  // namespace forcegrid::testing
