// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>
#include <zmq.hpp>

#include "link/address.h"
#include "link/curve_keys.h"
#include "link/key.h"
#include "simulator/workers/worker_protocol.h"
#include "simulator/workers/worker_socket.h"

namespace forcegrid::simulator {

inline constexpr char kWorkersScene[] = "small";

inline WorkerHello hello_of(const std::string& name) {
  return {name, digest_of(make_scene(kWorkersScene))};
}

/// A worker that says what a test wants.
class ScriptedWorker {
 public:
  ScriptedWorker(const std::string& address, const link::LinkKey& key) {
    const std::string scheme = "tcp://";
    connect_as_worker(socket_,
                      link::parse_address(address.substr(scheme.size()), link::PortZero::kRefused,
                                          link::Reach::kLoopback),
                      key);
  }
  /// One that knows the public key of a simulator with `server_key`, but has another key itself.
  ScriptedWorker(const std::string& address, const link::LinkKey& server_key,
                 const link::LinkKey& own_key) {
    link::CurvePair server;
    link::CurvePair client;
    link::derive(server_key, link::CurveSide::kServer, server);
    link::derive(own_key, link::CurveSide::kClient, client);
    socket_.set(zmq::sockopt::linger, 0);
    socket_.set(zmq::sockopt::curve_serverkey, zmq::buffer(server.public_key.data(), 32));
    socket_.set(zmq::sockopt::curve_publickey, zmq::buffer(client.public_key.data(), 32));
    socket_.set(zmq::sockopt::curve_secretkey, zmq::buffer(client.secret_key.data(), 32));
    socket_.connect(address);
  }

  /// @returns false while there is no connection.
  bool say(const std::string& text) { return send(socket_, {text}); }
  std::optional<std::string> heard() {
    const auto frames = receive(socket_);
    return frames ? std::optional(frames->front()) : std::nullopt;
  }

 private:
  zmq::context_t context_{1};
  zmq::socket_t socket_{context_, zmq::socket_type::dealer};
};

/// The answer to a job: `force_W_N` at the place that was asked for, converged.
inline NumberedAnswer answer_to(const NumberedJob& job, const Eigen::Vector3d& force_W_N) {
  NumberedAnswer numbered;
  numbered.id = job.id;
  StickyContact::Answer& answer = numbered.answer;
  answer.epoch = job.job.answer_epoch();
  answer.in_contact = job.job.touching;
  answer.position_W = job.job.position_W;
  answer.equilibrium.converged = true;
  answer.equilibrium.force_W = force_W_N;
  return numbered;
}

}  // namespace forcegrid::simulator
