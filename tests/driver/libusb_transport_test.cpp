// SPDX-License-Identifier: Apache-2.0
#include "driver/libusb_transport.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <libusb.h>

#include <thread>

#include "driver/device.h"
#include "driver/falcon_codec.h"
#include "driver/falcon_device.h"
#include "fake_libusb.h"

namespace forcegrid::driver {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;
using testing::AllOf;
using testing::HasSubstr;

class Libusb : public testing::Test {
 protected:
  void SetUp() override {
    FakeLibusb::reset();
    falcon_ = attach("FV001", {2});
  }
  // With what the transport has given up on purpose: a transfer that never ends, and its handle. To
  // LeakSanitizer they would be leaks.
  void TearDown() override { FakeLibusb::reset(); }

  static std::shared_ptr<ScriptedFalcon> attach(const std::string& serial,
                                                std::vector<std::uint8_t> ports) {
    auto falcon = std::make_shared<ScriptedFalcon>(
        ScriptedFalcon::Script{.state = ScriptedFalcon::State::kRunning});
    FakeLibusb::Device device;
    device.serial = serial;
    device.ports = std::move(ports);
    device.falcon = falcon;
    FakeLibusb::bus().devices.push_back(std::move(device));
    return falcon;
  }

  static std::unique_ptr<BulkTransport> open(const std::string& url = "falcon") {
    return open_libusb_transport(parse_device_url(url), 0x0403, 0xCB48);
  }

  static std::string error_of_open(const std::string& url = "falcon") {
    try {
      static_cast<void>(open(url));
    } catch (const DeviceError& error) {
      EXPECT_THAT(error.what(), HasSubstr("device '" + url + "': "));
      expect_all_returned();
      return error.what();
    }
    ADD_FAILURE() << "opened";
    return "";
  }

  static void expect_all_returned() {
    EXPECT_EQ(FakeLibusb::bus().contexts, 0);
    expect_all_returned_but_context();
  }

  static void expect_all_returned_but_context() {
    const FakeLibusb& bus = FakeLibusb::bus();
    EXPECT_EQ(bus.handles, 0);
    EXPECT_EQ(bus.claimed, 0);
    EXPECT_EQ(bus.freed, bus.allocated);
    EXPECT_EQ(bus.freed_in_use, 0);
  }

  std::shared_ptr<ScriptedFalcon> falcon_;
  std::array<std::uint8_t, 64> buffer_{};
};

// --- opening ---

TEST_F(Libusb, NamesTheDeviceAndDetachesKernelDrivers) {
  const auto transport = open();
  EXPECT_EQ(transport->identity().vendor_id, 0x0403);
  EXPECT_EQ(transport->identity().product, "FALCON HAPTIC");
  EXPECT_EQ(transport->identity().serial, "FV001");
  EXPECT_TRUE(FakeLibusb::bus().auto_detach);
  EXPECT_EQ(FakeLibusb::bus().claimed, 1);
}

TEST_F(Libusb, TellsOneDeviceFromTheOther) {
  attach("FV002", {3, 1});
  EXPECT_EQ(open("falcon:FV002")->identity().serial, "FV002");
  EXPECT_EQ(open("falcon:path=1-2")->identity().serial, "FV001");
  EXPECT_EQ(open("falcon:path=1-3.1")->identity().serial, "FV002");
  EXPECT_THAT(error_of_open(), AllOf(HasSubstr("2 devices fit; name one:"),
                                     HasSubstr("falcon:path=1-2   or falcon:FV001"),
                                     HasSubstr("falcon:path=1-3.1   or falcon:FV002")));
}

TEST_F(Libusb, SaysThatNoneIsAttached) {
  EXPECT_THAT(error_of_open("falcon:FV009"), HasSubstr("no such device is attached; plug it in"));
  FakeLibusb::bus().devices.front().product_id = 0x6001;
  EXPECT_THAT(error_of_open(), HasSubstr("no such device is attached"));
}

TEST_F(Libusb, SaysWhatToDoWithoutPermission) {
  FakeLibusb::bus().devices.front().open_error = LIBUSB_ERROR_ACCESS;
  EXPECT_THAT(error_of_open(), AllOf(HasSubstr("open: Access denied"), HasSubstr("install-udev")));
}

TEST_F(Libusb, SaysThatAnotherProgramUsesIt) {
  FakeLibusb::bus().devices.front().claim_error = LIBUSB_ERROR_BUSY;
  EXPECT_THAT(error_of_open(),
              AllOf(HasSubstr("claim its interface: Resource busy"), HasSubstr("other program")));
}

TEST_F(Libusb, RefusesADeviceWithoutItsInterface) {
  FakeLibusb::bus().devices.front().interface_class = 0x03;
  EXPECT_THAT(error_of_open(), HasSubstr("no vendor-specific interface with a bulk endpoint"));
}

TEST_F(Libusb, SaysThatItWasUnpluggedWhileOpening) {
  FakeLibusb::bus().submit_error = LIBUSB_ERROR_NO_DEVICE;
  EXPECT_THAT(error_of_open(), HasSubstr("no more data"));
}

// --- transfers ---

TEST_F(Libusb, AllocatesItsTransfersOnce) {
  const auto transport = open();
  const int allocated = FakeLibusb::bus().allocated;
  EXPECT_EQ(allocated, 4);
  for (int i = 0; i < 100; ++i) {
    ASSERT_EQ(transport->write(std::array<std::uint8_t, 3>{1, 2, 3}, seconds(5)).status,
              TransportStatus::kOk);
    ASSERT_EQ(transport->read(buffer_, seconds(5)).status, TransportStatus::kOk);
    ASSERT_EQ(transport->control_out({0x40, 0, 1, 0}, seconds(5)), TransportStatus::kOk);
  }
  EXPECT_EQ(FakeLibusb::bus().allocated, allocated);
  EXPECT_EQ(FakeLibusb::bus().freed, 0);
  EXPECT_EQ(FakeLibusb::bus().most_pending_in, 2);
  EXPECT_GE(FakeLibusb::bus().submitted, 300);
}

TEST_F(Libusb, KeepsTheOrderOfWhatArrives) {
  const auto transport = open();
  ASSERT_EQ(transport->control_out({0x40, 0x03, 0x0002, 0}, seconds(5)), TransportStatus::kOk);
  // 20 answers of 16 bytes, which fill several packets of 62.
  std::vector<std::uint8_t> expected;
  for (int i = 0; i < 20; ++i) {
    falcon_->set_counts({static_cast<std::int16_t>(i), 0, 0});
    std::array<std::uint8_t, 16> packet;
    packet.fill(0x41);
    packet.front() = '<';
    packet.back() = '>';
    ASSERT_TRUE(falcon_->out(packet));
    expected.push_back(static_cast<std::uint8_t>(0x41 + (i & 0xF)));
  }
  std::vector<std::uint8_t> first_digits;
  std::vector<std::uint8_t> stream;
  while (stream.size() < 320) {
    const ReadResult read = transport->read(buffer_, seconds(5));
    ASSERT_EQ(read.status, TransportStatus::kOk);
    stream.insert(stream.end(), buffer_.begin() + 2,
                  buffer_.begin() + static_cast<std::ptrdiff_t>(read.bytes));
  }
  for (std::size_t i = 0; i < 20; ++i) {
    first_digits.push_back(stream[16 * i + 1]);
  }
  EXPECT_EQ(first_digits, expected);
}

TEST_F(Libusb, WithdrawsAnOutThatIsNotTaken) {
  const auto transport = open();
  FakeLibusb::bus().takes_out = false;
  const rt::TimePoint begun = rt::Clock::now();
  EXPECT_EQ(transport->write(std::array<std::uint8_t, 1>{1}, milliseconds(20)).status,
            TransportStatus::kTimeout);
  EXPECT_GE(rt::Clock::now() - begun, milliseconds(20));
  FakeLibusb::bus().takes_out = true;
  EXPECT_EQ(transport->write(std::array<std::uint8_t, 1>{1}, seconds(5)).status,
            TransportStatus::kOk);
}

TEST_F(Libusb, DoesNotHangOnATransferThatCantBeWithdrawn) {
  auto transport = open();
  FakeLibusb::bus().takes_out = false;
  FakeLibusb::bus().cancels = false;
  EXPECT_EQ(transport->write(std::array<std::uint8_t, 1>{1}, milliseconds(5)).status,
            TransportStatus::kDisconnected);
  EXPECT_THAT(transport->failure(), HasSubstr("can't be withdrawn"));
  transport.reset();
  // What libusb still has is not freed under it.
  EXPECT_EQ(FakeLibusb::bus().freed_in_use, 0);
  EXPECT_LT(FakeLibusb::bus().freed, FakeLibusb::bus().allocated);
}

TEST_F(Libusb, TellsARefusedRequest) {
  const auto transport = open();
  FakeLibusb::bus().answers_control = false;
  EXPECT_EQ(transport->control_out({0x40, 9, 1, 0}, seconds(5)), TransportStatus::kProtocol);
  EXPECT_THAT(transport->failure(),
              AllOf(HasSubstr("refuses a control request"), HasSubstr("stalled")));
}

constexpr ControlRequest kRunBaudRate{.request_type = 0x40, .request = 3, .value = 2};

TEST_F(Libusb, StillSendsAZeroWhenOnlyTheWayBackHasFailed) {
  const auto transport = open();
  ASSERT_EQ(transport->control_out(kRunBaudRate, seconds(5)), TransportStatus::kOk);
  FakeLibusb::bus().stalls_in = true;
  ReadResult read;
  do {
    read = transport->read(buffer_, seconds(5));  // what had arrived comes first
  } while (read.status == TransportStatus::kOk);
  EXPECT_EQ(read.status, TransportStatus::kProtocol);
  ASSERT_TRUE(falcon_->packets().empty());
  // It is sent, but the transport has failed all the same.
  EXPECT_EQ(transport->write(falcon::encode({}), seconds(5)).status, TransportStatus::kProtocol);
  EXPECT_EQ(falcon_->packets().size(), 1U);
  EXPECT_THAT(transport->failure(), HasSubstr("no more data: the endpoint stalled"));
}

TEST_F(Libusb, SendsNothingMoreWhenTheWayThereHasFailed) {
  const auto transport = open();
  ASSERT_EQ(transport->control_out(kRunBaudRate, seconds(5)), TransportStatus::kOk);
  FakeLibusb::bus().stalls_out = true;
  EXPECT_EQ(transport->write(falcon::encode({}), seconds(5)).status, TransportStatus::kProtocol);
  FakeLibusb::bus().stalls_out = false;
  EXPECT_EQ(transport->write(falcon::encode({}), seconds(5)).status, TransportStatus::kProtocol);
  EXPECT_TRUE(falcon_->packets().empty());
}

TEST_F(Libusb, TellsAnUnplug) {
  const auto transport = open();
  falcon_->unplug();
  ReadResult read;
  do {
    read = transport->read(buffer_, seconds(5));  // what had arrived comes first
  } while (read.status == TransportStatus::kOk);
  EXPECT_EQ(read.status, TransportStatus::kDisconnected);
  EXPECT_THAT(transport->failure(), AllOf(HasSubstr("unplugged"), HasSubstr("plug it in again")));
  EXPECT_EQ(transport->write(std::array<std::uint8_t, 1>{1}, seconds(5)).status,
            TransportStatus::kDisconnected);
}

TEST_F(Libusb, TellsAFailureOfTheEventLoop) {
  const auto transport = open();
  FakeLibusb::bus().events_error = LIBUSB_ERROR_OTHER;
  EXPECT_EQ(transport->read(buffer_, seconds(5)).status, TransportStatus::kDisconnected);
  FakeLibusb::bus().events_error = 0;
}

TEST_F(Libusb, RefusesAPacketThatIsTooLong) {
  const auto transport = open();
  EXPECT_EQ(transport->write(std::array<std::uint8_t, 65>{}, seconds(5)).status,
            TransportStatus::kProtocol);
}

TEST_F(Libusb, WaitsNoLongerThanItIsTold) {
  const auto transport = open();
  ASSERT_EQ(transport->read(buffer_, seconds(5)).status, TransportStatus::kOk);
  FakeLibusb::bus().takes_out = false;
  EXPECT_EQ(transport->write(std::array<std::uint8_t, 1>{1}, rt::Duration::zero()).status,
            TransportStatus::kTimeout);
  EXPECT_EQ(transport->write(std::array<std::uint8_t, 1>{1}, seconds(-1)).status,
            TransportStatus::kTimeout);
}

// --- closing ---

TEST_F(Libusb, CancelsWhatIsPendingAndReturnsEverythingWhenItIsClosed) {
  auto transport = open();
  transport->close();
  expect_all_returned_but_context();
  EXPECT_EQ(transport->read(buffer_, seconds(5)).status, TransportStatus::kDisconnected);
  EXPECT_THAT(transport->failure(), HasSubstr("closed; open it again"));
  transport->close();
  transport.reset();
  expect_all_returned();
}

// --- the whole device over it ---

TEST_F(Libusb, CarriesTheFalconsStartUpAndExchange) {
  FakeLibusb::bus().devices.clear();
  FakeLibusb::Device device;
  device.falcon = falcon_ = std::make_shared<ScriptedFalcon>(ScriptedFalcon::Script{});
  FakeLibusb::bus().devices.push_back(std::move(device));
  OpenOptions options;
  options.realtime_io = false;
  options.stale_after = options.servo_silence = seconds(10);
  options.connect_timeout = options.open_timeout = seconds(10);
  options.firmware = falcon::synthetic_firmware();
  const auto opened = open_device("falcon", profiles::load_device_profile("falcon"), options);
  EXPECT_EQ(falcon_->image(), options.firmware.bytes);
  falcon_->set_homed(0b111);
  const rt::TimePoint deadline = rt::Clock::now() + seconds(10);
  while (opened->newest_report().homed != 0b111 && rt::Clock::now() < deadline) {
    std::this_thread::sleep_for(milliseconds(1));
  }
  opened->command({.joint_torque_Nm = {0.1, 0.2, -0.3}});
  while (falcon_->last_command() != std::array<int, 3>{-1000, -2000, 3000} &&
         rt::Clock::now() < deadline) {
    std::this_thread::sleep_for(milliseconds(1));
  }
  EXPECT_EQ(falcon_->last_command(), (std::array<int, 3>{-1000, -2000, 3000}));
  EXPECT_TRUE(opened->stop());
  EXPECT_EQ(falcon_->last_command(), (std::array<int, 3>{}));
}

TEST_F(Libusb, IsNotTakenForADeviceOfAnotherProfile) {
  EXPECT_THROW(static_cast<void>(
                   open_device("falcon", profiles::load_device_profile("woodenhaptics_v2015"))),
               DeviceError);
  EXPECT_THROW(
      static_cast<void>(open_device("hid:0403:cb48", profiles::load_device_profile("falcon"))),
      DeviceError);
}

}  // namespace
}  // namespace forcegrid::driver
