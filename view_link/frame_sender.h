// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <mutex>
#include <string>
#include <thread>

#include "view_link/frame.h"

namespace forcegrid::view_link {

/// What is sent to the live view over a local socket (AF_UNIX, stream), by a thread of its own. A
/// view that is slow or gone costs the sender nothing: what does not fit into the bounded queue is
/// dropped and counted.
/// Real-time: no; push() takes a lock and allocates. Threads: push() from any, the rest from one.
class FrameSender {
 public:
  struct Options {
    std::string path;  ///< of the view's socket
    /// [bytes] What may wait; one frame is always taken.
    std::size_t most_waiting_bytes = std::size_t{8} << 20;
    /// Called on the sender's thread with each frame that the view sends; empty: they are ignored.
    std::function<void(const Frame&)> on_frame;
    /// Called once on that thread with a sentence, when the view has gone away; may be empty.
    std::function<void(const std::string&)> on_lost;
  };

  /// Connects and starts the thread.
  /// @throws ViewLinkError naming the path and the system's reason.
  explicit FrameSender(Options options);
  /// As finish().
  ~FrameSender();
  FrameSender(const FrameSender&) = delete;
  FrameSender& operator=(const FrameSender&) = delete;

  /// Sends `frame` after those that wait.
  void push(const Frame& frame);
  /// Sends `frame` in place of one of the same type and object that still waits.
  void push_newest(const Frame& frame);
  /// As push() and push_newest(), but `frame` may wait for the next of them or for send(): frames
  /// that go together wake the thread, and the view, once.
  void queue(const Frame& frame);
  void queue_newest(const Frame& frame);
  void send() const noexcept { wake(); }

  /// Sends what waits, for at most `timeout_s`, and joins. Idempotent.
  void finish(double timeout_s = 0.5);

  /// [bytes] That wait. Who must not lose a frame pushes while there is room below
  /// Options::most_waiting_bytes.
  std::size_t waiting_bytes() const;

  bool lost() const noexcept { return lost_.load(); }  ///< the view has gone away
  std::uint64_t dropped() const noexcept { return dropped_.load(); }

 private:
  struct Waiting {
    std::uint16_t type;
    std::uint16_t object;
    bool newest;  ///< a newer one may take its place
    Bytes bytes;
  };
  bool queue(const Frame& frame, bool newest);
  void exchange();
  void exchange_until_over();
  bool send_some(Bytes& now, std::size_t& sent);
  bool receive_some(FrameReader& reader);
  void wake() const noexcept;

  Options options_;
  int socket_ = -1;
  int wake_ = -1;  ///< eventfd: there is something to send
  mutable std::mutex mutex_;
  std::deque<Waiting> waiting_;
  std::size_t waiting_bytes_ = 0;
  std::atomic<bool> finishing_{false};
  std::atomic<bool> lost_{false};
  std::atomic<bool> stop_now_{false};
  std::atomic<std::uint64_t> dropped_{0};
  std::thread thread_;
};

}  // namespace forcegrid::view_link
