// SPDX-License-Identifier: Apache-2.0
#include "view_link/frame_sender.h"

#include <fcntl.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <utility>

namespace forcegrid::view_link {
namespace {

constexpr int kPoll_ms = 100;
constexpr std::size_t kPiece = std::size_t{64} << 10;

int connect_to(const std::string& path) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  if (path.empty() || path.size() >= sizeof(address.sun_path)) {
    throw ViewLinkError("the live view's socket '" + path + "': a path has 1 to " +
                        std::to_string(sizeof(address.sun_path) - 1) + " characters");
  }
  std::copy(path.begin(), path.end(), address.sun_path);
  const int socket = ::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
  if (socket < 0 ||
      ::connect(socket, reinterpret_cast<const sockaddr*>(&address), sizeof(address)) != 0) {
    const int error = errno;
    if (socket >= 0) {
      ::close(socket);
    }
    throw ViewLinkError("the live view's socket " + path + ": " + std::strerror(error) +
                        "; is forcegrid-view running?");
  }
  return socket;
}

}  // namespace

FrameSender::FrameSender(Options options)
    : options_(std::move(options)), socket_(connect_to(options_.path)) {
  wake_ = ::eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
  if (wake_ < 0) {
    const std::string reason = std::strerror(errno);
    ::close(socket_);
    throw ViewLinkError("the live view's socket " + options_.path + ": eventfd: " + reason);
  }
  thread_ = std::thread([this] { exchange(); });
}

FrameSender::~FrameSender() {
  finish();
  ::close(socket_);
  ::close(wake_);
}

void FrameSender::push(const Frame& frame) {
  if (queue(frame, false)) {
    wake();
  }
}

void FrameSender::push_newest(const Frame& frame) {
  if (queue(frame, true)) {
    wake();
  }
}

void FrameSender::queue(const Frame& frame) { queue(frame, false); }
void FrameSender::queue_newest(const Frame& frame) { queue(frame, true); }

// False: it is dropped.
bool FrameSender::queue(const Frame& frame, bool newest) {
  if (lost_.load() || finishing_.load()) {
    return false;
  }
  Bytes bytes = bytes_of(frame);
  const std::lock_guard lock(mutex_);
  if (newest) {
    const auto same = std::find_if(waiting_.begin(), waiting_.end(), [&](const Waiting& one) {
      return one.newest && one.type == frame.type && one.object == frame.object;
    });
    if (same != waiting_.end()) {
      waiting_bytes_ -= same->bytes.size();
      waiting_.erase(same);
      dropped_.fetch_add(1);
    }
  }
  if (!waiting_.empty() && waiting_bytes_ + bytes.size() > options_.most_waiting_bytes) {
    dropped_.fetch_add(1);
    return false;
  }
  waiting_bytes_ += bytes.size();
  waiting_.push_back({frame.type, frame.object, newest, std::move(bytes)});
  return true;
}

std::size_t FrameSender::waiting_bytes() const {
  const std::lock_guard lock(mutex_);
  return waiting_bytes_;
}

void FrameSender::wake() const noexcept {
  const std::uint64_t one = 1;
  static_cast<void>(!::write(wake_, &one, sizeof(one)));  // full: it wakes anyway
}

void FrameSender::finish(double timeout_s) {
  if (!thread_.joinable()) {
    return;
  }
  finishing_.store(true);
  wake();
  const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(timeout_s);
  while (!lost_.load() && std::chrono::steady_clock::now() < end) {
    {
      const std::lock_guard lock(mutex_);
      if (waiting_bytes_ == 0) {
        break;
      }
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
  stop_now_.store(true);
  wake();
  thread_.join();
}

void FrameSender::exchange() {
  std::string why;
  try {
    exchange_until_over();
  } catch (const std::exception& error) {
    why = error.what();
  }
  if (stop_now_.load()) {
    return;
  }
  lost_.store(true);
  if (options_.on_lost) {
    options_.on_lost(why.empty() ? "it closed the connection" : why);
  }
}

// Returns when the view has closed the connection, or after stop_now_.
void FrameSender::exchange_until_over() {
  FrameReader reader(kLargestFeedPayload);
  Bytes now;  // the frames that are being sent, small ones together
  std::size_t sent = 0;
  while (!stop_now_.load()) {
    pollfd fds[2] = {{socket_, POLLIN, 0}, {wake_, POLLIN, 0}};
    if (!now.empty()) {
      fds[0].events |= POLLOUT;
    }
    if (::poll(fds, 2, kPoll_ms) < 0 && errno != EINTR) {
      throw ViewLinkError(std::string("poll: ") + std::strerror(errno));
    }
    std::uint64_t count = 0;
    static_cast<void>(!::read(wake_, &count, sizeof(count)));
    if (!receive_some(reader) || !send_some(now, sent)) {
      return;
    }
  }
}

// Sends frames until the socket takes no more. False: the view is gone.
bool FrameSender::send_some(Bytes& now, std::size_t& sent) {
  for (;;) {
    if (now.empty()) {
      const std::lock_guard lock(mutex_);
      if (waiting_.empty()) {
        return true;
      }
      now = std::move(waiting_.front().bytes);
      waiting_.pop_front();
      while (!waiting_.empty() && now.size() + waiting_.front().bytes.size() <= kPiece) {
        const Bytes& more = waiting_.front().bytes;
        now.insert(now.end(), more.begin(), more.end());
        waiting_.pop_front();
      }
      sent = 0;
    }
    const ssize_t bytes = ::send(socket_, now.data() + sent, now.size() - sent, MSG_NOSIGNAL);
    if (bytes < 0) {
      if (errno == EAGAIN || errno == EWOULDBLOCK || errno == EINTR) {
        return true;
      }
      if (errno == EPIPE || errno == ECONNRESET) {
        return false;
      }
      throw ViewLinkError(std::string("send: ") + std::strerror(errno));
    }
    sent += static_cast<std::size_t>(bytes);
    if (sent == now.size()) {
      const std::lock_guard lock(mutex_);
      waiting_bytes_ -= now.size();
      now.clear();
    }
  }
}

// False: the view is gone.
bool FrameSender::receive_some(FrameReader& reader) {
  std::uint8_t piece[kPiece];
  for (;;) {
    const ssize_t bytes = ::recv(socket_, piece, sizeof(piece), 0);
    if (bytes == 0) {
      return false;
    }
    if (bytes < 0) {
      if (errno == EAGAIN || errno == EWOULDBLOCK || errno == EINTR) {
        return true;
      }
      if (errno == ECONNRESET) {
        return false;
      }
      throw ViewLinkError(std::string("recv: ") + std::strerror(errno));
    }
    reader.add({piece, static_cast<std::size_t>(bytes)});
    while (const auto frame = reader.next()) {
      if (options_.on_frame) {
        options_.on_frame(*frame);
      }
    }
  }
}

}  // namespace forcegrid::view_link
