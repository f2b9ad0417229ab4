// SPDX-License-Identifier: Apache-2.0
#include "evaluation/judge/judge.h"

#include <algorithm>
#include <deque>
#include <limits>

#include "evaluation/judge/error_figures.h"
#include "forcegrid/core/sample_gate.h"

namespace forcegrid::evaluation {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr int kAllWork = 1 << 30;

// A stretch of the trace within one contact or without any.
struct Phase {
  double begins_s = -kInfinity;
  double known_s = -kInfinity;  ///< when the servo learns of it, unless a sample says so before
  bool in_contact = false;
  std::uint32_t epoch = 0;
  Eigen::Vector3d point_W = Eigen::Vector3d::Zero();
};

std::vector<Phase> phases_of(const Trace& trace) {
  std::vector<Phase> phases(1);
  if (trace.events.empty() || !trace.events.front().made) {
    phases.front().in_contact = true;
    phases.front().epoch = 1;
    phases.front().known_s = kInfinity;
    if (!trace.samples.empty()) {
      phases.front().known_s = trace.samples.front().delivered_s;
      phases.front().point_W = trace.samples.front().sample.position_W;
    }
  }
  for (const ContactEvent& event : trace.events) {
    Phase phase;
    phase.begins_s = event.time_s;
    phase.known_s = event.delivered_s.value_or(event.time_s);
    phase.in_contact = event.made;
    phase.epoch = phases.back().epoch + (event.made ? 1 : 0);
    phase.point_W = event.point_W;
    phases.push_back(phase);
  }
  return phases;
}

class Play {
 public:
  Play(ForceMethod& method, const Trace& trace, const JudgeOptions& options)
      : method_(method),
        trace_(trace),
        options_(options),
        meter_(trace.servo.size()),
        phases_(phases_of(trace)) {
    verdict_.forces_W.reserve(trace.servo.size());
  }

  Verdict run() {
    verdict_.memory_bytes = method_.memory_bytes();
    for (std::size_t i = 0; i < trace_.servo.size(); ++i) {
      const ServoInstant& instant = trace_.servo[i];
      meter_.begin_cycle();
      deliver(instant.time_s);
      query(i);
      request(instant);
      if (options_.work_budget >= 0) {
        meter_.time_work([&] { method_.work(options_.work_budget); });
      }
      meter_.end_cycle();
    }
    verdict_.samples_refused = gate_.refused();
    if (options_.least_cycle_ns != nullptr) {
      meter_.take_least(*options_.least_cycle_ns);
    }
    static_cast<MethodCosts&>(verdict_) = meter_.costs();
    return std::move(verdict_);
  }

 private:
  void work_if_at_once() {
    while (options_.work_budget < 0 && method_.work(kAllWork) > 0) {
    }
  }

  void enter_next_phase() {
    const Phase& phase = phases_[entered_++];
    meter_.time([&] {
      if (phase.in_contact) {
        method_.contact_made(phase.epoch, phase.point_W);
      } else {
        method_.contact_lost();
      }
      gate_.forget();
      work_if_at_once();
    });
  }

  void deliver(double now_s) {
    for (;;) {
      const double phase_s = entered_ < phases_.size() ? phases_[entered_].known_s : kInfinity;
      const double sample_s = next_sample_ < trace_.samples.size()
                                  ? trace_.samples[next_sample_].delivered_s
                                  : kInfinity;
      const double answer_s = answers_.empty() ? kInfinity : answers_.front().delivered_s;
      if (std::min({phase_s, sample_s, answer_s}) > now_s) {
        return;
      }
      if (phase_s <= sample_s && phase_s <= answer_s) {
        enter_next_phase();
      } else if (sample_s <= answer_s) {
        deliver_sample(trace_.samples[next_sample_++].sample);
      } else {
        deliver_answer();
      }
    }
  }

  void deliver_sample(const Sample& recorded) {
    std::size_t of = phases_.size() - 1;
    while (of > 0 && phases_[of].begins_s > recorded.time_s) {
      --of;
    }
    while (entered_ <= of) {
      enter_next_phase();
    }
    if (of + 1 != entered_ || !phases_[of].in_contact) {
      ++verdict_.samples_not_taken;
      return;
    }
    Sample sample = recorded;
    sample.contact_epoch = phases_[of].epoch;
    sample.contact_point_W = phases_[of].point_W;
    sample.from_query = false;
    for (const Sample& passed : gate_.pass(sample)) {
      take(passed);
      ++verdict_.samples_taken;
    }
  }

  void deliver_answer() {
    const Answer answer = answers_.front();
    answers_.pop_front();
    if (answer.asked_in_phase + 1 == entered_ || !phases_[answer.asked_in_phase].in_contact) {
      take(answer.sample);
      ++verdict_.requests_answered;
    }
  }

  void take(Sample sample) {
    if (!options_.stiffness_to_method) {
      sample.has_stiffness = false;
      sample.stiffness_W.setZero();
    }
    meter_.time_sample([&] {
      method_.take_sample(sample);
      work_if_at_once();
    });
  }

  void query(std::size_t i) {
    const ServoInstant& instant = trace_.servo[i];
    meter_.time([&] { method_.observe(instant.time_s, instant.position_W); });
    expect_contact(i);
    ForceEstimate estimate;
    meter_.time_query([&] { estimate = method_.force(instant.time_s, instant.position_W); },
                      [&](std::size_t ahead) {
                        const ServoInstant& at =
                            trace_.servo[std::min(i + ahead, trace_.servo.size() - 1)];
                        return method_.force(at.time_s, at.position_W).force_W.x();
                      });
    verdict_.forces_W.push_back(estimate.force_W);
    const auto status = static_cast<std::size_t>(estimate.status);
    if (status < verdict_.cycles_by_status.size()) {
      ++verdict_.cycles_by_status[status];
    }
  }

  void expect_contact(std::size_t i) {
    expected_W_.reset();
    if (!options_.expect || i == 0 || entered_ == 0 || phases_[entered_ - 1].in_contact) {
      return;
    }
    const ServoInstant& before = trace_.servo[i - 1];
    const ServoInstant& now = trace_.servo[i];
    expected_W_ = options_.expect(
        now.position_W, (now.position_W - before.position_W) / (now.time_s - before.time_s));
    if (expected_W_) {
      meter_.time([&] {
        method_.expect_contact(now.time_s, *expected_W_);
        work_if_at_once();
      });
    }
  }

  void request(const ServoInstant& instant) {
    if (!options_.answer || !(options_.requests_per_s > 0.0)) {
      return;
    }
    const double first_s = trace_.servo.front().time_s;
    for (; first_s + static_cast<double>(next_request_) / options_.requests_per_s <= instant.time_s;
         ++next_request_) {
      if (entered_ == 0) {
        continue;  // the method does not know of the first contact yet
      }
      Eigen::Vector3d wanted_W = Eigen::Vector3d::Zero();
      bool wants = false;
      meter_.time(
          [&] { wants = method_.plan_request(instant.time_s, instant.position_W, wanted_W); });
      if (wants) {
        Answer answer;
        answer.asked_in_phase = entered_ - 1;
        const Phase& phase = phases_[answer.asked_in_phase];
        if (!phase.in_contact && expected_W_) {
          if (!options_.answer_before_contact) {
            continue;
          }
          answer.sample = options_.answer_before_contact(instant.time_s, wanted_W, *expected_W_);
          answer.sample.before_contact = true;
          answer.sample.contact_point_W = *expected_W_;
        } else {
          answer.sample = options_.answer(instant.time_s, wanted_W);
          answer.sample.contact_point_W = phase.point_W;
        }
        answer.sample.from_query = true;
        answer.sample.contact_epoch = phase.epoch;
        answer.delivered_s = instant.time_s + options_.request_delay_s;
        answers_.push_back(answer);
      }
    }
  }

  struct Answer {
    Sample sample;
    double delivered_s = 0.0;
    std::size_t asked_in_phase = 0;
  };

  ForceMethod& method_;
  SampleGate gate_;
  const Trace& trace_;
  const JudgeOptions& options_;
  CostMeter meter_;
  std::vector<Phase> phases_;
  std::size_t entered_ = 0;  ///< number of phases that the method knows
  std::size_t next_sample_ = 0;
  std::deque<Answer> answers_;
  std::size_t next_request_ = 0;               ///< counted from the first servo instant on
  std::optional<Eigen::Vector3d> expected_W_;  ///< where contact is expected at this instant
  Verdict verdict_;
};

void add_errors(const std::vector<ServoInstant>& servo, Verdict& verdict) {
  std::vector<ErrorInstant> instants;
  instants.reserve(servo.size());
  Eigen::Vector3d error_before_W = Eigen::Vector3d::Zero();
  for (std::size_t i = 0; i < servo.size(); ++i) {
    const Eigen::Vector3d error_W = verdict.forces_W[i] - servo[i].force_W;
    instants.push_back({servo[i].time_s, servo[i].force_W.squaredNorm(), error_W.norm(),
                        (error_W - error_before_W).norm()});
    error_before_W = error_W;
  }
  const ForceErrors errors = force_errors(instants);
  verdict.reference_rms_N = errors.reference_rms_N;
  verdict.rms_error_percent_first_1s = errors.first_1s.rms_percent;
  verdict.p95_error_percent_first_1s = errors.first_1s.p95_percent;
  verdict.max_error_percent_first_1s = errors.first_1s.max_percent;
  verdict.rms_error_percent_after_1s = errors.after_1s.rms_percent;
  verdict.p95_error_percent_after_1s = errors.after_1s.p95_percent;
  verdict.max_error_percent_after_1s = errors.after_1s.max_percent;
  verdict.adaptation_s = errors.adaptation_s;
  verdict.largest_step_N = errors.largest_step_N;
}

}  // namespace

Verdict judge(ForceMethod& method, const Trace& trace, const JudgeOptions& options) {
  Verdict verdict = Play(method, trace, options).run();
  add_errors(trace.servo, verdict);
  if (!options.keep_forces) {
    verdict.forces_W = {};
  }
  return verdict;
}

}  // namespace forcegrid::evaluation
