// SPDX-License-Identifier: Apache-2.0
// What a person changes while a run goes on: what the servo's ports and the processes' sockets get,
// and when it counts as done.

#include "cli/run/view_controls.h"

#include <gtest/gtest.h>

#include <array>
#include <bit>
#include <chrono>
#include <cmath>
#include <condition_variable>
#include <cstdlib>
#include <filesystem>
#include <limits>
#include <string>
#include <vector>

namespace forcegrid::cli {
namespace {

using nlohmann::json;
using std::chrono::seconds;

constexpr seconds kPatience{20};

struct Datagram {
  std::uint64_t number = 0;
  std::array<double, 6> value{};
};

class ViewControlsTest : public testing::Test {
 public:
  ~ViewControlsTest() override {
    controls_.reset();
    std::filesystem::remove_all(folder_);
  }

 protected:
  struct Done {
    std::int64_t id;
    bool done;
    std::string text;
  };

  ViewControlsTest() {
    char folder[] = "/tmp/forcegrid_controls_XXXXXX";
    EXPECT_NE(::mkdtemp(folder), nullptr);
    folder_ = folder;
    facts_.emulated = true;
    facts_.own_simulator = true;
    facts_.hand_socket = folder_ + "/hand";
    facts_.simulator_socket = folder_ + "/simulator";
    facts_.run_socket = folder_ + "/run";
    facts_.least_budget_reads = 25.0;
    facts_.read_ns = 4.0;
    facts_.requests_per_s = 120.0;
    facts_.hand = "firm";
    facts_.scene = "small";
    facts_.scenes = {"block", "small"};
    hand_.emplace(facts_.hand_socket);
    simulator_.emplace(facts_.simulator_socket);
  }

  ViewControls& start() {
    controls_ = std::make_unique<ViewControls>(
        facts_, ports_,
        ViewControls::Calls{.acknowledge =
                                [this](std::int64_t id, bool done, const std::string& text) {
                                  const std::lock_guard lock(mutex_);
                                  answers_.push_back({id, done, text});
                                  came_.notify_all();
                                },
                            .changed =
                                [this](const json& settings) {
                                  const std::lock_guard lock(mutex_);
                                  settings_ = settings;
                                },
                            .restart = [this](const std::string& scene) { scene_ = scene; }});
    return *controls_;
  }

  // The next answer; one of id -1 if none comes.
  Done next() {
    std::unique_lock lock(mutex_);
    if (!came_.wait_for(lock, kPatience, [this] { return answers_.size() > read_; })) {
      return {-1, false, "nothing came"};
    }
    return answers_[read_++];
  }

  json value_of(const std::string& name) {
    for (const json& one : controls_->settings()) {
      if (one["name"] == name) {
        return one["value"];
      }
    }
    return "no such setting";
  }

  // What the simulator gets; it answers with these values.
  Datagram simulator_gets(const std::array<double, 6>& now) {
    std::array<std::uint8_t, sizeof(Datagram)> bytes{};
    const auto give_up = std::chrono::steady_clock::now() + kPatience;
    while (simulator_->receive(bytes) < 0 && std::chrono::steady_clock::now() < give_up) {
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    const auto got = std::bit_cast<Datagram>(bytes);
    const auto answer =
        std::bit_cast<std::array<std::uint8_t, sizeof(Datagram)>>(Datagram{got.number, now});
    EXPECT_TRUE(simulator_->reply(answer));
    return got;
  }

  std::string folder_;
  ControlFacts facts_;
  servo::ServoPorts ports_;
  std::optional<rt::LocalDatagrams> hand_;
  std::optional<rt::LocalDatagrams> simulator_;
  std::mutex mutex_;
  std::condition_variable came_;
  std::vector<Done> answers_;
  std::size_t read_ = 0;
  json settings_;
  std::string scene_;
  std::unique_ptr<ViewControls> controls_;
};

TEST_F(ViewControlsTest, CountARequestsRateAsDoneWhenTheServoHasIt) {
  ViewControls& controls = start();
  controls.set(4, "requests_per_s", 60);
  EXPECT_EQ(ports_.requests_per_s.load(), 60.0);
  servo::CycleRecord cycle;
  cycle.time_ns = 1'000'000'000;
  cycle.requests_per_s = 120.0;  // one that began before
  controls.cycle_ended(cycle);
  EXPECT_EQ(value_of("requests_per_s"), 120.0);
  cycle.time_ns = 1'500'000'000;
  cycle.requests_per_s = 60.0;
  controls.cycle_ended(cycle);
  const Done done = next();
  EXPECT_EQ(done.id, 4);
  EXPECT_TRUE(done.done) << done.text;
  EXPECT_EQ(value_of("requests_per_s"), 60);
  const json changes = controls.changes();
  ASSERT_EQ(changes.size(), 1U);
  EXPECT_EQ(changes[0]["name"], "requests_per_s");
  EXPECT_NEAR(changes[0]["time_s"].get<double>(), 0.5, 1e-9);
}

// 25 reads of 4 ns are 0.1 us.
TEST_F(ViewControlsTest, TurnABudgetIntoReadsAndNoneIntoNoLimit) {
  ViewControls& controls = start();
  controls.set(1, "budget_us", 0.09);
  EXPECT_FALSE(next().done) << "less than the least";
  EXPECT_TRUE(std::isnan(ports_.budget_reads.load()));
  controls.set(2, "budget_us", 2.0);
  EXPECT_DOUBLE_EQ(ports_.budget_reads.load(), 500.0);
  servo::CycleRecord cycle;
  cycle.budget_reads = ports_.budget_reads.load();
  controls.cycle_ended(cycle);
  EXPECT_TRUE(next().done);
  controls.set(3, "budget_us", nullptr);
  EXPECT_TRUE(std::isinf(ports_.budget_reads.load()));
  controls.set(4, "budget_us", 3.0);
  const Done overtaken = next();
  EXPECT_EQ(overtaken.id, 3);
  EXPECT_FALSE(overtaken.done);
}

TEST_F(ViewControlsTest, TellTheSimulatorOneThingAndWaitForItsAnswer) {
  ViewControls& controls = start();
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  struct Case {
    const char* name;
    json value;
    std::size_t place;
    double number;
  };
  std::array<double, 6> now{30.0, 0.0, 0.0, 0.0, kInfinity, 0.0};
  for (const Case& c : {Case{"simulator_rate_Hz", 10, 0, 10.0}, Case{"delay_ms", 150.5, 1, 150.5},
                        Case{"jitter_ms", 20, 2, 20.0}, Case{"loss_percent", 33, 3, 33.0},
                        Case{"wall_mm", 14, 4, 14.0}, Case{"wall_mm", nullptr, 4, kInfinity},
                        Case{"cut", "yes", 5, 1.0}, Case{"cut", "no", 5, 0.0}}) {
    controls.set(9, c.name, c.value);
    now[c.place] = c.number;
    const Datagram got = simulator_gets(now);
    for (std::size_t i = 0; i < got.value.size(); ++i) {
      if (i == c.place) {
        EXPECT_EQ(got.value[i], c.number) << c.name;
      } else {
        EXPECT_TRUE(std::isnan(got.value[i])) << c.name;
      }
    }
    const Done done = next();
    EXPECT_TRUE(done.done) << c.name << ": " << done.text;
    EXPECT_EQ(value_of(c.name), c.value);
  }
}

TEST_F(ViewControlsTest, SayThatTheSimulatorRefuses) {
  ViewControls& controls = start();
  controls.set(9, "cut", "yes");
  simulator_gets({30.0, 0.0, 0.0, 0.0, 0.0, 0.0});
  EXPECT_FALSE(next().done);
  EXPECT_EQ(value_of("cut"), "no");
  simulator_.reset();
  controls.set(10, "delay_ms", 5);
  const Done done = next();
  EXPECT_FALSE(done.done);
  EXPECT_NE(done.text.find("the simulator"), std::string::npos) << done.text;
}

TEST_F(ViewControlsTest, ChooseTheHandThatTheEmulatorConfirms) {
  ViewControls& controls = start();
  controls.set(3, "hand", "arm");
  std::array<std::uint8_t, 64> bytes{};
  const ssize_t size = hand_->receive(bytes);
  ASSERT_EQ(std::string(bytes.begin(), bytes.begin() + std::max<ssize_t>(size, 0)), "hand arm");
  EXPECT_EQ(value_of("hand"), "firm") << "not confirmed yet";
  ASSERT_TRUE(hand_->reply(std::span(bytes).first(static_cast<std::size_t>(size))));
  const Done done = next();
  EXPECT_EQ(done.id, 3);
  EXPECT_TRUE(done.done) << done.text;
  EXPECT_EQ(value_of("hand"), "arm");
  controls.set(4, "hand", "iron");
  EXPECT_FALSE(next().done);
}

TEST_F(ViewControlsTest, BeginAgainWithAnotherScene) {
  start().set(3, "scene", "block");
  EXPECT_TRUE(next().done);
  EXPECT_EQ(scene_, "block");
  controls_->set(4, "scene", "moon");
  EXPECT_FALSE(next().done);
}

TEST_F(ViewControlsTest, RefuseWithAReason) {
  facts_.emulated = false;
  facts_.hand_socket.clear();
  facts_.least_budget_reads.reset();
  facts_.why_no_requests = "method hold makes no requests";
  ViewControls& controls = start();
  const auto why = [&](const char* name, const json& value) {
    controls.set(1, name, value);
    const Done done = next();
    EXPECT_FALSE(done.done) << name;
    return done.text;
  };
  EXPECT_NE(why("budget_us", 5).find("only auto"), std::string::npos);
  EXPECT_EQ(why("requests_per_s", 5), "method hold makes no requests");
  EXPECT_NE(why("hand", "light").find("a person"), std::string::npos);
  for (const char* name : {"delay_ms", "jitter_ms", "loss_percent", "simulator_rate_Hz"}) {
    EXPECT_NE(why(name, 5).find("only an emulated one"), std::string::npos);
  }
  EXPECT_NE(why("max_force_N", 100).find("no setting"), std::string::npos)
      << "what changes motors' limits is not there";
  for (const json& one : controls.settings()) {
    EXPECT_TRUE(one.contains("why_not")) << one;
  }
  EXPECT_TRUE(std::isnan(ports_.budget_reads.load()));
}

TEST_F(ViewControlsTest, RefuseValuesOutOfRange) {
  facts_.own_simulator = true;
  ViewControls& controls = start();
  const std::vector<std::pair<const char*, json>> wrong = {{"requests_per_s", -1},
                                                           {"requests_per_s", 501},
                                                           {"requests_per_s", nullptr},
                                                           {"requests_per_s", "many"},
                                                           {"delay_ms", 1001},
                                                           {"delay_ms", -0.1},
                                                           {"loss_percent", 95},
                                                           {"simulator_rate_Hz", 0.5},
                                                           {"wall_mm", 1},
                                                           {"cut", 1},
                                                           {"hand", nullptr}};
  for (const auto& [name, value] : wrong) {
    controls.set(1, name, value);
    const Done done = next();
    EXPECT_FALSE(done.done) << name << value;
    EXPECT_FALSE(done.text.empty()) << name;
  }
}

TEST_F(ViewControlsTest, LeaveASimulatorOfSomebodyElsesAlone) {
  facts_.own_simulator = false;
  start().set(1, "delay_ms", 5);
  EXPECT_EQ(next().text, "this run did not start the simulator");
}

TEST_F(ViewControlsTest, LeaveASimulatorOfSeveralDevicesAlone) {
  facts_.why_same_simulator = "several devices share the simulator";
  ViewControls& controls = start();
  for (const auto& [name, value] : {std::pair<std::string, json>{"delay_ms", 5},
                                    {"wall_mm", 20},
                                    {"cut", "yes"},
                                    {"scene", "small"}}) {
    controls.set(1, name, value);
    const Done done = next();
    EXPECT_FALSE(done.done) << name;
    EXPECT_EQ(done.text, "several devices share the simulator") << name;
  }
}

}  // namespace
}  // namespace forcegrid::cli
