// SPDX-License-Identifier: Apache-2.0
#include "view/options.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>
#include <vector>

namespace forcegrid::view {
namespace {

Options parsed(const std::vector<const char*>& arguments) { return parse_options(arguments); }

std::string refusal_of(const std::vector<const char*>& arguments) {
  try {
    parse_options(arguments);
  } catch (const ViewError& error) {
    return error.what();
  }
  return "it is taken";
}

TEST(ViewOptions, ListenOnLoopbackWithoutFlags) {
  const Options options = parsed({});
  EXPECT_EQ(options.address, "127.0.0.1");
  EXPECT_EQ(options.port, 0);
  EXPECT_FALSE(options.until_stdin_closes);
}

TEST(ViewOptions, TakeAddressAndPort) {
  EXPECT_EQ(parsed({"--listen", "127.0.0.5:65535"}).address, "127.0.0.5");
  EXPECT_EQ(parsed({"--listen", "127.0.0.5:65535"}).port, 65535);
  EXPECT_EQ(parsed({"--listen=[::1]:81"}).address, "::1");
  EXPECT_EQ(parsed({"--listen=localhost:81"}).address, "127.0.0.1");
  EXPECT_TRUE(parsed({"--until-stdin-closes"}).until_stdin_closes);
  EXPECT_TRUE(parsed({"--version"}).version);
  EXPECT_TRUE(parsed({"--help"}).help);
}

TEST(ViewOptions, RefuseWhatOtherMachinesReach) {
  for (const char* address :
       {"0.0.0.0:80", "192.168.1.2:80", "[::]:80", "[::ffff:127.0.0.1]:80", "[fe80::1]:80"}) {
    EXPECT_THAT(refusal_of({"--listen", address}), testing::HasSubstr("other machines reach"))
        << address;
  }
}

TEST(ViewOptions, NameTheRemedyForWhatOtherMachinesReach) {
  const std::string refusal = refusal_of({"--listen", "192.168.1.2:80"});
  for (const char* remedy : {"--listen 192.168.1.2:80: ", "--key FILE", "--view-key FILE",
                             "openssl req -x509", "-keyout view.pem -out view.pem", "ssh -L"}) {
    EXPECT_THAT(refusal, testing::HasSubstr(remedy));
  }
}

TEST(ViewOptions, TakeAnyAddressWithAKey) {
  for (const char* address : {"0.0.0.0:80", "192.168.1.2:80", "[::]:80", "127.0.0.1:80"}) {
    EXPECT_EQ(parsed({"--listen", address, "--key", "view.pem"}).key_file, "view.pem") << address;
    EXPECT_EQ(parsed({"--key", "view.pem", "--listen", address}).port, 80) << address;
  }
  EXPECT_EQ(parsed({}).key_file, "");
  EXPECT_THAT(refusal_of({"--key"}), testing::HasSubstr("missing"));
  EXPECT_THAT(refusal_of({"--key", ""}), testing::HasSubstr("empty"));
  EXPECT_THAT(refusal_of({"--key", "view.pem", "--export", "a.html"}),
              testing::HasSubstr("leave one"));
  EXPECT_THAT(refusal_of({"--key", "view.pem", "--listen", "lab:80"}),
              testing::HasSubstr("is no address"));
}

TEST(ViewOptions, RefuseWhatIsNoAddressWithItsText) {
  for (const char* address :
       {"", ":", "80", "127.0.0.1", "127.0.0.1:", "127.0.0.1:65536", "127.0.0.1:-1", "127.0.0.1:8x",
        "127.1:80", "::1:80", "[::1:80", "example.org:80", "127.0.0.1:80 "}) {
    EXPECT_THAT(refusal_of({"--listen", address}),
                testing::StartsWith("--listen " + std::string(address)));
  }
  EXPECT_THAT(refusal_of({"--listen"}), testing::HasSubstr("missing"));
}

TEST(ViewOptions, TakeAFileToExport) {
  EXPECT_EQ(parsed({}).export_file, "");
  EXPECT_EQ(parsed({"--export", "a.html"}).export_file, "a.html");
  EXPECT_EQ(parsed({"--export", "a.html", "--export-MB", "7.5"}).export_MB, 7.5);
  for (const char* size : {"", "4.9", "501", "nan", "20x", "-20"}) {
    EXPECT_THAT(refusal_of({"--export-MB", size}), testing::HasSubstr("5 to 500")) << size;
  }
  EXPECT_THAT(refusal_of({"--export"}), testing::HasSubstr("missing"));
  EXPECT_THAT(refusal_of({"--export", ""}), testing::HasSubstr("empty"));
}

TEST(ViewOptions, RefuseWhatTheyDoNotKnow) {
  EXPECT_THAT(refusal_of({"--token"}), testing::HasSubstr("'--token'"));
  EXPECT_THAT(refusal_of({"extra"}), testing::HasSubstr("--help"));
}

}  // namespace
}  // namespace forcegrid::view
