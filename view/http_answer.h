// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>
#include <string_view>

#include "view/access.h"
#include "view/page_files.h"

/// What the server answers to a request, without sockets.
/// Real-time: no. Threads: any.
namespace forcegrid::view {

/// What the answer depends on, of a request that is HTTP.
struct HttpRequest {
  std::string_view method;
  std::string_view target;
  std::optional<std::string_view> host;  ///< nothing: none, or several
  std::optional<std::string_view> origin;
  bool is_upgrade = false;  ///< to a WebSocket
  bool keep_alive = true;
};

/// Of this server.
struct HttpServer {
  Site site;
  std::string token;
  PageFiles files;
};

struct HttpAnswer {
  bool open_web_socket = false;  ///< then nothing else matters
  bool keep_alive = true;
  std::string head;       ///< status line and headers, with the empty line
  std::string own_body;   ///< a sentence, or empty
  std::string_view body;  ///< of own_body or of a file
};

/// Checks Host, method, token and, for a WebSocket, Origin; finds the file.
/// @returns an answer that refers to itself and to `server`: it is not to be copied.
void answer(const HttpRequest& request, const HttpServer& server, HttpAnswer& result);

/// An answer of `status` ("400 Bad Request") with a sentence, after which the connection closes.
void answer_and_close(std::string_view status, std::string_view sentence, HttpAnswer& result);

}  // namespace forcegrid::view
