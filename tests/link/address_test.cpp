// SPDX-License-Identifier: Apache-2.0
#include "link/address.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace forcegrid::link {
namespace {

std::string refusal(std::string_view text, PortZero port_zero = PortZero::kAllowed) {
  try {
    return "accepted as " + to_string(parse_address(text, port_zero));
  } catch (const LinkError& error) {
    return error.what();
  }
}

TEST(ParseAddress, ReadsLoopbackAddresses) {
  const Address ipv4 = parse_address("127.0.0.1:24870", PortZero::kRefused);
  EXPECT_FALSE(ipv4.is_ipv6);
  EXPECT_EQ(ipv4.bytes, (std::array<std::uint8_t, 16>{127, 0, 0, 1}));
  EXPECT_EQ(ipv4.port, 24870);
  EXPECT_EQ(parse_address("localhost:24870", PortZero::kRefused), ipv4);
  EXPECT_EQ(parse_address("127.3.2.1:1", PortZero::kRefused).bytes,
            (std::array<std::uint8_t, 16>{127, 3, 2, 1}));
  const Address ipv6 = parse_address("[::1]:65535", PortZero::kRefused);
  EXPECT_TRUE(ipv6.is_ipv6);
  EXPECT_EQ(ipv6.bytes[15], 1);
  EXPECT_EQ(ipv6.port, 65535);
}

TEST(ParseAddress, ReadsWhatToStringWrites) {
  for (const char* text : {"127.0.0.1:24870", "[::1]:1", "127.255.0.1:0"}) {
    EXPECT_EQ(to_string(parse_address(text, PortZero::kAllowed)), text);
  }
}

TEST(ParseAddress, RefusesAddressesBeyondLoopbackAndSaysWhy) {
  for (const char* text :
       {"0.0.0.0:24870", "192.168.1.2:24870", "8.8.8.8:1", "128.0.0.1:1", "[::]:24870",
        "[fe80::1]:1", "[::ffff:127.0.0.1]:1", "[2001:db8::1]:1"}) {
    const std::string message = refusal(text);
    EXPECT_THAT(message, testing::HasSubstr(text));
    EXPECT_THAT(message, testing::HasSubstr("not a loopback address")) << text;
    EXPECT_THAT(message, testing::HasSubstr("could move the motors")) << text;
    EXPECT_THAT(message, testing::HasSubstr("needs a key")) << text;
    EXPECT_THAT(message, testing::HasSubstr("use 127.0.0.1:PORT")) << text;
  }
}

std::string far_refusal(std::string_view text, PortZero port_zero) {
  try {
    return "accepted as " + to_string(parse_address(text, port_zero, Reach::kNetwork));
  } catch (const LinkError& error) {
    return error.what();
  }
}

TEST(ParseAddress, ReadsAddressesOfOtherMachinesForALinkWithAKey) {
  for (const char* text :
       {"192.168.1.2:24870", "8.8.8.8:1", "[2001:db8::1]:1", "[fd00::7]:1", "127.0.0.1:1"}) {
    EXPECT_EQ(to_string(parse_address(text, PortZero::kRefused, Reach::kNetwork)), text);
  }
}

TEST(ParseAddress, TakesEveryAddressOfThisMachineForListeningOnly) {
  for (const char* text : {"0.0.0.0:24870", "[::]:24870"}) {
    EXPECT_THAT(far_refusal(text, PortZero::kAllowed), testing::HasSubstr("accepted"));
    EXPECT_THAT(far_refusal(text, PortZero::kRefused), testing::HasSubstr("only for listening"));
  }
}

TEST(ParseAddress, RefusesAddressesOfNoOneMachine) {
  for (const char* text : {"224.0.0.1:1", "255.255.255.255:1", "[ff02::1]:1"}) {
    EXPECT_THAT(far_refusal(text, PortZero::kAllowed), testing::HasSubstr("multicast")) << text;
  }
  EXPECT_THAT(far_refusal("[::ffff:10.0.0.1]:1", PortZero::kAllowed),
              testing::HasSubstr("write it as A.B.C.D:PORT"));
  EXPECT_THAT(far_refusal("[fe80::1]:1", PortZero::kAllowed), testing::HasSubstr("link-local"));
}

bool contains(const char* range, const char* host) {
  return AddressRange(range).contains(
      parse_address(std::string(host) + ":1", PortZero::kAllowed, Reach::kNetwork));
}

TEST(AddressRange, ContainsTheAddressesThatShareItsFirstBits) {
  EXPECT_TRUE(contains("192.168.1.7", "192.168.1.7"));
  EXPECT_FALSE(contains("192.168.1.7", "192.168.1.6"));
  EXPECT_TRUE(contains("192.168.1.0/24", "192.168.1.255"));
  EXPECT_FALSE(contains("192.168.1.0/24", "192.168.2.0"));
  EXPECT_TRUE(contains("10.0.0.128/25", "10.0.0.200"));
  EXPECT_FALSE(contains("10.0.0.128/25", "10.0.0.127"));
  EXPECT_TRUE(contains("0.0.0.0/0", "8.8.8.8"));
  EXPECT_FALSE(contains("0.0.0.0/0", "[::1]"));
  EXPECT_TRUE(contains("2001:db8::/32", "[2001:db8:1::1]"));
  EXPECT_FALSE(contains("2001:db8::/32", "[2001:db9::1]"));
}

TEST(AddressRange, RefusesWhatIsNone) {
  for (const char* text :
       {"", "example.org", "192.168.1", "192.168.1.0/33", "::/129", "192.168.1.0/",
        "192.168.1.0/-1", "192.168.1.0/2x", "192.168.1.0/ 8", "192.168.1.7/24", "[::1]"}) {
    EXPECT_THROW(AddressRange{text}, LinkError) << text;
  }
}

TEST(ParseAddress, RefusesNamesAndMalformedAddresses) {
  for (const char* text :
       {"example.org:1", "LOCALHOST:1", "127.1:1", "127.0.0.256:1", "127.0.0.1 :1", ":1", "[]:1",
        "[127.0.0.1]:1", "0x7f.0.0.1:1", "127.0.0.01:1", "[::1%lo]:1"}) {
    EXPECT_THAT(refusal(text), testing::HasSubstr("not a numeric IP address")) << text;
  }
  EXPECT_THAT(refusal(std::string_view("127.0.0.1\0.5:1", 14)),
              testing::HasSubstr("not a numeric IP address"));
  EXPECT_THAT(refusal("127.0.0.1"), testing::HasSubstr("no port"));
  EXPECT_THAT(refusal(""), testing::HasSubstr("no port"));
  EXPECT_THAT(refusal("::1:24870"), testing::HasSubstr("needs brackets"));
}

TEST(ParseAddress, RefusesMalformedPorts) {
  for (const char* text :
       {"127.0.0.1:", "127.0.0.1:65536", "127.0.0.1:-1", "127.0.0.1:+1", "127.0.0.1: 1",
        "127.0.0.1:1x", "127.0.0.1:0x10", "127.0.0.1:007", "127.0.0.1:99999999999999999999"}) {
    EXPECT_THAT(refusal(text), testing::HasSubstr("decimal number from 0 to 65535")) << text;
  }
}

TEST(ParseAddress, RefusesPortZeroAsADestinationOnly) {
  EXPECT_THAT(refusal("127.0.0.1:0", PortZero::kRefused),
              testing::HasSubstr("port 0 is only for listening"));
  EXPECT_EQ(parse_address("127.0.0.1:0", PortZero::kAllowed).port, 0);
}

}  // namespace
}  // namespace forcegrid::link
