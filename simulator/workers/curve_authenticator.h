// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <zmq.hpp>

#include "link/curve_keys.h"
#include "link/key.h"

namespace forcegrid::simulator {

/// Admits clients to the CURVE servers of a ZeroMQ context if they present the client key pair
/// derived from the link key. ZeroMQ asks through an inner socket (ZAP, ZeroMQ RFC 27) and admits
/// no client before answer(). Real-time: no. Threads: one at a time.
class CurveAuthenticator {
 public:
  /// Construct it before the servers of `context`; one per context.
  CurveAuthenticator(zmq::context_t& context, const link::LinkKey& key);

  /// Answers ZeroMQ's requests since the last call.
  void answer();
  /// Clients refused because of another key. Clients that do not present the server's public key
  /// are rejected before any lookup and not counted.
  [[nodiscard]] std::uint64_t strangers() const noexcept { return strangers_; }

 private:
  link::CurvePair client_;
  zmq::socket_t questions_;
  std::uint64_t strangers_ = 0;
};

}  // namespace forcegrid::simulator
