// SPDX-License-Identifier: Apache-2.0
#include "view/http_answer.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>

namespace forcegrid::view {
namespace {

using testing::HasSubstr;
using testing::Not;
using testing::StartsWith;

constexpr char kHost[] = "127.0.0.1:8080";
std::string token() { return std::string(64, '7'); }

HttpServer server() {
  return {{.address = "127.0.0.1", .port = 8080},
          token(),
          {{"/index.html", {"text/html", "the page"}}, {"/app.js", {"text/javascript", "code"}}}};
}

HttpRequest request(std::string_view target) {
  return {.method = "GET", .target = target, .host = kHost, .origin = std::nullopt};
}

class HttpAnswers : public testing::Test {
 protected:
  void ask(const HttpRequest& asked) {
    result_ = {};
    answer(asked, server_, result_);
  }

  HttpServer server_ = server();
  HttpAnswer result_;
};

TEST_F(HttpAnswers, GiveThePageToTheTokenAlone) {
  const std::string with_token = "/?token=" + token();
  ask(request(with_token));
  EXPECT_THAT(result_.head, StartsWith("HTTP/1.1 200 OK\r\n"));
  EXPECT_EQ(result_.body, "the page");
  for (const std::string& target :
       {std::string("/"), std::string("/index.html"), "/?token=" + std::string(64, '8'),
        "/?Token=" + token(), with_token + "7"}) {
    ask(request(target));
    EXPECT_THAT(result_.head, StartsWith("HTTP/1.1 403")) << target;
    EXPECT_THAT(std::string(result_.body), HasSubstr("token"));
  }
}

TEST_F(HttpAnswers, GiveCodeWithoutAToken) {
  ask(request("/app.js"));
  EXPECT_THAT(result_.head, StartsWith("HTTP/1.1 200 OK\r\nContent-Type: text/javascript\r\n"));
  EXPECT_EQ(result_.body, "code");
  EXPECT_THAT(result_.head, HasSubstr("Content-Length: 4\r\n"));
}

TEST_F(HttpAnswers, GiveNothingElse) {
  for (const char* target : {"/none.js", "/../app.js", "/%2e%2e/app.js", "//app.js", "app.js",
                             "http://127.0.0.1:8080/app.js", "*", ""}) {
    ask(request(target));
    EXPECT_THAT(result_.head, StartsWith("HTTP/1.1 404")) << target;
  }
}

TEST_F(HttpAnswers, RefuseAnotherHostWhateverIsAskedFor) {
  for (const std::optional<std::string_view> host :
       {std::optional<std::string_view>(), std::optional<std::string_view>("evil.example"),
        std::optional<std::string_view>("evil.example:8080")}) {
    for (const bool upgrade : {false, true}) {
      const std::string target = (upgrade ? "/ws?token=" : "/?token=") + token();
      HttpRequest asked = request(target);
      asked.host = host;
      asked.is_upgrade = upgrade;
      ask(asked);
      EXPECT_FALSE(result_.open_web_socket);
      EXPECT_THAT(result_.head, StartsWith("HTTP/1.1 403"));
      EXPECT_THAT(result_.head, HasSubstr("Connection: close"));
    }
  }
}

TEST_F(HttpAnswers, TakeOnlyGetAndHead) {
  for (const char* method : {"POST", "PUT", "DELETE", "OPTIONS", "get", ""}) {
    HttpRequest asked = request("/app.js");
    asked.method = method;
    ask(asked);
    EXPECT_THAT(result_.head, StartsWith("HTTP/1.1 405")) << method;
    EXPECT_THAT(result_.head, HasSubstr("Allow: GET, HEAD\r\n"));
  }
  HttpRequest asked = request("/app.js");
  asked.method = "HEAD";
  ask(asked);
  EXPECT_THAT(result_.head, HasSubstr("Content-Length: 4\r\n"));
  EXPECT_EQ(result_.body, "");
}

TEST_F(HttpAnswers, OpenAWebSocketForTheServersPageAndItsToken) {
  const std::string target = "/ws?token=" + token();
  HttpRequest asked = request(target);
  asked.is_upgrade = true;
  ask(asked);
  EXPECT_TRUE(result_.open_web_socket) << "a script sends no Origin";
  asked.origin = "http://127.0.0.1:8080";
  ask(asked);
  EXPECT_TRUE(result_.open_web_socket);
  for (const char* origin : {"http://evil.example", "null", "http://localhost:8080", "several"}) {
    asked.origin = origin;
    ask(asked);
    EXPECT_FALSE(result_.open_web_socket) << origin;
    EXPECT_THAT(result_.head, StartsWith("HTTP/1.1 403"));
  }
  asked.origin = "http://127.0.0.1:8080";
  for (const char* wrong : {"/ws", "/ws?token=", "/ws?token=7777"}) {
    asked.target = wrong;
    ask(asked);
    EXPECT_FALSE(result_.open_web_socket) << wrong;
    EXPECT_THAT(result_.head, StartsWith("HTTP/1.1 403"));
  }
  const std::string elsewhere = "/?token=" + token();
  asked.target = elsewhere;
  ask(asked);
  EXPECT_FALSE(result_.open_web_socket);
  EXPECT_THAT(result_.head, StartsWith("HTTP/1.1 404"));
}

TEST_F(HttpAnswers, SayWhatABrowserMayDo) {
  for (const char* target : {"/app.js", "/none", "/"}) {
    ask(request(target));
    for (const char* header :
         {"Content-Security-Policy: default-src ", "X-Content-Type-Options: nosniff\r\n",
          "Referrer-Policy: no-referrer\r\n", "Cache-Control: no-store\r\n",
          "X-Frame-Options: DENY\r\n"}) {
      EXPECT_THAT(result_.head, HasSubstr(header)) << target;
    }
    EXPECT_THAT(result_.head, Not(HasSubstr("unsafe")));
    EXPECT_TRUE(result_.head.ends_with("\r\n\r\n"));
  }
  ask(request("/app.js"));
  EXPECT_THAT(result_.head, HasSubstr("default-src 'self'; connect-src 'self' "
                                      "ws://127.0.0.1:8080;"));
}

TEST_F(HttpAnswers, SpeakOfTlsOnlyIfTheyAreEncrypted) {
  server_.site.encrypted = true;
  ask(request("/app.js"));
  EXPECT_THAT(result_.head, HasSubstr("connect-src 'self' wss://127.0.0.1:8080;"));
  EXPECT_THAT(result_.head, Not(HasSubstr("ws://1")));
  const std::string target = "/ws?token=" + token();
  HttpRequest asked = request(target);
  asked.is_upgrade = true;
  asked.origin = "https://127.0.0.1:8080";
  ask(asked);
  EXPECT_TRUE(result_.open_web_socket);
  asked.origin = "http://127.0.0.1:8080";
  ask(asked);
  EXPECT_FALSE(result_.open_web_socket) << "whoever is between could have changed that page";
  EXPECT_THAT(result_.head, StartsWith("HTTP/1.1 403"));
}

TEST_F(HttpAnswers, KeepTheConnectionIfTheRequestDoes) {
  HttpRequest asked = request("/app.js");
  ask(asked);
  EXPECT_TRUE(result_.keep_alive);
  EXPECT_THAT(result_.head, HasSubstr("Connection: keep-alive\r\n"));
  asked.keep_alive = false;
  ask(asked);
  EXPECT_FALSE(result_.keep_alive);
  EXPECT_THAT(result_.head, HasSubstr("Connection: close\r\n"));
}

}  // namespace
}  // namespace forcegrid::view
