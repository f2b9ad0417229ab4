// SPDX-License-Identifier: Apache-2.0
#include "cli/playback/view_command.h"

#include <chrono>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <optional>
#include <stdexcept>

#include "cli/common/number_check.h"
#include "cli/common/progress_line.h"
#include "cli/common/stop_request.h"
#include "cli/playback/one_run.h"
#include "cli/playback/player.h"
#include "cli/run/view_process.h"
#include "log/log.h"
#include "tools/hdf5_file.h"

namespace forcegrid::cli {
namespace {

bool stops() { return StopRequest::stop().load(); }

int show(const RecordedRuns& runs, const ViewOptions& options) {
  const ViewProcess process(options.listen, options.view_key);
  Player player(runs, {process.feed_socket(), process.surface_socket()});
  std::fputs(process.address_text().c_str(), stderr);  // not to the log: it has the token
  if (options.open) {
    const std::string why_not = process.open_browser();
    if (!why_not.empty()) {
      log::warn("view", "--open: " + why_not + "; open the address yourself");
    }
  }
  std::string why;
  try {
    why = player.play(stops);
  } catch (const tools::Hdf5Error& error) {
    player.end(error.what(), 1);
    player.finish(0.5);
    throw;
  }
  player.end(why.empty() ? "'forcegrid view' was stopped" : why, why.empty() ? 0 : 1);
  player.finish(0.5);
  if (!why.empty()) {
    log::error("view", why);
  }
  return why.empty() ? 0 : 1;
}

// "1.2 MB".
std::string size_text(double bytes) {
  char text[32];
  std::snprintf(text, sizeof text, "%.1f MB", 1e-6 * bytes);
  return text;
}

int write_page(const RecordedRuns& runs, const ViewOptions& options) {
  ViewProcess process(options.export_file, options.export_MB);
  ProgressLine line;
  line.begin("Exporting " + options.export_file);
  Player player(runs, {process.feed_socket(), process.surface_socket()});
  if (player.send_all(stops)) {
    player.end("", 0);
    while (!stops() && !player.finish(0.1)) {
    }
  }
  std::optional<std::string> said;
  while (!said && !stops()) {
    said = process.exported(std::chrono::milliseconds(100));
  }
  line.clear();
  if (!said) {
    throw std::runtime_error("stopped; " + options.export_file + " was not written");
  }
  const nlohmann::json result = nlohmann::json::parse(*said);
  const std::string left_out = result.at("left_out");
  say_result(options.json, "view",
             options.export_file + ": " + size_text(result.at("bytes")) +
                 ", opens in a browser without anything else" +
                 (left_out.empty() ? ""
                                   : "; to stay below " + size_text(1e6 * options.export_MB) +
                                         " it has only " + left_out));
  write_json(options.json, result.dump(2));
  return 0;
}

}  // namespace

void add_view(Command& app, ViewOptions& o, std::function<int()>& action) {
  Command& view = app.add_subcommand("view", "Show recordings in a browser: play, scrub, export");
  view.add_option("FILE", o.files,
                  "Recording of forcegrid record; also of a run that was killed. Several: those of "
                  "one run with several devices")
      ->required();
  view.add_option("--listen", o.listen,
                  "ADDR:PORT of the page; without --view-key loopback only; port 0: a free one")
      ->show_default()
      ->type_name("ADDR:PORT")
      ->not_in_config();
  Option* const key =
      view.add_option("--view-key", o.view_key,
                      "Serve the page encrypted, with the private key and certificate of this file")
          ->type_name("FILE.pem")
          ->not_in_config();
  view.add_flag("--open", o.open, "Open the page in the desktop's browser")->not_in_config();
  view.add_option("--export", o.export_file,
                  "Write it as one page that needs nothing else, instead of serving it")
      ->type_name("FILE.html")
      ->not_in_config()
      ->excludes(key);
  view.add_option("--export-MB", o.export_MB,
                  "Largest size of that file; what does not fit is thinned out, and said")
      ->check(between(5.0, 500.0))
      ->show_default()
      ->type_name("FLOAT MB")
      ->not_in_config();
  view.callback([&o, &action] { action = [&o] { return view_command(o); }; });
}

int view_command(const ViewOptions& options) {
  ProgressLine line;
  line.begin("Reading " + options.files.front());
  const RecordedRuns runs = recordings_of_one_run(options.files);
  line.clear();
  return options.export_file.empty() ? show(runs, options) : write_page(runs, options);
}

}  // namespace forcegrid::cli
