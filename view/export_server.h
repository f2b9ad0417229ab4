// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "view/options.h"
#include "view/page_files.h"

namespace forcegrid::view {

/// Takes one recording over the sockets `feed` and `surface` in `folder`, as the live view does,
/// and writes it to options.export_file as a page that needs nothing else. Prints the ready line
/// before, and one line of JSON at the end: file, bytes, left_out, kept.
/// @throws ViewError naming the file and the reason, or if the recording breaks off.
/// Real-time: no. Threads: one.
void serve_export(const Options& options, const PageFiles& files, const std::string& folder);

}  // namespace forcegrid::view
