// SPDX-License-Identifier: Apache-2.0
#include "evaluation/pair_judge.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <utility>

#include "evaluation/stopwatch.h"

namespace forcegrid::evaluation {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr int kAllWork = 1 << 30;
// As judge(): clocks tick in steps of up to 10 ns, so a fast query is timed as the mean of a few.
constexpr double kShortQuery_ns = 1000.0;
constexpr std::size_t kQueriesInARow = 8;

class PairPlay {
 public:
  PairPlay(PairForceMethod& method, const PairTrace& trace, const PairJudgeOptions& options)
      : method_(method), trace_(trace), options_(options), contacts_(trace.contacts) {
    if (contacts_.empty() && !trace.samples.empty()) {
      const DeliveredPairSample& first = trace.samples.front();
      contacts_.push_back({-kInfinity, first.sample.positions_W, first.delivered_s});
    }
    query_ns_.reserve(trace.servo.size());
    cycle_ns_.reserve(trace.servo.size());
    verdict_.forces_W.reserve(trace.servo.size());
  }

  PairVerdict run() {
    verdict_.memory_bytes = method_.memory_bytes();
    for (std::size_t i = 0; i < trace_.servo.size(); ++i) {
      const PairInstant& instant = trace_.servo[i];
      this_cycle_ns_ = 0.0;
      deliver(instant.time_s);
      query(i);
      if (options_.work_budget >= 0) {
        const double work_ns = timed([&] { method_.work(options_.work_budget); });
        if (!sample_ns_.empty()) {
          sample_ns_.back() += work_ns;
        }
      }
      cycle_ns_.push_back(this_cycle_ns_);
    }
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

  void enter_next_contact() {
    const PairContact& contact = contacts_[entered_++];
    timed([&] {
      method_.contacts_made(static_cast<std::uint32_t>(entered_), contact.points_W);
      work_if_at_once();
    });
  }

  void deliver(double now_s) {
    for (;;) {
      const double contact_s =
          entered_ < contacts_.size()
              ? contacts_[entered_].delivered_s.value_or(contacts_[entered_].time_s)
              : kInfinity;
      const double sample_s = next_sample_ < trace_.samples.size()
                                  ? trace_.samples[next_sample_].delivered_s
                                  : kInfinity;
      if (std::min(contact_s, sample_s) > now_s) {
        return;
      }
      if (contact_s <= sample_s) {
        enter_next_contact();
      } else {
        deliver_sample(trace_.samples[next_sample_++].sample);
      }
    }
  }

  // A sample belongs to the contact in which its time lies; one of an earlier contact is kept from
  // the method, one of a newer contact tells it of that contact.
  void deliver_sample(PairSample sample) {
    std::size_t of = 0;
    while (of < contacts_.size() && contacts_[of].time_s <= sample.time_s) {
      ++of;
    }
    while (entered_ < of) {
      enter_next_contact();
    }
    if (of == 0 || of != entered_) {
      ++verdict_.samples_not_taken;
      return;
    }
    sample.contact_epoch = static_cast<std::uint32_t>(of);
    sample.contact_points_W = contacts_[of - 1].points_W;
    ++verdict_.samples_taken;
    sample_ns_.push_back(timed([&] {
      method_.take_sample(sample);
      work_if_at_once();
    }));
  }

  void query(std::size_t i) {
    const PairInstant& instant = trace_.servo[i];
    timed([&] { method_.observe(instant.time_s, instant.positions_W); });
    PairEstimate estimate;
    double query_ns =
        timed([&] { estimate = method_.forces(instant.time_s, instant.positions_W); });
    if (query_ns < kShortQuery_ns) {
      query_ns = ns_of_queries_from(i);
    }
    query_ns_.push_back(query_ns);
    verdict_.forces_W.push_back(estimate.forces_W);
    ++verdict_.cycles_by_status.at(static_cast<std::size_t>(estimate.status));
  }

  // Queries change nothing, so those along the path ahead do not affect later answers.
  double ns_of_queries_from(std::size_t i) {
    const double ns = stopwatch_.ns_of([&] {
      for (std::size_t next = i; next < i + kQueriesInARow; ++next) {
        const PairInstant& at = trace_.servo[std::min(next, trace_.servo.size() - 1)];
        const PairEstimate estimate = method_.forces(at.time_s, at.positions_W);
        discarded_N_ = estimate.forces_W[0];
      }
    });
    return ns / static_cast<double>(kQueriesInARow);
  }

  void add_times() {
    const double floor_ns = stopwatch_.floor_ns();
    const auto at_least = [](double least_ns, double ns) {
      return ns < least_ns ? least_ns : ns;  // a NaN remains
    };
    const auto time_ns = [&](std::vector<double>& times_ns, double p) {
      return at_least(floor_ns, percentile(times_ns, p));
    };
    const double floor_of_query_ns = floor_ns / static_cast<double>(kQueriesInARow);
    verdict_.timer_floor_ns = floor_ns;
    verdict_.query_ns_median = at_least(floor_of_query_ns, percentile(query_ns_, 0.5));
    verdict_.query_ns_p99 = at_least(floor_of_query_ns, percentile(query_ns_, 0.99));
    verdict_.sample_us_median = 1e-3 * time_ns(sample_ns_, 0.5);
    verdict_.sample_us_p99 = 1e-3 * time_ns(sample_ns_, 0.99);
    verdict_.cycle_ns =
        at_least(floor_ns, std::accumulate(cycle_ns_.begin(), cycle_ns_.end(), 0.0) /
                               static_cast<double>(cycle_ns_.size()));
    verdict_.cycle_ns_median = time_ns(cycle_ns_, 0.5);
    verdict_.cycle_ns_p99 = time_ns(cycle_ns_, 0.99);
    verdict_.cycle_ns_p999 = time_ns(cycle_ns_, 0.999);
  }

  PairForceMethod& method_;
  const PairTrace& trace_;
  const PairJudgeOptions& options_;
  const Stopwatch stopwatch_;
  std::vector<PairContact> contacts_;
  std::size_t entered_ = 0;  ///< number of contacts that the method knows
  std::size_t next_sample_ = 0;
  double this_cycle_ns_ = 0.0;
  volatile double discarded_N_ = 0.0;  ///< so that no query is optimised away
  std::vector<double> query_ns_;
  std::vector<double> sample_ns_;
  std::vector<double> cycle_ns_;
  PairVerdict verdict_;
};

// @param first, count the components that are judged: all six, or one tool's.
PairErrors errors_of(const std::vector<PairInstant>& servo, const std::vector<PairVector>& forces_W,
                     Eigen::Index first, Eigen::Index count) {
  PairErrors errors;
  errors.largest_step_N = kNan;
  double reference_sum = 0.0;
  std::vector<double> since_start_s;
  std::vector<double> error_N;
  std::vector<double> first_N;
  std::vector<double> after_N;
  PairVector error_before_W = PairVector::Zero();
  for (std::size_t i = 0; i < servo.size(); ++i) {
    reference_sum += servo[i].forces_W.segment(first, count).squaredNorm();
    const PairVector error_W = forces_W[i] - servo[i].forces_W;
    since_start_s.push_back(servo[i].time_s - servo.front().time_s);
    error_N.push_back(error_W.segment(first, count).norm());
    if (since_start_s.back() < 1.0) {
      first_N.push_back(error_N.back());
    } else {
      if (!after_N.empty()) {
        const double step_N = (error_W - error_before_W).segment(first, count).norm();
        errors.largest_step_N = step_N <= errors.largest_step_N ? errors.largest_step_N : step_N;
      }
      after_N.push_back(error_N.back());
    }
    error_before_W = error_W;
  }
  errors.reference_rms_N = std::sqrt(reference_sum / static_cast<double>(servo.size()));
  errors.adaptation_s = adaptation_s(since_start_s, error_N, errors.reference_rms_N);
  errors.first_1s = error_figures(std::move(first_N), errors.reference_rms_N);
  errors.after_1s = error_figures(std::move(after_N), errors.reference_rms_N);
  return errors;
}

}  // namespace

PairVerdict judge_pair(PairForceMethod& method, const PairTrace& trace,
                       const PairJudgeOptions& options) {
  PairVerdict verdict = PairPlay(method, trace, options).run();
  verdict.together = errors_of(trace.servo, verdict.forces_W, 0, 6);
  for (std::size_t tool = 0; tool < verdict.tools.size(); ++tool) {
    verdict.tools[tool] =
        errors_of(trace.servo, verdict.forces_W, static_cast<Eigen::Index>(3 * tool), 3);
  }
  if (!options.keep_forces) {
    verdict.forces_W = {};
  }
  return verdict;
}

}  // namespace forcegrid::evaluation
