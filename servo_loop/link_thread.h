// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <cstdint>
#include <deque>
#include <exception>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <thread>
#include <utility>
#include <vector>

#include "link/servo_endpoint.h"
#include "servo_loop/servo_loop.h"

namespace forcegrid::servo {
#pragma GCC visibility push(default)

/// The first sample in contact: where and when the tool touched, to within one simulator period.
struct FirstContact {
  std::int64_t time_ns = 0;  ///< CLOCK_MONOTONIC of the tool state that the simulator answered
  std::uint32_t epoch = 0;
  Eigen::Vector3d point_W = Eigen::Vector3d::Zero();
};

/// Sends the servo's newest tool state and queries to the simulator, and hands the simulator's
/// checked samples to the servo, on its own thread.
/// Threads: start and stop from one; statistics() after stop().
class LinkThread {
 public:
  /// @param keys  of a sealed link, see link::ServoEndpoint; none: not sealed
  /// @param tool  its number among the simulator's; 0: the only one
  /// @throws link::LinkError for an address or a tool that cannot be used.
  LinkThread(std::string_view simulator_address, ServoPorts& ports,
             std::vector<link::LinkKey> keys = {}, link::ToolId tool = 0);
  ~LinkThread();
  LinkThread(const LinkThread&) = delete;
  LinkThread& operator=(const LinkThread&) = delete;

  /// Before start(): keeps the newest `count` samples that reach the servo, for samples().
  void keep_samples(std::size_t count) noexcept { samples_to_keep_ = count; }

  /// Before start(): calls `take` with each sample that reaches the servo, on the link's thread.
  /// It must return soon.
  void on_sample(std::function<void(const ArrivedSample&)> take) { on_sample_ = std::move(take); }

  /// Before start(): calls `take` with where the other tools are, whenever the simulator has said
  /// so, on the link's thread. It must return soon.
  void on_others(std::function<void(const link::OtherTools&)> take) {
    on_others_ = std::move(take);
  }

  void start();
  /// Says goodbye to the simulator and joins. Idempotent.
  /// @param fault  the device has failed: tells a simulator of several tools so.
  void stop(bool fault = false);

  /// While it runs, from any thread: when the newest sample was accepted, CLOCK_MONOTONIC; 0: none
  /// was.
  std::int64_t newest_sample_ns() const noexcept { return newest_sample_ns_.load(); }
  /// While it runs, from any thread: the system has reported that nobody listens at the
  /// simulator's address, and no sample has come since.
  bool nobody_listens() const noexcept { return nobody_listens_.load(); }
  /// Why the simulator does not serve this servo.
  enum class Barred : std::uint8_t {
    kNo,
    kAllPlacesTaken,  ///< link::Refusal::Reason, with most_tools()
    kToolTaken,
    kOtherFault,    ///< another tool's device has failed
    kKnowsOneTool,  ///< link::ServoEndpoint::simulator_knows_one_tool()
  };
  /// While it runs, from any thread.
  Barred barred() const noexcept { return barred_.load(); }
  /// While it runs, from any thread: how many tools a simulator that has refused this one serves.
  std::uint32_t most_tools() const noexcept { return most_tools_.load(); }

  /// After stop(): whether the simulator may get orientations, see
  /// link::ServoEndpoint::simulator_knows_poses().
  bool simulator_knows_poses() const noexcept { return endpoint_.simulator_knows_poses(); }
  /// After stop(): the exception that ended the exchange, in its own words; empty: none did.
  std::string trouble() const;
  /// After stop().
  link::ClockEstimate simulator_clock() const noexcept { return endpoint_.clock(); }
  const link::LinkStatistics& statistics() const noexcept { return endpoint_.statistics(); }
  /// Accepted datagrams that were samples. After stop().
  std::uint64_t samples_accepted() const noexcept {
    return endpoint_.statistics().accepted - endpoint_.patches_accepted() -
           endpoint_.others_accepted() - endpoint_.refusals_accepted();
  }
  /// Messages about the other tools, and the newest one; count 0 before the first. After stop().
  std::uint64_t others_accepted() const noexcept { return endpoint_.others_accepted(); }
  const link::OtherTools& others() const noexcept { return others_; }
  /// After stop(). Nothing if the tool never touched.
  const std::optional<FirstContact>& first_contact() const noexcept { return first_contact_; }
  /// The samples kept, in order of arrival. After stop().
  const std::deque<ArrivedSample>& samples() const noexcept { return samples_; }
  /// Samples that found the servo's ring full. After stop().
  std::uint64_t samples_lost() const noexcept { return samples_lost_; }
  /// [s] Largest solve time of all samples. After stop().
  double worst_solve_time_s() const noexcept { return worst_solve_time_s_; }
  double worst_relative_residual() const noexcept { return worst_relative_residual_; }
  std::uint64_t samples_not_converged() const noexcept { return samples_not_converged_; }

 private:
  void exchange();
  void take(const link::ForceSample& sample);
  void look_whether_barred() noexcept;

  ServoPorts& ports_;
  link::ServoEndpoint endpoint_;
  std::atomic<bool> stop_{false};
  std::atomic<bool> fault_{false};  ///< as stop() was told
  std::atomic<std::int64_t> newest_sample_ns_{0};
  std::atomic<bool> nobody_listens_{false};
  std::atomic<Barred> barred_{Barred::kNo};
  std::atomic<std::uint32_t> most_tools_{1};
  std::uint64_t unheard_before_ = 0;  ///< send_no_peer at the newest sample
  std::thread thread_;
  std::exception_ptr trouble_;  ///< of that thread
  std::optional<FirstContact> first_contact_;
  std::function<void(const ArrivedSample&)> on_sample_;
  std::function<void(const link::OtherTools&)> on_others_;
  link::OtherTools others_;
  std::size_t samples_to_keep_ = 0;
  std::deque<ArrivedSample> samples_;
  std::uint64_t samples_lost_ = 0;
  std::uint64_t samples_not_converged_ = 0;
  double worst_solve_time_s_ = 0.0;
  double worst_relative_residual_ = 0.0;
};

#pragma GCC visibility pop
}  // namespace forcegrid::servo
