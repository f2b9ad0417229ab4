// SPDX-License-Identifier: Apache-2.0
#include "view/server.h"

#include <sys/socket.h>
#include <unistd.h>

#include <boost/asio/buffer.hpp>
#include <boost/asio/post.hpp>
#include <chrono>
#include <csignal>
#include <utility>

#include "view/access.h"
#include "view/http_session.h"
#include "view/log_line.h"

namespace forcegrid::view {
namespace {

namespace asio = boost::asio;
using asio::ip::tcp;

constexpr long kMostConnections = 32;
constexpr std::size_t kMostSimulators = 4;
constexpr std::chrono::milliseconds kRetry{100};
constexpr std::chrono::milliseconds kLastWordsOfTheRun{300};
constexpr std::chrono::milliseconds kStep{10};
constexpr int kStepsForGoodbyes = 50;
// The kernel would take megabytes, and a slow page would look at the past.
constexpr int kSendBufferBytes = 256 << 10;

// One more than there may be: it is told so, and not waited for.
void refuse(tcp::socket socket) {
  HttpAnswer full;
  answer_and_close("503 Service Unavailable", "There are 32 connections already.", full);
  const std::string text = full.head + std::string(full.body);
  boost::system::error_code ignored;
  socket.non_blocking(true, ignored);
  socket.write_some(asio::buffer(text), ignored);
  socket.shutdown(tcp::socket::shutdown_both, ignored);
}

}  // namespace

Server::Server(const Options& options, std::optional<Certificate> certificate, std::string token,
               PageFiles files, std::string folder)
    : http_{{.address = options.address, .port = options.port}, std::move(token), std::move(files)},
      folder_(std::move(folder)),
      hub_([this](std::uint64_t run, const view_link::Frame& frame, PageCommand::What what,
                  bool newest) { return send_to_run(run, frame, what, newest); },
           [this](std::uint64_t simulator, const view_link::Frame& wish) {
             // One that does not read its wishes lacks nothing else.
             static_cast<void>(surface_ && surface_->send_to(simulator, wish, 1));
           }),
      acceptor_(context_),
      retry_(context_),
      goodbye_(context_),
      signals_(context_),
      standard_input_(context_),
      until_stdin_closes_(options.until_stdin_closes) {
  if (certificate) {
    http_.site.encrypted = true;
    http_.site.machine = name_of_machine();
    http_.site.names = std::move(certificate->names);
    certificate_sha256_ = certificate->sha256;
    tls_.emplace(certificate->context.release());  // takes ownership
  }
  wait_for_signals();
  listen_for_browsers(options);
  listen_for_peers();
  accept();
}

Server::~Server() { hub_.forget_viewers(); }

void Server::listen_for_browsers(const Options& options) {
  try {
    const tcp::endpoint endpoint(asio::ip::make_address(options.address), options.port);
    acceptor_.open(endpoint.protocol());
    acceptor_.set_option(tcp::acceptor::reuse_address(true));
    acceptor_.bind(endpoint);
    acceptor_.listen();
    http_.site.port = acceptor_.local_endpoint().port();
  } catch (const boost::system::system_error& error) {
    throw ViewError("cannot listen at " + address_and_port(options.address, options.port) + ": " +
                    error.code().message() + "; --listen 127.0.0.1:0 takes any port that is free");
  }
}

void Server::listen_for_peers() {
  try {
    feed_.emplace(context_, LocalListener::Options{
                                .path = folder_ + "/feed",
                                .peer = "run",
                                .largest_payload = view_link::kLargestFeedPayload,
                                .most_connections = kMostTools,
                                .on_frame =
                                    [this](std::uint64_t run, const view_link::Frame& frame) {
                                      hub_.take_feed(run, frame);
                                    },
                                .on_closed =
                                    [this](std::uint64_t run) {
                                      hub_.feed_lost(run);
                                      if (stopping_ && !feed_->has_peer()) {
                                        finish_pages();
                                      }
                                    }});
    surface_.emplace(
        context_,
        LocalListener::Options{
            .path = folder_ + "/surface",
            .peer = "simulator",
            .largest_payload = view_link::kLargestSurfacePayload,
            .most_connections = kMostSimulators,
            .on_frame = [this](std::uint64_t peer,
                               const view_link::Frame& frame) { hub_.take_surface(peer, frame); },
            .on_closed = [this](std::uint64_t peer) { hub_.surface_lost(peer); }});
  } catch (const boost::system::system_error& error) {
    throw ViewError("cannot make the sockets in " + folder_ + ": " + error.code().message());
  }
}

std::string Server::ready_line() const {
  return "listening " + address_and_port(http_.site.address, http_.site.port) + " folder " +
         folder_ + " token " + http_.token + (tls_ ? " certificate " + certificate_sha256_ : "");
}

bool Server::send_to_run(std::uint64_t run, const view_link::Frame& frame, PageCommand::What what,
                         bool newest) {
  return feed_ && feed_->send_to(run, frame, newest ? 1 + static_cast<int>(what) : 0);
}

void Server::run() {
  if (until_stdin_closes_) {
    const int input = ::dup(STDIN_FILENO);
    if (input < 0) {
      asio::post(context_, [this] { stop(); });
    } else {
      standard_input_.assign(input);
      watch_standard_input();
    }
  }
  context_.run();
}

void Server::accept() {
  acceptor_.async_accept([this](const boost::system::error_code& error, tcp::socket socket) {
    if (error == asio::error::operation_aborted) {
      return;
    }
    if (!error) {
      take_browser(std::move(socket));
      return accept();
    }
    log_line("cannot take a connection: " + error.message());
    retry_.expires_after(kRetry);  // too many open files: some will close
    retry_.async_wait([this](const boost::system::error_code& aborted) {
      if (!aborted) {
        accept();
      }
    });
  });
}

void Server::take_browser(tcp::socket socket) {
  if (slot_.use_count() > kMostConnections) {
    log_line("refused a connection; there are " + std::to_string(kMostConnections) + " already");
    if (!tls_) {
      refuse(std::move(socket));
    }  // a peer that waits for TLS would not understand a sentence
    return;
  }
  boost::system::error_code ignored;
  socket.set_option(tcp::no_delay(true), ignored);
  socket.set_option(asio::socket_base::send_buffer_size(kSendBufferBytes), ignored);
  std::make_shared<HttpSession>(BrowserStream(std::move(socket), tls_ ? &*tls_ : nullptr), http_,
                                slot_,
                                [this](BrowserStream upgraded, ConnectionSlot slot,
                                       const WebSocketSession::Request& request) {
                                  open_web_socket(std::move(upgraded), std::move(slot), request);
                                })
      ->run();
}

void Server::open_web_socket(BrowserStream stream, ConnectionSlot slot,
                             const WebSocketSession::Request& request) {
  std::erase_if(pages_, [](const auto& page) { return page.expired(); });
  const auto page = std::make_shared<WebSocketSession>(std::move(stream), hub_, std::move(slot));
  pages_.push_back(page);
  page->run(request);
}

void Server::wait_for_signals() {
  std::signal(SIGPIPE, SIG_IGN);
  signals_.add(SIGTERM);
  signals_.add(SIGHUP);
  // Ctrl-C in a terminal reaches the parent, too. It decides, and its last words are to be shown.
  if (until_stdin_closes_) {
    std::signal(SIGINT, SIG_IGN);
  } else {
    signals_.add(SIGINT);
  }
  signals_.async_wait([this](const boost::system::error_code& error, int) {
    if (!error) {
      stop();
    }
  });
}

void Server::watch_standard_input() {
  standard_input_.async_read_some(asio::buffer(input_),
                                  [this](const boost::system::error_code& error, std::size_t) {
                                    if (error == asio::error::operation_aborted) {
                                      return;
                                    }
                                    if (error) {
                                      stop();
                                    } else {
                                      watch_standard_input();
                                    }
                                  });
}

void Server::stop() {
  if (stopping_) {
    return;
  }
  stopping_ = true;
  boost::system::error_code ignored;
  acceptor_.close(ignored);
  retry_.cancel();
  feed_->stop_accepting();
  if (!feed_->has_peer()) {
    return finish_pages();
  }
  goodbye_.expires_after(kLastWordsOfTheRun);
  goodbye_.async_wait([this](const boost::system::error_code& error) {
    if (!error) {
      finish_pages();
    }
  });
}

void Server::finish_pages() {
  if (finishing_) {
    return;
  }
  finishing_ = true;
  goodbye_.cancel();
  feed_->close();
  for (const auto& weak : pages_) {
    if (const auto page = weak.lock()) {
      page->finish();
    }
  }
  wait_for_pages(kStepsForGoodbyes);
}

void Server::wait_for_pages(int steps) {
  std::erase_if(pages_, [](const auto& page) { return page.expired(); });
  if (pages_.empty() || steps == 0) {
    return context_.stop();
  }
  goodbye_.expires_after(kStep);
  goodbye_.async_wait([this, steps](const boost::system::error_code& error) {
    if (!error) {
      wait_for_pages(steps - 1);
    }
  });
}

}  // namespace forcegrid::view
