// SPDX-License-Identifier: Apache-2.0
#include "evaluation/scenarios/blind_limit.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

namespace forcegrid::evaluation {
namespace {

using Eigen::Vector3d;

constexpr double kOtherForce_N = 0.1;
constexpr double kOtherForce = 0.01;  // of the true force, ...
constexpr double kNoForce_N = 1e-3;   // ... unless that is less than the simulator's own error

class Blind {
 public:
  explicit Blind(const TouchedObject& object) : object_(object) {}

  void take(const Sample& sample) {
    const double time_s = sample.time_s;
    const Vector3d& position_W = sample.position_W;
    const Vector3d true_N = object_.answer_on_path(time_s, position_W).force_W;
    if (known_) {
      known_->slid_until_s = std::max(known_->slid_until_s, time_s);
    }
    const double other_N = (true_N - force_W(time_s, position_W)).norm();
    if (!known_ || other_N > kOtherForce_N ||
        other_N > std::max(kNoForce_N, kOtherForce * true_N.norm())) {
      known_ = object_.law_with_sample(known_.value_or(ForceLaw{}), time_s, position_W);
    }
  }

  Vector3d force_W(double time_s, const Vector3d& position_W) const {
    return known_ ? object_.force_on_path_W(time_s, position_W, *known_)
                  : Vector3d(Vector3d::Zero());
  }

 private:
  const TouchedObject& object_;
  std::optional<ForceLaw> known_;
};

struct Mean {
  double sum_N2 = 0.0;
  double count = 0.0;
  void add(double error_N2) {
    sum_N2 += error_N2;
    count += 1.0;
  }
  double root_N() const {
    return count > 0.0 ? std::sqrt(sum_N2 / count) : std::numeric_limits<double>::quiet_NaN();
  }
};

}  // namespace

BlindLimit blind_limit(const TouchedObject& object, const Trace& trace) {
  Blind blind(object);
  Mean reference;
  Mean first;
  Mean after;
  std::size_t next = 0;
  for (const ServoInstant& instant : trace.servo) {
    for (; next < trace.samples.size() && trace.samples[next].delivered_s <= instant.time_s;
         ++next) {
      blind.take(trace.samples[next].sample);
    }
    const double error_N2 =
        (blind.force_W(instant.time_s, instant.position_W) - instant.force_W).squaredNorm();
    reference.add(instant.force_W.squaredNorm());
    (instant.time_s - trace.servo.front().time_s < 1.0 ? first : after).add(error_N2);
  }
  const double to_percent = 100.0 / reference.root_N();
  return {to_percent * first.root_N(), to_percent * after.root_N()};
}

}  // namespace forcegrid::evaluation
