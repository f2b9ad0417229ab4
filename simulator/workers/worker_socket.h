// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <optional>
#include <string>
#include <vector>
#include <zmq.hpp>

#include "link/address.h"
#include "link/key.h"

/// The ZeroMQ ends of simulator and workers, both held to CURVE with pairs that are derived from
/// one link key (link/curve_keys.h).
namespace forcegrid::simulator {

/// Makes `socket` the simulator's end and listens.
/// @throws Error naming the address and the remedy.
void listen_as_simulator(zmq::socket_t& socket, const link::Address& address,
                         const link::LinkKey& key);

/// Makes `socket` a worker's end. Connects in the background, again and again.
void connect_as_worker(zmq::socket_t& socket, const link::Address& address,
                       const link::LinkKey& key);

/// @returns whether a message has come; false after `timeout`, true after a signal.
bool wait_for_message(zmq::socket_t& socket, std::chrono::milliseconds timeout);

/// The frames of a message that has arrived; nothing if there is none. Does not wait.
std::optional<std::vector<std::string>> receive(zmq::socket_t& socket);

/// @returns false if the peer has gone or takes nothing more at present. Does not wait.
bool send(zmq::socket_t& socket, const std::vector<std::string>& frames);

}  // namespace forcegrid::simulator
