// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/asio/io_context.hpp>
#include <boost/asio/local/stream_protocol.hpp>
#include <boost/asio/steady_timer.hpp>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "view_link/frame.h"

namespace forcegrid::view {

class LocalConnection;

/// A Unix socket on which peers of this account send frames. A peer that breaks the framing, or
/// whose frame on_frame refuses, is disconnected with a line of log.
/// Real-time: no. Threads: the io_context's.
class LocalListener {
 public:
  struct Options {
    std::string path;
    std::string peer;  ///< "run" or "simulator", for people
    std::size_t largest_payload = 0;
    std::size_t most_connections = 1;  ///< more are closed at once
    /// A frame of the peer `id`, never 0. @throws ViewLinkError to disconnect it.
    std::function<void(std::uint64_t id, const view_link::Frame&)> on_frame;
    std::function<void(std::uint64_t id)> on_closed;
  };

  /// Binds and listens. @throws boost::system::system_error.
  LocalListener(boost::asio::io_context& context, Options options);
  ~LocalListener();
  LocalListener(const LocalListener&) = delete;
  LocalListener& operator=(const LocalListener&) = delete;

  /// Sends a frame to the peer `id`. With `key` other than 0, it takes the place of one of the same
  /// key that waits. False: it is not there, or 64 KiB wait already.
  bool send_to(std::uint64_t id, const view_link::Frame& frame, int key);
  bool has_peer() const noexcept { return !connections_.empty(); }
  /// Takes no more peers; those that are there stay.
  void stop_accepting();
  /// Disconnects all, too.
  void close();

 private:
  friend class LocalConnection;
  void accept();
  void closed(std::uint64_t id);

  boost::asio::io_context& context_;
  Options options_;
  boost::asio::local::stream_protocol::acceptor acceptor_;
  boost::asio::steady_timer retry_;
  std::map<std::uint64_t, std::shared_ptr<LocalConnection>> connections_;
  std::uint64_t next_id_ = 1;
};

}  // namespace forcegrid::view
