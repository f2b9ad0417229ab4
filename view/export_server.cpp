// SPDX-License-Identifier: Apache-2.0
#include "view/export_server.h"

#include <unistd.h>

#include <array>
#include <boost/asio/buffer.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/posix/stream_descriptor.hpp>
#include <boost/asio/steady_timer.hpp>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

#include "view/export_page.h"
#include "view/export_record.h"
#include "view/local_stream.h"
#include "view_link/frame.h"

namespace forcegrid::view {
namespace {

namespace asio = boost::asio;

constexpr std::size_t kPacking = 6;  // bytes that are kept for one of the file
constexpr std::chrono::seconds kWaitForSurface{10};

class Exporter {
 public:
  Exporter(const Options& options, const std::string& folder)
      : record_(kPacking * static_cast<std::size_t>(std::lround(1e6 * options.export_MB))),
        late_(context_),
        input_(context_),
        feed_(context_, {.path = folder + "/feed",
                         .peer = "run",
                         .largest_payload = view_link::kLargestFeedPayload,
                         .most_connections = kMostTools,
                         .on_frame =
                             [this](std::uint64_t peer, const view_link::Frame& frame) {
                               record_.take_feed(peer, frame);
                               look(static_cast<view_link::FeedType>(frame.type) ==
                                    view_link::FeedType::kEnd);
                             },
                         .on_closed =
                             [this](std::uint64_t) {
                               if (!record_.complete() && !ended_) {
                                 give_up("the recording broke off");
                               }
                             }}),
        surface_(context_, {.path = folder + "/surface",
                            .peer = "simulator",
                            .largest_payload = view_link::kLargestSurfacePayload,
                            .most_connections = 1,
                            .on_frame =
                                [this](std::uint64_t peer, const view_link::Frame& frame) {
                                  record_.take_surface(peer, frame);
                                  look(false);
                                },
                            .on_closed = [](std::uint64_t) {}}) {
    if (options.until_stdin_closes) {
      const int input = ::dup(STDIN_FILENO);
      if (input >= 0) {
        input_.assign(input);
        watch_input();
      }
    }
  }

  ExportRecord& run() {
    context_.run();
    if (!why_.empty()) {
      throw ViewError("--export: " + why_);
    }
    return record_;
  }

 private:
  void look(bool end) {
    ended_ = ended_ || end;
    if (record_.complete()) {
      return context_.stop();
    }
    if (end) {
      late_.expires_after(kWaitForSurface);
      late_.async_wait([this](const boost::system::error_code& error) {
        if (!error) {
          give_up(std::to_string(record_.surfaces_missing()) +
                  " frames of the surface are missing");
        }
      });
    }
  }

  void watch_input() {
    input_.async_read_some(asio::buffer(read_),
                           [this](const boost::system::error_code& error, std::size_t) {
                             if (error) {
                               give_up("stopped");
                             } else {
                               watch_input();
                             }
                           });
  }

  void give_up(const std::string& why) {
    why_ = why;
    context_.stop();
  }

  asio::io_context context_{1};
  ExportRecord record_;
  asio::steady_timer late_;
  asio::posix::stream_descriptor input_;
  std::array<char, 64> read_{};
  bool ended_ = false;
  std::string why_;
  LocalListener feed_;
  LocalListener surface_;
};

}  // namespace

void serve_export(const Options& options, const PageFiles& files, const std::string& folder) {
  std::signal(SIGPIPE, SIG_IGN);
  if (options.until_stdin_closes) {
    std::signal(SIGINT, SIG_IGN);  // the parent decides
  }
  check_export(options.export_file);
  std::optional<Exporter> exporter;
  try {
    exporter.emplace(options, folder);
  } catch (const boost::system::system_error& error) {
    throw ViewError("cannot make the sockets in " + folder + ": " + error.code().message());
  }
  std::printf("listening - folder %s token -\n", folder.c_str());
  std::fflush(stdout);
  ExportRecord& record = exporter->run();
  const auto largest_bytes = static_cast<std::size_t>(std::lround(1e6 * options.export_MB));
  const std::string page = exported_page(files, record, largest_bytes);
  write_export(options.export_file, page);
  nlohmann::json kept;
  for (const auto& [name, kind] :
       {std::pair{"rows", ExportKind::kRows}, std::pair{"samples", ExportKind::kSamples},
        std::pair{"arm", ExportKind::kArm}, std::pair{"surface", ExportKind::kSurface},
        std::pair{"field", ExportKind::kField}, std::pair{"places", ExportKind::kPlaces}}) {
    const ExportRecord::Kept count = record.kept(kind);
    kept[name] = {{"kept", count.kept}, {"of", count.all}};
  }
  const nlohmann::json line = {{"file", options.export_file},
                               {"bytes", page.size()},
                               {"left_out", record.left_out()},
                               {"messages", kept}};
  std::puts(line.dump().c_str());
  std::fflush(stdout);
}

}  // namespace forcegrid::view
