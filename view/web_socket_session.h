// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/http/empty_body.hpp>
#include <boost/beast/http/message.hpp>
#include <boost/beast/websocket/stream.hpp>
#include <memory>

#include "view/browser_stream.h"
#include "view/tool_hubs.h"

namespace forcegrid::view {

/// One of the server's connections: as long as it lives, it counts.
using ConnectionSlot = std::shared_ptr<void>;

/// A page's WebSocket. It hands the page's texts to the hub, and sends what the page's outbox has,
/// one message at a time. It lives as long as an operation is under way.
/// Real-time: no. Threads: the io_context's.
class WebSocketSession : public std::enable_shared_from_this<WebSocketSession> {
 public:
  using Request = boost::beast::http::request<boost::beast::http::empty_body>;

  /// @param hub  outlives the io_context's run.
  WebSocketSession(BrowserStream stream, ToolHubs& hub, ConnectionSlot slot);
  ~WebSocketSession();
  WebSocketSession(const WebSocketSession&) = delete;
  WebSocketSession& operator=(const WebSocketSession&) = delete;

  /// Answers the upgrade and serves the page.
  void run(const Request& request);
  /// Sends what waits, then says goodbye.
  void finish();

 private:
  void read();
  void on_read(const boost::system::error_code& error);
  void write();
  void close(boost::beast::websocket::close_code code);
  void drop();

  // Pages are of this machine or near: compression would only cost.
  boost::beast::websocket::stream<BrowserStream, false> stream_;
  ToolHubs& hub_;
  ConnectionSlot slot_;
  Viewer viewer_;
  boost::beast::flat_buffer buffer_;
  PageMessage now_;  ///< that is being sent
  bool joined_ = false;
  bool writing_ = false;
  bool finishing_ = false;
  bool closing_ = false;
};

}  // namespace forcegrid::view
