// SPDX-License-Identifier: Apache-2.0
#include "view/http_session.h"

#include <openssl/ssl.h>

#include <array>
#include <boost/asio/buffer.hpp>
#include <boost/asio/ssl/error.hpp>
#include <boost/asio/write.hpp>
#include <boost/beast/core/error.hpp>
#include <boost/beast/http/read.hpp>
#include <boost/beast/websocket/rfc6455.hpp>
#include <chrono>
#include <string_view>
#include <utility>

#include "view/log_line.h"

namespace forcegrid::view {
namespace {

namespace http = boost::beast::http;

constexpr std::chrono::seconds kIdle{10};
constexpr std::uint32_t kLargestHeaders = 8 << 10;

std::string_view view_of(boost::beast::string_view text) { return {text.data(), text.size()}; }

// Of OpenSSL itself, not of the connection below it.
bool is_of_tls(const boost::system::error_code& error) {
  return error.category() == boost::asio::error::get_ssl_category();
}

// Nothing if the header is not there exactly once.
template <typename Fields>
std::optional<std::string_view> single(const Fields& fields, http::field name) {
  if (fields.count(name) != 1) {
    return std::nullopt;
  }
  return view_of(fields[name]);
}

}  // namespace

HttpSession::HttpSession(BrowserStream stream, const HttpServer& server, ConnectionSlot slot,
                         OpenWebSocket open_web_socket)
    : stream_(std::move(stream)),
      server_(server),
      slot_(std::move(slot)),
      open_web_socket_(std::move(open_web_socket)),
      buffer_(2 * kLargestHeaders) {}

void HttpSession::run() {
  if (!stream_.encrypted()) {
    return read();
  }
  stream_.next_layer().expires_after(kIdle);
  stream_.handshake([self = shared_from_this()](const auto& error) { self->on_handshake(error); });
}

void HttpSession::on_handshake(const boost::system::error_code& error) {
  if (!error) {
    return read();
  }
  if (is_of_tls(error) &&
      ERR_GET_REASON(static_cast<unsigned long>(error.value())) == SSL_R_HTTP_REQUEST) {
    stream_.leave_tls();
    answer_and_close("400 Bad Request",
                     "This server is encrypted: open the URL that forcegrid printed, with https.",
                     answer_);
    return write();
  }
  if (is_of_tls(error)) {
    log_line("dropped a connection: TLS: " + error.message());
  } else if (error == boost::beast::error::timeout) {
    log_line("dropped a connection: no TLS within 10 s");
  }  // else it has left
  close_socket();
}

void HttpSession::read() {
  parser_.emplace();
  parser_->header_limit(kLargestHeaders);
  parser_->body_limit(0);
  stream_.next_layer().expires_after(kIdle);
  http::async_read(
      stream_, buffer_, *parser_,
      [self = shared_from_this()](const auto& error, std::size_t) { self->on_read(error); });
}

void HttpSession::on_read(const boost::system::error_code& error) {
  answer_ = {};
  if (!error) {
    return take_request();
  }
  if (error == http::error::end_of_stream || error == http::error::partial_message ||
      error.category() != make_error_code(http::error::bad_method).category()) {
    return close();  // it has left, or has been silent for too long
  }
  if (error == http::error::header_limit || error == http::error::buffer_overflow) {
    answer_and_close("431 Request Header Fields Too Large", "Headers have at most 8 KiB.", answer_);
  } else if (error == http::error::body_limit || error == http::error::unexpected_body) {
    answer_and_close("413 Payload Too Large", "Requests have no body.", answer_);
  } else {
    answer_and_close("400 Bad Request", "This is not HTTP.", answer_);
  }
  write();
}

void HttpSession::take_request() {
  const auto& request = parser_->get();
  const bool several_origins = request.count(http::field::origin) > 1;
  answer({.method = view_of(request.method_string()),
          .target = view_of(request.target()),
          .host = single(request, http::field::host),
          .origin = several_origins ? "several" : single(request, http::field::origin),
          .is_upgrade = boost::beast::websocket::is_upgrade(request),
          .keep_alive = request.keep_alive()},
         server_, answer_);
  if (!answer_.open_web_socket) {
    return write();
  }
  if (buffer_.size() > 0) {
    answer_and_close("400 Bad Request", "Wait for the answer before the first message.", answer_);
    return write();
  }
  const WebSocketSession::Request upgrade = parser_->release();
  open_web_socket_(std::move(stream_), std::move(slot_), upgrade);
}

void HttpSession::write() {
  stream_.next_layer().expires_after(kIdle);
  const std::array<boost::asio::const_buffer, 2> buffers = {
      boost::asio::buffer(answer_.head),
      boost::asio::const_buffer(answer_.body.data(), answer_.body.size())};
  boost::asio::async_write(stream_, buffers,
                           [self = shared_from_this()](const auto& error, std::size_t) {
                             if (!error && self->answer_.keep_alive) {
                               self->read();
                             } else {
                               self->close();
                             }
                           });
}

void HttpSession::close() {
  if (!stream_.encrypted()) {
    return close_socket();
  }
  stream_.shut_down([self = shared_from_this()](const auto&) { self->close_socket(); });
}

void HttpSession::close_socket() {
  boost::system::error_code ignored;
  stream_.next_layer().socket().shutdown(boost::asio::ip::tcp::socket::shutdown_send, ignored);
  stream_.next_layer().close();
}

}  // namespace forcegrid::view
