// SPDX-License-Identifier: Apache-2.0
#include "view_link/frame_sender.h"

#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <functional>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

namespace forcegrid::view_link {
namespace {

// The view's end: a listening socket, and the connection that it takes.
class Listener {
 public:
  Listener() {
    std::string name = "/tmp/view-link-test-XXXXXX";
    EXPECT_NE(::mkdtemp(name.data()), nullptr);
    folder_ = name;
    listener_ = ::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    std::strncpy(address.sun_path, path().c_str(), sizeof(address.sun_path) - 1);
    EXPECT_EQ(::bind(listener_, reinterpret_cast<sockaddr*>(&address), sizeof(address)), 0);
    EXPECT_EQ(::listen(listener_, 1), 0);
  }
  ~Listener() {
    close();
    ::close(listener_);
    std::filesystem::remove_all(folder_);
  }
  Listener(const Listener&) = delete;
  Listener& operator=(const Listener&) = delete;

  std::string path() const { return folder_ + "/view"; }

  void accept() {
    connection_ = ::accept(listener_, nullptr, nullptr);
    ASSERT_GE(connection_, 0);
    const timeval limit{10, 0};
    ::setsockopt(connection_, SOL_SOCKET, SO_RCVTIMEO, &limit, sizeof(limit));
  }
  void close() {
    if (connection_ >= 0) {
      ::close(connection_);
      connection_ = -1;
    }
  }
  void send(const Frame& frame) const {
    const Bytes bytes = bytes_of(frame);
    ASSERT_EQ(::send(connection_, bytes.data(), bytes.size(), MSG_NOSIGNAL),
              static_cast<ssize_t>(bytes.size()));
  }
  // The next frame; nothing at the end of the stream.
  std::optional<Frame> receive() {
    for (;;) {
      if (auto frame = reader_.next()) {
        return frame;
      }
      std::uint8_t piece[65536];
      const ssize_t bytes = ::recv(connection_, piece, sizeof(piece), 0);
      if (bytes <= 0) {
        return std::nullopt;
      }
      reader_.add({piece, static_cast<std::size_t>(bytes)});
    }
  }

 private:
  std::string folder_;
  int listener_ = -1;
  int connection_ = -1;
  FrameReader reader_{kLargestSurfacePayload};
};

void wait_until(const std::function<bool()>& condition) {
  const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(10);
  while (!condition() && std::chrono::steady_clock::now() < end) {
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
}

Frame numbered(std::uint16_t type, std::uint32_t number, std::size_t bytes) {
  Frame frame{type, 0, Bytes(bytes, 0)};
  std::memcpy(frame.payload.data(), &number, sizeof(number));
  return frame;
}

std::uint32_t number_of(const Frame& frame) {
  std::uint32_t number = 0;
  std::memcpy(&number, frame.payload.data(), sizeof(number));
  return number;
}

TEST(FrameSender, SendsQueuedFramesInOrder) {
  Listener view;
  FrameSender sender({.path = view.path(), .on_frame = {}, .on_lost = {}});
  view.accept();
  sender.queue(numbered(2, 0, 100));
  sender.queue_newest(numbered(3, 1, 100));
  sender.queue(numbered(2, 2, 200'000));  // larger than what goes in one piece
  sender.queue(numbered(2, 3, 100));
  sender.send();
  for (std::uint32_t i = 0; i < 4; ++i) {
    const auto frame = view.receive();
    ASSERT_TRUE(frame);
    EXPECT_EQ(number_of(*frame), i);
    EXPECT_EQ(frame->payload.size(), i == 2 ? 200'000U : 100U);
  }
  wait_until([&] { return sender.waiting_bytes() == 0; });
  EXPECT_EQ(sender.waiting_bytes(), 0U) << "frames that went together are all counted off";
  EXPECT_EQ(sender.dropped(), 0U);
}

TEST(FrameSender, SendsInOrder) {
  Listener view;
  FrameSender sender({.path = view.path(), .on_frame = {}, .on_lost = {}});
  view.accept();
  constexpr std::uint32_t kFrames = 1000;
  for (std::uint32_t i = 0; i < kFrames; ++i) {
    sender.push(numbered(2, i, 100));
  }
  for (std::uint32_t i = 0; i < kFrames; ++i) {
    const auto frame = view.receive();
    ASSERT_TRUE(frame);
    EXPECT_EQ(number_of(*frame), i);
  }
  EXPECT_EQ(sender.dropped(), 0U);
}

TEST(FrameSender, NamesThePathThatNobodyListensAt) {
  try {
    FrameSender sender({.path = "/tmp/no-such-folder/view", .on_frame = {}, .on_lost = {}});
    FAIL() << "it connects";
  } catch (const ViewLinkError& error) {
    EXPECT_NE(std::string(error.what()).find("/tmp/no-such-folder/view"), std::string::npos)
        << error.what();
  }
}

// A view that does not read: what does not fit is dropped, what was taken comes once it reads.
TEST(FrameSender, DropsWhatDoesNotFit) {
  Listener view;
  constexpr std::uint32_t kFrames = 2000;
  std::uint64_t dropped = 0;
  std::thread reading;
  std::vector<std::uint32_t> taken;
  {
    FrameSender sender(
        {.path = view.path(), .most_waiting_bytes = 100'000, .on_frame = {}, .on_lost = {}});
    view.accept();
    for (std::uint32_t i = 0; i < kFrames; ++i) {
      sender.push(numbered(2, i, 10'000));  // 20 MB, more than any socket's buffer
    }
    dropped = sender.dropped();
    EXPECT_GT(dropped, kFrames / 2);
    reading = std::thread([&] {
      while (const auto frame = view.receive()) {
        taken.push_back(number_of(*frame));
      }
    });
    sender.finish(10.0);
  }
  reading.join();
  EXPECT_EQ(taken.size() + dropped, kFrames);
  EXPECT_TRUE(std::is_sorted(taken.begin(), taken.end()));
}

TEST(FrameSender, ReplacesWhatWaitsByTheNewest) {
  Listener view;
  FrameSender sender({.path = view.path(),
                      .most_waiting_bytes = std::size_t{64} << 20,
                      .on_frame = {},
                      .on_lost = {}});
  view.accept();
  // More than the socket's buffers take: from here on everything waits.
  sender.push(numbered(9, 0, std::size_t{16} << 20));
  for (std::uint32_t i = 1; i <= 50; ++i) {
    Frame surface = numbered(3, i, 1000);
    surface.object = static_cast<std::uint16_t>(i % 2);
    sender.push_newest(surface);
  }
  sender.push(numbered(2, 51, 1000));
  EXPECT_EQ(sender.dropped(), 48U);
  std::vector<std::uint32_t> numbers;
  for (int i = 0; i < 4; ++i) {
    const auto frame = view.receive();
    ASSERT_TRUE(frame);
    numbers.push_back(number_of(*frame));
  }
  EXPECT_EQ(numbers, (std::vector<std::uint32_t>{0, 49, 50, 51}));
}

TEST(FrameSender, SaysThatTheViewHasGone) {
  Listener view;
  std::atomic<int> said{0};
  FrameSender sender({.path = view.path(), .on_frame = {}, .on_lost = [&](const std::string& why) {
                        EXPECT_FALSE(why.empty());
                        ++said;
                      }});
  view.accept();
  view.close();
  wait_until([&] { return said.load() > 0; });
  EXPECT_EQ(said.load(), 1);
  EXPECT_TRUE(sender.lost());
  sender.push(numbered(2, 1, 100));  // costs nothing and does no harm
  sender.finish(10.0);
  EXPECT_EQ(said.load(), 1);
}

TEST(FrameSender, TakesTheViewsFrames) {
  Listener view;
  std::mutex mutex;
  std::vector<std::string> taken;
  FrameSender sender({.path = view.path(),
                      .on_frame =
                          [&](const Frame& frame) {
                            const std::lock_guard lock(mutex);
                            taken.push_back(text_of(frame));
                          },
                      .on_lost = {}});
  view.accept();
  view.send(text_frame(16, "stop"));
  view.send(text_frame(16, "pause"));
  wait_until([&] {
    const std::lock_guard lock(mutex);
    return taken.size() == 2;
  });
  const std::lock_guard lock(mutex);
  EXPECT_EQ(taken, (std::vector<std::string>{"stop", "pause"}));
}

TEST(FrameSender, GivesUpAViewThatSendsAFrameThatIsTooLarge) {
  Listener view;
  std::mutex mutex;
  std::string reason;
  FrameSender sender({.path = view.path(), .on_frame = {}, .on_lost = [&](const std::string& why) {
                        const std::lock_guard lock(mutex);
                        reason = why;
                      }});
  view.accept();
  view.send({16, 0, Bytes(kLargestFeedPayload + 1, 0)});
  wait_until([&] { return sender.lost(); });
  sender.finish(10.0);
  const std::lock_guard lock(mutex);
  EXPECT_NE(reason.find("65537"), std::string::npos) << reason;
}

TEST(FrameSender, SendsTheRestWhenItFinishes) {
  Listener view;
  FrameSender sender({.path = view.path(), .on_frame = {}, .on_lost = {}});
  view.accept();
  for (std::uint32_t i = 0; i < 20; ++i) {
    sender.push(numbered(2, i, 1000));
  }
  sender.finish(10.0);
  sender.finish(10.0);
  for (std::uint32_t i = 0; i < 20; ++i) {
    const auto frame = view.receive();
    ASSERT_TRUE(frame) << i;
    EXPECT_EQ(number_of(*frame), i);
  }
}

TEST(FrameSender, FinishesAlthoughTheViewDoesNotRead) {
  Listener view;
  FrameSender sender({.path = view.path(), .on_frame = {}, .on_lost = {}});
  view.accept();
  sender.push(numbered(2, 1, std::size_t{16} << 20));
  sender.finish(0.05);
  EXPECT_FALSE(sender.lost());
}

}  // namespace
}  // namespace forcegrid::view_link
