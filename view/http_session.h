// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/http/empty_body.hpp>
#include <boost/beast/http/parser.hpp>
#include <functional>
#include <memory>
#include <optional>

#include "view/browser_stream.h"
#include "view/http_answer.h"
#include "view/web_socket_session.h"

namespace forcegrid::view {

/// A browser's connection: TLS's handshake, if it is encrypted, then requests one after the other,
/// until one opens a WebSocket or the connection is idle for 10 s. The handshake has 10 s, too. It
/// lives as long as an operation is under way.
/// Real-time: no. Threads: the io_context's.
class HttpSession : public std::enable_shared_from_this<HttpSession> {
 public:
  using OpenWebSocket =
      std::function<void(BrowserStream, ConnectionSlot, const WebSocketSession::Request&)>;

  /// @param server  outlives the io_context's run.
  HttpSession(BrowserStream stream, const HttpServer& server, ConnectionSlot slot,
              OpenWebSocket open_web_socket);
  void run();

 private:
  void on_handshake(const boost::system::error_code& error);
  void read();
  void on_read(const boost::system::error_code& error);
  void take_request();
  void write();
  void close();
  void close_socket();

  BrowserStream stream_;
  const HttpServer& server_;
  ConnectionSlot slot_;
  OpenWebSocket open_web_socket_;
  boost::beast::flat_buffer buffer_;
  std::optional<boost::beast::http::request_parser<boost::beast::http::empty_body>> parser_;
  HttpAnswer answer_;
};

}  // namespace forcegrid::view
