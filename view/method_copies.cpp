// SPDX-License-Identifier: Apache-2.0
#include "view/method_copies.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "forcegrid/method_variant.h"
#include "forcegrid/methods.h"
#include "forcegrid/pair_methods.h"
#include "rt/vectors.h"

namespace forcegrid::view {
namespace {

constexpr char kDirect[] = "direct";

// In place of a method that can't be copied.
class NoCopy final : public ForceMethod {
 public:
  const char* name() const noexcept override { return kDirect; }
  std::size_t memory_bytes() const noexcept override { return sizeof(*this); }
  void take_sample(const Sample&) noexcept override {}
  void contact_made(std::uint32_t, const Eigen::Vector3d&) noexcept override {}
  void contact_lost() noexcept override {}
  int work(int) noexcept override { return 0; }
  ForceEstimate force(double, const Eigen::Vector3d&) const noexcept override { return {}; }
};

// A method over two tools learns from both, and the feed of one device has its own samples only.
bool has_copy(const std::string& text) {
  return text != kDirect && !is_pair_method(text.substr(0, text.find(' ')));
}

servo::ArrivedSample arrived_of(const view_link::FeedSample& sent) {
  servo::ArrivedSample arrived;
  Sample& sample = arrived.sample;
  sample.time_s = sent.time_s;
  sample.position_W = rt::to_vector(sent.position_W_m);
  sample.force_W = rt::to_vector(sent.force_W_N);
  sample.has_stiffness = sent.has_stiffness != 0;
  sample.stiffness_W = Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(
      sent.stiffness_W_N_per_m.data());
  sample.contact_epoch = sent.contact_epoch;
  sample.contact_point_W = rt::to_vector(sent.contact_point_W_m);
  sample.relative_residual = sent.relative_residual;
  sample.converged = sent.converged != 0;
  sample.from_query = sent.requested != 0;
  arrived.in_contact = sent.in_contact != 0;
  arrived.arrived = rt::TimePoint(rt::Duration(sent.arrived_ns));
  return arrived;
}

}  // namespace

MethodCopies::MethodCopies(Options options)
    : options_(std::move(options)), first_touch_(options_.max_force_N) {
  begin_anew();
}

void MethodCopies::restart() {
  first_touch_ = servo::FirstTouch(options_.max_force_N);
  samples_.clear();
  cycles_.clear();
  arrivals_ = taken_ = next_cycle_ = 0;
  begun_ = false;
  exact_ = true;
  time_s_ = 0.0;
  largest_difference_N_ = 0.0;
  begin_anew();
}

void MethodCopies::begin_anew() {
  copies_.clear();
  methods_.clear();
  budget_reads_ = std::numeric_limits<double>::quiet_NaN();
  for (const std::string& text : options_.methods) {
    if (!has_copy(text)) {
      copies_.push_back(std::make_unique<NoCopy>());
    } else {
      const MethodVariant variant = parse_method_variant(text, options_.base);
      copies_.push_back(make_force_method(variant.name, variant.options));
    }
    methods_.push_back(copies_.back().get());
  }
  if (methods_.empty()) {
    throw std::invalid_argument("the run has no force method");
  }
  ports_ = std::make_unique<servo::ServoPorts>();
  intake_ = std::make_unique<servo::SampleIntake>(
      *ports_, methods_,
      servo::SampleIntake::Options{.max_force_N = options_.max_force_N,
                                   .simulator_rate_Hz = options_.simulator_rate_Hz,
                                   .requests_per_s = options_.requests_per_s});
}

void MethodCopies::take(const view_link::FeedSample& sample) {
  samples_.push_back(arrived_of(sample));
  ++arrivals_;
  while (!cycles_.empty() && cycles_.front().arrivals_taken <= arrivals_) {
    replay(cycles_.front());
    cycles_.pop_front();
  }
  while (samples_.size() > kMostWaiting) {  // no cycle takes them: cycles are missing
    samples_.pop_front();
    ++taken_;
    exact_ = false;
  }
}

void MethodCopies::take(const view_link::FeedCycle& cycle) {
  if (begun_ && cycle.cycle != next_cycle_) {
    exact_ = false;
    begin_anew();
  }
  exact_ = exact_ && (begun_ || cycle.cycle <= 1);
  begun_ = true;
  next_cycle_ = cycle.cycle + 1;
  if (cycles_.empty() && cycle.arrivals_taken <= arrivals_) {
    replay(cycle);
    return;
  }
  cycles_.push_back(cycle);
  if (cycles_.size() > kMostWaiting) {  // the sample will not come any more
    exact_ = false;
    arrivals_ = std::max(arrivals_, cycles_.back().arrivals_taken);
    for (const view_link::FeedCycle& waiting : std::exchange(cycles_, {})) {
      replay(waiting);
    }
  }
}

// As ServoLoop::take_settings().
void MethodCopies::take_settings(const view_link::FeedCycle& cycle) {
  if (std::isfinite(cycle.requests_per_s) && cycle.requests_per_s >= 0.0) {
    intake_->set_requests_per_s(cycle.requests_per_s);
  }
  if (cycle.budget_reads > 0.0 && cycle.budget_reads != budget_reads_) {
    budget_reads_ = cycle.budget_reads;
    for (ForceMethod* method : methods_) {
      method->set_budget(budget_reads_);
    }
  }
}

// As ServoLoop::run_cycle() calls them.
void MethodCopies::replay(const view_link::FeedCycle& cycle) {
  for (; taken_ < cycle.arrivals_taken && !samples_.empty(); ++taken_) {
    static_cast<void>(ports_->samples.push(samples_.front()));
    samples_.pop_front();
  }
  taken_ = std::max(taken_, cycle.arrivals_taken);
  const rt::TimePoint now(rt::Duration(cycle.time_ns));
  const Eigen::Vector3d touching_W = rt::to_vector(cycle.touching_W_m);
  time_s_ = servo::servo_time_s(now);
  take_settings(cycle);
  intake_->take(now, first_touch_);
  for (std::size_t i = 0; i < methods_.size(); ++i) {
    if (cycle.fault == 0) {
      methods_[i]->observe(time_s_, touching_W);
    }
    if (intake_->expected_contact_W()) {
      methods_[i]->expect_contact(time_s_, *intake_->expected_contact_W());
    }
    const ForceEstimate estimate = methods_[i]->force(time_s_, touching_W);
    if (has_copy(options_.methods[i]) && i < view_link::kFeedMethods) {
      const double difference_N =
          (estimate.force_W - rt::to_vector(cycle.method_force_W_N[i])).norm();
      largest_difference_N_ = std::max(largest_difference_N_, difference_N);
    }
  }
  if (cycle.fault == 0) {
    intake_->query_if_due(now, touching_W);
    link::Query query;
    while (ports_->queries.pop(query)) {
    }
  }
  for (ForceMethod* method : methods_) {
    method->work(options_.fill_budget);
  }
}

ForceEstimate MethodCopies::force(std::size_t index, const Eigen::Vector3d& position_W) const {
  return methods_.at(index)->force(time_s_, position_W);
}

std::size_t MethodCopies::storage_blocks(std::size_t index, std::span<StorageBlock> blocks) const {
  const auto* const with_blocks = dynamic_cast<const StorageBlocks*>(methods_.at(index));
  return with_blocks != nullptr ? with_blocks->storage_blocks(blocks) : 0;
}

}  // namespace forcegrid::view
