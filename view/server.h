// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/posix/stream_descriptor.hpp>
#include <boost/asio/signal_set.hpp>
#include <boost/asio/ssl/context.hpp>
#include <boost/asio/steady_timer.hpp>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "view/browser_stream.h"
#include "view/certificate.h"
#include "view/http_answer.h"
#include "view/local_stream.h"
#include "view/options.h"
#include "view/tool_hubs.h"
#include "view/web_socket_session.h"

namespace forcegrid::view {

/// The live view: browsers on a TCP port, runs and simulators on two Unix sockets, all on the
/// thread that calls run(). Real-time: no. Threads: one.
class Server {
 public:
  /// Listens, and takes signals from now on. `folder` is where the sockets `feed` and `surface` are
  /// made.
  /// @param certificate  for TLS; nothing: without it.
  /// @throws ViewError naming the address or socket and the system's reason.
  Server(const Options& options, std::optional<Certificate> certificate, std::string token,
         PageFiles files, std::string folder);
  ~Server();
  Server(const Server&) = delete;
  Server& operator=(const Server&) = delete;

  /// "listening ADDR:PORT folder FOLDER token TOKEN", with TLS " certificate SHA256" after it
  std::string ready_line() const;
  /// Serves until a signal (SIGTERM, SIGHUP; SIGINT unless options.until_stdin_closes), or until
  /// standard input closes if options.until_stdin_closes. Then it takes what the run still sends,
  /// for at most 0.3 s, and says goodbye to the pages, for at most 0.5 s.
  void run();

 private:
  void listen_for_browsers(const Options& options);
  void listen_for_peers();
  void accept();
  void take_browser(boost::asio::ip::tcp::socket socket);
  void open_web_socket(BrowserStream stream, ConnectionSlot slot,
                       const WebSocketSession::Request& request);
  bool send_to_run(std::uint64_t run, const view_link::Frame& frame, PageCommand::What what,
                   bool newest);
  void wait_for_signals();
  void watch_standard_input();
  void stop();
  void finish_pages();
  void wait_for_pages(int steps);

  // What pages and requests refer to outlives the context, which holds them.
  HttpServer http_;
  std::string certificate_sha256_;
  std::optional<boost::asio::ssl::context> tls_;
  std::string folder_;
  ToolHubs hub_;
  boost::asio::io_context context_{1};
  boost::asio::ip::tcp::acceptor acceptor_;
  boost::asio::steady_timer retry_;
  boost::asio::steady_timer goodbye_;
  boost::asio::signal_set signals_;
  boost::asio::posix::stream_descriptor standard_input_;
  std::array<char, 256> input_{};
  std::optional<LocalListener> feed_;
  std::optional<LocalListener> surface_;
  ConnectionSlot slot_ = std::make_shared<int>(0);  ///< its owners are the connections, and this
  std::vector<std::weak_ptr<WebSocketSession>> pages_;
  bool until_stdin_closes_;
  bool stopping_ = false;
  bool finishing_ = false;
};

}  // namespace forcegrid::view
