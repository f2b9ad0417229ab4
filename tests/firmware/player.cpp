// SPDX-License-Identifier: Apache-2.0
// Runs on the processor: plays a recorded trace to the image's method and writes what each cycle
// answers; then counts the instructions of a query, a sample and a cycle by the board's timer,
// which under QEMU's `-icount shift=0` moves one tick every 40 instructions. Its words: the trace's
// file, the answers' file.
#include <algorithm>
#include <array>
#include <cstdint>
#include <cstring>

#include "firmware/arena.h"
#include "firmware/board.h"
#include "firmware/on_board_cycle.h"
#include "firmware/on_board_method.h"
#include "firmware/profile.h"
#include "tests/firmware/semihosting.h"
#include "tests/firmware/trace_bytes.h"

namespace forcegrid::firmware {
namespace {

constexpr std::uint32_t kInstructionsPerTick = 1'000'000'000 / kBoardClock_Hz;
constexpr int kRepeats = 1000;
constexpr std::size_t kKept = 64;  // cycles and samples that are repeated

void print_value(const char* key, std::uint32_t value) noexcept {
  std::array<char, 12> digits{};
  char* at = digits.data() + digits.size() - 1;
  do {
    *--at = static_cast<char>('0' + value % 10);
    value /= 10;
  } while (value > 0);
  semihosting::print(key);
  semihosting::print(" ");
  semihosting::print(at);
  semihosting::print("\n");
}

/// The newest kKept of what was played.
template <typename Value>
class Newest {
 public:
  void keep(const Value& value) noexcept { values_[count_++ % kKept] = value; }
  std::size_t size() const noexcept { return std::min(count_, kKept); }
  const Value& operator[](std::size_t i) const noexcept { return values_[i % size()]; }

 private:
  std::array<Value, kKept> values_{};
  std::size_t count_ = 0;
};

struct Played {
  Newest<std::array<std::int32_t, 6>> counts;
  Newest<Eigen::Vector3d> positions_W;
  Newest<Sample> samples;
  double time_s = 0.0;
  std::uint32_t cycles = 0;
  std::uint32_t most_ticks = 0;  ///< of a cycle with the samples that came before it
};
Played played;

CycleAnswer answer_of(const CycleResult& result) noexcept {
  CycleAnswer answer;
  answer.pose_status = static_cast<std::uint32_t>(result.pose.status);
  answer.estimate_status = static_cast<std::uint32_t>(result.estimate.status);
  std::copy(result.current_mA.begin(), result.current_mA.end(), answer.current_mA.begin());
  Eigen::Vector3d::Map(answer.position_D.data()) = result.pose.position_D;
  Eigen::Matrix3d::Map(answer.jacobian_D.data()) = result.pose.jacobian_D;
  Eigen::Vector3d::Map(answer.force_D.data()) = result.estimate.force_W;
  return answer;
}

bool play(std::intptr_t trace, std::intptr_t answers, ForceMethod& method,
          OnBoardCycle& cycle) noexcept {
  std::uint32_t ticks = 0;
  for (TraceRecord record; semihosting::read(trace, record);) {
    CycleAnswer answer;
    Sample sample;
    sample.time_s = record.time_s;
    sample.position_W = Eigen::Vector3d::Map(record.position_W.data());
    sample.force_W = Eigen::Vector3d::Map(record.force_W.data());
    sample.contact_epoch = record.epoch;
    const std::uint32_t began = timer_ticks();
    switch (record.kind) {
      case RecordKind::kContactMade:
        method.contact_made(record.epoch, sample.position_W);
        break;
      case RecordKind::kContactLost:
        method.contact_lost();
        break;
      case RecordKind::kSample:
        method.take_sample(sample);
        break;
      case RecordKind::kCycle:
        answer = answer_of(cycle.run(record.time_s, record.counts));
        break;
    }
    ticks += timer_ticks() - began;
    if (record.kind == RecordKind::kSample) {
      played.samples.keep(sample);
    } else if (record.kind == RecordKind::kCycle) {
      played.most_ticks = std::max(played.most_ticks, ticks);
      ticks = 0;
      ++played.cycles;
      played.time_s = record.time_s;
      if (answer.pose_status == static_cast<std::uint32_t>(driver::KinematicsStatus::kOk)) {
        played.counts.keep(record.counts);
        played.positions_W.keep(Eigen::Vector3d::Map(answer.position_D.data()));
      }
      if (!semihosting::write(answers, answer)) {
        return false;
      }
    }
  }
  return played.cycles > 0 && played.samples.size() > 0;
}

template <typename Do>
void count(const char* key, Do once) noexcept {
  const std::uint32_t began = timer_ticks();
  for (std::size_t i = 0; i < kRepeats; ++i) {
    once(i);
  }
  print_value(key, (timer_ticks() - began) * kInstructionsPerTick / kRepeats);
}

void count_instructions(ForceMethod& method, OnBoardCycle& cycle) noexcept {
  count("instructions_per_loop", [](std::size_t) { asm volatile(""); });
  count("instructions_per_kinematics", [](std::size_t i) {
    static const driver::ArmKinematics kinematics(kKinematics, kMotors, kGravity);
    const driver::ArmPose pose = kinematics.forward(played.counts[i]);
    asm volatile("" ::"m"(pose) : "memory");
  });
  count("instructions_per_query", [&](std::size_t i) {
    const ForceEstimate estimate = method.force(played.time_s, played.positions_W[i]);
    asm volatile("" ::"m"(estimate) : "memory");
  });
  count("instructions_per_cycle", [&](std::size_t i) {
    const CycleResult result =
        cycle.run(played.time_s + 0.002 * static_cast<double>(i + 1), played.counts[i]);
    asm volatile("" ::"m"(result) : "memory");
  });
  // The newest samples once more, each later than the one before, with all the work that they
  // cause.
  count("instructions_per_sample", [&](std::size_t i) {
    Sample sample = played.samples[i];
    sample.time_s = played.time_s + 0.033 * static_cast<double>(i + 1);
    method.take_sample(sample);
    while (method.work(OnBoardCycle::kWorkUnits) > 0) {
    }
  });
}

// The word `number` of the command line, in its place, ended by a zero.
const char* word(char* text, int number) noexcept {
  char* at = text;
  for (int i = 0; i < number && at != nullptr; ++i) {
    at = std::strchr(at, ' ');
    at = at == nullptr ? nullptr : at + 1;
  }
  if (at != nullptr) {
    if (char* const end = std::strchr(at, ' ')) {
      *end = '\0';
    }
  }
  return at;
}

int run() noexcept {
  static std::array<char, 512> line{};
  if (!semihosting::command_line(line.data(), line.size())) {
    semihosting::print("player: no command line\n");
    return 2;
  }
  const char* const answers_name = word(line.data(), 2);
  const char* const trace_name = word(line.data(), 1);
  if (trace_name == nullptr || answers_name == nullptr) {
    semihosting::print("usage: player TRACE ANSWERS\n");
    return 2;
  }
  const std::intptr_t trace = semihosting::open(trace_name, 1);
  const std::intptr_t answers = semihosting::open(answers_name, 5);
  if (trace < 0 || answers < 0) {
    semihosting::print("player: can't open the trace or the answers\n");
    return 2;
  }
  start_timer();
  const driver::ArmKinematics kinematics(kKinematics, kMotors, kGravity);
  ForceMethod& method = make_method();
  seal_arena();
  OnBoardCycle cycle(kinematics, kLimits.max_force_N, method);
  if (!play(trace, answers, method, cycle)) {
    semihosting::print("player: the trace has no cycles or no samples, or the disk is full\n");
    return 1;
  }
  semihosting::close(answers);
  print_value("cycles", played.cycles);
  print_value("method_bytes", method.memory_bytes());
  print_value("arena_bytes_used", arena_bytes_used());
  print_value("arena_bytes", FORCEGRID_ARENA_BYTES);
  print_value("instructions_of_largest_cycle", played.most_ticks * kInstructionsPerTick);
  count_instructions(method, cycle);
  print_value("stack_bytes_used", stack_bytes_used());
  print_value("stack_bytes", stack_bytes());
  return 0;
}

}  // namespace

[[noreturn]] void stop_device() noexcept {
  semihosting::print("player: the device stopped: a fault, or no memory in the arena\n");
  semihosting::exit(3);
}

}  // namespace forcegrid::firmware

int main() { forcegrid::firmware::semihosting::exit(forcegrid::firmware::run()); }
