// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <map>
#include <mutex>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "rt/clock.h"
#include "rt/local_datagrams.h"
#include "servo_loop/cycle_record.h"
#include "servo_loop/servo_ports.h"

namespace forcegrid::cli {

/// What a run is like when its controls are made.
struct ControlFacts {
  bool emulated = false;       ///< the device is
  bool own_simulator = false;  ///< the run has started it
  std::string hand_socket;     ///< of the emulator; empty: none
  std::string simulator_socket;
  std::string run_socket;  ///< to be bound for their answers
  double rate_Hz = 500.0;  ///< of the servo
  double simulator_rate_Hz = 30.0;
  double delay_ms = 0.0;
  double jitter_ms = 0.0;
  double loss_percent = 0.0;
  double requests_per_s = 0.0;
  std::string why_no_requests;  ///< empty: the rendered method may make some
  bool needs_requests = false;  ///< and does not work without
  /// Of the methods that keep a budget, the largest ForceMethod::least_budget_reads(); nothing:
  /// none keeps one.
  std::optional<double> least_budget_reads;
  double read_ns = 1.0;  ///< of a bare trilinear read
  std::optional<double> budget_us;
  std::string hand;
  std::string scene;
  std::vector<std::string> scenes;  ///< that may be chosen
  std::string why_same_simulator;   ///< empty: its rate, link, wall, cut and scene may change
  std::string why_one_scene;        ///< empty: another one may be chosen
  std::string why_whole;            ///< empty: the object may be cut
};

/// What a person can change in the live view while a run goes on (docs/view_protocol.md, "set"):
/// budget and requests of the servo, rate and link of the run's own simulator, the hand that holds
/// the emulated device, the scene. Nothing of it concerns the motors' limits.
///
/// The servo's own settings go through ServoPorts, and are acknowledged when a record of the servo
/// has them; the others go to the processes' sockets, and are acknowledged when these answer.
/// Real-time: no. Threads: any for every function; the callbacks come on any thread, with a lock
/// held, and must not call back.
class ViewControls {
 public:
  struct Calls {
    /// A command was obeyed, or not, and why.
    std::function<void(std::int64_t id, bool done, const std::string& text)> acknowledge;
    /// settings() has changed.
    std::function<void(const nlohmann::json& settings)> changed;
    /// The run is to end and to begin again with this scene.
    std::function<void(const std::string& scene)> restart;
  };

  /// @throws std::runtime_error if the socket for answers can't be bound.
  ViewControls(const ControlFacts& facts, servo::ServoPorts& ports, Calls calls);
  ~ViewControls() { stop(); }
  ViewControls(const ViewControls&) = delete;
  ViewControls& operator=(const ViewControls&) = delete;

  /// Acknowledges at once what is refused.
  void set(std::int64_t id, const std::string& name, const nlohmann::json& value);
  void cycle_ended(const servo::CycleRecord& cycle);
  /// No callback comes after it.
  void stop();

  /// What can be changed, how it stands, and why something can't be: a list of objects.
  [[nodiscard]] nlohmann::json settings();
  /// What was changed so far, each with its time since the first cycle.
  [[nodiscard]] nlohmann::json changes();

 private:
  struct Setting {
    std::string name;
    std::string label;
    std::string unit{};
    nlohmann::json value{};
    double low = 0.0;
    double high = 0.0;
    std::string none{};                  ///< what null means; empty: it is refused
    std::vector<std::string> choices{};  ///< of a text
    std::string why_not{};               ///< empty: it can be changed
  };
  struct Pending {
    std::int64_t id = 0;
    std::string name;
    nlohmann::json value;
    rt::TimePoint until;
  };
  /// Rate [Hz], delay, jitter [ms], loss [%], height of the wall [mm], cut.
  using SimulatorValues = std::array<double, 6>;

  void make_settings(const ControlFacts& facts);
  void make_link_settings(const ControlFacts& facts);
  [[nodiscard]] std::string why_not(const Setting& setting, const nlohmann::json& value) const;
  void set_servo(Pending command);
  void set_simulator(const Pending& command);
  void set_hand(const Pending& command);
  void take_answers();
  void take_simulator_answer(std::uint64_t number, const SimulatorValues& values);
  void give_up_late_ones();
  void finish(const Pending& command, bool done, const std::string& text);
  Setting* find(const std::string& name);
  nlohmann::json listed() const;

  const ControlFacts facts_;
  servo::ServoPorts& ports_;
  Calls calls_;

  std::mutex mutex_;  ///< of all below but the thread
  std::vector<Setting> settings_;
  std::map<std::uint64_t, Pending> simulator_pending_;  ///< by the datagram's number
  std::uint64_t next_number_ = 1;
  std::optional<Pending> budget_pending_;
  std::optional<Pending> requests_pending_;
  std::optional<Pending> hand_pending_;
  std::optional<std::int64_t> first_cycle_ns_;
  std::int64_t newest_cycle_ns_ = 0;
  nlohmann::json changes_ = nlohmann::json::array();
  std::optional<rt::LocalDatagrams> socket_;
  bool stopped_ = false;
  int wake_ = -1;  ///< an eventfd that ends the thread
  std::thread thread_;
};

}  // namespace forcegrid::cli
