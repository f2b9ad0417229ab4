// SPDX-License-Identifier: Apache-2.0
#include "evaluation/judge/pair_judge.h"

#include <algorithm>
#include <limits>
#include <utility>

namespace forcegrid::evaluation {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr int kAllWork = 1 << 30;

class PairPlay {
 public:
  PairPlay(PairForceMethod& method, const PairTrace& trace, const PairJudgeOptions& options)
      : method_(method),
        trace_(trace),
        options_(options),
        meter_(trace.servo.size()),
        contacts_(trace.contacts) {
    if (contacts_.empty() && !trace.samples.empty()) {
      const DeliveredPairSample& first = trace.samples.front();
      contacts_.push_back({-kInfinity, first.sample.positions_W, first.delivered_s});
    }
    verdict_.forces_W.reserve(trace.servo.size());
  }

  PairVerdict run() {
    verdict_.memory_bytes = method_.memory_bytes();
    for (std::size_t i = 0; i < trace_.servo.size(); ++i) {
      const PairInstant& instant = trace_.servo[i];
      meter_.begin_cycle();
      deliver(instant.time_s);
      query(i);
      if (options_.work_budget >= 0) {
        meter_.time_work([&] { method_.work(options_.work_budget); });
      }
      meter_.end_cycle();
    }
    static_cast<MethodCosts&>(verdict_) = meter_.costs();
    return std::move(verdict_);
  }

 private:
  void work_if_at_once() {
    while (options_.work_budget < 0 && method_.work(kAllWork) > 0) {
    }
  }

  void enter_next_contact() {
    const PairContact& contact = contacts_[entered_++];
    meter_.time([&] {
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
    sample.has_stiffness = sample.has_stiffness && options_.stiffness_to_method;
    sample.contact_epoch = static_cast<std::uint32_t>(of);
    sample.contact_points_W = contacts_[of - 1].points_W;
    ++verdict_.samples_taken;
    meter_.time_sample([&] {
      method_.take_sample(sample);
      work_if_at_once();
    });
  }

  void query(std::size_t i) {
    const PairInstant& instant = trace_.servo[i];
    meter_.time([&] { method_.observe(instant.time_s, instant.positions_W); });
    PairEstimate estimate;
    meter_.time_query([&] { estimate = method_.forces(instant.time_s, instant.positions_W); },
                      [&](std::size_t ahead) {
                        const PairInstant& at =
                            trace_.servo[std::min(i + ahead, trace_.servo.size() - 1)];
                        return method_.forces(at.time_s, at.positions_W).forces_W[0];
                      });
    verdict_.forces_W.push_back(estimate.forces_W);
    ++verdict_.cycles_by_status.at(static_cast<std::size_t>(estimate.status));
  }

  PairForceMethod& method_;
  const PairTrace& trace_;
  const PairJudgeOptions& options_;
  CostMeter meter_;
  std::vector<PairContact> contacts_;
  std::size_t entered_ = 0;  ///< number of contacts that the method knows
  std::size_t next_sample_ = 0;
  PairVerdict verdict_;
};

// @param first, count the components that are judged: all six, or one tool's.
ForceErrors errors_of(const std::vector<PairInstant>& servo,
                      const std::vector<PairVector>& forces_W, Eigen::Index first,
                      Eigen::Index count) {
  std::vector<ErrorInstant> instants;
  instants.reserve(servo.size());
  PairVector error_before_W = PairVector::Zero();
  for (std::size_t i = 0; i < servo.size(); ++i) {
    const PairVector error_W = forces_W[i] - servo[i].forces_W;
    instants.push_back({servo[i].time_s, servo[i].forces_W.segment(first, count).squaredNorm(),
                        error_W.segment(first, count).norm(),
                        (error_W - error_before_W).segment(first, count).norm()});
    error_before_W = error_W;
  }
  return force_errors(instants);
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
