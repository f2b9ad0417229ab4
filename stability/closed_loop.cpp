// SPDX-License-Identifier: Apache-2.0
#include "stability/closed_loop.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <numbers>
#include <optional>
#include <stdexcept>

#include "servo_loop/motion_guard.h"
#include "stability/settling.h"

namespace forcegrid::stability {
namespace {

using Eigen::Vector3d;

constexpr double kComingToRest_s = 0.1;
// As in evaluation::ContactErrors.
constexpr double kFirstWindows_s[] = {1.0 / 15.0, 0.25};

std::int64_t nanoseconds(double time_s) { return std::llround(1e9 * time_s); }

// Impulses on a device that nobody holds, in several directions.
const Vector3d& flick_direction_W() {
  static const Vector3d direction_W = Vector3d(2.0, -1.0, 2.0) / 3.0;
  return direction_W;
}

servo::PassivityOptions within_timing(const LoopSetup& setup) {
  servo::PassivityOptions options = setup.passivity;
  options.transport_delay_s = setup.timing.count_age_s + setup.timing.actuation_delay_s;
  return options;
}

class Run {
 public:
  Run(const LoopSetup& setup, VirtualObject& object, ForceMethod* method)
      : setup_(setup),
        object_(object),
        method_(method),
        plant_(setup.device, setup.hand, setup.contact_point_W),
        simulator_(setup.network, setup.fault, setup.seed),
        gate_(setup.device.max_force_N),
        guard_(within_timing(setup)),
        count_age_ns_(nanoseconds(setup.timing.count_age_s)),
        actuation_ns_(nanoseconds(setup.timing.actuation_delay_s)),
        sampled_W_(setup.contact_point_W),
        last_measured_W_(setup.contact_point_W) {
    guard_.set_resolution(Vector3d::Constant(setup.device.position_step_m));
    if (!(setup.servo_rate_Hz >= 50.0 && setup.servo_rate_Hz <= 20000.0)) {
      throw std::invalid_argument("servo rate: use 50 to 20000 Hz");
    }
    if (!(setup.hold_s >= StatedRun::kJudged_s)) {
      throw std::invalid_argument("hold: use at least the 2 s that the criterion covers");
    }
    if (count_age_ns_ < 0 || actuation_ns_ < 0 ||
        count_age_ns_ + actuation_ns_ > cycle_ns(1) - cycle_ns(0)) {
      throw std::invalid_argument("device timing " + setup.timing.name +
                                  ": age of the counts and delay of the force take longer than a "
                                  "cycle; use a lower servo rate or a quicker bus");
    }
  }

  LoopResult closed() {
    judged_until_s_ = stated_end_s();
    std::int64_t cycle = run_until(0, stated_end_s());
    settling_ = judge_settling(held_W_);
    double least_m = settling_.peak_to_peak_m;
    int not_less = 0;  // windows in a row
    for (double end_s = stated_end_s() + StatedRun::kJudged_s;
         end_s <= stated_end_s() + setup_.longest_settling_s && not_less < 2 && !diverged() &&
         settling_.behaviour != Behaviour::kStable;
         end_s += StatedRun::kJudged_s) {
      held_W_.clear();
      cycle = run_until(cycle, end_s);
      settling_ = judge_settling(held_W_);
      not_less = settling_.peak_to_peak_m < least_m ? 0 : not_less + 1;
      least_m = std::min(least_m, settling_.peak_to_peak_m);
    }
    return result(cycle);
  }

  LoopResult open(const evaluation::Trajectory& trajectory) {
    const auto cycles =
        static_cast<std::int64_t>(std::floor(trajectory.duration_s() * setup_.servo_rate_Hz));
    const Vector3d begin_W = trajectory.position_W(0.0);
    for (std::int64_t cycle = 0; cycle < cycles; ++cycle) {
      const double now_s = 1e-9 * static_cast<double>(cycle_ns(cycle));
      sampled_W_ = setup_.contact_point_W + trajectory.position_W(now_s) - begin_W;
      static_cast<void>(rendered_W(cycle));
    }
    LoopResult all = result(cycles);
    all.energy_generated_J = all.most_energy_generated_J = std::nan("");
    all.most_energy_to_hand_J = all.damped_energy_J = std::nan("");
    return all;
  }

 private:
  double stated_end_s() const { return StatedRun::kMotion_s + setup_.hold_s; }

  // Returns the cycle after the last one that was run.
  std::int64_t run_until(std::int64_t cycle, double end_s) {
    const auto end = static_cast<std::int64_t>(std::llround(end_s * setup_.servo_rate_Hz));
    for (; cycle < end && !diverged(); ++cycle) {
      one_cycle(cycle);
    }
    return cycle;
  }

  LoopResult result(std::int64_t cycle) const {
    LoopResult result;
    result.end_s = 1e-9 * static_cast<double>(cycle_ns(cycle));
    result.behaviour = diverged() ? Behaviour::kDivergence : settling_.behaviour;
    result.hold_peak_to_peak_m = diverged() ? std::nan("") : settling_.peak_to_peak_m;
    result.reference_rms_N =
        cycles_judged_ > 0 ? std::sqrt(reference_square_N2_ / cycles_judged_) : 0.0;
    result.force_error_percent = reference_square_N2_ > 0.0
                                     ? 100.0 * std::sqrt(error_square_N2_ / reference_square_N2_)
                                     : std::nan("");
    result.energy_generated_J = generated_J_;
    result.most_energy_generated_J = most_generated_J_;
    result.most_energy_to_hand_J = guard_.largest_energy_to_hand_J();
    result.damped_energy_J = guard_.damped_energy_J();
    result.largest_force_N = largest_force_N_;
    result.samples_taken = samples_taken_;
    result.samples_refused = gate_.refused();
    result.samples_lost = simulator_.lost();
    result.first_67ms_error_percent = first_percent(0);
    result.first_250ms_error_percent = first_percent(1);
    result.touches = touches_;
    result.requests_made = requests_made_;
    result.answers_taken = answers_taken_;
    result.answers_before = answers_before_;
    result.rattle_N = changes_ > 0.0 ? std::sqrt(change_square_N2_ / changes_) : 0.0;
    return result;
  }

  std::int64_t cycle_ns(std::int64_t cycle) const {
    return std::llround(1e9 * static_cast<double>(cycle) / setup_.servo_rate_Hz);
  }

  bool diverged() const {
    const Vector3d away_W = plant_.position_W() - plant_.target_W();
    return !away_W.allFinite() || !force_W_.allFinite() || away_W.norm() > StatedRun::kDivergence_m;
  }

  void take_samples(std::int64_t now_ns) {
    while (const auto answer = simulator_.receive(now_ns)) {
      if (answer->sample.from_query) {
        take_answer(answer->sample);
        continue;
      }
      ++samples_taken_;
      if (!setup_.sees_contacts) {
        learn_contact(answer->in_contact, answer->sample.contact_epoch,
                      answer->sample.contact_point_W);
      }
      if (!answer->in_contact) {
        air_epoch_ = answer->sample.contact_epoch;
      }
      expected_W_ = in_contact_ ? std::nullopt : answer->expected_W;
      if (in_contact_ && answer->in_contact && answer->sample.contact_epoch == epoch_) {
        for (const Sample& sample : gate_.pass(answer->sample)) {
          method_->take_sample(sample);
        }
      }
    }
  }

  void learn_contact(bool in_contact, std::uint32_t epoch, const Vector3d& point_W) {
    const bool news = !contact_known_ || epoch != epoch_;
    if (in_contact && (news || !in_contact_)) {
      gate_.forget();
      method_->contact_made(epoch, point_W);
      expected_W_.reset();
    } else if (!in_contact && (in_contact_ || !contact_known_)) {
      gate_.forget();
      method_->contact_lost();
    }
    contact_known_ = true;
    in_contact_ = in_contact;
    epoch_ = epoch;
  }

  void take_answer(Sample sample) {
    const bool asked_in_the_air = sample.before_contact;
    sample.before_contact = asked_in_the_air && method_->needs().requests_before_contact &&
                            sample.contact_epoch == air_epoch_;
    const bool of_this_contact = !asked_in_the_air && in_contact_ && sample.contact_epoch == epoch_;
    if (contact_known_ && (sample.before_contact || of_this_contact)) {
      method_->take_sample(sample);
      ++answers_taken_;
      answers_before_ += sample.before_contact ? 1 : 0;
    }
  }

  Vector3d method_force_W(std::int64_t now_ns, double period_s, const Vector3d& measured_W) {
    const double share = -std::expm1(-period_s / servo::MotionGuard::kVelocityTimeConstant_s);
    velocity_W_ += share * ((measured_W - last_measured_W_) / period_s - velocity_W_);
    simulator_.publish(now_ns, measured_W, velocity_W_, object_);
    if (setup_.sees_contacts) {
      const VirtualObject::Contact contact = object_.contact();
      learn_contact(contact.in_contact, contact.epoch, contact.point_W);
    }
    take_samples(now_ns);
    const double now_s = 1e-9 * static_cast<double>(now_ns);
    method_->observe(now_s, measured_W);
    if (expected_W_) {
      method_->expect_contact(now_s, *expected_W_);
    }
    return method_->force(now_s, measured_W).force_W;
  }

  void request_if_due(std::int64_t now_ns, const Vector3d& measured_W) {
    const double rate_per_s = setup_.network.requests_per_s;
    if (!(rate_per_s > 0.0) || now_ns < next_request_ns_) {
      return;
    }
    const std::int64_t interval_ns = nanoseconds(1.0 / rate_per_s);
    next_request_ns_ += interval_ns;
    if (next_request_ns_ <= now_ns) {
      next_request_ns_ = now_ns + interval_ns;
    }
    Vector3d wanted_W = Vector3d::Zero();
    const bool may_ask = in_contact_ || (expected_W_ && method_->needs().requests_before_contact);
    if (may_ask &&
        method_->plan_request(1e-9 * static_cast<double>(now_ns), measured_W, wanted_W)) {
      requests_made_ += simulator_.ask(now_ns, wanted_W, object_) ? 1 : 0;
    }
  }

  // The servo's part of a cycle; does not move the tool.
  Vector3d rendered_W(std::int64_t cycle) {
    const std::int64_t now_ns = cycle_ns(cycle);
    const double period_s = 1e-9 * static_cast<double>(cycle_ns(cycle + 1) - now_ns);
    const double now_s = 1e-9 * static_cast<double>(now_ns);
    const Vector3d measured_W = plant_.measured_W(sampled_W_);
    object_.advance(now_s, measured_W);
    const Vector3d reference_W = object_.at(measured_W).force_W;
    Vector3d wanted_W =
        method_ == nullptr ? reference_W : method_force_W(now_ns, period_s, measured_W);
    wanted_W -= setup_.virtual_damping_N_s_per_m / period_s * (measured_W - last_measured_W_);
    last_measured_W_ = measured_W;
    wanted_W = guard_.apply(cycle == 0 ? 0.0 : period_s, measured_W, wanted_W);
    judge(now_s, wanted_W, reference_W);
    const double size_N = wanted_W.norm();
    if (size_N > setup_.device.max_force_N) {
      wanted_W *= setup_.device.max_force_N / size_N;
    }
    guard_.set_rendered(wanted_W);
    largest_force_N_ = std::max(largest_force_N_, wanted_W.norm());
    if (method_ != nullptr) {
      request_if_due(now_ns, measured_W);
      method_->work(setup_.fill_budget);
    }
    return wanted_W;
  }

  void judge(double now_s, const Vector3d& rendered_W, const Vector3d& reference_W) {
    const Vector3d error_W = rendered_W - reference_W;
    if (now_s >= setup_.errors_from_s && now_s < judged_until_s_) {
      error_square_N2_ += error_W.squaredNorm();
      reference_square_N2_ += reference_W.squaredNorm();
      cycles_judged_ += 1.0;
    }
    if (holds_still(now_s) && now_s < judged_until_s_) {
      change_square_N2_ += (error_W - last_error_W_).squaredNorm();
      changes_ += 1.0;
    }
    last_error_W_ = error_W;
    judge_touch(now_s, error_W, reference_W);
  }

  void judge_touch(double now_s, const Vector3d& error_W, const Vector3d& reference_W) {
    const bool touching = object_.contact().in_contact;
    if (touching && was_in_the_air_) {
      ++touches_;
      touched_s_ = now_s;
    }
    was_in_the_air_ = !touching;
    if (!touching) {
      return;
    }
    contact_square_N2_ += reference_W.squaredNorm();
    contact_cycles_ += 1.0;
    for (std::size_t i = 0; i < std::size(kFirstWindows_s) && touches_ > 0; ++i) {
      if (now_s - touched_s_ < kFirstWindows_s[i]) {
        first_square_N2_[i] += error_W.squaredNorm();
        first_cycles_[i] += 1.0;
      }
    }
  }

  // In % of the RMS of |F_o| in contact.
  double first_percent(std::size_t window) const {
    return touches_ == 0 ? std::nan("")
                         : 100.0 * std::sqrt(first_square_N2_[window] / first_cycles_[window] *
                                             contact_cycles_ / contact_square_N2_);
  }

  // Whether the criterion's windows have begun.
  bool holds_still(double now_s) const { return now_s >= stated_end_s() - StatedRun::kJudged_s; }

  void one_cycle(std::int64_t cycle) {
    const std::int64_t now_ns = cycle_ns(cycle);
    const std::int64_t next_ns = cycle_ns(cycle + 1);
    const double now_s = 1e-9 * static_cast<double>(now_ns);
    const Vector3d wanted_W = rendered_W(cycle);
    flick_if_due(now_s, 1e-9 * static_cast<double>(next_ns - now_ns));

    const Vector3d object_begin_W = object_.at(plant_.position_W()).force_W;
    const Vector3d begin_W = plant_.position_W();
    move(now_ns, now_ns + actuation_ns_);
    force_W_ = wanted_W;
    move(now_ns + actuation_ns_, next_ns - count_age_ns_);
    sampled_W_ = plant_.position_W();
    move(next_ns - count_age_ns_, next_ns);
    const Vector3d moved_W = plant_.position_W() - begin_W;
    generated_J_ -= 0.5 * (object_begin_W + object_.at(plant_.position_W()).force_W).dot(moved_W);
    most_generated_J_ = std::max(most_generated_J_, generated_J_);
    if (holds_still(now_s)) {
      held_W_.push_back(plant_.position_W());
    }
  }

  void flick_if_due(double now_s, double period_s) {
    const double since_first_s = now_s - StatedRun::kFirstFlick_s + 0.5 * period_s;
    if (setup_.hand.holds() || now_s >= StatedRun::kMotion_s || since_first_s < 0.0) {
      return;
    }
    if (std::fmod(since_first_s, StatedRun::kFlickEvery_s) < period_s) {
      plant_.flick(StatedRun::kFlick_N_s * flick_direction_W());
    }
  }

  void move(std::int64_t from_ns, std::int64_t to_ns) {
    const Vector3d begin_W = plant_.position_W();
    const double end_s = 1e-9 * static_cast<double>(to_ns);
    plant_.advance(to_ns - from_ns, force_W_, setup_.contact_point_W + StatedRun::target_W(end_s));
    generated_J_ += force_W_.dot(plant_.position_W() - begin_W);
  }

  const LoopSetup& setup_;
  VirtualObject& object_;
  ForceMethod* method_;
  Plant plant_;
  SlowSimulator simulator_;
  SampleGate gate_;
  servo::PassivityGuard guard_;
  std::int64_t count_age_ns_;
  std::int64_t actuation_ns_;
  Vector3d sampled_W_;
  Vector3d last_measured_W_;
  Vector3d force_W_ = Vector3d::Zero();                              // presently acting
  double judged_until_s_ = std::numeric_limits<double>::infinity();  // errors and rattle
  bool contact_known_ = false;
  bool in_contact_ = false;
  std::uint32_t epoch_ = 0;
  std::optional<std::uint32_t> air_epoch_;  // of the newest sample in the air
  std::optional<Vector3d> expected_W_;      // where a tool in the air will touch
  Vector3d velocity_W_ = Vector3d::Zero();  // as servo::MotionGuard estimates it
  std::int64_t next_request_ns_ = 0;
  std::uint64_t requests_made_ = 0;
  std::uint64_t answers_taken_ = 0;
  std::uint64_t answers_before_ = 0;
  bool was_in_the_air_ = false;
  std::uint64_t touches_ = 0;
  double touched_s_ = 0.0;
  double first_square_N2_[std::size(kFirstWindows_s)] = {};
  double first_cycles_[std::size(kFirstWindows_s)] = {};
  double contact_square_N2_ = 0.0;
  double contact_cycles_ = 0.0;
  std::uint64_t samples_taken_ = 0;
  double error_square_N2_ = 0.0;
  double reference_square_N2_ = 0.0;
  double cycles_judged_ = 0.0;
  double generated_J_ = 0.0;
  double most_generated_J_ = 0.0;
  double largest_force_N_ = 0.0;
  double change_square_N2_ = 0.0;
  double changes_ = 0.0;
  Vector3d last_error_W_ = Vector3d::Zero();
  std::vector<Vector3d> held_W_;  // in the newest kJudged_s of rest
  Settling settling_;             // over them
};

}  // namespace

const std::vector<DeviceTiming>& device_timings() {
  static const std::vector<DeviceTiming> all = {{"ideal", 0.0, 0.0},
                                                {"w2_full_speed", 0.6e-3, 0.4e-3},
                                                {"w2_high_speed", 75e-6, 50e-6},
                                                {"on_board", 0.0, 20e-6}};
  return all;
}

const DeviceTiming& device_timing(const std::string& name) {
  std::string known;
  for (const DeviceTiming& timing : device_timings()) {
    if (timing.name == name) {
      return timing;
    }
    known += (known.empty() ? "" : ", ") + timing.name;
  }
  throw std::invalid_argument("device timing '" + name + "' is not known; use one of " + known);
}

const char* to_string(Behaviour behaviour) noexcept {
  switch (behaviour) {
    case Behaviour::kStable:
      return "stable";
    case Behaviour::kDivergence:
      return "divergence";
    case Behaviour::kLimitCycle:
      return "limit cycle";
    case Behaviour::kCreep:
      return "creep";
  }
  return "unknown";
}

Vector3d StatedRun::target_W(double time_s) noexcept {
  const double t_s =
      time_s <= kMotion_s
          ? time_s
          : kMotion_s + kComingToRest_s * (1.0 - std::exp((kMotion_s - time_s) / kComingToRest_s));
  constexpr double kTurn = 2.0 * std::numbers::pi;
  const double size_m = kAmplitude_m * (1.0 - std::exp(-t_s / 0.5));
  return size_m * Vector3d(std::sin(kTurn * 0.53 * t_s), std::sin(kTurn * 0.71 * t_s),
                           0.5 * (1.0 - std::cos(kTurn * 0.97 * t_s)));
}

LoopResult run_closed_loop(const LoopSetup& setup, VirtualObject& object, ForceMethod* method) {
  return Run(setup, object, method).closed();
}

LoopResult run_open_loop(const LoopSetup& setup, const evaluation::Trajectory& trajectory,
                         VirtualObject& object, ForceMethod* method) {
  return Run(setup, object, method).open(trajectory);
}

}  // namespace forcegrid::stability
