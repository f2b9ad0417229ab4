// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <thread>

#include "tools/recorder.h"
#include "view_link/frame.h"
#include "view_link/frame_sender.h"

namespace forcegrid::cli {

/// A socket for a simulator's surface stream (docs/view_protocol.md) on its way to a recording and,
/// if there is one, to the live view. Simulators that break the protocol are disconnected, with a
/// line of log. Real-time: no. Threads: one, besides its own.
class SurfaceTap {
 public:
  /// Listens in a private folder of its own.
  /// @param view_socket  where everything goes on to; empty: nowhere.
  /// @throws std::runtime_error with the system's reason.
  explicit SurfaceTap(std::string view_socket);
  /// Removes the socket.
  ~SurfaceTap();
  SurfaceTap(const SurfaceTap&) = delete;
  SurfaceTap& operator=(const SurfaceTap&) = delete;

  const std::string& socket() const noexcept { return path_; }

  /// From now on `recorder` gets everything; at once the shapes that have come and are still used.
  /// @param recorder  outlives this, or is replaced by null before its end.
  void record(tools::Recorder* recorder);

 private:
  struct Simulator;
  void serve();
  void accept();
  void take(Simulator& simulator, const view_link::Frame& frame);
  void pass_on(Simulator& simulator, const view_link::Frame& frame);
  void take_shape(const view_link::Frame& frame, std::int64_t now_ns);
  void take_frame(const view_link::Frame& frame, std::int64_t now_ns);

  std::string view_socket_;
  std::string folder_;
  std::string path_;
  int listener_ = -1;
  int wake_ = -1;
  std::mutex mutex_;  ///< of the next two
  tools::Recorder* recorder_ = nullptr;
  std::map<std::uint16_t, tools::RecordedShape> shapes_;  ///< by object
  std::map<int, std::unique_ptr<Simulator>> simulators_;  ///< by descriptor; of the thread alone
  std::atomic<bool> over_{false};
  std::thread thread_;
};

}  // namespace forcegrid::cli
