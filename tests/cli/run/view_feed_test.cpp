// SPDX-License-Identifier: Apache-2.0
// What a run says to the live view, and what the view's commands do, at the view's end of the
// sockets.

#include "cli/run/view_feed.h"

#include <gtest/gtest.h>
#include <poll.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <chrono>
#include <cstring>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <thread>

#include "cli/common/stop_request.h"
#include "view_link/little_endian.h"

namespace forcegrid::cli {
namespace {

using nlohmann::json;
using view_link::FeedCycle;
using view_link::FeedSample;
using view_link::FeedType;
using view_link::Frame;

constexpr int kPatience_ms = 20'000;

sockaddr_un address_of(const std::string& path) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  path.copy(address.sun_path, sizeof(address.sun_path) - 1);
  return address;
}

int bound_socket(int type, const std::string& path) {
  const int made = ::socket(AF_UNIX, type | SOCK_CLOEXEC, 0);
  const sockaddr_un address = address_of(path);
  EXPECT_EQ(::bind(made, reinterpret_cast<const sockaddr*>(&address), sizeof(address)), 0)
      << std::strerror(errno);
  return made;
}

bool readable(int socket) {
  pollfd waiting{socket, POLLIN, 0};
  return ::poll(&waiting, 1, kPatience_ms) == 1;
}

class ViewFeedTest : public testing::Test {
 public:
  ~ViewFeedTest() override {
    for (const int socket : {listening_, hand_, view_}) {
      ::close(socket);
    }
    std::filesystem::remove_all(folder_);
  }

 protected:
  ViewFeedTest() {
    std::string name = testing::TempDir() + "/viewXXXXXX";
    folder_ = ::mkdtemp(name.data());
    listening_ = bound_socket(SOCK_STREAM, folder_ + "/feed");
    EXPECT_EQ(::listen(listening_, 1), 0);
    hand_ = bound_socket(SOCK_DGRAM, folder_ + "/hand");
    workspace_.W_origin_D = {0.01, 0.02, 0.03};
    title_.version = "1.2.3";
    title_.device = "emulated:woodenhaptics_v2015";
    title_.methods = {"auto", "hold"};
    title_.candidates = {"kriging"};
    title_.emulated = true;
    title_.hand_socket = folder_ + "/hand";
  }

  ViewFeed& start() {
    feed_ = std::make_unique<ViewFeed>(folder_ + "/feed", title_, profile_, workspace_, ports_);
    view_ = ::accept(listening_, nullptr, nullptr);
    EXPECT_GE(view_, 0);
    return *feed_;
  }

  // The next frame of this type; an empty one of type 0 if none comes.
  Frame next(FeedType type) {
    for (;;) {
      while (auto frame = reader_.next()) {
        if (frame->type == static_cast<std::uint16_t>(type)) {
          return *frame;
        }
      }
      std::uint8_t piece[4096];
      const ssize_t bytes = readable(view_) ? ::recv(view_, piece, sizeof(piece), 0) : 0;
      if (bytes <= 0) {
        ADD_FAILURE() << "no frame of type " << static_cast<int>(type);
        return {};
      }
      reader_.add({piece, static_cast<std::size_t>(bytes)});
    }
  }
  json next_json(FeedType type) { return json::parse(text_of(next(type)), nullptr, false); }

  void command(const json& message) {
    const auto bytes = bytes_of(
        view_link::text_frame(static_cast<std::uint16_t>(FeedType::kCommand), message.dump()));
    ASSERT_EQ(::send(view_, bytes.data(), bytes.size(), MSG_NOSIGNAL),
              static_cast<ssize_t>(bytes.size()));
  }

  servo::Triple next_target_D_m() {
    servo::Triple target{};
    EXPECT_TRUE(readable(hand_));
    EXPECT_EQ(::recv(hand_, target.data(), sizeof(target), 0),
              static_cast<ssize_t>(sizeof(target)));
    return target;
  }

  void wait_until_paused(bool paused) const {
    const auto end = std::chrono::steady_clock::now() + std::chrono::milliseconds(kPatience_ms);
    while (ports_.force_paused.load() != paused && std::chrono::steady_clock::now() < end) {
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    ASSERT_EQ(ports_.force_paused.load(), paused);
  }

  std::string folder_;
  int listening_ = -1;
  int hand_ = -1;
  int view_ = -1;
  ViewTitle title_;
  profiles::DeviceProfile profile_ = profiles::load_device_profile("woodenhaptics_v2015");
  servo::WorkspaceMap workspace_;
  servo::ServoPorts ports_;
  view_link::FrameReader reader_{view_link::kLargestFeedPayload};
  std::unique_ptr<ViewFeed> feed_;
};

TEST_F(ViewFeedTest, BeginsWithWhatRuns) {
  start();
  const json hello = next_json(FeedType::kHello);
  EXPECT_EQ(hello["version"], "1.2.3");
  EXPECT_EQ(hello["methods"], json({"auto", "hold"}));
  EXPECT_EQ(hello["controls"], json({"stop", "pause", "method", "set", "hand"}));
  EXPECT_EQ(hello["faults"][0], "none");
  EXPECT_EQ(hello["held_back"].size(), static_cast<std::size_t>(servo::HeldBack::kPaused) + 1);
  // The profile's box lies in D; W's origin is at (10, 20, 30) mm of D.
  for (std::size_t axis = 0; axis < 3; ++axis) {
    EXPECT_NEAR(hello["workspace_W_m"]["low"][axis].get<double>(),
                profile_.limits.workspace_min_m[axis] - 0.01 * static_cast<double>(axis + 1),
                1e-12);
  }
}

TEST_F(ViewFeedTest, SendsEveryCycleAndSample) {
  ViewFeed& feed = start();
  for (std::uint64_t i = 0; i < 20; ++i) {
    servo::CycleRecord cycle;
    cycle.cycle = i;
    cycle.time_ns = static_cast<std::int64_t>(i) * 1'000'000;
    cycle.position_W_m = {0.001 * static_cast<double>(i), 0.0, -0.5};
    cycle.commanded_force_D_N = {0.0, 0.0, 2.5};
    cycle.method_force_W_N[1] = {1.0, 2.0, 3.0};
    cycle.rung = servo::Rung::kOld;
    feed.push(cycle);
  }
  feed.send();
  std::uint64_t expected = 0;
  while (expected < 20) {
    const Frame frame = next(FeedType::kCycles);
    ASSERT_GT(frame.payload.size(), 0U);
    ASSERT_EQ(frame.payload.size() % sizeof(FeedCycle), 0U);
    view_link::Reader reader(frame.payload);
    while (reader.left() > 0) {
      const auto cycle = reader.take<FeedCycle>();
      EXPECT_EQ(cycle.cycle, expected);
      EXPECT_EQ(cycle.position_W_m[0], 0.001 * static_cast<double>(expected));
      EXPECT_EQ(cycle.commanded_force_W_N[2], 2.5);
      EXPECT_EQ(cycle.method_force_W_N[1][2], 3.0);
      EXPECT_EQ(cycle.rung, 1);
      ++expected;
    }
  }
  servo::ArrivedSample arrived;
  arrived.sample.position_W = {1.0, 2.0, 3.0};
  arrived.sample.stiffness_W(0, 2) = 7.0;
  arrived.sample.has_stiffness = true;
  arrived.in_contact = true;
  feed.push(arrived);
  feed.send();
  const Frame frame = next(FeedType::kSamples);
  ASSERT_EQ(frame.payload.size(), sizeof(FeedSample));
  view_link::Reader reader(frame.payload);
  const auto sample = reader.take<FeedSample>();
  EXPECT_EQ(sample.position_W_m[1], 2.0);
  EXPECT_EQ(sample.stiffness_W_N_per_m[2], 7.0) << "row 0, column 2";
  EXPECT_EQ(sample.in_contact, 1);
}

TEST_F(ViewFeedTest, AcknowledgesAPauseOnceTheServoHasIt) {
  ViewFeed& feed = start();
  command({{"id", 7}, {"what", "pause"}, {"value", true}});
  wait_until_paused(true);
  servo::CycleRecord cycle;
  cycle.held_back = servo::HeldBack::kNot;  // one that began before
  feed.push(cycle);
  feed.note("info", "test", "between");
  cycle.held_back = servo::HeldBack::kPaused;
  feed.push(cycle);
  EXPECT_EQ(next_json(FeedType::kNote)["text"], "between") << "not acknowledged before";
  const json done = next_json(FeedType::kAcknowledged);
  EXPECT_EQ(done["id"], 7);
  EXPECT_EQ(done["what"], "pause");
  EXPECT_EQ(done["done"], true);
  command({{"id", 8}, {"what", "pause"}, {"value", false}});
  wait_until_paused(false);
}

TEST_F(ViewFeedTest, ChoosesTheRenderedMethodAmongThoseThatAreThere) {
  ViewFeed& feed = start();
  command({{"id", 6}, {"what", "method"}, {"method", 2}});
  EXPECT_EQ(next_json(FeedType::kAcknowledged)["done"], false) << "there are two";
  command({{"id", 7}, {"what", "method"}, {"method", 1}});
  const auto end = std::chrono::steady_clock::now() + std::chrono::milliseconds(kPatience_ms);
  while (ports_.rendered_method.load() != 1 && std::chrono::steady_clock::now() < end) {
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  servo::CycleRecord cycle;
  feed.push(cycle);  // one that began before
  feed.note("info", "test", "between");
  cycle.rendered_method = 1;
  feed.push(cycle);
  EXPECT_EQ(next_json(FeedType::kNote)["text"], "between") << "not acknowledged before";
  const json done = next_json(FeedType::kAcknowledged);
  EXPECT_EQ(done["id"], 7);
  EXPECT_EQ(done["done"], true);
}

TEST_F(ViewFeedTest, MovesTheHandInTheDevicesFrame) {
  start();
  command({{"id", 1}, {"what", "hand"}, {"target_W_m", {0.1, 0.2, 0.3}}});
  const servo::Triple target = next_target_D_m();
  EXPECT_NEAR(target[0], 0.11, 1e-15);
  EXPECT_NEAR(target[1], 0.22, 1e-15);
  EXPECT_NEAR(target[2], 0.33, 1e-15);
  command({{"id", 2}, {"what", "hand"}, {"target_W_m", nullptr}});
  EXPECT_TRUE(std::isnan(next_target_D_m()[0]));
}

TEST_F(ViewFeedTest, RefusesWhatItDoesNotKnow) {
  start();
  for (const json& wrong :
       {json{{"id", 3}, {"what", "limits"}, {"value", 1e9}},
        json{{"id", 3}, {"what", "pause"}, {"value", "yes"}},
        json{{"id", 3}, {"what", "hand"}, {"target_W_m", {1, 2}}}, json{{"id", 3}}}) {
    command(wrong);
    const json answer = next_json(FeedType::kAcknowledged);
    EXPECT_EQ(answer["id"], 3) << wrong;
    EXPECT_EQ(answer["done"], false) << wrong;
  }
  EXPECT_FALSE(ports_.force_paused.load());
  EXPECT_FALSE(StopRequest::emergency().pressed());
}

// The last test: the stop stays pressed in this process.
TEST_F(ViewFeedTest, StopsAndSaysSoOnceTheServoHas) {
  ViewFeed& feed = start();
  feed.push(servo::CycleRecord{});
  command({{"id", 5}, {"what", "stop"}});
  const auto end = std::chrono::steady_clock::now() + std::chrono::milliseconds(kPatience_ms);
  while (!StopRequest::emergency().pressed() && std::chrono::steady_clock::now() < end) {
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  EXPECT_EQ(StopRequest::emergency().source(), servo::EmergencySource::kView);
  EXPECT_TRUE(StopRequest::stop());
  servo::CycleRecord last;
  last.fault = servo::Fault::kEmergencyStop;
  feed.push(last);
  const json done = next_json(FeedType::kAcknowledged);
  EXPECT_EQ(done["id"], 5);
  EXPECT_EQ(done["what"], "stop");
  EXPECT_EQ(done["done"], true);
  feed.finish("emergency_stop", 3, "stopped", true);
  const json over = next_json(FeedType::kEnd);
  EXPECT_EQ(over["ended_by"], "emergency_stop");
  EXPECT_EQ(over["exit_status"], 3);
}

TEST(ViewFeed, NamesASocketThatIsNotThere) {
  servo::ServoPorts ports;
  try {
    const ViewFeed feed("/nowhere/feed", {}, profiles::load_device_profile("falcon"), {}, ports);
    FAIL();
  } catch (const view_link::ViewLinkError& error) {
    EXPECT_NE(std::string(error.what()).find("/nowhere/feed"), std::string::npos);
  }
}

}  // namespace
}  // namespace forcegrid::cli
