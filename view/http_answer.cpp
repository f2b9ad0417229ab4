// SPDX-License-Identifier: Apache-2.0
#include "view/http_answer.h"

namespace forcegrid::view {
namespace {

constexpr std::string_view kPlain = "text/plain; charset=utf-8";

// `policy` is the Content-Security-Policy; what is no page needs nothing from anywhere.
void write_head(std::string_view status, std::string_view type, std::string_view policy,
                HttpAnswer& result) {
  std::string& head = result.head;
  head = "HTTP/1.1 ";
  head += status;
  head += "\r\nContent-Type: ";
  head += type;
  head += "\r\nContent-Length: ";
  head += std::to_string(result.body.size());
  head += "\r\nContent-Security-Policy: ";
  head += policy;
  head +=
      "\r\nX-Content-Type-Options: nosniff"
      "\r\nX-Frame-Options: DENY"
      "\r\nReferrer-Policy: no-referrer"
      "\r\nCross-Origin-Resource-Policy: same-origin"
      "\r\nCache-Control: no-store";
  if (status.starts_with("405")) {
    head += "\r\nAllow: GET, HEAD";
  }
  head +=
      result.keep_alive ? "\r\nConnection: keep-alive\r\n\r\n" : "\r\nConnection: close\r\n\r\n";
}

void say(std::string_view status, std::string_view sentence, HttpAnswer& result) {
  result.own_body = std::string(sentence) + "\n";
  result.body = result.own_body;
  write_head(status, kPlain, "default-src 'none'", result);
}

void answer_upgrade(const HttpRequest& request, const HttpServer& server, HttpAnswer& result) {
  result.keep_alive = false;
  if (path_of(request.target) != "/ws") {
    say("404 Not Found", "The WebSocket is /ws.", result);
  } else if (!origin_is_right(request.origin, *request.host, server.site.encrypted)) {
    say("403 Forbidden", "Only a page of this server may open this WebSocket.", result);
  } else if (!token_is_right(query_value(request.target, "token"), server.token)) {
    say("403 Forbidden", "The token is wrong or missing.", result);
  } else {
    result.open_web_socket = true;
  }
}

}  // namespace

void answer_and_close(std::string_view status, std::string_view sentence, HttpAnswer& result) {
  result.keep_alive = false;
  say(status, sentence, result);
}

void answer(const HttpRequest& request, const HttpServer& server, HttpAnswer& result) {
  result.keep_alive = request.keep_alive;
  if (!request.host || !host_is_right(*request.host, server.site)) {
    return answer_and_close("403 Forbidden",
                            "This server answers only to its own address: open the URL that "
                            "forcegrid printed.",
                            result);
  }
  if (request.method != "GET" && request.method != "HEAD") {
    return answer_and_close("405 Method Not Allowed", "Only GET and HEAD.", result);
  }
  if (request.is_upgrade) {
    return answer_upgrade(request, server, result);
  }
  const std::string_view path = path_of(request.target);
  const bool is_page = path == "/" || path == "/index.html";
  if (is_page && !token_is_right(query_value(request.target, "token"), server.token)) {
    say("403 Forbidden",
        "The token is wrong or missing: open the URL that forcegrid printed, with all that is "
        "after '?'.",
        result);
  } else if (const auto file = server.files.find(is_page ? "/index.html" : path);
             file != server.files.end()) {
    result.body = file->second.content;
    write_head("200 OK", file->second.type,
               content_security_policy(*request.host, server.site.encrypted), result);
  } else {
    say("404 Not Found", "There is no such file.", result);
  }
  if (request.method == "HEAD") {
    result.body = {};
  }
}

}  // namespace forcegrid::view
