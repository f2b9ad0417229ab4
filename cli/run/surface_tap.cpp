// SPDX-License-Identifier: Apache-2.0
#include "cli/run/surface_tap.h"

#include <fcntl.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <stdexcept>
#include <utility>
#include <vector>

#include "log/log.h"
#include "rt/clock.h"
#include "rt/thread.h"
#include "view_link/inside_messages.h"
#include "view_link/little_endian.h"
#include "view_link/surface_messages.h"

namespace forcegrid::cli {
namespace {

using view_link::Frame;
using view_link::InsideType;
using view_link::SurfaceType;
using view_link::ViewLinkError;

constexpr std::size_t kMostSimulators = 4;
constexpr std::size_t kPiece = std::size_t{256} << 10;
constexpr std::uint16_t kMostObjects = 4;

[[noreturn]] void fail(const std::string& what) {
  throw std::runtime_error("--record-surface: " + what + ": " + std::strerror(errno));
}

int listen_at(const std::string& path) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  if (path.size() >= sizeof(address.sun_path)) {
    throw std::runtime_error("--record-surface: the socket's path " + path +
                             " is too long; name a shorter folder in TMPDIR");
  }
  std::copy(path.begin(), path.end(), address.sun_path);
  const int listener = ::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
  if (listener < 0 ||
      ::bind(listener, reinterpret_cast<const sockaddr*>(&address), sizeof(address)) != 0 ||
      ::listen(listener, static_cast<int>(kMostSimulators)) != 0) {
    const int error = errno;
    if (listener >= 0) {
      ::close(listener);
    }
    errno = error;
    fail("the socket " + path);
  }
  return listener;
}

}  // namespace

// A simulator that has connected.
struct SurfaceTap::Simulator {
  explicit Simulator(int connected)
      : descriptor(connected), reader(view_link::kLargestSurfacePayload) {}
  ~Simulator() {
    to_view.reset();  // its thread writes to the descriptor
    ::close(descriptor);
  }
  Simulator(const Simulator&) = delete;
  Simulator& operator=(const Simulator&) = delete;

  // What the view wishes. A simulator that does not read loses it, and nothing else.
  void pass_back(const Frame& frame) const {
    const view_link::Bytes bytes = view_link::bytes_of(frame);
    static_cast<void>(::send(descriptor, bytes.data(), bytes.size(), MSG_NOSIGNAL | MSG_DONTWAIT));
  }

  int descriptor;
  view_link::FrameReader reader;
  std::unique_ptr<view_link::FrameSender> to_view;
};

SurfaceTap::SurfaceTap(std::string view_socket)
    : view_socket_(std::move(view_socket)),
      folder_((std::filesystem::temp_directory_path() / "forcegrid-surface-XXXXXX").string()) {
  if (::mkdtemp(folder_.data()) == nullptr) {
    fail("a folder in " + std::filesystem::temp_directory_path().string());
  }
  path_ = folder_ + "/surface";
  try {
    listener_ = listen_at(path_);
    wake_ = ::eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
    if (wake_ < 0) {
      fail("eventfd");
    }
  } catch (...) {
    ::close(listener_);
    std::error_code ignored;
    std::filesystem::remove_all(folder_, ignored);
    throw;
  }
  thread_ = std::thread([this] {
    rt::name_current_thread("surface");
    serve();
  });
}

SurfaceTap::~SurfaceTap() {
  over_.store(true);
  const std::uint64_t one = 1;
  static_cast<void>(!::write(wake_, &one, sizeof(one)));
  thread_.join();
  simulators_.clear();
  ::close(listener_);
  ::close(wake_);
  std::error_code ignored;
  std::filesystem::remove_all(folder_, ignored);
}

void SurfaceTap::record(tools::Recorder* recorder) {
  const std::lock_guard lock(mutex_);
  recorder_ = recorder;
  if (recorder_ != nullptr) {
    for (const auto& [object, shape] : shapes_) {
      recorder_->push(shape);
    }
  }
}

void SurfaceTap::serve() {
  std::vector<std::uint8_t> piece(kPiece);
  while (!over_.load()) {
    std::vector<pollfd> waiting{{wake_, POLLIN, 0}, {listener_, POLLIN, 0}};
    for (const auto& [descriptor, simulator] : simulators_) {
      waiting.push_back({descriptor, POLLIN, 0});
    }
    if (::poll(waiting.data(), waiting.size(), -1) < 0 && errno != EINTR) {
      log::error("surface", std::string("poll: ") + std::strerror(errno) +
                                "; the surface is not recorded any more");
      return;
    }
    if (waiting[1].revents != 0) {
      accept();
    }
    for (std::size_t i = 2; i < waiting.size(); ++i) {
      if (waiting[i].revents == 0) {
        continue;
      }
      const auto found = simulators_.find(waiting[i].fd);
      try {
        const ssize_t bytes = ::recv(found->first, piece.data(), piece.size(), 0);
        if (bytes == 0 || (bytes < 0 && errno != EAGAIN && errno != EINTR)) {
          simulators_.erase(found);
          continue;
        }
        found->second->reader.add(
            {piece.data(), static_cast<std::size_t>(std::max<ssize_t>(bytes, 0))});
        while (const auto frame = found->second->reader.next()) {
          take(*found->second, *frame);
        }
      } catch (const ViewLinkError& error) {
        log::warn("surface", std::string("a simulator was disconnected: ") + error.what());
        simulators_.erase(found);
      }
    }
  }
}

void SurfaceTap::accept() {
  const int descriptor = ::accept4(listener_, nullptr, nullptr, SOCK_CLOEXEC | SOCK_NONBLOCK);
  if (descriptor < 0) {
    return;
  }
  auto simulator = std::make_unique<Simulator>(descriptor);
  if (simulators_.size() >= kMostSimulators) {
    log::warn("surface", "refused one more simulator; at most 4 at a time");
    return;
  }
  if (!view_socket_.empty()) {
    try {
      view_link::FrameSender::Options options;
      options.path = view_socket_;
      options.on_frame = [to = simulator.get()](const Frame& frame) { to->pass_back(frame); };
      simulator->to_view = std::make_unique<view_link::FrameSender>(std::move(options));
    } catch (const ViewLinkError& error) {
      log::warn("surface", error.what());
    }
  }
  simulators_.emplace(descriptor, std::move(simulator));
}

void SurfaceTap::take(Simulator& simulator, const Frame& frame) {
  const std::int64_t now_ns = rt::Clock::now().time_since_epoch().count();
  if (frame.object >= kMostObjects) {
    throw ViewLinkError("object " + std::to_string(frame.object) + "; there are 0 to 3");
  }
  pass_on(simulator, frame);
  switch (frame.type) {
    case static_cast<std::uint16_t>(SurfaceType::kShape):
      return take_shape(frame, now_ns);
    case static_cast<std::uint16_t>(SurfaceType::kFrame):
      return take_frame(frame, now_ns);
    case static_cast<std::uint16_t>(InsideType::kLines):
    case static_cast<std::uint16_t>(InsideType::kFrame):
      return;  // the view checks them; a recording has the surface alone
    default:
      throw ViewLinkError("a frame of unknown type " + std::to_string(frame.type));
  }
}

void SurfaceTap::pass_on(Simulator& simulator, const Frame& frame) {
  if (simulator.to_view) {
    const bool is_newest = frame.type == static_cast<std::uint16_t>(SurfaceType::kFrame) ||
                           frame.type == static_cast<std::uint16_t>(InsideType::kFrame);
    is_newest ? simulator.to_view->push_newest(frame) : simulator.to_view->push(frame);
  }
}

void SurfaceTap::take_shape(const Frame& frame, std::int64_t now_ns) {
  const auto decoded = view_link::decode_shape(frame.payload);
  if (!decoded) {
    throw ViewLinkError("its shape of " + std::to_string(frame.payload.size()) +
                        " bytes is truncated, too large or not finite");
  }
  tools::RecordedShape shape{now_ns, frame.object, decoded->epoch, decoded->rest_W_m,
                             decoded->triangle};
  const std::lock_guard lock(mutex_);
  if (recorder_ != nullptr) {
    recorder_->push(shape);
  }
  shapes_[frame.object] = std::move(shape);
}

void SurfaceTap::take_frame(const Frame& frame, std::int64_t now_ns) {
  if (!view_link::decode_frame(frame.payload)) {
    throw ViewLinkError("its surface of " + std::to_string(frame.payload.size()) +
                        " bytes is truncated, too large or not finite");
  }
  view_link::Reader reader(frame.payload);
  tools::RecordedFrame kept;
  kept.arrived_ns = now_ns;
  kept.object = frame.object;
  kept.epoch = reader.take<std::uint32_t>();
  const auto vertices = reader.take<std::uint32_t>();
  reader.take<std::uint32_t>();
  kept.simulator_s = reader.take<double>();
  kept.low_W_m = reader.take<std::array<float, 3>>();
  kept.step_m = reader.take<std::array<float, 3>>();
  kept.value.resize(vertices);
  reader.take_into(std::span<std::array<std::uint16_t, 3>>(kept.value));
  const std::lock_guard lock(mutex_);
  const auto shape = shapes_.find(frame.object);
  if (shape == shapes_.end()) {
    throw ViewLinkError("a surface of object " + std::to_string(frame.object) +
                        " before its shape");
  }
  if (shape->second.epoch != kept.epoch) {
    return;
  }
  if (shape->second.rest_W_m.size() != kept.value.size()) {
    throw ViewLinkError("its surface has " + std::to_string(kept.value.size()) +
                        " vertices, its shape " + std::to_string(shape->second.rest_W_m.size()));
  }
  if (recorder_ != nullptr) {
    recorder_->push(std::move(kept));
  }
}

}  // namespace forcegrid::cli
