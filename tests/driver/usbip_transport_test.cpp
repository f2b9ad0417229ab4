// SPDX-License-Identifier: Apache-2.0
#include "driver/usbip_transport.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/socket.h>

#include <random>

#include "driver/device.h"
#include "scripted_usbip_server.h"

namespace forcegrid::driver {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;
using testing::HasSubstr;

std::unique_ptr<Transport> open(const ScriptedUsbipServer& server,
                                rt::Duration timeout = seconds(5)) {
  return open_usbip_transport(parse_device_url(server.url()), timeout);
}

/// Error text of opening; a failure of the test when it opens.
std::string error_of(Script& script, rt::Duration timeout = seconds(5)) {
  const ScriptedUsbipServer server(script);
  try {
    static_cast<void>(open(server, timeout));
  } catch (const DeviceError& error) {
    EXPECT_THAT(error.what(), HasSubstr("device '" + server.url() + "': "));
    return error.what();
  }
  ADD_FAILURE() << "opened";
  return "";
}

TEST(UsbipTransport, ImportsAndEnumeratesTheDevice) {
  Script script;
  const ScriptedUsbipServer server(script);
  const auto transport = open(server);
  EXPECT_EQ(transport->identity().vendor_id, 0x1234);
  EXPECT_EQ(transport->identity().product_id, 0x0006);
  EXPECT_EQ(transport->identity().manufacturer, "mbed.org");
  EXPECT_EQ(transport->identity().product, "HID DEVICE");
  EXPECT_EQ(transport->identity().serial, "0123456789");
  EXPECT_EQ(transport->report_descriptor(), script.report_descriptor);
  // Configuration 1 is set, and the refusal of SET_IDLE (a stall) does no harm.
  EXPECT_THAT(server.setups(), testing::Contains(Bytes{0x00, 9, 1, 0, 0, 0, 0, 0}));
  EXPECT_THAT(server.setups(), testing::Contains(Bytes{0x21, 10, 0, 0, 0, 0, 0, 0}));
  EXPECT_THAT(server.setups(), testing::Contains(Bytes{0x81, 6, 0, 0x22, 0, 0, 0x1B, 0}));
}

TEST(UsbipTransport, MovesReportsBothWays) {
  Script script;
  ScriptedUsbipServer server(script);
  server.set_counts({1000, 2000, 6500, 0, 0, 0});
  const auto transport = open(server);
  std::array<std::uint8_t, 64> buffer{};
  ReadResult result = transport->read(buffer, seconds(5));
  ASSERT_EQ(result.status, TransportStatus::kOk);
  ASSERT_EQ(result.bytes, 14U);
  EXPECT_EQ(Bytes(buffer.begin(), buffer.begin() + 6),
            (Bytes{0xE8, 0x03, 0xD0, 0x07, 0x64, 0x19}));  // the sheet's bytes
  EXPECT_EQ(transport->read(buffer, milliseconds(0)).status, TransportStatus::kTimeout);

  const Bytes out = {0xFB, 0xF8, 0xAC, 0x00, 0x4A, 0x01, 0, 0, 0, 0, 0, 0, 0, 0};
  const auto before = rt::Clock::now();
  const WriteResult written = transport->write(out, seconds(5));
  ASSERT_EQ(written.status, TransportStatus::kOk);
  EXPECT_GE(written.completed, before);
  result = transport->read(buffer, seconds(5));
  EXPECT_EQ(result.status, TransportStatus::kOk);
  EXPECT_GE(result.arrived, before);
  EXPECT_THAT(server.outs(), testing::ElementsAre(out));
}

TEST(UsbipTransport, WithdrawsThePendingReadWhenItCloses) {
  Script script;
  script.speak_first = false;
  const ScriptedUsbipServer server(script);
  open(server)->close();
  EXPECT_EQ(server.unlinks(), 1);
}

TEST(UsbipTransport, WithdrawsAReportThatTheDeviceDoesNotTake) {
  Script script;
  script.take_outs = false;
  const ScriptedUsbipServer server(script);
  const auto transport = open(server);
  const Bytes out(14);
  EXPECT_EQ(transport->write(out, milliseconds(300)).status, TransportStatus::kTimeout);
  EXPECT_EQ(server.unlinks(), 1);
  EXPECT_EQ(transport->write(out, milliseconds(300)).status, TransportStatus::kTimeout);
  EXPECT_EQ(transport->failure(), "");
}

TEST(UsbipTransport, GivesUpOnAServerThatDoesNotAnswerAWithdrawal) {
  Script script;
  script.take_outs = false;
  script.answer_unlink = false;
  const ScriptedUsbipServer server(script);
  const auto transport = open(server);
  EXPECT_EQ(transport->write(Bytes(14), milliseconds(20)).status, TransportStatus::kDisconnected);
  EXPECT_THAT(transport->failure(), HasSubstr("does not answer"));
}

TEST(UsbipTransport, SaysWhyTheServerRefusesTheDevice) {
  const std::pair<std::uint32_t, const char*> cases[] = {{1, "in use, or not exported"},
                                                         {2, "busy"},
                                                         {3, "error state"},
                                                         {4, "no such device"},
                                                         {77, "status 77"}};
  for (const auto& [status, words] : cases) {
    Script script;
    script.import_status = status;
    EXPECT_THAT(error_of(script), HasSubstr(words));
  }
}

TEST(UsbipTransport, RefusesAnotherProtocolAndAnotherDevice) {
  Script old;
  old.import_version = 0x0106;
  EXPECT_THAT(error_of(old), HasSubstr("does not speak USB/IP 1.1.1"));
  Script other;
  other.import_bus_id = "1-10";
  EXPECT_THAT(error_of(other), HasSubstr("answers with another device"));
}

TEST(UsbipTransport, DoesNotWaitForEverForASilentServer) {
  Script silent;
  silent.answer_import = false;
  EXPECT_THAT(error_of(silent, milliseconds(500)), HasSubstr("does not answer"));
  Script deaf;
  deaf.answer_control = false;
  EXPECT_THAT(error_of(deaf, milliseconds(500)), HasSubstr("does not answer a control request"));
}

TEST(UsbipTransport, SaysThatNobodyListens) {
  std::string url;
  {
    Script script;
    url = ScriptedUsbipServer(script).url();
  }
  try {
    static_cast<void>(open_usbip_transport(parse_device_url(url), seconds(5)));
    ADD_FAILURE() << "opened";
  } catch (const DeviceError& error) {
    EXPECT_THAT(error.what(), HasSubstr("connect: Connection refused; start the USB/IP server"));
  }
}

TEST(UsbipTransport, NamesAHostThatDoesNotResolve) {
  try {
    static_cast<void>(
        open_usbip_transport(parse_device_url("usbip://256.0.0.1.invalid:3240/1-1"), seconds(1)));
    ADD_FAILURE() << "opened";
  } catch (const DeviceError& error) {
    EXPECT_THAT(error.what(), HasSubstr("host '256.0.0.1.invalid': "));
  }
}

TEST(UsbipTransport, RefusesMalformedDescriptors) {
  Script device;
  device.device_descriptor.resize(17);
  EXPECT_THAT(error_of(device), HasSubstr("device descriptor is malformed"));

  Script truncated;
  truncated.configuration_descriptor.resize(30);
  EXPECT_THAT(error_of(truncated), HasSubstr("no HID interface"));

  Script zero_length;  // a descriptor of length 0 must not be walked for ever
  zero_length.configuration_descriptor[9] = 0;
  EXPECT_THAT(error_of(zero_length), HasSubstr("no HID interface"));

  Script no_hid;
  no_hid.configuration_descriptor[14] = 0xFF;
  EXPECT_THAT(error_of(no_hid), HasSubstr("no HID interface"));

  Script no_report;
  no_report.report_descriptor.clear();
  EXPECT_THAT(error_of(no_report), HasSubstr("refuses its report descriptor"));
}

struct Lie {
  const char* name;
  std::function<Bytes(std::uint32_t sequence)> bytes;
  const char* words;
};

Bytes header(std::uint32_t command, std::uint32_t sequence, std::uint32_t length) {
  Bytes bytes(48);
  for (std::size_t i = 0; i < 4; ++i) {
    bytes[i] = static_cast<std::uint8_t>(command >> (24 - 8 * i));
    bytes[4 + i] = static_cast<std::uint8_t>(sequence >> (24 - 8 * i));
    bytes[24 + i] = static_cast<std::uint8_t>(length >> (24 - 8 * i));
  }
  return bytes;
}

TEST(UsbipTransport, EndsOnAServerThatLiesWithoutCrashOrHang) {
  const Lie lies[] = {
      {"a sequence number that is not pending",
       [](std::uint32_t sequence) { return header(3, sequence + 1000, 0); }, "is not pending"},
      {"more bytes than were asked for",
       [](std::uint32_t sequence) { return header(3, sequence, 15); }, "at most 14"},
      {"4 gigabytes", [](std::uint32_t sequence) { return header(3, sequence, 0xFFFFFFFF); },
       "at most 14"},
      {"an unknown message", [](std::uint32_t sequence) { return header(9, sequence, 0); },
       "message type 9"},
      {"a withdrawal nobody asked for",
       [](std::uint32_t sequence) { return header(4, sequence, 0); },
       "a withdrawal that was not asked for"},
      {"text", [](std::uint32_t) { return Bytes(200, 'x'); }, "message type"},
  };
  for (const Lie& lie : lies) {
    SCOPED_TRACE(lie.name);
    Script script;
    script.speak_first = false;
    script.lie = lie.bytes;
    script.lie_now = true;
    const ScriptedUsbipServer server(script);
    const auto transport = open(server);
    EXPECT_EQ(transport->write(Bytes(14), seconds(5)).status, TransportStatus::kProtocol);
    EXPECT_THAT(transport->failure(), HasSubstr(lie.words));
    std::array<std::uint8_t, 64> buffer{};
    EXPECT_EQ(transport->read(buffer, seconds(5)).status, TransportStatus::kProtocol);
  }
}

TEST(UsbipTransport, SurvivesRandomBytesInPlaceOfAnAnswer) {
  for (unsigned seed = 1; seed <= 30; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    Script script;
    script.lie = [seed](std::uint32_t sequence) {
      std::mt19937 random(seed);
      Bytes bytes = header(3, sequence, 14);
      for (int edits = 0; edits < 1 + static_cast<int>(seed % 5); ++edits) {
        bytes[random() % bytes.size()] = static_cast<std::uint8_t>(random());
      }
      bytes.resize(bytes.size() + random() % 60, static_cast<std::uint8_t>(random()));
      return bytes;
    };
    script.lie_now = true;
    const ScriptedUsbipServer server(script);
    const auto transport = open(server);
    std::array<std::uint8_t, 64> buffer{};
    for (int i = 0; i < 3; ++i) {
      const auto begun = rt::Clock::now();
      static_cast<void>(transport->write(Bytes(14), milliseconds(20)));
      static_cast<void>(transport->read(buffer, milliseconds(20)));
      EXPECT_LT(rt::Clock::now() - begun, seconds(5));
    }
  }
}

TEST(UsbipTransport, NoticesThatTheServerIsGone) {
  Script script;
  script.close_after_outs = 0;
  const ScriptedUsbipServer server(script);
  const auto transport = open(server);
  EXPECT_EQ(transport->write(Bytes(14), seconds(5)).status, TransportStatus::kDisconnected);
  EXPECT_THAT(transport->failure(), HasSubstr("check the device and its server"));
  EXPECT_EQ(transport->write(Bytes(14), seconds(5)).status, TransportStatus::kDisconnected);
}

}  // namespace
}  // namespace forcegrid::driver
