// SPDX-License-Identifier: Apache-2.0
#include "view/browser_stream.h"

#include <boost/asio/ssl/stream.hpp>
#include <chrono>

namespace forcegrid::view {
namespace {

constexpr std::chrono::seconds kTlsGoodbye{2};

}  // namespace

struct BrowserStream::Tls {
  Tls(next_layer_type& below, boost::asio::ssl::context& context) : stream(below, context) {}

  boost::asio::ssl::stream<next_layer_type&> stream;
};

BrowserStream::BrowserStream(boost::asio::ip::tcp::socket socket, boost::asio::ssl::context* tls)
    : tcp_(std::make_unique<next_layer_type>(std::move(socket))) {
  if (tls != nullptr) {
    tls_ = std::make_unique<Tls>(*tcp_, *tls);
    record_ = std::make_unique<std::array<char, kRecordBytes>>();
  }
}

BrowserStream::BrowserStream(BrowserStream&& other) noexcept = default;
BrowserStream::~BrowserStream() = default;

void BrowserStream::handshake(std::function<void(const boost::system::error_code&)> done) {
  tls_->stream.async_handshake(boost::asio::ssl::stream_base::server, std::move(done));
}

void BrowserStream::shut_down(std::function<void(const boost::system::error_code&)> done) {
  tcp_->expires_after(kTlsGoodbye);
  tls_->stream.async_shutdown(std::move(done));
}

void BrowserStream::read_tls(boost::asio::mutable_buffer buffer, Done done) {
  tls_->stream.async_read_some(buffer, std::move(done));
}

void BrowserStream::write_tls(boost::asio::const_buffer buffer, Done done) {
  tls_->stream.async_write_some(buffer, std::move(done));
}

}  // namespace forcegrid::view
