// SPDX-License-Identifier: Apache-2.0
#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <linux/hidraw.h>
#include <poll.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <filesystem>
#include <numeric>
#include <vector>

#include "tests/hil/hil_bench.h"
#include "tests/hil/open_node.h"

namespace forcegrid::hil {
namespace {

using ::testing::HasSubstr;
namespace fs = std::filesystem;

TEST(Enumeration, TheKernelReadsTheDeviceAsItsSheetHasIt) {
  const Bench bench;
  const ShellResult usb = shell("lsusb -d 1234:0006");
  EXPECT_EQ(usb.status, 0);
  EXPECT_THAT(usb.text, HasSubstr("ID 1234:0006"));
  const ShellResult all = shell("lsusb -v -d 1234:0006");
  for (const char* fact :
       {"bcdUSB               2.00", "bMaxPacketSize0        64", "1 mbed.org", "2 HID DEVICE",
        "3 0123456789", "wTotalLength       0x0029", "Self Powered", "bcdHID               1.11",
        "wDescriptorLength      27", "bEndpointAddress     0x81  EP 1 IN",
        "bEndpointAddress     0x01  EP 1 OUT", "bInterval               1"}) {
    EXPECT_THAT(all.text, HasSubstr(fact));
  }
  const fs::path interface =
      "/sys/bus/usb/devices/" + bench.node().port + "/" + bench.node().port + ":1.0";
  EXPECT_EQ(fs::read_symlink(interface / "driver").filename(), "usbhid");
}

TEST(LongEnumeration, TheReportDescriptorThroughTheKernelIsTheSheets) {
  const Bench bench;
  const OpenNode node(bench.node().dev());
  hidraw_report_descriptor descriptor{};
  int size = 0;
  ASSERT_EQ(::ioctl(node.get(), HIDIOCGRDESCSIZE, &size), 0);
  descriptor.size = static_cast<unsigned>(size);
  ASSERT_EQ(::ioctl(node.get(), HIDIOCGRDESC, &descriptor), 0);
  const std::vector<unsigned> sheet = {0x06, 0xAB, 0xFF, 0x0A, 0x00, 0x02, 0xA1, 0x01, 0x75,
                                       0x08, 0x15, 0x00, 0x25, 0xFF, 0x95, 0x0E, 0x09, 0x01,
                                       0x81, 0x02, 0x95, 0x0E, 0x09, 0x02, 0x91, 0x02, 0xC0};
  EXPECT_EQ(std::vector<unsigned>(descriptor.value, descriptor.value + size), sheet);
}

// The firmware's ping-pong with nothing between it and the kernel: how long the wire takes.
TEST(Enumeration, EachReportWrittenToHidrawBringsOneBack) {
  const Bench bench;
  const OpenNode node(bench.node().dev());
  const auto wait = [&](int ms) {
    pollfd entry{.fd = node.get(), .events = POLLIN, .revents = 0};
    return ::poll(&entry, 1, ms) == 1;
  };
  std::array<unsigned char, 15> zero{};  // the report ID slot, then 14 bytes
  std::array<unsigned char, 64> report{};
  // usbhid throws away what comes within 50 ms after the open, the pending report with it.
  EXPECT_FALSE(wait(200));
  constexpr int kTrips = 1000;
  std::vector<double> trips_us;
  for (int i = 0; i < kTrips; ++i) {
    const auto begun = std::chrono::steady_clock::now();
    ASSERT_EQ(::write(node.get(), zero.data(), zero.size()), 15) << std::strerror(errno);
    ASSERT_TRUE(wait(2000)) << "no report after write " << i;
    ASSERT_EQ(::read(node.get(), report.data(), report.size()), 14);
    trips_us.push_back(
        std::chrono::duration<double, std::micro>(std::chrono::steady_clock::now() - begun)
            .count());
  }
  EXPECT_FALSE(wait(50)) << "a report came that nothing was written for";
  std::sort(trips_us.begin(), trips_us.end());
  measured("round_trip_mean", std::accumulate(trips_us.begin(), trips_us.end(), 0.0) / kTrips,
           "us");
  measured("round_trip_p50", trips_us[kTrips / 2], "us");
  measured("round_trip_p99", trips_us[kTrips * 99 / 100], "us");
  measured("round_trip_max", trips_us.back(), "us");
}

}  // namespace
}  // namespace forcegrid::hil
