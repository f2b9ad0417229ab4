// SPDX-License-Identifier: Apache-2.0
#include "evaluation/judge.h"

#include <algorithm>
#include <cmath>
#include <deque>
#include <limits>
#include <stdexcept>
#include <string>

#include "evaluation/error_figures.h"
#include "evaluation/stopwatch.h"
#include "forcegrid/core/sample_gate.h"

namespace forcegrid::evaluation {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr int kAllWork = 1 << 30;
// A query faster than this is timed as the mean of a few: clocks tick in steps of up to 10 ns.
constexpr double kShortQuery_ns = 1000.0;
constexpr std::size_t kQueriesInARow = 8;

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
      : method_(method), trace_(trace), options_(options), phases_(phases_of(trace)) {
    query_ns_.reserve(trace.servo.size());
    cycle_ns_.reserve(trace.servo.size());
    verdict_.forces_W.reserve(trace.servo.size());
  }

  Verdict run() {
    verdict_.memory_bytes = method_.memory_bytes();
    for (std::size_t i = 0; i < trace_.servo.size(); ++i) {
      const ServoInstant& instant = trace_.servo[i];
      this_cycle_ns_ = 0.0;
      deliver(instant.time_s);
      query(i);
      request(instant);
      if (options_.work_budget >= 0) {
        const double work_ns = timed([&] { method_.work(options_.work_budget); });
        if (!sample_ns_.empty()) {
          sample_ns_.back() += work_ns;
        }
      }
      cycle_ns_.push_back(this_cycle_ns_);
    }
    verdict_.samples_refused = gate_.refused();
    add_times();
    return std::move(verdict_);
  }

 private:
  template <typename Call>
  double timed(const Call& call) {
    const double ns = stopwatch_.ns_of(call);
    this_cycle_ns_ += ns;
    return ns;
  }

  void work_if_at_once() {
    while (options_.work_budget < 0 && method_.work(kAllWork) > 0) {
    }
  }

  void enter_next_phase() {
    const Phase& phase = phases_[entered_++];
    timed([&] {
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
    sample_ns_.push_back(timed([&] {
      method_.take_sample(sample);
      work_if_at_once();
    }));
  }

  void query(std::size_t i) {
    const ServoInstant& instant = trace_.servo[i];
    timed([&] { method_.observe(instant.time_s, instant.position_W); });
    expect_contact(i);
    ForceEstimate estimate;
    double query_ns = timed([&] { estimate = method_.force(instant.time_s, instant.position_W); });
    if (query_ns < kShortQuery_ns) {
      query_ns = ns_of_queries_from(i);
    }
    query_ns_.push_back(query_ns);
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
      timed([&] {
        method_.expect_contact(now.time_s, *expected_W_);
        work_if_at_once();
      });
    }
  }

  // The mean time of queries along the path from instant `i` on. Queries change nothing, so they do
  // not affect later answers.
  double ns_of_queries_from(std::size_t i) {
    const double ns = stopwatch_.ns_of([&] {
      for (std::size_t next = i; next < i + kQueriesInARow; ++next) {
        const ServoInstant& at = trace_.servo[std::min(next, trace_.servo.size() - 1)];
        const ForceEstimate estimate = method_.force(at.time_s, at.position_W);
        discarded_N_ = estimate.force_W.x();
      }
    });
    return ns / static_cast<double>(kQueriesInARow);
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
      timed([&] { wants = method_.plan_request(instant.time_s, instant.position_W, wanted_W); });
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

  void take_least(std::vector<double>& least_ns) {
    if (least_ns.empty()) {
      least_ns = cycle_ns_;
    }
    if (least_ns.size() != cycle_ns_.size()) {
      throw std::invalid_argument("least_cycle_ns holds " + std::to_string(least_ns.size()) +
                                  " cycles, but the trace has " +
                                  std::to_string(cycle_ns_.size()));
    }
    for (std::size_t i = 0; i < cycle_ns_.size(); ++i) {
      cycle_ns_[i] = least_ns[i] = std::min(least_ns[i], cycle_ns_[i]);
    }
  }

  void add_times() {
    if (options_.least_cycle_ns != nullptr) {
      take_least(*options_.least_cycle_ns);
    }
    const double floor_ns = stopwatch_.floor_ns();
    const double floor_of_query_ns = floor_ns / static_cast<double>(kQueriesInARow);
    const auto at_least = [](double least_ns, double ns) {
      return ns < least_ns ? least_ns : ns;  // a NaN remains
    };
    const auto time_ns = [&](std::vector<double>& times_ns, double p) {
      return at_least(floor_ns, percentile(times_ns, p));
    };
    verdict_.timer_floor_ns = floor_ns;
    verdict_.query_ns_median = at_least(floor_of_query_ns, percentile(query_ns_, 0.5));
    verdict_.query_ns_p99 = at_least(floor_of_query_ns, percentile(query_ns_, 0.99));
    verdict_.sample_us_median = 1e-3 * time_ns(sample_ns_, 0.5);
    verdict_.sample_us_p99 = 1e-3 * time_ns(sample_ns_, 0.99);
    double sum_ns = 0.0;
    for (const double ns : cycle_ns_) {
      sum_ns += ns;
    }
    verdict_.cycle_ns = cycle_ns_.empty()
                            ? kNan
                            : at_least(floor_ns, sum_ns / static_cast<double>(cycle_ns_.size()));
    verdict_.cycle_ns_median = time_ns(cycle_ns_, 0.5);
    verdict_.cycle_ns_p99 = time_ns(cycle_ns_, 0.99);
    verdict_.cycle_ns_p999 = time_ns(cycle_ns_, 0.999);
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
  const Stopwatch stopwatch_;
  std::vector<Phase> phases_;
  std::size_t entered_ = 0;  ///< number of phases that the method knows
  std::size_t next_sample_ = 0;
  std::deque<Answer> answers_;
  std::size_t next_request_ = 0;               ///< counted from the first servo instant on
  std::optional<Eigen::Vector3d> expected_W_;  ///< where contact is expected at this instant
  double this_cycle_ns_ = 0.0;
  volatile double discarded_N_ = 0.0;  ///< so that no query is optimised away
  std::vector<double> query_ns_;
  std::vector<double> sample_ns_;
  std::vector<double> cycle_ns_;
  Verdict verdict_;
};

void add_errors(const std::vector<ServoInstant>& servo, Verdict& verdict) {
  if (servo.empty()) {
    return;
  }
  double reference_sum = 0.0;
  std::vector<double> since_start_s;
  std::vector<double> error_N;
  std::vector<double> first_N;
  std::vector<double> after_N;
  verdict.largest_step_N = kNan;
  Eigen::Vector3d error_before_W = Eigen::Vector3d::Zero();
  for (std::size_t i = 0; i < servo.size(); ++i) {
    reference_sum += servo[i].force_W.squaredNorm();
    const Eigen::Vector3d error_W = verdict.forces_W[i] - servo[i].force_W;
    since_start_s.push_back(servo[i].time_s - servo.front().time_s);
    error_N.push_back(error_W.norm());
    if (since_start_s.back() < 1.0) {
      first_N.push_back(error_N.back());
    } else {
      if (!after_N.empty()) {
        const double step_N = (error_W - error_before_W).norm();
        verdict.largest_step_N = step_N <= verdict.largest_step_N ? verdict.largest_step_N : step_N;
      }
      after_N.push_back(error_N.back());
    }
    error_before_W = error_W;
  }
  verdict.reference_rms_N = std::sqrt(reference_sum / static_cast<double>(servo.size()));
  verdict.adaptation_s = adaptation_s(since_start_s, error_N, verdict.reference_rms_N);
  const ErrorFigures first = error_figures(std::move(first_N), verdict.reference_rms_N);
  verdict.rms_error_percent_first_1s = first.rms_percent;
  verdict.p95_error_percent_first_1s = first.p95_percent;
  verdict.max_error_percent_first_1s = first.max_percent;
  const ErrorFigures after = error_figures(std::move(after_N), verdict.reference_rms_N);
  verdict.rms_error_percent_after_1s = after.rms_percent;
  verdict.p95_error_percent_after_1s = after.p95_percent;
  verdict.max_error_percent_after_1s = after.max_percent;
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
