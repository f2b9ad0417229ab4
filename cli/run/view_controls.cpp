// SPDX-License-Identifier: Apache-2.0
#include "cli/run/view_controls.h"

#include <poll.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include <algorithm>
#include <bit>
#include <cerrno>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <limits>

#include "rt/thread.h"

namespace forcegrid::cli {
namespace {

using nlohmann::json;

constexpr auto kPatience = std::chrono::seconds(3);  // a simulator may be in a long solution
constexpr int kPoll_ms = 200;
constexpr double kLargestBudget_us = 1000.0;
constexpr double kLargestDelay_ms = 1000.0;
constexpr double kLargestJitter_ms = 200.0;
constexpr double kLargestLoss_percent = 90.0;
constexpr double kLargestSimulatorRate_Hz = 200.0;
constexpr char kHandWord[] = "hand ";
constexpr double kLowestWall_mm = 2.0;
constexpr double kHighestWall_mm = 60.0;
constexpr std::array<const char*, 6> kOfSimulator = {"simulator_rate_Hz", "delay_ms", "jitter_ms",
                                                     "loss_percent",      "wall_mm",  "cut"};
constexpr double kUnchanged = std::numeric_limits<double>::quiet_NaN();

struct Datagram {
  std::uint64_t number = 0;
  std::array<double, 6> value{};
};
static_assert(sizeof(Datagram) == 56);  // as the simulator's ControlSocket

// In a datagram: no wall is an infinite height, a cut is 1.
double number_of(const json& value) {
  if (value.is_number()) {
    return value.get<double>();
  }
  return value.is_null() ? std::numeric_limits<double>::infinity() : value == "yes" ? 1.0 : 0.0;
}

std::string number_text(double number) {
  char text[32];
  std::snprintf(text, sizeof text, "%.4g", number);
  return text;
}

std::string value_text(const json& value) {
  return value.is_string() ? value.get<std::string>() : number_text(value.get<double>());
}

}  // namespace

ViewControls::ViewControls(const ControlFacts& facts, servo::ServoPorts& ports, Calls calls)
    : facts_(facts), ports_(ports), calls_(std::move(calls)) {
  make_settings(facts);
  make_link_settings(facts);
  if (facts.run_socket.empty()) {
    return;
  }
  socket_.emplace(facts.run_socket);
  wake_ = ::eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
  thread_ = std::thread([this] {
    rt::name_current_thread("view-controls");
    std::array<pollfd, 2> waiting = {pollfd{socket_->descriptor(), POLLIN, 0},
                                     pollfd{wake_, POLLIN, 0}};
    for (;;) {
      static_cast<void>(::poll(waiting.data(), waiting.size(), kPoll_ms));
      const std::lock_guard lock(mutex_);
      if (stopped_) {
        return;
      }
      take_answers();
      give_up_late_ones();
    }
  });
}

void ViewControls::stop() {
  {
    const std::lock_guard lock(mutex_);
    stopped_ = true;
  }
  if (thread_.joinable()) {
    const std::uint64_t one = 1;
    [[maybe_unused]] const ssize_t written = ::write(wake_, &one, sizeof one);
    thread_.join();
    ::close(wake_);
  }
}

void ViewControls::make_settings(const ControlFacts& facts) {
  Setting budget{.name = "budget_us", .label = "Budget of auto", .unit = "µs a cycle"};
  budget.none = "no limit";
  budget.value = facts.budget_us ? json(*facts.budget_us) : json(nullptr);
  budget.high = kLargestBudget_us;
  if (facts.least_budget_reads) {
    budget.low = 1e-3 * facts.read_ns * *facts.least_budget_reads;
  } else {
    budget.why_not = "none of the methods keeps a budget: only auto does";
  }
  Setting requests{.name = "requests_per_s", .label = "Requests", .unit = "1/s"};
  requests.value = facts.requests_per_s;
  requests.low = facts.needs_requests ? 1.0 : 0.0;
  requests.high = facts.rate_Hz;
  requests.why_not = facts.why_no_requests;
  Setting hand{.name = "hand", .label = "Hand"};
  hand.value = facts.hand;
  hand.choices = {"light", "firm", "arm", "none"};
  hand.why_not = facts.hand_socket.empty() ? "a person holds this device" : "";
  settings_ = {budget, requests, hand};
}

void ViewControls::make_link_settings(const ControlFacts& facts) {
  std::string why_not = facts.why_same_simulator;
  if (!why_not.empty()) {
    // That is why.
  } else if (!facts.own_simulator) {
    why_not = "this run did not start the simulator";
  } else if (!facts.emulated) {
    why_not = "a person holds this device: only an emulated one gets a bad link";
  }
  const auto add = [&](const char* name, const char* label, const char* unit, double value,
                       double low, double high) {
    Setting setting{.name = name, .label = label, .unit = unit};
    setting.value = value;
    setting.low = low;
    setting.high = high;
    setting.why_not = why_not;
    settings_.push_back(setting);
  };
  add("simulator_rate_Hz", "Simulator's rate", "Hz", facts.simulator_rate_Hz, 1.0,
      std::max(kLargestSimulatorRate_Hz, facts.simulator_rate_Hz));
  add("delay_ms", "Link: delay", "ms", facts.delay_ms, 0.0, kLargestDelay_ms);
  add("jitter_ms", "jitter", "ms", facts.jitter_ms, 0.0,
      std::max(kLargestJitter_ms, facts.jitter_ms));
  add("loss_percent", "loss", "%", facts.loss_percent, 0.0,
      std::max(kLargestLoss_percent, facts.loss_percent));
  Setting wall{.name = "wall_mm", .label = "Wall above", .unit = "mm"};
  wall.low = kLowestWall_mm;
  wall.high = kHighestWall_mm;
  wall.none = "no wall";
  wall.why_not = why_not;
  Setting cut{.name = "cut", .label = "Cut"};
  cut.value = "no";
  cut.choices = {"no", "yes"};
  cut.why_not = why_not.empty() ? facts.why_whole : why_not;
  settings_.push_back(wall);
  settings_.push_back(cut);
  Setting scene{.name = "scene", .label = "Scene"};
  scene.value = facts.scene;
  scene.choices = facts.scenes;
  scene.why_not = why_not.empty() ? facts.why_one_scene : why_not;
  settings_.push_back(scene);
}

ViewControls::Setting* ViewControls::find(const std::string& name) {
  const auto found = std::find_if(settings_.begin(), settings_.end(),
                                  [&](const Setting& one) { return one.name == name; });
  return found == settings_.end() ? nullptr : &*found;
}

// Empty: the setting takes the value.
std::string ViewControls::why_not(const Setting& setting, const json& value) const {
  if (!setting.why_not.empty()) {
    return setting.why_not;
  }
  if (!setting.choices.empty()) {
    const bool known =
        value.is_string() && std::find(setting.choices.begin(), setting.choices.end(),
                                       value.get<std::string>()) != setting.choices.end();
    return known ? "" : "'" + setting.label + "' has no choice " + value.dump();
  }
  if (value.is_null() && !setting.none.empty()) {
    return "";
  }
  if (value.is_number() && value.get<double>() >= setting.low &&
      value.get<double>() <= setting.high) {
    return "";
  }
  return setting.label + ": give " + number_text(setting.low) + " to " + number_text(setting.high) +
         " " + setting.unit;
}

void ViewControls::set(std::int64_t id, const std::string& name, const json& value) {
  const std::lock_guard lock(mutex_);
  const Pending command{id, name, value, rt::Clock::now() + kPatience};
  const Setting* const setting = find(name);
  const std::string problem = stopped_             ? "the run ends"
                              : setting == nullptr ? "'" + name + "' is no setting of this run"
                                                   : why_not(*setting, value);
  if (!problem.empty()) {
    finish(command, false, problem);
  } else if (name == "budget_us" || name == "requests_per_s") {
    set_servo(command);
  } else if (name == "hand") {
    set_hand(command);
  } else if (name == "scene") {
    finish(command, true, "the run begins again with scene " + value.get<std::string>());
    calls_.restart(value.get<std::string>());
  } else {
    set_simulator(command);
  }
}

void ViewControls::set_servo(Pending command) {
  const bool is_budget = command.name == "budget_us";
  auto& port = is_budget ? ports_.budget_reads : ports_.requests_per_s;
  auto& pending = is_budget ? budget_pending_ : requests_pending_;
  if (pending) {
    finish(*pending, false, "another value came after it");
  }
  if (!is_budget) {
    port.store(command.value.get<double>());
  } else {
    port.store(command.value.is_null() ? std::numeric_limits<double>::infinity()
                                       : 1e3 * command.value.get<double>() / facts_.read_ns);
  }
  pending = std::move(command);
}

void ViewControls::set_simulator(const Pending& command) {
  Datagram datagram{next_number_++, {}};
  datagram.value.fill(kUnchanged);
  for (std::size_t i = 0; i < kOfSimulator.size(); ++i) {
    if (command.name == kOfSimulator[i]) {
      datagram.value[i] = number_of(command.value);
    }
  }
  if (!socket_->send(facts_.simulator_socket,
                     std::bit_cast<std::array<std::uint8_t, sizeof datagram>>(datagram))) {
    finish(command, false, std::string("the simulator: ") + std::strerror(errno));
    return;
  }
  simulator_pending_[datagram.number] = command;
}

void ViewControls::set_hand(const Pending& command) {
  if (hand_pending_) {
    finish(*hand_pending_, false, "another hand came after it");
    hand_pending_.reset();
  }
  const std::string text = kHandWord + command.value.get<std::string>();
  const std::vector<std::uint8_t> bytes(text.begin(), text.end());
  if (!socket_->send(facts_.hand_socket, bytes)) {
    finish(command, false, std::string("the emulated hand: ") + std::strerror(errno));
    return;
  }
  hand_pending_ = command;
}

void ViewControls::take_answers() {
  for (;;) {
    std::array<std::uint8_t, sizeof(Datagram)> bytes{};
    const ssize_t size = socket_->receive(bytes);
    if (size < 0) {
      return;
    }
    if (size == static_cast<ssize_t>(bytes.size())) {
      const auto answer = std::bit_cast<Datagram>(bytes);
      take_simulator_answer(answer.number, answer.value);
      continue;
    }
    const std::string text(bytes.begin(),
                           bytes.begin() + std::min<ssize_t>(size, sizeof(Datagram)));
    if (hand_pending_ && text == kHandWord + hand_pending_->value.get<std::string>()) {
      finish(*hand_pending_, true,
             "a hand of kind " + text.substr(sizeof kHandWord - 1) + " takes over");
      hand_pending_.reset();
    }
  }
}

void ViewControls::take_simulator_answer(std::uint64_t number, const SimulatorValues& values) {
  const auto found = simulator_pending_.find(number);
  if (found == simulator_pending_.end()) {
    return;
  }
  const Pending command = found->second;
  simulator_pending_.erase(found);
  for (std::size_t i = 0; i < kOfSimulator.size(); ++i) {
    if (command.name == kOfSimulator[i]) {
      const double wanted = number_of(command.value);
      const bool has_it =
          values[i] == wanted || std::abs(values[i] - wanted) <= 1e-9 * (1.0 + std::abs(wanted));
      finish(command, has_it, has_it ? "" : "the simulator refuses it");
    }
  }
}

void ViewControls::give_up_late_ones() {
  const rt::TimePoint now = rt::Clock::now();
  std::erase_if(simulator_pending_, [&](const auto& one) {
    const bool is_late = now > one.second.until;
    if (is_late) {
      finish(one.second, false, "the simulator does not answer");
    }
    return is_late;
  });
  if (hand_pending_ && now > hand_pending_->until) {
    finish(*hand_pending_, false, "the emulator does not answer");
    hand_pending_.reset();
  }
}

void ViewControls::cycle_ended(const servo::CycleRecord& cycle) {
  const std::lock_guard lock(mutex_);
  first_cycle_ns_ = first_cycle_ns_.value_or(cycle.time_ns);
  newest_cycle_ns_ = cycle.time_ns;
  if (requests_pending_ && cycle.requests_per_s == ports_.requests_per_s.load()) {
    finish(*requests_pending_, true, "");
    requests_pending_.reset();
  }
  if (budget_pending_ && cycle.budget_reads == ports_.budget_reads.load()) {
    finish(*budget_pending_, true, "");
    budget_pending_.reset();
  }
}

// With mutex_ held.
void ViewControls::finish(const Pending& command, bool done, const std::string& text) {
  Setting* const setting = find(command.name);
  std::string words = text;
  if (done && setting != nullptr) {
    setting->value = command.value;
    changes_.push_back(
        {{"time_s", 1e-9 * static_cast<double>(newest_cycle_ns_ - first_cycle_ns_.value_or(0))},
         {"name", command.name},
         {"value", command.value}});
    if (words.empty()) {
      words = setting->label + " is " +
              (command.value.is_null() ? setting->none
                                       : value_text(command.value) + " " + setting->unit);
    }
    calls_.changed(listed());
  }
  calls_.acknowledge(command.id, done, words);
}

json ViewControls::listed() const {
  json list = json::array();
  for (const Setting& setting : settings_) {
    json one = {{"name", setting.name}, {"label", setting.label}, {"value", setting.value}};
    if (!setting.choices.empty()) {
      one["choices"] = setting.choices;
    } else {
      one.update({{"unit", setting.unit}, {"low", setting.low}, {"high", setting.high}});
    }
    if (!setting.none.empty()) {
      one["none"] = setting.none;
    }
    if (!setting.why_not.empty()) {
      one["why_not"] = setting.why_not;
    }
    list.push_back(one);
  }
  return list;
}

json ViewControls::settings() {
  const std::lock_guard lock(mutex_);
  return listed();
}

json ViewControls::changes() {
  const std::lock_guard lock(mutex_);
  return changes_;
}

}  // namespace forcegrid::cli
