// SPDX-License-Identifier: Apache-2.0
#include "scripted_usbip_server.h"

#include <arpa/inet.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <stdexcept>

namespace forcegrid::driver {
namespace {

std::uint32_t big32(const Bytes& bytes, std::size_t at) {
  return (std::uint32_t{bytes[at]} << 24) | (std::uint32_t{bytes[at + 1]} << 16) |
         (std::uint32_t{bytes[at + 2]} << 8) | bytes[at + 3];
}

void append32(Bytes& bytes, std::uint32_t value) {
  for (int shift = 24; shift >= 0; shift -= 8) {
    bytes.push_back(static_cast<std::uint8_t>(value >> shift));
  }
}

bool send_all(int client, const Bytes& bytes) {
  return ::send(client, bytes.data(), bytes.size(), MSG_NOSIGNAL) ==
         static_cast<ssize_t>(bytes.size());
}

Bytes reply(std::uint32_t command, std::uint32_t sequence, std::int32_t status,
            std::uint32_t length, const Bytes& payload) {
  Bytes bytes;
  append32(bytes, command);
  append32(bytes, sequence);
  for (int i = 0; i < 3; ++i) {
    append32(bytes, 0);
  }
  append32(bytes, static_cast<std::uint32_t>(status));
  append32(bytes, length);
  bytes.resize(48, 0);
  bytes.insert(bytes.end(), payload.begin(), payload.end());
  return bytes;
}

}  // namespace

ScriptedUsbipServer::ScriptedUsbipServer(Script& script)
    : script_(script), listener_(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  socklen_t size = sizeof address;
  if (::bind(listener_, reinterpret_cast<sockaddr*>(&address), sizeof address) != 0 ||
      ::listen(listener_, 1) != 0 ||
      ::getsockname(listener_, reinterpret_cast<sockaddr*>(&address), &size) != 0) {
    throw std::runtime_error(std::strerror(errno));
  }
  port_ = ntohs(address.sin_port);
  armed_ = script_.speak_first;
  thread_ = std::thread([this] { serve(); });
}

ScriptedUsbipServer::~ScriptedUsbipServer() {
  ending_ = true;
  thread_.join();
  ::close(listener_);
}

std::string ScriptedUsbipServer::url() const {
  return "usbip://127.0.0.1:" + std::to_string(port_) + "/1-1";
}

void ScriptedUsbipServer::set_counts(const std::array<std::int32_t, 6>& counts) {
  const std::lock_guard lock(mutex_);
  counts_ = counts;
}

std::array<std::int32_t, 6> ScriptedUsbipServer::counts() const {
  const std::lock_guard lock(mutex_);
  return counts_;
}

std::vector<Bytes> ScriptedUsbipServer::outs() const {
  const std::lock_guard lock(mutex_);
  return outs_;
}

std::vector<Bytes> ScriptedUsbipServer::setups() const {
  const std::lock_guard lock(mutex_);
  return setups_;
}

void ScriptedUsbipServer::serve() {
  while (!ending_) {
    pollfd entry{.fd = listener_, .events = POLLIN, .revents = 0};
    if (::poll(&entry, 1, 10) <= 0) {
      continue;
    }
    const int client = ::accept(listener_, nullptr, nullptr);
    const int on = 1;
    ::setsockopt(client, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
    if (import(client)) {
      while (!ending_ && serve_client(client)) {
      }
    }
    ::close(client);
    client_gone_ = true;
  }
}

bool ScriptedUsbipServer::receive(int client, std::uint8_t* bytes, std::size_t size) {
  while (size > 0) {
    pollfd entry{.fd = client, .events = POLLIN, .revents = 0};
    if (::poll(&entry, 1, 10) <= 0) {
      if (ending_) {
        return false;
      }
      continue;
    }
    const ssize_t count = ::recv(client, bytes, size, 0);
    if (count <= 0) {
      return false;
    }
    bytes += count;
    size -= static_cast<std::size_t>(count);
  }
  return true;
}

bool ScriptedUsbipServer::import(int client) {
  Bytes request(40);
  if (!receive(client, request.data(), request.size())) {
    return false;
  }
  if (!script_.answer_import) {
    std::uint8_t byte = 0;
    receive(client, &byte, 1);
    return false;
  }
  Bytes bytes = {static_cast<std::uint8_t>(script_.import_version >> 8),
                 static_cast<std::uint8_t>(script_.import_version), 0x00, 0x03};
  append32(bytes, script_.import_status);
  if (script_.import_status == 0) {
    Bytes device(312);
    std::copy(script_.import_bus_id.begin(), script_.import_bus_id.end(), device.begin() + 256);
    device[291] = 1;  // bus 1, device 2, full speed
    device[295] = 2;
    device[299] = 2;
    bytes.insert(bytes.end(), device.begin(), device.end());
  }
  return send_all(client, bytes) && script_.import_status == 0;
}

bool ScriptedUsbipServer::serve_client(int client) {
  Bytes header(48);
  if (!receive(client, header.data(), header.size())) {
    return false;
  }
  switch (big32(header, 0)) {
    case 1:
      return submit(client, header);
    case 2:
      return unlink(client, header);
    default:
      return false;
  }
}

bool ScriptedUsbipServer::submit(int client, const Bytes& header) {
  const std::uint32_t device_id = big32(header, 8);
  if (device_id != 0x00010002) {
    return false;
  }
  if (big32(header, 16) == 0) {
    return control(client, header);
  }
  if (big32(header, 12) == 1) {
    pending_in_ = big32(header, 4);
    return script_.in_first || deliver(client);
  }
  return out(client, header);
}

Bytes ScriptedUsbipServer::descriptor(std::uint8_t type, std::uint8_t number) const {
  if (type == 1) {
    return script_.device_descriptor;
  }
  if (type == 2) {
    return script_.configuration_descriptor;
  }
  if (type == 0x22) {
    return script_.report_descriptor;
  }
  if (type == 3 && number == 0) {
    return {4, 3, 0x09, 0x04};
  }
  if (type == 3 && number <= 3) {
    const std::string& text = script_.strings[number - 1U];
    Bytes bytes = {static_cast<std::uint8_t>(2 + 2 * text.size()), 3};
    for (const char c : text) {
      bytes.push_back(static_cast<std::uint8_t>(c));
      bytes.push_back(0);
    }
    return bytes;
  }
  return {};
}

bool ScriptedUsbipServer::control(int client, const Bytes& header) {
  const Bytes setup(header.begin() + 40, header.end());
  {
    const std::lock_guard lock(mutex_);
    setups_.push_back(setup);
  }
  if (!script_.answer_control) {
    return true;
  }
  const std::uint32_t sequence = big32(header, 4);
  if (setup[1] == 6) {
    Bytes data = descriptor(setup[3], setup[2]);
    data.resize(std::min<std::size_t>(data.size(), setup[6] | (setup[7] << 8)));
    return send_all(client, reply(3, sequence, data.empty() ? -EPIPE : 0,
                                  static_cast<std::uint32_t>(data.size()), data));
  }
  const bool set_configuration = setup[0] == 0 && setup[1] == 9;
  return send_all(client, reply(3, sequence, set_configuration ? 0 : -EPIPE, 0, {}));
}

bool ScriptedUsbipServer::out(int client, const Bytes& header) {
  const std::uint32_t length = big32(header, 24);
  Bytes report(length);
  if (length > 64 || !receive(client, report.data(), report.size())) {
    return false;
  }
  if (!script_.take_outs) {
    pending_out_ = big32(header, 4);
    return true;
  }
  if (script_.close_after_outs >= 0 && script_.close_after_outs-- == 0) {
    return false;
  }
  {
    const std::lock_guard lock(mutex_);
    outs_.push_back(report);
    if (report.size() == script_.wire_bytes &&
        report[6] == 1) {  // load counters; d, e, f in the current fields
      const auto word = [&](std::size_t i) {
        return static_cast<std::int16_t>(report[2 * i] | (report[2 * i + 1] << 8));
      };
      counts_ = {word(4), word(5), word(6), word(0), word(1), word(2)};
      if (!script_.has_wrist) {
        counts_[3] = counts_[4] = counts_[5] = 0;
      }
      button_ = false;
    }
  }
  if (script_.in_first && !deliver(client)) {
    return false;
  }
  const std::uint32_t sequence = big32(header, 4);
  if (script_.lie_now.exchange(false)) {
    return send_all(client, script_.lie(sequence));
  }
  if (!send_all(client, reply(3, sequence, 0, length, {}))) {
    return false;
  }
  if (script_.merge_outs > 0) {
    --script_.merge_outs;
    return true;
  }
  armed_ = script_.send_reports;
  {
    const std::lock_guard lock(mutex_);
    counts_[0] += script_.arm_step;
  }
  const bool delivered = script_.in_first || deliver(client);
  if (script_.foreign_outs > 0) {
    --script_.foreign_outs;
    const std::lock_guard lock(mutex_);
    counts_[0] += script_.foreign_step;
    armed_ = true;  // it goes with the next IN
  }
  return delivered;
}

bool ScriptedUsbipServer::deliver(int client) {
  if (!armed_ || pending_in_ == 0) {
    return true;
  }
  armed_ = false;
  const std::uint32_t sequence = pending_in_;
  pending_in_ = 0;
  if (const int status = script_.report_status; status != 0) {
    return send_all(client, reply(3, sequence, status, 0, {}));
  }
  Bytes report;
  {
    const std::lock_guard lock(mutex_);
    for (const std::int32_t count : counts_) {
      report.push_back(static_cast<std::uint8_t>(count & 0xFF));
      report.push_back(static_cast<std::uint8_t>((count >> 8) & 0xFF));
    }
  }
  report.push_back(button_ ? 1 : 0);
  report.push_back(0);
  report.resize(script_.wire_bytes, 0x5A);
  if (script_.wrong_length_reports > 0) {
    --script_.wrong_length_reports;
    report.pop_back();
  }
  return send_all(client, reply(3, sequence, 0, static_cast<std::uint32_t>(report.size()), report));
}

bool ScriptedUsbipServer::unlink(int client, const Bytes& header) {
  ++unlinks_;
  if (!script_.answer_unlink) {
    return true;
  }
  const std::uint32_t wanted = big32(header, 20);
  std::int32_t status = 0;
  for (std::uint32_t* pending : {&pending_in_, &pending_out_}) {
    if (*pending == wanted) {
      *pending = 0;
      status = -ECONNRESET;
    }
  }
  return send_all(client, reply(4, big32(header, 4), status, 0, {}));
}

}  // namespace forcegrid::driver
