// SPDX-License-Identifier: Apache-2.0
#include "view/local_stream.h"

#include <algorithm>
#include <boost/asio/buffer.hpp>
#include <boost/asio/write.hpp>
#include <chrono>
#include <utility>

#include "view/log_line.h"

namespace forcegrid::view {
namespace {

namespace asio = boost::asio;
using LocalSocket = asio::local::stream_protocol::socket;

constexpr std::size_t kPieceBytes = std::size_t{256} << 10;
constexpr std::size_t kMostWaitingBytes = std::size_t{64} << 10;

}  // namespace

/// A peer. It lives as long as an operation is under way.
class LocalConnection : public std::enable_shared_from_this<LocalConnection> {
 public:
  LocalConnection(LocalListener& listener, LocalSocket socket, std::uint64_t id)
      : listener_(&listener),
        socket_(std::move(socket)),
        id_(id),
        reader_(listener.options_.largest_payload),
        piece_(kPieceBytes) {}

  void read() {
    socket_.async_read_some(asio::buffer(piece_),
                            [self = shared_from_this()](const auto& error, std::size_t bytes) {
                              self->on_read(error, bytes);
                            });
  }

  bool send(const view_link::Frame& frame, int key) {
    view_link::Bytes bytes = view_link::bytes_of(frame);
    const auto same = std::find_if(waiting_.begin(), waiting_.end(), [key](const Waiting& one) {
      return key != 0 && one.key == key;
    });
    if (same != waiting_.end()) {
      waiting_bytes_ -= same->bytes.size();
      waiting_.erase(same);
    }
    if (waiting_bytes_ + bytes.size() > kMostWaitingBytes) {
      return false;
    }
    waiting_bytes_ += bytes.size();
    waiting_.push_back({key, std::move(bytes)});
    write();
    return true;
  }

  /// The handlers that are under way find no listener any more.
  void close() {
    listener_ = nullptr;
    boost::system::error_code ignored;
    socket_.close(ignored);
  }

 private:
  struct Waiting {
    int key;
    view_link::Bytes bytes;
  };

  void on_read(const boost::system::error_code& error, std::size_t bytes) {
    if (listener_ == nullptr) {
      return;
    }
    if (error) {
      // A peer that has not read all that was sent resets the connection when it closes it.
      const bool has_closed = error == asio::error::eof || error == asio::error::connection_reset;
      return end(has_closed ? "" : error.message());
    }
    try {
      reader_.add({piece_.data(), bytes});
      while (const auto frame = reader_.next()) {
        listener_->options_.on_frame(id_, *frame);
      }
    } catch (const view_link::ViewLinkError& broken) {
      return end(std::string("disconnected it: ") + broken.what());
    }
    read();
  }

  void write() {
    if (!now_.empty() || waiting_.empty()) {
      return;
    }
    now_ = std::move(waiting_.front().bytes);
    waiting_.pop_front();
    asio::async_write(socket_, asio::buffer(now_),
                      [self = shared_from_this()](const auto& error, std::size_t bytes) {
                        self->waiting_bytes_ -= self->now_.size();
                        self->now_.clear();
                        // An error of the socket ends the reading, too.
                        if (!error && bytes > 0 && self->listener_ != nullptr) {
                          self->write();
                        }
                      });
  }

  void end(const std::string& why) {
    LocalListener* listener = listener_;
    if (!why.empty()) {
      log_line("the " + listener->options_.peer + ": " + why);
    }
    close();
    listener->closed(id_);
  }

  LocalListener* listener_;
  LocalSocket socket_;
  std::uint64_t id_;
  view_link::FrameReader reader_;
  view_link::Bytes piece_;
  view_link::Bytes now_;  ///< that is being sent
  std::deque<Waiting> waiting_;
  std::size_t waiting_bytes_ = 0;
};

LocalListener::LocalListener(asio::io_context& context, Options options)
    : context_(context),
      options_(std::move(options)),
      acceptor_(context, asio::local::stream_protocol::endpoint(options_.path)),
      retry_(context) {
  accept();
}

LocalListener::~LocalListener() {
  for (const auto& [id, connection] : connections_) {
    connection->close();
  }
}

void LocalListener::accept() {
  acceptor_.async_accept([this](const boost::system::error_code& error, LocalSocket socket) {
    if (error == asio::error::operation_aborted) {
      return;
    }
    if (error) {  // too many open files
      log_line("the socket for a " + options_.peer + ": " + error.message());
      retry_.expires_after(std::chrono::milliseconds(100));
      retry_.async_wait([this](const boost::system::error_code& aborted) {
        if (!aborted) {
          accept();
        }
      });
      return;
    }
    if (connections_.size() < options_.most_connections) {
      const std::uint64_t id = next_id_++;
      const auto connection = std::make_shared<LocalConnection>(*this, std::move(socket), id);
      connections_.emplace(id, connection);
      connection->read();
    } else {
      log_line("refused one more " + options_.peer + "; at most " +
               std::to_string(options_.most_connections) + " at a time");
    }
    accept();
  });
}

void LocalListener::closed(std::uint64_t id) {
  connections_.erase(id);
  options_.on_closed(id);
}

bool LocalListener::send_to(std::uint64_t id, const view_link::Frame& frame, int key) {
  const auto found = connections_.find(id);
  return found != connections_.end() && found->second->send(frame, key);
}

void LocalListener::stop_accepting() {
  boost::system::error_code ignored;
  acceptor_.close(ignored);
  retry_.cancel();
}

void LocalListener::close() {
  stop_accepting();
  while (!connections_.empty()) {
    const auto [id, connection] = *connections_.begin();
    connection->close();
    closed(id);
  }
}

}  // namespace forcegrid::view
