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
    EXPECT_TRUE(host_is_right(host, "127.0.0.1", 8080)) << host;
  }
  EXPECT_TRUE(host_is_right("127.0.0.2:8080", "127.0.0.2", 8080));
  EXPECT_TRUE(host_is_right("[::1]:8080", "::1", 8080));
}

// A page of evil.example whose name resolves to this machine sends "evil.example".
TEST(Host, IsWrongForAnyOtherName) {
  for (const char* host :
       {"", "evil.example", "evil.example:8080", "127.0.0.1", "127.0.0.1:8081", "127.0.0.1:08080",
        "127.0.0.2:8080", "localhost", "localhost:8080.evil.example", "localhost.evil:8080",
        "127.0.0.1:8080 ", " 127.0.0.1:8080", "127.0.0.1:8080/", "user@127.0.0.1:8080", "::1:8080",
        "[::1]", "0.0.0.0:8080", "2130706433:8080"}) {
    EXPECT_FALSE(host_is_right(host, "127.0.0.1", 8080)) << host;
  }
}

TEST(Host, HasNoPortWhereItIs80) {
  EXPECT_TRUE(host_is_right("localhost", "127.0.0.1", 80));
  EXPECT_TRUE(host_is_right("[::1]", "127.0.0.1", 80));
  EXPECT_TRUE(host_is_right("localhost:80", "127.0.0.1", 80));
  EXPECT_FALSE(host_is_right("evil.example", "127.0.0.1", 80));
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
