// SPDX-License-Identifier: Apache-2.0
#include "simulator/workers/worker_socket.h"

#include <cerrno>
#include <cstdint>

#include "link/curve_keys.h"
#include "simulator/mesh/error.h"

namespace forcegrid::simulator {
namespace {

constexpr std::int64_t kMaxMessageBytes = 65536;
constexpr int kHeartbeat_ms = 1000;

template <typename Bytes>
zmq::const_buffer buffer_of(const Bytes& bytes) {
  return zmq::buffer(bytes.data(), bytes.size());
}

void set_common(zmq::socket_t& socket, const link::Address& address) {
  socket.set(zmq::sockopt::linger, 0);
  socket.set(zmq::sockopt::ipv6, address.is_ipv6);
  socket.set(zmq::sockopt::maxmsgsize, kMaxMessageBytes);
  socket.set(zmq::sockopt::heartbeat_ivl, kHeartbeat_ms);
}

// A signal is not an error for a call that does not wait.
template <typename Call>
auto uninterrupted(Call call) {
  for (;;) {
    try {
      return call();
    } catch (const zmq::error_t& error) {
      if (error.num() != EINTR) {
        throw;
      }
    }
  }
}

}  // namespace

void listen_as_simulator(zmq::socket_t& socket, const link::Address& address,
                         const link::LinkKey& key) {
  link::CurvePair server;
  link::derive(key, link::CurveSide::kServer, server);
  set_common(socket, address);
  socket.set(zmq::sockopt::router_mandatory, true);
  socket.set(zmq::sockopt::zap_domain, "forcegrid");
  socket.set(zmq::sockopt::curve_server, true);
  socket.set(zmq::sockopt::curve_secretkey, buffer_of(server.secret_key));
  try {
    socket.bind("tcp://" + link::to_string(address));
  } catch (const zmq::error_t& error) {
    throw Error("workers at " + link::to_string(address) + ": " + error.what() +
                "; choose another port (0 takes a free one) or an address of this machine");
  }
}

void connect_as_worker(zmq::socket_t& socket, const link::Address& address,
                       const link::LinkKey& key) {
  link::CurvePair server;
  link::CurvePair client;
  link::derive(key, link::CurveSide::kServer, server);
  link::derive(key, link::CurveSide::kClient, client);
  set_common(socket, address);
  socket.set(zmq::sockopt::immediate, true);  // queue nothing for an absent simulator
  socket.set(zmq::sockopt::curve_serverkey, buffer_of(server.public_key));
  socket.set(zmq::sockopt::curve_publickey, buffer_of(client.public_key));
  socket.set(zmq::sockopt::curve_secretkey, buffer_of(client.secret_key));
  socket.connect("tcp://" + link::to_string(address));
}

bool wait_for_message(zmq::socket_t& socket, std::chrono::milliseconds timeout) {
  zmq::pollitem_t item{socket.handle(), 0, ZMQ_POLLIN, 0};
  try {
    return zmq::poll(&item, 1, timeout) > 0;
  } catch (const zmq::error_t& error) {
    if (error.num() != EINTR) {
      throw;
    }
    return true;
  }
}

std::optional<std::vector<std::string>> receive(zmq::socket_t& socket) {
  std::vector<std::string> frames;
  bool more = true;
  while (more) {
    zmq::message_t frame;
    // The parts of a message arrive together.
    if (!uninterrupted([&] { return socket.recv(frame, zmq::recv_flags::dontwait); })) {
      return std::nullopt;
    }
    more = frame.more();
    frames.push_back(frame.to_string());
  }
  return frames;
}

bool send(zmq::socket_t& socket, const std::vector<std::string>& frames) {
  for (std::size_t i = 0; i < frames.size(); ++i) {
    const auto more = i + 1 < frames.size() ? zmq::send_flags::sndmore : zmq::send_flags::none;
    try {
      if (!uninterrupted([&] {
            return socket.send(zmq::buffer(frames[i]), more | zmq::send_flags::dontwait);
          })) {
        return false;
      }
    } catch (const zmq::error_t& error) {
      if (error.num() != EHOSTUNREACH) {
        throw;
      }
      return false;
    }
  }
  return true;
}

}  // namespace forcegrid::simulator
