// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <boost/asio/buffer.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/ssl/context.hpp>
#include <boost/beast/core/buffer_traits.hpp>
#include <boost/beast/core/tcp_stream.hpp>
#include <boost/beast/websocket/teardown.hpp>
#include <cstddef>
#include <functional>
#include <memory>
#include <utility>

namespace forcegrid::view {

/// A browser's connection, with TLS or without: a stream for Boost.Beast. HTTP and WebSocket are
/// slow to compile, and so is TLS for each kind of their buffers and handlers. With one type of
/// stream the former are compiled once, and behind std::function the latter is.
///
/// next_layer() is the connection below TLS; its time limits hold for both. As on any stream there
/// is one read and one write at a time.
/// Real-time: no. Threads: the io_context's.
class BrowserStream {
 public:
  using next_layer_type = boost::beast::tcp_stream;
  using executor_type = next_layer_type::executor_type;

  /// @param tls  outlives this; null: without TLS.
  BrowserStream(boost::asio::ip::tcp::socket socket, boost::asio::ssl::context* tls);
  BrowserStream(BrowserStream&& other) noexcept;
  ~BrowserStream();
  BrowserStream(const BrowserStream&) = delete;
  BrowserStream& operator=(const BrowserStream&) = delete;

  executor_type get_executor() noexcept { return tcp_->get_executor(); }
  next_layer_type& next_layer() noexcept { return *tcp_; }
  const next_layer_type& next_layer() const noexcept { return *tcp_; }
  bool encrypted() const noexcept { return tls_ != nullptr && !left_tls_; }

  /// TLS's handshake, once, if encrypted().
  void handshake(std::function<void(const boost::system::error_code&)> done);
  /// From here on without TLS: for a peer whose handshake has shown that it knows none.
  void leave_tls() noexcept { left_tls_ = true; }
  /// TLS's goodbye, if encrypted(). A peer that does not answer it is given 2 s.
  void shut_down(std::function<void(const boost::system::error_code&)> done);

  template <typename Buffers, typename Handler>
  void async_read_some(const Buffers& buffers, Handler&& handler) {
    if (encrypted()) {
      read_tls(first_of<boost::asio::mutable_buffer>(buffers),
               shared(std::forward<Handler>(handler)));
    } else {
      tcp_->async_read_some(buffers, std::forward<Handler>(handler));
    }
  }

  template <typename Buffers, typename Handler>
  void async_write_some(const Buffers& buffers, Handler&& handler) {
    if (encrypted()) {
      write_tls(one_record_of(buffers), shared(std::forward<Handler>(handler)));
    } else {
      tcp_->async_write_some(buffers, std::forward<Handler>(handler));
    }
  }

  /// How a WebSocket ends the connection below it; Beast looks for this function.
  template <typename Handler>
  friend void async_teardown(boost::beast::role_type role, BrowserStream& stream,
                             Handler&& handler) {
    if (stream.encrypted()) {
      stream.shut_down([done = std::make_shared<std::decay_t<Handler>>(std::forward<Handler>(
                            handler))](const boost::system::error_code& error) { (*done)(error); });
    } else {
      using boost::beast::async_teardown;
      async_teardown(role, *stream.tcp_, std::forward<Handler>(handler));
    }
  }

 private:
  struct Tls;
  using Done = std::function<void(const boost::system::error_code&, std::size_t)>;
  static constexpr std::size_t kRecordBytes = 16 << 10;  // the most that TLS encrypts at once

  // Beast's handlers can't be copied, which std::function asks for.
  template <typename Handler>
  static Done shared(Handler&& handler) {
    return
        [done = std::make_shared<std::decay_t<Handler>>(std::forward<Handler>(handler))](
            const boost::system::error_code& error, std::size_t bytes) { (*done)(error, bytes); };
  }

  template <typename Buffer, typename Buffers>
  static Buffer first_of(const Buffers& buffers) {
    for (auto at = boost::asio::buffer_sequence_begin(buffers);
         at != boost::asio::buffer_sequence_end(buffers); ++at) {
      if (Buffer buffer = *at; buffer.size() > 0) {
        return buffer;
      }
    }
    return {};
  }

  // Small buffers together, so that a head and its body are not encrypted and sent one by one.
  template <typename Buffers>
  boost::asio::const_buffer one_record_of(const Buffers& buffers) {
    const auto first = first_of<boost::asio::const_buffer>(buffers);
    if (first.size() >= kRecordBytes || first.size() == boost::beast::buffer_bytes(buffers)) {
      return first;
    }
    return {record_->data(), boost::asio::buffer_copy(boost::asio::buffer(*record_), buffers)};
  }

  void read_tls(boost::asio::mutable_buffer buffer, Done done);
  void write_tls(boost::asio::const_buffer buffer, Done done);

  std::unique_ptr<next_layer_type> tcp_;
  std::unique_ptr<Tls> tls_;                                ///< refers to tcp_; null: without TLS
  std::unique_ptr<std::array<char, kRecordBytes>> record_;  ///< that is being sent, with TLS
  bool left_tls_ = false;
};

}  // namespace forcegrid::view
