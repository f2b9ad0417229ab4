// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "cli/common/json_target.h"
#include "cli/common/options.h"

namespace forcegrid::cli {

struct ViewOptions {
  std::vector<std::string> files;      ///< a recording, or those of one run with several devices
  std::string listen = "127.0.0.1:0";  ///< ADDR:PORT of the page
  std::string view_key;                ///< PEM file that encrypts the page; empty: it is not
  bool open = false;                   ///< ask the desktop to open it
  std::string export_file;             ///< one file with everything instead; empty: none
  double export_MB = 20.0;             ///< its largest size
  JsonTarget json;
};

void add_view(Command& app, ViewOptions& o, std::function<int()>& action);

/// Shows recordings in a browser until it is asked to stop, or writes them as a page.
/// @returns the program's exit status: 0, or 1 if the live view broke off.
/// @throws std::exception with a sentence for the user.
int view_command(const ViewOptions& options);

}  // namespace forcegrid::cli
