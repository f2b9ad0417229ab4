// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/asio/ip/tcp.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/core/tcp_stream.hpp>
#include <boost/beast/http/empty_body.hpp>
#include <boost/beast/http/parser.hpp>
#include <functional>
#include <memory>
#include <optional>

#include "view/http_answer.h"
#include "view/web_socket_session.h"

namespace forcegrid::view {

/// A browser's connection: requests one after the other, until one opens a WebSocket or the
/// connection is idle for 10 s. It lives as long as an operation is under way.
/// Real-time: no. Threads: the io_context's.
class HttpSession : public std::enable_shared_from_this<HttpSession> {
 public:
  using OpenWebSocket = std::function<void(boost::asio::ip::tcp::socket, ConnectionSlot,
                                           const WebSocketSession::Request&)>;

  /// @param server  outlives the io_context's run.
  HttpSession(boost::asio::ip::tcp::socket socket, const HttpServer& server, ConnectionSlot slot,
              OpenWebSocket open_web_socket);
  void read();

 private:
  void on_read(const boost::system::error_code& error);
  void take_request();
  void write();
  void close();

  boost::beast::tcp_stream stream_;
  const HttpServer& server_;
  ConnectionSlot slot_;
  OpenWebSocket open_web_socket_;
  boost::beast::flat_buffer buffer_;
  std::optional<boost::beast::http::request_parser<boost::beast::http::empty_body>> parser_;
  HttpAnswer answer_;
};

}  // namespace forcegrid::view
