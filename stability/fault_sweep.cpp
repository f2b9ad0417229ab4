// SPDX-License-Identifier: Apache-2.0
#include "stability/fault_sweep.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <deque>
#include <memory>
#include <stdexcept>

#include "evaluation/motions/trajectories.h"
#include "evaluation/objects/force_table.h"
#include "forcegrid/method_variant.h"
#include "forcegrid/methods.h"
#include "rt/parallel_jobs.h"
#include "rt/vectors.h"
#include "servo_loop/force_renderer.h"
#include "servo_loop/servo_loop.h"
#include "stability/simulated_arm.h"
#include "stability/simulated_falcon.h"

namespace forcegrid::stability {
namespace {

using Eigen::Vector3d;
using evaluation::SeededNumbers;

constexpr rt::TimePoint kStart{std::chrono::seconds(1000)};
constexpr rt::Duration kPeriod = std::chrono::milliseconds(2);
constexpr double kEnd_s = 5.4;
// The operator grabs the object within 2.2 s of the start, and its full force acts 0.6 s later.
constexpr double kEarliestFault_s = 2.9;
constexpr double kLatestFault_s = 4.4;
constexpr double kAfterEnd_s = 0.1;
constexpr double kSimulatorPeriod_s = 1.0 / 30.0;
constexpr double kHardening_m = 0.02;

struct NamedFault {
  SweptFault fault;
  const char* name;
};

constexpr NamedFault kFaults[] = {{SweptFault::kNone, "none"},
                                  {SweptFault::kSimulatorStops, "simulator stops"},
                                  {SweptFault::kSimulatorRestarts, "simulator restarts"},
                                  {SweptFault::kSimulatorJumps, "simulator jumps"},
                                  {SweptFault::kSimulatorNoise, "simulator: noise"},
                                  {SweptFault::kSimulatorBias, "simulator: bias"},
                                  {SweptFault::kSimulatorOutliers, "simulator: outliers"},
                                  {SweptFault::kSimulatorNotFinite, "simulator: not a number"},
                                  {SweptFault::kSimulatorHuge, "simulator: 100 times the force"},
                                  {SweptFault::kSimulatorReversed, "simulator: wrong sign"},
                                  {SweptFault::kClockSkew, "clock skew"},
                                  {SweptFault::kLoss, "30 % loss, 200 ms late"},
                                  {SweptFault::kCut, "the object is cut"},
                                  {SweptFault::kReportsStop, "reports stop"},
                                  {SweptFault::kReportsPause, "reports pause for 60 ms"},
                                  {SweptFault::kUnplugged, "unplugged"},
                                  {SweptFault::kEncoderJumps, "encoder jumps"},
                                  {SweptFault::kEncoderFreezes, "encoder freezes"},
                                  {SweptFault::kEncoderSaturates, "encoder saturates"}};

constexpr emulator::MotionKind kMotions[] = {
    emulator::MotionKind::kChirp, emulator::MotionKind::kLissajous, emulator::MotionKind::kRandom,
    emulator::MotionKind::kPoke, emulator::MotionKind::kHold};

// Everything that the seed determines.
struct Draw {
  emulator::HandKind hand;
  emulator::MotionKind motion;
  double stiffness_N_per_m;
  double fault_at_s;
  double silence_s;
  std::size_t joint;
  Vector3d direction_W;

  explicit Draw(SeededNumbers& numbers)
      : hand(numbers.uniform(0.0, 1.0) < 0.5 ? emulator::HandKind::kFirm
                                             : emulator::HandKind::kLight),
        motion(kMotions[static_cast<std::size_t>(
            numbers.uniform(0.0, static_cast<double>(std::size(kMotions))))]),
        stiffness_N_per_m(50.0 * std::exp2(numbers.uniform(0.0, 3.0))),
        fault_at_s(numbers.uniform(kEarliestFault_s, kLatestFault_s)),
        silence_s(numbers.uniform(0.2, 1.0)),
        joint(static_cast<std::size_t>(numbers.uniform(0.0, 3.0))) {
    for (Eigen::Index i = 0; i < 3; ++i) {
      direction_W[i] = numbers.normal();
    }
    direction_W.normalize();
  }
};

std::unique_ptr<SimulatedDevice> device_of(const profiles::DeviceProfile& profile, const Draw& draw,
                                           std::uint64_t seed) {
  if (profile.kind == profiles::DeviceKind::kDelta) {
    return std::make_unique<SimulatedFalcon>(profile, draw.hand, draw.motion, seed, kStart);
  }
  return std::make_unique<SimulatedArm>(profile, draw.hand, draw.motion, seed, kStart);
}

class SweptLoop {
 public:
  SweptLoop(SweptFault fault, std::uint64_t seed, const MethodVariant& variant,
            const profiles::DeviceProfile& profile)
      : fault_(fault),
        numbers_(seed),
        draw_(numbers_),
        profile_(profile),
        device_(device_of(profile, draw_, seed)),
        method_(make_force_method(variant.name, variant.options)),
        loop_(*device_, profile, {method_.get()}, ports_, {}) {
    run_.device = profile.name;
    run_.fault = fault;
    run_.seed = seed;
    run_.method = variant.text;
    run_.hand = draw_.hand == emulator::HandKind::kFirm ? "firm" : "light";
    run_.stiffness_N_per_m = draw_.stiffness_N_per_m;
    run_.fault_at_s = draw_.fault_at_s;
  }

  SweptRun result() {
    const auto cycles = static_cast<int>(std::lround(kEnd_s / rt::seconds(kPeriod)));
    for (int i = 0; i < cycles && run_.ended_by == servo::Fault::kNone; ++i) {
      cycle();
    }
    if (run_.ended_by != servo::Fault::kNone) {
      device_->mute = true;
      const double before_J = device_->motor_work_J();
      device_->advance_to(now_ + rt::from_seconds(kAfterEnd_s));
      run_.work_after_end_J = device_->motor_work_J() - before_J;
    }
    return run_;
  }

 private:
  bool broken() const { return since_fault_s() >= 0.0; }
  double since_fault_s() const { return rt::seconds(now_ - kStart) - draw_.fault_at_s; }

  void cycle() {
    now_ += kPeriod;
    if (broken() && !was_broken_) {
      break_device();
      was_broken_ = true;
    }
    device_->mute = broken() && (fault_ == SweptFault::kReportsStop ||
                                 (fault_ == SweptFault::kReportsPause && since_fault_s() < 0.06));
    device_->advance_to(now_);
    simulate();
    run_.ended_by = loop_.run_cycle(now_, now_ + kPeriod);
    servo::CycleRecord record;
    while (ports_.records.pop(record)) {
      watch(record);
    }
  }

  void watch(const servo::CycleRecord& record) {
    // A NaN force counts as above every limit.
    const auto most = [](double so_far, double now) {
      return std::isfinite(now) ? std::max(so_far, now) : HUGE_VAL;
    };
    run_.largest_force_N =
        most(run_.largest_force_N, rt::to_vector(record.commanded_force_D_N).norm());
    run_.largest_drive_fraction = most(run_.largest_drive_fraction, drive_fraction());
    if (record.fault != servo::Fault::kNone) {
      return;  // its position is not trusted: zero force
    }
    const Vector3d position_W = rt::to_vector(record.position_W_m);
    const Vector3d force_W = rt::to_vector(record.commanded_force_D_N);
    given_J_ += 0.5 * (last_force_W_ + force_W).dot(position_W - last_position_W_);
    if (record.gain > last_gain_ && given_J_ > 0.0) {
      given_J_ =
          std::max(0.0, given_J_ - servo::ForceRenderer::kRampPower_J_per_s * rt::seconds(kPeriod));
    }
    last_gain_ = record.gain;
    last_force_W_ = force_W;
    last_position_W_ = position_W;
    if (was_broken_) {
      run_.energy_after_fault_J = most(run_.energy_after_fault_J, given_J_);
    }
  }

  double drive_fraction() const {
    const driver::MotorCommand& command = device_->commanded();
    const bool delta = profile_.kind == profiles::DeviceKind::kDelta;
    const Eigen::Array3d drive =
        (delta ? rt::to_vector(command.joint_torque_Nm) : rt::to_vector(command.current_A)).array();
    const auto& most = delta ? profile_.limits.max_joint_torque_Nm : profile_.motors.max_current_A;
    return (drive.abs() / rt::to_vector(most).array()).maxCoeff<Eigen::PropagateNaN>();
  }

  void break_device() {
    const std::size_t joint = draw_.joint;
    switch (fault_) {
      case SweptFault::kUnplugged:
        device_->health_shown = driver::DeviceHealth::kUnplugged;
        break;
      case SweptFault::kEncoderJumps:
        device_->spoil_counts = [joint](rt::TimePoint, std::array<std::int32_t, 6>& counts) {
          counts[joint] += 500;
        };
        break;
      case SweptFault::kEncoderFreezes:
        device_->spoil_counts = [joint, at = device_->newest_report().counts[joint]](
                                    rt::TimePoint, std::array<std::int32_t, 6>& counts) {
          counts[joint] = at;
        };
        break;
      case SweptFault::kEncoderSaturates:
        device_->spoil_counts = [joint](rt::TimePoint, std::array<std::int32_t, 6>& counts) {
          counts[joint] = 32767;
        };
        break;
      default:
        break;
    }
  }

  // A spring that hardens, around the point where the tool was grabbed:
  //   F = -K d (1 + |d|^2 / (20 mm)^2)
  Vector3d object_force_W(const Vector3d& displacement_W) const {
    const double hardening = displacement_W.squaredNorm() / (kHardening_m * kHardening_m);
    return -draw_.stiffness_N_per_m * (1.0 + hardening) * displacement_W;
  }

  void simulate() {
    const double now_s = rt::seconds(now_ - kStart);
    if (now_s >= next_tick_s_) {
      next_tick_s_ += kSimulatorPeriod_s;
      answer(now_s);
    }
    while (!under_way_.empty() && under_way_.front().arrived <= now_) {
      under_way_.front().arrived = now_;
      // A full ring loses the answer, as in the real loop.
      static_cast<void>(ports_.samples.push(under_way_.front()));
      under_way_.pop_front();
    }
  }

  void answer(double now_s) {
    const link::ToolState tool = newest_tool();
    const Vector3d position_W = rt::to_vector(tool.position_W_m);
    if (!grabbed_ && position_W.z() <= 0.0 && now_s > 1.0) {
      grabbed_ = true;
      contact_point_W_ = position_W;
    }
    servo::ArrivedSample arrived;
    arrived.in_contact = grabbed_;
    arrived.arrived = now_ + rt::from_seconds(kSimulatorPeriod_s);
    Sample& sample = arrived.sample;
    sample.time_s = 1e-9 * static_cast<double>(tool.servo_time_ns);
    sample.position_W = position_W;
    sample.contact_epoch = epoch_;
    sample.contact_point_W = contact_point_W_;
    if (grabbed_) {
      const Vector3d shift_W = broken() && fault_ == SweptFault::kSimulatorJumps
                                   ? Vector3d(0.003 * draw_.direction_W)
                                   : Vector3d(Vector3d::Zero());
      sample.force_W = object_force_W(position_W - contact_point_W_ - shift_W);
      if (sample.has_stiffness = method_->needs().stiffness; sample.has_stiffness) {
        sample.stiffness_W = -draw_.stiffness_N_per_m * Eigen::Matrix3d::Identity();
      }
    }
    if (!broken() || spoil(arrived)) {
      under_way_.push_back(arrived);
    }
  }

  // Returns false if there is no answer.
  bool spoil(servo::ArrivedSample& arrived) {
    Sample& sample = arrived.sample;
    switch (fault_) {
      case SweptFault::kSimulatorStops:
        return false;
      case SweptFault::kSimulatorRestarts:
        sample.contact_epoch = 2;
        return since_fault_s() >= draw_.silence_s;
      case SweptFault::kSimulatorNoise:
        for (Eigen::Index i = 0; i < 3; ++i) {
          sample.force_W[i] += 0.03 * numbers_.normal();
        }
        return true;
      case SweptFault::kSimulatorBias:
        sample.force_W.x() += 0.2;
        return true;
      case SweptFault::kSimulatorOutliers:
        if (numbers_.uniform(0.0, 1.0) < 0.1) {
          for (Eigen::Index i = 0; i < 3; ++i) {
            sample.force_W[i] += numbers_.uniform(-2.0, 2.0);
          }
        }
        return true;
      case SweptFault::kSimulatorNotFinite:
        sample.force_W.setConstant(std::nan(""));
        return true;
      case SweptFault::kSimulatorHuge:
        sample.force_W *= 100.0;
        return true;
      case SweptFault::kSimulatorReversed:
        sample.force_W = -sample.force_W;
        return true;
      case SweptFault::kClockSkew:
        sample.time_s += 0.01 * since_fault_s();
        return true;
      case SweptFault::kLoss:
        arrived.arrived += std::chrono::milliseconds(200);
        return numbers_.uniform(0.0, 1.0) >= 0.3;
      case SweptFault::kCut:
        sample.force_W *= 0.4;
        return true;
      default:
        return true;
    }
  }

  link::ToolState newest_tool() {
    link::ToolState tool;
    if (ports_.tool.fetch(tool)) {
      tool_ = tool;
    }
    return tool_;
  }

  SweptFault fault_;
  SeededNumbers numbers_;
  Draw draw_;
  const profiles::DeviceProfile& profile_;
  std::unique_ptr<SimulatedDevice> device_;
  std::unique_ptr<ForceMethod> method_;
  servo::ServoPorts ports_;
  servo::ServoLoop loop_;
  SweptRun run_;
  rt::TimePoint now_ = kStart;
  bool was_broken_ = false;
  double next_tick_s_ = 0.0;
  bool grabbed_ = false;
  Vector3d contact_point_W_ = Vector3d::Zero();
  std::uint32_t epoch_ = 1;
  link::ToolState tool_;
  double given_J_ = 0.0;
  double last_gain_ = 0.0;
  Vector3d last_force_W_ = Vector3d::Zero();
  Vector3d last_position_W_ = Vector3d::Zero();
  std::deque<servo::ArrivedSample> under_way_;
};

std::vector<MethodVariant> variants_of(const SweepOptions& options,
                                       const profiles::DeviceProfile& profile) {
  if (options.methods.empty() || options.runs < 1) {
    throw std::invalid_argument("fault sweep: give at least one method and one run");
  }
  MethodOptions base;
  base.grid.min_W = rt::to_vector(profile.limits.workspace_min_m);
  base.grid.max_W = rt::to_vector(profile.limits.workspace_max_m);
  base.grid.cells.setConstant(49);
  std::vector<MethodVariant> variants;
  for (const std::string& text : options.methods) {
    variants.push_back(parse_method_variant(text, base));
    check_method_name(variants.back().name);
  }
  return variants;
}

}  // namespace

const std::vector<SweptFault>& swept_faults() {
  static const std::vector<SweptFault> all = [] {
    std::vector<SweptFault> faults;
    for (const NamedFault& each : kFaults) {
      faults.push_back(each.fault);
    }
    return faults;
  }();
  return all;
}

const char* to_string(SweptFault fault) noexcept {
  for (const NamedFault& each : kFaults) {
    if (each.fault == fault) {
      return each.name;
    }
  }
  return "unknown";
}

bool force_above_limit(const SweptRun& run, const profiles::DeviceProfile& profile) noexcept {
  return !(run.largest_force_N <= profile.limits.max_force_N + SweepLimits::kRounding) ||
         !(run.largest_drive_fraction <= 1.0 + SweepLimits::kRounding);
}

bool energy_after_fault(const SweptRun& run) noexcept {
  return !(run.energy_after_fault_J <= SweepLimits::kEnergy_J) ||
         !(run.work_after_end_J <= SweepLimits::kRounding);
}

std::vector<SweptRun> sweep_faults(const SweepOptions& options) {
  const profiles::DeviceProfile profile = profiles::load_device_profile(options.device);
  const std::vector<MethodVariant> variants = variants_of(options, profile);
  std::vector<SweptRun> runs(static_cast<std::size_t>(options.runs));
  rt::JobOptions jobs{.threads = options.jobs};
  jobs.progress = options.progress;
  jobs.cancel = options.cancel;
  const bool finished = rt::run_jobs(runs.size(), jobs, [&](rt::Job& job) {
    const std::size_t i = job.number();
    const SweptFault fault = swept_faults()[i % swept_faults().size()];
    const MethodVariant& variant = variants[i / swept_faults().size() % variants.size()];
    runs[i] = SweptLoop(fault, options.seed * 1'000'003 + i, variant, profile).result();
    return true;
  });
  if (!finished) {
    throw evaluation::Stopped();
  }
  return runs;
}

std::vector<SweepLine> sweep_table(const std::vector<SweptRun>& runs,
                                   const profiles::DeviceProfile& profile) {
  std::vector<SweepLine> lines;
  for (const SweptFault fault : swept_faults()) {
    SweepLine line;
    line.device = profile.name;
    line.fault = fault;
    for (const SweptRun& run : runs) {
      if (run.fault != fault) {
        continue;
      }
      ++line.runs;
      line.survivors += run.ended_by == servo::Fault::kNone ? 1 : 0;
      if (run.ended_by != servo::Fault::kNone) {
        const std::string name = servo::name_of(run.ended_by);
        const auto found = std::find_if(line.ended_by.begin(), line.ended_by.end(),
                                        [&](const auto& each) { return each.first == name; });
        if (found == line.ended_by.end()) {
          line.ended_by.emplace_back(name, 1);
        } else {
          ++found->second;
        }
      }
      line.force_above_limit += force_above_limit(run, profile) ? 1 : 0;
      line.energy_after_fault += energy_after_fault(run) ? 1 : 0;
      line.largest_force_N = std::max(line.largest_force_N, run.largest_force_N);
      const double energy_J = std::max(run.energy_after_fault_J, run.work_after_end_J);
      if (line.worst_seed == 0 || energy_J > line.most_energy_J) {
        line.most_energy_J = energy_J;
        line.worst_seed = run.seed;
      }
    }
    if (line.runs > 0) {
      lines.push_back(std::move(line));
    }
  }
  return lines;
}

}  // namespace forcegrid::stability
