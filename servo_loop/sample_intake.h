// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <optional>
#include <vector>

#include "forcegrid/core/force_method.h"
#include "forcegrid/core/sample_gate.h"
#include "link/messages.h"
#include "rt/clock.h"
#include "servo_loop/cycle_record.h"
#include "servo_loop/first_touch.h"
#include "servo_loop/servo_ports.h"
#include "servo_loop/tool_torque.h"

namespace forcegrid::servo {

/// The servo's end of the link: gives the simulator's samples to the methods, keeps track of the
/// contact, and sends the tool state and the rendered method's queries.
///
/// A sample along the path counts for contact at once: the first in contact, or with another epoch
/// than the last, calls contact_made() of every method; the first out of contact calls
/// contact_lost(). Its force must also pass SampleGate before any method gets it; a refused one
/// does not make the samples younger. A sample out of contact whose contact point lies elsewhere
/// than the tool announces where the tool will touch: expected_contact_W().
///
/// An answer to a query says nothing about where the tool is, nor about contact. Only the rendered
/// method gets it, and only if it belongs to the contact that lasts, or was asked for before it by
/// a method that can use such answers (MethodNeeds::requests_before_contact).
///
/// Samples are taken in the order of the ring. link::ServoEndpoint has removed forged, late and
/// duplicated ones; a method ignores a sample older than the newest that it has taken.
///
/// Real-time: no allocation, lock or throw after construction; at most ServoPorts::kSampleCapacity
/// samples per cycle. Threads: one, the servo's.
class SampleIntake {
 public:
  struct Options {
    double max_force_N = 0.0;         ///< of the device, for SampleGate
    double simulator_rate_Hz = 30.0;  ///< expected, until samples have shown it; above 0
    double requests_per_s = 0.0;      ///< 0: no queries
  };

  /// @param ports    must outlive the intake.
  /// @param methods  the first one is rendered; at least one, none null; must outlive the intake.
  SampleIntake(ServoPorts& ports, std::vector<ForceMethod*> methods, const Options& options);

  /// How a tool on a wrist is turned, and the buttons of its stylus.
  struct ToolPose {
    std::array<double, 4> orientation_WT_wxyz = link::kIdentity;
    Eigen::Vector3d angular_velocity_W_rad_per_s = Eigen::Vector3d::Zero();
    bool has_buttons = false;
    std::uint32_t buttons = 0;
  };

  /// Publishes where the tool is, for the link thread to send.
  /// @param position_W [m] where the object is touched. @param velocity_W [m/s].
  /// @param pose nothing of a device without a wrist.
  void send_tool_state(rt::TimePoint now, const Eigen::Vector3d& position_W,
                       const Eigen::Vector3d& velocity_W,
                       const std::optional<ToolPose>& pose = std::nullopt) noexcept;

  /// Takes in all that has arrived since the last call. The newest surface goes to `first_touch`,
  /// and so does the news of each sample along the path.
  void take(rt::TimePoint now, FirstTouch& first_touch) noexcept;

  /// Sends a query if one is due and the rendered method wants one for a tool at `position_W` [m].
  /// Queries are made in contact, and before an expected contact if the method asks for that.
  /// Queries that a pause has prevented are not made up for.
  void query_if_due(rt::TimePoint now, const Eigen::Vector3d& position_W) noexcept;

  /// From now on; finite, at least 0. Real-time: yes.
  void set_requests_per_s(double requests_per_s) noexcept { requests_per_s_ = requests_per_s; }
  [[nodiscard]] double requests_per_s() const noexcept { return requests_per_s_; }

  /// A sample has come along the path, since construction or restart().
  [[nodiscard]] bool has_sample() const noexcept { return has_sample_; }
  [[nodiscard]] bool in_contact() const noexcept { return in_contact_; }
  /// [m] Where the tool, now in the air, will touch according to the simulator; else nothing.
  [[nodiscard]] const std::optional<Eigen::Vector3d>& expected_contact_W() const noexcept {
    return expected_contact_W_;
  }
  /// [s] Since the newest believed sample arrived; infinite without a sample.
  [[nodiscard]] double sample_age_s(rt::TimePoint now) const noexcept;
  /// [s] From sample to sample, averaged over some ten of them.
  [[nodiscard]] double sample_period_s() const noexcept { return sample_period_s_; }
  /// The object's torque on the tool by the newest believed sample that has one; none is known out
  /// of contact.
  [[nodiscard]] const ToolTorque& tool_torque() const noexcept { return tool_torque_; }
  /// Contact, epoch, count and age of samples, into the record of the cycle at `now`.
  void describe(rt::TimePoint now, CycleRecord& record) const noexcept;

  /// The samples so far are about a hand that has moved on: has_sample() is false until the next.
  void restart() noexcept;

  [[nodiscard]] std::uint64_t queries_sent() const noexcept { return queries_sent_; }
  [[nodiscard]] std::uint64_t answers_taken() const noexcept { return answers_taken_; }
  /// By SampleGate.
  [[nodiscard]] std::uint64_t samples_refused() const noexcept { return gate_.refused(); }

 private:
  void take_sample(rt::TimePoint now, const ArrivedSample& arrived,
                   FirstTouch& first_touch) noexcept;
  void take_contact(const ArrivedSample& arrived) noexcept;
  void take_torque(const ArrivedSample& arrived) noexcept;
  void take_answer(const ArrivedSample& answer) noexcept;
  void send_query(rt::TimePoint now, const Eigen::Vector3d& position_W) noexcept;

  ServoPorts& ports_;
  std::vector<ForceMethod*> methods_;
  double requests_per_s_;
  bool queries_before_contact_;
  SampleGate gate_;
  ToolTorque tool_torque_{ToolTorqueOptions{}};

  bool has_sample_ = false;
  rt::TimePoint newest_arrival_{};    ///< of any sample along the path
  rt::TimePoint believed_arrival_{};  ///< of the newest one that was believed
  double believed_time_s_ = 0.0;      ///< when the tool was at that one's position
  double sample_period_s_;
  std::uint64_t samples_taken_ = 0;
  std::uint64_t arrivals_taken_ = 0;  ///< from the ring, whatever they were

  bool contact_known_ = false;
  bool in_contact_ = false;
  std::uint32_t contact_epoch_ = 0;
  std::optional<std::uint32_t> air_epoch_;  ///< of the newest sample out of contact
  std::optional<Eigen::Vector3d> expected_contact_W_;

  rt::TimePoint next_query_{};
  std::uint32_t last_query_id_ = 0;
  std::uint32_t tool_sequence_ = 0;
  std::uint64_t queries_sent_ = 0;
  std::uint64_t answers_taken_ = 0;
};

}  // namespace forcegrid::servo
