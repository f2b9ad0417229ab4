// SPDX-License-Identifier: Apache-2.0
#include "view/web_socket_session.h"

#include <boost/asio/buffer.hpp>
#include <chrono>
#include <string>
#include <string_view>
#include <utility>

#include "view/log_line.h"

namespace forcegrid::view {
namespace {

namespace ws = boost::beast::websocket;

constexpr std::chrono::seconds kHandshake{5};
// A page that is silent for half of this is asked whether it is there.
constexpr std::chrono::seconds kSilence{30};

}  // namespace

WebSocketSession::WebSocketSession(BrowserStream stream, ToolHubs& hub, ConnectionSlot slot)
    : stream_(std::move(stream)), hub_(hub), slot_(std::move(slot)) {
  viewer_.wake = [this] { write(); };
}

WebSocketSession::~WebSocketSession() {
  if (joined_) {
    hub_.leave(viewer_);
  }
}

void WebSocketSession::run(const Request& request) {
  stream_.next_layer()
      .next_layer()
      .expires_never();  // from here on the WebSocket's own limits hold
  stream_.set_option(ws::stream_base::timeout{kHandshake, kSilence, true});
  stream_.read_message_max(kLargestPageText);
  stream_.auto_fragment(false);
  stream_.async_accept(request, [self = shared_from_this()](const auto& error) {
    if (!error && !self->finishing_) {
      self->joined_ = true;
      self->hub_.join(self->viewer_);
      self->read();
    }
  });
}

void WebSocketSession::read() {
  stream_.async_read(buffer_, [self = shared_from_this()](const auto& error, std::size_t) {
    self->on_read(error);
  });
}

void WebSocketSession::on_read(const boost::system::error_code& error) {
  if (error) {
    joined_ = false;
    hub_.leave(viewer_);
    drop();
    return;
  }
  if (!closing_) {
    try {
      if (!stream_.got_text()) {
        throw view_link::ViewLinkError("a binary message");
      }
      hub_.take_page(viewer_, {static_cast<const char*>(buffer_.data().data()), buffer_.size()});
    } catch (const view_link::ViewLinkError& broken) {
      log_line(std::string("disconnected a page: it sent ") + broken.what());
      close(ws::close_code::policy_error);
    }
  }
  buffer_.clear();
  read();
}

void WebSocketSession::write() {
  if (closing_ || !joined_) {
    return;
  }
  if (viewer_.outbox.overrun()) {
    log_line("disconnected a page that does not read");
    return drop();
  }
  if (writing_) {
    return;
  }
  auto message = viewer_.outbox.next();
  if (!message) {
    if (finishing_) {
      close(ws::close_code::going_away);
    }
    return;
  }
  now_ = std::move(*message);
  writing_ = true;
  stream_.text(now_.text);
  stream_.async_write(boost::asio::buffer(*now_.bytes),
                      [self = shared_from_this()](const auto& error, std::size_t) {
                        self->writing_ = false;
                        self->now_ = {};
                        if (!error) {  // one ends the reading, too
                          self->write();
                        }
                      });
}

void WebSocketSession::finish() {
  finishing_ = true;
  write();
}

void WebSocketSession::close(ws::close_code code) {
  if (!closing_) {
    closing_ = true;
    stream_.async_close(code, [self = shared_from_this()](const auto&) {});
  }
}

// Without a goodbye, for which a page that does not read has no ears.
void WebSocketSession::drop() {
  closing_ = true;
  stream_.next_layer().next_layer().close();
}

}  // namespace forcegrid::view
