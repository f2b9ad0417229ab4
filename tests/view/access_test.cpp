// SPDX-License-Identifier: Apache-2.0
#include "view/access.h"

#include <gtest/gtest.h>

#include <cstdlib>
#include <string>

#include "view/options.h"

namespace forcegrid::view {
namespace {

TEST(Host, IsRightForTheServersOwnNames) {
  for (const char* host : {"127.0.0.1:8080", "localhost:8080", "LocalHost:8080", "[::1]:8080"}) {
    EXPECT_TRUE(host_is_right(host, {"127.0.0.1", 8080})) << host;
  }
  EXPECT_TRUE(host_is_right("127.0.0.2:8080", {"127.0.0.2", 8080}));
  EXPECT_TRUE(host_is_right("[::1]:8080", {"::1", 8080}));
}

// A page of evil.example whose name resolves to this machine sends "evil.example".
TEST(Host, IsWrongForAnyOtherName) {
  for (const char* host :
       {"", "evil.example", "evil.example:8080", "127.0.0.1", "127.0.0.1:8081", "127.0.0.1:08080",
        "127.0.0.2:8080", "localhost", "localhost:8080.evil.example", "localhost.evil:8080",
        "127.0.0.1:8080 ", " 127.0.0.1:8080", "127.0.0.1:8080/", "user@127.0.0.1:8080", "::1:8080",
        "[::1]", "0.0.0.0:8080", "2130706433:8080"}) {
    EXPECT_FALSE(host_is_right(host, {"127.0.0.1", 8080})) << host;
  }
}

TEST(Host, HasNoPortWhereItIs80) {
  EXPECT_TRUE(host_is_right("localhost", {"127.0.0.1", 80}));
  EXPECT_TRUE(host_is_right("[::1]", {"127.0.0.1", 80}));
  EXPECT_TRUE(host_is_right("localhost:80", {"127.0.0.1", 80}));
  EXPECT_FALSE(host_is_right("evil.example", {"127.0.0.1", 80}));
}

TEST(Host, HasNoPortWhereItIs443WithTls) {
  const Site site{.address = "127.0.0.1", .port = 443, .encrypted = true};
  EXPECT_TRUE(host_is_right("localhost", site));
  EXPECT_TRUE(host_is_right("[::1]:443", site));
  EXPECT_FALSE(host_is_right("evil.example", site));
  EXPECT_FALSE(host_is_right("localhost", {.address = "127.0.0.1", .port = 443}));
  EXPECT_FALSE(host_is_right("localhost", {.address = "127.0.0.1", .port = 80, .encrypted = true}));
}

TEST(Host, IsTheListeningAddressAloneBeyondLoopback) {
  const Site site{.address = "192.168.1.5", .port = 8443, .encrypted = true, .machine = "lab"};
  EXPECT_TRUE(host_is_right("192.168.1.5:8443", site));
  for (const char* host : {"192.168.1.5", "192.168.1.6:8443", "127.0.0.1:8443", "localhost:8443",
                           "[::1]:8443", "lab:8443", "evil.example:8443", ":8443", ""}) {
    EXPECT_FALSE(host_is_right(host, site)) << host;
  }
  const Site six{.address = "fd00::5", .port = 443, .encrypted = true};
  EXPECT_TRUE(host_is_right("[FD00::5]:443", six));
  EXPECT_TRUE(host_is_right("[fd00::5]", six));
  EXPECT_FALSE(host_is_right("fd00::5", six));
}

// A name that somebody else's server resolves to this machine is no address and not its name.
TEST(Host, IsAnyAddressOrTheMachinesNameWhereItListensEverywhere) {
  for (const char* everywhere : {"0.0.0.0", "::"}) {
    const Site site{.address = everywhere, .port = 8443, .encrypted = true, .machine = "lab"};
    for (const char* host : {"lab:8443", "LAB:8443", "192.168.1.5:8443", "127.0.0.1:8443",
                             "[::1]:8443", "[fd00::5]:8443"}) {
      EXPECT_TRUE(host_is_right(host, site)) << host;
    }
    for (const char* host :
         {"", ":8443", "lab", "lab:8444", "lab:08443", "lab.evil.example:8443", "alab:8443",
          "evil.example:8443", "192.168.1.5", "192.168.1.5.evil.example:8443", "3232235781:8443",
          "192.168.261:8443", "[]:8443", "[lab]:8443", "[127.0.0.1]:8443", "::1:8443",
          "user@192.168.1.5:8443", "192.168.1.5:8443:8443", "192.168.1.5 :8443"}) {
      EXPECT_FALSE(host_is_right(host, site)) << host;
    }
  }
  const Site nameless{.address = "0.0.0.0", .port = 443, .encrypted = true};
  EXPECT_FALSE(host_is_right("", nameless));
  EXPECT_FALSE(host_is_right(":443", nameless));
}

TEST(Host, IsANameOfTheCertificate) {
  for (const char* address : {"127.0.0.1", "192.168.1.5", "0.0.0.0", "::"}) {
    const Site site{.address = address,
                    .port = 8443,
                    .encrypted = true,
                    .names = {"view.lab.example", "*.rooms.example"}};
    for (const char* host : {"view.lab.example:8443", "View.LAB.example:8443",
                             "one.rooms.example:8443", "ONE-2.Rooms.example:8443"}) {
      EXPECT_TRUE(host_is_right(host, site)) << host << " on " << address;
      EXPECT_TRUE(origin_is_right("https://" + std::string(host), host, true)) << host;
    }
    for (const char* host :
         {"view.lab.example", "view.lab.example:8444", "view.lab.example.:8443", "lab.example:8443",
          "a.view.lab.example:8443", "xview.lab.example:8443", "view.lab.example.evil.example:8443",
          "rooms.example:8443", ".rooms.example:8443", "*.rooms.example:8443",
          "a.b.rooms.example:8443", "evilrooms.example:8443", "a.rooms.example.evil.example:8443",
          "user@one.rooms.example:8443", "evil/one.rooms.example:8443", "evil.example:8443",
          ":8443"}) {
      EXPECT_FALSE(host_is_right(host, site)) << host << " on " << address;
    }
  }
  const Site usual{.address = "0.0.0.0", .port = 443, .encrypted = true, .names = {"view.example"}};
  EXPECT_TRUE(host_is_right("view.example", usual));
  EXPECT_TRUE(host_is_right("view.example:443", usual));
}

TEST(CertificateName, IsOneThatABrowserLooksUp) {
  const std::string longest(63, 'a');
  for (const std::string& name :
       {std::string("lab"), std::string("view.lab.example"), std::string("xn--bcher-kva.example"),
        std::string("a_b.1.x2"), std::string("*.lab.example"), longest + ".example"}) {
    EXPECT_TRUE(is_certificate_name(name)) << name;
  }
  for (const std::string& name : {std::string(),
                                  std::string("."),
                                  std::string("*"),
                                  std::string("*."),
                                  std::string("*.lab"),
                                  std::string("*.*.example"),
                                  std::string("a.*.example"),
                                  std::string("a*.lab.example"),
                                  std::string(".lab"),
                                  std::string("lab."),
                                  std::string("a..b"),
                                  std::string("192.168.1.5"),
                                  std::string("8443"),
                                  std::string("::1"),
                                  std::string("a b"),
                                  std::string("a:1"),
                                  std::string("lab\0.evil", 9),
                                  std::string("b\xc3\xbc.example"),
                                  longest + "a.example",
                                  longest + "." + longest + "." + longest + "." + longest}) {
    EXPECT_FALSE(is_certificate_name(name)) << name;
  }
}

TEST(Machine, HasAName) { EXPECT_NE(name_of_machine(), ""); }

TEST(Address, IsLoopbackIfPacketsStayHere) {
  for (const char* address : {"127.0.0.1", "127.255.255.255", "::1"}) {
    EXPECT_TRUE(is_loopback(address)) << address;
  }
  for (const char* address : {"", "0.0.0.0", "128.0.0.1", "::", "::ffff:127.0.0.1", "localhost"}) {
    EXPECT_FALSE(is_loopback(address)) << address;
  }
}

TEST(Origin, IsEncryptedAsTheServerIs) {
  EXPECT_TRUE(origin_is_right("https://lab:8443", "lab:8443", true));
  EXPECT_TRUE(origin_is_right(std::nullopt, "lab:8443", true));
  for (const char* origin : {"http://lab:8443", "https://lab", "https://evil.example", "null", "",
                             "several", "https://lab:8443.evil.example"}) {
    EXPECT_FALSE(origin_is_right(origin, "lab:8443", true)) << origin;
  }
}

TEST(Origin, IsTheHostItselfOrNone) {
  EXPECT_TRUE(origin_is_right("http://127.0.0.1:8080", "127.0.0.1:8080"));
  EXPECT_TRUE(origin_is_right(std::nullopt, "127.0.0.1:8080"));
  for (const char* origin : {"", "null", "http://evil.example", "https://127.0.0.1:8080",
                             "http://127.0.0.1", "http://127.0.0.1:80801", "http://localhost:8080",
                             "http://127.0.0.1:8080.evil.example", "several"}) {
    EXPECT_FALSE(origin_is_right(origin, "127.0.0.1:8080")) << origin;
  }
}

TEST(Token, IsRandomAndLongEnough) {
  const std::string token = random_token();
  EXPECT_EQ(token.size(), 64U);
  EXPECT_EQ(token.find_first_not_of("0123456789abcdef"), std::string::npos);
  EXPECT_NE(token, random_token());
}

TEST(Token, IsRightOnlyWhole) {
  const std::string token = random_token();
  EXPECT_TRUE(token_is_right(token, token));
  EXPECT_FALSE(token_is_right("", token));
  EXPECT_FALSE(token_is_right(token.substr(1), token));
  EXPECT_FALSE(token_is_right(token + "0", token));
  for (const std::size_t at : {std::size_t{0}, std::size_t{31}, token.size() - 1}) {
    std::string other = token;
    other[at] = other[at] == '0' ? '1' : '0';
    EXPECT_FALSE(token_is_right(other, token));
  }
  EXPECT_FALSE(token_is_right("", "")) << "a server without a token lets nobody in";
}

TEST(Token, ComesFromTheEnvironmentIfItIsStrong) {
  const std::string strong(32, 'a');
  ::setenv("FORCEGRID_VIEW_TOKEN", strong.c_str(), 1);
  EXPECT_EQ(token_from_environment(), strong);
  for (const std::string& weak : {std::string(), std::string(31, 'a'), std::string(32, 'g'),
                                  std::string(257, 'a'), strong + " "}) {
    ::setenv("FORCEGRID_VIEW_TOKEN", weak.c_str(), 1);
    EXPECT_THROW(token_from_environment(), ViewError) << weak;
  }
  ::unsetenv("FORCEGRID_VIEW_TOKEN");
  EXPECT_EQ(token_from_environment().size(), 64U);
}

TEST(Target, IsPathAndQuery) {
  EXPECT_EQ(path_of("/?token=1"), "/");
  EXPECT_EQ(path_of("/app.js"), "/app.js");
  EXPECT_EQ(path_of(""), "");
  EXPECT_EQ(query_value("/ws?token=abc", "token"), "abc");
  EXPECT_EQ(query_value("/ws?a=1&token=abc&b=2", "token"), "abc");
  EXPECT_EQ(query_value("/ws?mytoken=abc", "token"), "");
  EXPECT_EQ(query_value("/ws?token", "token"), "");
  EXPECT_EQ(query_value("/ws?token=", "token"), "");
  EXPECT_EQ(query_value("/ws?&&=&token=abc", "token"), "abc");
  EXPECT_EQ(query_value("/ws?token=a=b", "token"), "a=b");
  EXPECT_EQ(query_value("/ws", "token"), "");
  EXPECT_EQ(query_value("/ws?", "token"), "");
}

TEST(Address, HasBracketsForIpv6) {
  EXPECT_EQ(address_and_port("127.0.0.1", 80), "127.0.0.1:80");
  EXPECT_EQ(address_and_port("::1", 80), "[::1]:80");
}

}  // namespace
}  // namespace forcegrid::view
