#pragma once

#include <cstdint>
#include <zmq.hpp>

#include "link/curve_keys.h"
#include "link/key.h"

namespace forcegrid::simulator {

/// Decides who may connect to the CURVE servers of a ZeroMQ context: who has the key's client pair.
/// ZeroMQ asks over an inner socket (ZAP, ZeroMQ RFC 27) and lets nobody in until it is answered.
/// Real-time: no. Threads: one at a time.
class CurveAuthenticator {
 public:
  /// To be made before the servers of `context`; one a context.
  CurveAuthenticator(zmq::context_t& context, const link::LinkKey& key);

  /// Answers what ZeroMQ has asked since the last time.
  void answer();
  /// Those with another key. Who does not know the server's public key is not even asked about.
  [[nodiscard]] std::uint64_t strangers() const noexcept { return strangers_; }

 private:
  link::CurvePair client_;
  zmq::socket_t questions_;
  std::uint64_t strangers_ = 0;
};

}  // namespace forcegrid::simulator
